//! The core's obstacle stop: speed limits by the front distance, and in reverse.

/// Reaction time, s, and deceleration, mm/s².
const REACTION_S: f64 = 0.1;
const DECELERATION_MM_S2: f64 = 400.0;
/// Distance kept from the obstacle, and from the sensor's face to the robot's front edge, mm.
const STOP_DISTANCE_MM: f64 = 150.0;
const OVERHANG_MM: f64 = 20.0;
/// A reading farther off straight ahead does not count, and one is dropped after this turn, radians.
const AHEAD_RAD: f64 = 15.0 * std::f64::consts::PI / 180.0;
/// Out-of-range readings in a row that drop the last distance.
const SILENT_READINGS: u32 = 3;
/// Reverse speed, mm/s, and way until the next forward way, mm.
const REVERSE_MM_S: f64 = 50.0;
const REVERSE_WAY_MM: f64 = 300.0;

#[derive(Clone, Debug, Default)]
pub(super) struct ObstacleStop {
    /// Distance ahead of the sensor, mm, and the turn since its reading, radians.
    front: Option<(f64, f64)>,
    silent: u32,
    reversed_mm: f64,
    /// Whether the front distance limits the present command.
    pub(super) limits: bool,
}

impl ObstacleStop {
    /// The robot moved so far by its odometry.
    pub(super) fn moved(&mut self, forward_mm: f64, turn_rad: f64) {
        self.front = self.front.and_then(|(distance, turn)| {
            let turn = turn + turn_rad;
            (turn.abs() <= AHEAD_RAD).then_some((distance - forward_mm.max(0.0), turn))
        });
        self.reversed_mm = if forward_mm > 0.0 {
            0.0
        } else {
            self.reversed_mm - forward_mm
        };
    }

    /// A reading of the front sensor.
    pub(super) fn on_range(&mut self, bearing_rad: f64, range_mm: Option<f64>) {
        if bearing_rad.abs() > AHEAD_RAD {
            return;
        }
        if let Some(distance) = range_mm {
            (self.front, self.silent) = (Some((distance, 0.0)), 0);
        } else {
            self.silent += 1;
            if self.silent >= SILENT_READINGS {
                self.front = None;
            }
        }
    }

    /// The forward speed that is allowed of `forward_mm_s`.
    pub(super) fn limit(&mut self, forward_mm_s: f64) -> f64 {
        let (a, t) = (DECELERATION_MM_S2, REACTION_S);
        let free = self.front.map(|(distance, _)| {
            let way = (distance - OVERHANG_MM - STOP_DISTANCE_MM).max(0.0);
            // v t + v² / 2a = way
            a * ((t * t + 2.0 * way / a).sqrt() - t)
        });
        let slowest = if self.reversed_mm < REVERSE_WAY_MM {
            -REVERSE_MM_S
        } else {
            0.0
        };
        let ahead = forward_mm_s.min(free.unwrap_or(f64::INFINITY));
        self.limits = ahead < forward_mm_s;
        ahead.max(slowest)
    }
}
