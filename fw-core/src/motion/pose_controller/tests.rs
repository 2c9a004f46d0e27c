//! Each phase of the controller one tick at a time, to the last digit of its constants. Closed loops on
//! the robot's model are in `motion::tests`.

mod approach;
mod final_phases;
mod hold;
mod stiction;

use super::*;
use crate::eeprom::{Field, config_with, fields, first_board};
use crate::motion::tests::{duty, pose};
use crate::types::MotorCommand;

/// Whether it is on its final approach.
fn nears(controller: &PoseController) -> bool {
    matches!(controller.state.phase, Phase::FinalApproach { .. })
}

/// The first board with P alone, and D for the rotation: percent per millimetre, per degree, per degree a
/// tick. Without dead zones the commands are sum and difference of the outputs.
fn gains(forward: f64, rotation: f64, damping: f64) -> Config {
    gains_with(forward, rotation, damping, &[])
}

fn gains_with(forward: f64, rotation: f64, damping: f64, changes: &[(&Field, u64)]) -> Config {
    let gains = [
        (fields::FORWARD_P, forward.to_bits()),
        (fields::FORWARD_I, 0),
        (fields::FORWARD_D, 0),
        (fields::FORWARD_ANTI_WINDUP, 0),
        (fields::ROTATION_P, rotation.to_bits()),
        (fields::ROTATION_I, 0),
        (fields::ROTATION_D, damping.to_bits()),
        (fields::ROTATION_ANTI_WINDUP, 0),
        (fields::DEAD_ZONE_LEFT, 0),
        (fields::DEAD_ZONE_RIGHT, 0),
        // 3 mm, and half a degree less 0.0001°.
        (fields::POSITION_TOLERANCE, 3000),
        (fields::ROTATION_TOLERANCE, 91),
    ];
    config_with(&[&gains, changes].concat())
}

/// The configured heading tolerance, 2⁻³² turns.
const HEADING_TOLERANCE: i32 = 91 << 16;

fn controller(forward: f64, rotation: f64) -> PoseController {
    PoseController::new(&gains(forward, rotation, 0.0))
}

/// Forward and rotation output, percent; `None` if braked.
fn outputs(commands: MotorCommands) -> Option<(f64, f64)> {
    if commands == MotorCommands::BRAKE {
        return None;
    }
    let [left, right] = [commands.left, commands.right].map(|command| f64::from(duty(command)));
    Some(((left + right) / 200.0, (right - left) / 200.0))
}

/// A duty is rounded to a hundredth of a percent.
const ROUNDING: f64 = 0.011;

#[track_caller]
fn assert_outputs(commands: MotorCommands, forward: f64, rotation: f64) {
    let (f, r) = outputs(commands).expect("it is driven");
    let off = (f - forward).abs().max((r - rotation).abs());
    assert!(off < ROUNDING, "{f} {r} instead of {forward} {rotation}");
}

/// No count: at rest.
const STILL: Delta = Delta::rolled(0, 0);

/// Not at rest, with a travel in millimetres and a turn in degrees.
fn rolling(travel: f64, turn: f64) -> Delta {
    let (travel, turn) = (I16F16::from_num(travel), turns(turn));
    Delta {
        travel,
        turn,
        ..Delta::rolled(-9, 9)
    }
}

/// Degrees as 2⁻³² turns.
fn turns(degrees: f64) -> i32 {
    (degrees / 360.0 * 4_294_967_296.0).round() as i32
}

/// x, y, heading: millimetres and degrees.
type Stand = (f64, f64, f64);

/// The pose ahead of, to the left of and turned from a stand.
fn seen_from((x, y, heading): Stand, (ahead, left, rotation): Stand) -> Pose {
    let (s, c) = heading.to_radians().sin_cos();
    pose(
        x + ahead * c - left * s,
        y + ahead * s + left * c,
        heading + rotation,
    )
}

/// Results are independent of the place and of the heading's wrap.
const STANDS: [Stand; 3] = [(0.0, 0.0, 0.0), (-3e2, 7e3, 179.9), (12e3, -5.5, -90.0)];

/// The pose of a stand itself.
fn on(stand: Stand) -> Pose {
    seen_from(stand, (0.0, 0.0, 0.0))
}

/// A controller that has just got its target.
fn aimed(config: &Config, target: Pose) -> PoseController {
    let mut controller = PoseController::new(config);
    controller.set_target(target);
    controller
}

