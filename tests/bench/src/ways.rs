//! The ways.
//!
//! | way | numbers | sine and cosine |
//! |---|---|---|
//! | [`Ours`] | `fw-core`'s | its own |
//! | [`Double`] | `f64`, software on a Cortex-M4F | `libm` |
//! | [`Single`] | `f32`, the FPU | `libm` |
//! | [`Micromath`] | `f32`, the FPU | `micromath` |
//! | [`Cordic`] | `I32F32` | `cordic` |
//! | [`Idsp`] | `i32` phase, `i64` position | `idsp` |
//!
//! The floating-point and the CORDIC one are the document's formulas as they stand, with its second
//! case for equal ways and its division. The last one is what one writes around a table of sines: whole
//! turns as a wrapping phase, the chord taken for as long as its arc.

use cordic::sin_cos;
use fixed::types::I32F32;
use fw_core::eeprom::Platform;
use fw_core::motion::Odometry;
use micromath::F32Ext;

/// An odometry.
pub trait Way {
    /// At the origin, the counters at 0.
    fn new(platform: &Platform) -> Self;
    /// One tick's counters.
    fn tick(&mut self, left: u32, right: u16);
    /// x and y, millimetres.
    fn position(&self) -> (f64, f64);
    /// Everything it has summed up, to the bit.
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
    fn new(platform: &Platform) -> Self {
        let sign = |reversed| if reversed { -1 } else { 1 };
        Self {
            left: 0,
            right: 0,
            left_sign: sign(platform.encoder_left_reversed),
            right_sign: sign(platform.encoder_right_reversed),
        }
    }

    #[inline(always)]
    fn since(&mut self, left: u32, right: u16) -> (i32, i32) {
        let grown_left = left.wrapping_sub(self.left) as i32;
        let grown_right = i32::from(right.wrapping_sub(self.right) as i16);
        (self.left, self.right) = (left, right);
        (grown_left * self.left_sign, grown_right * self.right_sign)
    }
}

/// Millimetres of a wheel's count.
fn per_count(diameter: u32, platform: &Platform) -> f64 {
    f64::from(diameter) / 1000.0 * core::f64::consts::PI / f64::from(platform.counts_per_turn)
}

/// The robot's own.
pub struct Ours(Odometry);

impl Way for Ours {
    fn new(platform: &Platform) -> Self {
        Self(Odometry::new(platform, 0, 0))
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
        [
            pose.x.0.to_bits() as u64,
            pose.y.0.to_bits() as u64,
            pose.heading.0.into(),
        ]
    }
}

