//! Synthetic drives: the wheels roll what takes the robot along its path by its configured wheels,
//! and the truth is integrated from the same turns of the wheels, apart from the code under test.

use super::distance::{self, Measured};
use super::run::{self, square, straight};
use super::umbmark::{self, SquareRun};
use super::wheel_geometry::WheelGeometry;
use super::wheel_path::WheelPath;
use crate::ground_truth::Point;
use fw_core::eeprom::Image;
use host_link::board_io::BoardIo;
use host_link::error::Error;
use host_link::mock_board::{IoFault, MockBoard, mock_board};
use host_link::pose::Pose;
use host_link::session::Session;

const FIRST_BOARD: WheelGeometry = WheelGeometry::new(80.0, 80.0, 125.0);

/// A robot that turns on the spot towards each place, drives there and turns to its rotation, exactly by
/// its own belief. The path as it reports it (in the wire's codes), and where it truly ends.
fn driven(configured: &WheelGeometry, truth: &WheelGeometry, way: &[Pose]) -> (WheelPath, Point) {
    let mut path = WheelPath::new(*configured);
    let mut here = Pose::default();
    let mut real = (0.0, 0.0, 0.0_f64);
    path.push(here);
    let mut roll = |here: &mut Pose, ahead: f64, turn: f64| {
        // Fine steps, straight chords: as good as arcs.
        let pieces = 200.0;
        for _ in 0..200 {
            let (ds, da) = (ahead / pieces, turn.to_radians() / pieces);
            let middle = here.rotation_deg.to_radians() + da / 2.0;
            here.x_mm += ds * middle.cos();
            here.y_mm += ds * middle.sin();
            here.rotation_deg += da.to_degrees();
            let half = configured.track_mm / 2.0 * da;
            let left = (ds - half) * truth.left_mm / configured.left_mm;
            let right = (ds + half) * truth.right_mm / configured.right_mm;
            let true_turn = (right - left) / truth.track_mm;
            let true_middle = real.2 + true_turn / 2.0;
            real.0 += f64::midpoint(left, right) * true_middle.cos();
            real.1 += f64::midpoint(left, right) * true_middle.sin();
            real.2 += true_turn;
            path.push(Pose::from_code(here.code()));
        }
    };
    for there in way {
        let (dx, dy) = (there.x_mm - here.x_mm, there.y_mm - here.y_mm);
        let bearing = Pose {
            rotation_deg: dy.atan2(dx).to_degrees(),
            ..here
        };
        let turn = here.rotation_to_deg(bearing);
        roll(&mut here, 0.0, turn);
        roll(&mut here, dx.hypot(dy), 0.0);
        let turn = here.rotation_to_deg(*there);
        roll(&mut here, 0.0, turn);
    }
    let end = Point::new(real.0, real.1);
    (path, end)
}

fn squares(configured: &WheelGeometry, truth: &WheelGeometry, side_mm: f64) -> Vec<SquareRun> {
    [true, false]
        .map(|clockwise| {
            let (path, measured) = driven(configured, truth, &square(side_mm, clockwise));
            SquareRun {
                clockwise,
                path,
                measured,
            }
        })
        .into()
}

/// Largest relative difference of the three figures, percent.
fn off_percent(found: &WheelGeometry, truth: &WheelGeometry) -> f64 {
    [
        found.left_mm / truth.left_mm,
        found.right_mm / truth.right_mm,
        found.track_mm / truth.track_mm,
    ]
    .map(|ratio| (ratio - 1.0).abs() * 100.0)
    .into_iter()
    .fold(0.0, f64::max)
}

// Requirement: DOC-4.1-6
#[test]
fn distance_and_squares_recover_five_percent_errors() {
    for left in [-5.0, 0.0, 5.0] {
        for right in [-5.0, 0.0, 5.0] {
            for track in [-5.0, 0.0, 5.0] {
                let off = |figure: f64, percent: f64| figure * (1.0 + percent / 100.0);
                let truth =
                    WheelGeometry::new(off(80.0, left), off(80.0, right), off(125.0, track));
                let (path, end) = driven(&FIRST_BOARD, &truth, &straight(1000.0));
                let scaled = distance::solve(&path, &end.into()).unwrap().wheels;
                let runs = squares(&scaled, &truth, 1000.0);
                let found = umbmark::solve(&runs, 1000.0).unwrap();
                let off = off_percent(&found.wheels, &truth);
                assert!(off < 0.02, "{left} {right} {track}: {off} % {found:?}");
                assert!(found.residual_mm < 0.5, "{found:?}");
            }
        }
    }
}

