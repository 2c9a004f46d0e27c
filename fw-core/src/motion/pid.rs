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

use crate::double::Double;
use crate::eeprom::Gains;

/// Largest factor that fits; the EEPROM's are at most 10 000.
const LARGEST: i64 = (1 << 14 << 32) - 1;

/// A factor of the document, 32 fractional bits, within ±[`LARGEST`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Factor(i64);

impl Factor {
    /// The nearest; 0 for what is no number or beyond 2³¹, which no accepted configuration holds.
    // At start-up only: once in flash is enough.
    #[inline(never)]
    fn new(value: Double) -> Self {
        Self(value.to_scaled(32).unwrap_or(0).clamp(-LARGEST, LARGEST))
    }

    /// `self · value`, floor, 2⁻³² where `value` is in 2⁻¹⁶; below 2⁶¹.
    #[inline]
    const fn times(self, value: i32) -> i64 {
        let upper = (self.0 >> 32) * value as i64;
        let lower = (self.0 & 0xFFFF_FFFF) * value as i64;
        (upper << 16) + (lower >> 16)
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
    #[must_use]
    pub fn new(gains: &Gains, limit: I16F16) -> Self {
        let unwind = Factor::new(gains.anti_windup).0 >> 16;
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
        let increment = if proportional.abs() <= self.near {
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
            let back = (excess >> 16) * self.unwind;
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
