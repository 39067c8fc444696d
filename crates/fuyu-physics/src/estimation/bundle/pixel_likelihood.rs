//! Likelihood of an image residual: Huber's robust cost, or that of coordinates rounded to whole pixels.
//!
//! A rounded coordinate lies anywhere in its pixel with equal probability, and nowhere else. Least squares does not use
//! this bound; the likelihood of rounding does, and with hundreds of frames its result is several times as accurate:
//! the pixel bounds together confine the solution more closely than the mean of the rounding errors does.

use nalgebra::Vector2;

/// Model of the image noise. Its cost \[px²\] is the noise variance times the negative logarithm of the likelihood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PixelLikelihood {
    /// Huber's cost: half the square up to this length of the residual \[px\], linear beyond.
    Huber(f64),
    /// Coordinates rounded to whole pixels.
    Rounded(Rounding),
}

/// Rounding after a little noise with a logistic distribution. The likelihood of a pixel is the difference of the
/// distribution function at its edges: `sinh(h/s) / (cosh(h/s) + cosh(r/s))` for half width `h`, noise scale `s` and
/// distance `r` from the centre. The cost is flat inside the pixel and linear outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rounding {
    /// Half a pixel \[px\].
    half: f64,
    /// Scale of the noise before rounding \[px\].
    noise_scale: f64,
    /// Noise variance that scales the cost, the same as for other likelihoods \[px²\].
    variance: f64,
    /// `ln (cosh(h/s) / sinh(h/s) 2h)`.
    offset: f64,
    /// `1 / cosh(h/s)`.
    floor: f64,
    /// `1 / (1 + exp(-2 h/s))`.
    share: f64,
    /// `share² exp(-2 h/s)`: product of the two exponentials of [`Rounding::even_and_odd`], the same for any residual.
    product: f64,
}

/// Slope and curvature of the cost at a residual, for each coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostExpansion {
    /// First derivatives.
    pub slope: Vector2<f64>,
    /// Second derivatives, or their positive replacement in a quadratic model.
    pub curvature: Vector2<f64>,
}

impl Rounding {
    /// Rounding to multiples of `2 half` \[px\] after noise of scale `noise_scale` \[px\]; costs are in units of `variance`.
    pub fn new(half: f64, noise_scale: f64, variance: f64) -> Self {
        let ratio = half / noise_scale;
        let share = (1.0 + (-2.0 * ratio).exp()).recip();
        Self {
            half,
            noise_scale,
            variance,
            offset: (2.0 * half / ratio.tanh()).ln(),
            floor: ratio.cosh().recip(),
            share,
            product: share * share * (-2.0 * ratio).exp(),
        }
    }

    /// `cosh(r/s)` and `sinh(r/s)`, over `cosh(h/s)`: sum and difference of two exponentials.
    #[inline(always)]
    fn even_and_odd(&self, r: f64) -> (f64, f64) {
        let s = self.noise_scale;
        let up = (((r.abs() - self.half) / s).min(500.0)).exp() * self.share;
        let down = self.product / up.max(f64::MIN_POSITIVE);
        (up + down, (up - down) * r.signum())
    }

    /// Negative logarithm of a coordinate's density at `r`.
    #[inline]
    fn negative_log(&self, r: f64) -> f64 {
        (1.0 + self.even_and_odd(r).0).ln() + self.offset
    }

    /// First and second derivative of [`Rounding::negative_log`].
    #[inline(always)]
    fn derivatives(&self, r: f64) -> [f64; 2] {
        let (even, odd) = self.even_and_odd(r);
        let width = self.noise_scale * (1.0 + even);
        [
            odd / width,
            (even + self.floor * self.floor) / (width * width),
        ]
    }

    /// Number of a residual's two coordinates that are near the edges of their pixels and so bound the solution.
    pub fn bounded(&self, r: &Vector2<f64>) -> f64 {
        4.0 * self.noise_scale.powi(2) * (self.derivatives(r.x)[1] + self.derivatives(r.y)[1])
    }

    /// Mean negative logarithm of the density of a residual's two coordinates.
    pub fn negative_log_density(&self, r: &Vector2<f64>) -> f64 {
        0.5 * (self.negative_log(r.x) + self.negative_log(r.y))
    }
}

impl PixelLikelihood {
    /// Cost of a residual \[px\].
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
                rounding.variance * (rounding.negative_log(r.x) + rounding.negative_log(r.y))
            }
        }
    }

    /// Slope and curvature of the cost at a residual \[px\].
    #[inline(always)]
    pub fn expand(&self, r: &Vector2<f64>) -> CostExpansion {
        match self {
            Self::Huber(limit) => {
                let size = r.norm();
                let weight = if size > *limit { limit / size } else { 1.0 };
                CostExpansion {
                    slope: r * weight,
                    curvature: Vector2::repeat(weight),
                }
            }
            Self::Rounded(rounding) => {
                let (u, v) = (rounding.derivatives(r.x), rounding.derivatives(r.y));
                CostExpansion {
                    slope: Vector2::new(u[0], v[0]) * rounding.variance,
                    curvature: Vector2::new(u[1], v[1]) * rounding.variance,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_and_curvatures_match_finite_differences() {
        let rounded = |s| PixelLikelihood::Rounded(Rounding::new(0.5, s, 0.09));
        for (likelihood, exact) in [
            (PixelLikelihood::Huber(1.2), false),
            (rounded(0.3), true),
            (rounded(0.05), true),
        ] {
            for r in [[0.1, -0.3], [0.47, 0.53], [-0.9, 0.0], [3.0, -2.0]] {
                let r = Vector2::from(r);
                let expansion = likelihood.expand(&r);
                for k in 0..2 {
                    let mut h = Vector2::zeros();
                    h[k] = 1e-5;
                    let slope = (likelihood.cost(&(r + h)) - likelihood.cost(&(r - h))) / 2e-5;
                    assert!(
                        (slope - expansion.slope[k]).abs() < 1e-6,
                        "{likelihood:?} {r}"
                    );
                    let curvature = (likelihood.expand(&(r + h)).slope[k]
                        - likelihood.expand(&(r - h)).slope[k])
                        / 2e-5;
                    let off = (curvature - expansion.curvature[k]).abs();
                    assert!(
                        !exact || off < 1e-4 * (1.0 + curvature),
                        "{likelihood:?} {r}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_density_of_a_rounded_coordinate_integrates_to_one() {
        for noise_scale in [0.5, 0.1, 0.01] {
            let rounding = Rounding::new(0.5, noise_scale, 1.0);
            let at = |i: i32| (-rounding.negative_log(1e-3 * f64::from(i))).exp() * 1e-3;
            let sum: f64 = (-9000..=9000).map(at).sum();
            assert!((sum - 1.0).abs() < 1e-4, "{noise_scale}: {sum}");
        }
        // It stays finite far outside the pixel.
        assert!(Rounding::new(0.5, 1e-3, 1.0).negative_log(1e4).is_finite());
    }
}
