//! Odometry: heading and position from the encoders' counters (document, 4.1).
//!
//! Heading: `θ = K_R·n_R − K_L·n_L mod 1 turn`, each K the turn of one count in units of 2⁻⁶⁴ turns,
//! n all counts since the start. The products are summed count by count modulo 2⁶⁴, which is the same
//! number: nothing is rounded after K, so the heading never drifts.
//!
//! Position: a tick moves the axle's centre along an arc with the chord `ΔS = S̄·(1 − ψ²/24 +
//! ψ⁴/1920 − ψ⁶/322560)` (the document's 2R·sin ψ/2 without division and without a case for ψ = 0),
//! in direction β + ψ/2, rounded to 34 bits.
//!
//! | error contribution over 1 km, µm | first board | any accepted platform |
//! |---|---|---|
//! | K, half of 2⁻⁶⁴ turns a count of either wheel | 0.003 | ≤ 0.4 |
//! | travel of a count, half of 2⁻⁴² mm | 0.002 | ≤ 0.5 |
//! | direction, half of 2⁻³⁴ turns | ≤ 0.18 | ≤ 0.18 |
//! | sine and cosine | ≤ 0.5 together | ≤ 0.5 together |
//! | in arcs: the chord, its product half of 2⁻³⁰ | ≤ 0.9 | ≤ 0.9 |
//! | sums, two units of 2⁻⁴⁰ mm each | 0.001 | 0.001 |
//!
//! `proofs` decides or samples chord, sine and cosine (`motion/arc.rs`). Measured straight on, over many headings: at
//! most 0.40 µm. Numbers of 64 bits are split into two *signed* words,
//! whose products with a word are one instruction of the Cortex-M4 each (SMULL, SMLAL, MLA, SMMLAR).

mod slip;

use fixed::types::{I16F16, I32F32};

use super::trig::{Reduced, nearest, plus, split, upper};
use crate::divide::{digit, div_rem};
use crate::eeprom::fields::{COUNTS_PER_TURN, WHEEL_DIAMETER_LEFT};
use crate::eeprom::{self, Accepted, Config};
use crate::types::{Delta, Millimetres, Pose, Turns};

/// A factor per count, `high·2³² + low`.
#[derive(Clone, Copy, Debug)]
struct PerCount {
    low: i32,
    high: i32,
}

impl PerCount {
    const fn new(value: i64) -> Self {
        let (low, high) = split(value);
        Self { low, high }
    }

    /// `onto + self·n`, modulo 2⁶⁴: two multiplications.
    const fn times(self, n: i32, onto: i64) -> i64 {
        let onto = onto.wrapping_add(self.low as i64 * n as i64);
        onto.wrapping_add((self.high.wrapping_mul(n) as i64) << 32)
    }
}

/// One wheel's factors.
#[derive(Clone, Copy, Debug)]
struct Wheel {
    /// −1 if the encoder counts down while the wheel rolls forward.
    sign: i32,
    /// Turn of the robot per count of this wheel alone, counter-clockwise, 2⁻⁶⁴ turns.
    turn: PerCount,
    /// Half the wheel's travel per count, 2⁻⁴² mm, at most 2⁴⁶.
    half: PerCount,
}

/// π, 42 fractional bits.
const PI: u64 = 13_816_870_609_430;

// The largest wheel on the coarsest encoder: [`Wheel::half`] is at most 2⁴⁶.
const _: () = {
    let (Accepted::IntRange { max, .. }, Accepted::IntRange { min, .. }) =
        (*WHEEL_DIAMETER_LEFT.accepted, *COUNTS_PER_TURN.accepted)
    else {
        panic!()
    };
    assert!(max as u64 * PI / (2000 * min as u64) < 1 << 46);
};

/// Fractional part of `n / d`, nearest, 2⁻⁶⁴; `d` below 2⁶².
fn fraction(n: u64, d: u64) -> u64 {
    let (_, mut rest) = div_rem(n, d);
    let mut quotient = 0u64;
    let mut bit = 0;
    while bit < 64 {
        let one;
        (one, rest) = digit(rest, 0, d);
        quotient = (quotient << 1) | one;
        bit += 1;
    }
    let (half, _) = digit(rest, 0, d);
    quotient.wrapping_add(half)
}

