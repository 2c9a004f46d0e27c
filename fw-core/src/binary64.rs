//! IEEE-754 binary64 as the wire and the EEPROM carry it: bits, decoded without a float instruction.
//!
//! Every one of the 2⁶⁴ patterns decodes to the nearest fixed-point number (ties to the even one,
//! as IEEE-754 rounds) or to a named error.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "fields are cut to their width on purpose"
)]

use fixed::types::I32F32;

/// A binary64 as its 64 bits; `f64::to_bits` makes one, `f64::from_bits` reads one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Binary64(pub u64);

/// Why a binary64 has no fixed-point equal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binary64Error {
    /// Not a number.
    NotANumber,
    /// Plus or minus infinity.
    Infinite,
    /// Finite, but beyond the fixed-point type.
    OutOfRange,
}

/// Bits of the fraction.
const FRACTION_BITS: u32 = 52;
/// The implicit leading one.
const LEADING: u64 = 1 << FRACTION_BITS;
const SIGN: u64 = 1 << 63;
/// The exponent field of infinities and NaNs.
const SPECIAL: u64 = 0x7FF << FRACTION_BITS;
/// The exponent field of 1.0, plus the bits of the fraction: 2 to the power of (field − this) is
/// what the last bit of the fraction is worth.
const BIAS: i32 = 1023 + FRACTION_BITS as i32;

impl Binary64 {
    /// Whether it is neither NaN nor infinite.
    #[must_use]
    pub const fn is_finite(self) -> bool {
        self.0 & SPECIAL != SPECIAL
    }

    /// The bits without the sign; for numbers, they order like the absolute values.
    #[must_use]
    pub const fn magnitude(self) -> u64 {
        self.0 & !SIGN
    }

    /// The nearest integer to the number × 2^`fraction_bits`, ties to even: a fixed-point number
    /// with that many fraction bits.
    ///
    /// # Errors
    /// NaN, infinite, or beyond ±2⁶³ after scaling.
    // Requirement: DOC-5.1.2-1
    pub const fn to_scaled(self, fraction_bits: u8) -> Result<i64, Binary64Error> {
        let negative = self.0 & SIGN != 0;
        let field = (self.magnitude() >> FRACTION_BITS) as i32;
        let fraction = self.0 & (LEADING - 1);
        if !self.is_finite() {
            return Err(if fraction == 0 {
                Binary64Error::Infinite
            } else {
                Binary64Error::NotANumber
            });
        }
        // Subnormal numbers have no leading one and the exponent of the smallest normal ones.
        let (significand, field) = if field == 0 {
            (fraction, 1)
        } else {
            (fraction | LEADING, field)
        };
        let shift = field.wrapping_sub(BIAS).wrapping_add(fraction_bits as i32);
        let magnitude = if shift > 11 {
            // A subnormal never gets here: its exponent is far below what 255 fraction bits lift.
            return Err(Binary64Error::OutOfRange);
        } else if shift >= 0 {
            // 53 bits, up by at most 11: 64.
            significand << shift
        } else if shift <= -(FRACTION_BITS as i32 + 2) {
            // Below one half.
            0
        } else {
            let down = shift.unsigned_abs();
            let kept = significand >> down;
            let lost = significand & (1_u64 << down).wrapping_sub(1);
            let half = 1_u64 << (down.wrapping_sub(1));
            let up = lost > half || (lost == half && kept & 1 == 1);
            kept.wrapping_add(up as u64)
        };
        if magnitude < SIGN {
            let value = magnitude as i64;
            Ok(if negative {
                value.wrapping_neg()
            } else {
                value
            })
        } else if negative && magnitude == SIGN {
            Ok(i64::MIN)
        } else {
            Err(Binary64Error::OutOfRange)
        }
    }

    /// The nearest number with 32 integer and 32 fraction bits, ties to even.
    ///
    /// # Errors
    /// NaN, infinite, or beyond ±2³¹.
    pub fn to_fixed(self) -> Result<I32F32, Binary64Error> {
        self.to_scaled(32).map(I32F32::from_bits)
    }

    /// The number `value` / 2^`fraction_bits`: exact up to 53 significant bits, else the nearest,
    /// ties to even. Zero is +0.
    pub const fn from_scaled(value: i64, fraction_bits: u8) -> Self {
        if value == 0 {
            return Self(0);
        }
        let magnitude = value.unsigned_abs();
        // The leading one at bit 63, then eleven bits rounded away.
        let zeros = magnitude.leading_zeros();
        let aligned = magnitude << zeros;
        let kept = aligned >> 11;
        let lost = aligned & 0x7FF;
        let up = lost > 0x400 || (lost == 0x400 && kept & 1 == 1);
        // The leading one is at bit 63 − zeros of the value; it adds one to the exponent field, and
        // a carry out of the rounding adds another, as it should.
        let field = (1023 + 62_u64)
            .wrapping_sub(zeros as u64)
            .wrapping_sub(fraction_bits as u64);
        let bits = (field << FRACTION_BITS)
            .wrapping_add(kept)
            .wrapping_add(up as u64);
        Self(if value < 0 { bits | SIGN } else { bits })
    }

    /// The number as binary64: exact up to 53 significant bits (every I32F32 below 2²¹ in
    /// magnitude), else the nearest, ties to even.
    pub fn from_fixed(value: I32F32) -> Self {
        Self::from_scaled(value.to_bits(), 32)
    }
}

#[cfg(test)]
mod tests {
    //! Decoding is theorem T4's.
    #![allow(clippy::cast_precision_loss, reason = "the rounding that is expected")]
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn first_boards_factor_is_exact() {
        let factor = Binary64(106.75_f64.to_bits());
        assert_eq!(factor.to_fixed(), Ok(I32F32::lit("106.75")));
        assert_eq!(Binary64::from_fixed(I32F32::lit("106.75")), factor);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100_000))]

        #[test]
        fn integer_becomes_the_nearest_double(value in any::<i64>(), cut in 0_u32..63, bits in 0_u8..64) {
            for value in [value, value >> cut] {
                // The conversion rounds to the nearest, ties to even; the scaling is exact.
                let expected = value as f64 / 2_f64.powi(bits.into());
                prop_assert_eq!(Binary64::from_scaled(value, bits).0, expected.to_bits());
            }
        }
    }
}
