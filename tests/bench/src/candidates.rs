//! The candidates.
//!
//! | candidate | numbers | sine and cosine |
//! |---|---|---|
//! | [`FwCore`] | `fw-core`'s | its own |
//! | [`Double`] | `f64`, software on a Cortex-M4F | `libm` |
//! | [`Single`] | `f32`, the FPU | `libm` |
//! | [`Micromath`] | `f32`, the FPU | `micromath` |
//! | [`Cordic`] | `I32F32` | `cordic` |
//! | [`Idsp`] | `i32` phase, `i64` position | `idsp` |
//!
//! `Double` to `Cordic` are the document's formulas, with its case for equal travels and its division.
//! `Idsp` takes the chord for its arc.

use fixed::types::I32F32;
use fw_core::eeprom::Config;
use fw_core::motion::Odometry;
use micromath::F32Ext;

/// An odometry.
pub trait Candidate {
    /// At the origin, the counters at 0.
    fn new(config: &Config) -> Self;
    /// One tick's counters.
    fn tick(&mut self, left: u32, right: u16);
    /// x and y, millimetres.
    fn position(&self) -> (f64, f64);
    /// The whole state, to the bit.
    fn bits(&self) -> [u64; 3];
}

/// Counts since the last tick, forward positive.
#[derive(Clone, Copy, Debug)]
struct Counters {
    left: u32,
    right: u16,
    left_sign: i32,
    right_sign: i32,
}

impl Counters {
    fn new(config: &Config) -> Self {
        let sign = |reversed| if reversed { -1 } else { 1 };
        Self {
            left: 0,
            right: 0,
            left_sign: sign(config.left().encoder_reversed),
            right_sign: sign(config.right().encoder_reversed),
        }
    }

    #[inline(always)]
    fn since(&mut self, left: u32, right: u16) -> (i32, i32) {
        let left_counts = left.wrapping_sub(self.left) as i32;
        let right_counts = i32::from(right.wrapping_sub(self.right) as i16);
        (self.left, self.right) = (left, right);
        (left_counts * self.left_sign, right_counts * self.right_sign)
    }
}

/// Millimetres per count of a wheel.
pub fn per_count(diameter: u32, config: &Config) -> f64 {
    f64::from(diameter) / 1000.0 * core::f64::consts::PI / f64::from(config.counts_per_turn())
}

/// The robot's own odometry.
pub struct FwCore(Odometry);

impl Candidate for FwCore {
    fn new(config: &Config) -> Self {
        Self(Odometry::new(config, 0, 0))
    }

    fn tick(&mut self, left: u32, right: u16) {
        let _ = self.0.step(left, right);
    }

    fn position(&self) -> (f64, f64) {
        let pose = self.0.pose();
        (pose.x.0.to_num(), pose.y.0.to_num())
    }

    fn bits(&self) -> [u64; 3] {
        let pose = self.0.pose();
        let (x, y) = (pose.x.0.to_bits(), pose.y.0.to_bits());
        [x as u64, y as u64, pose.heading.0.into()]
    }
}

