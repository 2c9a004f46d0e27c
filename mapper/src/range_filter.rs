//! Which readings enter the map.
//!
//! One value per rangefinder arrives with every frame, but a rangefinder measures only a few times
//! per second: the same value again is the same measurement at an outdated pose. And an ultrasonic
//! sensor occasionally receives another source of sound or a multi-path echo. Such an outlier is
//! isolated, while a real surface is measured again as far as the robot has moved and turned in
//! between. So each new reading is held until its successor arrives, and accepted if its
//! predecessor or its successor agrees.

use crate::Pose2;

/// Limits of the agreement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gate {
    /// Difference allowed at rest, mm.
    pub still_mm: f64,
    /// Nearest and farthest reading accepted, mm.
    pub limits_mm: (f64, f64),
}

/// One measurement and the sensor's pose at the time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reading {
    pub sensor: Pose2,
    pub range_mm: Option<f64>,
}

/// The outcome of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Verdict {
    /// Nothing to decide yet.
    Pending,
    /// The previous reading is accepted.
    Accepted(Reading),
    /// The previous reading is isolated.
    Outlier,
    /// The same measurement again, or one outside the sensor's limits.
    Ignored,
}

/// The filter of one rangefinder.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RangeFilter {
    gate: Gate,
    before: Option<Reading>,
    pending: Option<Reading>,
}

/// A reading without an echo is new when the sensor has moved this far, mm, or turned this far,
/// radians.
const SILENT_MOVE: (f64, f64) = (30.0, 0.05);

impl RangeFilter {
    pub(crate) const fn new(gate: Gate) -> Self {
        Self {
            gate,
            before: None,
            pending: None,
        }
    }

    /// Takes the latest value of the rangefinder, which may be the last measurement again.
    // Requirement: DOC-2.2-4
    pub(crate) fn take(&mut self, reading: Reading) -> Verdict {
        if self.pending.is_some_and(|last| is_repeat(&last, &reading)) {
            return Verdict::Ignored;
        }
        self.take_new(reading)
    }

    /// Takes a value of a new measurement.
    pub(crate) fn take_new(&mut self, reading: Reading) -> Verdict {
        let (nearest, farthest) = self.gate.limits_mm;
        let within = |range| nearest <= range && range <= farthest;
        if !reading.range_mm.is_none_or(within) {
            return Verdict::Ignored;
        }
        let Some(last) = self.pending.replace(reading) else {
            return Verdict::Pending;
        };
        let before = self.before.replace(last);
        if before.is_some_and(|before| self.agree(&before, &last)) || self.agree(&last, &reading) {
            Verdict::Accepted(last)
        } else {
            Verdict::Outlier
        }
    }

    fn agree(&self, a: &Reading, b: &Reading) -> bool {
        match (a.range_mm, b.range_mm) {
            (None, None) => true,
            (Some(one), Some(two)) => {
                let (moved, turned) = between(&a.sensor, &b.sensor);
                // An oblique wall changes the range by up to the way moved, and by
                // range · turn · tan(obliqueness) when turning; 45° is allowed for.
                let allowed = self.gate.still_mm + moved + turned * one.max(two);
                (one - two).abs() <= allowed
            }
            _ => false,
        }
    }
}

fn between(a: &Pose2, b: &Pose2) -> (f64, f64) {
    (a.distance_mm(b), a.turn_to_rad(b).abs())
}

#[allow(clippy::float_cmp)] // the same code of the wire decodes to the same number
fn is_repeat(last: &Reading, now: &Reading) -> bool {
    match (last.range_mm, now.range_mm) {
        (Some(a), Some(b)) => a == b,
        (None, None) => {
            let (moved, turned) = between(&last.sensor, &now.sensor);
            moved < SILENT_MOVE.0 && turned < SILENT_MOVE.1
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(x_mm: f64, range_mm: Option<f64>) -> Reading {
        Reading {
            sensor: Pose2::new(x_mm, 0.0, 0.0),
            range_mm,
        }
    }

    fn filter() -> RangeFilter {
        RangeFilter::new(Gate {
            still_mm: 40.0,
            limits_mm: (30.0, 2490.0),
        })
    }

    // Requirement: DOC-2.2-4
    #[test]
    fn filter_accepts_readings_that_a_neighbour_confirms() {
        // Sensor's x and range, mm; a range of 0 is a missing echo.
        let still = |ranges: &[f64]| ranges.iter().map(|&r| (0.0, r)).collect::<Vec<_>>();
        for (name, readings, expected) in [
            (
                "outlier is dropped, its neighbours stay",
                still(&[1000.0, 1001.0, 350.0, 999.0, 1002.0, 1003.0]),
                &[1000.0, 1001.0, 999.0, 1002.0][..],
            ),
            (
                "edge of a surface is kept on both sides",
                still(&[1000.0, 1001.0, 400.0, 401.0, 402.0]),
                &[1000.0, 1001.0, 400.0, 401.0],
            ),
            (
                "repeated value is the same measurement",
                vec![(0.0, 500.0), (9.0, 500.0), (18.0, 500.5)],
                &[500.0],
            ),
            (
                "single missing echo is dropped",
                vec![(0.0, 500.0), (40.0, 0.0), (80.0, 501.0), (90.0, 502.0)],
                &[501.0],
            ),
            (
                "lasting silence is accepted",
                vec![(0.0, 0.0), (40.0, 0.0), (80.0, 0.0)],
                &[0.0, 0.0],
            ),
            (
                "silence repeated within 30 mm is the same measurement",
                vec![(0.0, 0.0), (29.0, 0.0), (58.0, 0.0)],
                &[0.0],
            ),
            (
                "the robot's own motion explains the change",
                vec![(0.0, 1000.0), (300.0, 700.0), (600.0, 400.0)],
                &[1000.0, 700.0],
            ),
        ] {
            let mut filter = filter();
            let take = |(x_mm, range)| {
                let range_mm = (range > 0.0).then_some(range);
                match filter.take(reading(x_mm, range_mm)) {
                    Verdict::Accepted(reading) => Some(reading.range_mm.unwrap_or(0.0)),
                    _ => None,
                }
            };
            let accepted: Vec<f64> = readings.into_iter().filter_map(take).collect();
            assert_eq!(accepted, expected, "{name}");
        }
    }

    #[test]
    fn readings_outside_limits_are_ignored() {
        let mut filter = filter();
        for range in [20.0, f64::NAN, 2500.0] {
            assert_eq!(filter.take(reading(0.0, Some(range))), Verdict::Ignored);
        }
    }
}
