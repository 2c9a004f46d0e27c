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
use crate::tune::samples::TICK_S;
use fixed::types::I16F16;
use fw_core::binary64::Binary64;
use fw_core::eeprom::{Field, Gain, Gains};
use fw_core::motion::pid::Pid;
use host_link::settings::Settings;
use serde::Serialize;

/// The integral's time constant, in lags.
const INTEGRAL_LAGS: f64 = 10.0;

/// The factors of a PID as the EEPROM holds them, per 10 ms sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Factors {
    /// Proportional, percent per degree or millimetre.
    pub p: f64,
    /// Integral, percent per degree or millimetre and sample.
    pub i: f64,
    /// Derivative, percent per degree or millimetre a sample.
    pub d: f64,
    /// Back-calculation factor.
    pub anti_windup: f64,
}

impl Factors {
    /// Those of an axis.
    pub fn of(axis: Axis, settings: &Settings) -> Self {
        let factor = |field| f64::from_bits(settings.get(field));
        let [p, i, d, anti_windup] = axis.fields().map(factor);
        Self {
            p,
            i,
            d,
            anti_windup,
        }
    }

    /// The raw values of the axis' fields.
    pub fn values(&self, axis: Axis) -> [(&'static Field, u64); 4] {
        let [p, i, d, anti_windup] = axis.fields();
        [
            (p, self.p.to_bits()),
            (i, self.i.to_bits()),
            (d, self.d.to_bits()),
            (anti_windup, self.anti_windup.to_bits()),
        ]
    }

    /// What the firmware makes of them; 0 for what it does not accept.
    fn gains(&self) -> Gains {
        let gain = |factor: f64| {
            let fixed = Binary64(factor.to_bits()).to_fixed().unwrap_or_default();
            Gain::new(fixed).unwrap_or_default()
        };
        Gains {
            p: gain(self.p),
            i: gain(self.i),
            d: gain(self.d),
            anti_windup: gain(self.anti_windup),
        }
    }
}

/// Factors for the model; `present` gives the anti wind-up factor.
pub fn propose(model: &DriveModel, damping: f64, present: &Factors) -> Factors {
    let lag = model.lag_s.max(TICK_S);
    let p = 1.0 / (4.0 * damping * damping * lag * model.gain);
    Factors {
        p: round(p),
        i: round(p * TICK_S / (INTEGRAL_LAGS * lag)),
        d: round(p * lag / TICK_S),
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

impl Response {
    /// Whether it settles later, or as late with more overshoot.
    #[must_use]
    pub fn is_worse_than(&self, other: &Self) -> bool {
        let rank = |response: &Self| {
            let settled_s = response.settled_s.unwrap_or(f64::INFINITY);
            (settled_s, response.overshoot)
        };
        rank(self) > rank(other)
    }
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
pub fn predict(axis: Axis, model: &DriveModel, factors: &Factors) -> Response {
    let (target, tolerance, limit) = axis.prediction_case();
    let reach = limit.min(100.0 - model.dead_zone);
    let mut pid = Pid::new(&factors.gains(), I16F16::saturating_from_num(limit));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn predicted_response_is_that_of_the_loops_poles() {
        let model = crate::tune::tests::known_drive(20.0, 0.0, 0.2);
        let present = Factors::of(Axis::Rotate, &Settings::first_board().unwrap());
        let mut factors = propose(&model, 0.5, &present);
        factors.i = 0.0;
        let response = predict(Axis::Rotate, &model, &factors);
        // 125 / ((s + 5)(s² + 5s + 25)), by partial fractions; the steps are some milliseconds ahead.
        let position = |t: f64| {
            let ring = (-2.5 * t).exp() * (18.75_f64.sqrt() * t).sin() * (4.0_f64 / 3.0).sqrt();
            90.0 * (1.0 - (-5.0 * t).exp() - ring)
        };
        let off = |&(t, at): &(f64, f64)| (at - position(t)).abs();
        let off = response.curve.iter().map(off).fold(0.0, f64::max);
        assert!(off < 1.5, "{off}");
        let highest = response.curve.iter().map(|now| now.1).fold(0.0, f64::max);
        assert!((response.overshoot - (highest - 90.0)).abs() < 1e-9);
        let is_off = |now: &&(f64, f64)| (now.1 - 90.0).abs() > 1.0;
        let last = response.curve.iter().rfind(is_off);
        let since_s = response.settled_s.unwrap() - last.unwrap().0;
        assert!((since_s - 0.01).abs() < 1e-6, "{response:?}");
    }
}
