//! Covariance of the dynamic parameters, choice of the motion model, and diagnosis of what the data do not determine.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::Options;
use super::free_motion::{FreeMotion, PARAMETERS, shape_times};
use super::inlier_gate::Residuals;
use crate::estimation::motion_state::{MotionState, STATES};
use crate::estimation::{MotionEstimate, MotionModel};

/// A difference of fewer standard deviations is not significant.
const SIGNIFICANT: f64 = 3.0;

/// The images determine a value if its posterior standard deviation is less than this fraction of the prior's.
const MEASURED: f64 = 0.5;

/// The motion with its covariance, and remarks for the user.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// The motion.
    pub motion: MotionEstimate,
    /// Remarks, one line each.
    pub diagnosis: Vec<String>,
}

/// Derivatives of `(J_x, J_y, J_z, alpha)` by the eight parameters of [`FreeMotion`], with the axes in the order of
/// `J`.
pub fn derivatives(motion: &FreeMotion, J: &Vector3<f64>) -> SMatrix<f64, 4, PARAMETERS> {
    let eigen = motion.inertia.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    if J.x > J.z {
        order.reverse();
    }
    let w = motion.w_WB_B(&motion.R_WB);
    let w_W = motion.R_WB * w;
    let L = motion.momentum;
    let twice_energy = L.dot(&w_W);
    // 2E = Lᵀ R I⁻¹ Rᵀ L.
    let mut by_energy = SVector::<f64, PARAMETERS>::zeros();
    by_energy
        .fixed_rows_mut::<5>(0)
        .copy_from(&-shape_times(&w).tr_mul(&w));
    by_energy.fixed_rows_mut::<3>(5).copy_from(&(w_W * 2.0));
    let mut out = SMatrix::<f64, 4, PARAMETERS>::zeros();
    for (row, &axis) in order.iter().enumerate() {
        let v: Vector3<f64> = eigen.eigenvectors.column(axis).into();
        let mut by_moment = SVector::<f64, PARAMETERS>::zeros();
        by_moment
            .fixed_rows_mut::<5>(0)
            .copy_from(&shape_times(&v).tr_mul(&v));
        let moment = eigen.eigenvalues[axis];
        let slope = by_moment / twice_energy - by_energy * (moment / twice_energy.powi(2));
        out.set_row(row, &slope.transpose());
    }
    let square = L.norm_squared();
    let mut slope = by_energy * (-2.0 * square / twice_energy.powi(3));
    let mut by_momentum = slope.fixed_rows_mut::<3>(5);
    by_momentum += L * (2.0 / twice_energy.powi(2));
    out.set_row(3, &slope.transpose());
    out
}

/// Distance of the angular velocity from the direction of the angular momentum, in standard deviations.
fn nutation_significance(state: &MotionState) -> f64 {
    let MotionState {
        motion, covariance, ..
    } = state;
    let R = *motion.R_WB.to_rotation_matrix().matrix();
    let Some(inverse) = motion.inertia.try_inverse() else {
        return 0.0;
    };
    let w = motion.w_WB_B(&motion.R_WB);
    let h = R.tr_mul(&motion.momentum);
    let along = motion.momentum.normalize();
    let across = Matrix3::identity() - along * along.transpose();
    let w_W = R * w;
    let off = across * w_W;
    let mut slope = SMatrix::<f64, 3, STATES>::zeros();
    let by_turn = across * R * (inverse * h.cross_matrix() - w.cross_matrix());
    slope.fixed_columns_mut::<3>(0).copy_from(&by_turn);
    slope
        .fixed_columns_mut::<5>(3)
        .copy_from(&(across * R * -inverse * shape_times(&w)));
    // The projection across the momentum depends on the momentum as well.
    let turned = across * w_W.dot(&along) / motion.momentum.norm();
    let by_momentum = across * R * inverse * R.transpose() - turned;
    slope.fixed_columns_mut::<3>(8).copy_from(&by_momentum);
    let spread = slope * covariance * slope.transpose();
    // Only the plane across the momentum is tested; this term makes the matrix regular along the momentum.
    let tested = spread + along * along.transpose() * spread.trace().max(f64::MIN_POSITIVE);
    tested
        .try_inverse()
        .map_or(0.0, |i| off.dot(&(i * off)).max(0.0).sqrt())
}

