//! Exploring on the virtual board: a small room that the robot does not know, in an imperfect world,
//! and what goes wrong on the way.

use host_link::error::Error;
use mapper::{Grid, Point};
use pilot::calibrate::explored::Explored;
use pilot::calibrate::wheel_geometry::WheelGeometry;
use robot_tests::exploration::{self, Figures};
use robot_tests::test_board::Rig;
use twin::Board;
use twin::plant::{Faults, Imperfections, Pose2, Room, Sides};

/// 2 m by 1.6 m with a box in it.
fn small_room() -> Room {
    let room = Room::default()
        .with_wall(-400.0, -500.0, 1600.0, -500.0)
        .with_wall(1600.0, -500.0, 1600.0, 1100.0)
        .with_wall(1600.0, 1100.0, -400.0, 1100.0)
        .with_wall(-400.0, 1100.0, -400.0, -500.0);
    let corner = Pose2::new(1450.0, 950.0, 0.0);
    room.with_box(&corner, 300.0, 300.0)
}

/// In it, a robot with a body of this radius, mm.
fn rig(seed: u64, body_mm: f64) -> Rig {
    let mut options = exploration::options(&small_room(), Imperfections::default(), seed);
    exploration::set_body(&mut options, body_mm);
    let settings = exploration::settings().expect("accepted");
    options.eeprom = Some(settings.image().0.to_vec());
    Rig::new(options)
}

/// Explores it with a body of this radius, mm, while `disturb` does what it likes at a time, s, with the map so far;
/// checks that the robot comes home without a collision.
fn explore(seed: u64, body_mm: f64, mut disturb: impl FnMut(&Board, f64, &Grid)) -> Figures {
    let (room, rig) = (small_room(), rig(seed, body_mm));
    let mut reports = 0.0;
    let run = exploration::explore(&mut rig.io(), &rig, |step| {
        reports += 1.0;
        disturb(&rig, reports / 40.0, step.grid);
    });
    let run = run.expect("a session");
    let figures = run.figures(&room);
    let truth = rig.truth();
    assert!(figures.completed, "{:?}", run.drive);
    assert_eq!((truth.collisions, figures.frames_rejected), (0, 0));
    assert!(truth.pose.distance_mm(&room.start) < 100.0);
    assert!(
        rig.max_wheel_deg_s() < 1.0,
        "{} deg/s",
        rig.max_wheel_deg_s()
    );
    assert!(figures.coverage > 0.99 && figures.map_iou > 0.8);
    figures
}

// Requirement: NAV-explore-1, NAV-pose-1
#[test]
fn unknown_room_is_mapped_and_robot_comes_home() {
    let figures = explore(21, 100.0, |_, _, _| ());
    assert_eq!(figures.stops, 0);
    assert!(figures.position_error_mm_max < 60.0 && figures.heading_error_deg_max < 5.0);
}

// Requirement: NAV-recovery-1
#[test]
fn jam_slip_and_silence_are_answered_and_room_is_mapped() {
    let mut silent = false;
    let figures = explore(22, 100.0, |board, time_s, _| {
        let jam = (30.0..32.0).contains(&time_s);
        let slip = f64::from(u8::from((50.0..50.5).contains(&time_s)));
        board.set_faults(move |faults: &mut Faults| {
            faults.jammed.left = jam;
            faults.slip.right = slip;
        });
        if time_s > 15.0 && !silent {
            silent = true;
            // Longer than the stop deadline.
            board.run_us(400_000);
        }
    });
    assert!(figures.stops >= 2, "{}", figures.stops);
    assert!(figures.position_error_mm_max < 150.0 && figures.heading_error_deg_max < 8.0);
}

// Requirement: NAV-recovery-1
#[test]
fn rangefinder_that_stays_unplugged_ends_the_drive_by_its_name() {
    let rig = rig(25, 100.0);
    let mut time_s = 0.0;
    let run = exploration::explore(&mut rig.io(), &rig, |_| {
        time_s += 1.0 / 40.0;
        // A loose contact for 2 s is none.
        let unplugged = (10.0..12.0).contains(&time_s) || time_s > 20.0;
        rig.set_faults(move |faults: &mut Faults| faults.unplugged[1] = unplugged);
    });
    let drive = run.expect("a session").drive;
    let named = matches!(drive, Err(Error::SilentRangefinder("right")));
    assert!(
        named && (23.0..25.0).contains(&time_s),
        "{drive:?} after {time_s} s"
    );
}

// Requirement: NAV-explore-1
#[test]
fn wide_robot_drives_around_what_comes_and_goes() {
    let visitor = Point::new(700.0, 300.0);
    let (mut left_s, mut seen) = (f64::INFINITY, false);
    explore(23, 150.0, |board, time_s, grid| {
        let is_far = board.truth().pose.position().distance_mm(visitor) > 500.0;
        if time_s > 15.0 && left_s > 1e6 && is_far {
            let room = small_room().with_circle(visitor, 100.0);
            board.world(move |world| world.set_room(room));
            left_s = time_s + 40.0;
        } else if (0.0..time_s).contains(&left_s) {
            board.world(|world| world.set_room(small_room()));
            left_s = -1.0;
        }
        let is_at = |at: Point| (80.0..150.0).contains(&at.distance_mm(visitor));
        seen |= grid.occupied().any(is_at);
    });
    assert!(seen && left_s < 0.0, "{seen} {left_s}");
}

// Requirement: NAV-calibrate-1
#[test]
fn learned_wheels_in_eeprom_improve_next_exploration() {
    let (room, sample) = (small_room(), exploration::settings().expect("accepted"));
    let options = || exploration::options(&room, Imperfections::default(), 24);
    let truth = Rig::new(options()).world(|world| world.params().chassis);
    let Sides { left, right } = truth.wheel_diameter_mm;
    // As measured by a ruler: 0.6 and 1 % off. What a run in this room learns is off by up to 0.07 % of the wheels'
    // ratio and up to 0.28 % of the track (20 seeds).
    let by_ruler = WheelGeometry::new(left, right, truth.track_mm * 1.01).with_ratio(1.006);
    let mut settings = sample.with(&by_ruler.values()).expect("accepted");
    let (mut off, mut raw_mm) = (Vec::new(), Vec::new());
    for _ in 0..2 {
        let mut options = options();
        options.eeprom = Some(settings.image().0.to_vec());
        let rig = Rig::new(options);
        let run = exploration::explore(&mut rig.io(), &rig, |_| ()).expect("a session");
        let assumed = WheelGeometry::from_config(settings.config());
        let ratio = assumed.right_mm / assumed.left_mm / (right / left);
        let [wheels, track] =
            [ratio, assumed.track_mm / truth.track_mm].map(|factor| (factor - 1.0).abs() * 100.0);
        off.push((wheels, track));
        raw_mm.push(run.figures(&room).raw_position_error_mm_max);
        let learned = Explored::new(settings.config(), &run.localisation.localiser.calibration());
        let wheels = learned.wheels().expect("learned");
        settings = settings.with(&wheels.values()).expect("accepted");
    }
    assert!(off[1].0 < 0.15 && off[1].0 < off[0].0 / 2.0, "{off:?}");
    assert!(off[1].1 < 0.35 && off[1].1 < off[0].1 / 2.0, "{off:?}");
    assert!(raw_mm[1] < raw_mm[0] / 2.0, "{raw_mm:?}");
}
