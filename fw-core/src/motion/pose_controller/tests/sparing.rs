//! A look at the target that is spared would have said the same.

use super::*;
use crate::eeprom::first_board;
use crate::types::Millimetres;
use fixed::types::I32F32;

/// Holding its place, left alone, nudged and pushed, beside one that looks at its target every tick.
#[test]
fn a_robot_that_rests_holds_as_one_that_always_looks() {
    let mut word = 0x1234_5678_9ABC_DEF1_u64;
    let mut chance = move |of: u64| {
        word ^= word << 13;
        word ^= word >> 7;
        word ^= word << 17;
        word % of
    };
    let mut controller = PoseController::new(&first_board());
    let mut looking = controller.clone();
    let (mut target, mut pose) = (Pose::default(), Pose::default());
    let (mut spared, mut left) = (0, 0);
    for _ in 0..200_000 {
        let mut delta = Delta::default();
        match chance(80) {
            // To either side of both tolerances, 3 mm and 0.5°.
            0 => {
                let mut aside = || I32F32::from_bits((chance(8 << 32) as i64) - (4 << 32));
                pose.x = Millimetres(target.x.0 + aside());
                pose.y = Millimetres(target.y.0 + aside());
                delta.left = 50;
            }
            1 => pose.heading.0 = target.heading.0.wrapping_add(chance(1 << 24) as u32),
            // As the gyroscope corrects it: no count tells of it.
            2 => pose.y = Millimetres(pose.y.0 + I32F32::from_num(3)),
            3..8 => pose = target,
            8 if chance(20) == 0 => target.heading.0 = chance(1 << 32) as u32,
            9 if chance(20) == 0 => {
                controller.halt();
                looking.halt();
            }
            _ => {}
        }
        controller.set_target(target);
        looking.set_target(target);
        let held = controller.arrived();
        spared += u32::from(held && controller.seen == pose);
        looking.seen.heading = Turns(!pose.heading.0);
        let wheels = controller.drive(&pose, &delta);
        assert_eq!(wheels, looking.drive(&pose, &delta));
        assert_eq!(controller.arrived(), looking.arrived());
        left += u32::from(held && !controller.arrived());
    }
    assert!(spared > 10_000 && left > 500, "{spared} {left}");
}
