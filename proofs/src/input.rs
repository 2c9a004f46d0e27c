//! Where a property's inputs come from: Kani's arbitrary values, a fuzzer's bytes, a sampler's.

/// Something inputs can be drawn from.
pub trait Source {
    /// The next 8 bits.
    fn bits8(&mut self) -> u8;
    /// The next 16 bits.
    fn bits16(&mut self) -> u16;
    /// The next 32 bits.
    fn bits32(&mut self) -> u32;
    /// The next 64 bits.
    fn bits64(&mut self) -> u64;
    /// The next `N` bytes.
    fn bytes<const N: usize>(&mut self) -> [u8; N];
    /// The next binary64.
    fn double(&mut self) -> u64 {
        self.bits64()
    }
}

/// A type that can be drawn; every value of the type must be possible.
pub trait Input: Sized {
    /// Draws one value.
    fn draw(source: &mut impl Source) -> Self;
}

/// An arbitrary value: all of them at once under Kani.
#[cfg(kani)]
#[must_use]
pub fn any<T: Input>() -> T {
    T::draw(&mut Symbolic)
}

/// Kani's arbitrary values.
#[cfg(kani)]
#[derive(Clone, Copy, Debug)]
pub struct Symbolic;

#[cfg(kani)]
impl Source for Symbolic {
    fn bits8(&mut self) -> u8 {
        kani::any()
    }
    fn bits16(&mut self) -> u16 {
        kani::any()
    }
    fn bits32(&mut self) -> u32 {
        kani::any()
    }
    fn bits64(&mut self) -> u64 {
        kani::any()
    }
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        kani::any()
    }
}

/// Bytes as they come, then zeros: what a fuzzer feeds.
#[derive(Clone, Debug)]
pub struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    /// Draws from `bytes`.
    #[must_use]
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }
}

impl Source for Bytes<'_> {
    fn bits8(&mut self) -> u8 {
        u8::from_le_bytes(self.bytes())
    }
    fn bits16(&mut self) -> u16 {
        u16::from_le_bytes(self.bytes())
    }
    fn bits32(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }
    fn bits64(&mut self) -> u64 {
        u64::from_le_bytes(self.bytes())
    }
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (taken, rest) = self.0.split_at(self.0.len().min(N));
        self.0 = rest;
        let mut bytes = [0; N];
        for (to, from) in bytes.iter_mut().zip(taken) {
            *to = *from;
        }
        bytes
    }
}

/// Bytes read so that the edges of every type come up often: what sampling feeds.
#[derive(Clone, Debug)]
pub struct Biased<'a>(Bytes<'a>);

impl<'a> Biased<'a> {
    /// Draws from `bytes`; all zeros draw the simplest value of every type.
    #[must_use]
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self(Bytes(bytes))
    }

    /// Whether all bytes have been drawn: from here on everything is zero.
    #[must_use]
    pub const fn is_spent(&self) -> bool {
        self.0 .0.is_empty()
    }

    /// An edge, a small number of either sign, a power of two and its neighbours, or anything.
    fn shaped(&mut self, width: u32) -> u64 {
        let shape = self.0.bits8();
        let all = u64::MAX >> (64 - width);
        let value = match shape {
            0 => 0,
            1..=31 => 1 << (u32::from(self.0.bits8()) % width),
            32..=47 => (1 << (u32::from(self.0.bits8()) % width)) - 1,
            48..=63 => !(1 << (u32::from(self.0.bits8()) % width)),
            64..=79 => u64::from(self.0.bits8()),
            80..=95 => !u64::from(self.0.bits8()),
            96..=127 => self.0.bits64() >> (u32::from(self.0.bits8()) % width),
            _ => self.0.bits64(),
        };
        value & all
    }
}

impl Source for Biased<'_> {
    #[allow(clippy::cast_possible_truncation, reason = "shaped to its width")]
    fn bits8(&mut self) -> u8 {
        self.shaped(8) as u8
    }
    #[allow(clippy::cast_possible_truncation, reason = "shaped to its width")]
    fn bits16(&mut self) -> u16 {
        self.shaped(16) as u16
    }
    #[allow(clippy::cast_possible_truncation, reason = "shaped to its width")]
    fn bits32(&mut self) -> u32 {
        self.shaped(32) as u32
    }
    fn bits64(&mut self) -> u64 {
        self.shaped(64)
    }
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        self.0.bytes()
    }
    /// Often a special number or one whose size means something to the robot; uniform bits are nearly
    /// all far too large or far too small.
    fn double(&mut self) -> u64 {
        let exponent = match self.0.bits8() {
            0..=15 => 0,
            16..=23 => 1,
            24..=31 => 0x7FE,
            32..=47 => 0x7FF,
            48..=79 => self.0.bits64(),
            _ => (1023 - 80) + u64::from(self.0.bits8() % 160),
        };
        self.shaped(52) | (exponent & 0x7FF) << 52 | u64::from(self.0.bits8() & 1) << 63
    }
}

