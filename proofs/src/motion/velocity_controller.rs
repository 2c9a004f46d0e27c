//! T16: limits of speed, yaw rate, acceleration and duty hold in velocity mode, and zero holds.

use fw_core::eeprom::{Config, ObstacleStop, VelocityLimits, Wheel};
use fw_core::motion::obstacle_limit::Track;
use fw_core::motion::velocity_controller::{VelocityRamp, towards};
use fw_core::motion::{ObstacleLimit, VelocityController};
use fw_core::types::{Milliseconds, MotorCommand, MotorCommands, Velocity};

use super::obstacle_limit::Event;
use crate::eeprom::accepted::AcceptedConfig;
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

fn duty_is_within_limit(command: MotorCommand, wheel: &Wheel) -> bool {
    match command {
        MotorCommand::Run(duty) => duty.hundredths().abs() <= wheel.limit.hundredths(),
        MotorCommand::Brake => true,
        MotorCommand::Coast => false,
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
    let cut = |velocity: Velocity| Velocity {
        forward: velocity.forward.clamp(-ramp.max_speed, ramp.max_speed),
        yaw_rate: velocity
            .yaw_rate
            .clamp(-ramp.max_yaw_rate, ramp.max_yaw_rate),
    };
    let within = |velocity| cut(velocity) == velocity;
    let before = cut(before);
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
    assert!(within(after) && within(followed.target) && !obstacle.limited(after.forward));
    let steps = (ramp.speed_step.unsigned_abs(), ramp.yaw_step.unsigned_abs());
    assert!(is_followed(before.forward, after.forward, steps.0));
    assert!(is_followed(before.yaw_rate, after.yaw_rate, steps.1));
    assert!(followed.free == obstacle.limit(followed.target.forward));
    assert!(followed.clipped || within(commanded) && after.yaw_rate == commanded.yaw_rate);
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
    Seen::NOTHING
        .case(0, followed.clipped)
        .case(1, !followed.clipped && after != before)
        .case(
            2,
            after.forward < before.forward && commanded.forward > before.forward,
        )
        .case(3, after.forward == 0 && before.forward != 0)
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

/// Braked for a zero command, the robot stays braked as long as zero is commanded, whatever rolls,
/// turns or echoes.
// Requirement: WIRE-velocity-6
pub fn zero_command_holds_the_brake(
    values: AcceptedConfig,
    track: Track,
    event: Event,
    ticks: u8,
) -> Seen {
    given!(let (true, config) = values.checked());
    given!(track.max_forward >= 0);
    let (mut controller, obstacle) = parts(&config);
    let mut obstacle = obstacle.with_track(track);
    for _ in 0..ticks % 9 {
        let delta = event.apply(&mut obstacle);
        let commands = controller.step(Velocity::default(), &obstacle, &delta);
        assert!(commands == MotorCommands::BRAKE && !controller.clipped());
        assert!(controller.applied() == Velocity::default() && !controller.held_back());
    }
    seen!(obstacle.max_forward() == 0, obstacle.max_forward() > 0)
}

/// For any commands, motions and echoes: speed and yaw rate within their limits and the obstacle stop's,
/// gained no faster than configured, duty within each wheel's limit; no overflow; not clipped only where
/// the command is followed.
// Requirement: WIRE-velocity-3, WIRE-eeprom-6, WIRE-obstacle-1
pub fn velocity_keeps_its_limits(
    values: AcceptedConfig,
    ticks: [(Velocity, (Event, ())); 8],
    count: u8,
    repeats: u8,
) -> Seen {
    given!(let (true, config) = values.checked());
    let limits = config.velocity_limits();
    let (mut controller, mut obstacle) = parts(&config);
    let mut seen = Seen::NOTHING;
    for (command, (event, ())) in ticks.into_iter().take(usize::from(count % 9)) {
        for _ in 0..=repeats {
            let before = controller.applied();
            let delta = event.apply(&mut obstacle);
            let commands = controller.step(command, &obstacle, &delta);
            let applied = controller.applied();
            assert!(applied.forward.unsigned_abs() <= u32::from(limits.speed_mm_s) * 1000);
            assert!(applied.yaw_rate.unsigned_abs() <= limits.yaw_rate);
            assert!(!obstacle.limited(applied.forward));
            let speed_step = u32::from(limits.acceleration_mm_s2) * 10;
            assert!(is_followed(before.forward, applied.forward, speed_step));
            assert!(is_followed(
                before.yaw_rate,
                applied.yaw_rate,
                limits.yaw_acceleration / 100
            ));
            assert!(duty_is_within_limit(commands.left, config.left()));
            assert!(duty_is_within_limit(commands.right, config.right()));
            let followed = Velocity {
                forward: obstacle.limit(command.forward),
                ..command
            };
            assert!(controller.clipped() || applied == followed);
            seen = seen
                .case(0, controller.clipped())
                .case(1, !controller.clipped() && applied != Velocity::default())
                .case(2, obstacle.limited(command.forward))
                .case(
                    3,
                    applied.forward.unsigned_abs() < before.forward.unsigned_abs(),
                );
        }
    }
    seen
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
    property T16 zero_command_holds_the_brake(
        values: AcceptedConfig, track: Track, event: Event, ticks: u8
    ) {
        cases ["at an obstacle", "free"];
        needs [accepted_configuration_is_bounded];
        kani first_board [unwind(80)] = (AcceptedConfig::FIRST_BOARD, any(), any(), 1);
        sampled 50_000;
    }
    property T16 velocity_keeps_its_limits(
        values: AcceptedConfig, ticks: [(Velocity, (Event, ())); 8], count: u8, repeats: u8
    ) {
        cases ["clipped", "followed", "limited by an obstacle", "slowed"];
        needs [accepted_configuration_is_bounded];
        sampled 20_000;
    }
    property T16 zero_command_ends_in_the_brake(
        values: AcceptedConfig, before: Velocity, event: Event
    ) {
        cases ["from a speed", "from a turn", "at rest"];
        needs [accepted_configuration_is_bounded];
        sampled 5_000;
    }
}
