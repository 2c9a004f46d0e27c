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
#[allow(clippy::cast_precision_loss, reason = "the rounding that is expected")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scaled(value: f64, bits: u8) -> Result<i64, Binary64Error> {
        Binary64(value.to_bits()).to_scaled(bits)
    }

    /// The nearest integer to value · 2^bits, by the host's own arithmetic: scaling by a power of
    /// two is exact unless it leaves binary64's range, which 63 bits cannot do upwards and which
    /// downwards does not happen.
    fn by_float(value: f64, bits: u8) -> Result<i64, Binary64Error> {
        if value.is_nan() {
            return Err(Binary64Error::NotANumber);
        }
        if value.is_infinite() {
            return Err(Binary64Error::Infinite);
        }
        let nearest = (value * 2_f64.powi(bits.into())).round_ties_even();
        if (-9_223_372_036_854_775_808.0..9_223_372_036_854_775_808.0).contains(&nearest) {
            Ok(nearest as i64)
        } else {
            Err(Binary64Error::OutOfRange)
        }
    }

    #[test]
    fn what_is_not_a_number_is_named() {
        assert_eq!(scaled(f64::NAN, 32), Err(Binary64Error::NotANumber));
        assert_eq!(scaled(-f64::NAN, 32), Err(Binary64Error::NotANumber));
        assert_eq!(scaled(f64::INFINITY, 32), Err(Binary64Error::Infinite));
        assert_eq!(scaled(f64::NEG_INFINITY, 32), Err(Binary64Error::Infinite));
        assert_eq!(
            Binary64(0x7FF0_0000_0000_0001).to_scaled(0),
            Err(Binary64Error::NotANumber)
        );
    }

    #[test]
    fn the_ends_of_the_range_are_exact() {
        let end = 2_f64.powi(31);
        assert_eq!(scaled(-end, 32), Ok(i64::MIN));
        assert_eq!(scaled(end, 32), Err(Binary64Error::OutOfRange));
        assert_eq!(scaled(end.next_down(), 32), Ok(i64::MAX - 1023));
        assert_eq!(
            scaled((-end).next_down(), 32),
            Err(Binary64Error::OutOfRange)
        );
        assert_eq!(scaled(f64::MAX, 0), Err(Binary64Error::OutOfRange));
        assert_eq!(scaled(f64::MAX, 255), Err(Binary64Error::OutOfRange));
    }

    #[test]
    fn ties_go_to_the_even_neighbour() {
        let cases = [
            (0.5, 0),
            (1.5, 2),
            (2.5, 2),
            (-0.5, 0),
            (-1.5, -2),
            (-2.5, -2),
            (0.25, 0),
        ];
        for (value, nearest) in cases {
            assert_eq!(scaled(value, 0), Ok(nearest));
        }
        assert_eq!(scaled(0.5_f64.next_up(), 0), Ok(1));
        assert_eq!(scaled(0.5_f64.next_down(), 0), Ok(0));
    }

    #[test]
    fn zeros_and_the_smallest_numbers_are_zero() {
        for value in [
            0.0,
            -0.0,
            f64::from_bits(1),
            f64::MIN_POSITIVE,
            -f64::MIN_POSITIVE,
        ] {
            for bits in 0..=255 {
                assert_eq!(scaled(value, bits), Ok(0));
            }
        }
    }

    #[test]
    fn the_first_boards_factors_are_what_they_say() {
        assert_eq!(scaled(6.5088, 32), Ok(27_955_083_136));
        assert_eq!(
            Binary64(106.75_f64.to_bits()).to_fixed(),
            Ok(I32F32::lit("106.75"))
        );
    }

    fn interesting() -> impl Strategy<Value = f64> {
        let bits = any::<u64>().prop_map(f64::from_bits);
        // Exponents around those that fit, few bits set so that ties occur.
        let near = (960_u64..1100, any::<u64>(), 0_u32..53, any::<bool>()).prop_map(
            |(field, fraction, cut, negative)| {
                let fraction = fraction & (LEADING - 1) & !((1 << cut) - 1);
                f64::from_bits(u64::from(negative) << 63 | field << 52 | fraction)
            },
        );
        prop_oneof![bits, near]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100_000))]

        #[test]
        fn a_double_becomes_the_nearest_integer(value in interesting(), bits in 0_u8..64) {
            prop_assert_eq!(scaled(value, bits), by_float(value, bits));
        }

        #[test]
        fn an_integer_becomes_the_nearest_double(value in any::<i64>(), cut in 0_u32..63, bits in 0_u8..64) {
            for value in [value, value >> cut] {
                // The conversion rounds to the nearest, ties to even; the scaling is exact.
                let expected = value as f64 / 2_f64.powi(bits.into());
                prop_assert_eq!(Binary64::from_scaled(value, bits).0, expected.to_bits());
            }
        }

        #[test]
        fn fifty_three_bits_go_there_and_back(value in -1_i64 << 53..=1 << 53, bits in 0_u8..64) {
            prop_assert_eq!(Binary64::from_scaled(value, bits).to_scaled(bits), Ok(value));
            let fixed = I32F32::from_bits(value);
            prop_assert_eq!(Binary64::from_fixed(fixed).to_fixed(), Ok(fixed));
        }

        #[test]
        fn any_pattern_is_decoded(pattern in any::<u64>(), bits in any::<u8>()) {
            let value = Binary64(pattern);
            prop_assert_eq!(value.is_finite(), f64::from_bits(pattern).is_finite());
            prop_assert!(value.is_finite() || value.to_scaled(bits).is_err());
        }
    }
}
