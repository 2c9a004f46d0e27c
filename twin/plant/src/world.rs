//! The physical world of one robot: everything that moves when time passes.

use crate::collision::{Collision, Contact};
use crate::encoder::Encoder;
use crate::faults::Faults;
use crate::{
    Battery, BatteryParams, Chassis, Motor, MotorInput, MotorParams, Mount, Pose,
    RangefinderParams, Rng, Room, Servo, ServoParams, Sides,
};

/// The figures of a robot. The default is the first board.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// The motors.
    pub motors: Sides<MotorParams>,
    /// The battery.
    pub battery: BatteryParams,
    /// Wheels, track, encoders, body.
    pub chassis: Chassis,
    /// Where the rangefinders sit: front, right, left.
    pub mounts: [Mount; 3],
    /// Their beam and errors, and the air.
    pub rangefinder: RangefinderParams,
    /// The servo that turns the front one, if it is sent any pulses.
    pub servo: ServoParams,
    /// How much warmer the microcontroller is than the air, K.
    pub chip_over_air_k: f64,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            motors: Sides::new(
                MotorParams::first_board_left(),
                MotorParams::first_board_right(),
            ),
            battery: BatteryParams::default(),
            chassis: Chassis::default(),
            mounts: Mount::first_board(),
            rangefinder: RangefinderParams::default(),
            servo: ServoParams::default(),
            // 50 mW through the package's 51 K/W.
            chip_over_air_k: 2.5,
        }
    }
}

/// Longest stretch that is integrated in one piece, s: a hundredth of the motors' lags or less.
const LONGEST_STEP_S: f64 = 0.001;

/// The world: one robot in one room.
#[derive(Clone, Debug)]
pub struct World {
    params: Params,
    room: Room,
    pose: Pose,
    motors: Sides<Motor>,
    encoders: Sides<Encoder>,
    battery: Battery,
    servo: Servo,
    rng: Rng,
    time_s: f64,
    path_mm: f64,
    contact: Contact,
    /// What is broken; change it at any time.
    pub faults: Faults,
    /// A hand that rolls the wheels at these speeds, °/s, on top of what the motors do; the encoders
    /// see it. Zero: no hand.
    pub hand_deg_s: Sides<f64>,
}

impl World {
    /// A robot at rest at `pose` (the room's frame) with its encoders at zero.
    #[must_use]
    pub fn new(params: Params, room: Room, pose: Pose, seed: u64) -> Self {
        Self {
            motors: Sides::new(
                Motor::new(params.motors.left),
                Motor::new(params.motors.right),
            ),
            encoders: Sides::default(),
            battery: Battery::new(params.battery),
            servo: Servo::new(params.servo),
            params,
            room,
            pose,
            rng: Rng::new(seed),
            time_s: 0.0,
            path_mm: 0.0,
            contact: Contact::default(),
            faults: Faults::default(),
            hand_deg_s: Sides::default(),
        }
    }

    /// Lets `dt_s` seconds pass with these inputs at the motors. Long stretches are cut into
    /// pieces of at most 1 ms.
    pub fn step(&mut self, dt_s: f64, left: MotorInput, right: MotorInput) {
        let mut rest = dt_s;
        while rest > 0.0 {
            let dt = rest.min(LONGEST_STEP_S);
            self.piece(dt, Sides::new(left, right));
            rest -= dt;
        }
    }

