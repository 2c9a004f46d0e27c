//! T17: a robot that drives to a target arrives or gives up within the stated time.

use fw_core::eeprom::fields::{BATTERY_CUTOFF, BLIND_SPEED, MODE, STOP_DEADLINE};
use fw_core::eeprom::{Config, Wheel};
use fw_core::log::Log;
use fw_core::robot::{Robot, TickInput, TickOutput};
use fw_core::types::{Faults, MotorCommand};
use fw_core::wire::{Command, Mode, PiLink, PoseCode, State};

use super::send;
use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};
use crate::motion::arrival::stated_ticks;
use crate::property::Seen;

/// A wheel and its motor, of any strength.
#[derive(Clone, Copy, Debug, Default)]
pub struct Drivetrain {
    /// 64 is the configured full speed.
    pub strength: u8,
    /// Part of full duty below which it stands, 2⁻⁸.
    pub dead_zone: u8,
    /// Binary logarithm of its lag in ticks.
    pub lag: u8,
    /// Largest play, counts.
    pub play: u8,
}

impl Input for Drivetrain {
    fn draw(source: &mut impl Source) -> Self {
        Self {
            strength: Input::draw(source),
            dead_zone: Input::draw(source),
            lag: u8::draw(source) % 6,
            play: u8::draw(source) % 4,
        }
    }
}

/// A drivetrain in motion.
struct Turning {
    drivetrain: Drivetrain,
    /// Counts a tick by a hundredth of a percent of duty, 2⁻¹⁶.
    gain: i64,
    /// Duty that does nothing, hundredths of a percent.
    dead_zone: i64,
    /// 2⁻¹⁶ counts a tick, and counts.
    speed: i64,
    counts: i64,
}

impl Turning {
    fn new(drivetrain: Drivetrain, config: &Config, wheel: &Wheel) -> Self {
        let full = i64::from(wheel.full_speed_mm_s) * i64::from(config.counts_per_turn());
        // 2¹⁶·10 / π, of micrometres.
        let full = full * 208_611 / i64::from(wheel.diameter.0);
        let gain = full * i64::from(drivetrain.strength) / 640_000;
        let opposed = wheel.motor_reversed != wheel.encoder_reversed;
        Self {
            drivetrain,
            gain: if opposed { -gain } else { gain },
            dead_zone: i64::from(drivetrain.dead_zone) * 10_000 / 256,
            speed: 0,
            counts: 0,
        }
    }

    /// A tick: the encoder's counts since the start.
    fn step(&mut self, command: MotorCommand, tick: u64) -> i64 {
        let duty = match command {
            MotorCommand::Run(duty) => i64::from(duty.hundredths()),
            MotorCommand::Brake | MotorCommand::Coast => 0,
        };
        let driving = duty.signum() * (duty.abs() - self.dead_zone).max(0);
        self.speed += (driving * self.gain - self.speed) >> self.drivetrain.lag;
        self.counts += self.speed;
        (self.counts >> 16) + i64::from(self.drivetrain.play) * i64::from(tick % 5 == 0)
    }
}

/// Any accepted configuration, any target within 65 mm, any strength, dead zone, lag and play of the
/// wheels: after the stated time the robot has arrived or a fault has stopped it, and it was not given up
/// before.
// Requirement: WIRE-fault-15
#[allow(clippy::cast_sign_loss, reason = "the encoders' counters wrap")]
pub fn motion_ends_arrived_or_given_up(
    values: AcceptedConfig,
    guarded: bool,
    target: ((i16, i16), u16),
    wheels: (Drivetrain, Drivetrain),
) -> Seen {
    let mode = if guarded {
        Mode::GuardedNormal
    } else {
        Mode::Normal
    };
    let values = values
        .with(MODE, mode.code().into())
        .with(STOP_DEADLINE, 250)
        // Nothing else is to stop or to slow it.
        .with(BATTERY_CUTOFF, 0)
        .with(BLIND_SPEED, 2_000);
    given!(let Some(config) = values.config());
    let ((x, y), rotation) = target;
    let (x, y) = (i32::from(x) * 2, i32::from(y) * 2);
    let stated = stated_ticks(&config, (x.unsigned_abs(), y.unsigned_abs()));
    given!(stated < 4_000);
    let mut sample = TickInput::default();
    let mut robot = Robot::new(&config, sample);
    let mut pi = PiLink::new(config.link_setup());
    let mut log = Log::<1024>::new();
    let mut turning = [
        Turning::new(wheels.0, &config, config.left()),
        Turning::new(wheels.1, &config, config.right()),
    ];
    let command = Command {
        expected: PoseCode { x, y, rotation },
        apply: true,
        ..Command::default()
    };
    let mut ticks = 0;
    loop {
        send(&mut pi, &command, &mut robot, sample.now, &mut log);
        let TickOutput { left, right, .. } = robot.on_tick(sample, &[], &mut log);
        if robot.state() != State::Moving {
            break;
        }
        ticks += 1;
        assert!(ticks <= stated);
        sample.now = sample.now.after(10_000);
        sample.left = turning[0].step(left, ticks) as u32;
        sample.right = turning[1].step(right, ticks) as u16;
    }
    let given_up = robot.faults().intersects(Faults::NOT_ARRIVED);
    // One is the first, and it is allowed a tick and 2⁻¹² less.
    assert!(!given_up || ticks + 3 >= stated - (stated >> 12));
    let arrived = robot.state() == State::Ready;
    assert!(arrived || robot.state() == State::Faulted);
    Seen::NOTHING
        .case(0, arrived && ticks > 100)
        .case(1, given_up)
        .case(2, !arrived && !given_up)
}

crate::properties! {
    property T17 motion_ends_arrived_or_given_up(
        values: AcceptedConfig, guarded: bool, target: ((i16, i16), u16), wheels: (Drivetrain, Drivetrain)
    ) {
        cases ["arrived", "given up", "another fault"];
        needs [accepted_configuration_is_bounded, time_of_a_motion_runs_down];
        sampled 20_000;
    }
}
