//! PID at 100 Hz in saturating fixed point, with the gains of the EEPROM (document, 6.0.2): per 10 ms
//! sample, output in percent of duty.
//!
//! - The derivative acts on the measurement, so a new set-point never kicks.
//! - Anti wind-up is back-calculation: the excess beyond the limit, times the factor (at most 1), is
//!   taken out of the integral, down to zero. Beyond zero a large proportional part would wind the
//!   integral up the other way, and the robot would brake long before its target.
//! - Conditional integration: only errors whose proportional part is within a fifth of the limit, and
//!   that do not drive the output further into it. A larger integral would cause overshoot.
//!
//! No step overflows for any input and any accepted gain: gains are below 2¹⁴ with 32 fractional bits,
//! so a term is below 2³⁰ percent and, with its 32 fractional bits, below 2⁶¹.

use fixed::types::{I16F16, I32F32};

use super::trig::{split, upper};
use crate::eeprom::{self, Gains};

/// A gain: 48 fractional bits as two signed words.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Gain {
    low: i32,
    high: i32,
}

impl Gain {
    const fn new(gain: eeprom::Gain) -> Self {
        // Below 2¹⁴ with 32 fractional bits.
        let (low, high) = split(gain.value().to_bits() << 16);
        Self { low, high }
    }

    /// `self · value`, floor, 2⁻³² where `value` is in 2⁻¹⁶; below 2⁶¹.
    const fn times(self, value: i32) -> i64 {
        self.high as i64 * value as i64 + upper(self.low, value) as i64
    }
}

/// Part of the limit up to which the proportional part allows integration: a fifth.
const INTEGRATION_SHARE: i32 = 5;

/// The nearest value within ±`limit`.
const fn clamp(value: i64, limit: i64) -> i64 {
    if value > limit {
        limit
    } else if value < -limit {
        -limit
    } else {
        value
    }
}

/// One PID controller.
#[derive(Clone, Debug)]
pub struct Pid {
    proportional: Gain,
    integral: Gain,
    derivative: Gain,
    /// Back-calculation factor, Q16, 0 ..= 1.
    back_calculation: i64,
    /// 2⁻³² %.
    limit: i64,
    /// Largest proportional part that is integrated, 2⁻³² %.
    integration_limit: i64,
    /// Integral part of the output, 2⁻³² %, within ±`limit`.
    sum: i64,
}

impl Pid {
    /// With an output within ±`limit` percent, 0 ..= 100.
    // Requirement: WIRE-eeprom-11
    pub fn new(gains: &Gains, limit: I16F16) -> Self {
        let back_calculation = gains.anti_windup.value().to_bits() >> 16;
        let limit = limit.to_bits().clamp(0, 100 << 16);
        Self {
            proportional: Gain::new(gains.p),
            integral: Gain::new(gains.i),
            derivative: Gain::new(gains.d),
            back_calculation: back_calculation.min(1 << 16),
            limit: i64::from(limit) << 16,
            integration_limit: i64::from(limit / INTEGRATION_SHARE) << 16,
            sum: 0,
        }
    }

    /// Integrates errors of any size up to the limit: for a set-point that the controlled quantity
    /// follows all the time.
    #[must_use]
    pub(super) const fn integrating_all(mut self) -> Self {
        self.integration_limit = self.limit;
        self
    }

    /// Clears the integral.
    pub fn reset(&mut self) {
        self.sum = 0;
    }

    /// As after samples that left this integral part, percent; beyond the limit it is the limit.
    #[must_use]
    pub const fn with_integral(mut self, integral: I32F32) -> Self {
        self.sum = clamp(integral.to_bits(), self.limit);
        self
    }

    /// One sample. `error`: set-point less measurement; `rate`: change of the measurement since the last
    /// sample, same unit. Output: percent, within the limits.
    #[must_use]
    pub fn step(&mut self, error: I16F16, rate: I16F16) -> I16F16 {
        let proportional = self.proportional.times(error.to_bits());
        let others = proportional - self.derivative.times(rate.to_bits());
        let (increment, sum) = if proportional.abs() <= self.integration_limit {
            let increment = self.integral.times(error.to_bits());
            (increment, clamp(self.sum + increment, self.limit))
        } else {
            (0, self.sum)
        };
        let output = others + sum;
        let limited = clamp(output, self.limit);
        let excess = output - limited;
        self.sum = if excess == 0 {
            sum
        } else {
            // No integration further into the limit.
            let kept = if (excess > 0) == (increment > 0) {
                self.sum
            } else {
                sum
            };
            self.back_calculated(kept, excess)
        };
        I16F16::from_bits((limited >> 16) as i32)
    }

    /// The integral after back-calculation.
    const fn back_calculated(&self, kept: i64, excess: i64) -> i64 {
        // Only an integral of the excess's sign, and down to zero.
        if kept == 0 || (kept > 0) != (excess > 0) {
            return kept;
        }
        let rest = kept - (excess >> 16) * self.back_calculation;
        if (rest > 0) == (kept > 0) { rest } else { 0 }
    }

    /// The integral part, percent.
    pub const fn integral(&self) -> I32F32 {
        I32F32::from_bits(self.sum)
    }
}

#[cfg(test)]
mod tests;
