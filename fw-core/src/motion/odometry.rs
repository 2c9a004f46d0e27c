//! Heading and position from the encoders' counters (document, 4.1).
//!
//! Heading: `θ = K_R·n_R − K_L·n_L mod 1 turn`, each K the turn of one count in units of 2⁻⁶⁴ turns,
//! n all the counts since the start. The product is formed count by count and modulo 2⁶⁴, which is
//! the same number: nothing is rounded after K, so the heading never drifts, whatever the path.
//!
//! Position: a tick moves the axle's centre along an arc. Its chord is `ΔS = S̄·(1 − ψ²/24 +
//! ψ⁴/1920 − ψ⁶/322560)` (the document's 2R·sin ψ/2 without its division and without its second
//! case for ψ = 0), in direction β + ψ/2. The direction's sine and versine come from its upper 32
//! bits; what the lower ones add, below 1e-9 rad, is added to first order, since on a long straight
//! line even that would show.
//!
//! | contribution, 1 km straight on | µm |
//! |---|---|
//! | K, half of 2⁻⁶⁴ turns a count | 0.003 |
//! | travel of a count, half of 2⁻⁴⁰ mm | 0.007 |
//! | sine and versine | ≤ 0.35 |
//! | sums, a unit of 2⁻⁴⁰ mm each | 0.002 |

use fixed::types::{I16F16, I32F32};

use super::trig::{high, nearest, Reduced};
use crate::divide::div_rem;
use crate::eeprom::Platform;
use crate::units::{Millimetres, Pose, Turns};

/// What the wheels did in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Delta {
    /// Counts the left wheel rolled, forward positive.
    pub left: i32,
    /// Counts the right wheel rolled, forward positive, −32 768 ..= 32 768.
    pub right: i32,
    /// Millimetres the axle's centre moved along its path, saturating.
    pub travel: I16F16,
    /// How far the robot turned, 2⁻³² turns, counter-clockwise positive.
    pub turn: i32,
}

/// One wheel's factors.
#[derive(Clone, Copy, Debug)]
struct Wheel {
    /// −1 where the encoder counts down when the wheel rolls forward.
    sign: i32,
    /// Turn of the robot per count of this wheel alone, 2⁻⁶⁴ turns.
    turn: u64,
    /// Half the wheel's travel per count, 2⁻⁴⁰ mm, at most 2⁴⁵.
    half: i64,
}

/// π, 40 fractional bits.
const PI: u64 = 3_454_217_652_358;

/// `n / d` of a whole, as 2⁻⁶⁴ of it, nearest, modulo the whole. `d` below 2⁶².
fn fraction(n: u64, d: u64) -> u64 {
    let (_, mut rest) = div_rem(n, d);
    let mut quotient = 0u64;
    let mut bit = 0;
    while bit < 64 {
        rest <<= 1;
        quotient <<= 1;
        if rest >= d {
            rest -= d;
            quotient |= 1;
        }
        bit += 1;
    }
    quotient.wrapping_add(u64::from(2 * rest >= d))
}

impl Wheel {
    // At start-up only: once in flash is enough.
    #[inline(never)]
    fn new(diameter: u32, reversed: bool, platform: &Platform) -> Self {
        let counts = u64::from(platform.counts_per_turn.max(1));
        let track = u64::from(platform.track.max(1));
        let diameter = u64::from(diameter.min(MAX_DIAMETER));
        let divisor = 2000 * counts;
        let (half, _) = div_rem(diameter * PI + divisor / 2, divisor);
        Self {
            sign: if reversed { -1 } else { 1 },
            turn: fraction(diameter, 2 * counts * track),
            half: half.min(1 << 45) as i64,
        }
    }
}

/// Larger wheels are taken as this, micrometres; a validated configuration has none.
const MAX_DIAMETER: u32 = 5_000_000;

/// Where the robot is. Arithmetic error of the position ≤ 1 µm per km of path; the heading is exact.
#[derive(Clone, Debug)]
pub struct Odometry {
    left: Wheel,
    right: Wheel,
    left_counter: u32,
    right_counter: u16,
    /// 2⁻⁶⁴ turns.
    heading: u64,
    /// 2⁻⁴⁰ mm, within ±[`FARTHEST`].
    x: i64,
    y: i64,
}

/// `a·b / 2³²`, floor; `a` below 2⁶³.
#[inline]
const fn scale(a: u64, b: u32) -> u64 {
    (a >> 32) * b as u64 + (((a & 0xFFFF_FFFF) * b as u64) >> 32)
}

/// `a` or, where `sign` is −1, `−a`.
#[inline]
const fn signed(a: u64, sign: i64) -> i64 {
    (a as i64 ^ sign) - sign
}

impl Odometry {
    /// At the origin, with the counters as first read: the first sample never moves the pose.
    #[must_use]
    pub fn new(platform: &Platform, left: u32, right: u16) -> Self {
        Self {
            left: Wheel::new(
                platform.wheel_diameter_left,
                platform.encoder_left_reversed,
                platform,
            ),
            right: Wheel::new(
                platform.wheel_diameter_right,
                platform.encoder_right_reversed,
                platform,
            ),
            left_counter: left,
            right_counter: right,
            heading: 0,
            x: 0,
            y: 0,
        }
    }

