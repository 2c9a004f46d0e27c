//! Driving to a pose with the real, unequal motors: 5 mm and 1° at rest.

use host_link::board_io::Interrupt;
use host_link::pose::Pose;
use host_link::session::{RATE_HZ, Session};
use pilot::drive::{ArrivalCriteria, go_to};
use pilot::virtual_board;
use robot_tests::exploration::{READY_MS, SPI_HZ, configured_board};
use robot_tests::reference::{normal_frame, original_image};
use robot_tests::test_board::{ELF, Rig, elf};
use twin::Options;
use twin::plant::Room;

/// Drives to (x, y) mm and `degrees` in an open field; the truth's distance and angle to it at rest.
fn drive(x: f64, y: f64, degrees: f64, seconds: u64) -> (f64, f64, u32) {
    let rig = Rig::ready(Options {
        room: Room::default(),
        ..Options::with_eeprom(original_image())
    });
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let rotation = (degrees / 360.0 * 32768.0).round().rem_euclid(32768.0) as u16;
    #[allow(clippy::cast_possible_truncation)]
    let frame = normal_frame((x * 1000.0) as i32, (y * 1000.0) as i32, rotation, true);
    let _ = rig.keep_sending(&frame, seconds * 1_000_000);
    let truth = rig.truth();
    let still = truth.wheel_deg_s;
    assert!(still.left.abs().max(still.right.abs()) < 0.5, "{still:?}");
    let pose = truth.pose.relative_to(&rig.world(|w| w.room().start));
    let off = (pose.heading_rad.to_degrees() - degrees + 180.0).rem_euclid(360.0) - 180.0;
    let mm = (pose.x_mm - x).hypot(pose.y_mm - y);
    (mm, off.abs(), truth.collisions)
}

// Requirement: DOC-1-1, DOC-5.2.1-1
#[test]
fn drive_reaches_poses_within_5_mm_and_1_degree() {
    for (x, y, degrees, seconds) in [
        (1000.0, 0.0, 0.0, 20),
        (0.0, 0.0, 180.0, 12),
        (300.0, 300.0, 270.0, 15),
        (-400.0, 100.0, 90.0, 20),
        (50.0, 0.0, 0.0, 10),
    ] {
        let (mm, off, collisions) = drive(x, y, degrees, seconds);
        assert!(mm <= 5.0 && off <= 1.0, "{x} {y}: {mm:.2} mm, {off:.2}°");
        assert_eq!(collisions, 0);
    }
}

// Requirement: DOC-1-1
#[test]
fn pose_followed_by_velocity_ends_within_tolerances() {
    let board = configured_board(&elf(ELF), &Room::default(), 31).expect("a board");
    let mut io = virtual_board::board_io(&board, SPI_HZ, Interrupt::new());
    let mut session = Session::open(&mut io, RATE_HZ, READY_MS).expect("a session");
    let criteria = ArrivalCriteria::default();
    for (x, y, degrees) in [
        (600.0, 0.0, 0.0),
        (600.0, 0.0, 180.0),
        (300.0, 300.0, 270.0),
        (250.0, 300.0, 275.0),
        (0.0, 0.0, 0.0),
    ] {
        let target = Pose::new(x, y, degrees);
        let arrival = go_to(&mut session, target, &criteria, |_, _| ());
        let arrival = arrival.expect("reached");
        assert!(arrival.seconds < 20.0, "{arrival:?}");
    }
}
