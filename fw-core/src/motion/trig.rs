//! Sine, cosine and direction of fixed-point turns: no table, no branch on the angle, one division, in
//! [`direction`].
//!
//! A phase is reduced to the eighth of a turn on either side of the nearest quadrant. There one
//! polynomial gives the sine and one gives `1 − cos`: minimax (Remez) in the square of the reduced
//! phase, by Horner's rule on rounded high words of signed products, one instruction (SMMLAR) a step.
//!
//! | function | absolute error over all phases | source of the bound |
//! |---|---|---|
//! | [`sin_cos`] | ≤ 5.8e-10 | exhaustive property in `proofs`, sampled below |
//! | `Reduced`'s sine | ≤ 3.4e-10 | sampled below |
//! | `Reduced`'s cosine | ≤ 3.6e-10 | sampled below |
//! | [`direction`] | ≤ 8e-6 turns | sampled property in `proofs` |

use crate::types::Turns;
/// High word of a product, floor.
const fn high(a: u32, b: u32) -> u32 {
    ((a as u64 * b as u64) >> 32) as u32
}

/// High word of a signed product, floor: one instruction, SMMUL.
pub(crate) const fn upper(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
}

/// High word of a signed product, nearest: SMMULR.
pub(crate) const fn nearest(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64 + (1 << 31)) >> 32) as i32
}

/// `c` and the high word of a signed product, nearest: SMMLAR.
pub(crate) const fn plus(c: i32, a: i32, b: i32) -> i32 {
    c.wrapping_add(nearest(a, b))
}

/// The signed words (low, high) of `high·2³² + low`.
pub(crate) const fn split(value: i64) -> (i32, i32) {
    let low = value as i32;
    let high = ((value >> 32) as i32).wrapping_add((low as u32 >> 31) as i32);
    (low, high)
}

/// A phase as the nearest quarter turn and sine and cosine of the remainder, at most an eighth of a turn
/// either way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Reduced {
    /// Quarter turns, 0 ..= 3.
    pub quarter: u32,
    /// Minus the remainder's sine, Q62, within ±0.7072.
    pub minus_sine: i64,
    /// The remainder's cosine, Q62, 0.7071 ..= 1.
    pub cosine: i64,
}

impl Reduced {
    /// Of `phase` in 2⁻⁶⁴ turns, of which the upper 34 bits count. Total: every phase has one.
    #[inline]
    pub const fn of(phase: u64) -> Self {
        let quarter = ((phase >> 32) as u32).wrapping_add(1 << 29) >> 30;
        // Eighths of a turn, Q31: shifting the quarters out leaves the right sign bit.
        let u = ((phase << 2) >> 32) as i32;
        // −u², Q30, so that 1 fits: its products have two fractional bits less than the other factor, and
        // the coefficients' formats follow, so that no step shifts. All are negative: LLVM takes a known
        // positive factor for unsigned, and has no single instruction for a mixed product.
        let w = -nearest(u, u);
        // sin(π/4·u) = u·p(u²): Q39, Q37, Q35, Q33, Q31.
        let p = plus(-5_026_545, w, -169_985);
        let p = plus(-85_569_276, w, p);
        let p = plus(-693_598_668, w, p);
        let p = plus(-1_686_629_713, w, p);
        // 1 − cos(π/4·u) = u²·q(u²): Q38, Q36, Q34, Q32.
        let q = plus(-22_398_599, w, -970_753);
        let q = plus(-272_375_283, w, q);
        let q = plus(-1_324_675_872, w, q);
        Self {
            quarter,
            minus_sine: u as i64 * p as i64,
            cosine: (1 << 62) - w as i64 * q as i64,
        }
    }
}

/// Sine and cosine of `phase`, Q31 (one is `i32::MAX`), absolute error ≤ 5.8e-10.
// One copy in flash.
#[inline(never)]
pub const fn sin_cos(phase: Turns) -> (i32, i32) {
    let reduced = Reduced::of((phase.0 as u64) << 32);
    let minus_sine = ((reduced.minus_sine + (1 << 30)) >> 31) as i32;
    // 1 itself does not fit: the largest cosine is 1 − 2⁻³¹.
    let cosine = (reduced.cosine + (1 << 30)) >> 31;
    let cosine = (cosine - (cosine >> 31)) as i32;
    match reduced.quarter {
        0 => (-minus_sine, cosine),
        1 => (cosine, minus_sine),
        2 => (minus_sine, -cosine),
        _ => (-cosine, -minus_sine),
    }
}

/// The direction of the vector (x, y), error ≤ 8e-6 turns (0.003°); 0 for the zero vector. Any unit
/// that both share.
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
    // The top bit is set already; the `|` removes the compiler's check for zero.
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
    use super::*;
    use std::f64::consts::TAU;

    const TURN: f64 = 4_294_967_296.0;

    #[test]
    fn sine_and_cosine_are_within_their_bounds() {
        let reduced = (0..1 << 30).step_by(101);
        let reduced = reduced.map(|phase: u32| phase.wrapping_sub(1 << 29));
        let all = (0..=u32::MAX).step_by(4099);
        let edges =
            (0..32u32).flat_map(|e| (0..5).map(move |k| (e << 27).wrapping_add(k).wrapping_sub(2)));
        let mut worst = [0.0f64; 4];
        for phase in reduced.chain(all).chain(edges) {
            let angle = f64::from(phase as i32) / TURN * TAU;
            let (sine, cosine) = sin_cos(Turns(phase));
            let (s, c) = angle.sin_cos();
            worst[0] = worst[0].max((f64::from(sine) / 2_147_483_648.0 - s).abs());
            worst[1] = worst[1].max((f64::from(cosine) / 2_147_483_648.0 - c).abs());
            // The upper 34 bits count: two more than a phase has.
            let extra = phase & 3;
            let reduced = Reduced::of(u64::from(phase) << 32 | u64::from(extra) << 30);
            let rest = angle - f64::from(reduced.quarter) * TAU / 4.0
                + f64::from(extra) / (4.0 * TURN) * TAU;
            let (s, c) = rest.sin_cos();
            worst[2] = worst[2].max((reduced.minus_sine as f64 / 2f64.powi(62) + s).abs());
            worst[3] = worst[3].max((reduced.cosine as f64 / 2f64.powi(62) - c).abs());
        }
        std::println!("sine, cosine, reduced sine, reduced cosine: {worst:?}");
        assert!(worst[0] <= 5.8e-10 && worst[1] <= 5.8e-10);
        assert!(worst[2] <= 3.4e-10 && worst[3] <= 3.6e-10);
    }
}
