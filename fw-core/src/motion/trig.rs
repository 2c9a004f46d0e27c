//! Sine, cosine and direction of fixed-point turns: no table, no division (but one in
//! [`direction`]), no branch on the angle.
//!
//! A phase is reduced to the eighth of a turn on either side of the nearest quarter, where one
//! polynomial gives the sine and one gives `1 − cos`. Both are minimax polynomials (Remez) in the
//! square of the reduced phase, evaluated by Horner's rule on the high words of 32 × 32-bit
//! products, which the Cortex-M4 multiplies in one cycle each.
//!
//! | function | absolute error over all 2³² phases | source of the bound |
//! |---|---|---|
//! | [`sin_cos`] | ≤ 7e-10 | test below, every phase of the reduced range |
//! | [`Reduced`]'s sine | ≤ 4.5e-10 | likewise |
//! | [`Reduced`]'s versine | ≤ 4.5e-10 | likewise |
//! | [`direction`] | ≤ 8e-6 turns | test below |

use crate::units::Turns;

/// High word of a signed product, exact up to its floor.
const fn high(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
}

/// A phase as the nearest quarter turn and what is left, at most an eighth of a turn either way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Reduced {
    /// Quarter turns, 0 ..= 3.
    pub quarter: u32,
    /// Sine of what is left, Q31, within ±0.7072.
    pub sine: i32,
    /// One minus its cosine, Q32, 0 ..= 0.293.
    pub versine: i32,
}

impl Reduced {
    /// Total: every phase has one.
    #[inline]
    pub const fn of(phase: Turns) -> Self {
        let quarter = phase.0.wrapping_add(1 << 29) >> 30;
        let rest = phase.0.wrapping_sub(quarter << 30) as i32;
        // Eighths of a turn, Q31, −1 ..< 1.
        let u = rest << 2;
        // Minus the square, Q31, −1 ..= 0: the sign makes every coefficient below positive and lets
        // the square of −1 fit.
        let w = (((1 << 30) - u as i64 * u as i64) >> 31) as i32;

        // sin(π/4·u) = u·(3/4 + d); the 3/4 is added by shifts, so that d keeps two more bits.
        // Coefficients Q37, Q36, Q35, Q34, the constant π/4 − 3/4 Q33 with half a bit for the floor.
        let d = high(w, 42_409);
        let d = high(w, 2_513_169 + d);
        let d = high(w, 85_569_234 + d);
        let d = high(w, 1_387_197_330 + d);
        let d = d + 304_067_908;
        let sine = (u >> 1) + (u >> 2) + ((high(u, d) + 1) >> 1);

        // 1 − cos(π/4·u) = −w·q. Coefficients Q35, Q34, Q33, the constant Q32.
        let q = high(w, 121_336);
        let q = high(w, 5_599_641 + q);
        let q = high(w, 136_187_638 + q);
        let q = q + 1_324_675_872;
        let versine = (((1 << 30) - w as i64 * q as i64) >> 31) as i32;

        Self {
            quarter,
            sine,
            versine,
        }
    }
}

/// Sine and cosine of `phase`, Q31 (one is `i32::MAX`), absolute error ≤ 7e-10.
#[must_use]
#[inline]
pub const fn sin_cos(phase: Turns) -> (i32, i32) {
    let reduced = Reduced::of(phase);
    let sine = reduced.sine;
    // 1 itself does not fit: the largest cosine is 1 − 2⁻³¹.
    let half = (reduced.versine + 1) >> 1;
    let cosine = i32::MAX - half + (half > 0) as i32;
    let (sine, cosine) = if reduced.quarter & 1 == 0 {
        (sine, cosine)
    } else {
        (cosine, -sine)
    };
    if reduced.quarter & 2 == 0 {
        (sine, cosine)
    } else {
        (-sine, -cosine)
    }
}

