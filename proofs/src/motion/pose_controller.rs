//! T5: the pose controller for any pose and target.

use fixed::types::{I16F16, I32F32};
use fw_core::motion::PoseController;

use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};
use crate::property::Seen;
use fw_core::types::{Delta, Millimetres, MotorCommand, MotorCommands, Pose, Turns};

/// Inputs of a tick, consistent or not.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tick {
    pose: Pose,
    delta: Delta,
}

impl Input for Pose {
    fn draw(source: &mut impl Source) -> Self {
        let mut length = || Millimetres(I32F32::from_bits(Input::draw(source)));
        Self {
            x: length(),
            y: length(),
            heading: Turns::draw(source),
        }
    }
}

impl Input for Tick {
    fn draw(source: &mut impl Source) -> Self {
        Self {
            pose: Input::draw(source),
            delta: Delta {
                left: Input::draw(source),
                right: i16::draw(source).into(),
                travel: I16F16::from_bits(Input::draw(source)),
                turn: Input::draw(source),
            },
        }
    }
}

/// After any new target, any poses and wheel motions: no overflow, no division by zero, and the motors
/// either both brake or both run.
pub fn any_pose_is_safe(
    values: AcceptedConfig,
    target: Pose,
    ticks: [(Tick, ()); 8],
    count: u8,
) -> Seen {
    given!(let (true, config) = values.checked());
    let mut controller = PoseController::new(&config);
    controller.set_target(target);
    assert!(controller.moving());
    let mut seen = Seen::NOTHING;
    for (tick, ()) in ticks.into_iter().take(usize::from(count % 9)) {
        let commands = controller.drive(&tick.pose, &tick.delta);
        let brakes = commands == MotorCommands::BRAKE;
        let runs = |drive: MotorCommand| matches!(drive, MotorCommand::Run(_));
        assert!(brakes || runs(commands.left) && runs(commands.right));
        seen = seen
            .case(0, brakes)
            .case(1, !brakes && tick.pose.x.0 < -1_000)
            .case(2, !brakes && tick.delta.left == i32::MIN);
    }
    seen
}

crate::properties! {
    property T5 any_pose_is_safe(
        values: AcceptedConfig, target: Pose, ticks: [(Tick, ()); 8], count: u8
    ) {
        cases ["at the target", "far behind", "impossible counts"];
        needs [accepted_configuration_is_bounded];
        sampled 100_000;
    }
}
