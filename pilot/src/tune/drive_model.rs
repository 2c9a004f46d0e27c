//! A model of the drive from its steps: `speed = gain · (|duty| − dead zone)` through two equal
//! first-order lags.
//!
//! From rest the travel is `K · (t − 2τ + (t + 2τ)·e^(−t/τ))` with `K` the steady speed. For a
//! given lag τ that is linear in gain and gain · dead zone: ordinary least squares. The lag itself
//! is searched for the least residual. Two levels of duty are needed to separate gain and
//! dead zone.

use crate::tune::samples::Sample;
use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

/// The drive.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DriveModel {
    /// Steady speed per percent beyond the dead zone, degrees or millimetres a second.
    pub gain: f64,
    /// Duty that moves nothing, percent.
    pub dead_zone: f64,
    /// Each of the two lags, seconds.
    pub lag_s: f64,
    /// Root mean square of what the model leaves unexplained, degrees or millimetres.
    pub residual: f64,
    /// The steps it was fitted to.
    pub steps: usize,
}

/// One step: duty held, and the travel since it began.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// When it began, seconds.
    pub begun_s: f64,
    /// Where it began.
    pub from: f64,
    /// Duty, percent, not 0.
    pub percent: f64,
    /// Seconds since it began, and the travel.
    pub travel: Vec<(f64, f64)>,
}

/// Samples a step has at least.
const SHORTEST: usize = 20;

/// The steps in a record: from a sample of duty 0 on to the last with the same duty. A step whose
/// beginning was lost is left out.
pub fn steps(samples: &[Sample]) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    let mut open = false;
    for (before, now) in samples.iter().zip(samples.iter().skip(1)) {
        let same = now.percent.to_bits() == before.percent.to_bits();
        if !same {
            open = before.percent == 0.0 && now.percent != 0.0 && now.tick == before.tick + 1;
            if open {
                // The duty was set at the end of this tick: its measurement is the last at rest.
                steps.push(Step {
                    begun_s: now.seconds(),
                    from: now.value,
                    percent: now.percent,
                    travel: vec![(0.0, 0.0)],
                });
            }
        } else if let Some(step) = steps.last_mut().filter(|_| open) {
            step.travel
                .push((now.seconds() - step.begun_s, now.value - step.from));
        }
    }
    steps.retain(|step| step.travel.len() >= SHORTEST);
    steps
}

/// The travel after `t` seconds at steady speed 1, through two lags of `lag` seconds.
pub fn unit_travel(t: f64, lag: f64) -> f64 {
    t - 2.0 * lag + (t + 2.0 * lag) * (-t / lag).exp()
}

impl DriveModel {
    /// The model's travel of a step after `t` seconds.
    pub fn step_travel(&self, percent: f64, t: f64) -> f64 {
        let speed = self.gain * (percent.abs() - self.dead_zone);
        speed.copysign(percent) * unit_travel(t, self.lag_s)
    }
}

/// Shortest and longest lag searched, seconds.
const LAGS: (f64, f64) = (0.01, 1.0);
/// Lags tried before the search closes in.
const TRIES: u8 = 60;

/// Largest residual, as a part of the longest travel.
const MAX_RESIDUAL: f64 = 0.15;

/// Fits the model.
///
/// # Errors
/// A sentence: too few steps or levels, nothing moved, or the model does not describe what happened.
pub fn fit(steps: &[Step]) -> Result<DriveModel, String> {
    let levels = |step: &Step| step.percent.abs();
    let low = steps.iter().map(levels).fold(f64::MAX, f64::min);
    let high = steps.iter().map(levels).fold(0.0, f64::max);
    if steps.len() < 2 || high - low < 5.0 {
        return Err(format!(
            "{} usable steps are too few: steps of two levels at least 5 % apart are needed",
            steps.len()
        ));
    }
    let travels = steps.iter().flat_map(|step| &step.travel);
    let longest = travels.map(|(_, travel)| travel.abs()).fold(0.0, f64::max);
    if longest < 1.0 {
        return Err(format!("nothing moved ({longest:.3} at most)"));
    }
    let (gain, offset, lag_s, residual) = search_lag(steps).ok_or("the steps fit no model")?;
    let dead_zone = -offset / gain;
    if gain.is_nan() || gain <= 0.0 || !(-20.0..high).contains(&dead_zone) {
        return Err(format!(
            "the steps give a gain of {gain:.3} and a dead zone of {dead_zone:.1} %: accepted is a positive gain and a dead zone below the highest level"
        ));
    }
    if residual > MAX_RESIDUAL * longest {
        return Err(format!(
            "the model leaves {residual:.1} of at most {longest:.1} unexplained; check that the robot was not held and did not slip"
        ));
    }
    Ok(DriveModel {
        gain,
        dead_zone: dead_zone.max(0.0),
        lag_s,
        residual,
        steps: steps.len(),
    })
}

type Fitted = (f64, f64, f64, f64);

/// Gain, −gain · dead zone, lag and residual of the lag with the least residual.
fn search_lag(steps: &[Step]) -> Option<Fitted> {
    let ratio = (LAGS.1 / LAGS.0).powf(1.0 / f64::from(TRIES));
    let coarse = (0..=TRIES)
        .map(|index| LAGS.0 * ratio.powi(index.into()))
        .filter_map(|lag| linear(steps, lag))
        .min_by(|one, other| one.3.total_cmp(&other.3))?;
    let (mut low, mut high) = (coarse.2 / ratio, coarse.2 * ratio);
    for _ in 0..40 {
        let third = (high - low) / 3.0;
        let (left, right) = (linear(steps, low + third)?, linear(steps, high - third)?);
        if left.3 < right.3 {
            high = right.2;
        } else {
            low = left.2;
        }
    }
    linear(steps, f64::midpoint(low, high))
}

/// Least squares for one lag.
fn linear(steps: &[Step], lag: f64) -> Option<Fitted> {
    let rows = || {
        steps.iter().flat_map(move |step| {
            step.travel.iter().map(move |&(t, measured)| {
                let unit = unit_travel(t, lag).copysign(step.percent);
                (Vector2::new(unit * step.percent.abs(), unit), measured)
            })
        })
    };
    let (mut normal, mut moment, mut count) = (Matrix2::zeros(), Vector2::zeros(), 0.0);
    for (row, y) in rows() {
        normal += row * row.transpose();
        moment += row * y;
        count += 1.0;
    }
    let determinant: f64 = normal.determinant();
    if determinant.is_nan() || determinant <= 1e-9 * normal.m11 * normal.m22 {
        return None;
    }
    let fitted = normal.try_inverse()? * moment;
    let squares: f64 = rows().map(|(row, y)| (y - fitted.dot(&row)).powi(2)).sum();
    Some((fitted.x, fitted.y, lag, (squares / count).sqrt()))
}

/// The model's position beside the measured one, seconds and position; not-a-number between steps.
pub fn replay(model: &DriveModel, steps: &[Step]) -> Vec<(f64, f64)> {
    let mut points = Vec::new();
    for step in steps {
        points.extend(step.travel.iter().map(|&(t, _)| {
            (
                step.begun_s + t,
                step.from + model.step_travel(step.percent, t),
            )
        }));
        points.push((f64::NAN, f64::NAN));
    }
    points
}
