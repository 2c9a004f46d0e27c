//! The servo's control line: pulse widths from its edges.

/// The line, and when it rose.
#[derive(Clone, Copy, Debug, Default)]
pub struct ServoLine {
    rose: Option<u64>,
}

impl ServoLine {
    /// The line has this level at `now`, nanoseconds. Returns the width of the pulse that this ends,
    /// microseconds.
    #[expect(clippy::cast_precision_loss, reason = "a pulse is milliseconds")]
    pub fn level(&mut self, now: u64, high: bool) -> Option<f64> {
        if high {
            self.rose.get_or_insert(now);
            return None;
        }
        self.rose.take().map(|rose| (now - rose) as f64 / 1000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulse_width_is_time_at_high_level() {
        let mut line = ServoLine::default();
        assert_eq!(line.level(5, false), None);
        assert_eq!(line.level(1_000, true), None);
        assert_eq!(line.level(900_000, true), None);
        assert_eq!(line.level(1_501_000, false), Some(1500.0));
        assert_eq!(line.level(1_600_000, false), None);
    }
}
