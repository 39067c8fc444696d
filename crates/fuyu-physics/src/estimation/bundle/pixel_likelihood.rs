//! What a residual costs: nearly a square, or what rounding to whole pixels tells.
//!
//! A coordinate that was rounded lies anywhere in its pixel with equal chance, and nowhere else. Least squares does
//! not know that; the likelihood of the pixel does, and with hundreds of frames it is several times as exact: what
//! matters is no longer the mean of many errors but how closely their bounds enclose the answer.

use nalgebra::Vector2;

/// Cost of a residual \[px²\]: the variance of the noise times minus the logarithm of the likelihood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PixelLikelihood {
    /// Half the square up to this length \[px\], linear beyond.
    Huber(f64),
    /// Of rounded coordinates.
    Rounded(Rounding),
}

/// Rounding after a little noise of logistic distribution: the likelihood of the pixel is the difference of the
/// distribution at its sides, `sinh(h/s) / (cosh(h/s) + cosh(r/s))` for a pixel of half width `h` whose centre is `r`
/// off. Its cost is flat within and linear outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rounding {
    /// Half a pixel \[px\].
    half: f64,
    /// Scale of the noise before rounding \[px\].
    softness: f64,
    /// Variance that the costs of this and of other losses have in common \[px²\].
    variance: f64,
    /// `ln (cosh(h/s) / sinh(h/s) 2h)`.
    offset: f64,
    /// `1 / cosh(h/s)`.
    floor: f64,
}

/// A loss near a residual, for each coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostExpansion {
    /// Its value.
    pub cost: f64,
    /// First derivatives.
    pub slope: Vector2<f64>,
    /// Second derivatives, or what takes their place in a quadratic model.
    pub curvature: Vector2<f64>,
}

impl Rounding {
    /// Rounding to steps of `2 half` after noise of scale `softness` \[px\]; costs are in units of `variance`.
    pub fn new(half: f64, softness: f64, variance: f64) -> Self {
        let ratio = half / softness;
        Self {
            half,
            softness,
            variance,
            offset: (2.0 * half / ratio.tanh()).ln(),
            floor: ratio.cosh().recip(),
        }
    }

    /// Minus the logarithm of a coordinate's density at `r` and its two derivatives.
    #[inline]
    fn at(&self, r: f64) -> [f64; 3] {
        let s = self.softness;
        let size = r.abs();
        // cosh(r/s) / cosh(h/s) and sinh(r/s) / cosh(h/s).
        let scale = (1.0 + (-2.0 * self.half / s).exp()).recip();
        let up = (((size - self.half) / s).min(500.0)).exp() * scale;
        let down = (-(size + self.half) / s).exp() * scale;
        let (even, odd) = (up + down, (up - down) * r.signum());
        let whole = 1.0 + even;
        [
            whole.ln() + self.offset,
            odd / (s * whole),
            (even + self.floor * self.floor) / (s * whole).powi(2),
        ]
    }

    /// Of a residual's coordinates, how many are next to the edges of their pixels and so bound the answer.
    pub fn bounded(&self, r: &Vector2<f64>) -> f64 {
        4.0 * self.softness.powi(2) * (self.at(r.x)[2] + self.at(r.y)[2])
    }

    /// Minus the logarithm of the density of a residual's two coordinates, per coordinate.
    pub fn surprise(&self, r: &Vector2<f64>) -> f64 {
        0.5 * (self.at(r.x)[0] + self.at(r.y)[0])
    }
}

impl PixelLikelihood {
    /// The loss of a residual \[px\].
    #[inline]
    pub fn cost(&self, r: &Vector2<f64>) -> f64 {
        match self {
            Self::Huber(limit) => {
                let squared = r.norm_squared();
                if squared <= limit * limit {
                    0.5 * squared
                } else {
                    limit * (squared.sqrt() - 0.5 * limit)
                }
            }
            Self::Rounded(rounding) => {
                rounding.variance * (rounding.at(r.x)[0] + rounding.at(r.y)[0])
            }
        }
    }

    /// The loss near a residual \[px\].
    #[inline]
    pub fn expand(&self, r: &Vector2<f64>) -> CostExpansion {
        match self {
            Self::Huber(limit) => {
                let size = r.norm();
                let weight = if size > *limit { limit / size } else { 1.0 };
                CostExpansion {
                    cost: self.cost(r),
                    slope: r * weight,
                    curvature: Vector2::repeat(weight),
                }
            }
            Self::Rounded(rounding) => {
                let (u, v) = (rounding.at(r.x), rounding.at(r.y));
                let scaled = |k: usize| Vector2::new(u[k], v[k]) * rounding.variance;
                CostExpansion {
                    cost: scaled(0).sum(),
                    slope: scaled(1),
                    curvature: scaled(2),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_and_curvatures_are_those_of_differences() {
        let rounded = |s| PixelLikelihood::Rounded(Rounding::new(0.5, s, 0.09));
        for (loss, exact) in [
            (PixelLikelihood::Huber(1.2), false),
            (rounded(0.3), true),
            (rounded(0.05), true),
        ] {
            for r in [[0.1, -0.3], [0.47, 0.53], [-0.9, 0.0], [3.0, -2.0]] {
                let r = Vector2::from(r);
                let expansion = loss.expand(&r);
                assert!((expansion.cost - loss.cost(&r)).abs() < 1e-15);
                for k in 0..2 {
                    let mut h = Vector2::zeros();
                    h[k] = 1e-5;
                    let slope = (loss.cost(&(r + h)) - loss.cost(&(r - h))) / 2e-5;
                    assert!((slope - expansion.slope[k]).abs() < 1e-6, "{loss:?} {r}");
                    let curvature =
                        (loss.expand(&(r + h)).slope[k] - loss.expand(&(r - h)).slope[k]) / 2e-5;
                    let off = (curvature - expansion.curvature[k]).abs();
                    assert!(!exact || off < 1e-4 * (1.0 + curvature), "{loss:?} {r}");
                }
            }
        }
    }

    #[test]
    fn the_density_of_a_rounded_coordinate_adds_up_to_one() {
        for softness in [0.5, 0.1, 0.01] {
            let rounding = Rounding::new(0.5, softness, 1.0);
            let at = |i: i32| (-rounding.at(1e-3 * f64::from(i))[0]).exp() * 1e-3;
            let sum: f64 = (-9000..=9000).map(at).sum();
            assert!((sum - 1.0).abs() < 1e-4, "{softness}: {sum}");
        }
        // Far outside it stays finite.
        assert!(Rounding::new(0.5, 1e-3, 1.0).at(1e4)[0].is_finite());
    }
}
