//! The estimated motion: result of every estimation method.

use nalgebra::{Matrix3, Matrix4, UnitQuaternion, UnitVector3, Vector3};

use super::free_body::{DynamicParameters, FreeRotation, SolutionKind};

/// Solution of Euler's equations that describes the motion, as far as the data determine it.
pub type MotionModel = SolutionKind;

impl MotionModel {
    /// All models by name, in the order of the thesis.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("asymmetric", Self::Asymmetric),
        ("aperiodic", Self::Aperiodic),
        ("axisymmetric", Self::Axisymmetric),
        ("single_axis", Self::SingleAxis),
    ];

    /// The model's name.
    pub fn name(self) -> &'static str {
        let known = Self::NAMES.iter().find(|(_, model)| *model == self);
        known.map_or("", |(name, _)| name)
    }
}

/// The estimated motion of a body: a torque-free rotation in closed form, with residual and covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionEstimate {
    model: MotionModel,
    rotation: FreeRotation,
    rms: f64,
    covariance: Option<Matrix4<f64>>,
}

impl MotionEstimate {
    /// An estimate with the simplest `model` that fits the data (a nearly symmetric body may be called axisymmetric
    /// although its closed form is asymmetric). `rms` is the RMS residual: of image points \[px\] or angular velocities
    /// \[rad/s\]. `covariance` is that of `(J_x, J_y, J_z, alpha)` \[s⁴\], if the method computes it.
    pub fn new(
        model: MotionModel,
        rotation: FreeRotation,
        rms: f64,
        covariance: Option<Matrix4<f64>>,
    ) -> Self {
        Self {
            model,
            rotation,
            rms,
            covariance,
        }
    }

    /// The model.
    pub fn model(&self) -> MotionModel {
        self.model
    }

    /// The closed form.
    pub fn rotation(&self) -> &FreeRotation {
        &self.rotation
    }

    /// Moments over twice the energy \[s²\], in the thesis's order ([`DynamicParameters`]). `None` if the
    /// model does not determine them: many bodies have the same aperiodic or single-axis motion.
    pub fn J(&self) -> Option<Vector3<f64>> {
        self.rotation.parameters().map(DynamicParameters::J)
    }

    /// `alpha = L² / 4E²` \[s²\].
    pub fn alpha(&self) -> f64 {
        self.rotation.alpha()
    }

    /// Direction of the angular momentum in camera axes.
    pub fn momentum_direction(&self) -> UnitVector3<f64> {
        self.rotation.momentum_direction()
    }

    /// The principal axes in body axes B, by rows, in the order of `J`. `None` if the model does not determine them.
    pub fn principal_axes(&self) -> Option<Matrix3<f64>> {
        self.rotation.principal_axes()
    }

    /// Reference time of the motion \[s\].
    pub fn reference_time(&self) -> f64 {
        self.rotation.reference_time()
    }

    /// The body's attitude `R_CB` at the reference time.
    pub fn reference_attitude(&self) -> UnitQuaternion<f64> {
        self.attitude(self.reference_time())
    }

    /// Attitude `R_CB` in camera axes at `time` \[s\]. B is fixed to the body, but otherwise arbitrary.
    pub fn attitude(&self, time: f64) -> UnitQuaternion<f64> {
        self.rotation.attitude(time)
    }

    /// Angular velocity in camera axes \[rad/s\] at `time` \[s\].
    pub fn angular_velocity(&self, time: f64) -> Vector3<f64> {
        self.rotation.angular_velocity(time)
    }

    /// RMS residual: of image points \[px\] or of angular velocities \[rad/s\].
    pub fn rms(&self) -> f64 {
        self.rms
    }

    /// Covariance of `(J_x, J_y, J_z, alpha)` \[s⁴\], if the method computes it.
    pub fn covariance(&self) -> Option<&Matrix4<f64>> {
        self.covariance.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_model_has_a_unique_name() {
        for (name, model) in MotionModel::NAMES {
            assert_eq!(model.name(), name);
        }
    }
}
