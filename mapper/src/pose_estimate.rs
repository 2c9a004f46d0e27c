//! A pose and how uncertain it is.

use crate::Pose2;

/// An estimated pose in the map's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseEstimate {
    /// The most likely pose.
    pub pose: Pose2,
    /// Covariance of x, y (mm) and heading (rad).
    pub covariance: [[f64; 3]; 3],
}
