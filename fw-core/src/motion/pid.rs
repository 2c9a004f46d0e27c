//! PID at 100 Hz in saturating fixed point, with the document's factors as they stand in the EEPROM
//! (document, 6.0.2): per 10 ms sample, output in percent of duty.
//!
//! - The derivative is taken from the measurement, so a new set-point never kicks.
//! - Anti wind-up is back-calculation: what the limit cuts off the output, times the factor (1 at
//!   most: the whole excess), is taken out of the integral. It takes out only what integration put
//!   in, down to zero: an error so large that the proportional part alone saturates would otherwise
//!   wind the integral up the other way, and the robot would brake long before its goal.
//! - Only what is near is integrated: errors whose proportional part is within a fifth of the limit,
//!   and that do not drive the output further into it. On the way there the integral has nothing to
//!   say; what it gathered would only carry the robot past its goal.
//!
//! No step overflows, for any input and any factor that the configuration accepts: factors are below
//! 2¹⁴ with 32 fractional bits, so a term is below 2³⁰ percent and, with its 32 fractional bits,
//! below 2⁶¹.

use fixed::types::I16F16;

use super::trig::{split, upper};
use crate::binary64::Binary64;
use crate::eeprom::Gains;

/// Largest factor that fits; the EEPROM's are at most 10 000.
const LARGEST: i64 = (1 << 14 << 32) - 1;

/// A factor of the document, within ±[`LARGEST`]: 48 fractional bits as two signed words.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Factor {
    low: i32,
    high: i32,
}

impl Factor {
    /// The nearest of 32 fractional bits; 0 for what is no number or beyond 2³¹, which no accepted
    /// configuration holds.
    fn new(value: Binary64) -> Self {
        let (low, high) = split(Self::bits(value) << 16);
        Self { low, high }
    }

    /// 32 fractional bits.
    // At start-up only: once in flash is enough.
    #[inline(never)]
    fn bits(value: Binary64) -> i64 {
        value.to_scaled(32).unwrap_or(0).clamp(-LARGEST, LARGEST)
    }

    /// `self · value`, floor, 2⁻³² where `value` is in 2⁻¹⁶; below 2⁶¹.
    #[inline]
    const fn times(self, value: i32) -> i64 {
        self.high as i64 * value as i64 + upper(self.low, value) as i64
    }
}

/// Part of the limit up to which the proportional part counts as near.
const NEAR: i32 = 5;

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

/// One regulator.
#[derive(Clone, Debug)]
pub struct Pid {
    proportional: Factor,
    integral: Factor,
    derivative: Factor,
    /// Back-calculation factor, Q16, 0 ..= 1.
    unwind: i64,
    /// 2⁻³² %.
    limit: i64,
    /// Proportional parts up to this are integrated, 2⁻³² %.
    near: i64,
    /// The integral part of the output, 2⁻³² %, within ±`limit`.
    sum: i64,
}

impl Pid {
    /// With an output within ±`limit` percent, 0 ..= 100.
    // Requirement: DOC-6.0.2-1, WIRE-eeprom-11
    #[must_use]
    pub fn new(gains: &Gains, limit: I16F16) -> Self {
        let unwind = Factor::bits(gains.anti_windup) >> 16;
        let mut pid = Self {
            proportional: Factor::new(gains.p),
            integral: Factor::new(gains.i),
            derivative: Factor::new(gains.d),
            unwind: unwind.clamp(0, 1 << 16),
            limit: 0,
            near: 0,
            sum: 0,
        };
        pid.set_limit(limit);
        pid
    }

    /// Changes the output's limit, percent, 0 ..= 100.
    pub fn set_limit(&mut self, limit: I16F16) {
        self.limit = i64::from(limit.to_bits().clamp(0, 100 << 16)) << 16;
        self.near = i64::from(limit.to_bits().clamp(0, 100 << 16) / NEAR) << 16;
        self.sum = clamp(self.sum, self.limit);
    }

    /// Forgets the integral: the next output starts from the error alone.
    pub fn reset(&mut self) {
        self.sum = 0;
    }

    /// Forgets the integral and takes over at the output `percent`: the first [`Self::step`] with
    /// this `error` and `rate` continues it without a jump, within the limits.
    pub fn start_at(&mut self, percent: I16F16, error: I16F16, rate: I16F16) {
        let others =
            self.proportional.times(error.to_bits()) - self.derivative.times(rate.to_bits());
        self.sum = clamp((i64::from(percent.to_bits()) << 16) - others, self.limit);
    }

    /// One sample. `error`: what is missing to the set-point; `rate`: by how much the measurement
    /// grew since the last sample, same unit. Output: percent, within the limits.
    #[must_use]
    pub fn step(&mut self, error: I16F16, rate: I16F16) -> I16F16 {
        let proportional = self.proportional.times(error.to_bits());
        let others = proportional - self.derivative.times(rate.to_bits());
        let (increment, sum) = if proportional.abs() <= self.near {
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
            // Not further into the limit, and back by what is too much, as far as zero.
            let kept = if (excess > 0) == (increment > 0) {
                self.sum
            } else {
                sum
            };
            self.unwound(kept, excess)
        };
        I16F16::from_bits((limited >> 16) as i32)
    }

    /// What back-calculation leaves of an integral part.
    #[inline]
    const fn unwound(&self, kept: i64, excess: i64) -> i64 {
        // Only what pushes the same way, and no further than to zero.
        if kept == 0 || (kept > 0) != (excess > 0) {
            return kept;
        }
        let rest = kept - (excess >> 16) * self.unwind;
        if (rest > 0) == (kept > 0) {
            rest
        } else {
            0
        }
    }

    /// The integral part, percent.
    #[must_use]
    pub const fn integral(&self) -> I16F16 {
        I16F16::from_bits((self.sum >> 16) as i32)
    }
}

#[cfg(test)]
mod tests;
