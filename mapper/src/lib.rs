//! Localisation, and log-odds occupancy grids from poses and ranges.
//!
//! ```
//! use mapper::{map_iou, Cell, Config, Mapper, Point, Pose2, Segment};
//!
//! // The robot backs off from a wall 1 m ahead of its start; the front sensor sits 80 mm ahead.
//! let mut mapper = Mapper::new(Config::default());
//! for step in 0..60 {
//!     let x_mm = -2.0 * f64::from(step);
//!     mapper.observe(&Pose2::new(x_mm, 0.0, 0.0), &[Some(920.0 - x_mm), None, None]);
//! }
//! let grid = mapper.grid();
//! assert_eq!(grid.cell_at(Point::new(500.0, 0.0)), Cell::Free);
//! assert_eq!(grid.cell_at(Point::new(1000.0, 0.0)), Cell::Occupied);
//!
//! let wall = Segment::new(Point::new(1000.0, -300.0), Point::new(1000.0, 300.0));
//! assert!(map_iou(grid, &[wall], 100.0).precision > 0.9);
//! ```
//!
//! [`Mapper`] takes the reported pose and ranges of every frame, rejects repeats and outliers
//! ([`Config`]), and enters the rest into a [`Grid`] by a model of the sonar's cone
//! ([`SonarModel`]). [`ros`] writes the grid as the PGM and YAML pair of ROS map servers,
//! [`map_plot`] and [`line_plot`] draw PNG files, [`evaluation`] compares a grid with known walls.
//!
//! [`Localiser`] does the same without true poses: it takes odometry, gyroscope and ranges, estimates
//! pose and calibration by what it has mapped, and finds itself on a saved map.
//!
//! Lengths, angles and frames are those of [`geometry`]; the grid is in the frame of the poses.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod evaluation;
mod grid;
pub mod line_plot;
mod localiser;
pub mod map_plot;
mod mapper;
mod png_canvas;
mod pose_estimate;
mod range_filter;
pub mod ros;
mod sonar_model;

pub use evaluation::{MapScore, map_iou};
pub use geometry::{Mount, Point, Pose2, Segment};
pub use grid::{Cell, Grid};
pub use localiser::{
    CalibrationEstimate, Localiser, LocaliserConfig, MatcherConfig, MotionNoise, Observation,
};
pub use mapper::{Config, Counters, Mapper};
pub use png_canvas::PlotError;
pub use pose_estimate::PoseEstimate;
pub use sonar_model::SonarModel;