impl Wheel {
    /// `right`: which side the wheel is on; rolling forward, the right one turns the robot
    /// counter-clockwise.
    // Start-up only: one copy in flash.
    #[inline(never)]
    fn new(wheel: &eeprom::Wheel, right: bool, config: &Config) -> Self {
        let counts = u64::from(config.counts_per_turn());
        let track = u64::from(config.track().0);
        let diameter = u64::from(wheel.diameter.0);
        let divisor = 2000 * counts;
        let (half, _) = div_rem(diameter * PI + divisor / 2, divisor);
        let turn = fraction(diameter, 2 * counts * track) as i64;
        Self {
            sign: if wheel.encoder_reversed { -1 } else { 1 },
            turn: PerCount::new(if right { turn } else { turn.wrapping_neg() }),
            half: PerCount::new(half as i64),
        }
    }
}

/// The robot's pose. Arithmetic error of the position ≤ 2.5 µm per km of path; the heading is exact.
#[derive(Clone, Debug)]
pub struct Odometry {
    left: Wheel,
    right: Wheel,
    left_counter: u32,
    right_counter: u16,
    /// Half the difference of the wheels' travels in a turn on the spot: π·track, 2⁻⁴⁰ mm.
    half_travel_per_turn: i64,
    /// 2⁻⁶⁴ turns, plus [`ROUNDING`].
    heading: i64,
    position: Position,
}

impl Odometry {
    /// At the origin, with the counters as first read: the first sample never moves the pose.
    // Requirement: WIRE-platform-2, WIRE-platform-3
    pub fn new(config: &Config, left: u32, right: u16) -> Self {
        Self {
            left: Wheel::new(config.left(), false, config),
            right: Wheel::new(config.right(), true, config),
            left_counter: left,
            right_counter: right,
            half_travel_per_turn: (PI >> 2) as i64 / 1000 * i64::from(config.track().0),
            heading: ROUNDING,
            position: Position { x: 0, y: 0 },
        }
    }

    /// One tick's counters, both of which wrap. Between two ticks a wheel may turn by ±32 767 counts
    /// and, for the stated accuracy of the position, the robot by a sixteenth of a turn. Other input is
    /// safe but less accurate.
    // Not inlined: `cargo xtask figures` counts its instructions.
    // Requirement: DOC-4.1-1, WIRE-position-3
    #[inline(never)]
    pub fn step(&mut self, left: u32, right: u16) -> Delta {
        let n_left = left.wrapping_sub(self.left_counter) as i32;
        let n_right = i32::from(right.wrapping_sub(self.right_counter) as i16);
        self.left_counter = left;
        self.right_counter = right;
        let n_left = n_left.wrapping_mul(self.left.sign);
        let n_right = n_right * self.right.sign;

        let turn = self
            .left
            .turn
            .times(n_left, self.right.turn.times(n_right, 0));
        // Requirement: DOC-4.1-3
        let middle = self.heading.wrapping_add(turn >> 1);
        // Requirement: DOC-4.1-5
        self.heading = self.heading.wrapping_add(turn);
        let turn = (turn >> 32) as i32;

        // 2⁻⁴² mm, within ±2⁶² for counts within ±2¹⁵; beyond that meaningless but safe.
        let path = self
            .left
            .half
            .times(n_left, self.right.half.times(n_right, 0));
        self.position.advance(path, middle, turn);

        Delta {
            left: n_left,
            right: n_right,
            travel: I16F16::from_bits(narrow(path)),
            turn,
        }
    }

    /// Position to the nearest 2⁻³² mm, heading to the nearest 2⁻³² turns.
    pub const fn pose(&self) -> Pose {
        let Position { x, y } = self.position;
        Pose {
            x: Millimetres(I32F32::from_bits((x >> 8) + ((x >> 7) & 1))),
            y: Millimetres(I32F32::from_bits((y >> 8) + ((y >> 7) & 1))),
            heading: Turns((self.heading.wrapping_add((1 << 31) - ROUNDING) >> 32) as u32),
        }
    }
}

