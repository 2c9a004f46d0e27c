//! Localisation, and log-odds occupancy grids from poses and ranges.
//!
//! ```
//! use mapper::{map_iou, Cell, Localiser, LocaliserConfig, Observation, Point, Pose2, Segment};
//!
//! // The robot drives 1 m along a wall 510 mm to its left; the left sensor sits 60 mm aside.
//! let mut localiser = Localiser::new(LocaliserConfig::default());
//! for step in 0..=100 {
//!     localiser.observe(&Observation {
//!         time_s: 0.1 * f64::from(step),
//!         odometry: Pose2::new(10.0 * f64::from(step), 0.0, 0.0),
//!         gyro_rad: None,
//!         ranges_mm: [None, None, Some(450.0 + f64::from(step % 2))],
//!         front_bearing_rad: None,
//!     });
//! }
//! let grid = localiser.grid();
//! assert_eq!(grid.cell_at(Point::new(400.0, 300.0)), Cell::Free);
//! assert_eq!(grid.cell_at(Point::new(400.0, 510.0)), Cell::Occupied);
//!
//! let wall = Segment::new(Point::new(0.0, 510.0), Point::new(800.0, 510.0));
//! assert!(map_iou(grid, &[wall], 100.0).iou > 0.9);
//! ```
//!
//! [`Localiser`] takes odometry, gyroscope and ranges, enters the ranges into a [`Grid`], estimates pose and
//! calibration by what it has mapped, and finds itself on a saved map. [`ros`] writes the grid as the PGM and YAML
//! pair of ROS map servers, [`map_plot`] and [`line_plot`] draw PNG files, [`evaluation`] compares a grid with known
//! walls.
//!
//! Lengths, angles and frames are those of [`geometry`]; the grid is in the frame of the estimated poses.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod evaluation;
mod grid;
pub mod line_plot;
mod localiser;
pub mod map_plot;
mod png_canvas;
mod pose_estimate;
pub mod ros;

pub use evaluation::{MapScore, map_iou};
pub use geometry::{Mount, Point, Pose2, Segment};
pub use grid::{Cell, Grid};
pub use localiser::{
    CalibrationEstimate, Localiser, LocaliserConfig, MatcherConfig, MotionNoise, Observation,
};
pub use png_canvas::PlotError;
pub use pose_estimate::PoseEstimate;
