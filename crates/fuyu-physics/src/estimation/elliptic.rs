//! Jacobi's elliptic functions and the integrals that free rotation needs. Masutani 1995 app. C.
//!
//! The modulus is `k` in [0, 1], stored with its complement `k' = √(1 - k²)`: near the separatrix `k` rounds to 1 while
//! `k'` still determines the period. Functions are computed by the arithmetic-geometric mean (descending Landen
//! transformation, in Bulirsch's form without inverse functions), integrals by Carlson's duplication (DLMF 19.36). No
//! dependency provides sn, cn and dn.

use std::f64::consts::PI;

/// A modulus `k` with its complement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Modulus {
    k: f64,
    complement: f64,
    quarter_period: f64,
}

/// `sn`, `cn` and `dn` of one argument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jacobi {
    /// sn(k, u).
    pub sn: f64,
    /// cn(k, u).
    pub cn: f64,
    /// dn(k, u).
    pub dn: f64,
}

impl Modulus {
    /// The modulus `k` in [0, 1]; outside this range all results are NaN.
    pub fn new(k: f64) -> Self {
        Self::with_complement(k, ((1.0 - k) * (1.0 + k)).sqrt())
    }

    /// The modulus from `k²` and `1 - k²`, each with full relative precision.
    pub fn from_squares(k_squared: f64, complement_squared: f64) -> Self {
        Self::with_complement(k_squared.sqrt(), complement_squared.sqrt())
    }

    fn with_complement(k: f64, complement: f64) -> Self {
        Self {
            k,
            complement,
            quarter_period: quarter_period(complement),
        }
    }

    /// `k`.
    pub fn k(&self) -> f64 {
        self.k
    }

    /// `k' = √(1 - k²)`.
    pub fn complement(&self) -> f64 {
        self.complement
    }

    /// The complete integral of the first kind `K(k)`, (C.5): a quarter of the period of sn and cn. Infinite
    /// at `k = 1`.
    pub fn quarter_period(&self) -> f64 {
        self.quarter_period
    }

    /// sn, cn and dn of `u`, (C.2)-(C.4).
    pub fn jacobi(&self, u: f64) -> Jacobi {
        let (reduced, half_periods) = self.reduce(u);
        let mut j = self.jacobi_reduced(reduced);
        if half_periods % 2.0 != 0.0 {
            j.sn = -j.sn;
            j.cn = -j.cn;
        }
        j
    }

    /// `u` minus a whole number of half periods `2 K`, and that number; the remainder is in [-K, K].
    fn reduce(&self, u: f64) -> (f64, f64) {
        let half_period = 2.0 * self.quarter_period;
        if half_period.is_infinite() {
            return (u, 0.0);
        }
        let n = (u / half_period).round();
        (n.mul_add(-half_period, u), n)
    }

    /// The functions for `u` in [-K, K].
    fn jacobi_reduced(&self, u: f64) -> Jacobi {
        let quarter = self.quarter_period;
        if quarter.is_infinite() {
            let sech = u.cosh().recip();
            return Jacobi {
                sn: u.tanh(),
                cn: sech,
                dn: sech,
            };
        }
        if u.abs() <= 0.5 * quarter {
            return self.bulirsch(u);
        }
        // Beyond K/2 by reflection at K, so that cn keeps its relative accuracy near its zero.
        let v = self.bulirsch(quarter - u.abs());
        Jacobi {
            sn: (v.cn / v.dn).copysign(u),
            cn: self.complement * v.sn / v.dn,
            dn: self.complement / v.dn,
        }
    }

    fn bulirsch(&self, u: f64) -> Jacobi {
        let (mut a, mut b) = (1.0, self.complement);
        let mut means = [(0.0, 0.0); 12];
        let mut steps = 0;
        let mut c;
        loop {
            means[steps] = (a, b);
            steps += 1;
            c = 0.5 * (a + b);
            if (a - b).abs() <= 1e-9 * a || steps == means.len() {
                break;
            }
            (a, b) = (c, (a * b).sqrt());
        }
        let (sin, cos) = (c * u).sin_cos();
        if sin == 0.0 {
            return Jacobi {
                sn: u,
                cn: 1.0,
                dn: 1.0,
            };
        }
        let mut ratio = cos / sin;
        let mut dn = 1.0;
        c *= ratio;
        for &(a, b) in means[..steps].iter().rev() {
            ratio *= c;
            c *= dn;
            dn = (b + ratio) / (a + ratio);
            ratio = c / a;
        }
        let sn = c.hypot(1.0).recip().copysign(sin);
        Jacobi { sn, cn: c * sn, dn }
    }

    /// The argument `u` in [-2K, 2K] whose amplitude has this sine and cosine: the common inverse of sn
    /// and cn.
    pub fn argument(&self, sin: f64, cos: f64) -> f64 {
        let first = sin * carlson_rf(cos * cos, self.dn_squared(sin, cos), 1.0);
        if cos >= 0.0 {
            first
        } else {
            (2.0 * self.quarter_period).copysign(sin) - first
        }
    }

    /// `∫₀ᵘ ν sn² / (1 + ν sn²)`: `u` minus the incomplete integral of the third kind with characteristic `-ν`, `ν ≥
    /// 0`. The integral grows by a fixed amount in each half period, and vanishes with `ν`.
    pub fn third_kind_excess(&self, nu: f64, u: f64) -> f64 {
        let (reduced, half_periods) = self.reduce(u);
        let Jacobi { sn, cn, dn } = self.jacobi_reduced(reduced);
        let part = |s: f64, c: f64, d: f64| {
            nu / 3.0 * s.powi(3) * carlson_rj(c * c, d * d, 1.0, 1.0 + nu * s * s)
        };
        let full_half_periods = if half_periods == 0.0 {
            0.0
        } else {
            2.0 * half_periods * part(1.0, 0.0, self.complement)
        };
        part(sn, cn, dn) + full_half_periods
    }

