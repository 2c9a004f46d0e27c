//! From what the body should do, forward and rotation in percent, to what each motor is told.
//!
//! - Rotation goes first: where both do not fit, forward gives way, so the robot stays on course.
//! - A wheel's percent count from its dead zone on, so that a small output moves it at all.
//! - The motors' gains are not in the configuration and differ by a third on the first board. They
//!   are learned while driving: each wheel's counts are set against its own effective duty through
//!   two first-order lags like the motor's, and the stronger wheel is scaled down to the weaker.
//!   What is learned stays when the robot stops.

use fixed::types::I16F16;

use crate::divide::ratio;
use crate::eeprom::Platform;
use crate::types::{Delta, Duty, MotorCommand, MotorCommands};

/// 1 %, 2⁻¹⁶.
const PERCENT: i32 = 1 << 16;
/// Below this output the dead zone is compensated in proportion, or the motors would be thrown from
/// one side of it to the other at a standstill.
const SOFT: i32 = PERCENT;
/// Effective duty from which on a wheel's motion says something about its gain.
const EXCITED: i32 = 6 * PERCENT;
/// Time constant of each of the two lags, 2ⁿ ticks: 160 ms, the motors have 134 and 158.
const LAG: u32 = 4;
/// Time constant of the learning, 2ⁿ excited ticks.
const LEARNING: u32 = 6;

/// One motor: its figures and what it is learned to do.
#[derive(Clone, Copy, Debug)]
struct Motor {
    /// 2⁻¹⁶ %.
    dead_zone: i32,
    /// Duty left beyond the dead zone, 2⁻¹⁶ %.
    room: i32,
    /// Share of the output this wheel gets, Q16, ¼ ..= 1.
    share: i32,
    /// Effective duty of this tick and behind each lag, 2⁻¹⁶ %.
    effective: i32,
    lagged: [i32; 2],
    /// Decaying sums of counts·duty and duty².
    response: i64,
    excitation: i64,
}

impl Motor {
    fn new(dead_zone: u16, limit: u16) -> Self {
        let limit = i32::from(limit.min(Duty::FULL.unsigned_abs()));
        let dead_zone = i32::from(dead_zone).min(limit);
        Self {
            dead_zone: dead_zone * PERCENT / 100,
            room: (limit - dead_zone) * PERCENT / 100,
            share: 1 << 16,
            effective: 0,
            lagged: [0; 2],
            response: 0,
            excitation: 0,
        }
    }

    /// The largest output this wheel can follow, 2⁻¹⁶ %.
    fn reach(&self) -> i32 {
        // At most 100 % · 4. The room is below 2²³ and not negative, so nine more bits fit a 32-bit
        // division; the seven left out are 0.002 %.
        let share = self.share.max(1 << 14) as u32;
        ((((self.room as u32) << 9) / share) << 7) as i32
    }

    /// Duty for an output within the reach.
    // Requirement: WIRE-platform-9
    fn duty(&mut self, output: i32) -> i32 {
        let effective = ((i64::from(output) * i64::from(self.share)) >> 16) as i32;
        self.effective = effective.min(self.room).max(-self.room);
        let softness = effective.abs().min(SOFT);
        let lift = ((i64::from(self.dead_zone) * i64::from(softness)) >> 16) as i32;
        self.effective + if effective < 0 { -lift } else { lift }
    }

    fn follow(&mut self) {
        self.lagged[0] += (self.effective - self.lagged[0]) >> LAG;
        self.lagged[1] += (self.lagged[0] - self.lagged[1]) >> LAG;
    }

    fn learn(&mut self, counts: i32) {
        // Q8 percent: 25 600 at most; counts above a thousand a tick are not a wheel's.
        let duty = i64::from(self.lagged[1] >> 8);
        let counts = i64::from(counts.clamp(-1000, 1000)) << 8;
        self.response += (counts * duty - self.response) >> LEARNING;
        self.excitation += (duty * duty - self.excitation) >> LEARNING;
    }
}

/// Both motors.
#[derive(Clone, Debug)]
pub struct Mixer {
    left: Motor,
    right: Motor,
    left_reversed: bool,
    right_reversed: bool,
    limit_left: i32,
    limit_right: i32,
    reach: i32,
    excited: u8,
}

