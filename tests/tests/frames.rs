//! The frames of the ELF, against the document's tables and not against our own encoder.

use fw_core::wire::{Command, MAX_FRAME, Mode, PiLink, Setup};
use robot_tests::reference::{
    KEY_STM, NormalReply, crc16, guarded_frame, image_in_mode, normal_frame, original_image,
    tuning_frame,
};
use robot_tests::test_board::{Rig, ahead};
use twin::Options;
use twin::plant::{RangefinderParams, Room};

fn normal() -> Rig {
    let rig = Rig::configured(original_image());
    rig.run_us(200_000);
    rig
}

fn idle() -> [u8; 19] {
    normal_frame(0, 0, 0, false)
}

// Requirement: DOC-5.2.1-2, DOC-5.2.2-4, DOC-5.2.3-3, DOC-2.1-4, DOC-2.3-5, WIRE-battery-1
#[test]
fn reply_alternates_cells_with_true_voltages() {
    // Of each mode the Pi's frame at rest, and where in the reply the cell is.
    let (normal, tuning) = (idle(), tuning_frame(0.0));
    for (mode, frame, at) in [(0, &normal[..], 11), (1, &tuning, 9), (2, &tuning, 9)] {
        let rig = Rig::configured(image_in_mode(mode));
        rig.run_us(30_000);
        let cells = rig.truth().cells_v;
        let mut next = None;
        // The converter measures the temperature in between.
        for _ in 0..60 {
            let reply = rig.frame(frame);
            assert_eq!(reply[0], KEY_STM);
            let cell = reply[at] >> 5;
            assert_eq!(next.replace(1 - cell).unwrap_or(cell), cell);
            let volts = f64::from(u16::from_be_bytes([reply[at] & 0x1F, reply[at + 1]])) / 200.0;
            let truth = cells[usize::from(cell)];
            assert!((volts - truth).abs() < 0.05, "{volts} V, truly {truth} V");
            rig.run_us(25_000);
        }
    }
}

// Requirement: DOC-2.2-1, DOC-5.2.1-2, DOC-2.1-4, WIRE-distance-2
#[test]
fn normal_reply_distances_order_and_scale() {
    // 900 mm ahead, 600 mm to the right, 1,400 mm to the left.
    let walls = Room::default()
        .with_wall(980.0, -3000.0, 980.0, 3000.0)
        .with_wall(-3000.0, -660.0, 3000.0, -660.0)
        .with_wall(-3000.0, 1460.0, 3000.0, 1460.0);
    let mut options = Options::with_eeprom(original_image()).in_room(walls);
    options.params.rangefinder = RangefinderParams::exact();
    let rig = Rig::ready(options);
    rig.run_us(200_000);
    let reply = NormalReply::of(&rig.frame(&idle()));
    let truth = rig.world(|world| [0, 1, 2].map(|sensor| world.true_range_mm(sensor)));
    for (code, truth) in reply.ranges.into_iter().zip(truth) {
        let (measured, mm) = (f64::from(code) * 2500.0 / 65535.0, truth.expect("a wall"));
        assert!((measured - mm).abs() < 30.0, "{measured} mm, truly {mm} mm");
    }
}

// Requirement: DOC-2.1-2, DOC-2.1-6, WIRE-modes-1
#[test]
fn normal_applied_pose_is_reached_and_reported() {
    let rig = normal();
    let reply = rig.keep_sending(&normal_frame(300_000, 0, 0x1000, true), 8_000_000);
    let reply = NormalReply::of(&reply);
    let truth = rig.pose();
    assert!((f64::from(reply.x) / 1000.0 - truth.x_mm).abs() < 1.0);
    assert!((f64::from(reply.y) / 1000.0 - truth.y_mm).abs() < 1.0);
    let degrees = f64::from(reply.rotation) * 360.0 / 32768.0;
    assert!((degrees - truth.heading_rad.to_degrees().rem_euclid(360.0)).abs() < 0.2);
    assert!((truth.x_mm - 300.0).abs() < 5.0 && (degrees - 45.0).abs() < 1.0);
    assert!(!reply.not_used);
}

// Requirement: DOC-5.1.1-4, WIRE-modes-2
#[test]
fn normal_without_apply_keeps_target() {
    let rig = normal();
    let _ = rig.keep_sending(&normal_frame(300_000, 0, 0, false), 500_000);
    assert!(rig.truth().path_mm < 0.01);
    let _ = rig.keep_sending(&normal_frame(200_000, 0, 0, true), 100_000);
    let _ = rig.keep_sending(&normal_frame(-200_000, 0, 0x4000, false), 6_000_000);
    let pose = rig.pose();
    assert!((pose.x_mm - 200.0).abs() < 5.0, "{pose:?}");
    assert!(pose.heading_rad.to_degrees().abs() < 1.0, "{pose:?}");
}

