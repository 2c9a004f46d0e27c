//! Exact arcs in double-double arithmetic (106 bits), their angle from whole counts in rational
//! arithmetic: what every odometry is measured against. The comparison in `tests/bench` uses this
//! file, too.

use std::ops::{Add, Mul, Neg, Sub};

use super::{Platform, Turns};

/// A number as the unevaluated sum of two binary64: 106 bits (Dekker; Knuth).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Twofold(pub f64, pub f64);

impl Twofold {
    fn sum(a: f64, b: f64) -> Self {
        let s = a + b;
        let t = s - a;
        Self(s, (a - (s - t)) + (b - t))
    }

    /// `a` below 2¹⁰⁶ in magnitude.
    pub fn of(a: i128) -> Self {
        let high = a as f64;
        Self::sum(high, (a - high as i128) as f64)
    }

    /// `self / d`, by two steps of long division.
    fn over(self, d: Self) -> Self {
        let first = self.0 / d.0;
        let rest = self - d * Self(first, 0.0);
        let second = rest.0 / d.0;
        let rest = rest - d * Self(second, 0.0);
        Self::sum(first, second) + Self(rest.0 / d.0, 0.0)
    }

    /// Sum of `(−1)ᵏ x^(2k+odd) / (2k+odd)!`; |x| ≤ 1.
    fn series(self, odd: u32) -> Self {
        let square = self * self;
        let mut term = if odd == 1 { self } else { Self(1.0, 0.0) };
        let mut total = term;
        for k in 1..16 {
            let n = 2 * k + odd;
            term = -(term * square).over(Self(f64::from(n * (n - 1)), 0.0));
            total = total + term;
        }
        total
    }
}

impl Add for Twofold {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        let high = Self::sum(self.0, b.0);
        let low = Self::sum(self.1, b.1);
        let high = Self::sum(high.0, high.1 + low.0);
        Self::sum(high.0, high.1 + low.1)
    }
}
impl Neg for Twofold {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}
impl Sub for Twofold {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        self + -b
    }
}
impl Mul for Twofold {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        let p = self.0 * b.0;
        let e = self.0.mul_add(b.0, -p);
        Self::sum(p, e + (self.0 * b.1 + self.1 * b.0))
    }
}

/// π to 106 bits.
const PI2: Twofold = Twofold(std::f64::consts::PI, 1.224_646_799_147_353_2e-16);

/// Exact arcs (document, 4.1) over the same counts.
pub(super) struct Exact {
    left: i128,
    right: i128,
    pub platform: Platform,
    /// Millimetres.
    pub x: Twofold,
    /// Millimetres.
    pub y: Twofold,
}

impl Exact {
    pub fn new(platform: Platform) -> Self {
        Self {
            left: 0,
            right: 0,
            platform,
            x: Twofold::default(),
            y: Twofold::default(),
        }
    }

    /// Counts the wheels rolled forward.
    pub fn step(&mut self, left: i64, right: i64) {
        let p = &self.platform;
        let (dl, dr) = (
            i128::from(p.wheel_diameter_left),
            i128::from(p.wheel_diameter_right),
        );
        let (left, right) = (i128::from(left), i128::from(right));
        // β + ψ/2 in turns, a ratio of whole numbers: no rounding, modulo 1 exactly.
        let whole = 4 * i128::from(p.counts_per_turn) * i128::from(p.track);
        let middle = (2 * self.right + right) * dr - (2 * self.left + left) * dl;
        let eighth = (middle * 8 + whole / 2).div_euclid(whole);
        let rest = Twofold::of(middle * 8 - eighth * whole).over(Twofold::of(whole * 4)) * PI2;
        let (s, c) = (rest.series(1), rest.series(0));
        let half = Twofold(std::f64::consts::FRAC_1_SQRT_2, -4.833_646_656_726_457e-17);
        let (s, c) = if eighth & 1 == 0 {
            (s, c)
        } else {
            ((s + c) * half, (c - s) * half)
        };
        let (s, c) = if eighth & 2 == 0 { (s, c) } else { (c, -s) };
        let (s, c) = if eighth & 4 == 0 { (s, c) } else { (-s, -c) };
        // ψ/2 = π·turn; the chord is the path · sin(ψ/2)/(ψ/2).
        let half_turn = Twofold::of(right * dr - left * dl).over(Twofold::of(whole / 2)) * PI2;
        let path = Twofold::of(right * dr + left * dl)
            .over(Twofold::of(2000 * i128::from(p.counts_per_turn)))
            * PI2;
        let ratio = if half_turn.0 == 0.0 {
            Twofold(1.0, 0.0)
        } else {
            half_turn.series(1).over(half_turn)
        };
        let chord = path * ratio;
        self.x = self.x + chord * c;
        self.y = self.y + chord * s;
        self.left += left;
        self.right += right;
    }

    /// Heading in 2⁻³² turns, exact to 2⁻⁴⁰.
    pub fn heading(&self) -> Turns {
        let p = &self.platform;
        let whole = 2 * i128::from(p.counts_per_turn) * i128::from(p.track);
        let turn = self.right * i128::from(p.wheel_diameter_right)
            - self.left * i128::from(p.wheel_diameter_left);
        let rest = turn.rem_euclid(whole);
        Turns((((rest << 33) / whole + 1) >> 1) as u32)
    }
}
