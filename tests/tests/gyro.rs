//! The gyroscope on the virtual board: a slip that the heading survives, and everything that can be
//! wrong with the part.

use fw_core::eeprom::{encode, first_board, Config, IMAGE_LEN};
use fw_core::types::Faults;
use fw_core::wire::{Command, Mode, Order, PiLink, PoseCode, Report, Setup, MAX_FRAME};
use robot_tests::test_board::{Rig, TIM5_CCR1};
use twin::components::mpu6050::Mpu6050;
use twin::plant::{Room, Sides};
use twin::trace::EventKind;
use twin::{I2cController, Mpu6050Fault, Mpu6050Params, Options};

/// A robot in Guarded Normal and its Pi.
struct Robot {
    rig: Rig,
    pi: PiLink,
    last: Report,
    rejected: u32,
}

/// x, y and heading: millimetres and degrees.
type Pose = (f64, f64, f64);

fn config(gyro: bool) -> Config {
    let mut config = first_board();
    config.mode = Mode::GuardedNormal;
    config.platform.gyro = gyro;
    config
}

fn options(gyro: bool, mpu: Option<Mpu6050Params>) -> Options {
    let mut image = [0xFF; IMAGE_LEN];
    encode(&config(gyro), &mut image);
    Options {
        eeprom: Some(image.to_vec()),
        room: Room::default(),
        mpu,
        ..Options::default()
    }
}

impl Robot {
    fn new(gyro: bool, mpu: Option<Mpu6050Params>) -> Self {
        let robot = Self {
            rig: Rig::new(options(gyro, mpu)),
            pi: PiLink::new(Setup::from(&config(gyro))),
            last: Report::default(),
            rejected: 0,
        };
        assert!(robot.rig.await_ready(), "{}", robot.rig.log());
        robot
    }

    fn exchange(&mut self, command: &Command) {
        let mut frame = [0; MAX_FRAME];
        let len = self.pi.send(command, &mut frame);
        match self.pi.receive(&self.rig.frame(&frame[..len])) {
            Ok(report) => self.last = report,
            Err(_) => self.rejected += 1,
        }
    }

    /// Towards a pose for so many milliseconds at 40 Hz.
    fn go(&mut self, (x, y, degrees): Pose, ms: u64) {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let expected = PoseCode {
            x: (x * 1000.0) as i32,
            y: (y * 1000.0) as i32,
            rotation: (degrees / 360.0 * 32768.0).round().rem_euclid(32768.0) as u16,
        };
        let command = Command {
            expected,
            apply: true,
            order: Order::Resume,
            ..Command::default()
        };
        let ends = self.rig.board.now_us() + ms * 1000;
        while self.rig.board.now_us() < ends {
            self.exchange(&command);
            self.rig.board.run_us(25_000 - 60);
        }
    }

    /// Stands for so many milliseconds.
    fn stand(&mut self, ms: u64) {
        let ends = self.rig.board.now_us() + ms * 1000;
        while self.rig.board.now_us() < ends {
            self.exchange(&Command::default());
            self.rig.board.run_us(25_000 - 60);
        }
    }

    fn truth(&self) -> Pose {
        let start = self.rig.board.world(|world| world.room().start);
        let pose = self.rig.board.truth().pose.relative_to(&start);
        (pose.x_mm, pose.y_mm, pose.heading_rad.to_degrees())
    }

    fn believed(&mut self) -> Pose {
        self.rig.board.run_us(30_000);
        self.exchange(&Command::default());
        self.exchange(&Command::default());
        let PoseCode { x, y, rotation } = self.last.pose;
        (
            f64::from(x) / 1000.0,
            f64::from(y) / 1000.0,
            f64::from(rotation) / 32768.0 * 360.0,
        )
    }

    /// How far what the robot believes is from the truth, at rest: millimetres and degrees.
    fn off(&mut self) -> (f64, f64) {
        for _ in 0..40 {
            self.stand(100);
            let Sides { left, right } = self.rig.board.truth().wheel_deg_s;
            if left.abs().max(right.abs()) < 0.05 {
                break;
            }
        }
        let (believed, truth) = (self.believed(), self.truth());
        let degrees = (believed.2 - truth.2 + 180.0).rem_euclid(360.0) - 180.0;
        (
            (believed.0 - truth.0).hypot(believed.1 - truth.1),
            degrees.abs(),
        )
    }

    fn log(&self) -> String {
        self.rig.log()
    }
}

