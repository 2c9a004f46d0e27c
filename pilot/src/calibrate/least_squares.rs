//! Least squares for two factors, from anywhere within their range: a coarse search over all of it,
//! then Gauss-Newton with damping (Levenberg-Marquardt). Errors of 5 % bend a metre by 20° on a
//! track of 125 mm: far beyond what small-angle formulas can correct in one go.

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
        let damped = [
            [normal[0][0] * (1.0 + damping), normal[0][1]],
            [normal[1][0], normal[1][1] * (1.0 + damping)],
        ];
        let Some(inverse) = inverted(damped) else {
            break;
        };
        let step = times(inverse, gradient);
        let next = [factors[0] - step[0], factors[1] - step[1]];
        let cost = cost(next);
        if cost < least {
            (factors, least) = (next, cost);
            damping = (damping * 0.1).max(1e-12);
        } else {
            damping *= 10.0;
        }
        if step[0].abs().max(step[1].abs()) < 1e-12 || damping > 1e12 {
            break;
        }
    }
    let (normal, _, count) = linear(&residuals, factors);
    let variance = least / (count - 2.0);
    let deviations = inverted(normal).map_or([f64::NAN; 2], |inverse| {
        [
            (variance * inverse[0][0]).sqrt(),
            (variance * inverse[1][1]).sqrt(),
        ]
    });
    Fitted {
        factors,
        deviations,
        residual: (least / count).sqrt(),
    }
}

type Square = [[f64; 2]; 2];

/// `JᵀJ`, `Jᵀr` and the number of residuals.
fn linear(residuals: &impl Fn([f64; 2]) -> Vec<f64>, at: [f64; 2]) -> (Square, [f64; 2], f64) {
    let here = residuals(at);
    let beside = [
        residuals([at[0] + DELTA, at[1]]),
        residuals([at[0], at[1] + DELTA]),
    ];
    let (mut normal, mut gradient, mut count) = ([[0.0; 2]; 2], [0.0; 2], 0.0);
    for ((r, a), b) in here.iter().zip(&beside[0]).zip(&beside[1]) {
        let slope = [(a - r) / DELTA, (b - r) / DELTA];
        for i in 0..2 {
            for j in 0..2 {
                normal[i][j] += slope[i] * slope[j];
            }
            gradient[i] += slope[i] * r;
        }
        count += 1.0;
    }
    (normal, gradient, count)
}

fn inverted(m: Square) -> Option<Square> {
    let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    if !determinant.is_normal() {
        return None;
    }
    Some([
        [m[1][1] / determinant, -m[0][1] / determinant],
        [-m[1][0] / determinant, m[0][0] / determinant],
    ])
}

fn times(m: Square, v: [f64; 2]) -> [f64; 2] {
    [
        m[0][0] * v[0] + m[0][1] * v[1],
        m[1][0] * v[0] + m[1][1] * v[1],
    ]
}
