//! Mode 0x20: the servo, the bearing of every reading, and the resulting map.

use fw_core::eeprom::{Config, Image, fields};
use fw_core::wire::{Command, Mode, Report};
use host_link::snapshot::distance_mm;
use host_link::statistics::LinkStatistics;
use mapper::Point;
use pilot::exploring::Localisation;
use pilot::mapping::{BODY_MM, RangeSample};
use robot_tests::linked_robot::LinkedRobot;
use robot_tests::test_board::{Rig, image_with_servo, take_writes};
use twin::board_model::Ping;
use twin::plant::{Params, RangefinderParams};
use twin::{Board, Options};

fn sweeping() -> Image {
    image_with_servo(Mode::GuardedSweep)
}

fn robot(image: &Image, params: Params) -> LinkedRobot {
    let options = Options::default();
    let robot = LinkedRobot::new(image, Options { params, ..options });
    robot.rig.run_us(20_000);
    robot
}

/// Frames at 40 Hz for `us`: each reply and its time.
fn frames(robot: &mut LinkedRobot, us: u64) -> Vec<(u64, Report)> {
    let ends = robot.rig.now_us() + us;
    let mut all = Vec::new();
    while robot.rig.now_us() < ends {
        let at = robot.rig.now_ns();
        all.push((at, robot.exchange(&Command::default())));
        robot.rig.run_us(25_000 - 60);
    }
    all
}

fn degrees(bearing: u16) -> f64 {
    f64::from(bearing.cast_signed()) * 360.0 / 65_536.0
}

/// The reports without the repeats of one reading.
fn readings(reports: &[(u64, Report)]) -> Vec<(u64, Report)> {
    let mut new = Vec::new();
    let mut last = (0, fw_core::wire::DistanceCode::NONE);
    for &(at, report) in reports {
        let reading = (report.bearing, report.ranges[0]);
        if reading != last {
            last = reading;
            new.push((at, report));
        }
    }
    new
}

/// No noise and no outliers: the rest is the robot's own error.
fn exact() -> Params {
    Params {
        rangefinder: RangefinderParams::exact(),
        ..Params::default()
    }
}

/// Every reading belongs to the ping before it: with the servo's true bearing, and the true range.
fn assert_readings_match_pings(pings: &[Ping], readings: &[(u64, Report)], front_deg: f64) {
    let mut pings = pings.iter();
    for (at, report) in readings {
        let bearing = degrees(report.bearing);
        let measured = distance_mm(report.ranges[0]);
        // In order: none twice, and none left out.
        let ping = pings.next().expect("a ping for every reading");
        assert!(ping.at_ns < *at, "{bearing}");
        let true_bearing = ping.bearing_rad.to_degrees();
        let off = (true_bearing - bearing).abs();
        assert!(
            off < 0.7,
            "{bearing}, not {true_bearing} (front {front_deg})"
        );
        match (measured, ping.range_mm.filter(|&mm| mm < 2499.0)) {
            (Some(measured), Some(truth)) => {
                // A per cent for the chip's idea of the air, and a step of the emulated clock.
                let most = 2.0 + truth / 100.0;
                assert!((measured - truth).abs() <= most, "{measured} for {truth}");
            }
            (None, Some(truth)) => assert!(truth > 2475.0, "{bearing}: no echo for {truth}"),
            (Some(measured), None) => {
                assert!(measured > 2475.0, "{bearing}: {measured} for no echo");
            }
            (None, None) => {}
        }
    }
}

