//! Direct feedback of attitude and rate.

use fuyu_lti::{LtiError, Matrix, StateSpace};
use nalgebra::{Matrix3, Vector3};

use crate::control::attitude::{AttitudeConfigError, AttitudeDeviation, AttitudeLaw};

/// Direct velocity and displacement feedback, `τ = -P angle - D rate` (Kida 1993 section 4.2).
///
/// With symmetric positive definite P and D it is stable for any posture and any vibration (Theorem 4.1), provided that
/// it acts without delay; P = 0 (DVFB) damps without holding an attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dvdfb {
    P: Matrix3<f64>,
    D: Matrix3<f64>,
}

impl Dvdfb {
    /// The law with gains P \[N m/rad\] and D \[N m s/rad\], base axes.
    ///
    /// # Errors
    /// [`AttitudeConfigError`] unless D is symmetric positive definite, and P as well or zero.
    pub fn new(P: Matrix3<f64>, D: Matrix3<f64>) -> Result<Self, AttitudeConfigError> {
        if P != Matrix3::zeros() {
            check_definite("P [N m/rad]", &P)?;
        }
        check_definite("D [N m s/rad]", &D)?;
        Ok(Self { P, D })
    }

    /// The law with one gain for each axis.
    ///
    /// # Errors
    /// As [`Dvdfb::new`].
    pub fn diagonal(p: [f64; 3], d: [f64; 3]) -> Result<Self, AttitudeConfigError> {
        Self::new(
            Matrix3::from_diagonal(&Vector3::from(p)),
            Matrix3::from_diagonal(&Vector3::from(d)),
        )
    }

    /// P \[N m/rad\].
    pub fn angle_gain(&self) -> &Matrix3<f64> {
        &self.P
    }

    /// D \[N m s/rad\].
    pub fn rate_gain(&self) -> &Matrix3<f64> {
        &self.D
    }
}

/// Refuses a matrix that is not symmetric and positive definite: stability would depend on the robot.
fn check_definite(name: &str, gain: &Matrix3<f64>) -> Result<(), AttitudeConfigError> {
    let refuse = |what: String, value: f64, expected: &'static str| {
        Err(AttitudeConfigError::Value {
            what,
            value,
            expected,
        })
    };
    for i in 0..3 {
        for j in 0..3 {
            if !gain[(i, j)].is_finite() {
                return refuse(format!("{name}[{i}][{j}]"), gain[(i, j)], "finite");
            }
        }
    }
    let skew = (gain - gain.transpose()).amax();
    if skew > 1e-10 * gain.amax() {
        let what = format!("largest difference of {name} from its transpose");
        return refuse(what, skew, "zero: the gain must be symmetric");
    }
    let least = ((gain + gain.transpose()) * 0.5)
        .symmetric_eigenvalues()
        .min();
    if least <= 0.0 {
        let what = format!("smallest eigenvalue of {name}");
        return refuse(what, least, "positive");
    }
    Ok(())
}

impl AttitudeLaw for Dvdfb {
    fn torque(&mut self, deviation: &AttitudeDeviation) -> Vector3<f64> {
        -(self.P * deviation.angle + self.D * deviation.rate)
    }

    fn linear(&self) -> Result<StateSpace, LtiError> {
        let gain = Matrix::from_fn(3, 6, |i, j| {
            if j < 3 {
                self.P[(i, j)]
            } else {
                self.D[(i, j - 3)]
            }
        });
        Ok(StateSpace::gain(gain))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_that_break_the_theorem_are_refused() {
        let D = Matrix3::identity() * 900.0;
        let skewed = Matrix3::identity() * 60.0 + Vector3::new(100.0, 0.0, 0.0).cross_matrix();
        let text = Dvdfb::new(skewed, D).unwrap_err().to_string();
        assert_eq!(
            text,
            "largest difference of P [N m/rad] from its transpose is 200; it must be zero: the gain must be symmetric"
        );
        let text = Dvdfb::diagonal([60.0, 60.0, -1.0], [900.0; 3]).unwrap_err();
        assert_eq!(
            text.to_string(),
            "smallest eigenvalue of P [N m/rad] is -1; it must be positive"
        );
        let text = Dvdfb::diagonal([60.0; 3], [900.0, 0.0, 900.0]).unwrap_err();
        assert!(text.to_string().starts_with("smallest eigenvalue of D"));
        let text = Dvdfb::diagonal([60.0, f64::NAN, 60.0], [900.0; 3]).unwrap_err();
        assert_eq!(
            text.to_string(),
            "P [N m/rad][1][1] is NaN; it must be finite"
        );
        assert!(Dvdfb::diagonal([0.0; 3], [900.0; 3]).is_ok());
    }
}
