//! Division of 64-bit numbers, for start-up and the log.
//!
//! The core has a 32-bit division instruction and no 64-bit one; the compiler's own routine for it is
//! as large as the whole pose controller. Nothing that runs every tick divides 64 bits, so one bit a
//! turn is fast enough.

/// A binary digit of a division by `d`, and the rest after it: `next`, 0 or 1, is the dividend's digit
/// behind the `rest` so far, which is below `d` and below 2⁶³. 2·`rest` + `next` = `d`·digit + rest after it.
#[inline]
pub const fn digit(rest: u64, next: u64, d: u64) -> (u64, u64) {
    let rest = (rest << 1) | next;
    if rest >= d {
        // Wraps for no input: `proofs` shows that the digit is exact.
        (1, rest.wrapping_sub(d))
    } else {
        (0, rest)
    }
}

/// `(n / d, n % d)`; by zero `(u64::MAX, n)`.
#[inline(never)]
pub const fn div_rem(n: u64, d: u64) -> (u64, u64) {
    let mut quotient = n;
    let mut rest = 0_u64;
    let mut bit = 0;
    while bit < 64 {
        // The rest has as many bits of `n` as turns, so far: it is below 2⁶³.
        let one;
        (one, rest) = digit(rest, quotient >> 63, d);
        quotient = (quotient << 1) | one;
        bit += 1;
    }
    (quotient, if d == 0 { n } else { rest })
}

/// `n / d` in Q16 to 15 significant bits where it is at most 1, fewer above, by one 32-bit division;
/// never above 2³². By zero as by the smallest number.
#[inline(never)]
pub const fn ratio(n: u64, d: u64) -> u32 {
    // Both by the same shift to the top of a word, the divisor cut to its half.
    let spare = (n | d | 1).leading_zeros();
    let n = ((n << spare) >> 32) as u32;
    let d = ((d << spare) >> 48) as u32;
    n / if d == 0 { 1 } else { d }
}

#[cfg(test)]
mod tests {
    use super::{div_rem, ratio};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_the_compilers_division(n: u64, d: u64, shift in 0..64) {
            let d = d >> shift;
            prop_assume!(d != 0);
            prop_assert_eq!(div_rem(n, d), (n / d, n % d));
        }
    }

    proptest! {
        #[test]
        fn a_ratio_up_to_one_is_within_15_bits(n: u64, d: u64, shift in 0..48) {
            let (n, d) = (n.min(d) >> shift, n.max(d) >> shift);
            prop_assume!(d >= 1 << 16);
            let exact = (u128::from(n) << 16) / u128::from(d);
            prop_assert!(u128::from(ratio(n, d)).abs_diff(exact) <= 1 + (exact >> 14));
        }

        #[test]
        fn a_ratio_above_one_is_above_one(n: u64, d: u64) {
            prop_assume!(n > d);
            prop_assert!(ratio(n, d) >= 1 << 16);
        }
    }

    #[test]
    fn the_ends_are_right_too() {
        for n in [0, 1, 2, u64::MAX - 1, u64::MAX, 1 << 63, (1 << 63) - 1] {
            for d in [1, 2, 3, u64::MAX - 1, u64::MAX, 1 << 63, (1 << 63) - 1] {
                assert_eq!(div_rem(n, d), (n / d, n % d), "{n} / {d}");
            }
            assert_eq!(div_rem(n, 0), (u64::MAX, n));
        }
    }
}
