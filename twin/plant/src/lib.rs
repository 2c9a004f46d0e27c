//! Motors, wheels, encoders, battery, room and rangefinders of the virtual robot.
//!
//! Pure models, no I/O: [`World`] holds the physical state and is advanced by [`World::step`] with
//! what the bridge applies to the motors; everything the board can sense is read back from it.
//! Every run is reproducible from its seed.
//!
//! # Conventions
//! - Lengths in millimetres, angles in radians unless a name says `_deg`, times in seconds unless a
//!   name says `_us`, voltages in volts.
//! - World frame: right-handed; heading counter-clockwise positive, 0 along +x. In the robot's own
//!   frame x is ahead and y to the left.
//! - A positive duty drives the wheel forward. The encoders of the first board count *down* going
//!   forward ([`Chassis::encoder_sign`]).
#![forbid(unsafe_code)]

mod battery;
mod chassis;
mod collision;
mod encoder;
mod faults;
mod motor;
mod pose;
mod rangefinder;
mod rng;
pub mod room;
mod servo;
mod world;

pub use battery::{Battery, BatteryParams, Divider};
pub use chassis::Chassis;
pub use collision::Collision;
pub use faults::Faults;
pub use motor::{Motor, MotorInput, MotorParams};
pub use pose::Pose;
pub use rangefinder::{speed_of_sound_mm_per_us, Mount, RangefinderParams};
pub use rng::Rng;
pub use room::Room;
pub use servo::{Servo, ServoParams};
pub use world::{Params, World};

/// The front rangefinder's index, in the order of the frame.
pub const FRONT: usize = 0;
/// The right rangefinder's index.
pub const RIGHT: usize = 1;
/// The left rangefinder's index.
pub const LEFT: usize = 2;

/// One thing for each side of the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sides<T> {
    /// The left one.
    pub left: T,
    /// The right one.
    pub right: T,
}

impl<T> Sides<T> {
    /// A pair from its two halves.
    pub const fn new(left: T, right: T) -> Self {
        Self { left, right }
    }
}
