//! Linear plant of attitude control: from the wheels' torques on the base to small rotations of the base.

use fuyu_lti::{Matrix, StateSpace, Structure, spectral_radius};
use nalgebra::{DVector, Matrix3};

use super::{AttitudeConfigError, AttitudeLaw};
use crate::dynamics::flexible::{FlexibleSystem, LinearModel};

/// Linear model of a robot with locked joints at one posture, undeformed and at rest, from torques of wheels on the
/// base to small rotations of the base (base axes) and their rates.
///
/// The translation follows from zero momentum, and the wheels turn freely under their motors, so their axial inertia is
/// not part of the plant. Sensors and actuators are collocated, as Kida 1993 section 4.2 requires.
#[derive(Debug, Clone)]
pub struct AttitudePlant {
    structure: Structure,
    system: StateSpace,
}

impl AttitudePlant {
    /// The plant of `system` at joint positions `q`.
    ///
    /// # Errors
    /// [`AttitudeConfigError::Design`] for a mass matrix that is not positive definite.
    ///
    /// # Panics
    /// If `q` does not have one element per joint.
    pub fn new(system: &FlexibleSystem, q: &DVector<f64>) -> Result<Self, AttitudeConfigError> {
        let linear = LinearModel::new(system, q);
        let kept = linear.base_and_modes();
        let wheels: Vec<usize> = linear.wheels().collect();
        let part = |rows: &[usize], columns: &[usize]| {
            linear.mass.select_rows(rows).select_columns(columns)
        };
        // Only the motor changes a wheel's own momentum about its axis.
        let coupling = part(&kept, &wheels);
        let mut mass = part(&kept, &kept);
        for (w, column) in coupling.column_iter().enumerate() {
            let inertia = linear.mass[(wheels[w], wheels[w])];
            mass -= column * column.transpose() / inertia;
        }
        let mut input = Matrix::zeros(kept.len(), 3);
        input
            .view_mut((3, 0), (3, 3))
            .copy_from(&Matrix::identity(3, 3));
        let structure = Structure::new(
            (&mass + mass.transpose()) * 0.5,
            LinearModel::part(&linear.damping, &kept),
            LinearModel::part(&linear.stiffness, &kept),
            input,
        )
        .and_then(|structure| structure.without_free_coordinates(&[0, 1, 2]))
        .map_err(AttitudeConfigError::design("model of the attitude"))?;
        Ok(Self {
            system: structure
                .displacement_and_rate_system()
                .map_err(AttitudeConfigError::design("model of the attitude"))?,
            structure,
        })
    }

    /// The plant in second-order form: three rotations, then the modes.
    pub fn structure(&self) -> &Structure {
        &self.structure
    }

    /// The plant in state-space form: from torque \[N m\] to rotation \[rad\] and rate \[rad/s\], six outputs.
    pub fn system(&self) -> &StateSpace {
        &self.system
    }

    /// Inertia against a torque on the locked, undeformed robot's base, which is free to move \[kg m²\]: `θ'' =
    /// inertia⁻¹ τ`.
    pub fn inertia(&self) -> Matrix3<f64> {
        self.structure.mass().fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// Inertia about each axis while the other two attitudes follow freely \[kg m²\].
    pub fn axis_inertia(&self) -> [f64; 3] {
        // Of a positive definite matrix, as the structure's constructor has checked.
        let inverse = self.inertia().try_inverse().unwrap_or_else(Matrix3::zeros);
        [0, 1, 2].map(|i| 1.0 / inverse[(i, i)])
    }

    /// The plant of one axis, the other two free to follow.
    pub(super) fn axis(&self, axis: usize) -> Result<Structure, fuyu_lti::LtiError> {
        let others: Vec<usize> = (0..3).filter(|i| *i != axis).collect();
        self.structure
            .with_actuators(&[axis])?
            .without_free_coordinates(&others)
    }

    /// Poles of the continuous closed loop \[rad/s\].
    ///
    /// # Errors
    /// [`AttitudeConfigError::Design`] if the eigenvalues cannot be computed.
    pub fn poles(
        &self,
        law: &dyn AttitudeLaw,
    ) -> Result<Vec<fuyu_lti::Complex>, AttitudeConfigError> {
        let closed = law.linear().and_then(|law| self.system.feedback(&law));
        closed
            .and_then(|closed| closed.poles())
            .map_err(AttitudeConfigError::design("closed loop of the attitude"))
    }

    /// Spectral radius of the sampled closed loop, in which torques are held for `period` \[s\] and act `delay` \[s\]
    /// late. The loop is stable if it is below 1.
    ///
    /// # Errors
    /// [`AttitudeConfigError::Design`] for a period or delay out of its range.
    pub fn sampled_radius(
        &self,
        law: &dyn AttitudeLaw,
        period: f64,
        delay: f64,
    ) -> Result<f64, AttitudeConfigError> {
        let radius = || {
            let plant = self.system.zero_order_hold_delayed(period, delay)?;
            let law = law.linear()?;
            let law = if law.order() == 0 {
                law
            } else {
                law.tustin(period)?
            };
            spectral_radius(&plant.feedback(&law)?.a)
        };
        radius().map_err(AttitudeConfigError::design("sampled loop of the attitude"))
    }
}