#[test]
fn noisy_readings_stay_within_estimated_deviation() {
    let truth = WheelGeometry::new(79.2, 80.6, 127.0);
    let scaled = FIRST_BOARD.scaled((79.2 + 80.6) / 160.0);
    // Three millimetres in every combination: their mean is zero.
    let noisy = |configured, truth| {
        let mut runs = Vec::new();
        for (ahead, left) in [(3.0, 3.0), (-3.0, 3.0), (3.0, -3.0), (-3.0, -3.0)] {
            for mut run in squares(configured, truth, 1000.0) {
                run.measured.ahead_mm += ahead;
                run.measured.left_mm += left;
                runs.push(run);
            }
        }
        runs
    };
    // Of right wheels nothing is certain.
    let right = umbmark::solve(&noisy(&FIRST_BOARD, &FIRST_BOARD), 1000.0).unwrap();
    assert_eq!(right.wheels, FIRST_BOARD);
    let runs = noisy(&scaled, &truth);
    let found = umbmark::solve(&runs, 1000.0).unwrap();
    assert!((2.5..3.5).contains(&found.residual_mm), "{found:?}");
    let score = found.score;
    assert!((4.0..6.0).contains(&score.clockwise.deviation_mm));
    let offsets = [score.clockwise, score.counter_clockwise].map(|one| one.offset_mm);
    assert!(offsets.iter().all(|&offset| score.worst_mm >= offset));
    let settings = host_link::settings::Settings::first_board().unwrap();
    let written = settings.with(&truth.values()).unwrap();
    assert_eq!(WheelGeometry::from_config(written.config()), truth);
    assert!(off_percent(&found.wheels, &truth) < 0.02, "{found:?}");
    for deviation in [found.track_deviation, found.ratio_deviation] {
        assert!((1e-5..1e-3).contains(&deviation), "{found:?}");
    }
    // Three runs less: now the mean is off, by no more than four deviations.
    let found = umbmark::solve(&runs[..3], 1000.0).unwrap();
    let track = (found.wheels.track_mm / 127.0 - 1.0).abs();
    assert!(track < 4.0 * found.track_deviation, "{track} {found:?}");
}

#[test]
fn distance_without_side_offset_is_taken_as_straight() {
    let truth = FIRST_BOARD.scaled(1.03);
    let (path, end) = driven(&FIRST_BOARD, &truth, &straight(1000.0));
    let measured = Measured {
        ahead_mm: end.distance_mm(),
        left_mm: None,
    };
    let found = distance::solve(&path, &measured).unwrap();
    assert!(off_percent(&found.wheels, &truth) < 0.001, "{found:?}");
    assert!((found.ratio - 1.0).abs() < 1e-12);
}

#[test]
fn implausible_distance_is_rejected_with_range() {
    let (path, _) = driven(&FIRST_BOARD, &FIRST_BOARD, &straight(1000.0));
    let at = |ahead_mm, left_mm| distance::solve(&path, &Measured { ahead_mm, left_mm });
    for (ahead, left) in [
        (100.0, None), // centimetres
        (1101.0, None),
        (899.0, Some(0.0)),
        (-1000.0, Some(0.0)),
        (-1000.0, None),
        (f64::NAN, None),
        (700.0, Some(700.0)), // bent by far more than a tenth of ratio
    ] {
        let why = at(ahead, left).unwrap_err();
        assert!(
            why.contains("accepted") || why.contains("no diameters"),
            "{why}"
        );
    }
    assert!(at(1099.0, None).is_ok() && at(901.0, None).is_ok());
    let (short, end) = driven(&FIRST_BOARD, &FIRST_BOARD, &straight(150.0));
    assert!(
        distance::solve(&short, &end.into())
            .unwrap_err()
            .contains("200 mm")
    );
}

