//! Hold: the disturbances that restart the motion.

use super::*;
use crate::types::Millimetres;
use fixed::types::I32F32;

const TARGET: Stand = (500.0, -200.0, 170.0);

/// Holding at the target, with widened tolerances or not.
fn holding(widened: bool) -> (PoseController, Pose) {
    let target = on(TARGET);
    let mut controller = aimed(&gains(1.0, 1.0, 0.0), target);
    controller.state.widened = widened;
    drive(&mut controller, &target, &STILL, 5);
    assert!(controller.arrived());
    (controller, target)
}

#[test]
fn hold_restarts_beyond_its_limits() {
    // 1⅝ position tolerances.
    for (widened, limit) in [(false, 4.875), (true, 7.3125)] {
        for bearing in [0.0, 37.0, 90.0, 180.0, -90.0] {
            let (s, c) = f64::to_radians(bearing).sin_cos();
            for (pushed, restarts) in [(limit - 0.03, false), (limit + 0.03, true)] {
                let (mut controller, _) = holding(widened);
                let here = seen_from(TARGET, (pushed * c, pushed * s, 0.0));
                let _ = controller.drive(&here, &STILL);
                assert_eq!(!controller.arrived(), restarts, "{bearing} {pushed}");
                assert_eq!(controller.moving(), restarts);
            }
        }
    }
    // 1⅗ heading tolerances, to the last unit.
    let wide = HEADING_TOLERANCE / 2 * 3;
    for (widened, tolerance) in [(false, HEADING_TOLERANCE), (true, wide)] {
        let limit = tolerance / 5 * 8;
        for (turned, restarts) in [(limit, false), (limit + 1, true)] {
            for turned in [turned, -turned] {
                let (mut controller, mut here) = holding(widened);
                here.heading = Turns(here.heading.0.wrapping_add_signed(turned));
                let _ = controller.drive(&here, &STILL);
                assert_eq!(!controller.arrived(), restarts, "{turned}");
            }
        }
    }
}

#[test]
fn hold_brakes_within_its_limits_and_restart_resets_them() {
    let (mut controller, target) = holding(true);
    let aside = seen_from(TARGET, (3.5, 0.0, 0.0));
    for _ in 0..10 {
        assert_eq!(controller.drive(&aside, &STILL), MotorCommands::BRAKE);
        assert!(controller.arrived());
    }
    let _ = controller.drive(&seen_from(TARGET, (30.0, 0.0, 0.0)), &STILL);
    assert!(!controller.arrived() && controller.moving());
    let _ = controller.drive(&target, &rolling(0.0, 0.0));
    for _ in 0..6 {
        let _ = controller.drive(&aside, &STILL);
        assert!(!controller.arrived(), "3.5 mm are more than 3");
    }
}

#[test]
fn final_rotation_and_hold_begin_without_an_integral() {
    let config = integrating();
    let target = on(TARGET);
    let mut fresh = aimed(&config, target);
    let mut held = fresh.clone();
    let aside = seen_from(TARGET, (-5.0, 0.0, 20.0));
    let first = fresh.drive(&aside, &rolling(0.0, 0.0));
    drive(&mut held, &aside, &rolling(0.0, 0.0), 20);
    drive(&mut held, &target, &STILL, 5);
    assert!(held.arrived());
    assert_eq!(held.drive(&aside, &rolling(0.0, 0.0)), first);
    // In the final approach the bearing is the heading: only the forward PID integrates.
    let mut approaching = aimed(&config, target);
    let before = seen_from(TARGET, (-30.0, 0.0, 0.0));
    drive(&mut approaching, &before, &rolling(0.0, 0.0), 20);
    let _ = approaching.drive(&target, &rolling(0.0, 0.0));
    assert_eq!(approaching.state.phase, Phase::FinalRotation);
    let commands = approaching.drive(&aside, &rolling(0.0, 0.0));
    let (forward, expected) = (outputs(commands).unwrap().0, outputs(first).unwrap().0);
    assert!((forward - expected).abs() < ROUNDING, "{forward}");
}

/// Beside a controller that evaluates its target every tick.
#[test]
fn hold_skips_the_evaluation_without_effect() {
    let mut random = fastrand::Rng::with_seed(1);
    let mut controller = PoseController::new(&first_board());
    let mut reference = controller.clone();
    let (mut target, mut pose) = (Pose::default(), Pose::default());
    let (mut skipped, mut left) = (0, 0);
    for _ in 0..200_000 {
        let mut delta = Delta::default();
        match random.u32(..80) {
            // To either side of both tolerances, 3 mm and 0.5°.
            0 => {
                let mut offset = || I32F32::from_bits(random.i64(-(4 << 32)..4 << 32));
                pose.x = Millimetres(target.x.0 + offset());
                pose.y = Millimetres(target.y.0 + offset());
                delta.left = 50;
            }
            1 => pose.heading.0 = target.heading.0.wrapping_add(random.u32(..1 << 24)),
            // A correction by the gyroscope: without counts.
            2 => pose.y = Millimetres(pose.y.0 + I32F32::from_num(3)),
            3..8 => pose = target,
            8 if random.u8(..20) == 0 => target.heading.0 = random.u32(..),
            9 if random.u8(..20) == 0 => {
                controller.halt();
                reference.halt();
            }
            _ => {}
        }
        controller.set_target(target);
        reference.set_target(target);
        let held = controller.arrived();
        skipped += u32::from(held && controller.last_pose == pose);
        reference.last_pose.heading = Turns(!pose.heading.0);
        let commands = controller.drive(&pose, &delta);
        assert_eq!(commands, reference.drive(&pose, &delta));
        assert_eq!(controller.arrived(), reference.arrived());
        left += u32::from(held && !controller.arrived());
    }
    assert!(skipped > 10_000 && left > 300, "{skipped} {left}");
}
