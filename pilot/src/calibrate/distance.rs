//! A drive that odometry took for straight, and its true end: the scale of diameters and track.
//!
//! Wheels whose ratio is not the configured one bend the path. The measured offset to the side gives
//! the bend, and with it the wheels' ratio and the length of the path. Without an offset the path is
//! taken as straight.
//!
//! Track and diameters are scaled together: rotations stay as they are, for `umbmark` to correct.

use super::least_squares::fit_factors;
use super::wheel_geometry::WheelGeometry;
use super::wheel_path::WheelPath;
use crate::ground_truth::Point;
use serde::Serialize;

/// Largest change of the scale accepted.
pub const ACCEPTED: f64 = 0.10;
/// Largest change of the wheels' ratio accepted. A track that is wrong too makes it look larger.
pub const ACCEPTED_RATIO: f64 = 0.15;

/// Shortest accepted drive, millimetres: a millimetre of the tape is half a percent of it.
pub const SHORTEST_MM: f64 = 200.0;

/// What a person measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// Millimetres ahead of the start; without an offset to the side, straight from start to end.
    pub ahead_mm: f64,
    /// Millimetres to the left of the line that the robot faced at the start, if measured.
    pub left_mm: Option<f64>,
}

impl From<Point> for Measured {
    fn from(Point { ahead_mm, left_mm }: Point) -> Self {
        let left_mm = Some(left_mm);
        Self { ahead_mm, left_mm }
    }
}

/// The correction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Scale {
    /// The end by odometry.
    pub odometry_end: Point,
    /// How much longer everything is.
    pub scale: f64,
    /// How much larger the right wheel is against the left; 1 where the offset was not measured.
    pub ratio: f64,
    /// The corrected wheels.
    pub wheels: WheelGeometry,
}

/// The wheels with which the path ends where it was measured.
///
/// # Errors
/// A sentence: what was measured and what is accepted.
// Requirement: DOC-4.1-6
pub fn solve(path: &WheelPath, measured: &Measured) -> Result<Scale, String> {
    let present = *path.wheels();
    let odometry_end = path.odometry_end();
    let length = odometry_end.distance_mm();
    if length < SHORTEST_MM {
        return Err(format!(
            "the drive was {length:.0} mm long by odometry; accepted is {SHORTEST_MM:.0} mm or more"
        ));
    }
    let left_mm = measured.left_mm.unwrap_or(0.0);
    let straight = measured.ahead_mm.hypot(left_mm);
    // A bend that was measured too makes the straight line shorter than the path.
    let shortest = if measured.left_mm.is_some() {
        0.5
    } else {
        1.0 - ACCEPTED
    };
    let (low, high) = (length * shortest, length * (1.0 + ACCEPTED));
    if !(low..=high).contains(&straight) || measured.ahead_mm <= 0.0 {
        return Err(format!(
            "{straight:.1} mm were measured, odometry has {length:.1} mm; accepted is {low:.0} to \
             {high:.0} mm. Did a wheel slip, or is the figure in another unit?"
        ));
    }
    let (scale, ratio) = if measured.left_mm.is_some() {
        let fitted = fit_factors(
            |[scale, ratio]| {
                let end = path.end_with(&present.scaled(scale).with_ratio(ratio));
                vec![end.ahead_mm - measured.ahead_mm, end.left_mm - left_mm]
            },
            [ACCEPTED * 1.5, ACCEPTED_RATIO * 1.5],
        );
        let [scale, ratio] = fitted.factors;
        if fitted.residual > 1.0 {
            return Err(format!(
                "no diameters explain an end {:.1} mm ahead and {left_mm:.1} mm to the left ({:.1} mm remain)",
                measured.ahead_mm, fitted.residual
            ));
        }
        (scale, ratio)
    } else {
        (straight / length, 1.0)
    };
    for (what, factor, accepted) in [
        ("scale", scale, ACCEPTED),
        ("wheels' ratio", ratio, ACCEPTED_RATIO),
    ] {
        if (factor - 1.0).abs() > accepted {
            return Err(format!(
                "the end was measured {:.1} mm ahead and {left_mm:.1} mm to the left, which makes the {what} \
                 {:+.1} % different; accepted is {:.0} % either way",
                measured.ahead_mm,
                (factor - 1.0) * 100.0,
                accepted * 100.0
            ));
        }
    }
    Ok(Scale {
        odometry_end,
        scale,
        ratio,
        wheels: present.scaled(scale).with_ratio(ratio),
    })
}
