//! Drive monitor: whether the wheels follow their commands. Any of these faults makes the pose
//! worthless and the closed loop dangerous, because it would only drive harder.
//!
//! | fault | condition | latency |
//! |---|---|---|
//! | stalled (blocked wheel, dead encoder) | driven by 25 % beyond its dead zone, it turns less than 1/128 turn in half a second | below |
//! | reversed (wired backwards) | likewise, but it turns by that or more the other way | below |
//! | jump (broken encoder) | it turns by more than a tenth of a turn in a tick: 10 turns a second | none |
//!
//! The drive passes two first-order lags, like the motor's, so that a start or a reversal has its
//! time: the fault takes 0.62 to 0.95 s from a start, at most 0.99 s with a constant drive before, at
//! most 1.27 s after anything else, and longer between 20 and 25 %. Below 20 %, braked or coasting,
//! a wheel is not judged.
//!
//! A wheel whose `limit` exceeds its dead zone by less than 25 % is judged from four fifths of that
//! on, for as much longer as it is driven less: half a second of 25 % is 1.25 s of 10 %.

use super::mixer::MotorLag;
use crate::eeprom::{Config, Wheel};
use crate::types::{Delta, Faults, MotorCommand, MotorCommands};

/// Smallest duty beyond the dead zone that must turn a wheel, 2⁻⁸ hundredths of a percent.
const MIN_DRIVE: i32 = 2000 << 8;
/// Drive over which a wheel is judged, summed over the ticks: half a second of [`MIN_DRIVE`].
const WINDOW: i32 = 50 * MIN_DRIVE;

/// Monitor of one wheel.
#[derive(Clone, Copy, Debug)]
struct WheelMonitor {
    reversed: bool,
    /// Hundredths of a percent.
    dead_zone: i32,
    /// Smallest drive that must turn it, in the unit of [`MIN_DRIVE`].
    min_drive: i32,
    /// In the unit of [`MIN_DRIVE`].
    lag: MotorLag,
    /// Ticks since the window began, each `min_drive`.
    driven: i32,
    /// Counts in the direction of the duty since the window began.
    counts: i32,
}

// What is found of a wheel is named as the left one's; the right one's are the next bits.
const _: () = {
    assert!(Faults::RIGHT_STALLED.bits() == Faults::LEFT_STALLED.bits() << 1);
    assert!(Faults::RIGHT_REVERSED.bits() == Faults::LEFT_REVERSED.bits() << 1);
};

impl WheelMonitor {
    fn new(wheel: &Wheel) -> Self {
        let (limit, dead_zone) = (wheel.limit.hundredths(), wheel.dead_zone.hundredths());
        // Four fifths of 2⁸; `dead_zone` is below `limit`.
        let min_drive = (i32::from(limit - dead_zone) * 204).min(MIN_DRIVE);
        Self {
            reversed: wheel.motor_reversed,
            dead_zone: i32::from(dead_zone),
            min_drive,
            lag: MotorLag([0; 2]),
            driven: 0,
            counts: 0,
        }
    }

    /// The faults found in this tick, as the left wheel's.
    fn step(&mut self, command: MotorCommand, counts: i32, min_counts: i32) -> Faults {
        let MotorCommand::Run(duty) = command else {
            // The window restarts below: the lagged drive begins at nearly nothing.
            self.lag = MotorLag::default();
            return Faults::NONE;
        };
        let duty = i32::from(duty.hundredths());
        let duty = if self.reversed { -duty } else { duty };
        let drive = (duty.abs() - self.dead_zone).max(0) << 8;
        let drive = if duty < 0 { -drive } else { drive };
        // The weaker of the drive and the lagged drive, where both have the same sign.
        let lagged = self.lag.step(drive);
        let driven = if drive > 0 {
            drive.min(lagged)
        } else {
            -drive.max(lagged)
        };
        if driven < self.min_drive {
            (self.driven, self.counts) = (0, 0);
            return Faults::NONE;
        }
        // A jump is another fault; here it must not overflow, in at most 126,000 ticks.
        let counts = counts.clamp(-0x4000, 0x4000);
        self.counts += if drive > 0 { counts } else { -counts };
        self.driven += self.min_drive;
        if self.driven < WINDOW {
            return Faults::NONE;
        }
        self.driven = 0;
        match core::mem::take(&mut self.counts) {
            turned if turned <= -min_counts => Faults::LEFT_REVERSED,
            turned if turned < min_counts => Faults::LEFT_STALLED,
            _ => Faults::NONE,
        }
    }
}

/// The monitor of both wheels.
#[derive(Clone, Debug)]
pub struct DriveMonitor {
    left: WheelMonitor,
    right: WheelMonitor,
    /// Fewest counts in a window of a wheel that turns.
    min_counts: i32,
    /// Most counts in a tick.
    max_counts: i32,
}

impl DriveMonitor {
    /// At rest, without a fault.
    pub fn new(config: &Config) -> Self {
        let turn = i32::from(config.counts_per_turn());
        Self {
            left: WheelMonitor::new(config.left()),
            right: WheelMonitor::new(config.right()),
            min_counts: (turn / 128).max(2),
            max_counts: (turn / 10),
        }
    }

    /// Every tick, with the commands since the last one and the wheels' motion: the faults found.
    // Requirement: WIRE-status-3
    #[must_use]
    pub fn step(&mut self, commands: &MotorCommands, delta: &Delta) -> Faults {
        let left = self.left.step(commands.left, delta.left, self.min_counts);
        let right = self
            .right
            .step(commands.right, delta.right, self.min_counts);
        let mut faults = left | Faults::from_bits(right.bits() << 1);
        if delta.left.saturating_abs() > self.max_counts
            || delta.right.saturating_abs() > self.max_counts
        {
            faults |= Faults::ENCODER_JUMP;
        }
        faults
    }
}

#[cfg(test)]
mod tests;
