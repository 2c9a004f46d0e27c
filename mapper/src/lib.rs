//! Log-odds occupancy grid from poses and ranges.
//!
//! [`Mapper`] takes what the robot reports, frame by frame: where it believes to be and what its
//! rangefinders say. It drops repeats and lone wild readings ([`Config`]'s filter figures), and
//! enters the rest into a [`Grid`] by a model of the sensors' cone. The grid is written as the
//! PGM and YAML pair that ROS map servers read ([`ros`]), and drawn ([`picture`]; [`chart`] draws
//! curves over time with the same pen); [`agreement`] compares it with walls that are known.
//!
//! Millimetres and radians throughout; x and y are those of the frame the poses are in, headings
//! and bearings counter-clockwise.
#![forbid(unsafe_code)]

pub mod agreement;
mod canvas;
pub mod chart;
mod cone;
mod filter;
mod geometry;
mod grid;
mod mapper;
pub mod picture;
pub mod ros;

pub use agreement::{map_iou, Agreement};
pub use cone::Cone;
pub use geometry::{Mount, Pose, Segment};
pub use grid::{Cell, Grid};
pub use mapper::{Config, Counters, Mapper};
