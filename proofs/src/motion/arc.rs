//! T6: where the way of a tick ends, of which the error of a whole run is the sum.
//!
//! The references are binary64, exact to 1e-15.

use core::f64::consts::TAU;

use fw_core::motion::odometry::Position;

use crate::property::Seen;

/// A way whose length is a power of two, 2⁻⁴² mm, so that its components are sine and cosine themselves.
const LONG: i64 = 1 << 61;

/// Where [`LONG`] ends, in shares of it, for a direction in 2⁻³⁴ turns and a bend in 2⁻³² turns.
#[allow(clippy::cast_precision_loss, reason = "2⁻⁵³ of the way")]
fn end(direction: i64, turn: i32) -> (f64, f64) {
    let mut end = Position { x: 0, y: 0 };
    end.advance(LONG, direction << 30, turn);
    let share = |units: i64| units as f64 / (LONG / 4) as f64;
    (share(end.x), share(end.y))
}

/// A straight way ends within 5.1·10⁻¹⁰ of its length from where it should.
// Requirement: DOC-4.1-4
#[allow(clippy::cast_precision_loss, reason = "34 bits")]
pub fn way_ends_in_its_direction(direction: u64) -> Seen {
    let direction = (direction % (1 << 34)) as i64;
    let (x, y) = end(direction, 0);
    let (sine, cosine) = (direction as f64 / 17_179_869_184.0 * TAU).sin_cos();
    let error = (x - cosine).hypot(y - sine);
    assert!(error <= 5.1e-10);
    seen!(error > 4e-10, x < 0.0 && y < 0.0)
}

/// A way that bends by up to a sixteenth of a turn is as long as the chord of its arc, within 6·10⁻¹⁰ of its
/// length, for the 1024 bends from `block` · 1024 on, in 2⁻³² turns: 2¹⁹ blocks are all.
// Requirement: DOC-4.1-3
pub fn bent_way_is_the_chord(block: u32) -> Seen {
    let first = ((block % (1 << 19)) << 10) as i32 - (1 << 28);
    let mut worst = 0.0_f64;
    for turn in first..first + (1 << 10) {
        let psi = f64::from(turn) / 4_294_967_296.0 * TAU;
        let square = psi * psi;
        // Chord over arc, the series of sin(ψ/2) / (ψ/2).
        let rest = 1.0 / 1920.0 - square * (1.0 / 322_560.0 - square / 92_897_280.0);
        let chord = 1.0 - square * (1.0 / 24.0 - square * rest);
        let (x, y) = end(0, turn);
        assert!(y == 0.0);
        worst = worst.max((x - chord).abs());
    }
    assert!(worst <= 6e-10);
    seen!(worst > 5.5e-10, first == 0)
}

crate::properties! {
    property T6 way_ends_in_its_direction(direction: u64) {
        cases ["near its bound", "back and to the right"];
        stepped (0..1 << 34).step_by(257).map(|direction| (direction,));
    }
    theorem T6 bent_way_is_the_chord(block: u32) {
        cases ["near its bound", "straight on"];
        exhaustive (0..1 << 19).map(|block| (block,));
    }
}