    fn piece(&mut self, dt: f64, inputs: Sides<MotorInput>) {
        let volts = self.battery.voltage();
        let mut turned = Sides::new(
            self.motors.left.step(dt, inputs.left, volts),
            self.motors.right.step(dt, inputs.right, volts),
        );
        self.battery.step(
            dt,
            self.motors.left.current_a() + self.motors.right.current_a(),
        );
        self.time_s += dt;
        self.servo.step(dt);
        if self.faults.jammed.left {
            self.motors.left.block();
            turned.left = 0.0;
        }
        if self.faults.jammed.right {
            self.motors.right.block();
            turned.right = 0.0;
        }
        turned.left += self.hand_deg_s.left * dt;
        turned.right += self.hand_deg_s.right * dt;
        if self.faults.twist_deg_s != 0.0 {
            self.pose.heading_rad += self.faults.twist_deg_s.to_radians() * dt;
            self.contact.moved_by_force();
        }
        if turned.left == 0.0 && turned.right == 0.0 {
            return;
        }
        let mut travel = self.params.chassis.travel(turned);
        travel.left *= 1.0 - self.faults.slip.left.clamp(0.0, 1.0);
        travel.right *= 1.0 - self.faults.slip.right.clamp(0.0, 1.0);
        let next = self.params.chassis.roll(&self.pose, travel);
        let radius = self.params.chassis.radius_mm;
        if self
            .contact
            .blocks(&self.room, radius, &self.pose, &next, self.time_s)
        {
            self.motors.left.block();
            self.motors.right.block();
            return;
        }
        self.path_mm += (next.x_mm - self.pose.x_mm).hypot(next.y_mm - self.pose.y_mm);
        self.pose = next;
        let counts = self.params.chassis.counts(turned);
        self.encoders
            .left
            .turn(counts.left, self.faults.dead_encoder.left);
        self.encoders
            .right
            .turn(counts.right, self.faults.dead_encoder.right);
    }

    /// The encoders' counts (left, right), with the encoders' sign.
    #[must_use]
    pub fn wheel_counts(&self) -> (i64, i64) {
        (self.encoders.left.count(), self.encoders.right.count())
    }

    /// The encoders' exact positions in counts (left, right): a quadrature edge lies at every
    /// integer.
    #[must_use]
    pub fn wheel_phase(&self) -> (f64, f64) {
        (self.encoders.left.phase(), self.encoders.right.phase())
    }

    /// The wheels' speeds (left, right), °/s, positive forward.
    #[must_use]
    pub fn wheel_speeds_deg_s(&self) -> (f64, f64) {
        (
            self.motors.left.speed_deg_s(),
            self.motors.right.speed_deg_s(),
        )
    }

    /// The speeds of the encoders' positions (left, right), counts per second with the encoders'
    /// sign, for placing edges within a step. A dead encoder is not considered.
    #[must_use]
    pub fn count_rates(&self) -> (f64, f64) {
        let (left, right) = self.wheel_speeds_deg_s();
        let counts = self.params.chassis.counts(Sides::new(left, right));
        (counts.left, counts.right)
    }

    /// The robot's true pose in the room's frame.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Seconds since the world began.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Length of the robot's true path so far, mm.
    #[must_use]
    pub fn path_mm(&self) -> f64 {
        self.path_mm
    }

    /// The room.
    #[must_use]
    pub fn room(&self) -> &Room {
        &self.room
    }

    /// The robot's figures.
    #[must_use]
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// The battery.
    #[must_use]
    pub fn battery(&self) -> &Battery {
        &self.battery
    }

    /// Voltages of the taps `CELL_1`, `CELL_2` against ground.
    #[must_use]
    pub fn battery_taps(&self) -> [f64; 2] {
        self.battery.taps()
    }

    /// Voltages at the ADC pins of `CELL_1`, `CELL_2`, behind their dividers.
    #[must_use]
    pub fn adc_pin_voltages(&self) -> [f64; 2] {
        self.battery.pins()
    }

    /// Moves the robot by a push, in its own frame: millimetres ahead and to the left, radians
    /// counter-clockwise. The wheels slide: the encoders see nothing.
    pub fn push(&mut self, ahead_mm: f64, left_mm: f64, turn_rad: f64) {
        let (x, y) = self.pose.point(ahead_mm, left_mm);
        self.pose = Pose::new(x, y, self.pose.heading_rad + turn_rad);
        self.contact.moved_by_force();
    }

    /// Mounts a rangefinder (0 front, 1 right, 2 left) at another bearing, radians.
    ///
    /// # Panics
    /// If there is no such sensor.
    pub fn set_bearing(&mut self, sensor: usize, bearing_rad: f64) {
        self.params.mounts[sensor].bearing_rad = bearing_rad;
    }

