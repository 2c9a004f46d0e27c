//! T16: limits of speed, yaw rate, acceleration and duty hold in velocity mode, and zero holds.

use fw_core::eeprom::{Config, ObstacleStop, VelocityLimits, Wheel};
use fw_core::motion::obstacle_limit::Track;
use fw_core::motion::pose_controller::stiction::LowPass;
use fw_core::motion::velocity_controller::{VelocityRamp, VelocityState, towards};
use fw_core::motion::{ObstacleLimit, VelocityController};
use fw_core::types::{Delta, Milliseconds, MotorCommand, MotorCommands, Velocity};

use super::obstacle_limit::Event;
#[cfg(kani)]
use super::pose_controller::{any_commands_of_each, any_output};
use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};
use crate::property::Seen;

/// Controller and obstacle stop at rest.
fn parts(config: &Config) -> (VelocityController, ObstacleLimit) {
    (
        VelocityController::new(config),
        ObstacleLimit::new(config.obstacle_stop(), true),
    )
}

/// Whether a change is within `step`, or a slowing without a change of direction.
fn is_followed(before: i32, after: i32, step: u32) -> bool {
    let slower =
        after.unsigned_abs() <= before.unsigned_abs() && after.signum() * before.signum() >= 0;
    slower || after.abs_diff(before) <= step
}

/// The nearest velocity within its limits.
fn within(velocity: Velocity, ramp: &VelocityRamp) -> Velocity {
    Velocity {
        forward: velocity.forward.clamp(-ramp.max_speed, ramp.max_speed),
        yaw_rate: velocity
            .yaw_rate
            .clamp(-ramp.max_yaw_rate, ramp.max_yaw_rate),
    }
}

/// Inductive step, from any velocity within its limits, any command and any limits of the obstacle stop:
/// the next one is within them too, no further away than a tick's change but for the obstacle stop, and a
/// command that is not clipped is followed. So zero is reached after |v| / step ticks.
// Requirement: WIRE-velocity-3, WIRE-velocity-6, WIRE-obstacle-1
pub fn ramp_keeps_its_limits(
    ramp: VelocityRamp,
    max_forward: i32,
    max_reverse_mm_s: u16,
    before: Velocity,
    commanded: Velocity,
) -> Seen {
    let smallest = ramp.max_speed.min(ramp.max_yaw_rate);
    let smallest = smallest.min(ramp.speed_step).min(ramp.yaw_step);
    given!(smallest.min(max_forward) >= 0 && max_reverse_mm_s <= 2_000);
    let before = within(before, &ramp);
    // The ramp asks for nothing but the two limits.
    let figures = ObstacleStop {
        stop_distance_mm: 0,
        overhang_mm: 0,
        reaction_time: Milliseconds(0),
        deceleration_mm_s2: 0,
        blind_speed_mm_s: 0,
        reverse_speed_mm_s: max_reverse_mm_s,
        reverse_distance_mm: 0,
    };
    let obstacle = ObstacleLimit::new(&figures, false).with_track(Track {
        max_forward,
        ..Track::default()
    });
    let followed = ramp.step(before, commanded, &obstacle);
    let after = followed.velocity;
    assert!(within(after, &ramp) == after && within(followed.target, &ramp) == followed.target);
    assert!(!obstacle.limited(after.forward));
    let steps = (ramp.speed_step.unsigned_abs(), ramp.yaw_step.unsigned_abs());
    assert!(is_followed(before.forward, after.forward, steps.0));
    assert!(is_followed(before.yaw_rate, after.yaw_rate, steps.1));
    assert!(followed.free == obstacle.limit(followed.target.forward));
    assert!(followed.clipped || within(commanded, &ramp) == commanded);
    assert!(followed.clipped || after.yaw_rate == commanded.yaw_rate);
    assert!(followed.clipped || after.forward == obstacle.limit(commanded.forward));
    // As far as one tick leads, or nearer by it.
    let remaining = |from: i32, to: i32, step: u32| from.abs_diff(to).saturating_sub(step);
    let (forward, yaw_rate) = (followed.free, followed.target.yaw_rate);
    let (ahead, turn) = (
        after.forward.abs_diff(forward),
        after.yaw_rate.abs_diff(yaw_rate),
    );
    assert!(turn == remaining(before.yaw_rate, yaw_rate, steps.1));
    assert!(ahead <= remaining(before.forward, forward, steps.0));
    seen!(
        followed.clipped,
        !followed.clipped && after != before,
        after.forward < before.forward && commanded.forward > before.forward,
        after.forward == 0 && before.forward != 0
    )
}

