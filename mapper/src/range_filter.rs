//! Which readings are believed.
//!
//! One value per rangefinder arrives with every frame, but a rangefinder measures only a few times
//! per second: the same value again is the same measurement again, at a pose it does not belong to.
//! And an ultrasonic sensor now and then hears something else: another sensor's echo, a second
//! reflection, a slamming door. Such a reading stands alone, while a real surface is seen again by
//! the next one, as far as the robot has moved and turned in between. So each new reading waits for
//! its successor and is believed if its predecessor or its successor agrees.

use crate::Pose;

/// Limits of the agreement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gate {
    /// Difference allowed at rest, mm.
    pub still_mm: f64,
    /// Nearest and farthest reading believed, mm.
    pub limits_mm: (f64, f64),
}

/// One measurement and the sensor's pose at the time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reading {
    pub sensor: Pose,
    pub range_mm: Option<f64>,
}

/// What became of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Verdict {
    /// Nothing to decide yet.
    Waiting,
    /// The previous reading is believed.
    Believed(Reading),
    /// The previous reading stood alone.
    Alone,
    /// The same measurement again, or one outside the sensor's limits.
    Ignored,
}

/// The filter of one rangefinder.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Filter {
    gate: Gate,
    before: Option<Reading>,
    waiting: Option<Reading>,
}

/// A reading without an echo is new when the sensor has moved this far, mm, or turned this far,
/// radians.
const SILENT_MOVE: (f64, f64) = (30.0, 0.05);

impl Filter {
    pub(crate) const fn new(gate: Gate) -> Self {
        Self {
            gate,
            before: None,
            waiting: None,
        }
    }

    /// Takes the latest value of the rangefinder, which may be the last measurement again.
    // Requirement: DOC-2.2-4
    pub(crate) fn take(&mut self, reading: Reading) -> Verdict {
        if self.waiting.is_some_and(|last| is_repeat(&last, &reading)) {
            return Verdict::Ignored;
        }
        self.take_new(reading)
    }

    /// Takes a value that is known to be of a measurement of its own.
    pub(crate) fn take_new(&mut self, reading: Reading) -> Verdict {
        let believable = reading
            .range_mm
            .is_none_or(|range| range >= self.gate.limits_mm.0 && range <= self.gate.limits_mm.1);
        if !believable {
            return Verdict::Ignored;
        }
        let Some(last) = self.waiting.replace(reading) else {
            return Verdict::Waiting;
        };
        let before = self.before.replace(last);
        if before.is_some_and(|before| self.agree(&before, &last)) || self.agree(&last, &reading) {
            Verdict::Believed(last)
        } else {
            Verdict::Alone
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

fn between(a: &Pose, b: &Pose) -> (f64, f64) {
    let moved = (a.x_mm - b.x_mm).hypot(a.y_mm - b.y_mm);
    let turn = (a.heading_rad - b.heading_rad).rem_euclid(std::f64::consts::TAU);
    (moved, turn.min(std::f64::consts::TAU - turn))
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

    fn filter() -> Filter {
        Filter::new(Gate {
            still_mm: 40.0,
            limits_mm: (30.0, 2490.0),
        })
    }

    fn at(x: f64, range_mm: Option<f64>) -> Reading {
        Reading {
            sensor: Pose::new(x, 0.0, 0.0),
            range_mm,
        }
    }

    fn believed(readings: &[Reading]) -> Vec<f64> {
        let mut filter = filter();
        readings
            .iter()
            .filter_map(|reading| match filter.take(*reading) {
                Verdict::Believed(reading) => Some(reading.range_mm.unwrap_or(-1.0)),
                _ => None,
            })
            .collect()
    }

    // Requirement: DOC-2.2-4
    #[test]
    fn a_lone_wild_reading_is_dropped_and_its_neighbours_stay() {
        let ranges = [1000.0, 1001.0, 350.0, 999.0, 1002.0, 1003.0];
        let readings: Vec<Reading> = ranges.iter().map(|r| at(0.0, Some(*r))).collect();
        assert_eq!(believed(&readings), [1000.0, 1001.0, 999.0, 1002.0]);
    }

    #[test]
    fn the_edge_of_a_surface_is_kept_on_both_sides() {
        let ranges = [1000.0, 1001.0, 400.0, 401.0, 402.0];
        let readings: Vec<Reading> = ranges.iter().map(|r| at(0.0, Some(*r))).collect();
        assert_eq!(believed(&readings), [1000.0, 1001.0, 400.0, 401.0]);
    }

    #[test]
    fn a_repeated_value_is_the_same_measurement() {
        let readings = [
            at(0.0, Some(500.0)),
            at(9.0, Some(500.0)),
            at(18.0, Some(500.5)),
        ];
        assert_eq!(believed(&readings), [500.0]);
    }

    #[test]
    fn a_single_missing_echo_is_not_believed_but_a_lasting_silence_is() {
        let one = [
            at(0.0, Some(500.0)),
            at(40.0, None),
            at(80.0, Some(501.0)),
            at(90.0, Some(502.0)),
        ];
        assert_eq!(believed(&one), [501.0]);
        let lasting = [at(0.0, None), at(40.0, None), at(80.0, None)];
        assert_eq!(believed(&lasting), [-1.0, -1.0]);
    }

    #[test]
    fn readings_outside_the_limits_are_ignored() {
        let mut filter = filter();
        assert_eq!(filter.take(at(0.0, Some(20.0))), Verdict::Ignored);
        assert_eq!(filter.take(at(0.0, Some(f64::NAN))), Verdict::Ignored);
        assert_eq!(filter.take(at(0.0, Some(2500.0))), Verdict::Ignored);
    }

    #[test]
    fn what_the_robots_own_motion_explains_agrees() {
        let readings = [
            at(0.0, Some(1000.0)),
            at(300.0, Some(700.0)),
            at(600.0, Some(400.0)),
        ];
        assert_eq!(believed(&readings), [1000.0, 700.0]);
    }
}
