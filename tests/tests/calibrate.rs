//! Calibration end to end: the release ELF drives a robot whose true wheels and track are not those of its
//! EEPROM; only its true poses are measured.

use host_link::board_io::BoardIo;
use host_link::eeprom;
use host_link::pose::Pose;
use host_link::session::Session;
use host_link::settings::{Settings, decode};
use pilot::calibrate::distance;
use pilot::calibrate::run::{run, square, straight};
use pilot::calibrate::umbmark::{self, SquareRun};
use pilot::calibrate::wheel_geometry::WheelGeometry;
use pilot::calibrate::wheel_path::WheelPath;
use pilot::ground_truth::GroundTruth;
use pilot::virtual_board::SimulatedTape;
use robot_tests::reference::original_image;
use robot_tests::test_board::Rig;
use twin::Options;
use twin::plant::{Room, Sides};

const SIDE_MM: f64 = 1000.0;

fn rig(truth: &WheelGeometry, eeprom: Vec<u8>) -> Rig {
    let mut options = Options::with_eeprom(eeprom).in_room(Room::default());
    // Both images say 80 mm, 80 mm, 125 mm.
    let chassis = &mut options.params.chassis;
    chassis.wheel_diameter_mm = Sides::new(truth.left_mm, truth.right_mm);
    chassis.track_mm = truth.track_mm;
    Rig::ready(options)
}

/// The I/O of a virtual robot and the measurement of its true position.
struct Robot {
    io: BoardIo,
    tape: SimulatedTape,
}

fn drive(robot: &mut Robot, way: &[Pose]) -> WheelPath {
    robot.tape.put_back();
    let mut session = Session::open(&mut robot.io, 40, 1000).expect("a session");
    run(&mut session, way, |_| {}).expect("a run")
}

fn write(io: &mut BoardIo, figures: &WheelGeometry) {
    let image = eeprom::read(io).expect("the EEPROM");
    let settings = Settings::from_image(&image)
        .and_then(|settings| settings.with(&figures.values()))
        .expect("a configuration");
    eeprom::program(io, settings.image(), 1000, None, |_| {}).expect("written");
}

fn squares(robot: &mut Robot, runs: usize, deviation_mm: f64) -> Vec<SquareRun> {
    (0..2 * runs)
        .map(|nth| {
            let clockwise = nth % 2 == 0;
            SquareRun {
                clockwise,
                path: drive(robot, &square(SIDE_MM, clockwise)),
                measured: robot.tape.measure(deviation_mm),
            }
        })
        .collect()
}

/// Distance, then `UMBmark`: what the EEPROM holds in the end, and how squares end then. Diameters and track are off
/// by so many per cent.
fn assert_recovered(
    [left, right, track]: [f64; 3],
    eeprom: Vec<u8>,
    length_mm: f64,
    deviation_mm: f64,
    percent: f64,
) {
    let truth = WheelGeometry::new(
        80.0 * (1.0 + left / 100.0),
        80.0 * (1.0 + right / 100.0),
        125.0 * (1.0 + track / 100.0),
    );
    let rig = rig(&truth, eeprom);
    let mut robot = Robot {
        io: rig.io(),
        tape: SimulatedTape::new(&rig, 1),
    };
    let path = drive(&mut robot, &straight(length_mm));
    let measured = robot.tape.measure(deviation_mm).into();
    let scaled = distance::solve(&path, &measured).expect("a scale");
    write(&mut robot.io, &scaled.wheels);

    let runs = if deviation_mm > 0.0 { 3 } else { 1 };
    let ends = squares(&mut robot, runs, deviation_mm);
    let estimate = umbmark::solve(&ends, SIDE_MM).expect("an estimate");
    write(&mut robot.io, &estimate.wheels);

    let after = squares(&mut robot, 1, 0.0);
    let image = eeprom::read(&mut robot.io).expect("the EEPROM");
    let found = WheelGeometry::from_config(&decode(&image).expect("a configuration"));
    rig.assert_modelled();
    assert_eq!(rig.truth().collisions, 0);
    let before = estimate.score;
    let after = umbmark::score(&after).expect("both ways");
    println!("{left} {right} {track}: {found:?} for {truth:?}, {before:?}, {after:?}");
    for (found, truth) in [
        (found.left_mm, truth.left_mm),
        (found.right_mm, truth.right_mm),
        (found.track_mm, truth.track_mm),
    ] {
        let off = (found / truth - 1.0).abs() * 100.0;
        assert!(off < percent, "{found} for {truth}: {off} %");
    }
    assert!(
        after.worst_mm < 1.0 + 20.0 * deviation_mm && after.worst_mm < before.worst_mm / 5.0,
        "{before:?} {after:?}"
    );
}

// Requirement: DOC-4.1-6, WIRE-platform-2
#[test]
fn calibration_recovers_wheels_to_0_1_percent() {
    for off in [[5.0, -5.0, -5.0], [5.0, 4.0, 5.0]] {
        assert_recovered(off, original_image(), 1000.0, 0.0, 0.1);
    }
}

#[test]
fn calibration_by_velocity_with_gyroscope_recovers_wheels() {
    let sample = Settings::sample().expect("accepted").image().0.to_vec();
    assert_recovered([5.0, -5.0, -5.0], sample, 1000.0, 0.0, 0.1);
}

#[test]
fn calibration_tape_error_is_not_amplified() {
    // Three standard deviations of a reading over the length.
    assert_recovered([-5.0, 3.0, 4.0], original_image(), 2000.0, 1.0, 0.15);
}
