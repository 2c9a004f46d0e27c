//! T16: limits of speed, yaw rate, acceleration and duty hold in velocity mode, and zero holds.

use fw_core::eeprom::{Config, Wheel};
use fw_core::motion::{ObstacleLimit, VelocityController};
use fw_core::types::{MotorCommand, MotorCommands, Velocity};

use super::obstacle_limit::Event;
use crate::eeprom::accepted::AcceptedConfig;
use crate::property::Seen;

/// Controller and obstacle stop at rest.
fn parts(config: &Config) -> (VelocityController, ObstacleLimit) {
    (
        VelocityController::new(config),
        ObstacleLimit::new(config, true),
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
    let Some(config) = values.config() else {
        return Seen::NOTHING;
    };
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
    let Some(config) = values.config() else {
        return Seen::NOTHING;
    };
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
    Seen::NOTHING
        .case(0, moving && forward != 0)
        .case(1, moving && yaw_rate != 0)
        .case(2, !moving)
}

crate::properties! {
    property T16 velocity_keeps_its_limits(
        values: AcceptedConfig, ticks: [(Velocity, (Event, ())); 8], count: u8, repeats: u8
    ) {
        cases ["clipped", "followed", "limited by an obstacle", "slowed"];
        needs [accepted_configuration_is_bounded];
        kani first_board [unwind(80)] = (AcceptedConfig::FIRST_BOARD, any(), 1, 0);
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