// Requirement: WIRE-spi-2
#[test]
fn bad_frame_is_dropped_and_next_is_read() {
    let rig = normal();
    let good = normal_frame(200_000, 0, 0, true);
    let mut wrong_key = good;
    wrong_key[0] ^= 1;
    let mut bad_cell = good;
    bad_cell[11] = 7 << 5;
    let long: Vec<u8> = good.iter().copied().chain([0; 64]).collect();
    for bad in [
        &good[..18],
        &good[..1],
        &long[..20],
        &long,
        &wrong_key,
        &bad_cell,
    ] {
        let _ = rig.frame(bad);
        rig.run_us(20_000);
        assert!(rig.motors_off(), "{bad:02X?} had an effect");
        let reply = NormalReply::of(&rig.frame(&idle()));
        assert_eq!(reply.key, KEY_STM, "the frame after {bad:02X?} is shifted");
        rig.run_us(20_000);
    }
    rig.assert_logged("frame rejected");
    let _ = rig.keep_sending(&good, 300_000);
    assert!(!rig.motors_off(), "the good frame is still taken");
    rig.assert_modelled();
}

// Requirement: WIRE-spi-1, WIRE-spi-5
#[test]
fn frames_20_us_apart_are_all_answered() {
    let rig = normal();
    let good = normal_frame(0, 0, 0, false);
    let mut last_cell = None;
    for n in 0..500 {
        let reply = NormalReply::of(&rig.frame(&good));
        assert_eq!(reply.key, KEY_STM, "frame {n}");
        // Every reply is a new one: the cells alternate.
        assert_ne!(last_cell.replace(reply.cell), Some(reply.cell), "frame {n}");
    }
    let log = rig.log();
    assert!(!log.contains("rejected") && !log.contains("lost"), "{log}");
}

/// A position is at most a frame and a tick old, also where the core is too slow to answer within the gap.
// Requirement: WIRE-spi-6
#[test]
fn position_is_a_frame_and_a_tick_old_at_most() {
    for mips in [20, 60] {
        let rig = Rig::with_mips(mips, Options::with_eeprom(original_image()));
        let _ = rig.keep_sending(&ahead(), 1_500_000);
        let mut before = rig.truth();
        for _ in 0..20 {
            rig.run_us(25_000 - 60);
            let now = rig.truth();
            #[allow(clippy::cast_precision_loss, reason = "some milliseconds")]
            let mm_each_ms =
                (now.pose.x_mm - before.pose.x_mm) * 1e6 / (now.at_ns - before.at_ns) as f64;
            let reply = NormalReply::of(&rig.frame(&ahead()));
            let age_ms = (now.pose.x_mm - f64::from(reply.x) / 1000.0) / mm_each_ms;
            assert!(mm_each_ms > 0.05 && age_ms < 36.0, "{age_ms} ms");
            before = now;
        }
    }
}

// Requirement: DOC-5.2.2-1, DOC-2.1-4, DOC-2.3-2, DOC-5.2.2-2, WIRE-modes-3
#[test]
fn tune_rotate_sets_duty_and_reports_rotation() {
    let rig = Rig::configured(image_in_mode(1));
    let reply = rig.keep_sending(&tuning_frame(60.0), 1_000_000);
    let truth = rig.truth();
    assert!((truth.duty.left + 0.6).abs() < 0.01 && (truth.duty.right - 0.6).abs() < 0.01);
    assert_eq!(reply[0], KEY_STM);
    let measured = measurement(&reply);
    assert!(measured > 5.0, "counter-clockwise is positive, {measured}");
    // The samples of 10 ms each are in the log: percent and degrees. The last frame is up to 25 ms late.
    let samples = rig.log().matches(": T 60.00 ").count();
    assert!((90..=103).contains(&samples), "{samples} in a second");
    let _ = rig.keep_sending(&tuning_frame(0.0), 100_000);
    assert!(rig.motors_off());
}

// Requirement: DOC-5.2.3-1, DOC-2.1-4, DOC-5.2.3-4, WIRE-modes-4
#[test]
fn tune_move_drives_straight_and_reports_way() {
    let rig = Rig::booted(Some(image_in_mode(2)));
    let reply = rig.keep_sending(&tuning_frame(-60.0), 1_500_000);
    let measured = measurement(&reply);
    let truth = rig.pose();
    let off = (measured - truth.x_mm).abs();
    assert!(measured < -20.0 && off < 5.0, "{measured} and {truth:?}");
    assert!(truth.heading_rad.to_degrees().abs() < 8.0, "{truth:?}");
    // The samples of 10 ms each are in the log: percent and millimetres.
    let samples = rig.log().matches(": T -60.00 -").count();
    assert!((130..=153).contains(&samples), "{samples} in 1.5 s");
}

