//! The regularized incomplete beta function, for intervals and p-values.

/// Terms of the continued fraction: it converges in about `sqrt(max(a, b))` of them.
const MOST_TERMS: u32 = 1_000_000;

/// `I_x(a, b)`, the probability that a beta variable with the parameters `a` and `b` is below `x`: the continued fraction of
/// DLMF 8.17.22 (<https://dlmf.nist.gov/8.17.E22>), evaluated by Lentz's method (Thompson and Barnett 1986).
pub(crate) fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    // The fraction converges fast below the mean.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(b, a, 1.0 - x);
    }
    let ln_beta = libm::lgamma(a) + libm::lgamma(b) - libm::lgamma(a + b);
    let front = libm::exp(a * libm::log(x) + b * libm::log1p(-x) - ln_beta) / a;
    front * fraction(a, b, x)
}

/// `1 / (1 + d_1 / (1 + d_2 / (1 + ...)))`.
fn fraction(a: f64, b: f64, x: f64) -> f64 {
    let coefficient = |k: u32| {
        let m = f64::from(k / 2);
        match k % 2 {
            0 => m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m)),
            _ => -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)),
        }
    };
    let nonzero = |y: f64| if y.abs() < 1e-300 { 1e-300 } else { y };
    // Ratios of successive numerators and, inverted, denominators of the convergents.
    let (mut c, mut d) = (1.0, 1.0 / nonzero(1.0 + coefficient(1)));
    let mut value = d;
    for k in 2..MOST_TERMS {
        d = 1.0 / nonzero(1.0 + coefficient(k) * d);
        c = nonzero(1.0 + coefficient(k) / c);
        value *= c * d;
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    value
}

/// The `x` with `I_x(a, b) = p`: bisection, to the last bit.
pub(crate) fn inverse_incomplete_beta(a: f64, b: f64, p: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        match incomplete_beta(a, b, middle) < p {
            true => low = middle,
            false => high = middle,
        }
    }
}