/// Stands two seconds, turns left by a quarter, then drives 1.5 m; its left wheel slips for a second
/// on the way.
fn slipping(gyro: bool) -> Robot {
    let mut robot = Robot::new(gyro, Some(Mpu6050Params::default()));
    robot.stand(2_000);
    robot.go((0.0, 0.0, 90.0), 4_000);
    robot.go((0.0, 1500.0, 90.0), 2_500);
    robot.rig.board.set_faults(|faults| faults.slip.left = 1.0);
    robot.go((0.0, 1500.0, 90.0), 1_000);
    robot.rig.board.set_faults(|faults| faults.slip.left = 0.0);
    robot.go((0.0, 1500.0, 90.0), 12_000);
    robot
}

// Requirement: DOC-2.3-3, WIRE-fault-12
#[test]
fn a_wheel_that_slips_for_a_second_costs_the_heading_less_than_a_degree_with_the_gyro() {
    let mut with = slipping(true);
    let (mm, degrees) = with.off();
    let target = with.truth();
    println!("with: off by {mm:.1} mm, {degrees:.2}°, arrived at {target:.1?}");
    let mut without = slipping(false);
    let (mm_without, degrees_without) = without.off();
    println!(
        "without: off by {mm_without:.1} mm, {degrees_without:.2}°, arrived at {:.1?}",
        without.truth()
    );
    assert!(degrees <= 1.0, "{degrees:.2}°\n{}", with.log());
    assert!(mm <= 30.0, "{mm:.1} mm\n{}", with.log());
    assert!(degrees_without >= 20.0, "{degrees_without:.2}°");
    // It drove on to where it should be, in truth.
    assert!(target.0.hypot(target.1 - 1500.0) < 40.0, "{target:?}");
    let faults = with.last.faults & (Faults::SLIP | Faults::GYRO_LOST);
    assert_eq!(faults, Faults::SLIP, "{}", with.log());
    assert!(!without
        .last
        .faults
        .intersects(Faults::SLIP | Faults::GYRO_LOST));
    let log = with.log();
    let bias: f64 = log
        .split("gyro: bias ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next())
        .expect("a bias")
        .parse()
        .expect("a number");
    assert!((bias + 3.7).abs() < 0.05, "{log}");
    let of = |what: &str| log.find(what).unwrap_or_else(|| panic!("{what}\n{log}"));
    assert!(of("gyro: bias") < of("gyro: agrees"));
    assert!(of("gyro: agrees") < of("slip: the heading follows the gyro"));
    assert!(of("slip: ") < of("slip over: heading corrected by"));
    assert!(!without.log().contains("slip") && !without.log().contains("gyro"));
    with.rig.assert_modelled();
}

#[test]
fn without_a_slip_it_drives_as_the_encoders_say_and_one_turned_by_hand_knows() {
    let way = [(0.0, 0.0, 120.0), (300.0, 200.0, 0.0), (0.0, 0.0, 270.0)];
    let drive = |gyro: bool| {
        let mut robot = Robot::new(gyro, Some(Mpu6050Params::default()));
        robot.stand(1_500);
        for pose in way {
            robot.go(pose, 5_000);
        }
        robot
    };
    let (mut with, mut without) = (drive(true), drive(false));
    for robot in [&mut with, &mut without] {
        let (mm, degrees) = robot.off();
        assert!(mm < 0.5 && degrees < 0.05, "{mm} mm, {degrees}°");
        assert!(!robot
            .last
            .faults
            .intersects(Faults::SLIP | Faults::GYRO_LOST));
    }
    assert!(with.log().contains("gyro: agrees"), "{}", with.log());
    assert!(!with.log().contains("slip"), "{}", with.log());

    // It holds its pose, brakes on; a hand turns it at 50 °/s for 1.2 s, and it turns back.
    let held = with.truth();
    with.rig
        .board
        .set_faults(|faults| faults.twist_deg_s = 50.0);
    with.go(way[2], 1_200);
    with.rig.board.set_faults(|faults| faults.twist_deg_s = 0.0);
    with.go(way[2], 4_000);
    let (_, degrees) = with.off();
    assert!(degrees < 2.5, "{degrees}°\n{}", with.log());
    let back = with.truth().2 - held.2;
    assert!(back.abs() < 3.5, "{back}°\n{}", with.log());
    assert!(with.last.faults.intersects(Faults::SLIP));
}

/// How one drive with something wrong went.
fn broken(mpu: Option<Mpu6050Params>, breaks: impl FnOnce(&Robot), told: &str) -> Robot {
    let mut robot = Robot::new(true, mpu);
    breaks(&robot);
    robot.rig.board.trace_writes(TIM5_CCR1);
    robot.stand(500);
    robot.go((200.0, 100.0, 90.0), 5_000);
    let (mm, degrees) = robot.off();
    assert!(mm < 0.5 && degrees < 0.05, "{told}: {mm} mm, {degrees}°");
    let truth = robot.truth();
    assert!(
        (truth.0 - 200.0).hypot(truth.1 - 100.0) < 6.0,
        "{told}: {truth:?}\n{}",
        robot.log()
    );
    let ticks: Vec<u64> = robot
        .rig
        .board
        .take_events()
        .into_iter()
        .filter(|event| matches!(event.kind, EventKind::Write { .. }))
        .map(|event| event.at_ns)
        .collect();
    assert!(ticks.len() >= 540, "{told}: {} ticks", ticks.len());
    for pair in ticks.windows(2) {
        let late = (pair[1] - pair[0]).abs_diff(10_000_000);
        assert!(late < 5_000, "{told}: a tick {late} ns off");
    }
    assert_eq!(robot.rejected, 0, "{told}");
    let faults = robot.last.faults & (Faults::SLIP | Faults::GYRO_LOST);
    assert_eq!(faults, Faults::GYRO_LOST, "{told}\n{}", robot.log());
    assert!(robot.log().contains(told), "{told}\n{}", robot.log());
    assert!(robot.log().contains("encoders alone"), "{}", robot.log());
    assert!(robot.rig.board.resets().is_empty());
    robot.rig.assert_modelled();
    robot
}

fn fault_of(robot: &Robot, fault: Mpu6050Fault) {
    let set = move |mpu: &mut Mpu6050| mpu.fault = fault;
    robot.rig.board.set_mpu(set);
}

// Requirement: DOC-2.3-3, DOC-3.1-3, WIRE-fault-13
#[test]
fn absent_silent_refusing_or_another_part_it_drives_by_its_encoders_and_says_why() {
    let fitted = Some(Mpu6050Params::default());
    let _ = broken(None, |_| {}, "gyro: no answer at 0x68");
    let _ = broken(
        fitted,
        |robot| fault_of(robot, Mpu6050Fault::RefusesAfter(1)),
        "gyro: no answer at 0x68",
    );
    let _ = broken(
        fitted,
        |robot| fault_of(robot, Mpu6050Fault::WrongId(0x70)),
        "gyro: not an MPU6050 at 0x68",
    );
}

// Requirement: DOC-3.1-3
#[test]
fn dying_freezing_or_holding_the_bus_on_the_way_it_drives_by_its_encoders_and_says_why() {
    let fitted = Some(Mpu6050Params::default());
    let later = |fault: Mpu6050Fault| {
        move |robot: &Robot| {
            robot.rig.board.run_us(1_000_000);
            fault_of(robot, fault);
        }
    };
    let _ = broken(
        fitted,
        later(Mpu6050Fault::Silent),
        "gyro: no answer at 0x68",
    );
    let _ = broken(fitted, later(Mpu6050Fault::Frozen), "gyro: data frozen");
    let hold = |pulses: u32| {
        move |robot: &Robot| {
            robot.rig.board.run_us(1_000_000);
            robot
                .rig
                .board
                .i2c_bus(move |bus, _| bus.hold_sda_by_mpu(pulses));
        }
    };
    let _ = broken(fitted, hold(u32::MAX), "gyro: I2C held");
    // One that only lost its place is freed, found again, and rested.
    let freed = broken(fitted, hold(7), "gyro: I2C held");
    freed.rig.board.run_us(1_500_000);
    let log = freed.log();
    let after = log.split("gyro: I2C held").nth(1).expect("it was told");
    assert!(after.contains("gyro: bias"), "{log}");
}

#[test]
fn the_pi_may_take_the_eeprom_while_the_gyro_is_read() {
    let mut robot = Robot::new(true, Some(Mpu6050Params::default()));
    robot.stand(1_000);
    let reads = |robot: &Robot| {
        let bus = robot
            .rig
            .board
            .i2c_bus(|bus, _| bus.mpu.as_ref().map(Mpu6050::reads));
        bus.expect("it is fitted")
    };
    for controller in [I2cController::Pi, I2cController::Stm] {
        robot.rig.board.switch_i2c(controller);
        let before = reads(&robot);
        robot.stand(300);
        let more = reads(&robot) - before;
        assert!((29..=34).contains(&more), "{more} reads in 0.3 s");
    }
    assert!(!robot.log().contains("encoders alone"), "{}", robot.log());
}