// Requirement: WIRE-modes-3
#[test]
fn tune_rotate_reports_all_turns_since_reset() {
    let rig = Rig::booted(Some(image_in_mode(1)));
    let (mut turned, mut last) = (0.0, rig.truth().pose.heading_rad);
    let mut reply = Vec::new();
    for _ in 0..60 {
        reply = rig.keep_sending(&tuning_frame(-100.0), 100_000);
        let heading = rig.truth().pose.heading_rad;
        let (sine, cosine) = (heading - last).sin_cos();
        turned += sine.atan2(cosine).to_degrees();
        last = heading;
    }
    let measured = measurement(&reply);
    assert!(measured < -400.0, "clockwise is negative, {measured}");
    // The rotation between the reported tick and the reply, a frame period and a tick at most.
    let off = (measured - turned).abs();
    assert!(off < 8.0, "{measured}, truly {turned}");
}

/// The rotation or displacement of a tuning mode's reply.
fn measurement(reply: &[u8]) -> f64 {
    let bytes = reply[1..].first_chunk();
    f64::from_le_bytes(*bytes.expect("eight bytes"))
}

// Requirement: WIRE-sequence-6, WIRE-crc-2, WIRE-deadline-2, WIRE-deadline-5
#[test]
fn guarded_accepts_fresh_frames_with_valid_crc() {
    let rig = Rig::booted(Some(image_in_mode(0x10)));
    let go = normal_frame(300_000, 0, 0, true);
    let guarded = |own, order| guarded_frame(own, order, &go);
    let mut flipped = guarded(1, 0);
    flipped[7] ^= 0x10;
    let reply = rig.frame(&flipped);
    assert_eq!(reply[0], KEY_STM);
    assert_eq!(crc16(&reply[..24]).to_be_bytes(), [reply[24], reply[25]]);
    rig.run_us(20_000);
    assert!(rig.motors_off(), "a flipped bit had an effect");
    let mut own = 1_u8;
    for _ in 0..20 {
        let _ = rig.frame(&guarded(own, 0));
        own = own.wrapping_add(1);
        rig.run_us(25_000);
    }
    assert!(!rig.motors_off(), "fresh frames drive: {}", rig.log());
    // The same number again and again is not fresh: the deadline stops the robot.
    for _ in 0..16 {
        let _ = rig.frame(&guarded(own.wrapping_sub(1), 0));
        rig.run_us(25_000);
    }
    assert!(rig.motors_off(), "a repeated frame fed the deadline");
    let status = rig.frame(&guarded(own, 0));
    assert_eq!(status[5], 3, "stopped");
    assert_eq!(status[4] & 1, 1, "link lost is latched");
    rig.run_us(20_000);
    assert!(rig.motors_off(), "apply alone does not resume it");
    let _ = rig.frame(&guarded(own.wrapping_add(1), 2));
    rig.run_us(20_000);
    assert!(!rig.motors_off(), "the order to resume does");
    rig.assert_modelled();
}

/// The answer to the longest frame is armed in the gap behind it: the next frame acknowledges it, unless a
/// tick came in between.
// Requirement: WIRE-spi-5
#[test]
fn guarded_velocity_frame_is_acknowledged_by_the_next() {
    let rig = Rig::ready(Options::with_eeprom(image_in_mode(0x30)));
    let mut pi = PiLink::new(Setup::first_board(Mode::GuardedVelocity));
    let mut late = 0;
    for _ in 0..200 {
        let mut bytes = [0; MAX_FRAME];
        let len = pi.send(&Command::default(), &mut bytes);
        pi.receive(&rig.frame(&bytes[..len])).expect("a report");
        late += u32::from(pi.counters().unacknowledged > 1);
        // No multiple of the tick's: all of its phases.
        rig.run_us(25_013);
    }
    assert!(late <= 4, "{late} of 200 acknowledged late");
    // The longest frame, and a byte more.
    let mut bytes = [0; MAX_FRAME];
    let len = pi.send(&Command::default(), &mut bytes);
    let _ = rig.frame(&[&bytes[..len], &[0]].concat());
    rig.run_us(20_000);
    rig.assert_logged("frame too long by 1");
}
