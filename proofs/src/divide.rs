//! T5: division, digit by digit.

use fw_core::divide::digit;

use crate::property::Seen;

/// A digit and the rest after it make up the rest before it and the dividend's digit, and the rest stays
/// below the divisor. So by induction `div_rem` is the division.
pub fn digit_of_a_division_is_exact(rest: u64, next: bool, divisor: u64) -> Seen {
    given!(rest < divisor && rest < 1 << 63);
    let (one, after) = digit(rest, next.into(), divisor);
    assert!(one <= 1 && after < divisor);
    let whole = if one == 1 { divisor } else { 0 };
    assert!(2 * u128::from(rest) + u128::from(next) == u128::from(whole) + u128::from(after));
    seen!(one == 1, divisor > 1 << 63, after == 0)
}

crate::properties! {
    theorem T5 digit_of_a_division_is_exact(rest: u64, next: bool, divisor: u64) {
        cases ["a one", "a divisor of 64 bits", "no rest"];
        kani proof [unwind(4)];
        stepped (1..=300).map(|below| u64::MAX - below).chain(1..=300).flat_map(|divisor| {
            (0..300).map(move |rest| (rest % divisor, rest % 2 == 1, divisor))
        });
        sampled 100_000;
    }
}
