//! Mode 0x30 on the virtual board: tracking, obstacle stop, silence, the gyro's angle, the sweep.

use fw_core::eeprom::{Field, Image, fields};
use fw_core::types::Faults;
use fw_core::wire::{Command, DistanceCode, GyroCode, Mode, Report, State};
use host_link::snapshot::distance_mm;
use mapper::LocaliserConfig;
use robot_tests::linked_robot::{LinkedRobot, velocity};
use twin::Options;
use twin::plant::{FRONT, GyroParams, Room};

/// Forward speed in mm/s and yaw rate in degrees/s.
type Speeds = (f64, f64);

const STAND: Speeds = (0.0, 0.0);
/// On an open floor the blind speed is the limit.
const FAST_BLIND: (&Field, u64) = (fields::BLIND_SPEED, 300);

/// A robot in mode 0x30. Its rangefinders have noise and no outliers.
fn driven(room: Room, changes: &[(&Field, u64)]) -> LinkedRobot {
    let mut image = Image::FIRST_BOARD.with(fields::MODE, Mode::GuardedVelocity.code().into());
    for &(field, raw) in changes {
        image = image.with(field, raw);
    }
    let mut options = Options::default().in_room(room);
    options.params.rangefinder.outlier = 0.0;
    options.mpu = (image.get(fields::GYRO) != 0).then(GyroParams::default);
    LinkedRobot::new(&image, options)
}

/// Frames at 40 Hz for so many milliseconds.
fn drive(robot: &mut LinkedRobot, (forward, yaw): Speeds, sweep: u16, ms: u32) -> Vec<Report> {
    let command = Command {
        velocity: velocity(forward, yaw),
        sweep,
        ..Command::default()
    };
    robot.drive(&command, ms / 25)
}

/// Mean true speeds over so many milliseconds.
fn measured(robot: &mut LinkedRobot, speeds: Speeds, ms: u32) -> Speeds {
    let before = robot.rig.truth();
    drive(robot, speeds, 0, ms);
    let after = robot.rig.truth();
    let seconds = f64::from(ms) / 1000.0;
    let turned = (after.pose.heading_rad - before.pose.heading_rad).to_degrees();
    let turned = (turned + 180.0).rem_euclid(360.0) - 180.0;
    ((after.path_mm - before.path_mm) / seconds, turned / seconds)
}

fn wall(x_mm: f64) -> Room {
    Room::default().with_wall(x_mm, -1000.0, x_mm, 1000.0)
}

/// In a curve from a straight line one motor reverses, the other does not.
// Requirement: DOC-2.3-2
#[test]
fn one_bridge_changes_its_inputs_alone() {
    let mut robot = driven(Room::default(), &[]);
    drive(&mut robot, (100.0, 0.0), 0, 500);
    robot.rig.trace_bridges();
    for speeds in [(30.0, 60.0), (100.0, 0.0), (30.0, -60.0)] {
        drive(&mut robot, speeds, 0, 500);
    }
    let [right, left] = robot.rig.take_input_changes();
    for (one, other) in [(&right, &left), (&left, &right)] {
        let alone = |at: &u64| other.iter().all(|&then| then.abs_diff(*at) > 100_000);
        assert!(one.iter().any(alone), "{right:?} {left:?}");
    }
}

// Requirement: WIRE-velocity-1, WIRE-velocity-3, WIRE-velocity-4, WIRE-velocity-5, WIRE-velocity-6, WIRE-status-7
#[test]
fn velocity_tracks_within_five_percent_and_zero_holds() {
    let mut robot = driven(Room::default(), &[FAST_BLIND]);
    let straight = [(100.0, 0.0), (40.0, 0.0)];
    for (forward, yaw) in straight
        .into_iter()
        .chain([(60.0, 20.0), (60.0, -20.0), (20.0, 30.0)])
    {
        drive(&mut robot, (forward, yaw), 0, 2000);
        let (speed, rate) = measured(&mut robot, (forward, yaw), 2000);
        assert!((speed / forward - 1.0).abs() <= 0.05, "{speed} mm/s");
        let rate_error = (rate - yaw).abs();
        assert!(rate_error <= 0.05 * yaw.abs() + 0.5, "{rate} deg/s");
        assert!(robot.last.state == State::Moving && !robot.last.clipped);
    }
    // Beyond the limits the yaw rate is kept.
    drive(&mut robot, (1000.0, 20.0), 0, 3000);
    assert!(robot.last.clipped);
    let (_, rate) = measured(&mut robot, (1000.0, 20.0), 2000);
    assert!((rate - 20.0).abs() < 1.5, "{rate} deg/s");
    drive(&mut robot, STAND, 0, 1000);
    let (speed, rate) = measured(&mut robot, STAND, 1000);
    assert!(speed < 0.01 && rate.abs() < 0.01, "{speed} {rate}");
    assert!(robot.last.state == State::Ready && !robot.last.clipped);
    robot.rig.assert_modelled();
}

// Requirement: WIRE-obstacle-1, WIRE-obstacle-6, WIRE-status-7
#[test]
fn obstacle_stops_before_wall_until_way_is_free() {
    let mut robot = driven(wall(1000.0), &[]);
    let reports = drive(&mut robot, (120.0, 0.0), 0, 15_000);
    assert_eq!(robot.rig.truth().collisions, 0);
    // Overhang and stop distance, less 1 % for the speed of sound and three deviations of a measurement.
    let ahead = robot
        .rig
        .world(|world| world.true_range_mm(FRONT).expect("a wall"));
    assert!((164.8..200.0).contains(&ahead), "{ahead} mm");
    assert!(robot.last.obstacle_limited && robot.last.faults.is_empty());
    assert!(!reports[100].obstacle_limited, "far from it");
    drive(&mut robot, (-50.0, 0.0), 0, 2000);
    assert!(!robot.last.obstacle_limited);
    robot.rig.assert_logged("obstacle: speed limited");
    robot.rig.assert_logged("obstacle: way free");
}