impl Mixer {
    /// Nothing learned yet: wheels taken as alike.
    // Requirement: WIRE-platform-3
    #[must_use]
    pub fn new(platform: &Platform) -> Self {
        let left = Motor::new(platform.dead_zone_left, platform.limit_left);
        let right = Motor::new(platform.dead_zone_right, platform.limit_right);
        Self {
            reach: left.room.min(right.room),
            left,
            right,
            left_reversed: platform.motor_left_reversed,
            right_reversed: platform.motor_right_reversed,
            limit_left: i32::from(platform.limit_left),
            limit_right: i32::from(platform.limit_right),
            excited: 0,
        }
    }

    /// Every tick, with what the wheels did since the last: learns how they follow.
    pub fn observe(&mut self, delta: &Delta) {
        self.left.follow();
        self.right.follow();
        if self.left.lagged[1].abs() < EXCITED || self.right.lagged[1].abs() < EXCITED {
            return;
        }
        self.left.learn(delta.left);
        self.right.learn(delta.right);
        self.excited = self.excited.wrapping_add(1);
        // The shares change slowly: every sixteenth tick is enough.
        if self.excited % 16 == 0 {
            self.balance();
        }
    }

    fn balance(&mut self) {
        let gain = |motor: &Motor| {
            let (response, excitation) = (motor.response.max(0), motor.excitation.max(1));
            ratio(response.unsigned_abs(), excitation.unsigned_abs()).max(1)
        };
        let (left, right) = (gain(&self.left), gain(&self.right));
        let share =
            |own: u32, other: u32| ratio(other.into(), own.into()).clamp(1 << 14, 1 << 16) as i32;
        self.left.share = share(left, right);
        self.right.share = share(right, left);
        self.reach = self.left.reach().min(self.right.reach()).min(100 * PERCENT);
    }

    /// Forward and counter-clockwise rotation, percent.
    // Requirement: WIRE-eeprom-6
    #[must_use]
    pub fn mix(&mut self, forward: I16F16, rotation: I16F16) -> MotorCommands {
        let rotation = rotation.to_bits().min(self.reach).max(-self.reach);
        let room = self.reach - rotation.abs();
        let forward = forward.to_bits().min(room).max(-room);
        let left = self.left.duty(forward - rotation);
        let right = self.right.duty(forward + rotation);
        self.wheels(hundredths(left), hundredths(right))
    }

    /// Raw duties in hundredths of a percent, within the configured limits only: what the tuning
    /// modes measure must be the motors, not our compensation.
    // Requirement: WIRE-eeprom-6
    #[must_use]
    pub fn raw(&mut self, left: i32, right: i32) -> MotorCommands {
        self.stand();
        self.wheels(
            left.min(self.limit_left).max(-self.limit_left),
            right.min(self.limit_right).max(-self.limit_right),
        )
    }

    /// Both motors braked.
    #[must_use]
    pub fn brake(&mut self) -> MotorCommands {
        self.stand();
        MotorCommands::BRAKE
    }

    /// The motors are not driven: what they do now says nothing about them.
    pub(super) fn stand(&mut self) {
        self.left.effective = 0;
        self.right.effective = 0;
    }

    fn wheels(&self, left: i32, right: i32) -> MotorCommands {
        let run = |duty: i32, reversed: bool| {
            MotorCommand::Run(Duty::saturating(if reversed { -duty } else { duty }))
        };
        MotorCommands {
            left: run(left, self.left_reversed),
            right: run(right, self.right_reversed),
        }
    }

    /// The share of the output that the left and the right wheel get, 2⁻¹⁶: 1 for the weaker.
    #[must_use]
    pub const fn shares(&self) -> (I16F16, I16F16) {
        (
            I16F16::from_bits(self.left.share),
            I16F16::from_bits(self.right.share),
        )
    }
}

/// 2⁻¹⁶ % as the nearest hundredths.
const fn hundredths(percent: i32) -> i32 {
    (percent * 25 + (1 << 13)) >> 14
}

#[cfg(test)]
mod tests;
