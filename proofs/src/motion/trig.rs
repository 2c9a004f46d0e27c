//! T5 and T6: sine, cosine and direction against the true ones.
//!
//! The references are binary64, exact to 1e-15, and exhaustive: CBMC has no sine.

use fw_core::motion::trig::{direction, sin_cos};

use crate::property::Seen;
use fw_core::types::Turns;

/// Phases of one block.
pub const BLOCK: u32 = 1 << 10;

/// Largest error of sine and cosine, of full scale.
pub const ERROR: f64 = 7e-10;

/// The phase in radians; exact but for the product.
fn radians(phase: u32) -> f64 {
    f64::from(phase) / 4_294_967_296.0 * core::f64::consts::TAU
}

/// Sine and cosine of the 1024 phases from `block` · 1024 on are within 7e-10 of the true ones; 2²⁰ blocks
/// are the reduced range.
pub fn sine_and_cosine_are_accurate(block: u32) -> Seen {
    let first = block.wrapping_mul(BLOCK);
    let (start_sine, start_cosine) = radians(first).sin_cos();
    // Sine and cosine of a small step, by the first terms of their series: exact in binary64.
    let unit = radians(1);
    let (mut worst_sine, mut worst_cosine) = (0.0_f64, 0.0_f64);
    for step in 0..BLOCK {
        let angle = unit * f64::from(step);
        let square = angle * angle;
        let sine = angle * (1.0 - square / 6.0);
        let versine = square / 2.0 * (1.0 - square / 12.0);
        let true_sine = start_sine + (start_cosine * sine - start_sine * versine);
        let true_cosine = start_cosine - (start_sine * sine + start_cosine * versine);
        let (sine, cosine) = sin_cos(Turns(first.wrapping_add(step)));
        worst_sine = worst_sine.max((f64::from(sine) / 2_147_483_648.0 - true_sine).abs());
        worst_cosine = worst_cosine.max((f64::from(cosine) / 2_147_483_648.0 - true_cosine).abs());
    }
    assert!(worst_sine <= ERROR && worst_cosine <= ERROR);
    seen!(worst_sine > ERROR / 2.0, worst_cosine > ERROR / 2.0)
}

/// A quarter turn swaps sine and cosine and changes a sign, exactly, so that the error in the reduced
/// range is the error of all phases.
pub fn quarter_turn_only_swaps(phase: Turns) -> Seen {
    let (sine, cosine) = sin_cos(phase);
    let further = |quarters: u32| sin_cos(Turns(phase.0.wrapping_add(quarters << 30)));
    assert!(further(1) == (cosine, -sine));
    assert!(further(2) == (-sine, -cosine));
    assert!(further(3) == (-cosine, sine));
    seen!(phase.0 >> 29 == 1, cosine == i32::MAX)
}

/// The direction of a vector is within 8e-6 turns of the true one, at every length.
#[allow(clippy::cast_precision_loss, reason = "2⁻⁵³ of the vector")]
pub fn direction_is_accurate(x: i64, y: i64) -> Seen {
    let found = f64::from(direction(x, y).0) / 4_294_967_296.0;
    if x == 0 && y == 0 {
        assert!(found == 0.0);
        return Seen::NOTHING.case(0, true);
    }
    let exact = (y as f64).atan2(x as f64) / core::f64::consts::TAU;
    let error = found - exact;
    assert!((error - error.round()).abs() <= 8e-6);
    Seen::NOTHING
        .case(1, x == i64::MIN || y == i64::MIN)
        .case(2, x.unsigned_abs() < 100 && y.unsigned_abs() < 100)
}

/// Every vector has a direction, in its quadrant: no overflow, no division by zero.
pub fn direction_lies_in_the_quadrant(x: i64, y: i64) -> Seen {
    let found = direction(x, y).0;
    let from_ahead = found.min(found.wrapping_neg());
    assert!(if x < 0 {
        from_ahead >= 1 << 30
    } else {
        from_ahead <= 1 << 30
    });
    let to_the_left = if y < 0 { found.wrapping_neg() } else { found };
    assert!(to_the_left <= 1 << 31);
    seen!(x < 0 && y < 0, x == i64::MIN, x == 0 && y == 0)
}

crate::properties! {
    theorem T5 direction_lies_in_the_quadrant(x: i64, y: i64) {
        cases ["behind to the right", "the longest", "no vector"];
        kani proof [unwind(2), solver(minisat)];
        sampled 100_000;
    }
    theorem T6 sine_and_cosine_are_accurate(block: u32) {
        cases ["a sine near its bound", "a cosine near its bound"];
        exhaustive (0..1 << 20).map(|block: u32| (block.wrapping_sub(1 << 19),));
    }
    theorem T6 quarter_turn_only_swaps(phase: Turns) {
        cases ["beyond an eighth of a turn", "a full cosine"];
        exhaustive (0..1 << 30).map(|phase| (Turns(phase),));
    }
    property T6 direction_is_accurate(x: i64, y: i64) {
        cases ["no vector", "the longest", "a short one"];
        stepped (-200..=200).flat_map(|x| (-200..=200).map(move |y| (x, y))).chain([
            (i64::MIN, 0), (0, i64::MIN), (i64::MIN, i64::MIN), (i64::MAX, i64::MIN)
        ]);
        sampled 300_000;
    }
}