// Requirement: WIRE-bearing-2, WIRE-bearing-3, WIRE-bearing-4, WIRE-bearing-5
#[test]
fn scan_readings_carry_their_bearing_exactly_once() {
    let mut robot = robot(&sweeping(), exact());
    // Five seconds are two sweeps to and fro.
    let reports = frames(&mut robot, 5_600_000);
    let first = reports[0].1;
    assert_eq!((first.bearing, distance_mm(first.ranges[0])), (0, None));
    let readings = readings(&reports);
    let pings = robot.rig.pings();
    assert!(pings.iter().all(|ping| ping.sensor == 0));
    assert!(readings.len() >= 80, "{}", readings.len());
    // The last may be under way.
    assert!(pings.len() - readings.len() <= 1);
    assert_readings_match_pings(&pings, &readings, 0.0);
    let bearings: Vec<f64> = readings.iter().map(|(_, r)| degrees(r.bearing)).collect();
    let turns = bearings
        .windows(3)
        .filter(|w| (w[1] - w[0]) * (w[2] - w[1]) < 0.0);
    assert!(turns.count() >= 4, "to and fro: {bearings:?}");
    let ends = (-90.0, 90.0);
    assert!(bearings.iter().any(|b| (b - ends.0).abs() < 0.2));
    assert!(bearings.iter().any(|b| (b - ends.1).abs() < 0.2));
    // As fast as the part allows: 60 ms from burst to burst.
    for pair in pings.windows(2) {
        let apart = pair[1].at_ns - pair[0].at_ns;
        assert!((59_900_000..=60_100_000).contains(&apart), "{apart} ns");
    }
    let echoes = readings
        .iter()
        .filter(|(_, r)| distance_mm(r.ranges[0]).is_some());
    assert!(echoes.count() > 40);
    robot.rig.assert_modelled();
}

// Requirement: WIRE-platform-6
#[test]
fn scan_reversed_short_servo_bearings_are_true() {
    let mut params = exact();
    params.servo.travel_rad = -std::f64::consts::FRAC_PI_2;
    params.mounts[0].bearing_rad = 30f64.to_radians();
    let image = sweeping().with(fields::SERVO_REVERSED, 1);
    let image = image.with(fields::SERVO_TRAVEL, 0x4000);
    let mut robot = robot(&image.with(fields::BEARING_FRONT, 0x1555), params);
    let reports = frames(&mut robot, 2_500_000);
    let readings = readings(&reports);
    assert!(readings.len() >= 30);
    assert_readings_match_pings(&robot.rig.pings(), &readings, 30.0);
}

#[test]
fn scan_slow_servo_shows_bearing_errors() {
    let mut params = exact();
    // Half as fast as the plan allows for.
    params.servo.slew_rad_s /= 2.0;
    let mut robot = robot(&sweeping(), params);
    let reports = frames(&mut robot, 2_500_000);
    let readings = readings(&reports);
    let pings = robot.rig.pings();
    let pairs = pings.iter().zip(&readings);
    let errors = pairs.map(|(ping, (_, r))| ping.bearing_rad.to_degrees() - degrees(r.bearing));
    let worst = errors.map(f64::abs).fold(0.0, f64::max);
    assert!(worst > 1.0, "{worst}");
}

// Requirement: WIRE-servo-1, WIRE-servo-2
#[test]
fn scan_servo_rests_without_frames() {
    let mut robot = robot(&sweeping(), exact());
    let angle = |board: &Board| board.world(|world| world.servo.angle_rad.to_degrees());
    robot.rig.run_us(700_000);
    assert!(angle(&robot.rig.board).abs() < 1e-9);
    assert!(robot.rig.pings().is_empty());
    frames(&mut robot, 1_000_000);
    let pings = robot.rig.pings().len();
    assert!(pings > 3);
    // The stop deadline's 250 ms, and what was under way.
    robot.rig.run_us(350_000);
    let (stands, pings) = (angle(&robot.rig.board), robot.rig.pings().len());
    robot.rig.run_us(2_000_000);
    assert!((angle(&robot.rig.board) - stands).abs() < 1e-9);
    assert_eq!(robot.rig.pings().len(), pings);
    // Turned from outside meanwhile: the readings after that are still true.
    robot.rig.world(|world| world.servo.angle_rad = 1.2);
    let reports = frames(&mut robot, 1_500_000);
    let fresh = readings(&reports[24..]);
    let after = robot.rig.pings();
    assert!(after.len() > pings + 8);
    for (at, report) in fresh {
        let ping = after.iter().rfind(|ping| ping.at_ns + 500_000 < at);
        let ping = ping.expect("a ping before every reading");
        let off = ping.bearing_rad.to_degrees() - degrees(report.bearing);
        let of_the_one_before = off.abs() > 5.0 && off.abs() < 11.0;
        assert!(off.abs() < 0.7 || of_the_one_before, "{off}");
    }
}