/// So many ticks alike.
fn drive(controller: &mut PoseController, here: &Pose, delta: &Delta, ticks: u32) {
    for _ in 0..ticks {
        let _ = controller.drive(here, delta);
    }
}

#[test]
fn controller_without_target_brakes() {
    let mut controller = controller(1.0, 1.0);
    for here in [pose(0.0, 0.0, 0.0), pose(500.0, 20.0, 90.0)] {
        let commands = controller.drive(&here, &rolling(1.0, 1.0));
        assert_eq!(commands, MotorCommands::BRAKE);
        assert!(!controller.arrived() && !controller.moving());
    }
    controller.set_target(pose(0.0, 0.0, 0.0));
    assert!(controller.moving() && !controller.arrived());
    controller.halt();
    let commands = controller.drive(&pose(500.0, 0.0, 0.0), &STILL);
    assert_eq!(commands, MotorCommands::BRAKE);
    assert!(!controller.arrived() && !controller.moving());
}

#[test]
fn target_repeated_has_no_effect_and_changed_restarts() {
    let (target, other) = (pose(100.0, 50.0, -45.0), pose(100.0, 50.0, -45.1));
    for (new, arrival) in [(target, 5), (other, 8)] {
        let mut controller = aimed(&gains(1.0, 1.0, 0.0), target);
        for tick in 1..=8 {
            let _ = controller.drive(&target, &STILL);
            assert_eq!(controller.arrived(), tick >= arrival, "{tick}");
            if tick == 3 {
                controller.set_target(new);
            }
        }
        controller.set_target(new);
        assert!(controller.arrived());
        controller.halt();
        controller.set_target(new);
        assert!(controller.moving());
    }
}

/// P and I.
fn integrating() -> Config {
    let half = 0.5_f64.to_bits();
    let integral = [(fields::FORWARD_I, half), (fields::ROTATION_I, half)];
    gains_with(0.1, 0.1, 0.0, &integral)
}

#[test]
fn halt_clears_the_integrals() {
    let config = integrating();
    let (target, here) = (pose(30.0, 3.0, 10.0), pose(0.0, 0.0, 0.0));
    let mut fresh = aimed(&config, target);
    let mut controller = fresh.clone();
    let first = fresh.drive(&here, &rolling(0.0, 0.0));
    drive(&mut controller, &here, &rolling(0.0, 0.0), 20);
    assert_ne!(controller.drive(&here, &rolling(0.0, 0.0)), first);
    controller.halt();
    controller.set_target(target);
    assert_eq!(controller.drive(&here, &rolling(0.0, 0.0)), first);
}

#[test]
fn halted_wheels_are_not_identified() {
    let mut controller = controller(1.0, 1.0);
    for _ in 0..500 {
        controller.set_target(pose(1000.0, 0.0, 0.0));
        let _ = controller.drive(&Pose::default(), &Delta::rolled(40, 20));
        controller.halt();
    }
    assert_eq!(controller.mixer.gain_balance(), (I16F16::ONE, I16F16::ONE));
}

/// What is allowed with an echo at this distance from the sensor, mm.
fn limited(controller: &mut PoseController, distance: f64) {
    let mut obstacle = ObstacleLimit::new(first_board().obstacle_stop(), false);
    let distance = crate::types::Millimetres(fixed::types::I32F32::from_num(distance));
    obstacle.on_range(0, Some(distance));
    obstacle.step(&STILL);
    controller.limit_speed(&obstacle);
}

#[test]
fn turning_while_idle_counts_for_the_damping() {
    let fresh = PoseController::new(&gains(0.0, 1.0, 10.0));
    let mut idled = fresh.clone();
    let turning = rolling(0.0, 0.5);
    drive(&mut idled, &Pose::default(), &turning, 200);
    let [idled, fresh] = [idled, fresh].map(|mut controller| {
        controller.set_target(pose(0.0, 0.0, 20.0));
        let commands = controller.drive(&Pose::default(), &turning);
        outputs(commands).expect("driven").1
    });
    assert!(fresh - idled > 1.0, "{fresh} {idled}");
}

// Requirement: WIRE-obstacle-5
#[test]
fn held_back_ends_with_the_obstacle_and_is_not_boosted() {
    let mut controller = aimed(&gains(1.0, 1.0, 0.0), pose(30.0, 0.0, 0.0));
    limited(&mut controller, 172.0);
    let first = controller.drive(&Pose::default(), &STILL);
    for _ in 0..30 {
        assert!(nears(&controller));
        assert_eq!(controller.drive(&Pose::default(), &STILL), first);
        assert!(controller.held_back());
    }
    let mut halted = controller.clone();
    halted.halt();
    assert!(!halted.held_back());
    limited(&mut controller, 2500.0);
    let _ = controller.drive(&Pose::default(), &STILL);
    assert!(!controller.held_back());
}

