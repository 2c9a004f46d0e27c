//! The physical world of one robot: everything that moves when time passes.

use crate::collision::{Collision, CollisionDetector};
use crate::echo::Sonar;
use crate::faults::Faults;
use crate::floor::Floor;
use crate::{Battery, Motor, MotorInput, Mount, Params, Pose2, Rng, Room, Servo, Sides};

/// Longest integration step, s: a hundredth of the motors' lags or less.
const LONGEST_STEP_S: f64 = 0.001;

/// The world: one robot in one room.
#[derive(Clone, Debug)]
pub struct World {
    params: Params,
    room: Room,
    pose: Pose2,
    motors: Sides<Motor>,
    /// The encoders' exact positions, counts.
    counts: Sides<f64>,
    battery: Battery,
    sonar: Sonar,
    floor: Floor,
    rng: Rng,
    time_s: f64,
    path_mm: f64,
    collision: CollisionDetector,
    /// The servo of the front rangefinder.
    pub servo: Servo,
    /// What is broken; change it at any time.
    pub faults: Faults,
    /// External rotation of the wheels, °/s, on top of the motors'; the encoders see it.
    pub hand_deg_s: Sides<f64>,
}

impl World {
    /// A robot at rest at `pose` (the room's frame) with its encoders at zero. Its true figures are
    /// `params` with the imperfections that the seed draws.
    pub fn new(params: Params, room: Room, pose: Pose2, seed: u64) -> Self {
        let imperfections = params.imperfections;
        let params = imperfections.draw(params, seed);
        Self {
            sonar: Sonar::new(params.rangefinder, &room, &imperfections),
            floor: Floor::new(&imperfections, seed),
            motors: params.motors.map(Motor::new),
            counts: Sides::default(),
            battery: Battery::new(params.battery),
            servo: Servo::new(params.servo),
            params,
            room,
            pose,
            rng: Rng::new(seed),
            time_s: 0.0,
            path_mm: 0.0,
            collision: CollisionDetector::default(),
            faults: Faults::default(),
            hand_deg_s: Sides::default(),
        }
    }

    /// Changes the room while the robot stands or drives in it.
    pub fn set_room(&mut self, room: Room) {
        self.sonar = Sonar::new(self.params.rangefinder, &room, &self.params.imperfections);
        self.room = room;
        self.collision.invalidate();
    }

    /// Advances by `dt_s` seconds with these inputs at the motors, in steps of at most 1 ms.
    pub fn step(&mut self, dt_s: f64, left: MotorInput, right: MotorInput) {
        let mut rest = dt_s;
        while rest > 0.0 {
            let dt = rest.min(LONGEST_STEP_S);
            self.integrate(dt, Sides::new(left, right));
            rest -= dt;
        }
    }

    fn integrate(&mut self, dt: f64, inputs: Sides<MotorInput>) {
        let volts = self.battery.taps()[1];
        let inputs = if self.faults.crossed_motors {
            Sides::new(inputs.right, inputs.left)
        } else {
            inputs
        };
        let motors = self.motors.as_mut().zip(inputs).zip(self.faults.jammed);
        let driven = motors.map(|((motor, input), jammed)| {
            let turned = motor.step(dt, input, volts);
            if jammed {
                motor.block();
                return 0.0;
            }
            turned
        });
        let current = self.motors.left.current_a() + self.motors.right.current_a();
        self.battery.step(dt, current);
        self.time_s += dt;
        self.servo.step(dt);
        let turned = driven.zip(self.hand_deg_s);
        let turned = turned.map(|(degrees, hand)| degrees + hand * dt);
        if self.faults.twist_deg_s != 0.0 {
            self.pose.heading_rad += self.faults.twist_deg_s.to_radians() * dt;
            self.collision.invalidate();
        }
        if turned == Sides::default() {
            return;
        }
        let chassis = &self.params.chassis;
        let travel = self.floor.travel(chassis.travel(turned));
        let travel = travel.zip(self.faults.slip);
        let travel = travel.map(|(mm, slip)| mm * (1.0 - slip.clamp(0.0, 1.0)));
        let next = chassis.roll(&self.pose, travel);
        let (room, radius) = (&self.room, chassis.radius_mm);
        if self
            .collision
            .blocks(room, radius, &self.pose, &next, dt, self.time_s)
        {
            self.motors.as_mut().map(Motor::block);
            return;
        }
        self.floor.cross(room, &self.pose, &next, chassis.track_mm);
        self.path_mm += next.distance_mm(&self.pose);
        self.pose = next;
        let counted = chassis.counts(turned).zip(self.faults.dead_encoder);
        let counts = self.counts.zip(counted);
        self.counts = counts.map(|(at, (by, dead))| if dead { at } else { at + by });
    }