/// The ramp's limits are the configured ones, a change per second is a hundred a tick.
// Requirement: WIRE-velocity-3
pub fn ramp_is_the_configured_one(speed: u16, yaw: u16) -> Seen {
    let limits = VelocityLimits {
        speed_mm_s: speed,
        yaw_rate: u32::from(yaw) << 16,
        acceleration_mm_s2: speed,
        yaw_acceleration: u32::from(yaw) << 16,
    };
    let ramp = VelocityRamp::new(&limits);
    assert!(ramp.max_speed.unsigned_abs() == u32::from(speed) * 1000);
    assert!(ramp.speed_step.unsigned_abs() == u32::from(speed) * 1000 / 100);
    // Half a turn a second less 2⁻³².
    let most = i32::MAX.unsigned_abs();
    assert!(ramp.max_yaw_rate.unsigned_abs() == limits.yaw_rate.min(most));
    assert!(ramp.yaw_step.unsigned_abs() == limits.yaw_acceleration / 100);
    Seen::NOTHING.case(0, yaw == 0x8000).case(1, speed == 2_000)
}

/// What does not fit into the duty slows: a velocity never grows by it nor changes its direction.
// Requirement: WIRE-velocity-5
pub fn slowing_never_speeds_up(from: i32, less: i32) -> Seen {
    given!(less >= 0);
    let after = towards(from, 0, less);
    assert!(after.unsigned_abs() == from.unsigned_abs().saturating_sub(less.unsigned_abs()));
    assert!(after == 0 || after.signum() == from.signum());
    seen!(after == 0 && from < 0, after > 0 && less > 0)
}

/// The nearest state that a tick can leave.
fn possible(mut state: VelocityState, limits: &VelocityLimits) -> VelocityState {
    let ramp = VelocityRamp::new(limits);
    state.applied = within(state.applied, &ramp);
    for [first, second] in &mut state.lags {
        // A tick's way of 20 mm, and of 32 mm by the rotation, fits.
        for lag in [first, second] {
            *lag = (*lag).clamp(-(1 << 22), 1 << 22);
        }
    }
    for deviation in &mut state.deviations {
        deviation.0 = deviation.0.clamp(-(1 << 28), 1 << 28);
    }
    state
}

/// Inductive step, from any state that a tick can leave, with any command, after any motion of the wheels and
/// with any limits of the obstacle stop: speed and yaw rate within their limits and the obstacle stop's, gained
/// no faster than configured; no overflow, such a state again, both motors braked or both within their limits;
/// not clipped only where the command is followed. At rest, a zero command holds the brake, whatever rolls, turns
/// or echoes.
// Requirement: WIRE-velocity-3, WIRE-velocity-6, WIRE-eeprom-6, WIRE-obstacle-1
pub fn velocity_keeps_its_limits(
    values: AcceptedConfig,
    state: Option<VelocityState>,
    (command, delta): (Option<Velocity>, Delta),
    track: Track,
) -> Seen {
    given!(let (true, config) = values.checked());
    given!(track.max_forward >= 0);
    let limits = config.velocity_limits();
    let (controller, obstacle) = parts(&config);
    let obstacle = obstacle.with_track(track);
    let rest = VelocityState::default();
    let before = possible(state.unwrap_or(rest), limits);
    // None is the command that is followed.
    let command = command.unwrap_or(before.applied);
    let mut controller = controller.with_state(before);
    let commands = controller.step(command, &obstacle, &delta);
    let (after, applied) = (controller.state(), controller.applied());
    let rests = before == rest && command == rest.applied;
    if rests {
        assert!(commands == MotorCommands::BRAKE && after == rest);
        assert!(!controller.clipped() && !controller.held_back());
    }
    let before = before.applied;
    assert!(possible(after, limits) == after && !obstacle.limited(applied.forward));
    let speed_step = u32::from(limits.acceleration_mm_s2) * 10;
    assert!(is_followed(before.forward, applied.forward, speed_step));
    let yaw_step = limits.yaw_acceleration / 100;
    assert!(is_followed(before.yaw_rate, applied.yaw_rate, yaw_step));
    let runs = |drive: MotorCommand, wheel: &Wheel| {
        // Under Kani the mixer's duties are any: `duty_keeps_its_wheels_limit` limits them.
        matches!(drive, MotorCommand::Run(duty)
            if cfg!(kani) || duty.hundredths().abs() <= wheel.limit.hundredths())
    };
    let both_run = runs(commands.left, config.left()) && runs(commands.right, config.right());
    assert!(commands == MotorCommands::BRAKE || both_run);
    let followed = Velocity {
        forward: obstacle.limit(command.forward),
        ..command
    };
    assert!(controller.clipped() || applied == followed);
    seen!(
        controller.clipped(),
        !controller.clipped() && applied != Velocity::default(),
        obstacle.limited(command.forward),
        applied.forward.unsigned_abs() < before.forward.unsigned_abs(),
        rests
    )
}

