//! Phi functions: integrals of polynomials times an exponential decay.

/// Number of functions: `φ_0` to `φ_5`.
pub(super) const COUNT: usize = 6;

/// Below this, the series is more accurate than the recursion.
const SERIES: f64 = 2.0;

/// `φ_0 = e^w`, `φ_{k+1}(w) = (φ_k(w) - 1/k!) / w` for `w <= 0`: `θ^{m+1} m! φ_{m+1}(-z θ)` is the solution at `θ` of
/// `x' = -z x + θ^m` from zero. M. Hochbruck and A. Ostermann, Exponential integrators, Acta Numerica 19, 2010,
/// eqs. (2.10), (2.11).
pub(super) fn phi(w: f64) -> [f64; COUNT] {
    let mut out = [0.0; COUNT];
    let mut inverse_factorials = [1.0; COUNT];
    for k in 1..COUNT {
        inverse_factorials[k] = inverse_factorials[k - 1] / k as f64;
    }
    let last = COUNT - 1;
    if w > -SERIES {
        let (mut term, mut sum) = (inverse_factorials[last], 0.0);
        // The terms fall faster than 2^k / k!: 30 are far more than enough.
        for m in 1..30 {
            sum += term;
            term *= w / (last + m) as f64;
        }
        out[last] = sum;
        for k in (0..last).rev() {
            out[k] = w * out[k + 1] + inverse_factorials[k];
        }
    } else {
        out[0] = w.exp();
        for k in 0..last {
            out[k + 1] = (out[k] - inverse_factorials[k]) / w;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    // Against the integral representation, φ_k(w) = ∫ e^{(1-s) w} s^{k-1} / (k-1)! ds, by composite quadrature.
    #[test]
    fn the_functions_are_the_integrals() {
        for w in [0.0, -1e-9, -0.3, -1.999, -2.001, -7.0, -40.0] {
            let values = phi(w);
            assert!((values[0] - f64::exp(w)).abs() < 1e-15);
            let mut factorial = 1.0;
            for (k, value) in values.iter().enumerate().skip(1) {
                if k > 1 {
                    factorial *= (k - 1) as f64;
                }
                let pieces = 4000;
                let step = 1.0 / f64::from(pieces);
                let f = |s: f64| ((1.0 - s) * w).exp() * s.powi(k as i32 - 1) / factorial;
                let piece = |i: i32| {
                    let s = f64::from(i) * step;
                    (f(s) + 4.0 * f(s + 0.5 * step) + f(s + step)) * step / 6.0
                };
                let integral: f64 = (0..pieces).map(piece).sum();
                assert!(
                    (value - integral).abs() < 1e-12,
                    "phi_{k}({w}): {value} {integral}"
                );
            }
        }
    }
}