    /// The servo of the front rangefinder.
    #[must_use]
    pub const fn servo(&self) -> &Servo {
        &self.servo
    }

    /// The servo, to send it a pulse or to turn it by hand.
    pub const fn servo_mut(&mut self) -> &mut Servo {
        &mut self.servo
    }

    /// Where a rangefinder (0 front, 1 right, 2 left) sits and looks right now, its servo considered.
    ///
    /// # Panics
    /// If there is no such sensor.
    #[must_use]
    pub fn mount(&self, sensor: usize) -> Mount {
        let mut mount = self.params.mounts[sensor];
        if sensor == crate::FRONT {
            mount.bearing_rad += self.servo.angle_rad();
        }
        mount
    }

    /// What a rangefinder (0 front, 1 right, 2 left) would say right now if it had no errors, mm;
    /// `None` without an echo.
    ///
    /// # Panics
    /// If there is no such sensor.
    #[must_use]
    pub fn true_range_mm(&self, sensor: usize) -> Option<f64> {
        let at = self.mount(sensor).pose(&self.pose);
        self.params.rangefinder.nearest_return(&self.room, &at)
    }

    /// Makes the air as warm as this, °C.
    pub const fn set_air(&mut self, temperature_c: f64) {
        self.params.rangefinder.temperature_c = temperature_c;
    }

    /// The microcontroller's own temperature, °C.
    #[must_use]
    pub fn chip_temperature_c(&self) -> f64 {
        self.params.rangefinder.temperature_c + self.params.chip_over_air_k
    }

