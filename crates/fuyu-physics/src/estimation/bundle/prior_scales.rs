//! Selection of the disturbances' prior widths by the evidence of the images.
//!
//! With the normal equations of the common unknowns, `½ (z - z₀)ᵀ H (z - z₀) + gᵀ (z - z₀)` for the images and `½ zᵀ
//! Λ z` for the prior, the logarithm of the evidence is `½ ln |Λ| - ½ ln |H + Λ| - min`: the marginal likelihood of
//! the widths (MacKay 1992, Bayesian interpolation). A width that the images do not determine, or for which a smaller one
//! would do, keeps about its nominal value.

use nalgebra::{SMatrix, SVector};

use super::pose_model::disturbed::Scales;

/// Scales that are tried for each width. None is much less than one: a torque whose mean is small over the images may
/// turn with the body and act in another direction later, and gyro errors that are small by chance grow after the
/// images.
const TRIED: [f64; 6] = [0.7, 1.0, 10.0, 100.0, 1e3, 1e4];

/// Standard deviation of the prior on the scale's decimal logarithm.
const DECADES: f64 = 1.0;

/// Variance that represents a flat prior, in the units of the unknowns.
const FLAT: f64 = 1e12;

/// The scales with the largest evidence. `hessian` and `gradient` are those of the images alone at `values`, divided by
/// the noise variance; `deviations` gives the standard deviations of the priors as a function of scales.
pub fn best_scales<const G: usize>(
    hessian: &SMatrix<f64, G, G>,
    gradient: &SVector<f64, G>,
    values: &SVector<f64, G>,
    deviations: impl Fn(Scales) -> SVector<f64, G>,
    start: Scales,
) -> Scales {
    let right = hessian * values - gradient;
    let evidence = |scales: Scales| {
        let weights = deviations(scales).map(|d| match d.is_finite() {
            true => d.max(1e-9).powi(-2),
            false => FLAT.recip(),
        });
        let mut total = *hessian;
        for k in 0..G {
            total[(k, k)] += weights[k];
        }
        let Some(factor) = total.cholesky() else {
            return f64::NEG_INFINITY;
        };
        let solution = factor.solve(&right);
        let determinant: f64 = (0..G).map(|k| factor.l_dirty()[(k, k)].ln()).sum();
        let prior: f64 = weights.iter().map(|w| w.ln()).sum();
        let unusual = [scales.torque, scales.other].map(|s| (s.log10() / DECADES).powi(2));
        0.5 * (prior + right.dot(&solution) - unusual.iter().sum::<f64>()) - determinant
    };
    let mut best = (evidence(start), start);
    for _ in 0..2 {
        let before = best.1;
        for scale in TRIED {
            let tried = [
                Scales {
                    torque: scale,
                    ..before
                },
                Scales {
                    other: scale,
                    ..best.1
                },
            ];
            for scales in tried {
                let found = evidence(scales);
                if found > best.0 {
                    best = (found, scales);
                }
            }
        }
        if best.1 == before {
            break;
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One value that was measured with unit noise: the evidence prefers a width of its size.
    #[test]
    fn a_width_follows_what_the_images_show() {
        let found = |measured: f64, information: f64| {
            let hessian =
                SMatrix::<f64, 2, 2>::from_diagonal(&SVector::<f64, 2>::new(information, 1.0));
            let gradient = SVector::<f64, 2>::new(-measured * information, 0.0);
            let deviations = |s: Scales| SVector::<f64, 2>::new(s.torque, s.other);
            best_scales(
                &hessian,
                &gradient,
                &SVector::zeros(),
                deviations,
                Scales::default(),
            )
            .torque
        };
        assert_eq!(found(150.0, 1e4), 100.0);
        assert_eq!(found(0.02, 1e8), 0.7);
        // Nothing was measured.
        assert_eq!(found(3.0, 1e-4), 1.0);
    }
}
