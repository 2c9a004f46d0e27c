//! Mixer: from forward and rotation outputs, percent, to the motor commands.
//!
//! - Rotation has priority: where both do not fit, forward is reduced and the robot stays on course.
//! - A wheel's output counts from its dead zone, so that a small output moves it.
//! - The motors' gains are not in the configuration and differ by a third on the first board. They are
//!   identified while driving: each wheel's counts against its effective duty, behind two first-order
//!   lags like the motor's. The stronger wheel is scaled down to the weaker; a stop keeps the result.

use fixed::types::I16F16;

use crate::divide::ratio;
use crate::eeprom::{Config, Wheel};
use crate::types::{Delta, Duty, MotorCommand, MotorCommands};

/// 1 % in 2⁻¹⁶ %.
const PERCENT: i32 = 1 << 16;
/// Below this output the dead zone is compensated in proportion, so that the motors do not chatter
/// across it at standstill.
const SOFT_ZONE: i32 = PERCENT;
/// Smallest lagged duty that excites a wheel enough to identify its gain.
const MIN_EXCITATION: i32 = 6 * PERCENT;
/// Time constant of the identification, 2ⁿ excited ticks.
const LEARNING_SHIFT: u32 = 6;

/// Two first-order lags of 160 ms each: an approximation of the motors, which have 134 and 158 ms.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MotorLag(pub [i32; 2]);

impl MotorLag {
    /// The lagged input after this tick.
    pub fn step(&mut self, input: i32) -> i32 {
        let [first, second] = &mut self.0;
        *first += (input - *first) >> 4;
        *second += (*first - *second) >> 4;
        *second
    }

    const fn output(self) -> i32 {
        self.0[1]
    }
}

/// One motor: its limits and its identified gain.
#[derive(Clone, Copy, Debug)]
struct Motor {
    /// 2⁻¹⁶ %.
    dead_zone: i32,
    /// Duty beyond the dead zone up to the limit, 2⁻¹⁶ %.
    headroom: i32,
    /// Factor of this wheel's output, Q16, ¼ ..= 1.
    gain_balance: i32,
    /// Duty beyond the dead zone, now and lagged, 2⁻¹⁶ %.
    effective: i32,
    lag: MotorLag,
    /// Low-passed counts·duty and duty².
    response: i64,
    excitation: i64,
}

impl Motor {
    fn new(wheel: &Wheel) -> Self {
        let limit = i32::from(wheel.limit.hundredths());
        let dead_zone = i32::from(wheel.dead_zone.hundredths());
        Self {
            dead_zone: dead_zone * PERCENT / 100,
            headroom: (limit - dead_zone) * PERCENT / 100,
            gain_balance: 1 << 16,
            effective: 0,
            lag: MotorLag::default(),
            response: 0,
            excitation: 0,
        }
    }

    /// Counts per duty, any unit, at least 1.
    #[inline(never)]
    fn gain(&self) -> u32 {
        let (response, excitation) = (self.response.max(0), self.excitation.max(1));
        ratio(response.unsigned_abs(), excitation.unsigned_abs()).max(1)
    }

    /// Scales this wheel by its gain and the other's; the largest output it can follow then, 2⁻¹⁶ %.
    #[inline(never)]
    fn balance(&mut self, own: u32, other: u32) -> i32 {
        self.gain_balance = ratio(other.into(), own.into()).clamp(1 << 14, 1 << 16) as i32;
        // At most 100 % · 4. The headroom is below 2²³ and not negative, so nine more bits fit a 32-bit
        // division; the seven bits left out are 0.002 %.
        let balance = self.gain_balance.max(1 << 14) as u32;
        ((((self.headroom as u32) << 9) / balance) << 7) as i32
    }

    /// Duty for an output within [`Self::max_output`], 2⁻¹⁶ %.
    // Requirement: WIRE-platform-9
    fn duty(&mut self, output: i32) -> i32 {
        let effective = ((i64::from(output) * i64::from(self.gain_balance)) >> 16) as i32;
        self.effective = effective.min(self.headroom).max(-self.headroom);
        let softness = effective.abs().min(SOFT_ZONE);
        let lift = ((i64::from(self.dead_zone) * i64::from(softness)) >> 16) as i32;
        self.effective + if effective < 0 { -lift } else { lift }
    }

    fn identify(&mut self, counts: i32) {
        // Q8 percent: 25 600 at most; no wheel makes more than a thousand counts a tick.
        let duty = i64::from(self.lag.output() >> 8);
        let counts = i64::from(counts.clamp(-1000, 1000)) << 8;
        self.response += (counts * duty - self.response) >> LEARNING_SHIFT;
        self.excitation += (duty * duty - self.excitation) >> LEARNING_SHIFT;
    }
}