    /// One measurement of a rangefinder (0 front, 1 right, 2 left), mm; `None` without an echo.
    /// Draws from the world's chance.
    ///
    /// # Panics
    /// If there is no such sensor.
    pub fn range_mm(&mut self, sensor: usize) -> Option<f64> {
        let at = self.mount(sensor).pose(&self.pose);
        let measured = self
            .params
            .rangefinder
            .measure(&self.room, &at, &mut self.rng);
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

    /// How often the robot ran into something (a touch that lasts counts once).
    #[must_use]
    pub fn collisions(&self) -> u32 {
        self.contact.collisions()
    }

    /// The first time it did.
    #[must_use]
    pub fn first_collision(&self) -> Option<Collision> {
        self.contact.first()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn world(room: Room) -> World {
        World::new(Params::default(), room, Pose::default(), 1)
    }

    fn drive(world: &mut World, millis: u32, left: f64, right: f64) {
        for _ in 0..millis {
            world.step(0.001, MotorInput::run(left), MotorInput::run(right));
        }
    }

    #[test]
    fn going_forward_both_encoders_count_down_as_far_as_the_wheels_roll() {
        let mut world = world(Room::default());
        drive(&mut world, 2000, 0.75, 0.75);
        let (left, right) = world.wheel_phase();
        assert!(left < -500.0 && right < left, "{left} {right}");
        let per_count = 80.0 * std::f64::consts::PI / 3840.0;
        let turn = (left - right) * per_count / 125.0;
        assert!(
            (world.pose().heading_rad - turn).abs() < 1e-9,
            "the faster right wheel turns left"
        );
        assert!((world.path_mm() + f64::midpoint(left, right) * per_count).abs() < 0.01);
        let (whole, _) = world.wheel_counts();
        assert!(whole < -500);
    }

    #[test]
    fn the_same_seed_gives_the_same_world() {
        let run = |seed| {
            let room = Room::two_rooms();
            let mut world = World::new(Params::default(), room, Pose::default(), seed);
            drive(&mut world, 1000, 0.6, 0.5);
            (
                world.pose(),
                (0..3).map(|s| world.echo_us(s)).collect::<Vec<_>>(),
            )
        };
        assert_eq!(run(5), run(5));
        assert_ne!(run(5).1, run(6).1);
    }

    #[test]
    fn the_size_of_the_steps_does_not_matter() {
        let mut fine = world(Room::default());
        let mut coarse = world(Room::default());
        for _ in 0..20_000 {
            fine.step(0.0001, MotorInput::run(0.8), MotorInput::run(0.6));
        }
        for _ in 0..200 {
            coarse.step(0.01, MotorInput::run(0.8), MotorInput::run(0.6));
        }
        let (a, b) = (fine.pose(), coarse.pose());
        assert!(
            (a.x_mm - b.x_mm).hypot(a.y_mm - b.y_mm) < 1.0,
            "{a:?} {b:?}"
        );
    }

    #[test]
    fn a_wall_stops_the_robot_and_its_encoders_and_is_reported_once() {
        let mut world = world(Room::default().with_wall(300.0, -900.0, 300.0, 900.0));
        drive(&mut world, 4000, 1.0, 0.75);
        assert_eq!(world.collisions(), 1);
        let clearance = world.room().clearance(world.pose().x_mm, world.pose().y_mm);
        assert!((99.0..101.0).contains(&clearance), "{clearance}");
        let counts = world.wheel_counts();
        drive(&mut world, 1000, 1.0, 0.75);
        assert_eq!(world.wheel_counts(), counts);
        drive(&mut world, 1000, -1.0, -0.75);
        assert!(world.pose().x_mm < 190.0, "it can back out");
        assert!(world.first_collision().unwrap().time_s < 4.0);
    }

    #[test]
    fn driving_makes_the_battery_sag() {
        let mut world = world(Room::default());
        world.step(0.001, MotorInput::COAST, MotorInput::COAST);
        let rested = world.battery_taps()[1];
        drive(&mut world, 50, 1.0, 1.0);
        assert!(world.battery_taps()[1] < rested - 0.1);
        drive(&mut world, 10, 0.0, 0.0);
        assert!((world.battery_taps()[1] - rested).abs() < 0.01);
    }

    #[test]
    fn slip_and_a_push_move_robot_and_encoders_apart() {
        let mut world = world(Room::default());
        world.faults.slip = Sides::new(1.0, 1.0);
        drive(&mut world, 1000, 0.75, 0.75);
        assert_eq!(world.pose(), Pose::default());
        assert!(world.wheel_counts().0 < -100);
        let counts = world.wheel_counts();
        world.push(10.0, -5.0, 0.1);
        assert_eq!(world.pose(), Pose::new(10.0, -5.0, 0.1));
        assert_eq!(world.wheel_counts(), counts);
    }

    #[test]
    fn a_hand_rolls_robot_and_encoders_alike() {
        let mut world = world(Room::default());
        world.hand_deg_s = Sides::new(-90.0, -90.0);
        for _ in 0..500 {
            world.step(0.001, MotorInput::BRAKE, MotorInput::BRAKE);
        }
        let (left, right) = world.wheel_counts();
        assert!(
            (479..=480).contains(&left) && left == right,
            "{left} {right}"
        );
        let rolled = 45.0 * 80.0 * std::f64::consts::PI / 360.0;
        assert!(
            (world.pose().x_mm + rolled).abs() < 1e-6,
            "{:?}",
            world.pose()
        );
    }

    #[test]
    fn a_hand_turns_the_robot_and_the_encoders_see_nothing() {
        let mut world = world(Room::default());
        world.faults.twist_deg_s = 90.0;
        drive(&mut world, 500, 0.0, 0.0);
        assert!((world.pose().heading_rad.to_degrees() - 45.0).abs() < 1e-6);
        assert_eq!(world.wheel_counts(), (0, 0));
    }

    #[test]
    fn broken_parts_behave_as_broken() {
        let mut world = world(Room::two_rooms());
        world.faults.dead_encoder.left = true;
        world.faults.jammed.right = true;
        world.faults.missing_echo[crate::FRONT] = true;
        world.faults.stuck_mm[crate::LEFT] = Some(123.0);
        drive(&mut world, 500, 0.75, 0.75);
        assert_eq!(world.wheel_counts(), (0, 0));
        assert!(world.pose().heading_rad < 0.0, "the left wheel still turns");
        assert_eq!(world.range_mm(crate::FRONT), None);
        assert_eq!(world.range_mm(crate::LEFT), Some(123.0));
        assert!(world.range_mm(crate::RIGHT).is_some());
        world.set_bearing(crate::LEFT, 0.0);
    }
}