    /// The encoders' counts, with the encoders' sign.
    #[allow(clippy::cast_possible_truncation)] // 2^63 counts are 600 million kilometres
    pub fn wheel_counts(&self) -> Sides<i64> {
        self.counts.map(|exact| exact.floor() as i64)
    }

    /// The encoders' exact positions in counts: a quadrature edge lies at every integer.
    pub fn wheel_phase(&self) -> Sides<f64> {
        self.counts
    }

    /// The wheels' speeds, °/s, positive forward.
    pub fn wheel_speeds_deg_s(&self) -> Sides<f64> {
        let (left, right) = (&self.motors.left, &self.motors.right);
        Sides::new(left.speed_deg_s(), right.speed_deg_s())
    }

    /// The robot's true pose in the room's frame.
    pub fn pose(&self) -> Pose2 {
        self.pose
    }

    /// Seconds since the start of the run.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Length of the robot's true path so far, mm.
    pub fn path_mm(&self) -> f64 {
        self.path_mm
    }

    /// The room.
    pub fn room(&self) -> &Room {
        &self.room
    }

    /// The robot's true parameters.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// Voltages at the ADC pins of the cells.
    pub fn cell_pins(&self) -> [f64; 2] {
        self.battery.pins(self.faults.cells_v)
    }

    /// The battery.
    pub fn battery(&self) -> &Battery {
        &self.battery
    }

    /// Displaces the robot by `by`, given in its own frame. The wheels slide: the encoders see
    /// nothing.
    pub fn push(&mut self, by: &Pose2) {
        self.pose = self.pose.compose(by);
        self.collision.invalidate();
    }

    /// Position and direction of a rangefinder (0 front, 1 right, 2 left), its servo considered.
    ///
    /// # Panics
    /// If there is no such sensor.
    pub fn mount(&self, sensor: usize) -> Mount {
        let mut mount = self.params.mounts[sensor];
        if sensor == crate::FRONT {
            mount.bearing_rad += self.servo.angle_rad;
        }
        mount
    }

    /// What a rangefinder (0 front, 1 right, 2 left) without errors would measure, mm; `None`
    /// without an echo.
    ///
    /// # Panics
    /// If there is no such sensor.
    pub fn true_range_mm(&self, sensor: usize) -> Option<f64> {
        let at = self.mount(sensor).sensor_pose(&self.pose);
        self.sonar.nearest_return(&self.room, &at)
    }

    /// One measurement of a rangefinder (0 front, 1 right, 2 left), mm; `None` without an echo.
    /// Draws from the run's random numbers.
    ///
    /// # Panics
    /// If there is no such sensor.
    pub fn range_mm(&mut self, sensor: usize) -> Option<f64> {
        let at = self.mount(sensor).sensor_pose(&self.pose);
        let measured = self.sonar.measure(&self.room, &at, &mut self.rng);
        if self.faults.missing_echo[sensor] {
            None
        } else {
            self.faults.stuck_mm[sensor].or(measured)
        }
    }

    /// Like [`World::range_mm`], as the width of the echo pulse, µs.
    ///
    /// # Panics
    /// If there is no such sensor.
    pub fn echo_us(&mut self, sensor: usize) -> Option<f64> {
        let range = self.range_mm(sensor)?;
        Some(self.params.rangefinder.echo_us(range))
    }

    /// The microcontroller's temperature, °C.
    pub fn chip_temperature_c(&self) -> f64 {
        self.params.rangefinder.temperature_c + self.params.chip_over_air_k
    }

    /// The collisions so far; a lasting contact counts once.
    pub fn collisions(&self) -> &[Collision] {
        &self.collision.collisions
    }
}

#[cfg(test)]
mod tests;