/// The servo's timer's reload (RM0383, 12.4.12).
const TIM1_ARR: u64 = 0x4001_002C;

// Requirement: WIRE-servo-3
#[test]
fn servo_points_ahead_in_other_modes() {
    let image = image_with_servo(Mode::Normal);
    let rig = Rig::configured(image.0.to_vec());
    rig.world(|world| world.servo.angle_rad = -1.5);
    rig.trace_writes(TIM1_ARR);
    let frame = robot_tests::reference::normal_frame(0, 0, 0, false);
    let _ = rig.keep_sending(&frame, 450_000);
    assert!(rig.pings().is_empty(), "not before it stands");
    let _ = rig.keep_sending(&frame, 1_000_000);
    let pings = rig.pings();
    assert!(pings.len() > 30, "{}", pings.len());
    for ping in pings.iter().filter(|ping| ping.sensor == 0) {
        assert!(ping.bearing_rad.to_degrees().abs() < 0.7);
    }
    // A microsecond low, then high until the counter overflows behind its reload: 1.5 ms.
    assert!(take_writes(&rig).iter().all(|write| write.value == 1_500));
}

// Requirement: DOC-1-2, DOC-2.2-3
#[test]
fn scan_maps_room_around_robot() {
    let mut robot = robot(&sweeping(), Params::default());
    let config = Config::decode(&sweeping()).expect("accepted");
    let mut survey = Localisation::new(&config, BODY_MM, 25.0);
    // What was seen is entered after 400 mm or a radian.
    for (x_mm, heading_deg) in [
        (0.0, 60.0),
        (0.0, -60.0),
        (400.0, 0.0),
        (400.0, 90.0),
        (400.0, -90.0),
        (400.0, 180.0),
        (0.0, 180.0),
    ] {
        robot.go((x_mm, 0.0, heading_deg), 0);
        for (at, report) in frames(&mut robot, 6_000_000) {
            let mut snapshot = host_link::snapshot::Snapshot::new(&config);
            snapshot.update(at / 1000, &report, LinkStatistics::default());
            survey.observe(&RangeSample::of(&snapshot).expect("a mode with poses"));
        }
    }
    // The first board's start looks along +x of its own frame: what was seen must be where walls are.
    let room = robot.rig.world(|world| world.room().clone());
    let grid = survey.localiser.grid();
    let (mut right, mut wrong, mut ahead) = (0, 0, [0; 3]);
    for (column, row) in grid.cells() {
        if grid.probability(column, row) >= 0.7 {
            let Point { x_mm: x, y_mm: y } = grid.middle(column, row);
            // Within the cone's half width of a wall: an arc is drawn where only a point of it is.
            let near = room.clearance_mm(room.start.point_at(x, y));
            let allowed = 60.0 + 0.27 * x.hypot(y);
            let seen_wall = near <= allowed;
            right += u32::from(seen_wall);
            wrong += u32::from(!seen_wall);
            let side = y.atan2(x).to_degrees();
            ahead[usize::from(side >= -30.0) + usize::from(side > 30.0)] += 1;
        }
    }
    assert!(right > 60 && wrong * 20 <= right, "{right}, {wrong} wrong");
    assert!(ahead.iter().all(|&cells| cells > 5), "{ahead:?}");
}
