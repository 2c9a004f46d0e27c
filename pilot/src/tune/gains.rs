//! A PID for a fitted drive, and its predicted response.
//!
//! # The rule
//! Seen from the duty beyond the dead zone, which the firmware compensates, the drive is
//! `gain / (s · (τs + 1)²)`. A derivative of `D = P · τ` (per second) cancels one of its lags. What
//! is left is a loop of second order, `τs² + s + gain · P`, whose damping ζ is chosen:
//! `P = 1 / (4 ζ² τ gain)`; for ζ = 1/√2 this is the magnitude optimum, ζ = 0.8 overshoots by 1.5 %.
//! The integral is slow beside that, `I = P · 10 ms / 10 τ`: it only removes what is left at the
//! end. Per sample of 10 ms, as the EEPROM has it, `D` is a hundred times as large as per second.
//! The anti wind-up factor stays as it is.

use super::Axis;
use super::drive_model::DriveModel;
use fixed::types::I16F16;
use fw_core::binary64::Binary64;
use fw_core::eeprom::Gains;
use fw_core::motion::pid::Pid;
use host_link::samples::TICK_S;
use serde::Serialize;

/// The integral's time constant, in lags.
const INTEGRAL_LAGS: f64 = 10.0;

/// Gains for the model; `present` gives the anti wind-up factor.
#[must_use]
pub fn propose(model: &DriveModel, damping: f64, present: &Gains) -> Gains {
    let lag = model.lag_s.max(TICK_S);
    let p = 1.0 / (4.0 * damping * damping * lag * model.gain);
    let double = |value: f64| Binary64(value.to_bits());
    Gains {
        p: double(round(p)),
        i: double(round(p * TICK_S / (INTEGRAL_LAGS * lag))),
        d: double(round(p * lag / TICK_S)),
        anti_windup: present.anti_windup,
    }
}

/// To five significant digits, like the first board's.
fn round(value: f64) -> f64 {
    format!("{value:.4e}").parse().unwrap_or(value)
}

/// The step response of a loop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Response {
    /// The set-point, degrees or millimetres.
    pub target: f64,
    /// Beyond it, degrees or millimetres.
    pub overshoot: f64,
    /// Seconds after which it stays within the tolerance; none: not within the time.
    pub settled_s: Option<f64>,
    /// Position over time.
    #[serde(skip)]
    pub curve: Vec<(f64, f64)>,
}

impl Axis {
    /// The default damping. Forward may be lower: most of a distance is driven at the
    /// limit, which keeps the overshoot small, and the last millimetres need force against friction.
    #[must_use]
    pub const fn damping(self) -> f64 {
        match self {
            Self::Rotate => 0.8,
            Self::Move => 0.5,
        }
    }

    /// The set-point of a prediction, the tolerance that counts as settled, and the largest output
    /// that the firmware gives the loop, percent.
    const fn prediction_case(self) -> (f64, f64, f64) {
        match self {
            Self::Rotate => (90.0, 1.0, 50.0),
            Self::Move => (300.0, 5.0, 100.0),
        }
    }
}

/// Seconds predicted.
const HORIZON_S: f64 = 5.0;
/// Steps of the drive's model in one tick.
const FINE: u8 = 10;

/// What the firmware's own regulator does with these gains and this drive, from rest.
#[must_use]
pub fn predict(axis: Axis, model: &DriveModel, gains: &Gains) -> Response {
    let (target, tolerance, limit) = axis.prediction_case();
    let reach = limit.min(100.0 - model.dead_zone);
    let mut pid = Pid::new(gains, I16F16::saturating_from_num(limit));
    let (mut position, mut speed, mut drive, mut last) = (0.0, 0.0, 0.0, 0.0);
    let (mut overshoot, mut settled_s) = (0.0_f64, None);
    let mut points = Vec::new();
    let dt = TICK_S / f64::from(FINE);
    let mut t = 0.0;
    while t < HORIZON_S {
        let output = pid.step(
            I16F16::saturating_from_num(target - position),
            I16F16::saturating_from_num(position - last),
        );
        last = position;
        let wanted = model.gain * output.to_num::<f64>().clamp(-reach, reach);
        for _ in 0..FINE {
            drive += (wanted - drive) * dt / model.lag_s;
            speed += (drive - speed) * dt / model.lag_s;
            position += speed * dt;
        }
        t += TICK_S;
        points.push((t, position));
        overshoot = overshoot.max(position - target);
        if (position - target).abs() > tolerance {
            settled_s = None;
        } else {
            settled_s = settled_s.or(Some(t));
        }
    }
    Response {
        target,
        overshoot,
        settled_s,
        curve: points,
    }
}
