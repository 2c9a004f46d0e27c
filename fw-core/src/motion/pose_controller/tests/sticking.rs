//! The nudges of a robot that sticks. With gains of nothing they are all that the motors are told.

use super::*;

/// What a nudge is after so many ticks at rest: from the fourth on a quarter of a percent more each tick.
fn nudge(ticks: u32) -> f64 {
    f64::from(ticks.saturating_sub(3)) / 4.0
}

fn counts(left: i32, right: i32) -> Delta {
    Delta {
        left,
        right,
        ..STILL
    }
}

/// On the last bit of the way, the target so far ahead, the nose `off` by so much, 2⁻³² turns.
fn stuck(ahead: f64, off: i32) -> (PoseController, Pose) {
    let target = pose(1000.0, 0.0, 0.0);
    let controller = closing(&gains(0.0, 0.0, 0.0), target, pose(970.0, 0.0, 0.0));
    let mut here = pose(1000.0 - ahead, 0.0, 0.0);
    here.heading = Turns((off as u32).wrapping_neg());
    (controller, here)
}

#[test]
fn on_the_last_bit_a_robot_that_rests_is_pushed_towards_the_target_and_round() {
    for (ahead, off) in [(20.0, turns(5.0)), (20.0, turns(-5.0)), (-20.0, turns(5.0))] {
        let (mut controller, here) = stuck(ahead, off);
        for ticks in 1..=100 {
            // Rotation has the first say, and both together fit.
            let wheels = controller.drive(&here, &STILL);
            let push = nudge(ticks).min(15.0);
            assert_outputs(wheels, push.copysign(ahead), push.copysign(f64::from(off)));
        }
    }
}

#[test]
fn a_count_of_either_wheel_ends_both_pushes_and_they_begin_anew() {
    for moved in [
        counts(1, 0),
        counts(-1, 0),
        counts(0, 1),
        counts(0, -1),
        counts(5, -5),
    ] {
        let (mut controller, here) = stuck(20.0, turns(5.0));
        for _ in 0..20 {
            let _ = controller.drive(&here, &STILL);
        }
        assert_outputs(controller.drive(&here, &STILL), nudge(21), nudge(21));
        assert_outputs(controller.drive(&here, &moved), 0.0, 0.0);
        for ticks in 1..=10 {
            let wheels = controller.drive(&here, &STILL);
            assert_outputs(wheels, nudge(ticks), nudge(ticks));
        }
    }
}

#[test]
fn on_the_last_bit_it_is_not_pushed_ahead_while_the_nose_is_8_degrees_off_or_it_is_there() {
    for (ahead, off, round) in [
        (20.0, 8 * DEGREE, 1.0),
        (-20.0, 8 * DEGREE, 1.0),
        (-20.0, turns(-20.0), -1.0),
        (0.0, 0, 0.0),
    ] {
        let (mut controller, here) = stuck(ahead, off);
        // So it is not done: it would roll on.
        let slipping = Delta {
            travel: I16F16::ONE,
            ..STILL
        };
        for ticks in 1..=20 {
            let wheels = controller.drive(&here, &slipping);
            assert_outputs(wheels, 0.0, nudge(ticks) * round);
        }
    }
}

#[test]
fn round_it_is_pushed_while_more_than_half_of_the_rotations_tolerance_is_missing() {
    let half = TOLERANCE / 2;
    for (off, pushed) in [
        (0, false),
        (half - 1, false),
        (half, false),
        (half + 1, true),
    ] {
        for off in [off, -off] {
            let (mut controller, here) = stuck(20.0, off);
            for ticks in 1..=10 {
                let wheels = controller.drive(&here, &STILL);
                let round = if pushed { nudge(ticks) } else { 0.0 };
                assert_outputs(wheels, nudge(ticks), round.copysign(f64::from(off)));
            }
        }
    }
}

#[test]
fn on_the_way_and_on_the_last_turn_it_is_pushed_round_and_not_ahead() {
    for (target, off) in [
        (pose(1000.0, 0.0, 0.0), 5.0),
        (pose(1000.0, 0.0, 0.0), -5.0),
        (pose(0.0, 0.0, 0.0), 40.0),
        (pose(0.0, 0.0, 0.0), -40.0),
    ] {
        let mut controller = PoseController::new(&gains(0.0, 0.0, 0.0));
        controller.set_target(target);
        for ticks in 1..=100 {
            let wheels = controller.drive(&pose(0.0, 0.0, -off), &STILL);
            assert_outputs(wheels, 0.0, nudge(ticks).min(15.0).copysign(off));
        }
    }
}
