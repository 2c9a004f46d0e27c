//! What the monitor knows of a platform, and the drives and motions around its thresholds.

use fw_core::eeprom::Config;
use fw_core::eeprom::fields::{
    COUNTS_PER_TURN, DEAD_ZONE_LEFT, DEAD_ZONE_RIGHT, LIMIT_LEFT, LIMIT_RIGHT, MOTOR_LEFT_REVERSED,
    MOTOR_RIGHT_REVERSED,
};
use fw_core::motion::DriveMonitor;
use fw_core::types::{Duty, MotorCommand};

use super::{DRIVEN, IDLE, WINDOW};
use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};

/// The monitor's parameters of a platform.
#[derive(Clone, Copy, Debug)]
pub struct Parameters {
    /// Encoder counts of a turn.
    pub turn: u16,
    /// Hundredths of a percent.
    pub dead_zones: [u16; 2],
    /// Hundredths of a percent, above the dead zones.
    pub limits: [u16; 2],
    /// A positive duty drives backward.
    pub reversed: [bool; 2],
}

impl Input for Parameters {
    fn draw(source: &mut impl Source) -> Self {
        let dead_zones = [u16::draw(source).min(9_999), u16::draw(source).min(9_999)];
        let limits = dead_zones.map(|dead_zone| u16::draw(source).clamp(dead_zone + 1, 10_000));
        Self {
            turn: u16::draw(source).clamp(100, 60_000),
            dead_zones,
            limits,
            reversed: [Input::draw(source), Input::draw(source)],
        }
    }
}

impl Parameters {
    /// Of this configuration.
    pub fn of(config: &Config) -> Self {
        let wheels = [config.left(), config.right()];
        Self {
            turn: config.counts_per_turn(),
            dead_zones: wheels.map(|wheel| wheel.dead_zone.hundredths().unsigned_abs()),
            limits: wheels.map(|wheel| wheel.limit.hundredths().unsigned_abs()),
            reversed: wheels.map(|wheel| wheel.motor_reversed),
        }
    }

    pub(super) fn monitor(self) -> DriveMonitor {
        let values = AcceptedConfig::FIRST_BOARD
            .with(COUNTS_PER_TURN, self.turn.into())
            .with(DEAD_ZONE_LEFT, self.dead_zones[0].into())
            .with(DEAD_ZONE_RIGHT, self.dead_zones[1].into())
            .with(LIMIT_LEFT, self.limits[0].into())
            .with(LIMIT_RIGHT, self.limits[1].into())
            .with(MOTOR_LEFT_REVERSED, self.reversed[0].into())
            .with(MOTOR_RIGHT_REVERSED, self.reversed[1].into());
        DriveMonitor::new(&values.config().expect("accepted"))
    }

    /// Counts of 1/128 turn.
    pub(super) fn least(self) -> i32 {
        i32::from(self.turn / 128).max(2)
    }

    /// Counts of a tenth of a turn.
    pub(super) fn most(self) -> i32 {
        i32::from(self.turn / 10).max(10)
    }

    /// Largest duty of a wheel beyond its dead zone.
    pub(super) fn headroom(self, wheel: usize) -> i32 {
        i32::from(self.limits[wheel]) - i32::from(self.dead_zones[wheel])
    }

    /// Smallest duty beyond the dead zone for which the times hold.
    pub fn driven(self, wheel: usize) -> i32 {
        self.headroom(wheel).min(DRIVEN)
    }

    /// Drive from which a wheel is judged, 2⁻⁸ hundredths of a percent: four fifths of its headroom.
    pub fn judged(self, wheel: usize) -> i32 {
        (204 * self.headroom(wheel)).min(IDLE << 8)
    }

    /// Fewest ticks before a standing wheel is judged.
    pub(super) fn window(self, wheel: usize) -> u32 {
        let drive = WINDOW * (IDLE << 8).unsigned_abs();
        drive.div_ceil(self.judged(wheel).unsigned_abs())
    }

    /// Ticks by which that exceeds [`WINDOW`].
    pub fn more(self, wheel: usize) -> u32 {
        self.window(wheel) - WINDOW
    }

    /// Duty of a wheel beyond the dead zone, forward positive.
    pub(super) fn beyond(self, wheel: usize, drive: MotorCommand) -> i32 {
        let MotorCommand::Run(duty) = drive else {
            return 0;
        };
        let duty = i32::from(duty.hundredths());
        let beyond = (duty.abs() - i32::from(self.dead_zones[wheel])).max(0) * duty.signum();
        beyond * self.sign(wheel)
    }

    /// −1 where a positive duty drives backward.
    pub(super) fn sign(self, wheel: usize) -> i32 {
        1 - 2 * i32::from(self.reversed[wheel])
    }

    /// The duty that drives a wheel by `beyond`, at most its limit.
    pub(super) fn duty(self, wheel: usize, beyond: i32) -> MotorCommand {
        let beyond = beyond.clamp(-self.headroom(wheel), self.headroom(wheel));
        let duty = (beyond.abs() + i32::from(self.dead_zones[wheel])) * beyond.signum();
        MotorCommand::Run(Duty::saturating(duty * self.sign(wheel)))
    }

    /// A command, often near a threshold.
    pub(super) fn some_duty(self, wheel: usize, byte: u8) -> MotorCommand {
        let sign = if byte & 1 == 0 { 1 } else { -1 };
        match byte >> 1 {
            0 => MotorCommand::Coast,
            1 => MotorCommand::Brake,
            2..=31 => self.duty(
                wheel,
                sign * ((self.judged(wheel) >> 8) + i32::from(byte) - 32),
            ),
            32..=63 => self.duty(wheel, sign * 10_000),
            _ => {
                let limit = i32::from(self.limits[wheel]);
                let duty = (i32::from(byte) - 128) * 79;
                MotorCommand::Run(Duty::saturating(duty.clamp(-limit, limit)))
            }
        }
    }

    /// Counts of a tick, often with a window's sum near a threshold.
    pub(super) fn some_counts(self, byte: u8, tick: u8) -> i32 {
        let sign = if byte & 1 == 0 { 1 } else { -1 };
        let least = self.least();
        let share = |sum: i32| {
            // `sum` distributed evenly over [`WINDOW`] ticks.
            let window = WINDOW as i32;
            let tick = i32::from(tick) % window;
            sum * (tick + 1) / window - sum * tick / window
        };
        match byte >> 1 {
            0..=7 => 0,
            8..=39 => share(sign * (least + i32::from(byte >> 1) - 24)),
            40..=47 => sign * if tick % 2 == 0 { least } else { -least },
            48..=79 => share(sign * 20 * least),
            80..=87 => sign * (self.most() + i32::from(byte >> 1) - 84),
            _ => share(sign * i32::from(byte)),
        }
    }
}