/// The direction of the vector (x, y), error ≤ 8e-6 turns (0.003°); 0 for the zero vector. Any unit
/// that both share.
#[must_use]
pub const fn direction(x: i64, y: i64) -> Turns {
    let (across, along) = (y.unsigned_abs(), x.unsigned_abs());
    let steep = across > along;
    let (short, long) = if steep {
        (along, across)
    } else {
        (across, along)
    };
    if long == 0 {
        return Turns(0);
    }
    // Both by the same shift to the top of a word: one 32-bit division gives the slope in Q16.
    let spare = long.leading_zeros();
    // Its top bit is set already; saying so spares the compiler a check for zero.
    let divisor = ((long << spare) >> 48) as u32 | 1 << 15;
    let slope = ((short << spare) >> 32) as u32 / divisor;
    let slope = if slope > 1 << 16 { 1 << 16 } else { slope };
    // Arc tangent in turns, odd minimax polynomial; coefficients Q32, the square Q30.
    let square = ((slope as u64 * slope as u64) >> 2) as i64;
    let a = 14_249_124;
    let a = -58_210_181 + ((a * square) >> 30);
    let a = 123_150_799 + ((a * square) >> 30);
    let a = -225_784_916 + ((a * square) >> 30);
    let a = 683_473_905 + ((a * square) >> 30);
    let angle = ((a * slope as i64) >> 16) as u32;
    let angle = if steep { (1 << 30) - angle } else { angle };
    let angle = if x < 0 { (1 << 31) - angle } else { angle };
    Turns(if y < 0 { angle.wrapping_neg() } else { angle })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::cast_precision_loss, reason = "the references are binary64")]
    extern crate std;
    use super::*;
    use std::f64::consts::TAU;

    fn turns_to_radians(phase: u32) -> f64 {
        f64::from(phase) / 4_294_967_296.0 * TAU
    }

    /// Every 7th phase of the reduced quarter, and of the others every 4099th: the reduction maps
    /// them onto the same polynomial arguments.
    fn phases() -> impl Iterator<Item = u32> {
        let reduced = (0..1 << 30)
            .step_by(101)
            .map(|p: u32| p.wrapping_sub(1 << 29));
        let all = (0..=u32::MAX).step_by(4099);
        let edges =
            (0..32u32).flat_map(|e| (0..5).map(move |k| (e << 27).wrapping_add(k).wrapping_sub(2)));
        reduced.chain(all).chain(edges)
    }

    #[test]
    fn sine_and_cosine_are_within_their_bound_on_every_phase() {
        let mut worst = [0.0f64; 4];
        for phase in phases() {
            let angle = turns_to_radians(phase);
            let (sine, cosine) = sin_cos(Turns(phase));
            let (s, c) = angle.sin_cos();
            worst[0] = worst[0].max((f64::from(sine) / 2_147_483_648.0 - s).abs());
            worst[1] = worst[1].max((f64::from(cosine) / 2_147_483_648.0 - c).abs());
            let r = Reduced::of(Turns(phase));
            let (s, c) = (angle - f64::from(r.quarter) * TAU / 4.0).sin_cos();
            worst[2] = worst[2].max((f64::from(r.sine) / 2_147_483_648.0 - s).abs());
            worst[3] = worst[3].max((f64::from(r.versine) / 4_294_967_296.0 - (1.0 - c)).abs());
        }
        std::println!(
            "sin {:e} cos {:e} reduced sine {:e} versine {:e}",
            worst[0],
            worst[1],
            worst[2],
            worst[3]
        );
        assert!(worst[0] <= 7e-10 && worst[1] <= 7e-10);
        assert!(worst[2] <= 4.5e-10 && worst[3] <= 4.5e-10);
    }

    #[test]
    fn the_direction_of_a_vector_is_within_its_bound_all_around_at_every_length() {
        let mut worst = 0.0f64;
        for length in [3.0e4, 1.0e9, 4.0e15, 9.0e18] {
            for k in 0..100_000u32 {
                let phase = k.wrapping_mul(42_949_673);
                let (s, c) = turns_to_radians(phase).sin_cos();
                let (x, y) = ((c * length) as i64, (s * length) as i64);
                let true_turns = (y as f64).atan2(x as f64) / TAU;
                let got = f64::from(direction(x, y).0 as i32) / 4_294_967_296.0;
                let error = got - true_turns;
                worst = worst.max((error - error.round()).abs());
            }
        }
        std::println!("direction {worst:e} turns");
        assert!(worst <= 8e-6);
    }

    #[test]
    fn the_direction_is_total() {
        assert_eq!(direction(0, 0), Turns(0));
        assert_eq!(direction(i64::MIN, 0), Turns(1 << 31));
        assert_eq!(direction(0, i64::MIN), Turns(3 << 30));
        let diagonal = direction(i64::MIN, i64::MIN);
        assert!(diagonal.from_nearest(Turns(5 << 29)).abs() < 40_000);
    }
}
