//! Log-odds occupancy grid from poses and ranges.
//!
//! [`Mapper`] takes what the robot reports, frame by frame: where it believes to be and what its
//! rangefinders say. It drops repeats and lone wild readings ([`Config`]'s filter figures), and
//! enters the rest into a [`Grid`] by a model of the sensors' cone. The grid is written as the
//! PGM and YAML pair that ROS map servers read ([`ros`]), and drawn ([`map_plot`]; [`line_plot`] draws
//! curves over time with the same pen); [`evaluation`] compares it with walls that are known.
//!
//! Millimetres and radians throughout; x and y are those of the frame the poses are in, headings
//! and bearings counter-clockwise.
#![forbid(unsafe_code)]

mod canvas;
pub mod evaluation;
mod geometry;
mod grid;
pub mod line_plot;
pub mod map_plot;
mod mapper;
mod range_filter;
pub mod ros;
mod sonar_model;

pub use evaluation::{map_iou, Agreement};
pub use geometry::{Mount, Pose, Segment};
pub use grid::{Cell, Grid};
pub use mapper::{Config, Counters, Mapper};
pub use sonar_model::Cone;
