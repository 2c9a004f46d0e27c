//! The rangefinders' turns as the firmware takes them: front, right, left, one every 20 ms, 30 ms after
//! a missing echo, the front one's servo moving by a step between its turns.

use crate::echo::Sonar;
use crate::{FRONT, Imperfections, Mount, Params, Pose2, Rng, Room};

/// Ticks of a slot, and of one without an echo.
const SLOT_TICKS: u32 = 2;
const SILENT_SLOT_TICKS: u32 = 3;
/// The farthest distance on the wire, mm.
const FARTHEST_MM: f64 = 2500.0;
/// The servo's step between two front readings, and its travel to either side, radians.
const STEP_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
const TRAVEL_RAD: f64 = std::f64::consts::FRAC_PI_2;

#[derive(Clone, Debug)]
pub(super) struct Ranging {
    mounts: [Mount; 3],
    sonar: Sonar,
    rng: Rng,
    sensor: usize,
    ticks_left: u32,
    /// The running measurement's result and bearing.
    pending: Option<(Option<f64>, f64)>,
    pub(super) ranges_mm: [Option<f64>; 3],
    pub(super) front_bearing_rad: f64,
    /// Steps of the servo from straight ahead, and its direction.
    position: i32,
    direction: i32,
}

impl Ranging {
    pub(super) fn new(params: &Params, room: &Room, world: &Imperfections, rng: Rng) -> Self {
        Self {
            mounts: params.mounts,
            sonar: Sonar::new(params.rangefinder, room, world),
            rng,
            sensor: FRONT,
            ticks_left: 0,
            pending: None,
            ranges_mm: [None; 3],
            front_bearing_rad: 0.0,
            position: 0,
            direction: 1,
        }
    }

    /// A tick with the robot at `pose`: the front reading that is new, and its bearing.
    pub(super) fn tick(
        &mut self,
        pose: &Pose2,
        room: &Room,
        sweep_half_width_rad: f64,
    ) -> Option<(f64, Option<f64>)> {
        if self.ticks_left > 0 {
            self.ticks_left -= 1;
            return None;
        }
        let mut front = None;
        if let Some((range, bearing)) = self.pending.take() {
            self.ranges_mm[self.sensor] = range;
            if self.sensor == FRONT {
                self.front_bearing_rad = bearing;
                self.step_servo(sweep_half_width_rad);
                front = Some((bearing, range));
            }
            self.sensor = (self.sensor + 1) % 3;
        }
        let mut mount = self.mounts[self.sensor];
        let bearing = f64::from(self.position) * STEP_RAD;
        if self.sensor == FRONT {
            mount.bearing_rad += bearing;
        }
        let at = mount.sensor_pose(pose);
        let range = self.sonar.measure(room, &at, &mut self.rng);
        let range = range.filter(|&mm| mm < FARTHEST_MM);
        self.pending = Some((range, bearing));
        let slot = range.map_or(SILENT_SLOT_TICKS, |_| SLOT_TICKS);
        self.ticks_left = slot - 1;
        front
    }

    /// The next bearing: to and fro within the sweep, by one step.
    #[allow(clippy::cast_possible_truncation)] // at most nine steps
    fn step_servo(&mut self, half_width_rad: f64) {
        let most = (half_width_rad.abs().min(TRAVEL_RAD) / STEP_RAD + 0.5).floor() as i32;
        if self.position >= most {
            self.direction = -1;
        } else if self.position <= -most {
            self.direction = 1;
        }
        if most > 0 || self.position != 0 {
            self.position += self.direction;
        }
    }
}