    /// One tick's counters, both of which wrap. Between two ticks a wheel may turn by ±32 767 counts,
    /// eight turns, and, for the position's stated accuracy, the robot by a sixteenth of a turn. Any
    /// other input is as safe, only less accurate; the heading follows the left counter's whole
    /// range.
    #[inline]
    pub fn step(&mut self, left: u32, right: u16) -> Delta {
        let n_left = left.wrapping_sub(self.left_counter) as i32;
        let n_right = i32::from(right.wrapping_sub(self.right_counter) as i16);
        self.left_counter = left;
        self.right_counter = right;
        let n_left = n_left.wrapping_mul(self.left.sign);
        let n_right = n_right * self.right.sign;

        let turn = times(self.right.turn, n_right).wrapping_sub(times(self.left.turn, n_left));
        let middle = self.heading.wrapping_add((turn as i64 >> 1) as u64);
        self.heading = self.heading.wrapping_add(turn);
        let turn = (turn >> 32) as i32;

        // 2⁻⁴⁰ mm, below 2⁶¹: each half below 2⁴⁵, each count at most 2¹⁵.
        let path = self.left.half * i64::from(n_left.clamp(-0x8000, 0x8000))
            + self.right.half * i64::from(n_right);
        let direction = Direction::new(middle, turn);
        let length = path.unsigned_abs();
        let along = length - scale(length, direction.versine);
        let across = scale(length, direction.sine);

        // Quarter turns: (a, b), (−b, a), (−a, −b), (b, −a).
        let ahead = (path >> 63) ^ -i64::from(direction.quarter >> 1);
        let beside = ahead ^ i64::from(direction.sign);
        let (dx, dy) = if direction.quarter & 1 == 0 {
            (signed(along, ahead), signed(across, beside))
        } else {
            (signed(across, !beside), signed(along, ahead))
        };
        self.x = within(self.x + dx);
        self.y = within(self.y + dy);

        Delta {
            left: n_left,
            right: n_right,
            travel: I16F16::from_bits(narrow(path >> 24)),
            turn,
        }
    }

    /// Position to the nearest 2⁻³² mm, heading to the nearest 2⁻³² turns.
    #[must_use]
    pub const fn pose(&self) -> Pose {
        Pose {
            x: Millimetres(I32F32::from_bits((self.x >> 8) + ((self.x >> 7) & 1))),
            y: Millimetres(I32F32::from_bits((self.y >> 8) + ((self.y >> 7) & 1))),
            heading: Turns((self.heading.wrapping_add(1 << 31) >> 32) as u32),
        }
    }
}

/// Where the chord points, and how much shorter than its arc it is: a vector of that length in the
/// frame of the nearest quarter turn.
struct Direction {
    /// Quarter turns, 0 ..= 3.
    quarter: u32,
    /// −1 where the sine is negative, else 0.
    sign: i32,
    /// Magnitude of the vector's part across the quarter, Q32.
    sine: u32,
    /// What its part along the quarter lacks to 1, Q32.
    versine: u32,
}

impl Direction {
    /// Of a chord in direction `middle`, 2⁻⁶⁴ turns, over an arc of `turn`, 2⁻³² turns.
    #[inline]
    fn new(middle: u64, turn: i32) -> Self {
        let Reduced {
            quarter,
            sign,
            sine,
            versine,
        } = Reduced::of(Turns((middle >> 32) as u32));
        // The chord is shorter than its arc.
        let short = shortening(turn);
        let sine = sine - nearest(sine, short);
        let versine = versine + short - nearest(versine, short);
        // What the lower word of the direction adds, at most 6.3 units of 2⁻³² rad: to first order.
        // 2π has 29 fractional bits here.
        let rest = high(middle as u32, 3_373_259_426);
        let to_sine = (high(!versine, rest) + (1 << 28)) >> 29;
        let to_versine = (high(sine, rest) + (1 << 28)) >> 29;
        // The direction is rounded down, so the rest leads away from zero or, below it, towards it:
        // there the sine is at least as large as what is taken away.
        let apply =
            |value: u32, by: u32| value.wrapping_add((by ^ sign as u32).wrapping_sub(sign as u32));
        Self {
            quarter,
            sign,
            sine: apply(sine, to_sine),
            versine: apply(versine, to_versine),
        }
    }
}

/// `factor·n`, modulo 2⁶⁴.
#[inline]
const fn times(factor: u64, n: i32) -> u64 {
    factor.wrapping_mul(n as i64 as u64)
}

/// The position's range: ±4.19 km, twice what the wire can say. A step is shorter than half of it,
/// so no sum overflows.
const FARTHEST: i64 = (1 << 62) - 1;

/// The nearest position there is.
#[inline]
const fn within(position: i64) -> i64 {
    // Beyond the range the two upper bits differ: one test, rarely true.
    if (position ^ (position << 1)) >> 63 == 0 {
        position
    } else if position < 0 {
        -FARTHEST - 1
    } else {
        FARTHEST
    }
}

/// The nearest word.
#[inline]
const fn narrow(value: i64) -> i32 {
    if (value + (1 << 31)) as u64 >> 32 == 0 {
        value as i32
    } else if value < 0 {
        i32::MIN
    } else {
        i32::MAX
    }
}

/// What a chord lacks of its arc, relative: ψ²/24 − ψ⁴/1920 + ψ⁶/322560, Q32, for `turn` in 2⁻³²
/// turns; error ≤ 1.4e-10 up to a sixteenth of a turn. Beyond that it is only bounded.
#[inline]
const fn shortening(turn: i32) -> u32 {
    // Turns squared, Q38 up to a sixteenth.
    let size = turn.unsigned_abs() << 3;
    let square = high(size, size);
    // (2π)⁶/322560 Q18, (2π)⁴/1920 Q24, (2π)²/24 Q30.
    let factor = 13_618_778 - high(square, 50_004);
    let factor = 1_766_234_505 - high(square, factor);
    (high(square, factor) + 8) >> 4
}

#[cfg(test)]
mod tests;
