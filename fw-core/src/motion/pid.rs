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
//! No step overflows, for any factor: a factor is a 31-bit mantissa and a binary exponent, a term is
//! one 32 × 32-bit product, shifted and cut to ±2¹⁶ %.

use fixed::types::I16F16;

use crate::double::Double;
use crate::eeprom::Gains;

/// Largest magnitude of a term, 2⁻³² %.
const TERM_LIMIT: i64 = 1 << 48;

/// A factor of the document: `mantissa · 2⁻ᵉˣᵖᵒⁿᵉⁿᵗ`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Factor {
    /// 31 bits; never `i32::MIN`.
    mantissa: i32,
    /// −31 ..= 63: a factor below 1.2e-10 is 0, one of 2⁶² or more the largest.
    exponent: i32,
}

impl Factor {
    /// The leading 31 bits of a finite double; 0 for what is not finite, which no accepted
    /// configuration holds.
    const fn new(value: Double) -> Self {
        let biased = ((value.0 >> 52) & 0x7FF) as i32;
        if biased == 0 || biased == 0x7FF {
            return Self {
                mantissa: 0,
                exponent: 0,
            };
        }
        let mantissa = (((value.0 & ((1 << 52) - 1)) | (1 << 52)) >> 22) as i32;
        let exponent = 1023 + 30 - biased;
        let (mantissa, exponent) = if exponent > 63 {
            (0, 0)
        } else if exponent < -31 {
            (i32::MAX, -31)
        } else {
            (mantissa, exponent)
        };
        let mantissa = if value.0 >> 63 == 1 {
            -mantissa
        } else {
            mantissa
        };
        Self { mantissa, exponent }
    }

    /// `self · value`, 2⁻³² where `value` is in 2⁻¹⁶, floor, cut to ±2¹⁶.
    const fn times(self, value: i32) -> i64 {
        let product = self.mantissa as i64 * value as i64;
        let shift = self.exponent - 16;
        if shift >= 0 {
            clamp(product >> shift, TERM_LIMIT)
        } else {
            // At most 47 places: cut first, and what is left cannot lose its top.
            let bound = TERM_LIMIT >> -shift;
            clamp(product, bound) << -shift
        }
    }
}

/// Part of the limit up to which the proportional part counts as near.
const NEAR: i64 = 5;

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
    /// The integral part of the output, 2⁻³² %, within ±`limit`.
    sum: i64,
}

impl Pid {
    /// With an output within ±`limit` percent, 0 ..= 100.
    #[must_use]
    pub fn new(gains: &Gains, limit: I16F16) -> Self {
        let unwind = Factor::new(gains.anti_windup).times(1 << 16) >> 16;
        Self {
            proportional: Factor::new(gains.p),
            integral: Factor::new(gains.i),
            derivative: Factor::new(gains.d),
            unwind: unwind.clamp(0, 1 << 16),
            limit: i64::from(limit.to_bits().clamp(0, 100 << 16)) << 16,
            sum: 0,
        }
    }

    /// Changes the output's limit, percent, 0 ..= 100.
    pub fn set_limit(&mut self, limit: I16F16) {
        self.limit = i64::from(limit.to_bits().clamp(0, 100 << 16)) << 16;
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
        let increment = if proportional.abs() <= self.limit / NEAR {
            self.integral.times(error.to_bits())
        } else {
            0
        };
        let sum = clamp(self.sum + increment, self.limit);
        let output = others + sum;
        let excess = output - clamp(output, self.limit);
        self.sum = if excess == 0 {
            sum
        } else {
            // Not further into the limit, and back by what is too much, as far as zero.
            let kept = if (excess > 0) == (increment > 0) {
                self.sum
            } else {
                sum
            };
            let back = (clamp(excess, TERM_LIMIT) >> 16) * self.unwind;
            if excess > 0 {
                (kept - back).max(kept.min(0))
            } else {
                (kept - back).min(kept.max(0))
            }
        };
        I16F16::from_bits((clamp(output, self.limit) >> 16) as i32)
    }

    /// The integral part, percent.
    #[must_use]
    pub const fn integral(&self) -> I16F16 {
        I16F16::from_bits((self.sum >> 16) as i32)
    }
}

#[cfg(test)]
mod tests;
