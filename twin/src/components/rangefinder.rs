//! The US-015: a trigger pulse starts a burst, the echo line is high as long as the sound travels.

/// The shortest trigger, nanoseconds (board notes: at least 10 µs).
const TRIGGER_NS: u64 = 10_000;
/// From the trigger's end to the echo line's rise: the burst of eight periods of 40 kHz and what
/// the sensor's controller adds; typical of such sensors.
const BURST_NS: u64 = 250_000;
/// How long the line stays high without an echo; typical of such sensors.
const NO_ECHO_NS: u64 = 38_000_000;

/// One rangefinder.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rangefinder {
    triggered: Option<u64>,
    rise: Option<u64>,
    fall: Option<u64>,
}

impl Rangefinder {
    /// The trigger line changed. Returns whether this starts a measurement, which the caller then
    /// gives to [`Rangefinder::measure`].
    pub fn trigger(&mut self, now: u64, high: bool) -> bool {
        if high {
            self.triggered = Some(now);
            return false;
        }
        let risen = self.triggered.take();
        risen.is_some_and(|since| now - since >= TRIGGER_NS) && self.fall.is_none()
    }

    /// Starts a measurement at `now` whose echo takes `echo_us` microseconds, or never returns. Returns
    /// when it arrives.
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

    /// Another sensor's echo arrives at `at`: it ends a measurement that is waiting for its own.
    pub fn receive_crosstalk(&mut self, at: u64, now: u64) {
        let listens = self.rise.unwrap_or(now) <= at;
        if self.fall.is_some_and(|fall| listens && at < fall) {
            self.fall = Some(at);
        }
    }

    /// When the echo line changes next.
    pub fn next_event(&self) -> Option<u64> {
        self.rise.or(self.fall)
    }

    /// The echo line's next level, if it changes by `now`.
    pub fn take(&mut self, now: u64) -> Option<bool> {
        if self.rise.is_some() {
            return self.rise.take_if(|rise| *rise <= now).map(|_| true);
        }
        self.fall.take_if(|fall| *fall <= now).map(|_| false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn echo_line_is_high_for_time_of_flight() {
        let mut sensor = Rangefinder::default();
        assert!(!sensor.trigger(0, true));
        assert!(sensor.trigger(10_000, false));
        sensor.measure(10_000, Some(1000.0));
        assert_eq!(sensor.take(259_999), None);
        assert_eq!(sensor.take(260_000), Some(true));
        assert_eq!(sensor.next_event(), Some(1_260_000));
        assert_eq!(sensor.take(1_260_000), Some(false));
        assert_eq!(sensor.next_event(), None);
    }

    #[test]
    fn crosstalk_ends_pending_measurement() {
        let mut sensor = Rangefinder::default();
        assert_eq!(sensor.measure(0, None), None);
        sensor.receive_crosstalk(100_000, 0);
        assert_eq!(sensor.fall, Some(38_250_000), "before it listens");
        sensor.receive_crosstalk(9_000_000, 0);
        assert_eq!(sensor.fall, Some(9_000_000));
        sensor.receive_crosstalk(12_000_000, 0);
        assert_eq!(sensor.fall, Some(9_000_000), "after its end");
        assert_eq!(sensor.take(9_000_000), Some(true));
        assert_eq!(sensor.take(9_000_000), Some(false));
        sensor.receive_crosstalk(10_000_000, 9_500_000);
        assert_eq!(sensor.next_event(), None);
    }

    #[test]
    fn short_or_early_trigger_is_ignored() {
        let mut sensor = Rangefinder::default();
        sensor.trigger(0, true);
        assert!(!sensor.trigger(9_999, false));
        sensor.trigger(20_000, true);
        assert!(sensor.trigger(30_000, false));
        sensor.measure(30_000, None);
        sensor.trigger(40_000, true);
        assert!(!sensor.trigger(60_000, false));
    }
}
