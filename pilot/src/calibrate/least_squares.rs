//! Least squares for two factors, from anywhere within their range: a coarse search over all of it,
//! then Gauss-Newton with damping (Levenberg-Marquardt). Errors of 5 % bend a metre by 20° on a
//! track of 125 mm: far beyond what small-angle formulas can correct in one go.

use nalgebra::{Matrix2, Vector2};

/// The two factors that explain the measurements best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitted {
    /// The factors.
    pub factors: [f64; 2],
    /// Their standard deviations; not a number without more measurements than factors.
    pub deviations: [f64; 2],
    /// Root mean square of what is left, in the residuals' unit.
    pub residual: f64,
}

/// Steps of the coarse search to each side of 1.
const COARSE: i32 = 12;
/// Steps of Gauss-Newton at most.
const STEPS: usize = 60;
/// Difference for the derivatives.
const DELTA: f64 = 1e-6;

/// Finds the factors within `1 ± reach` for which the sum of the squared `residuals` is least. They
/// must be as many for every pair of factors, at least two.
pub fn fit_factors(residuals: impl Fn([f64; 2]) -> Vec<f64>, reach: [f64; 2]) -> Fitted {
    let cost = |factors| residuals(factors).iter().map(|r| r * r).sum::<f64>();
    let mut best = ([1.0, 1.0], cost([1.0, 1.0]));
    for i in -COARSE..=COARSE {
        for j in -COARSE..=COARSE {
            let at = |n: i32, reach: f64| 1.0 + reach * f64::from(n) / f64::from(COARSE);
            let factors = [at(i, reach[0]), at(j, reach[1])];
            let cost = cost(factors);
            if cost < best.1 {
                best = (factors, cost);
            }
        }
    }
    let (mut factors, mut least) = best;
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let (normal, gradient, _) = linear(&residuals, factors);
        let damped = normal + Matrix2::from_diagonal(&normal.diagonal()) * damping;
        let Some(inverse) = damped.try_inverse() else {
            break;
        };
        let step = inverse * gradient;
        let next = [factors[0] - step[0], factors[1] - step[1]];
        let cost = cost(next);
        if cost < least {
            (factors, least) = (next, cost);
            damping = (damping * 0.1).max(1e-12);
        } else {
            damping *= 10.0;
        }
        if step.amax() < 1e-12 || damping > 1e12 {
            break;
        }
    }
    let (normal, _, count) = linear(&residuals, factors);
    let variance = least / (count - 2.0);
    let deviations = normal.try_inverse().map_or([f64::NAN; 2], |inverse| {
        inverse.diagonal().map(|of| (variance * of).sqrt()).into()
    });
    Fitted {
        factors,
        deviations,
        residual: (least / count).sqrt(),
    }
}

/// `JᵀJ`, `Jᵀr` and the number of residuals.
fn linear(
    residuals: &impl Fn([f64; 2]) -> Vec<f64>,
    at: [f64; 2],
) -> (Matrix2<f64>, Vector2<f64>, f64) {
    let here = residuals(at);
    let beside = [
        residuals([at[0] + DELTA, at[1]]),
        residuals([at[0], at[1] + DELTA]),
    ];
    let (mut normal, mut gradient, mut count) = (Matrix2::zeros(), Vector2::zeros(), 0.0);
    for ((r, a), b) in here.iter().zip(&beside[0]).zip(&beside[1]) {
        let slope = Vector2::new(a - r, b - r) / DELTA;
        normal += slope * slope.transpose();
        gradient += slope * *r;
        count += 1.0;
    }
    (normal, gradient, count)
}