// Requirement: WIRE-obstacle-4
#[test]
fn way_back_has_the_limit_of_its_own() {
    for (ahead, target, held_back) in [
        (172.0, -10.0, false),
        (172.0, -500.0, true),
        (2500.0, -500.0, true),
    ] {
        let mut controller = aimed(&gains(1.0, 1.0, 0.0), pose(target, 0.0, 0.0));
        limited(&mut controller, ahead);
        let commands = controller.drive(&Pose::default(), &STILL);
        assert_eq!(controller.held_back(), held_back, "{ahead} {target}");
        assert!(duty(commands.left) < -500, "{commands:?}");
    }
}

// Requirement: DOC-5.2.2-1
#[test]
fn tune_rotate_sets_opposite_duties_and_discards_the_target() {
    let mut controller = aimed(&gains(1.0, 1.0, 0.0), pose(1000.0, 0.0, 0.0));
    let mut braked = controller.clone();
    let _ = braked.tune_rotate(Duty::ZERO);
    assert!(!braked.moving());
    for duty in [1, -1, 3000, -10_000, 10_000] {
        let [duty, opposite] = [duty, -duty].map(Duty::saturating);
        let commands = controller.tune_rotate(duty);
        assert_eq!(commands.left, MotorCommand::Run(opposite));
        assert_eq!(commands.right, MotorCommand::Run(duty));
    }
    let commands = controller.tune_rotate(Duty::ZERO);
    assert_eq!(commands, MotorCommands::BRAKE);
    assert!(!controller.moving());
    let commands = controller.drive(&Pose::default(), &STILL);
    assert_eq!(commands, MotorCommands::BRAKE);
}

// Requirement: DOC-5.2.3-1
#[test]
fn tune_move_holds_the_first_heading_until_zero() {
    let mut controller = aimed(&gains(1.0, 1.0, 0.0), pose(1000.0, 0.0, 0.0));
    let mut tune = |duty, degrees| {
        let here = pose(3.0, 4.0, degrees);
        controller.tune_move(Duty::saturating(duty), &here, &STILL)
    };
    assert_outputs(tune(4000, 179.0), 40.0, 0.0);
    // Across the heading's wrap, and in reverse.
    assert_outputs(tune(4000, -179.5), 40.0, -1.5);
    assert_outputs(tune(4000, 177.5), 40.0, 1.5);
    assert_outputs(tune(-4000, 177.5), -40.0, 1.5);
    assert_eq!(tune(0, 177.5), MotorCommands::BRAKE);
    assert_outputs(tune(4000, 177.5), 40.0, 0.0);
    assert!(!controller.moving());
    let _ = controller.drive(&pose(0.0, 0.0, 0.0), &STILL);
    let here = pose(0.0, 0.0, 90.0);
    let commands = controller.tune_move(Duty::saturating(4000), &here, &STILL);
    assert_outputs(commands, 40.0, 0.0);
}

#[test]
fn tune_move_begins_without_an_integral() {
    let mut controller = PoseController::new(&integrating());
    let mut tune = |duty, degrees| {
        controller.tune_move(Duty::saturating(duty), &pose(0.0, 0.0, degrees), &STILL)
    };
    let _ = tune(4000, 0.0);
    for _ in 0..50 {
        let _ = tune(4000, 10.0);
    }
    let _ = tune(0, 10.0);
    assert_outputs(tune(4000, 10.0), 40.0, 0.0);
}

/// 1 % per degree a tick, behind a filter of four ticks.
#[test]
fn derivative_opposes_the_filtered_turn_rate() {
    let mut tuning = PoseController::new(&gains(0.0, 0.0, 1.0));
    let mut approach = aimed(&gains(0.0, 0.0, 1.0), pose(0.0, 1000.0, 90.0));
    let here = Pose::default();
    let mut filtered = 0.0;
    for _ in 0..40 {
        filtered += (2.0 - filtered) / 4.0;
        let commands = tuning.tune_move(Duty::saturating(3000), &here, &rolling(0.0, 2.0));
        assert_outputs(commands, 30.0, -filtered);
        let commands = approach.drive(&here, &rolling(0.0, 2.0));
        assert_outputs(commands, 0.0, -filtered);
    }
}