/// The axle's centre, 2⁻⁴⁰ mm, both within ±[`MAX_POSITION`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    /// Ahead at the start.
    pub x: i64,
    /// To the left at the start.
    pub y: i64,
}

impl Position {
    /// Moves it along an arc: `path` long, 2⁻⁴² mm, its chord in the direction `middle`, 2⁻⁶⁴ turns of
    /// which the upper 34 bits count, bent by `turn`, 2⁻³² turns. Safe for any arc.
    #[inline]
    pub fn advance(&mut self, path: i64, middle: i64, turn: i32) {
        let direction = Reduced::of(middle as u64);
        let short = shortening(turn);
        let (low, high) = split(path);
        // In the frame of the quadrant: ahead, and to the right.
        let ahead = component(low, high, direction.cosine, short);
        let right = component(low, high, direction.minus_sine, short);
        // Requirement: DOC-4.1-4
        let (x, y) = match direction.quarter {
            0 => (self.x + ahead, self.y - right),
            1 => (self.x + right, self.y + ahead),
            2 => (self.x - ahead, self.y + right),
            _ => (self.x - right, self.y - ahead),
        };
        (self.x, self.y) = if out_of_range(x) | out_of_range(y) {
            (saturated(x), saturated(y))
        } else {
            (x, y)
        };
    }
}

/// Added to the heading so that truncating it to 34 bits rounds.
const ROUNDING: i64 = 1 << 29;

/// Component of a path, 2⁻⁴² mm in signed words, along an axis, 2⁻⁴⁰ mm, floor: times `cosine`, Q62,
/// and times 1 + `short`, Q32; below 2⁶¹.
#[inline]
const fn component(low: i32, high: i32, cosine: i64, short: i32) -> i64 {
    let (fine, coarse) = split(cosine);
    let coarse = plus(coarse, coarse, short);
    // Each below 2³⁰.
    let rest = upper(low, coarse).wrapping_add(upper(high, fine));
    rest as i64 + high as i64 * coarse as i64
}

/// Range of the position: ±4.19 km, twice the wire's. A step is shorter than half of it, so no sum
/// overflows.
pub const MAX_POSITION: i64 = (1 << 62) - 1;

/// Whether a position is out of range.
const fn out_of_range(position: i64) -> bool {
    // Its two upper bits differ.
    let high = (position >> 32) as i32;
    (high ^ (high << 1)) < 0
}

/// The nearest position in range.
#[cold]
const fn saturated(position: i64) -> i64 {
    if !out_of_range(position) {
        position
    } else if position < 0 {
        -MAX_POSITION - 1
    } else {
        MAX_POSITION
    }
}

/// A path of 2⁻⁴² mm in 2⁻¹⁶ mm, floor, saturating to within 64 units.
fn narrow(path: i64) -> i32 {
    const END: i32 = 1 << 25;
    ((path >> 32) as i32).clamp(-END, END - 1) << 6 | (path as u32 >> 26) as i32
}

/// Chord over arc, less 1: −ψ²/24 + ψ⁴/1920 − ψ⁶/322560, Q32, for `turn` in 2⁻³² turns; error ≤ 2.1e-10
/// up to a sixteenth of a turn, bounded by 6 % beyond.
// Requirement: DOC-4.1-3
const fn shortening(turn: i32) -> i32 {
    // −turns², Q35. All factors are negative: LLVM takes a known positive factor for
    // unsigned, and has no single instruction for a mixed product.
    let square = upper(turn << 2, (turn << 1).wrapping_neg());
    // (2π)⁶/322560 Q23, (2π)⁴/1920 Q26, (2π)²/24 Q29.
    let factor = plus(-54_475_112, square, -1_605_633);
    let factor = plus(-883_117_253, square, factor);
    -nearest(square, factor)
}

#[cfg(test)]
mod tests;