/// At the time of the position in its frame.
#[test]
fn range_is_as_old_as_the_localiser_takes_it_to_be() {
    const SPEED_MM_S: f64 = 200.0;
    let mut robot = driven(wall(2400.0), &[FAST_BLIND]);
    let x_mm = |report: &Report| f64::from(report.pose.x) / 1000.0;
    let range_mm = |report: &Report| distance_mm(report.ranges[0]).expect("an echo");
    let rest = |robot: &mut LinkedRobot| {
        drive(robot, STAND, 0, 1500);
        let ranges = drive(robot, STAND, 0, 1500)
            .iter()
            .map(range_mm)
            .sum::<f64>();
        (x_mm(&robot.last), ranges / 60.0)
    };
    let far = rest(&mut robot);
    let reports = drive(&mut robot, (SPEED_MM_S, 0.0), 0, 9000);
    let near = rest(&mut robot);
    // What is wrong with the scales of ranges and positions is in both rests.
    let slope = (near.1 - far.1) / (near.0 - far.0);
    let is_new = |pair: &&[Report]| pair[0].ranges[0] != pair[1].ranges[0];
    let new = reports[20..].windows(2).filter(is_new).map(|pair| pair[1]);
    let late_mm = new.map(|report| range_mm(&report) - far.1 - slope * (x_mm(&report) - far.0));
    let (sum_mm, count) = late_mm.fold((0.0, 0.0), |(sum, count), mm| (sum + mm, count + 1.0));
    let age_s = sum_mm / count / SPEED_MM_S;
    let expected_s = LocaliserConfig::default().range_age_s;
    assert!(
        count > 100.0 && (age_s - expected_s).abs() < 0.006,
        "{age_s} s"
    );
}

// Requirement: WIRE-deadline-1
#[test]
fn velocity_silence_brakes_within_deadline() {
    let mut robot = driven(Room::default(), &[FAST_BLIND]);
    drive(&mut robot, (100.0, 0.0), 0, 2000);
    robot.rig.run_us(200_000);
    assert!(!robot.rig.motors_off());
    robot.rig.run_us(35_000);
    assert!(robot.rig.motors_off());
    drive(&mut robot, (100.0, 0.0), 0, 1000);
    assert_eq!(robot.last.state, State::Stopped);
    assert!(robot.last.faults.intersects(Faults::LINK_LOST) && robot.rig.motors_off());
}

// Requirement: WIRE-gyro-2, WIRE-gyro-3
#[test]
fn gyro_angle_counts_turns_from_first_bias() {
    let mut robot = driven(Room::default(), &[(fields::GYRO, 1)]);
    drive(&mut robot, STAND, 0, 100);
    assert_eq!(robot.last.gyro, GyroCode::NONE);
    drive(&mut robot, STAND, 0, 2500);
    let before = robot.rig.truth().pose.heading_rad;
    assert!(robot.last.gyro.angle().expect("a bias").abs() < 1 << 12);
    let turning = drive(&mut robot, (0.0, 60.0), 0, 10_000);
    drive(&mut robot, STAND, 0, 1500);
    let angle = |report: &Report| f64::from(report.gyro.angle().expect("a bias")) / 16_777_216.0;
    let turned = angle(&robot.last);
    let truth = (robot.rig.truth().pose.heading_rad - before) / std::f64::consts::TAU;
    let error = (turned - truth + 0.5).rem_euclid(1.0) - 0.5;
    // More than one turn, 3 % of scale.
    assert!(turned > 1.4 && error.abs() < 0.06, "{turned} turns");

    // How far it trails the position, but for the error of its scale: docs/interfaces.md.
    let behind = |report: &Report| {
        let turns = f64::from(report.pose.rotation) / 32_768.0 - angle(report);
        turns - turns.round()
    };
    let scale = behind(&robot.last) / turned;
    let late = |report: &Report| behind(report) - scale * angle(report);
    let last_s = &turning[turning.len() - 41..];
    let late_s =
        last_s.iter().map(late).sum::<f64>() / 41.0 / (angle(&last_s[40]) - angle(&last_s[0]));
    assert!((late_s - 0.0095).abs() < 0.001, "{late_s} s");

    let mut blank = driven(Room::default(), &[]);
    drive(&mut blank, STAND, 0, 2500);
    assert_eq!(blank.last.gyro, GyroCode::NONE);
}

// Requirement: WIRE-sweep-1
#[test]
fn sweep_keeps_its_width_and_every_sensor_measures() {
    let room = wall(600.0)
        .with_wall(-500.0, 400.0, 600.0, 400.0)
        .with_wall(-500.0, -400.0, 600.0, -400.0);
    let mut robot = driven(room, &[(fields::SERVO, 1)]);
    for (sweep, degrees) in [(0x1555, 30.0), (0, 0.0), (0xFFFF, 90.0)] {
        drive(&mut robot, STAND, sweep, 1500);
        let reports = drive(&mut robot, STAND, sweep, 4000);
        let bearings = || reports.iter().map(|report| report.bearing.cast_signed());
        for (end, expected) in [(bearings().min(), -degrees), (bearings().max(), degrees)] {
            let end = f64::from(end.expect("reports")) / 65_536.0 * 360.0;
            assert!((end - expected).abs() < 0.3, "{end} of {expected} degrees");
        }
        let mut sides = reports.iter().flat_map(|report| &report.ranges[1..]);
        assert!(sides.all(|range| *range != DistanceCode::NONE));
    }
}
