//! The rangefinders' schedule, and the speed of sound from the chip's temperature.

use robot_tests::reference::{NormalReply, normal_frame, original_image};
use robot_tests::test_board::Rig;
use twin::Options;
use twin::plant::{Params, Pose2, RangefinderParams, Room};

/// No noise and no outliers, in air of `celsius`, the chip `over` K warmer.
fn exact(celsius: f64, over: f64) -> Params {
    Params {
        rangefinder: RangefinderParams {
            temperature_c: celsius,
            ..RangefinderParams::exact()
        },
        chip_over_air_k: over,
        ..Params::default()
    }
}

/// Walls square to all three sensors, so far from them.
fn walls(ahead: f64, right: f64, left: f64) -> Room {
    // The sensors sit 80 mm ahead of and 60 mm beside the axle's middle.
    let (x, r, l) = (80.0 + ahead, -60.0 - right, 60.0 + left);
    Room::default()
        .with_wall(x, -9000.0, x, 9000.0)
        .with_wall(-9000.0, r, 9000.0, r)
        .with_wall(-9000.0, l, 9000.0, l)
}

fn rig(room: Room, params: Params, calibration_words: Option<[u16; 3]>) -> Rig {
    let options = Options::with_eeprom(original_image()).in_room(room);
    let mut options = options.at(Pose2::default());
    options.params = params;
    if let Some(words) = calibration_words {
        options.calibration_words = words;
    }
    Rig::ready(options)
}

fn ranges(rig: &Rig, us: u64) -> [f64; 3] {
    let back = rig.keep_sending(&normal_frame(0, 0, 0, false), us);
    NormalReply::of(&back).ranges.map(|code| match code {
        0xFFFF => f64::NAN,
        code => f64::from(code) * 2500.0 / 65_535.0,
    })
}

// Requirement: DOC-2.2-2, WIRE-log-10
#[test]
fn distance_within_1_percent_at_any_temperature() {
    let truth = [2000.0, 1200.0, 500.0];
    for celsius in [-10.0, 20.0, 45.0] {
        // A chip that warms up more or less than the firmware takes off.
        for over in [0.0, 2.5, 6.0] {
            let rig = rig(walls(2000.0, 1200.0, 500.0), exact(celsius, over), None);
            let measured = ranges(&rig, 400_000);
            for (measured, truth) in measured.into_iter().zip(truth) {
                let off = (measured / truth - 1.0).abs();
                assert!(off < 0.01, "{celsius} °C, +{over} K: {measured}");
            }
            rig.assert_logged("air at ");
            rig.assert_modelled();
        }
    }
}

// Requirement: WIRE-log-10
#[test]
fn missing_calibration_words_use_343_m_per_s() {
    let (room, erased) = (walls(2000.0, 1200.0, 500.0), Some([0xFFFF; 3]));
    let rig = rig(room, exact(19.3, 2.5), erased);
    let measured = ranges(&rig, 400_000);
    assert!((measured[0] - 2000.0).abs() < 2.0, "{measured:?}");
    let log = rig.log();
    let line = log.lines().find(|line| line.contains(": no temperature: "));
    let line = line.unwrap_or_else(|| panic!("{log}"));
    assert!(line.starts_with('W'), "{line}");
    assert!(line.ends_with("sound at 343 m/s"), "{line}");
}

// Requirement: DOC-2.1-6, DOC-5.2.2-5
#[test]
fn rangefinders_ping_in_turn_every_20_ms() {
    let rig = rig(walls(2400.0, 2400.0, 2400.0), exact(20.0, 2.5), None);
    let measured = ranges(&rig, 2_000_000);
    let near = |mm: &f64| (mm - 2400.0).abs() < 24.0;
    assert!(measured.iter().all(near), "{measured:?}");
    let pings = rig.pings();
    for (nth, pair) in pings.windows(2).enumerate() {
        let apart = pair[1].at_ns - pair[0].at_ns;
        // Two ticks.
        let right = (19_800_000..=20_200_000).contains(&apart);
        assert!(right, "{nth}: {apart} ns");
        assert_eq!(pair[1].sensor, (pair[0].sensor + 1) % 3);
    }
}

#[test]
fn late_echo_does_not_reach_next_sensor() {
    // 3.5 to 4 m: answers between 20 and 24 ms after the trigger.
    for far in [3450.0, 3600.0, 3800.0, 3990.0] {
        let rig = rig(walls(far, 1000.0, 1500.0), exact(20.0, 2.5), None);
        for _ in 0..40 {
            let [front, right, left] = ranges(&rig, 25_000);
            assert!(front.is_nan(), "{far}: {front}");
            for (measured, truth) in [(right, 1000.0), (left, 1500.0)] {
                let off = (measured - truth).abs();
                assert!(off.is_nan() || off < 15.0, "{far}: {measured}");
            }
        }
        let pings = rig.pings();
        let front = pings.windows(2).filter(|pair| pair[0].sensor == 0);
        for pair in front {
            assert!(pair[1].at_ns - pair[0].at_ns >= 29_800_000);
        }
        assert!(!rig.log().contains("silent"), "{}", rig.log());
    }
}

// Requirement: WIRE-log-9
#[test]
fn silent_rangefinder_is_logged() {
    let rig = rig(walls(9000.0, 1000.0, 1500.0), exact(20.0, 2.5), None);
    let measured = ranges(&rig, 600_000);
    assert!(measured[0].is_nan() && measured[1] > 900.0);
    assert!(!rig.log().contains("silent"), "{}", rig.log());
    // Its line never goes up.
    rig.set_faults(|faults| faults.unplugged[1] = true);
    let measured = ranges(&rig, 600_000);
    assert!(measured[0].is_nan() && measured[1].is_nan() && measured[2] > 1400.0);
    let log = rig.log();
    assert!(log.contains("right rangefinder silent"), "{log}");
    assert!(!log.contains("front rangefinder silent"), "{log}");
    rig.set_faults(|faults| faults.unplugged[1] = false);
    assert!(ranges(&rig, 600_000)[1] > 900.0);
    rig.assert_logged("right rangefinder answers");
}