/// The motion of a state as an estimate with RMS residual `rms`, and remarks. `None` if the body does not rotate.
pub fn report_of_state(state: &MotionState, rms: f64) -> Option<Report> {
    let motion = &state.motion;
    let w = motion.w_WB_B(&motion.R_WB);
    let rotation = state.rotation()?;
    let J = rotation.parameters().map(|p| p.J()).unwrap_or_else(|| {
        motion.inertia.symmetric_eigenvalues() / motion.momentum.dot(&(motion.R_WB * w))
    });
    let spread = state.parameter_covariance(&J);
    let off = |a: usize, b: usize, values: [f64; 2]| {
        let variance = spread[(a, a)] + spread[(b, b)] - 2.0 * spread[(a, b)];
        (values[0] - values[1]).abs() / variance.max(f64::MIN_POSITIVE).sqrt()
    };
    let alpha = rotation.alpha();
    let mut diagnosis = Vec::new();
    let deviation = |k: usize| spread[(k, k)].max(0.0).sqrt();
    let model = if nutation_significance(state) < SIGNIFICANT {
        diagnosis.push(format!(
            "the axis of rotation does not move within the noise: alpha = {alpha:.4} s² is determined, the moments of \
             inertia are not (J = {:.3} ± {:.3}, {:.3} ± {:.3}, {:.3} ± {:.3} s²)",
            J.x, deviation(0), J.y, deviation(1), J.z, deviation(2)
        ));
        MotionModel::SingleAxis
    } else if off(0, 1, [J.x, J.y]) < SIGNIFICANT {
        diagnosis.push(format!(
            "two moments are equal within the noise (J_x - J_y = {:.2e} ± {:.1e} s²): the directions of the \
             principal axes x and y are not determined",
            J.x - J.y,
            (J.x - J.y).abs() / off(0, 1, [J.x, J.y]).max(f64::MIN_POSITIVE)
        ));
        MotionModel::Axisymmetric
    } else if off(1, 3, [J.y, alpha]) < SIGNIFICANT {
        diagnosis.push(
            "alpha equals the middle moment within the noise: the time at which the body turns over next is not determined".to_owned(),
        );
        MotionModel::Aperiodic
    } else {
        MotionModel::Asymmetric
    };
    for (name, k, value) in [("J_x", 0, J.x), ("J_y", 1, J.y), ("J_z", 2, J.z)] {
        if model != MotionModel::SingleAxis && deviation(k) > 0.1 * value {
            diagnosis.push(format!(
                "{name} = {value:.3} ± {:.3} s² is poorly known: observe longer",
                deviation(k)
            ));
        }
    }
    Some(Report {
        motion: MotionEstimate::new(model, rotation, rms, Some(spread)),
        diagnosis,
    })
}

/// The fitted motion as an estimate, and remarks. `focal` is the logarithm of the focal length over its nominal value,
/// with its standard deviation. `None` if the body does not rotate.
pub fn report(
    state: &MotionState,
    residuals: &Residuals,
    options: &Options,
    focal: (f64, f64),
) -> Option<Report> {
    let Report {
        motion,
        mut diagnosis,
    } = report_of_state(state, residuals.rms)?;
    if residuals.deviation > 1.3 * options.pixel_noise {
        diagnosis.push(format!(
            "residuals of {:.2} px are more than the {:.2} px assumed (--pixel-noise): the images are noisier, or the lens \
             distorts",
            residuals.deviation, options.pixel_noise
        ));
    }
    if residuals.outliers > 0.02 {
        diagnosis.push(format!(
            "{:.0} % of the image points were left out: they do not fit the rest",
            100.0 * residuals.outliers
        ));
    }
    let (log_focal, deviation) = focal;
    if options.widths.focal > 0.0 {
        if deviation > MEASURED * options.widths.focal {
            diagnosis.push(format!(
                "the images do not determine the focal length: the camera's counts, ± {:.1} %",
                100.0 * options.widths.focal
            ));
        } else if log_focal.abs() > SIGNIFICANT * deviation {
            diagnosis.push(format!(
                "focal length: {:+.3} % ± {:.3} % from the camera's",
                100.0 * log_focal.exp_m1(),
                100.0 * deviation
            ));
        }
    }
    Some(Report { motion, diagnosis })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::free_body::FreeRotation;
    use nalgebra::UnitQuaternion;

    #[test]
    fn derivatives_match_finite_differences() {
        let shape = SVector::<f64, 5>::new(0.3, -0.2, 0.1, 0.05, -0.15);
        let R = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.7, 1.1));
        let motion = FreeMotion::new(&shape, Vector3::new(0.3, -0.5, 0.6), 10.0, R).unwrap();
        let values = |m: &FreeMotion| {
            let w = m.w_WB_B(&m.R_WB);
            let r = FreeRotation::new(&m.inertia, m.R_WB, &w, m.time).unwrap();
            let J = r.parameters().unwrap().J();
            nalgebra::Vector4::new(J.x, J.y, J.z, r.alpha())
        };
        let analytic = derivatives(&motion, &values(&motion).xyz());
        for k in 0..PARAMETERS {
            let mut step = SVector::<f64, PARAMETERS>::zeros();
            step[k] = 1e-6;
            let up = values(&motion.moved(&step).unwrap());
            let down = values(&motion.moved(&-step).unwrap());
            let numeric = (up - down) / 2e-6;
            assert!((numeric - analytic.column(k)).norm() < 1e-6, "{k}");
        }
    }
}
