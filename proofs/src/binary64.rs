//! T4: every binary64 to the nearest fixed-point number or a named error, and back.

use fw_core::binary64::{Binary64, Binary64Error};

use crate::property::Seen;

/// The magnitude of a finite double as `significand · 2^exponent`, exactly.
const fn parts(bits: u64) -> (u64, i32) {
    let field = (bits >> 52 & 0x7FF) as i32;
    let fraction = bits & 0xF_FFFF_FFFF_FFFF;
    if field == 0 {
        (fraction, -1074)
    } else {
        (1 << 52 | fraction, field - 1075)
    }
}

/// The result is the integer nearest to the number times 2^`fraction_bits`, the even one of two, or
/// the error that says why there is none.
// Requirement: DOC-5.1.2-1
pub fn decoding_is_nearest(double: Binary64, fraction_bits: u8) -> Seen {
    let Binary64(bits) = double;
    let decoded = double.to_scaled(fraction_bits);
    let (significand, exponent) = parts(bits);
    let special = bits >> 52 & 0x7FF == 0x7FF;
    if special {
        let infinite = bits << 12 == 0;
        assert!(infinite == (decoded == Err(Binary64Error::Infinite)));
        assert!(infinite != (decoded == Err(Binary64Error::NotANumber)));
        return Seen::NOTHING.case(0, infinite).case(1, !infinite);
    }
    let negative = bits >> 63 == 1;
    let shift = exponent + i32::from(fraction_bits);
    let Ok(value) = decoded else {
        assert!(decoded == Err(Binary64Error::OutOfRange));
        // Too large whichever way it is rounded: a magnitude of 2⁶³, and not −2⁶³ itself.
        assert!(shift >= 11 || (shift > 0 && significand >> (63 - shift) != 0));
        assert!(!(negative && shift == 11 && significand == 1 << 52));
        return Seen::NOTHING.case(2, true);
    };
    let magnitude = value.unsigned_abs();
    assert!(value == 0 || (value < 0) == negative);
    if shift >= 0 {
        assert!(shift <= 11 || significand == 0);
        assert!(significand == 0 || magnitude == significand << (shift & 63));
    } else if shift < -54 {
        assert!(magnitude == 0);
    } else {
        // Both sides times 2^−shift: what is missing is at most half of the last place.
        let down = shift.unsigned_abs();
        let missing = significand.abs_diff(magnitude << down);
        assert!(magnitude <= 1 << 53 && missing <= 1 << (down - 1));
        assert!(missing < 1 << (down - 1) || magnitude & 1 == 0);
    }
    Seen::NOTHING
        .case(3, shift >= 0 && significand != 0)
        .case(4, shift < -54)
        .case(5, (-54..0).contains(&shift) && magnitude != 0)
}

/// A fixed-point number that has at most 53 significant bits is a double exactly, and back itself.
pub fn encoding_is_exact_up_to_53_bits(value: i64, fraction_bits: u8) -> Seen {
    let back = Binary64::from_scaled(value, fraction_bits).to_scaled(fraction_bits);
    let magnitude = value.unsigned_abs();
    if magnitude >> 53 == 0 {
        assert!(back == Ok(value));
    } else if let Ok(back) = back {
        // The nearest of what a double can say: at most half of its last place off.
        let places = 11 - magnitude.leading_zeros();
        assert!(back.abs_diff(value) <= 1 << (places - 1));
    } else {
        // Only a number that rounds up to 2⁶³ does not come back.
        assert!(value > 0 && magnitude >> 9 == u64::MAX >> 10);
    }
    Seen::NOTHING
        .case(0, magnitude >> 53 == 0)
        .case(1, magnitude >> 53 != 0 && back == Ok(value))
        .case(2, back.is_ok() && back != Ok(value))
        .case(3, back.is_err())
}

crate::properties! {
    theorem T4 decoding_is_nearest(double: Binary64, fraction_bits: u8) {
        cases [
            "infinite", "not a number", "out of range", "exact", "below the last place", "rounded"
        ];
        kani q16 [unwind(4)] = (any(), 16);
        kani q32 [unwind(4)] = (any(), 32);
        kani any_scale [unwind(4)] = (any(), any());
        sampled 2_000_000;
    }
    theorem T4 encoding_is_exact_up_to_53_bits(value: i64, fraction_bits: u8) {
        cases ["exact", "exact though long", "rounded", "rounded out of range"];
        kani q32 [unwind(4)] = (any(), 32);
        kani any_scale [unwind(4)] = (any(), any());
        sampled 1_000_000;
    }
}
