//! T5: the pose controller in any state, at any pose.

#[cfg(kani)]
use fixed::types::I16F16;
#[cfg(kani)]
use fw_core::eeprom::Field;
use fw_core::motion::obstacle_limit::Track;
use fw_core::motion::pose_controller::state::{Phase, PoseState};
use fw_core::motion::{ObstacleLimit, PoseController};
#[cfg(kani)]
use fw_core::motion::{mixer::Mixer, pid::Pid};
use fw_core::types::{Delta, MotorCommand, MotorCommands, Pose};
#[cfg(kani)]
use fw_core::types::{Duty, Turns};

use crate::eeprom::accepted::AcceptedConfig;
use crate::property::Seen;

/// The nearest state that a tick can leave.
fn possible(mut state: PoseState) -> PoseState {
    for rate in [&mut state.speed.0, &mut state.turn_rate.0] {
        *rate = (*rate).clamp(-(1 << 28), 1 << 28);
    }
    let planned = &mut state.planned_turn.0;
    *planned = (*planned).clamp(-(2 << 16), 2 << 16);
    for boost in [&mut state.forward_boost, &mut state.rotation_boost] {
        boost.rest_ticks = boost.rest_ticks.min(3);
        boost.boost = boost.boost.clamp(0, 15 << 16);
    }
    let is_over = matches!(state.phase, Phase::Idle | Phase::Hold);
    state.settled_ticks = state.settled_ticks.min(if is_over { 5 } else { 4 });
    state
}

/// Inductive step, from any state that a tick can leave, to any target, at any pose, after any motion of the
/// wheels and with any limits of the obstacle stop: no overflow, no division by zero, such a state again, and
/// the motors either both brake or both run.
pub fn any_state_is_safe(
    values: AcceptedConfig,
    (state, target): (PoseState, Pose),
    (pose, delta): (Pose, Delta),
    track: Option<Track>,
) -> Seen {
    given!(let (true, config) = values.checked());
    let mut controller = PoseController::new(&config).with_state(possible(state), target);
    if let Some(track) = track {
        let obstacle = ObstacleLimit::new(config.obstacle_stop(), false).with_track(track);
        controller.limit_speed(&obstacle);
    }
    let commands = controller.drive(&pose, &delta);
    assert!(possible(*controller.state()) == *controller.state());
    let brakes = commands == MotorCommands::BRAKE;
    let runs = |drive: MotorCommand| matches!(drive, MotorCommand::Run(_));
    assert!(brakes || runs(commands.left) && runs(commands.right));
    seen!(
        brakes,
        !brakes && pose.x.0 < -1_000,
        !brakes && delta.left == i32::MIN,
        controller.held_back()
    )
}

/// Whether what is not replaced here reads a field: dead zones and limits, tolerances, the obstacle stop. Gains and
/// full speeds end in a quotient, of which any is tried.
#[cfg(kani)]
fn is_read(field: &Field) -> bool {
    matches!(field.address, 0x031C..=0x0323 | 0x032C..=0x032F | 0x0334..=0x0341)
}

/// Any output: by `step_stays_within_the_limit` the PID's is within its limit, 100 % at most.
#[cfg(kani)]
pub(super) fn any_output(_: &mut Pid, _error: I16F16, _rate: I16F16) -> I16F16 {
    let percent: i32 = crate::input::any();
    I16F16::from_bits(percent.clamp(-(100 << 16), 100 << 16))
}

/// Any commands that drive: by `duty_keeps_its_wheels_limit` the mixer's do.
#[cfg(kani)]
fn any_commands(_: &mut Mixer, _forward: I16F16, _rotation: I16F16) -> MotorCommands {
    let (left, right) = crate::input::any();
    let [left, right] = [left, right].map(|duty| MotorCommand::Run(Duty::saturating(duty)));
    MotorCommands { left, right }
}

/// Likewise for each wheel's own output.
#[cfg(kani)]
pub(super) fn any_commands_of_each(mixer: &mut Mixer, _left: i32, _right: i32) -> MotorCommands {
    any_commands(mixer, I16F16::ZERO, I16F16::ZERO)
}

/// Any quotient up to the dividend: by `digit_of_a_division_is_exact` the division's is one.
#[cfg(kani)]
fn any_quotient(n: u64, d: u64) -> (u64, u64) {
    let (quotient, rest): (u64, u64) = crate::input::any();
    (if d == 0 { u64::MAX } else { quotient.min(n) }, rest)
}

/// Any values: by `sine_and_cosine_are_accurate` there are some, within ±1.
#[cfg(kani)]
fn any_sine(_: Turns) -> (i32, i32) {
    crate::input::any()
}

/// Any direction: by `direction_lies_in_the_quadrant` there is one.
#[cfg(kani)]
fn any_direction(_: i64, _: i64) -> Turns {
    crate::input::any()
}

crate::properties! {
    theorem T5 any_state_is_safe(
        values: AcceptedConfig, of: (PoseState, Pose), at: (Pose, Delta), track: Option<Track>
    ) {
        cases ["at the target", "far behind", "impossible counts", "before an obstacle"];
        needs [
            accepted_configuration_is_bounded, step_stays_within_the_limit, sine_and_cosine_are_accurate,
            direction_lies_in_the_quadrant, digit_of_a_division_is_exact,
        ];
        kani any_platform [
            unwind(80), solver(minisat), stub(fw_core::motion::pid::Pid::step, any_output),
            stub(fw_core::motion::mixer::Mixer::mix, any_commands),
            stub(fw_core::divide::div_rem, any_quotient),
            stub(fw_core::motion::trig::sin_cos, any_sine), stub(fw_core::motion::trig::direction, any_direction)
        ] = (AcceptedConfig::of_any(is_read), any(), any(), any());
        sampled 500_000;
    }
}
