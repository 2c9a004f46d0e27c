//! Sources of a property's inputs: Kani's arbitrary values, a fuzzer's bytes, a sampler's bytes.

/// A source of inputs.
pub trait Source {
    /// The next 8, 16, 32 or 64 bits.
    fn bits(&mut self, width: u32) -> u64;
    /// The next `N` bytes.
    fn bytes<const N: usize>(&mut self) -> [u8; N];
    /// The next binary64, as its bits.
    fn double(&mut self) -> u64 {
        self.bits(64)
    }
    /// The next 8 bits.
    fn bits8(&mut self) -> u8 {
        self.bits(8) as u8
    }
    /// The next 16 bits.
    fn bits16(&mut self) -> u16 {
        self.bits(16) as u16
    }
    /// The next 32 bits.
    fn bits32(&mut self) -> u32 {
        self.bits(32) as u32
    }
}

/// A type that can be drawn; every value of the type must be possible.
pub trait Input: Sized {
    /// Draws one value.
    fn draw(source: &mut impl Source) -> Self;
}

/// An arbitrary value: all of them at once under Kani.
#[cfg(kani)]
pub fn any<T: Input>() -> T {
    T::draw(&mut Symbolic)
}

/// Kani's arbitrary values.
#[cfg(kani)]
#[derive(Clone, Copy, Debug)]
pub struct Symbolic;

#[cfg(kani)]
impl Source for Symbolic {
    fn bits(&mut self, width: u32) -> u64 {
        match width {
            8 => kani::any::<u8>().into(),
            16 => kani::any::<u16>().into(),
            32 => kani::any::<u32>().into(),
            _ => kani::any(),
        }
    }
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        kani::any()
    }
}

/// The given bytes, then zeros: a fuzzer's input.
#[derive(Clone, Debug)]
pub struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    /// Draws from `bytes`.
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }
}

impl Source for Bytes<'_> {
    fn bits(&mut self, width: u32) -> u64 {
        (0..width / 8).fold(0, |bits, at| {
            bits | u64::from(self.bytes::<1>()[0]) << (8 * at)
        })
    }
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (taken, rest) = self.0.split_at(self.0.len().min(N));
        self.0 = rest;
        let mut bytes = [0; N];
        bytes[..taken.len()].copy_from_slice(taken);
        bytes
    }
}

/// Bytes read so that the edges of every type are frequent: a sampler's input.
#[derive(Clone, Debug)]
pub struct Biased<'a>(Bytes<'a>);

impl<'a> Biased<'a> {
    /// Draws from `bytes`; all zeros draw the simplest value of every type.
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self(Bytes(bytes))
    }

    /// Whether all bytes have been drawn: everything after them is zero.
    pub const fn is_spent(&self) -> bool {
        self.0.0.is_empty()
    }
}

impl Source for Biased<'_> {
    /// An edge, a small number of either sign, a power of two and its neighbours, or anything.
    fn bits(&mut self, width: u32) -> u64 {
        let shape = self.0.bits8();
        let value = match shape {
            0 => 0,
            1..=31 => 1 << (u32::from(self.0.bits8()) % width),
            32..=47 => (1 << (u32::from(self.0.bits8()) % width)) - 1,
            48..=63 => !(1 << (u32::from(self.0.bits8()) % width)),
            64..=79 => u64::from(self.0.bits8()),
            80..=95 => !u64::from(self.0.bits8()),
            96..=127 => self.0.bits(64) >> (u32::from(self.0.bits8()) % width),
            _ => self.0.bits(64),
        };
        value & u64::MAX >> (64 - width)
    }
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        self.0.bytes()
    }
    /// Often a special number or one of a magnitude that the robot uses; uniform bits are nearly
    /// always far too large or far too small.
    fn double(&mut self) -> u64 {
        let exponent = match self.0.bits8() {
            0..=15 => 0,
            16..=23 => 1,
            24..=31 => 0x7FE,
            32..=47 => 0x7FF,
            48..=79 => self.0.bits(64),
            _ => (1023 - 80) + u64::from(self.0.bits8() % 160),
        };
        self.bits(52) | (exponent & 0x7FF) << 52 | u64::from(self.0.bits8() & 1) << 63
    }
}

macro_rules! integers {
    ($($integer:ty),*) => {$(
        impl Input for $integer {
            fn draw(source: &mut impl Source) -> Self {
                source.bits(Self::BITS) as Self
            }
        }
    )*};
}

integers!(u8, i8, u16, i16, u32, i32, u64, i64);

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

use fixed::types::{I16F16, I32F32};
use fw_core::binary64::Binary64;
use fw_core::motion::ArrivalTimer;
use fw_core::motion::obstacle_limit::Track;
use fw_core::motion::pose_controller::state::{Phase, PoseState};
use fw_core::motion::pose_controller::stiction::{LowPass, RateProfile, StictionBoost};
use fw_core::motion::velocity_controller::VelocityRamp;
use fw_core::types::{Delta, Faults, Micros, Millimetres, Pose, Turns, Velocity};
use fw_core::wire::strategy::Context;
use fw_core::wire::{
    CellCode, Command, DistanceCode, GyroCode, Mode, Order, PoseCode, Report, Sequence, Setup,
    State,
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

macro_rules! fixed {
    ($($name:ty),*) => {$(
        impl Input for $name {
            fn draw(source: &mut impl Source) -> Self {
                Self::from_bits(Input::draw(source))
            }
        }
    )*};
}

fixed!(Faults, I16F16, I32F32);
wrappers!(
    Micros,
    Turns,
    Millimetres,
    DistanceCode,
    GyroCode,
    LowPass,
    RateProfile
);

structures! {
    PoseCode { x, y, rotation }
    CellCode { cell, voltage }
    Sequence { own, seen }
    Velocity { forward, yaw_rate }
    Pose { x, y, heading }
    Delta { left, right, travel, turn }
    StictionBoost { rest_ticks, boost }
    PoseState {
        phase, widened, settled_ticks, speed, turn_rate, planned_turn, forward_boost, rotation_boost,
    }
    ArrivalTimer { speed, pace, turns, left }
    VelocityRamp { max_speed, max_yaw_rate, speed_step, yaw_step }
    Track { ahead, fresh, turned, misses, backward, forward, max_forward }
    Command { expected, apply, percent, velocity, sweep, tune, sequence, clear_faults, order }
    Context { key_from_pi, key_from_stm, cells, own, last }
    Setup { mode, key_from_pi, key_from_stm, cells }
    Report {
        pose, measurement, cell, ranges, bearing, gyro, sequence, faults, state, obstacle_limited,
        clipped,
    }
}

impl Input for Mode {
    fn draw(source: &mut impl Source) -> Self {
        match source.bits8() % 8 {
            0 => Self::Normal,
            1 => Self::TuneRotate,
            2 => Self::TuneMove,
            3 => Self::GuardedNormal,
            4 => Self::GuardedTuneRotate,
            5 => Self::GuardedTuneMove,
            6 => Self::GuardedSweep,
            _ => Self::GuardedVelocity,
        }
    }
}

impl Input for [DistanceCode; 3] {
    fn draw(source: &mut impl Source) -> Self {
        let (front, right) = Input::draw(source);
        [front, right, Input::draw(source)]
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

impl Input for Phase {
    fn draw(source: &mut impl Source) -> Self {
        let (reverse, heading) = Input::draw(source);
        match source.bits8() % 5 {
            0 => Self::Idle,
            1 => Self::Approach { reverse },
            2 => Self::FinalApproach { heading },
            3 => Self::FinalRotation,
            _ => Self::Hold,
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
