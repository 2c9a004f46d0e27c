//! No input overflows.

use super::*;

#[test]
fn no_pose_target_or_reading_overflows_whatever_the_configuration() {
    // With the test build's overflow checks on.
    let mut word = 0x1234_5678_9ABC_DEF1u64;
    let mut chance = move || {
        word ^= word << 13;
        word ^= word >> 7;
        word ^= word << 17;
        word
    };
    for round in 0..400u64 {
        let mut config = first_board();
        let double = |v: f64| crate::binary64::Binary64(v.to_bits());
        let gain = [0.0, 1e-9, 1.3, 1e4];
        for gains in [&mut config.forward, &mut config.rotation] {
            gains.p = double(gain[chance() as usize % 4]);
            gains.i = double(gain[chance() as usize % 4]);
            gains.d = double(gain[chance() as usize % 4]);
            gains.anti_windup = double(gain[chance() as usize % 4]);
        }
        config.platform.dead_zone_left = (chance() % 10_000) as u16;
        config.platform.limit_left = 1 + (chance() % 10_000) as u16;
        config.platform.limit_right = 1;
        config.platform.position_tolerance = 200 + (chance() % 65_000) as u16;
        config.platform.rotation_tolerance = 8 + (chance() % 0x1FF8) as u16;
        let mut controller = PoseController::new(&config);
        let pick = |a: u64, b: u64| {
            let bits = match a % 5 {
                0 => i64::MIN,
                1 => i64::MAX,
                2 => 0,
                3 => b as i64,
                _ => (b as i64) >> (a >> 8 & 63),
            };
            Millimetres(I32F32::from_bits(bits))
        };
        for k in 0..200 {
            let mut random = || Pose {
                x: pick(chance(), chance()),
                y: pick(chance(), chance()),
                heading: Turns(chance() as u32),
            };
            let (here, target) = (random(), random());
            if k % 7 == round % 7 {
                controller.set_target(target);
            }
            let delta = Delta {
                left: chance() as i32,
                right: (chance() % 65_537) as i32 - 32_768,
                travel: fixed::types::I16F16::from_bits(chance() as i32),
                turn: chance() as i32,
            };
            let _ = controller.drive(&here, &delta);
            if k % 50 == 0 {
                let duty = Duty::saturating((chance() % 20_001) as i32 - 10_000);
                let _ = controller.tune_move(duty, &here, &delta);
                let _ = controller.tune_rotate(duty);
            }
        }
    }
}