#[test]
fn inconsistent_or_one_way_squares_are_rejected() {
    let good = squares(&FIRST_BOARD, &FIRST_BOARD, 1000.0);
    let one_way = umbmark::solve(&good[..1], 1000.0).unwrap_err();
    assert!(one_way.contains("no run counter-clockwise"), "{one_way}");
    assert!(umbmark::solve(&[], 1000.0).is_err());
    // Ahead and left swapped, or measured from the room's corner.
    let mut wrong = squares(&FIRST_BOARD, &FIRST_BOARD, 1000.0);
    (wrong[0].measured.ahead_mm, wrong[1].measured.left_mm) = (300.0, 300.0);
    let why = umbmark::solve(&wrong, 1000.0).unwrap_err();
    assert!(why.contains("accepted"), "{why}");
    wrong[0].measured.ahead_mm = 2500.0;
    let why = umbmark::solve(&wrong, 1000.0).unwrap_err();
    assert!(why.contains("twice the side"), "{why}");
    wrong[0].measured.ahead_mm = f64::NAN;
    assert!(umbmark::solve(&wrong, 1000.0).is_err());
}

#[test]
fn track_wrong_by_fifth_is_rejected() {
    let truth = FIRST_BOARD.with_track(1.2);
    let why = umbmark::solve(&squares(&FIRST_BOARD, &truth, 1000.0), 1000.0).unwrap_err();
    assert!(
        why.contains("track") && why.contains("accepted is 15 %"),
        "{why}"
    );
}

fn drive(io: &mut BoardIo, way: &[Pose]) -> Result<WheelPath, Error> {
    let mut session = Session::open(io, 40, 100)?;
    run::run(&mut session, way, |_| {})
}

/// The last command keeps the robot where it is.
fn assert_holds_position(board: &MockBoard) {
    let last = board.commands.last().expect("frames were sent");
    assert!(last.apply && last.expected.x < 1_000_000, "{last:?}");
}

#[test]
fn run_interrupt_or_lost_link_stops_robot() {
    let (board, mut io) = mock_board(&Image::FIRST_BOARD, Some(IoFault::Interrupt(30)));
    let interrupted = drive(&mut io, &straight(1000.0));
    assert_eq!(interrupted, Err(Error::Interrupted));
    assert_holds_position(&board.borrow());

    let (board, mut io) = mock_board(&Image::FIRST_BOARD, None);
    board.borrow_mut().garbled_from = 6;
    let error = drive(&mut io, &straight(1000.0)).unwrap_err();
    assert!(
        matches!(error, Error::Silent { frames: 8, .. }),
        "{error:?}"
    );
    // 6 answered, 8 not, and the 10 of the stop.
    assert_eq!(board.borrow().commands.len(), 24);
    assert_holds_position(&board.borrow());
}

#[test]
fn run_keeps_to_its_path_leg_by_leg() {
    let start = Pose::new(300.0, -200.0, 0.0);
    let run = |drift_um: i32, way: &[Pose]| {
        let (board, mut io) = mock_board(&Image::FIRST_BOARD, None);
        board.borrow_mut().report.pose = start.code();
        board.borrow_mut().on_command = Some(Box::new(move |_, report| {
            report.pose.y += drift_um;
        }));
        let run = drive(&mut io, way);
        (run.map(|path| path.moved()), board)
    };
    let (outcome, board) = run(0, &square(1000.0, true));
    let end = Pose::from_code(board.borrow().report.pose);
    assert!(
        outcome == Ok(true) && end.distance_mm(start) < 5.0,
        "{end:?}"
    );
    for (drift_um, way, why) in [
        (100_000, straight(1000.0), "beside its path"),
        (0, vec![Pose::default()], "nothing moved"),
    ] {
        let (outcome, board) = run(drift_um, &way);
        assert!(
            matches!(&outcome, Err(Error::Calibration(text)) if text.contains(why)),
            "{outcome:?}"
        );
        assert_holds_position(&board.borrow());
    }
}

#[test]
fn creep_adds_up() {
    let mut path = WheelPath::new(FIRST_BOARD);
    for micrometres in 0..=1000 {
        path.push(Pose::new(f64::from(micrometres) / 1000.0, 0.0, 0.0));
    }
    assert!((path.odometry_end().ahead_mm - 1.0).abs() < 0.01);
}

#[test]
fn arc_of_few_reports_ends_where_it_was_reported() {
    let mut path = WheelPath::new(FIRST_BOARD);
    for degrees in [0.0_f64, 30.0, 90.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        path.push(Pose::new(200.0 * sin, 200.0 * (1.0 - cos), degrees));
    }
    let end = path.odometry_end();
    let off_mm = (end.ahead_mm - 200.0).hypot(end.left_mm - 200.0);
    assert!(off_mm < 1e-6, "{end:?}");
}
