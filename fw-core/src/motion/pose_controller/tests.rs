//! What the controller does in each phase, to its figures, one tick at a time. How well that drives is
//! seen in `motion::simulation`.

mod approach;
mod close;
mod holding;
mod last_turn;
mod sparing;
mod sticking;
mod targets;
mod tuning;

use super::*;
use crate::binary64::Binary64;
use crate::eeprom::{first_board, Gains};
use crate::motion::simulation::pose;
use crate::types::MotorCommand;

/// With P alone, and D for the rotation: percent per millimetre, per degree, per degree a tick.
fn gains(forward: f64, rotation: f64, damping: f64) -> Config {
    let gains = |p: f64, d: f64| Gains {
        p: Binary64(p.to_bits()),
        i: Binary64::default(),
        d: Binary64(d.to_bits()),
        anti_windup: Binary64::default(),
    };
    let mut config = first_board();
    config.forward = gains(forward, 0.0);
    config.rotation = gains(rotation, damping);
    // Then the motors are told the sum and the difference of the outputs.
    config.platform.dead_zone_left = 0;
    config.platform.dead_zone_right = 0;
    // 3 mm, and half a degree but for 0.0001°.
    assert_eq!(config.platform.position_tolerance, 3000);
    assert_eq!(config.platform.rotation_tolerance, 91);
    config
}

/// Half a degree of the configuration, in 2⁻³² turns.
const TOLERANCE: i32 = 91 << 16;

fn controller(forward: f64, rotation: f64) -> PoseController {
    PoseController::new(&gains(forward, rotation, 0.0))
}

/// Forward and rotation, percent, of which the motors were told; nothing if they were braked.
fn outputs(wheels: MotorCommands) -> Option<(f64, f64)> {
    let MotorCommands {
        left: MotorCommand::Run(left),
        right: MotorCommand::Run(right),
    } = wheels
    else {
        assert_eq!(wheels, MotorCommands::BRAKE);
        return None;
    };
    let (left, right) = (f64::from(left.hundredths()), f64::from(right.hundredths()));
    Some(((left + right) / 200.0, (right - left) / 200.0))
}

#[track_caller]
fn assert_outputs(wheels: MotorCommands, forward: f64, rotation: f64) {
    let (is_forward, is_rotation) = outputs(wheels).expect("it is driven");
    // A hundredth of a percent is what a duty is rounded to.
    assert!(
        (is_forward - forward).abs() < 0.011 && (is_rotation - rotation).abs() < 0.011,
        "{is_forward} {is_rotation} instead of {forward} {rotation}"
    );
}

/// No count: the robot rests.
const STILL: Delta = Delta {
    left: 0,
    right: 0,
    travel: I16F16::ZERO,
    turn: 0,
};

/// Millimetres ahead and degrees in a tick. The counts are on the spot, and not at rest.
fn rolling(travel: f64, turn: f64) -> Delta {
    Delta {
        left: -9,
        right: 9,
        travel: I16F16::from_num(travel),
        turn: turns(turn),
    }
}

/// Degrees as 2⁻³² turns.
fn turns(degrees: f64) -> i32 {
    (degrees / 360.0 * 4_294_967_296.0).round() as i32
}

/// What lies so far ahead of and to the left of a pose, and is turned by so many degrees from it.
fn seen_from((x, y, heading): (f64, f64, f64), (ahead, left, rotation): (f64, f64, f64)) -> Pose {
    let (s, c) = heading.to_radians().sin_cos();
    pose(
        x + ahead * c - left * s,
        y + ahead * s + left * c,
        heading + rotation,
    )
}

/// Places and headings to try a scene from: headings wrap, and nothing depends on where it is.
const STANDS: [(f64, f64, f64); 4] = [
    (0.0, 0.0, 0.0),
    (-300.0, 7000.0, 179.9),
    (12_000.0, -5.5, -90.0),
    (-40.0, -80.0, 293.0),
];

/// Set down at `from`, with the last bit of the way before it.
fn closing(config: &Config, target: Pose, from: Pose) -> PoseController {
    let mut controller = PoseController::new(config);
    controller.set_target(target);
    let _ = controller.drive(&from, &rolling(0.0, 0.0));
    assert!(matches!(controller.phase, Phase::Close { .. }));
    controller
}
