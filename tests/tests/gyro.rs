//! The gyroscope on the virtual board: a slip that the heading survives, and everything that can be
//! wrong with the part.

use fw_core::eeprom::{Image, fields};
use fw_core::types::Faults;
use fw_core::wire::{Command, Mode};
use robot_tests::linked_robot::LinkedRobot;
use robot_tests::test_board::{I2C1_CR1, Rig, START, STOP, TIM5_CCR1, take_writes, wrote};
use twin::components::mpu6050::Mpu6050;
use twin::plant::{GyroParams, Room};
use twin::{Board, I2cController, Mpu6050Fault, Options};

/// A robot in Guarded Normal.
fn robot(gyro: bool, mpu: Option<GyroParams>) -> LinkedRobot {
    let image = Image::FIRST_BOARD
        .with(fields::MODE, Mode::GuardedNormal.code().into())
        .with(fields::GYRO, gyro.into());
    let options = Options::default().in_room(Room::default());
    LinkedRobot::new(&image, Options { mpu, ..options })
}

fn fitted() -> LinkedRobot {
    robot(true, Some(GyroParams::default()))
}

fn faults(robot: &LinkedRobot) -> Faults {
    robot.last.faults & (Faults::SLIP | Faults::GYRO_LOST)
}

/// Stands for 0.3 s, in which every tick reads the rate.
#[track_caller]
fn assert_read(robot: &mut LinkedRobot) {
    let reads = |rig: &Rig| {
        let reads = rig.i2c_bus(|bus, _| bus.mpu.as_ref().map(Mpu6050::reads));
        reads.expect("it is fitted")
    };
    let before = reads(&robot.rig);
    robot.stand(300);
    let more = reads(&robot.rig) - before;
    assert!((29..=34).contains(&more), "{more} reads in 0.3 s");
}

/// A master may see a bus error without a cause (ES0287, 2.10): at every step of the transfers.
// Requirement: WIRE-fault-13
#[test]
fn gyro_ignores_spurious_bus_errors() {
    let mut robot = fitted();
    for step in 0..20_000 {
        robot.rig.run_us(71);
        robot.rig.raise_bus_error();
        if step % 300 == 0 {
            robot.exchange(&Command::default());
        }
    }
    assert_eq!(robot.last.faults, Faults::NONE, "{}", robot.rig.log());
    robot.rig.assert_logged("gyro: bias");
}

/// Stands two seconds, turns left by a quarter, then drives 1.5 m; its left wheel slips for a second
/// on the way.
fn slipping(gyro: bool) -> LinkedRobot {
    let mut robot = robot(gyro, Some(GyroParams::default()));
    robot.stand(2_000);
    robot.go((0.0, 0.0, 90.0), 4_000);
    robot.go((0.0, 1500.0, 90.0), 2_500);
    robot.rig.set_faults(|faults| faults.slip.left = 1.0);
    robot.go((0.0, 1500.0, 90.0), 1_000);
    robot.rig.set_faults(|faults| faults.slip.left = 0.0);
    robot.go((0.0, 1500.0, 90.0), 12_000);
    robot
}

// Requirement: DOC-2.3-3, WIRE-fault-12
#[test]
fn gyro_one_second_slip_keeps_heading_within_1_degree() {
    let mut with = slipping(true);
    let (mm, degrees) = with.pose_error();
    let target = with.rig.pose();
    println!("with: off by {mm:.1} mm, {degrees:.2}°, arrived at {target:.1?}");
    let mut without = slipping(false);
    let (mm_without, degrees_without) = without.pose_error();
    let target_without = without.rig.pose();
    println!("without: off by {mm_without:.1} mm, {degrees_without:.2}°, at {target_without:.1?}");
    assert!(degrees <= 1.0, "{degrees:.2}°\n{}", with.rig.log());
    assert!(mm <= 30.0, "{mm:.1} mm\n{}", with.rig.log());
    assert!(degrees_without >= 20.0, "{degrees_without:.2}°");
    // It drove on to where it should be, in truth.
    assert!(target.x_mm.hypot(target.y_mm - 1500.0) < 40.0, "{target:?}");
    assert_eq!(faults(&with), Faults::SLIP, "{}", with.rig.log());
    assert_eq!(faults(&without), Faults::NONE);
    let log = with.rig.log();
    let bias = log.split("gyro: bias ").nth(1).expect("a bias");
    let bias: f64 = bias.split(' ').next().unwrap().parse().expect("a number");
    assert!((bias + 3.7).abs() < 0.05, "{log}");
    let of = |what: &str| log.find(what).unwrap_or_else(|| panic!("{what}\n{log}"));
    assert!(of("gyro: bias") < of("gyro: agrees"));
    assert!(of("gyro: agrees") < of("slip: heading by the gyro"));
    assert!(of("slip: ") < of("slip over: heading corrected by"));
    assert!(!without.rig.log().contains("slip") && !without.rig.log().contains("gyro"));
    with.rig.assert_modelled();
}

