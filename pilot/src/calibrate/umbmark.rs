//! `UMBmark` (J. Borenstein, L. Feng: Measurement and Correction of Systematic Odometry Errors in Mobile
//! Robots, IEEE Transactions on Robotics and Automation 12, 1996): squares clockwise and
//! counter-clockwise, and from the two clusters of ends the errors of the track and of the wheels' ratio.
//! One direction alone cannot separate them, they may even cancel.
//!
//! The paper's two formulas hold for small angles. What is written comes from
//! [`least_squares`](super::least_squares): the track and the ratio with which the very paths that the wheels rolled
//! end where they were measured.

use super::least_squares::fit_factors;
use super::wheel_geometry::WheelGeometry;
use super::wheel_path::WheelPath;
use crate::ground_truth::Point;
use serde::Serialize;

/// Largest change of the wheels' ratio accepted.
pub const ACCEPTED_RATIO: f64 = 0.12;
/// Largest change of the track accepted. The scale of `distance` changes it too.
pub const ACCEPTED_TRACK: f64 = 0.15;
/// Part of a side that the ends may be off their explanation, root mean square.
pub const ACCEPTED_RESIDUAL: f64 = 0.03;

/// One square.
#[derive(Clone, Debug, PartialEq)]
pub struct SquareRun {
    /// The direction.
    pub clockwise: bool,
    /// What the wheels rolled.
    pub path: WheelPath,
    /// Where it ended.
    pub measured: Point,
}

impl SquareRun {
    /// The measured end minus that of odometry.
    pub fn error(&self) -> Point {
        self.measured.minus(self.path.odometry_end())
    }
}

/// The direction's word.
pub const fn direction_name(clockwise: bool) -> &'static str {
    if clockwise {
        "clockwise"
    } else {
        "counter-clockwise"
    }
}

/// The ends of the runs in one direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EndCluster {
    /// Runs.
    pub runs: usize,
    /// Mean of their errors: the centre of gravity.
    pub centre: Point,
    /// Its distance from no error, millimetres.
    pub offset_mm: f64,
    /// Standard deviation of the ends about their centre, millimetres; 0 for a single run.
    pub deviation_mm: f64,
}

/// How good the odometry is, by `UMBmark`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Clockwise.
    pub clockwise: EndCluster,
    /// Counter-clockwise.
    pub counter_clockwise: EndCluster,
    /// The paper's measure: the larger offset of the two, millimetres.
    pub worst_mm: f64,
}

/// The correction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The ends as they were.
    pub score: Score,
    /// True over configured track, and its standard deviation.
    pub track: f64,
    /// Standard deviation of it.
    pub track_deviation: f64,
    /// True over configured ratio of the right wheel to the left.
    pub ratio: f64,
    /// Standard deviation of it.
    pub ratio_deviation: f64,
    /// Root mean square of the residuals, millimetres.
    pub residual_mm: f64,
    /// The wheels with what is [`certain`]; their mean is unchanged.
    pub wheels: WheelGeometry,
}

/// A correction that exceeds its standard deviation: a smaller one may as well be wrong.
pub fn certain(factor: f64, deviation: f64) -> Option<f64> {
    ((factor - 1.0).abs() > deviation).then_some(factor)
}

/// The clusters of both directions.
///
/// # Errors
/// A sentence if one direction is missing.
pub fn score(runs: &[SquareRun]) -> Result<Score, String> {
    let cluster = |clockwise: bool| {
        let runs = runs.iter().filter(|run| run.clockwise == clockwise);
        let ends: Vec<Point> = runs.map(SquareRun::error).collect();
        EndCluster::of(&ends).ok_or_else(|| {
            let direction = direction_name(clockwise);
            format!("no run {direction}: both directions are needed")
        })
    };
    let (clockwise, counter_clockwise) = (cluster(true)?, cluster(false)?);
    Ok(Score {
        clockwise,
        counter_clockwise,
        worst_mm: clockwise.offset_mm.max(counter_clockwise.offset_mm),
    })
}

impl EndCluster {
    fn of(ends: &[Point]) -> Option<Self> {
        if ends.is_empty() {
            return None;
        }
        #[allow(clippy::cast_precision_loss)] // a handful
        let count = ends.len() as f64;
        let mean = |of: fn(&Point) -> f64| ends.iter().map(of).sum::<f64>() / count;
        let centre = Point::new(mean(|end| end.ahead_mm), mean(|end| end.left_mm));
        let square = |end: &Point| end.minus(centre).distance_mm().powi(2);
        let squares: f64 = ends.iter().map(square).sum();
        Some(Self {
            runs: ends.len(),
            centre,
            offset_mm: centre.distance_mm(),
            deviation_mm: (squares / (count - 1.0).max(1.0)).sqrt(),
        })
    }
}

/// The track and the ratio that explain all ends best.
///
/// # Errors
/// A sentence: what was measured, what is accepted.
pub fn solve(runs: &[SquareRun], side_mm: f64) -> Result<Estimate, String> {
    let score = score(runs)?;
    let present = *runs.first().ok_or("no run")?.path.wheels();
    for run in runs {
        let off = run.error().distance_mm();
        if off.is_nan() || off > 2.0 * side_mm {
            return Err(format!(
                "an end was measured {:.0} mm ahead and {:.0} mm to the left, {off:.0} mm from its odometry's \
                 end; accepted is at most twice the side of {side_mm:.0} mm",
                run.measured.ahead_mm, run.measured.left_mm
            ));
        }
    }
    let fitted = fit_factors(
        |[track, ratio]| {
            let wheels = present.with_track(track).with_ratio(ratio);
            runs.iter()
                .flat_map(|run| {
                    let off = run.path.end_with(&wheels).minus(run.measured);
                    [off.ahead_mm, off.left_mm]
                })
                .collect()
        },
        [ACCEPTED_TRACK, ACCEPTED_RATIO],
    );
    let [track, ratio] = fitted.factors;
    for (what, factor, accepted) in [
        ("track", track, ACCEPTED_TRACK),
        ("wheels' ratio", ratio, ACCEPTED_RATIO),
    ] {
        if (factor - 1.0).abs() > accepted {
            return Err(format!(
                "the ends make the {what} {:+.1} % different; accepted is {:.0} % either way. They were \
                 {:.0} mm (clockwise) and {:.0} mm off: measure again, and see that no wheel slips",
                (factor - 1.0) * 100.0,
                accepted * 100.0,
                score.clockwise.offset_mm,
                score.counter_clockwise.offset_mm
            ));
        }
    }
    let accepted = ACCEPTED_RESIDUAL * side_mm;
    if fitted.residual > accepted {
        return Err(format!(
            "no track and no diameters explain the ends: {:.0} mm remain (root mean square), accepted are \
             {accepted:.0} mm. Calibrate the distance first, see that no wheel slips, and measure along the \
             directions of the start",
            fitted.residual
        ));
    }
    let [track_deviation, ratio_deviation] = fitted.deviations;
    let [track_kept, ratio_kept] = [(track, track_deviation), (ratio, ratio_deviation)]
        .map(|(factor, deviation)| certain(factor, deviation).unwrap_or(1.0));
    Ok(Estimate {
        score,
        track,
        track_deviation,
        ratio,
        ratio_deviation,
        residual_mm: fitted.residual,
        wheels: present.with_track(track_kept).with_ratio(ratio_kept),
    })
}
