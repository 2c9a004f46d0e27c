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
//! | sine and versine | ≤ 0.4 |
//! | sums, a unit of 2⁻⁴⁰ mm each | 0.002 |

use fixed::types::{I16F16, I32F32};

use super::trig::Reduced;
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
    let mut rest = n % d;
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
    fn new(diameter: u32, reversed: bool, platform: &Platform) -> Self {
        let counts = u64::from(platform.counts_per_turn.max(1));
        let track = u64::from(platform.track.max(1));
        let diameter = u64::from(diameter.min(MAX_DIAMETER));
        let divisor = 2000 * counts;
        let half = (diameter * PI + divisor / 2) / divisor;
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
    /// 2⁻⁴⁰ mm: ±8.3 km, four times what the wire can say.
    x: i64,
    y: i64,
}

/// `a·b / 2³²`, floor; exact for every `a` and `b` whose result fits.
#[inline]
const fn scale(a: i64, b: i32) -> i64 {
    let upper = (a >> 32) * b as i64;
    let lower = ((a & 0xFFFF_FFFF) * b as i64) >> 32;
    upper.wrapping_add(lower)
}

/// High word of a signed product, floor.
#[inline]
const fn high(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
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

    /// One tick's counters. Both wrap; between two ticks the right wheel may turn by ±32 767 counts
    /// and the robot by a sixteenth of a turn for the stated accuracy. Any other input is as safe,
    /// only less accurate.
    #[inline]
    pub fn step(&mut self, left: u32, right: u16) -> Delta {
        let n_left = left.wrapping_sub(self.left_counter) as i32;
        let n_right = i32::from(right.wrapping_sub(self.right_counter) as i16);
        self.left_counter = left;
        self.right_counter = right;
        let n_left = n_left.wrapping_mul(self.left.sign);
        let n_right = n_right.wrapping_mul(self.right.sign);

        let turn = times(self.right.turn, n_right).wrapping_sub(times(self.left.turn, n_left));
        let middle = self.heading.wrapping_add((turn as i64 >> 1) as u64);
        self.heading = self.heading.wrapping_add(turn);
        let turn = (turn >> 32) as i32;

        // |S̄| < 2⁶², 2⁻⁴⁰ mm.
        let path = self.right.half * i64::from(n_right)
            + self.left.half * i64::from(n_left.clamp(-0x8000, 0x8000));
        let chord = path - (scale(path, shortening(turn)) >> 4);

        // Nearest upper word, and what it leaves, signed.
        let phase = (middle.wrapping_add(1 << 31) >> 32) as u32;
        let rest = middle as u32 as i32;
        let Reduced {
            quarter,
            sine,
            versine,
        } = Reduced::of(Turns(phase));
        let along = chord - scale(chord, versine);
        let across = scale(chord << 1, sine);
        // The rest in radians is rest·2π/2⁶⁴; 2π has 28 fractional bits, a position's upper word 8.
        let rest = i64::from(high(rest, 1_686_629_713));
        let dx = along - (((across >> 32) * rest) >> 28);
        let dy = across + (((along >> 32) * rest) >> 28);

        let (dx, dy) = if quarter & 1 == 0 {
            (dx, dy)
        } else {
            (-dy, dx)
        };
        let (dx, dy) = if quarter & 2 == 0 {
            (dx, dy)
        } else {
            (-dx, -dy)
        };
        self.x = self.x.saturating_add(dx);
        self.y = self.y.saturating_add(dy);

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

/// `factor·n`, modulo 2⁶⁴.
#[inline]
const fn times(factor: u64, n: i32) -> u64 {
    factor.wrapping_mul(n as i64 as u64)
}

/// The nearest word.
const fn narrow(value: i64) -> i32 {
    if value > i32::MAX as i64 {
        i32::MAX
    } else if value < i32::MIN as i64 {
        i32::MIN
    } else {
        value as i32
    }
}

/// What the chord lacks of its arc: ψ²/24 − ψ⁴/1920 + ψ⁶/322560, Q36, for `turn` in 2⁻³² turns;
/// error ≤ 4e-11 up to a sixteenth of a turn, beyond which it stays.
#[inline]
const fn shortening(turn: i32) -> i32 {
    const LIMIT: i32 = (1 << 28) - 1;
    let turn = if turn > LIMIT {
        LIMIT
    } else if turn < -LIMIT {
        -LIMIT
    } else {
        turn
    };
    // Turns squared, Q38, at most 2³⁰.
    let square = high(turn << 3, turn << 3);
    // (2π)⁶/322560 Q18, (2π)⁴/1920 Q24, (2π)²/24 Q30.
    let factor = 13_618_778 - high(square, 50_004);
    let factor = 1_766_234_505 - high(square, factor);
    high(square, factor)
}

#[cfg(test)]
mod tests;
