//! Velocity servo of the joint drives.

use nalgebra::{DMatrix, DVector};

use super::gains::{ConfigError, check_joint_gains, check_positive};
use crate::{
    dynamics::{State, Workspace},
    model::Model,
};

/// Proportional gains of the servo.
#[derive(Debug, Clone, PartialEq)]
pub enum ServoGains {
    /// Bandwidth `ω` \[rad/s\], the same in every posture: `τ = Ĥ(q) ω (e + ω_i ∫e dt)`, with the rate error `e`
    /// and the reduced inertia `Ĥ` of the joints on a free base.
    Bandwidth(f64),
    /// Gains `k` \[N m s/rad or N s/m\], one per joint: `τ_j = k_j (e_j + ω_i ∫e_j dt)`. The
    /// bandwidth depends on the effective inertia of the joint.
    PerJoint(Vec<f64>),
}

/// Settings of the servo.
#[derive(Debug, Clone, PartialEq)]
pub struct VelocityServoConfig {
    /// Proportional gains.
    pub gains: ServoGains,
    /// Inverse of the integral time, `ω_i` \[rad/s\]; zero for a proportional servo.
    pub integral: f64,
}

impl VelocityServoConfig {
    /// Refuses gains that are not positive or do not fit the robot.
    ///
    /// # Errors
    /// [`ConfigError`] names the gain.
    pub fn check(&self, joints: usize) -> Result<(), ConfigError> {
        match &self.gains {
            ServoGains::Bandwidth(omega) => check_positive("bandwidth", *omega)?,
            ServoGains::PerJoint(gains) => check_joint_gains("gains", gains, joints)?,
        }
        match self.integral {
            0.0 => Ok(()),
            omega => check_positive("integral", omega),
        }
    }
}

/// A proportional-integral servo of joint rates, within the effort limits of the drives.
///
/// The servo is sampled: its torque is held between calls. With the period `T` of the calls, a proportional servo is
/// stable up to a bandwidth of `2/T`, and overshoots above `1/T`.
#[derive(Debug, Clone)]
pub struct VelocityServo {
    config: VelocityServoConfig,
    /// Reference rates \[rad/s or m/s\].
    reference: DVector<f64>,
    integral: DVector<f64>,
    /// Rate errors, including their integral part.
    error: DVector<f64>,
    efforts: DVector<f64>,
    workspace: Workspace,
}

impl VelocityServo {
    /// A servo with zero references.
    ///
    /// # Errors
    /// [`ConfigError`] as [`VelocityServoConfig::check`].
    pub fn new(model: &Model, config: VelocityServoConfig) -> Result<Self, ConfigError> {
        let n = model.dof();
        config.check(n)?;
        Ok(Self {
            config,
            reference: DVector::zeros(n),
            integral: DVector::zeros(n),
            error: DVector::zeros(n),
            efforts: DVector::zeros(n),
            workspace: Workspace::new(model),
        })
    }

    /// Largest bandwidth of the proportional part at the joint positions `q` \[rad/s\].
    pub fn max_bandwidth(&self, model: &Model, q: &DVector<f64>) -> f64 {
        match &self.config.gains {
            ServoGains::Bandwidth(omega) => *omega,
            ServoGains::PerJoint(gains) => {
                let mut workspace = Workspace::new(model);
                workspace.set_positions(q);
                let roots = DVector::from_iterator(gains.len(), gains.iter().map(|k| k.sqrt()));
                // Ĥ⁻¹ K has the eigenvalues of √K Ĥ⁻¹ √K, which is symmetric.
                let inertia = workspace.reduced_inertia().clone();
                let scaled = DMatrix::from_fn(gains.len(), gains.len(), |i, j| {
                    inertia[(i, j)] / (roots[i] * roots[j])
                });
                let least = scaled.symmetric_eigenvalues();
                1.0 / least.iter().fold(f64::INFINITY, |a, b| a.min(*b))
            }
        }
    }

    /// Reference rates \[rad/s or m/s\].
    pub fn reference(&self) -> &DVector<f64> {
        &self.reference
    }

    /// Sets the reference rate of joint `j`, clamped to its limit. Returns whether it was clamped.
    pub fn set_reference(&mut self, model: &Model, j: usize, rate: f64) -> bool {
        let limit = model.joints()[j].limits.velocity;
        self.reference[j] = rate.clamp(-limit, limit);
        self.reference[j] != rate
    }

    /// Sets all references to zero.
    pub fn halt(&mut self) {
        self.reference.fill(0.0);
    }

    /// Sets integrals to zero.
    pub fn reset_integral(&mut self) {
        self.integral.fill(0.0);
    }

    /// Sets references and integrals to zero.
    pub fn reset(&mut self) {
        self.reference.fill(0.0);
        self.integral.fill(0.0);
    }

    /// Efforts \[N m or N\] for the next `dt` \[s\], within the joints' limits.
    pub fn efforts(&mut self, model: &Model, state: &State, dt: f64) -> &DVector<f64> {
        let omega_i = self.config.integral;
        for j in 0..model.dof() {
            let error = self.reference[j] - state.qd[j];
            self.error[j] = error + omega_i * (self.integral[j] + error * dt);
        }
        match &self.config.gains {
            ServoGains::Bandwidth(omega) => {
                self.workspace.set_positions(&state.q);
                let inertia: &DMatrix<f64> = self.workspace.reduced_inertia();
                self.efforts.gemv(*omega, inertia, &self.error, 0.0);
            }
            ServoGains::PerJoint(gains) => {
                let pairs = gains.iter().zip(self.error.iter());
                for (effort, (gain, error)) in self.efforts.iter_mut().zip(pairs) {
                    *effort = gain * error;
                }
            }
        }
        for (j, joint) in model.joints().iter().enumerate() {
            let limit = joint.limits.effort;
            let wanted = self.efforts[j];
            self.efforts[j] = wanted.clamp(-limit, limit);
            // Anti-windup: a saturated drive does not integrate.
            if self.efforts[j] == wanted {
                self.integral[j] += (self.reference[j] - state.qd[j]) * dt;
            }
        }
        &self.efforts
    }
}
