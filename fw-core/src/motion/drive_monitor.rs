//! Do the wheels do what they are told? A wheel that does not turn is blocked or its encoder is dead;
//! one that turns the other way is wired backwards; one that jumps has a broken encoder. Any of
//! them makes the pose worthless and the controller dangerous: it would push ever harder.
//!
//! | fault | seen when | after |
//! |---|---|---|
//! | stalled | driven by 25 % beyond its dead zone, it turns less than 1/128 turn in half a second | below |
//! | reversed | likewise, but it turns by that or more the other way | below |
//! | jump | it turns by more than a tenth of a turn in a tick: 10 turns a second | at once |
//!
//! What the wheel is driven by is taken through two first-order lags, as the motor does, so that a
//! start or a reversal is given its time: it takes 0.62 to 0.95 s from a start, at most 0.99 s where the
//! wheel was driven like that before, and at most 1.27 s after anything else. Between 20 and 25 % it
//! takes longer. Nothing is judged below that, or while braked or coasting.

use crate::eeprom::Platform;
use crate::types::{Delta, Faults, MotorCommand, MotorCommands};

/// Duty beyond the dead zone from which on a wheel must turn, hundredths of a percent, 8 fractional
/// bits.
const MUST_TURN: i32 = 2000 << 8;
/// Each lag, 2ⁿ ticks: 160 ms.
const LAG: u32 = 4;
/// Ticks over which a wheel is judged.
const WINDOW: u8 = 50;

/// One wheel.
#[derive(Clone, Copy, Debug)]
struct Watch {
    suspicion: Suspicion,
    reversed: bool,
    /// Hundredths of a percent.
    dead_zone: i32,
    /// Behind each lag, like [`MUST_TURN`].
    lagged: [i32; 2],
    ticks: u8,
    /// Counts in the direction of the duty since the window began.
    counts: i32,
}

/// The bits of [`fault`] that a wheel can earn.
#[derive(Clone, Copy, Debug)]
struct Suspicion {
    stalled: Faults,
    reversed: Faults,
}

impl Watch {
    const fn new(dead_zone: u16, reversed: bool, suspicion: Suspicion) -> Self {
        Self {
            suspicion,
            reversed,
            dead_zone: dead_zone as i32,
            lagged: [0; 2],
            ticks: 0,
            counts: 0,
        }
    }

    /// Bits of [`fault`], 0 if all is well.
    fn step(&mut self, told: MotorCommand, counts: i32, least: i32) -> Faults {
        let MotorCommand::Run(duty) = told else {
            *self = Self {
                lagged: [0; 2],
                ticks: 0,
                counts: 0,
                ..*self
            };
            return Faults::NONE;
        };
        let duty = i32::from(duty.hundredths());
        let duty = if self.reversed { -duty } else { duty };
        let beyond = (duty.abs() - self.dead_zone).max(0) << 8;
        let beyond = if duty < 0 { -beyond } else { beyond };
        self.lagged[0] += (beyond - self.lagged[0]) >> LAG;
        self.lagged[1] += (self.lagged[0] - self.lagged[1]) >> LAG;
        // The weaker of what it is told and what that has come to, where both agree.
        let (told, came) = (beyond, self.lagged[1]);
        let driven = if told > 0 {
            told.min(came)
        } else {
            -told.max(came)
        };
        if driven < MUST_TURN {
            self.ticks = 0;
            self.counts = 0;
            return Faults::NONE;
        }
        // A jump is another fault; here it only must not overflow.
        let counts = counts.clamp(-0x8000, 0x8000);
        self.counts += if told > 0 { counts } else { -counts };
        self.ticks += 1;
        if self.ticks < WINDOW {
            return Faults::NONE;
        }
        let turned = self.counts;
        self.ticks = 0;
        self.counts = 0;
        if turned <= -least {
            self.suspicion.reversed
        } else if turned < least {
            self.suspicion.stalled
        } else {
            Faults::NONE
        }
    }
}

/// Both wheels.
#[derive(Clone, Debug)]
pub struct DriveMonitor {
    left: Watch,
    right: Watch,
    /// Counts that make a turning wheel.
    least: i32,
    /// Most counts a tick.
    most: i32,
}

impl DriveMonitor {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(platform: &Platform) -> Self {
        let turn = i32::from(platform.counts_per_turn);
        Self {
            left: Watch::new(
                platform.dead_zone_left,
                platform.motor_left_reversed,
                Suspicion {
                    stalled: Faults::LEFT_STALLED,
                    reversed: Faults::LEFT_REVERSED,
                },
            ),
            right: Watch::new(
                platform.dead_zone_right,
                platform.motor_right_reversed,
                Suspicion {
                    stalled: Faults::RIGHT_STALLED,
                    reversed: Faults::RIGHT_REVERSED,
                },
            ),
            least: (turn / 128).max(2),
            most: (turn / 10).max(10),
        }
    }

    /// Every tick: what the bridges were told since the last one, and what the wheels did. Bits of
    /// [`fault`], 0 if all is well.
    // Requirement: WIRE-status-3
    #[must_use]
    pub fn step(&mut self, told: &MotorCommands, delta: &Delta) -> Faults {
        let mut faults = self.left.step(told.left, delta.left, self.least)
            | self.right.step(told.right, delta.right, self.least);
        if delta.left.saturating_abs() > self.most || delta.right.saturating_abs() > self.most {
            faults |= Faults::ENCODER_JUMP;
        }
        faults
    }
}

#[cfg(test)]
mod tests;