#[test]
fn gyro_without_slip_changes_nothing_and_detects_twist() {
    let way = [(0.0, 0.0, 120.0), (300.0, 200.0, 0.0), (0.0, 0.0, 270.0)];
    let drive = |gyro: bool| {
        let mut robot = robot(gyro, Some(GyroParams::default()));
        robot.stand(1_500);
        for pose in way {
            robot.go(pose, 5_000);
        }
        robot
    };
    let (mut with, mut without) = (drive(true), drive(false));
    for robot in [&mut with, &mut without] {
        let (mm, degrees) = robot.pose_error();
        assert!(mm < 0.5 && degrees < 0.05, "{mm} mm, {degrees}°");
        assert_eq!(faults(robot), Faults::NONE);
    }
    with.rig.assert_logged("gyro: agrees");
    assert!(!with.rig.log().contains("slip"), "{}", with.rig.log());

    // It holds its pose, brakes on; a hand turns it at 50 °/s for 1.2 s, and it turns back.
    let held = with.rig.pose();
    with.rig.set_faults(|faults| faults.twist_deg_s = 50.0);
    with.go(way[2], 1_200);
    with.rig.set_faults(|faults| faults.twist_deg_s = 0.0);
    with.go(way[2], 4_000);
    let (_, degrees) = with.pose_error();
    assert!(degrees < 2.5, "{degrees}°\n{}", with.rig.log());
    let back = (with.rig.pose().heading_rad - held.heading_rad).to_degrees();
    assert!(back.abs() < 3.5, "{back}°\n{}", with.rig.log());
    assert!(with.last.faults.intersects(Faults::SLIP));
}

/// Drives with a broken gyroscope to a pose by the encoders alone, and expects the log to contain
/// `expected_log`.
fn drive_with_fault(
    mpu: Option<GyroParams>,
    breaks: impl FnOnce(&LinkedRobot),
    expected_log: &str,
) -> LinkedRobot {
    let mut robot = self::robot(true, mpu);
    breaks(&robot);
    robot.rig.trace_writes(TIM5_CCR1);
    robot.stand(500);
    robot.go((200.0, 100.0, 90.0), 5_000);
    let (mm, degrees) = robot.pose_error();
    let exact = mm < 0.5 && degrees < 0.05;
    assert!(exact, "{expected_log}: {mm} mm, {degrees}°");
    let truth = robot.rig.pose();
    let off = (truth.x_mm - 200.0).hypot(truth.y_mm - 100.0);
    assert!(off < 6.0, "{expected_log}: {truth:?}\n{}", robot.rig.log());
    let ticks = take_writes(&robot.rig);
    assert!(ticks.len() >= 540, "{expected_log}: {} ticks", ticks.len());
    for pair in ticks.windows(2) {
        let late = (pair[1].at_ns - pair[0].at_ns).abs_diff(10_000_000);
        assert!(late < 5_000, "{expected_log}: a tick {late} ns off");
    }
    let (found, log) = (faults(&robot), robot.rig.log());
    assert_eq!(found, Faults::GYRO_LOST, "{expected_log}\n{log}");
    robot.rig.assert_logged(expected_log);
    robot.rig.assert_logged("encoders alone");
    assert!(robot.rig.resets().is_empty());
    robot.rig.assert_modelled();
    robot
}

fn set_fault(robot: &LinkedRobot, fault: Mpu6050Fault) {
    let set = move |mpu: &mut Mpu6050| mpu.fault = fault;
    robot.rig.set_mpu(set);
}