/// A zero command ends in the brake, whatever the wheels do: when both the speed and the yaw rate have been
/// followed to zero and the response has ended, and from then on in every tick.
// Requirement: WIRE-velocity-6
pub fn zero_command_ends_in_the_brake(
    values: AcceptedConfig,
    before: Velocity,
    event: Event,
) -> Seen {
    given!(let Some(config) = values.config());
    let limits = config.velocity_limits();
    let (mut controller, mut obstacle) = parts(&config);
    let mut moving = false;
    for _ in 0..100 {
        let delta = event.apply(&mut obstacle);
        moving |= controller.step(before, &obstacle, &delta) != MotorCommands::BRAKE;
    }
    let Velocity { forward, yaw_rate } = controller.applied();
    let speed_ticks = forward.unsigned_abs() / (u32::from(limits.acceleration_mm_s2) * 10);
    let yaw_ticks = yaw_rate.unsigned_abs() / (limits.yaw_acceleration / 100);
    // 7.4 of the lags' time constants leave less than 10 mm/s of 5 m/s.
    let ticks = speed_ticks.max(yaw_ticks) + 120;
    let mut rests = false;
    for tick in 0..ticks + 20 {
        let delta = event.apply(&mut obstacle);
        let braked =
            controller.step(Velocity::default(), &obstacle, &delta) == MotorCommands::BRAKE;
        assert!(braked || tick < ticks && !rests);
        rests = braked;
    }
    assert!(!controller.clipped() && controller.applied() == Velocity::default());
    seen!(moving && forward != 0, moving && yaw_rate != 0, !moving)
}

impl Input for VelocityState {
    fn draw(source: &mut impl Source) -> Self {
        let lags: [(i32, i32); 2] = Input::draw(source);
        let others: [(LowPass, bool); 2] = Input::draw(source);
        Self {
            applied: Input::draw(source),
            lags: lags.map(Into::into),
            deviations: others.map(|(deviation, _)| deviation),
            backward: others.map(|(_, backward)| backward),
        }
    }
}

crate::properties! {
    theorem T16 ramp_keeps_its_limits(
        ramp: VelocityRamp, max_forward: i32, max_reverse_mm_s: u16, before: Velocity, commanded: Velocity
    ) {
        cases ["clipped", "followed", "slowed by the obstacle stop", "to a stand"];
        needs [accepted_configuration_is_bounded];
        kani proof [unwind(2)];
        sampled 500_000;
    }
    theorem T16 ramp_is_the_configured_one(speed: u16, yaw: u16) {
        cases ["the largest yaw rate", "the largest speed"];
        kani proof [unwind(2)];
        exhaustive (0..=u16::MAX).map(|value| (value, value.rotate_left(3)));
    }
    theorem T16 slowing_never_speeds_up(from: i32, less: i32) {
        cases ["to a stand", "slower"];
        kani proof [unwind(2)];
        sampled 100_000;
    }
    property T16 velocity_keeps_its_limits(
        values: AcceptedConfig, state: Option<VelocityState>, tick: (Option<Velocity>, Delta), track: Track
    ) {
        cases ["clipped", "followed", "limited by an obstacle", "slowed", "at rest"];
        needs [
            accepted_configuration_is_bounded, step_stays_within_the_limit, duty_keeps_its_wheels_limit,
        ];
        kani first_board [
            unwind(80), solver(minisat), stub(fw_core::motion::pid::Pid::step, any_output),
            stub(fw_core::motion::mixer::Mixer::each, any_commands_of_each)
        ] = (AcceptedConfig::FIRST_BOARD, Some(any()), any(), any());
        sampled 500_000;
    }
    property T16 zero_command_ends_in_the_brake(
        values: AcceptedConfig, before: Velocity, event: Event
    ) {
        cases ["from a speed", "from a turn", "at rest"];
        needs [accepted_configuration_is_bounded];
        sampled 5_000;
    }
}