macro_rules! floating {
    ($(#[$doc:meta])* $name:ident: $float:ident, $bits:ident, $sin:expr, $cos:expr) => {
        $(#[$doc])*
        pub struct $name {
            counters: Counters,
            left: $float,
            right: $float,
            track: $float,
            x: $float,
            y: $float,
            angle: $float,
        }

        impl $name {
            #[inline(never)]
            fn step(&mut self, left: u32, right: u16) {
                const TURN: $float = core::$float::consts::TAU;
                let (left, right) = self.counters.since(left, right);
                let s_left = left as $float * self.left;
                let s_right = right as $float * self.right;
                if s_left == s_right {
                    self.x += s_right * $cos(self.angle);
                    self.y += s_right * $sin(self.angle);
                    return;
                }
                let psi = (s_right - s_left) / self.track;
                let radius = (s_right + s_left) / (2.0 * psi);
                let chord = 2.0 * radius * $sin(psi / 2.0);
                let middle = self.angle + psi / 2.0;
                self.x += chord * $cos(middle);
                self.y += chord * $sin(middle);
                self.angle += psi;
                if self.angle >= TURN {
                    self.angle -= TURN;
                } else if self.angle < 0.0 {
                    self.angle += TURN;
                }
            }
        }

        impl Way for $name {
            fn new(platform: &Platform) -> Self {
                Self {
                    counters: Counters::new(platform),
                    left: per_count(platform.wheel_diameter_left, platform) as $float,
                    right: per_count(platform.wheel_diameter_right, platform) as $float,
                    track: platform.track as $float / 1000.0,
                    x: 0.0,
                    y: 0.0,
                    angle: 0.0,
                }
            }

            fn tick(&mut self, left: u32, right: u16) {
                self.step(left, right);
            }

            fn position(&self) -> (f64, f64) {
                (self.x.into(), self.y.into())
            }

            fn bits(&self) -> [u64; 3] {
                [self.x, self.y, self.angle].map(|value| value.to_bits().into())
            }
        }
    };
}

floating!(
    /// The document's formulas in doubles.
    Double: f64, u64, libm::sin, libm::cos
);
floating!(
    /// The document's formulas on the FPU.
    Single: f32, u32, libm::sinf, libm::cosf
);
floating!(
    /// The document's formulas on the FPU, with fast approximations.
    Micromath: f32, u32, F32Ext::sin, F32Ext::cos
);

/// The document's formulas in fixed point.
pub struct Cordic {
    counters: Counters,
    left: I32F32,
    right: I32F32,
    track: I32F32,
    x: I32F32,
    y: I32F32,
    angle: I32F32,
}

impl Cordic {
    #[inline(never)]
    fn step(&mut self, left: u32, right: u16) {
        let (left, right) = self.counters.since(left, right);
        let s_left = self.left * i64::from(left);
        let s_right = self.right * i64::from(right);
        if s_left == s_right {
            let (sine, cosine) = sin_cos(self.angle);
            self.x += s_right * cosine;
            self.y += s_right * sine;
            return;
        }
        let psi = (s_right - s_left) / self.track;
        let radius = (s_right + s_left) / (psi * 2);
        let chord = radius * 2 * sin_cos(psi / 2).0;
        let (sine, cosine) = sin_cos(self.angle + psi / 2);
        self.x += chord * cosine;
        self.y += chord * sine;
        self.angle += psi;
        if self.angle >= I32F32::TAU {
            self.angle -= I32F32::TAU;
        } else if self.angle < 0 {
            self.angle += I32F32::TAU;
        }
    }
}

impl Way for Cordic {
    fn new(platform: &Platform) -> Self {
        Self {
            counters: Counters::new(platform),
            left: I32F32::from_num(per_count(platform.wheel_diameter_left, platform)),
            right: I32F32::from_num(per_count(platform.wheel_diameter_right, platform)),
            track: I32F32::from_num(platform.track) / 1000,
            x: I32F32::ZERO,
            y: I32F32::ZERO,
            angle: I32F32::ZERO,
        }
    }

    fn tick(&mut self, left: u32, right: u16) {
        self.step(left, right);
    }

    fn position(&self) -> (f64, f64) {
        (self.x.to_num(), self.y.to_num())
    }

    fn bits(&self) -> [u64; 3] {
        [self.x, self.y, self.angle].map(|value| value.to_bits() as u64)
    }
}

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
        let way = self.half_left * i64::from(left) + self.half_right * i64::from(right);
        let (cosine, sine) = idsp::cossin(self.phase.wrapping_add(turn >> 1));
        // 2⁻²⁴ mm: 128 mm a tick, and the product fits.
        let way = way >> 8;
        self.x += (way * i64::from(cosine)) >> 23;
        self.y += (way * i64::from(sine)) >> 23;
        self.phase = self.phase.wrapping_add(turn);
    }
}

impl Way for Idsp {
    fn new(platform: &Platform) -> Self {
        let unit = 4_294_967_296.0;
        let track = f64::from(platform.track) / 1000.0 * core::f64::consts::TAU;
        let left = per_count(platform.wheel_diameter_left, platform);
        let right = per_count(platform.wheel_diameter_right, platform);
        Self {
            counters: Counters::new(platform),
            turn_left: (left / track * unit + 0.5) as i32,
            turn_right: (right / track * unit + 0.5) as i32,
            half_left: (left / 2.0 * unit + 0.5) as i64,
            half_right: (right / 2.0 * unit + 0.5) as i64,
            phase: 0,
            x: 0,
            y: 0,
        }
    }

    fn tick(&mut self, left: u32, right: u16) {
        self.step(left, right);
    }

    fn position(&self) -> (f64, f64) {
        let unit = 4_294_967_296.0;
        (self.x as f64 / unit, self.y as f64 / unit)
    }

    fn bits(&self) -> [u64; 3] {
        [self.x as u64, self.y as u64, u64::from(self.phase as u32)]
    }
}