/// The document's formulas in one type of number.
macro_rules! document {
    (
        $(#[$doc:meta])* $name:ident: $number:ty, $turn:expr, $from_f64:expr, $from_count:expr,
        $sin_cos:expr, $to_f64:expr, $to_bits:expr
    ) => {
        $(#[$doc])*
        pub struct $name {
            counters: Counters,
            left: $number,
            right: $number,
            track: $number,
            x: $number,
            y: $number,
            angle: $number,
        }

        impl $name {
            #[inline(never)]
            fn step(&mut self, left: u32, right: u16) {
                let (left, right) = self.counters.since(left, right);
                let s_left = self.left * $from_count(left);
                let s_right = self.right * $from_count(right);
                if s_left == s_right {
                    let (sine, cosine) = $sin_cos(self.angle);
                    self.x += s_right * cosine;
                    self.y += s_right * sine;
                    return;
                }
                let two = $from_count(2);
                let psi = (s_right - s_left) / self.track;
                let radius = (s_right + s_left) / (psi * two);
                let chord = radius * two * $sin_cos(psi / two).0;
                let (sine, cosine) = $sin_cos(self.angle + psi / two);
                self.x += chord * cosine;
                self.y += chord * sine;
                self.angle += psi;
                if self.angle >= $turn {
                    self.angle -= $turn;
                } else if self.angle < $from_count(0) {
                    self.angle += $turn;
                }
            }
        }

        impl Candidate for $name {
            fn new(config: &Config) -> Self {
                Self {
                    counters: Counters::new(config),
                    left: $from_f64(per_count(config.left().diameter.0, config)),
                    right: $from_f64(per_count(config.right().diameter.0, config)),
                    track: $from_f64(f64::from(config.track().0) / 1000.0),
                    x: $from_count(0),
                    y: $from_count(0),
                    angle: $from_count(0),
                }
            }

            fn tick(&mut self, left: u32, right: u16) {
                self.step(left, right);
            }

            fn position(&self) -> (f64, f64) {
                ($to_f64(self.x), $to_f64(self.y))
            }

            fn bits(&self) -> [u64; 3] {
                [self.x, self.y, self.angle].map($to_bits)
            }
        }
    };
}

document!(
    /// The document's formulas in doubles.
    Double: f64, core::f64::consts::TAU, core::convert::identity, f64::from,
    |angle| (libm::sin(angle), libm::cos(angle)), core::convert::identity, f64::to_bits
);
document!(
    /// The document's formulas on the FPU.
    Single: f32, core::f32::consts::TAU, |value| value as f32, |count| count as f32,
    |angle| (libm::sinf(angle), libm::cosf(angle)), f64::from, |value| value.to_bits().into()
);
document!(
    /// The document's formulas on the FPU, with fast approximations.
    Micromath: f32, core::f32::consts::TAU, |value| value as f32, |count| count as f32,
    |angle| (F32Ext::sin(angle), F32Ext::cos(angle)), f64::from, |value| value.to_bits().into()
);
document!(
    /// The document's formulas in fixed point.
    Cordic: I32F32, I32F32::TAU, I32F32::from_num::<f64>, I32F32::from_num::<i32>,
    cordic::sin_cos, I32F32::to_num, |value| value.to_bits() as u64
);

/// A wrapping phase and a table of sines.
pub struct Idsp {
    counters: Counters,
    /// 2⁻³² turns a count.
    turn_left: i32,
    turn_right: i32,
    /// Half a count, 2⁻³² mm.
    half_left: i64,
    half_right: i64,
    phase: i32,
    /// 2⁻³² mm.
    x: i64,
    y: i64,
}

impl Idsp {
    #[inline(never)]
    fn step(&mut self, left: u32, right: u16) {
        let (left, right) = self.counters.since(left, right);
        let turn =
            (right.wrapping_mul(self.turn_right)).wrapping_sub(left.wrapping_mul(self.turn_left));
        let path = self.half_left * i64::from(left) + self.half_right * i64::from(right);
        let (cosine, sine) = idsp::cossin(self.phase.wrapping_add(turn >> 1));
        // 2⁻²⁴ mm: up to 128 mm a tick the product fits.
        let path = path >> 8;
        self.x += (path * i64::from(cosine)) >> 23;
        self.y += (path * i64::from(sine)) >> 23;
        self.phase = self.phase.wrapping_add(turn);
    }
}

/// 2³².
const UNIT: f64 = 4_294_967_296.0;

impl Candidate for Idsp {
    fn new(config: &Config) -> Self {
        let track = f64::from(config.track().0) / 1000.0 * core::f64::consts::TAU;
        let left = per_count(config.left().diameter.0, config);
        let right = per_count(config.right().diameter.0, config);
        Self {
            counters: Counters::new(config),
            turn_left: (left / track * UNIT + 0.5) as i32,
            turn_right: (right / track * UNIT + 0.5) as i32,
            half_left: (left / 2.0 * UNIT + 0.5) as i64,
            half_right: (right / 2.0 * UNIT + 0.5) as i64,
            phase: 0,
            x: 0,
            y: 0,
        }
    }

    fn tick(&mut self, left: u32, right: u16) {
        self.step(left, right);
    }

    fn position(&self) -> (f64, f64) {
        (self.x as f64 / UNIT, self.y as f64 / UNIT)
    }

    fn bits(&self) -> [u64; 3] {
        [self.x as u64, self.y as u64, u64::from(self.phase as u32)]
    }
}
