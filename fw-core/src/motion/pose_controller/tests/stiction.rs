//! Stiction boost: with zero gains it is the whole output.

use super::*;
use crate::motion::pose_controller::stiction::StictionBoost;

/// The boost after so many ticks at rest: from the fourth on a quarter of a percent more each tick.
fn boost(ticks: u32) -> f64 {
    (f64::from(ticks.saturating_sub(3)) / 4.0).min(15.0)
}

/// In the final approach, the target so far ahead, mm, with a heading error, 2⁻³² turns.
fn stuck(ahead: f64, heading_error: i32) -> (PoseController, Pose) {
    let mut controller = aimed(&gains(0.0, 0.0, 0.0), pose(1000.0, 0.0, 0.0));
    let _ = controller.drive(&pose(970.0, 0.0, 0.0), &rolling(0.0, 0.0));
    assert!(nears(&controller));
    let mut here = pose(1000.0 - ahead, 0.0, 0.0);
    here.heading = Turns((heading_error as u32).wrapping_neg());
    (controller, here)
}

#[test]
fn boost_in_the_final_approach_pushes_both_axes() {
    for (ahead, error) in [(20.0, 5.0), (20.0, -5.0), (-20.0, 5.0)] {
        let (mut controller, here) = stuck(ahead, turns(error));
        for ticks in 1..=100 {
            let commands = controller.drive(&here, &STILL);
            let boost = boost(ticks);
            assert_outputs(commands, boost.copysign(ahead), boost.copysign(error));
        }
    }
}

#[test]
fn boost_restarts_after_a_count_of_either_wheel() {
    for (left, right) in [(1, 0), (-1, 0), (0, 1), (0, -1), (5, -5)] {
        let (mut controller, here) = stuck(20.0, turns(5.0));
        drive(&mut controller, &here, &STILL, 20);
        assert_outputs(controller.drive(&here, &STILL), boost(21), boost(21));
        let commands = controller.drive(&here, &Delta::rolled(left, right));
        assert_outputs(commands, 0.0, 0.0);
        for ticks in 1..=10 {
            let commands = controller.drive(&here, &STILL);
            assert_outputs(commands, boost(ticks), boost(ticks));
        }
    }
}

#[test]
fn boost_forward_needs_an_open_gate_and_a_distance() {
    let back = turns(-20.0);
    let gate = 8 * DEGREE;
    for (ahead, error) in [(20.0, gate), (-20.0, gate), (-20.0, back), (0.0, 0)] {
        let side = f64::from(error.signum());
        let (mut controller, here) = stuck(ahead, error);
        // A travel without counts keeps the phase.
        let mut slipping = STILL;
        slipping.travel = I16F16::ONE;
        for ticks in 1..=20 {
            let commands = controller.drive(&here, &slipping);
            assert_outputs(commands, 0.0, boost(ticks) * side);
        }
    }
}

#[test]
fn boost_of_the_rotation_needs_half_the_heading_tolerance() {
    let (half, wide) = (HEADING_TOLERANCE / 2, HEADING_TOLERANCE / 4 * 3);
    for (widened, error, enabled) in [
        (false, 0, 0.0),
        (false, half, 0.0),
        (false, half + 1, 1.0),
        (true, wide, 0.0),
        (true, wide + 1, 1.0),
    ] {
        for (error, enabled) in [(error, enabled), (-error, -enabled)] {
            let (mut controller, here) = stuck(20.0, error);
            controller.state.widened = widened;
            for ticks in 1..=10 {
                let commands = controller.drive(&here, &STILL);
                assert_outputs(commands, boost(ticks), boost(ticks) * enabled);
            }
        }
    }
}

#[test]
fn boost_in_approach_and_final_rotation_only_rotates() {
    for (x, error) in [(1000.0, 5.0), (1000.0, -5.0), (0.0, 40.0), (0.0, -40.0)] {
        let mut controller = aimed(&gains(0.0, 0.0, 0.0), pose(x, 0.0, 0.0));
        for ticks in 1..=100 {
            let commands = controller.drive(&pose(0.0, 0.0, -error), &STILL);
            assert_outputs(commands, 0.0, boost(ticks).copysign(error));
        }
    }
}

#[test]
fn boost_begins_anew_after_it_was_disabled() {
    let (mut boost, mut output) = (StictionBoost::default(), I16F16::ZERO);
    for _ in 0..20 {
        output = boost.step(I16F16::ONE, true, false);
    }
    assert!(output > 4);
    let next = [false, true].map(|enabled| boost.step(I16F16::ONE, enabled, false));
    assert_eq!(next, [I16F16::ZERO; 2]);
}
