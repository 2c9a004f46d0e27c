//! Plane geometry of a mobile robot in `f64`: poses, sensor mounts, segments and rays.
//!
//! ```
//! use geometry::{Mount, Point, Pose2, Segment};
//!
//! // A quarter turn to the left on wheels 125 mm apart.
//! let robot = Pose2::default().advance_arc(0.0, 125.0 * std::f64::consts::FRAC_PI_2, 125.0);
//! assert!(robot.position().distance_mm(Point::new(62.5, 62.5)) < 1e-9);
//!
//! // The front sensor of that robot faces a wall.
//! let sensor = Mount::first_board()[0].sensor_pose(&robot);
//! let wall = Segment::new(Point::new(-500.0, 1000.0), Point::new(500.0, 1000.0));
//! let hit = wall.ray_hit(sensor.position(), sensor.direction()).unwrap();
//! assert!((hit.distance_mm - 857.5).abs() < 1e-9);
//! ```
//!
//! Lengths are millimetres, angles radians. Frames are right-handed with headings counter-clockwise
//! from +x; in the robot's own frame x points ahead and y to the left. The firmware's fixed-point
//! pose is `fw_core`'s own.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod mount;
mod pose;
mod shape;

pub use mount::Mount;
pub use pose::{Point, Pose2, wrap_angle};
pub use shape::{Circle, RayHit, Segment};
