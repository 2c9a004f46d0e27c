//! Sine, cosine and direction of fixed-point turns: no table, no division (but one in
//! [`direction`]), no branch on the angle.
//!
//! A phase is reduced to the eighth of a turn on either side of the nearest quarter, where one
//! polynomial gives the sine and one gives `1 − cos`. Both are minimax polynomials (Remez) in the
//! square of the reduced phase, evaluated by Horner's rule on the high words of unsigned
//! 32 × 32-bit products, which the Cortex-M4 multiplies in one cycle each.
//!
//! | function | absolute error over all 2³² phases | source of the bound |
//! |---|---|---|
//! | [`sin_cos`] | ≤ 5.2e-10 | every phase of the reduced range tried; the test below samples |
//! | `Reduced`'s sine | ≤ 3.7e-10 | likewise |
//! | `Reduced`'s versine | ≤ 2.8e-10 | likewise |
//! | [`direction`] | ≤ 8e-6 turns | test below |

use crate::units::Turns;

/// High word of a product, floor.
#[inline]
pub(crate) const fn high(a: u32, b: u32) -> u32 {
    ((a as u64 * b as u64) >> 32) as u32
}

/// High word of a product, nearest.
#[inline]
pub(crate) const fn nearest(a: u32, b: u32) -> u32 {
    ((a as u64 * b as u64 + (1 << 31)) >> 32) as u32
}

/// A phase as the nearest quarter turn and what is left, at most an eighth of a turn either way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Reduced {
    /// Quarter turns, 0 ..= 3.
    pub quarter: u32,
    /// −1 where what is left is negative, else 0.
    pub sign: i32,
    /// Magnitude of the sine of what is left, Q32, up to 0.7072.
    pub sine: u32,
    /// One minus its cosine, Q32, up to 0.293.
    pub versine: u32,
}

impl Reduced {
    /// Total: every phase has one.
    #[inline]
    pub const fn of(phase: Turns) -> Self {
        let quarter = phase.0.wrapping_add(1 << 29) >> 30;
        let rest = phase.0.wrapping_sub(quarter << 30) as i32;
        let sign = rest >> 31;
        // In eighths of a turn, Q32; the eighth itself becomes the number below it.
        let size = rest.unsigned_abs();
        let u = (size << 3).wrapping_sub(size >> 29);
        let w = high(u, u);
        // sin(π/4·u) = u·p(u²). Each product is shifted to its neighbour's fractional bits, which
        // the processor does while it subtracts: Q53, Q46, Q40, Q35, Q32.
        let p = 2_573_484_738 - (high(w, 2_779_292_431) >> 7);
        let p = 2_738_215_488 - (high(w, p) >> 6);
        let p = 2_774_394_660 - (high(w, p) >> 5);
        let p = 3_373_259_426 - (high(w, p) >> 3);
        // 1 − cos(π/4·u) = u²·q(u²): Q50, Q43, Q37, Q33.
        let q = 2_867_016_223 - (high(w, 3_975_929_417) >> 7);
        let q = 2_179_002_214 - (high(w, q) >> 6);
        let q = 2_649_351_743 - (high(w, q) >> 4);
        Self {
            quarter,
            sign,
            sine: nearest(u, p),
            versine: (high(w, q) + 1) >> 1,
        }
    }
}

/// Sine and cosine of `phase`, Q31 (one is `i32::MAX`), absolute error ≤ 5.2e-10.
#[must_use]
#[inline]
pub const fn sin_cos(phase: Turns) -> (i32, i32) {
    let reduced = Reduced::of(phase);
    let sine = ((reduced.sine >> 1) as i32 ^ reduced.sign) - reduced.sign;
    // 1 itself does not fit: the largest cosine is 1 − 2⁻³¹.
    let cosine = ((u32::MAX - reduced.versine.saturating_sub(1)) >> 1) as i32;
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
    let slope = if slope > 0xFFFF { 0xFFFF } else { slope };
    // Arc tangent in turns, odd minimax polynomial, all Q32.
    let w = slope * slope;
    let a = 58_210_181 - high(w, 14_249_124);
    let a = 123_150_799 - high(w, a);
    let a = 225_784_916 - high(w, a);
    let a = 683_473_905 - high(w, a);
    let angle = high(a, slope << 16);
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

    /// Every 101st phase of the reduced quarter, and of the others every 4099th: the reduction maps
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
            // Just below a whole turn counts from zero, as its quarter does.
            let angle = f64::from(phase as i32) / 4_294_967_296.0 * TAU;
            let (sine, cosine) = sin_cos(Turns(phase));
            let (s, c) = angle.sin_cos();
            worst[0] = worst[0].max((f64::from(sine) / 2_147_483_648.0 - s).abs());
            worst[1] = worst[1].max((f64::from(cosine) / 2_147_483_648.0 - c).abs());
            let r = Reduced::of(Turns(phase));
            let rest = angle - f64::from(r.quarter) * TAU / 4.0;
            let sine = f64::from(r.sine) / 4_294_967_296.0 * f64::from(1 + 2 * r.sign);
            worst[2] = worst[2].max((sine - rest.sin()).abs());
            // 1 − cos without its cancellation.
            let half = (rest / 2.0).sin();
            let versine = f64::from(r.versine) / 4_294_967_296.0;
            worst[3] = worst[3].max((versine - 2.0 * half * half).abs());
        }
        std::println!(
            "sin {:e} cos {:e} reduced sine {:e} versine {:e}",
            worst[0],
            worst[1],
            worst[2],
            worst[3]
        );
        assert!(worst[0] <= 5.2e-10 && worst[1] <= 5.2e-10);
        assert!(worst[2] <= 3.7e-10 && worst[3] <= 2.8e-10);
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