/// The mixer of both motors.
#[derive(Clone, Debug)]
pub struct Mixer {
    left: Motor,
    right: Motor,
    left_reversed: bool,
    right_reversed: bool,
    limit_left: i32,
    limit_right: i32,
    max_output: i32,
    excited: u8,
}

impl Mixer {
    /// Equal gains until identified.
    // Requirement: WIRE-platform-3
    // Start-up only: one copy in flash.
    #[inline(never)]
    pub fn new(config: &Config) -> Self {
        let left = Motor::new(config.left());
        let right = Motor::new(config.right());
        Self {
            max_output: left.headroom.min(right.headroom),
            left,
            right,
            left_reversed: config.left().motor_reversed,
            right_reversed: config.right().motor_reversed,
            limit_left: i32::from(config.left().limit.hundredths()),
            limit_right: i32::from(config.right().limit.hundredths()),
            excited: 0,
        }
    }

    /// Every tick, with the wheels' motion since the last: identifies the motors' gains.
    pub fn observe(&mut self, delta: &Delta) {
        let left = self.left.lag.step(self.left.effective);
        let right = self.right.lag.step(self.right.effective);
        if left.abs() < MIN_EXCITATION || right.abs() < MIN_EXCITATION {
            return;
        }
        self.left.identify(delta.left);
        self.right.identify(delta.right);
        self.excited = self.excited.wrapping_add(1);
        // The gains change slowly: every sixteenth tick is enough.
        if self.excited % 16 == 0 {
            self.balance();
        }
    }

    fn balance(&mut self) {
        self.balance_by(self.left.gain(), self.right.gain());
    }

    #[inline]
    fn balance_by(&mut self, left: u32, right: u32) {
        self.max_output = self
            .left
            .balance(left, right)
            .min(self.right.balance(right, left))
            .min(100 * PERCENT);
    }

    /// As after ticks that identified these counts per duty.
    #[must_use]
    pub fn with_gains(mut self, left: u32, right: u32) -> Self {
        self.balance_by(left.max(1), right.max(1));
        self
    }

    /// Commands for a forward and a counter-clockwise output, percent.
    // Requirement: WIRE-eeprom-6
    #[must_use]
    pub fn mix(&mut self, forward: I16F16, rotation: I16F16) -> MotorCommands {
        let rotation = rotation
            .to_bits()
            .min(self.max_output)
            .max(-self.max_output);
        let headroom = self.max_output - rotation.abs();
        let forward = forward.to_bits().min(headroom).max(-headroom);
        self.each(forward - rotation, forward + rotation)
    }

    /// Commands for each wheel's own output, 2⁻¹⁶ %, cut to its limit.
    // Requirement: WIRE-eeprom-6
    #[must_use]
    pub fn each(&mut self, left: i32, right: i32) -> MotorCommands {
        let left = self.left.duty(left);
        let right = self.right.duty(right);
        self.commands(hundredths(left), hundredths(right))
    }

    /// Uncompensated duties, hundredths of a percent, within the configured limits: the tuning modes
    /// measure the motors alone.
    // Requirement: DOC-5.2.2-1, WIRE-eeprom-6
    #[must_use]
    pub fn raw(&mut self, left: i32, right: i32) -> MotorCommands {
        self.stop_learning();
        self.commands(
            left.min(self.limit_left).max(-self.limit_left),
            right.min(self.limit_right).max(-self.limit_right),
        )
    }

    /// Both motors braked.
    #[must_use]
    pub fn brake(&mut self) -> MotorCommands {
        self.stop_learning();
        MotorCommands::BRAKE
    }

    /// The motors are not driven by [`Self::mix`]: their motion does not identify them.
    pub(super) fn stop_learning(&mut self) {
        self.left.effective = 0;
        self.right.effective = 0;
    }

    // Requirement: WIRE-platform-3
    fn commands(&self, left: i32, right: i32) -> MotorCommands {
        let run = |duty: i32, reversed: bool| {
            MotorCommand::Run(Duty::saturating(if reversed { -duty } else { duty }))
        };
        MotorCommands {
            left: run(left, self.left_reversed),
            right: run(right, self.right_reversed),
        }
    }

    /// Factors of the left and the right wheel's output, ¼ ..= 1: 1 for the weaker wheel.
    pub const fn gain_balance(&self) -> (I16F16, I16F16) {
        (
            I16F16::from_bits(self.left.gain_balance),
            I16F16::from_bits(self.right.gain_balance),
        )
    }
}

/// 2⁻¹⁶ % in the nearest hundredths of a percent.
const fn hundredths(percent: i32) -> i32 {
    (percent * 25 + (1 << 13)) >> 14
}

#[cfg(test)]
mod tests;