    fn dn_squared(&self, sin: f64, cos: f64) -> f64 {
        (self.complement * sin).mul_add(self.complement * sin, cos * cos)
    }
}

/// `K` of the modulus with this complement, by the arithmetic-geometric mean.
fn quarter_period(complement: f64) -> f64 {
    if complement == 0.0 {
        return f64::INFINITY;
    }
    let (mut a, mut b) = (1.0, complement);
    // Convergence is quadratic: once the means agree to 1e-9, the next is exact to rounding.
    while (a - b).abs() > 1e-9 * a {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    PI / (a + b)
}

/// The modulus with `2 k K(k) = x`, eq. (2.32); `x ≥ 0`. `2 k K` grows without bound as `k` approaches 1.
pub fn modulus_with_2kK(x: f64) -> Modulus {
    // As a function of p = ln k', ln(2 k K) is nearly linear for k near 1; bisection needs no derivative and cannot
    // fail.
    let of = |p: f64| {
        let complement = p.exp();
        let k_squared = -(2.0 * p).exp_m1();
        Modulus::from_squares(k_squared, complement * complement)
    };
    let (mut low, mut high) = (-700.0, 0.0);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle == low || middle == high {
            break;
        }
        let m = of(middle);
        if 2.0 * m.k * m.quarter_period() > x {
            low = middle;
        } else {
            high = middle;
        }
    }
    of(0.5 * (low + high))
}

/// Carlson's `R_F(x, y, z)`; arguments not negative, at most one zero.
pub(crate) fn carlson_rf(x: f64, y: f64, z: f64) -> f64 {
    let start = (x + y + z) / 3.0;
    let (dx, dy) = (start - x, start - y);
    // (3 ε)^(-1/6) for ε = 1e-17.
    let mut error_bound = 480.0 * dx.abs().max(dy.abs()).max((start - z).abs());
    let (mut x, mut y, mut z, mut a) = (x, y, z, start);
    let mut shrink = 1.0;
    while error_bound > a.abs() {
        let lambda = (x * y).sqrt() + (y * z).sqrt() + (z * x).sqrt();
        [x, y, z, a] = [x, y, z, a].map(|t| 0.25 * (t + lambda));
        error_bound *= 0.25;
        shrink *= 0.25;
    }
    let (x, y) = (dx * shrink / a, dy * shrink / a);
    let z = -x - y;
    let (e2, e3) = (x * y - z * z, x * y * z);
    (1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0 - 3.0 * e2 * e3 / 44.0) / a.sqrt()
}

/// Carlson's `R_J(x, y, z, p)`; `x`, `y`, `z` not negative, at most one zero, `p` positive.
fn carlson_rj(x: f64, y: f64, z: f64, p: f64) -> f64 {
    let start = (x + y + z + 2.0 * p) / 5.0;
    let (dx, dy, dz) = (start - x, start - y, start - z);
    // (ε / 4)^(-1/6) for ε = 1e-17.
    let mut error_bound = 860.0
        * [dx, dy, dz, start - p]
            .into_iter()
            .fold(0.0, |m: f64, d| m.max(d.abs()));
    let mut delta = (p - x) * (p - y) * (p - z);
    let (mut x, mut y, mut z, mut p, mut a) = (x, y, z, p, start);
    let mut shrink = 1.0;
    let mut sum = 0.0;
    while error_bound > a.abs() {
        let (rx, ry, rz, rp) = (x.sqrt(), y.sqrt(), z.sqrt(), p.sqrt());
        let d = (rp + rx) * (rp + ry) * (rp + rz);
        sum += shrink / d * carlson_rc_near_one(delta / (d * d));
        let lambda = rx * ry + ry * rz + rz * rx;
        [x, y, z, p, a] = [x, y, z, p, a].map(|t| 0.25 * (t + lambda));
        error_bound *= 0.25;
        shrink *= 0.25;
        delta /= 64.0;
    }
    let [x, y, z] = [dx, dy, dz].map(|d| d * shrink / a);
    let p = -0.5 * (x + y + z);
    let xyz = x * y * z;
    let e2 = x * y + x * z + y * z - 3.0 * p * p;
    let e3 = xyz + 2.0 * e2 * p + 4.0 * p * p * p;
    let e4 = (2.0 * xyz + e2 * p + 3.0 * p * p * p) * p;
    let e5 = xyz * p * p;
    let series = 1.0 - 3.0 * e2 / 14.0 + e3 / 6.0 + 9.0 * e2 * e2 / 88.0
        - 3.0 * e4 / 22.0
        - 9.0 * e2 * e3 / 52.0
        + 3.0 * e5 / 26.0;
    shrink * series / (a * a.sqrt()) + 6.0 * sum
}

/// Carlson's `R_C(1, 1 + e)`, `e > -1`.
fn carlson_rc_near_one(e: f64) -> f64 {
    if e.abs() < 1e-3 {
        1.0 - e * (1.0 / 3.0 - e * (1.0 / 5.0 - e * (1.0 / 7.0 - e * (1.0 / 9.0 - e / 11.0))))
    } else if e > 0.0 {
        e.sqrt().atan() / e.sqrt()
    } else {
        (-e).sqrt().atanh() / (-e).sqrt()
    }
}

/// The Gudermannian `∫₀ˣ sech`: the amplitude at `k = 1`.
pub fn gudermannian(x: f64) -> f64 {
    2.0 * (0.5 * x).tanh().atan()
}