// Requirement: DOC-2.3-3, DOC-3.1-3, WIRE-fault-13
#[test]
fn gyro_absent_or_wrong_drives_by_encoders() {
    let _ = drive_with_fault(None, |_| {}, "gyro: no answer at 0x68");
    for (fault, text) in [
        (Mpu6050Fault::RefusesAfter(1), "gyro: no answer at 0x68"),
        (Mpu6050Fault::WrongId(0x70), "gyro: not an MPU6050 at 0x68"),
    ] {
        let fitted = Some(GyroParams::default());
        let _ = drive_with_fault(fitted, |robot| set_fault(robot, fault), text);
    }
    // What the part is, is a single byte: not acknowledged, or it may hold the line (RM0383, 18.3.3).
    let mut robot = robot(true, Some(GyroParams::default()));
    set_fault(&robot, Mpu6050Fault::WrongId(0x70));
    robot.rig.trace_writes(I2C1_CR1);
    robot.stand(500);
    let writes = take_writes(&robot.rig);
    let mut values = writes.iter().map(|write| write.value);
    assert!(values.any(|value| value & 0x401 == 1));
}

// Requirement: DOC-3.1-3
#[test]
fn gyro_failing_later_drives_by_encoders() {
    let fitted = Some(GyroParams::default());
    let later = |fault: Mpu6050Fault| {
        move |robot: &LinkedRobot| {
            robot.rig.run_us(1_000_000);
            set_fault(robot, fault);
        }
    };
    let silent = later(Mpu6050Fault::Silent);
    let _ = drive_with_fault(fitted, silent, "gyro: no answer at 0x68");
    let _ = drive_with_fault(fitted, later(Mpu6050Fault::Frozen), "gyro: data frozen");
    let hold = |pulses: u32| {
        move |robot: &LinkedRobot| {
            let rig = &robot.rig;
            rig.run_us(1_000_000);
            rig.i2c_bus(move |bus, _| bus.sda_held_by_mpu = pulses);
        }
    };
    let _ = drive_with_fault(fitted, hold(u32::MAX), "gyro: I2C held");
    // One that only lost its place is freed, found again, and rested.
    let freed = drive_with_fault(fitted, hold(7), "gyro: I2C held");
    freed.rig.run_us(1_500_000);
    let log = freed.rig.log();
    let after = log.split("gyro: I2C held").nth(1).expect("it is there");
    assert!(after.contains("gyro: bias"), "{log}");
}

/// A clock that is stretched beyond the next tick in the middle of a reading costs that reading.
// Requirement: DOC-3.1-3
#[test]
fn gyro_transfer_is_aborted_at_the_next_tick() {
    let mut robot = fitted();
    robot.stand(1_500);
    let is_reading =
        |board: &Board| board.i2c_bus(|bus, _| bus.mpu.as_ref().is_some_and(Mpu6050::is_reading));
    for (episode, later) in [0, 10, 20, 40].into_iter().enumerate() {
        assert!(robot.rig.run_until(20_000, 2, is_reading));
        robot.rig.run_us(later);
        robot.rig.stretch_i2c(true);
        robot.stand(15);
        robot.rig.stretch_i2c(false);
        // A second to the next attempt, and its set-up.
        robot.stand(3_000);
        let held = robot.rig.log().matches("gyro: I2C held").count();
        assert_eq!(held, episode + 1, "{}", robot.rig.log());
        assert_read(&mut robot);
    }
}

/// A lost arbitration, wherever in the transfer, ends it at once; the bus is cleared and readings go on.
// Requirement: WIRE-fault-13
#[test]
fn gyro_lost_arbitration_ends_transfer_at_once() {
    let mut robot = fitted();
    robot.stand(1_500);
    robot.rig.trace_writes(I2C1_CR1);
    for (episode, later) in [5, 30, 55, 80, 100].into_iter().enumerate() {
        take_writes(&robot.rig);
        assert!(robot.rig.run_until(20_000, 1, wrote(START)));
        robot.rig.run_us(later);
        assert!(robot.rig.lose_arbitration(), "{later} µs");
        assert!(robot.rig.run_until(50, 1, wrote(STOP)), "{later} µs");
        // Two seconds to the next attempt, and its set-up.
        robot.stand(4_000);
        let held = robot.rig.log().matches("gyro: I2C held").count();
        assert_eq!(held, episode + 1, "{}", robot.rig.log());
        assert_read(&mut robot);
    }
}

#[test]
fn gyro_reads_continue_while_pi_has_eeprom() {
    let mut robot = fitted();
    robot.stand(1_000);
    for controller in [I2cController::Pi, I2cController::Stm] {
        robot.rig.switch_i2c(controller);
        assert_read(&mut robot);
    }
    let log = robot.rig.log();
    assert!(!log.contains("encoders alone"), "{log}");
}
