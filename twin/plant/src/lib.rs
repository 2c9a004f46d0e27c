//! Physical model of the virtual robot: motors, wheels, encoders, battery, room and rangefinders.
//!
//! ```
//! use plant::{MotorInput, Params, Room, World, FRONT};
//!
//! let room = Room::two_rooms();
//! let start = room.start;
//! let mut world = World::new(Params::default(), room, start, 1);
//! for _ in 0..1000 {
//!     world.step(0.001, MotorInput::run(0.75), MotorInput::run(0.75));
//! }
//! assert!(world.path_mm() > 50.0);
//! let front_mm = world.range_mm(FRONT).expect("an echo");
//! assert!((front_mm - world.true_range_mm(FRONT).unwrap()).abs() < 20.0);
//! ```
//!
//! [`World`] holds the physical state. [`World::step`] advances it with what the bridge applies to
//! the motors; everything the board can sense is read back from it. There is no I/O, and a run is
//! reproducible from its seed.
//!
//! # Conventions
//! - Lengths in millimetres, angles in radians unless a name says `_deg`, times in seconds unless a
//!   name says `_us`, voltages in volts. Frames are those of [`geometry`].
//! - A positive duty drives the wheel forward. The encoders of the first board count *down* going
//!   forward ([`Chassis::counts`]).
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod battery;
mod chassis;
mod collision;
mod echo;
mod faults;
mod floor;
mod gyro;
mod imperfections;
pub mod kinematic;
mod motor;
mod params;
mod rangefinder;
mod rng;
pub mod room;
mod servo;
mod sides;
mod world;

pub use battery::{Battery, BatteryParams, Divider};
pub use chassis::Chassis;
pub use collision::{COLLISION_MM_S, Collision};
pub use faults::Faults;
pub use geometry::{Mount, Pose2};
pub use gyro::GyroParams;
pub use imperfections::{DriveSpread, GeometrySpread, GyroSpread, Imperfections, Sill};
pub use motor::{Motor, MotorInput, MotorParams};
pub use params::Params;
pub use rangefinder::RangefinderParams;
pub use rng::Rng;
pub use room::Room;
pub use servo::{Servo, ServoParams};
pub use sides::Sides;
pub use world::World;

/// Index of the front rangefinder, in the order of the frame.
pub const FRONT: usize = 0;
/// Index of the right rangefinder.
pub const RIGHT: usize = 1;
/// Index of the left rangefinder.
pub const LEFT: usize = 2;
