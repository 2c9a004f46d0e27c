//! Driving to a pose by velocity with the real, unequal motors.

use host_link::error::Error;
use host_link::pose::Pose;
use host_link::session::{RATE_HZ, Session};
use host_link::settings::Settings;
use pilot::drive::{ArrivalCriteria, go_to};
use pilot::mapping;
use robot_tests::exploration::{self, READY_MS};
use robot_tests::test_board::Rig;
use twin::Options;
use twin::plant::{Imperfections, Room};

/// Follows poses by velocity in an open field, in the world of this seed; checks what is reported, and returns how
/// far the truth is from it at the end of each, at worst.
fn follow(imperfections: Imperfections, seed: u64, poses: &[(f64, f64, f64)]) -> (f64, f64) {
    let mut options = exploration::options(&Room::default(), imperfections, seed);
    options.eeprom = Some(Settings::sample().expect("accepted").image().0.to_vec());
    let rig = Rig::ready(options);
    // Frames at another phase to the ticks.
    rig.run_us(seed * 1_300);
    let mut io = rig.io();
    let mut session = Session::open(&mut io, RATE_HZ, READY_MS).expect("a session");
    let mut worst = (0.0_f64, 0.0_f64);
    for &(x, y, degrees) in poses {
        let target = Pose::new(x, y, degrees);
        let arrival = go_to(&mut session, target, &ArrivalCriteria::default(), |_| ());
        let arrival = arrival.unwrap_or_else(|error| panic!("{target:?}: {error}"));
        // At rest is at most 0.3 mm and 0.1° in 250 ms.
        assert!(
            rig.max_wheel_deg_s() < 3.0,
            "{} deg/s",
            rig.max_wheel_deg_s()
        );
        let pose = mapping::reported_pose(&rig.pose());
        worst.0 = worst.0.max(pose.distance_mm(arrival.pose));
        worst.1 = worst.1.max(pose.rotation_to_deg(arrival.pose).abs());
        // As near as the configuration says.
        let (mm, deg) = (arrival.off_mm, arrival.off_deg.abs());
        assert!(mm <= 3.0 && deg <= 0.5, "{target:?}: {mm} mm, {deg}°");
    }
    worst
}

// Requirement: DOC-1-1
#[test]
fn pose_followed_by_velocity_ends_within_configured_tolerances() {
    let poses = [
        (600.0, 0.0, 0.0),
        (600.0, 0.0, 180.0),
        (300.0, 300.0, 270.0),
        // Behind, near and far.
        (300.0, 360.0, 270.0),
        (300.0, 900.0, 270.0),
        // To the side.
        (0.0, 900.0, 270.0),
        // A turn alone, a small and a large one.
        (0.0, 900.0, 271.0),
        (0.0, 900.0, 91.0),
        // Tiny moves ahead, aside and back.
        (0.0, 905.0, 91.0),
        (6.0, 905.0, 91.0),
        (6.0, 900.0, 91.0),
        (0.0, 0.0, 0.0),
    ];
    for seed in [31, 35, 38] {
        let (mm, deg) = follow(Imperfections::none(), seed, &poses);
        assert!(mm < 2.0 && deg < 0.3, "{mm} mm, {deg}° from the truth");
        follow(Imperfections::default(), seed, &poses);
    }
}

/// Near the origin the number of the reply shows it, not the pose.
// Requirement: WIRE-safe-2
#[test]
fn drive_ends_where_the_stm_restarts() {
    for (at, by_watchdog) in [(80, true), (40, false)] {
        let image = Settings::sample().expect("accepted").image().0.to_vec();
        let rig = Rig::ready(Options::with_eeprom(image).in_room(Room::default()));
        let mut io = rig.io();
        let mut session = Session::open(&mut io, RATE_HZ, READY_MS).expect("a session");
        let (mut frames, mut from_mm) = (0, 0.0);
        let target = Pose::new(1000.0, 0.0, 0.0);
        let driven = go_to(&mut session, target, &ArrivalCriteria::default(), |_| {
            frames += 1;
            if frames == at {
                from_mm = rig.pose().x_mm;
                if by_watchdog {
                    rig.stop_ticks();
                } else {
                    rig.hold_reset(true);
                    rig.run_us(100);
                    rig.hold_reset(false);
                }
            }
        });
        assert_eq!(driven, Err(Error::Restarted), "{from_mm} mm");
        // It rolls on for a moment, and stands.
        let x_mm = rig.pose().x_mm;
        assert!((from_mm + 5.0..from_mm + 150.0).contains(&x_mm), "{x_mm}");
        assert!(rig.max_wheel_deg_s() < 3.0);
    }
}