macro_rules! integers {
    ($($unsigned:ty, $signed:ty, $bits:ident;)*) => {$(
        impl Input for $unsigned {
            fn draw(source: &mut impl Source) -> Self {
                source.$bits()
            }
        }
        impl Input for $signed {
            #[allow(clippy::cast_possible_wrap, reason = "every pattern is a value")]
            fn draw(source: &mut impl Source) -> Self {
                source.$bits() as $signed
            }
        }
    )*};
}

integers! {
    u8, i8, bits8;
    u16, i16, bits16;
    u32, i32, bits32;
    u64, i64, bits64;
}

impl Input for bool {
    fn draw(source: &mut impl Source) -> Self {
        source.bits8() & 1 != 0
    }
}

impl<const N: usize> Input for [u8; N] {
    fn draw(source: &mut impl Source) -> Self {
        source.bytes()
    }
}

impl<const N: usize> Input for [u16; N] {
    fn draw(source: &mut impl Source) -> Self {
        let mut all = [0; N];
        for one in &mut all {
            *one = source.bits16();
        }
        all
    }
}

impl<A: Input + Copy + Default, B: Input + Copy + Default, const N: usize> Input for [(A, B); N] {
    fn draw(source: &mut impl Source) -> Self {
        let mut all = [Default::default(); N];
        for one in &mut all {
            *one = Input::draw(source);
        }
        all
    }
}

impl Input for () {
    fn draw(_: &mut impl Source) -> Self {}
}

impl<A: Input, B: Input> Input for (A, B) {
    fn draw(source: &mut impl Source) -> Self {
        let first = A::draw(source);
        (first, B::draw(source))
    }
}

impl<T: Input> Input for Option<T> {
    fn draw(source: &mut impl Source) -> Self {
        let some = bool::draw(source);
        let value = T::draw(source);
        some.then_some(value)
    }
}

/// Draws a struct field by field.
macro_rules! structures {
    ($($name:path { $($field:ident),* $(,)? })*) => {$(
        impl Input for $name {
            fn draw(source: &mut impl Source) -> Self {
                Self { $($field: Input::draw(source)),* }
            }
        }
    )*};
}

use fw_core::binary64::Binary64;
use fw_core::eeprom::{Divider, Platform};
use fw_core::types::{Faults, Micros, Turns};
use fw_core::wire::strategy::Context;
use fw_core::wire::{
    CellCode, Command, DistanceCode, Mode, Order, PoseCode, Report, Sequence, Setup, State,
};

macro_rules! wrappers {
    ($($name:path),*) => {$(
        impl Input for $name {
            fn draw(source: &mut impl Source) -> Self {
                $name(Input::draw(source))
            }
        }
    )*};
}

impl Input for Binary64 {
    fn draw(source: &mut impl Source) -> Self {
        Self(source.double())
    }
}

impl Input for Faults {
    fn draw(source: &mut impl Source) -> Self {
        Self::from_bits(Input::draw(source))
    }
}

wrappers!(Micros, Turns, DistanceCode);

structures! {
    PoseCode { x, y, rotation }
    CellCode { cell, voltage }
    Sequence { own, seen }
    Command { expected, apply, percent, tune, sequence, clear_faults, order }
    Context { key_from_pi, key_from_stm, cells, own, last }
    Setup { mode, key_from_pi, key_from_stm, cells }
    Divider { upper, lower }
    Platform {
        counts_per_turn, wheel_diameter_left, wheel_diameter_right, track, encoder_left_reversed,
        encoder_right_reversed, motor_left_reversed, motor_right_reversed, servo_reversed,
        rangefinders, bearings, servo, gyro, stop_deadline, dead_zone_left, dead_zone_right,
        limit_left, limit_right, log_baud, battery_warn, battery_cutoff, position_tolerance,
        rotation_tolerance, log_period, servo_travel,
    }
}

impl Input for Mode {
    fn draw(source: &mut impl Source) -> Self {
        match source.bits8() % 7 {
            0 => Self::Normal,
            1 => Self::TuneRotate,
            2 => Self::TuneMove,
            3 => Self::GuardedNormal,
            4 => Self::GuardedTuneRotate,
            5 => Self::GuardedTuneMove,
            _ => Self::GuardedSweep,
        }
    }
}

impl Input for Report {
    fn draw(source: &mut impl Source) -> Self {
        Self {
            pose: Input::draw(source),
            measurement: Input::draw(source),
            cell: Input::draw(source),
            ranges: [
                Input::draw(source),
                Input::draw(source),
                Input::draw(source),
            ],
            bearing: Input::draw(source),
            sequence: Input::draw(source),
            faults: Input::draw(source),
            state: Input::draw(source),
        }
    }
}

impl Input for State {
    fn draw(source: &mut impl Source) -> Self {
        match source.bits8() % 5 {
            0 => Self::Booting,
            1 => Self::Ready,
            2 => Self::Moving,
            3 => Self::Stopped,
            _ => Self::Faulted,
        }
    }
}

impl Input for Order {
    fn draw(source: &mut impl Source) -> Self {
        match source.bits8() % 3 {
            0 => Self::None,
            1 => Self::Stop,
            _ => Self::Resume,
        }
    }
}
