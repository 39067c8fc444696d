//! The invariable plane, in which the angular velocity ends, and the angle about its normal.

use nalgebra::{Matrix3, UnitVector3, Vector3};

use super::{EstimateError, Rate};
use crate::estimation::free_body::frame;

/// The plane `n · w = 1/√alpha`: Masutani 1995 eqs. (2.26), (2.27).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InvariablePlane {
    /// Its normal, the direction of the angular momentum in camera axes.
    pub normal: UnitVector3<f64>,
    /// `alpha = L² / 4E²` \[s²\].
    pub alpha: f64,
    /// Scatter of the angular velocities across the plane, `sigma_n` \[rad/s\], (2.63). The print forgets that
    /// its normal has unit length: the distance is `n · w - 1/√alpha`.
    pub scatter: f64,
}

impl InvariablePlane {
    /// The plane that fits best, by linear least squares.
    ///
    /// # Errors
    /// [`EstimateError::NoPlane`] if the angular velocities span no more than a plane through zero.
    pub fn fit(rates: &[Rate]) -> Result<Self, EstimateError> {
        let mut normal = Matrix3::zeros();
        let mut sum = Vector3::zeros();
        for (_, w) in rates {
            normal += w * w.transpose();
            sum += w;
        }
        // A constant angular velocity makes the system singular: of the planes through it take the one nearest
        // to zero, which the pseudo-inverse gives.
        let size = normal.trace();
        let inverse = normal
            .pseudo_inverse(1e-14 * size)
            .map_err(|_| EstimateError::NoPlane)?;
        let n = inverse * sum;
        let alpha = n.norm_squared();
        if !(alpha.is_finite() && alpha > 0.0) {
            return Err(EstimateError::NoPlane);
        }
        let normal = UnitVector3::new_normalize(n);
        let distance = alpha.sqrt().recip();
        let squares: f64 = rates
            .iter()
            .map(|(_, w)| (normal.dot(w) - distance).powi(2))
            .sum();
        Ok(Self {
            normal,
            alpha,
            scatter: (squares / (rates.len() as f64 - 3.0)).sqrt(),
        })
    }
}

/// The angle about the plane's normal as it grows on average: `chi = rate · t + phase`, eq. (2.40).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanPrecession {
    /// `A` of (2.40) \[rad/s\].
    pub rate: f64,
    /// `B`: the angle at the first sample's time \[rad\].
    pub phase: f64,
    /// Axes x (where the angle is zero), y, z = normal, as columns.
    axes: Matrix3<f64>,
}

impl MeanPrecession {
    /// Fits the angle of the herpolhode by linear least squares.
    pub fn fit(rates: &[Rate], plane: &InvariablePlane) -> Self {
        let axes = frame(&plane.normal, None).to_rotation_matrix().into_inner();
        let start = rates[0].0;
        let mut last = None;
        let (mut n, mut st, mut sc, mut stt, mut stc) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (t, w) in rates {
            let (x, y) = (axes.column(0).dot(w), axes.column(1).dot(w));
            let angle = y.atan2(x);
            // The turn nearest to the angle before.
            let angle = last.map_or(angle, |before: f64| {
                angle + std::f64::consts::TAU * ((before - angle) / std::f64::consts::TAU).round()
            });
            last = Some(angle);
            let t = t - start;
            n += 1.0;
            st += t;
            sc += angle;
            stt += t * t;
            stc += t * angle;
        }
        let rate = (n * stc - st * sc) / (n * stt - st * st);
        Self {
            rate,
            phase: (sc - rate * st) / n,
            axes,
        }
    }

    /// The direction in the plane that has angle `angle` \[rad\].
    pub fn direction(&self, angle: f64) -> Vector3<f64> {
        self.axes.column(0) * angle.cos() + self.axes.column(1) * angle.sin()
    }
}
