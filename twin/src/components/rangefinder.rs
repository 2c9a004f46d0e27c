//! The US-015: a trigger pulse starts a burst, the echo line is high as long as the sound travels.

/// The shortest trigger, nanoseconds (board notes: at least 10 µs).
const TRIGGER_NS: u64 = 10_000;
/// From the trigger's end to the echo line's rise: the burst of eight periods of 40 kHz and what
/// the sensor's controller needs; a choice within what such sensors show.
const BURST_NS: u64 = 250_000;
/// How long the line stays high without an echo; a choice within what such sensors show.
const NO_ECHO_NS: u64 = 38_000_000;

/// One rangefinder.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rangefinder {
    triggered: Option<u64>,
    rise: Option<u64>,
    fall: Option<u64>,
}

impl Rangefinder {
    /// The trigger line changed. Answers whether this starts a measurement, which the caller then
    /// hands over with [`Rangefinder::measure`].
    pub fn trigger(&mut self, now: u64, high: bool) -> bool {
        if high {
            self.triggered = Some(now);
            return false;
        }
        let long_enough = self
            .triggered
            .take()
            .is_some_and(|since| now - since >= TRIGGER_NS);
        long_enough && self.fall.is_none()
    }

    /// A burst leaves at `now`; its echo takes `echo_us` microseconds, or never returns. Answers when it
    /// comes back.
    pub fn measure(&mut self, now: u64, echo_us: Option<f64>) -> Option<u64> {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "an echo takes microseconds to milliseconds"
        )]
        let width = echo_us.map_or(NO_ECHO_NS, |us| (us * 1000.0) as u64);
        let rise = now + BURST_NS;
        self.rise = Some(rise);
        self.fall = Some(rise + width);
        echo_us.and(self.fall)
    }

    /// Sound arrives at `at`: a sensor that listens then cannot tell whose it is.
    pub fn hear(&mut self, at: u64, now: u64) {
        let listens = self.rise.unwrap_or(now) <= at;
        if let Some(fall) = self.fall.filter(|&fall| listens && at < fall) {
            self.fall = Some(at.min(fall));
        }
    }

    /// When the echo line changes next.
    #[must_use]
    pub fn next(&self) -> Option<u64> {
        self.rise.or(self.fall)
    }

    /// The echo line's next level, if it changes by `now`.
    pub fn take(&mut self, now: u64) -> Option<bool> {
        if let Some(rise) = self.rise {
            if rise <= now {
                self.rise = None;
                return Some(true);
            }
        } else if self.fall.is_some_and(|fall| fall <= now) {
            self.fall = None;
            return Some(false);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_echo_line_is_high_as_long_as_the_sound_travels() {
        let mut ranger = Rangefinder::default();
        assert!(!ranger.trigger(0, true));
        assert!(ranger.trigger(10_000, false));
        ranger.measure(10_000, Some(1000.0));
        assert_eq!(ranger.take(259_999), None);
        assert_eq!(ranger.take(260_000), Some(true));
        assert_eq!(ranger.next(), Some(1_260_000));
        assert_eq!(ranger.take(1_260_000), Some(false));
        assert_eq!(ranger.next(), None);
    }

    #[test]
    fn anybodys_sound_ends_an_echo_that_is_still_awaited() {
        let mut ranger = Rangefinder::default();
        assert_eq!(ranger.measure(0, None), None);
        ranger.hear(100_000, 0);
        assert_eq!(ranger.fall, Some(38_250_000), "before it listens");
        ranger.hear(9_000_000, 0);
        assert_eq!(ranger.fall, Some(9_000_000));
        ranger.hear(12_000_000, 0);
        assert_eq!(ranger.fall, Some(9_000_000), "after its end");
        assert_eq!(ranger.take(9_000_000), Some(true));
        assert_eq!(ranger.take(9_000_000), Some(false));
        ranger.hear(10_000_000, 9_500_000);
        assert_eq!(ranger.next(), None);
    }

    #[test]
    fn a_short_trigger_and_one_during_a_measurement_do_nothing() {
        let mut ranger = Rangefinder::default();
        ranger.trigger(0, true);
        assert!(!ranger.trigger(9_999, false));
        ranger.trigger(20_000, true);
        assert!(ranger.trigger(30_000, false));
        ranger.measure(30_000, None);
        ranger.trigger(40_000, true);
        assert!(!ranger.trigger(60_000, false));
    }
}
