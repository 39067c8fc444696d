//! The servo of joint rates that sits in a robot's drives.

use nalgebra::{DMatrix, DVector};

use super::gains::{ConfigError, check_joint_gains, check_positive};
use crate::{
    dynamics::{State, Workspace},
    model::Model,
};

/// What the servo's torque is made of.
#[derive(Debug, Clone, PartialEq)]
pub enum ServoGains {
    /// Bandwidth `ω` \[rad/s\], the same whatever the posture: `τ = Ĥ(q) ω (e + ω_i ∫e dt)`, with the rate error `e`
    /// and the reduced inertia `Ĥ` that the joints feel when the base is free.
    Bandwidth(f64),
    /// Gains `k` \[N m s/rad or N s/m\], one per joint, each for itself: `τ_j = k_j (e_j + ω_i ∫e_j dt)`. How fast that
    /// is depends on the inertia that a joint feels.
    PerJoint(Vec<f64>),
}

/// Settings of the servo.
#[derive(Debug, Clone, PartialEq)]
pub struct VelocityServoConfig {
    /// Proportional part.
    pub gains: ServoGains,
    /// Inverse of the integral part's time, `ω_i` \[rad/s\]; zero is a proportional servo.
    pub integral: f64,
}

impl VelocityServoConfig {
    /// Refuses what no servo can be made of.
    ///
    /// # Errors
    /// [`ConfigError`] for gains that are not positive or do not fit the robot.
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

/// A servo that drives joint rates to references: proportional and integral, no more than its drives can do.
///
/// Sampled: its torque is held from one call to the next. With the period `T` of the calls, a proportional servo is
/// stable up to a bandwidth of `2/T`, and overshoots above `1/T`.
#[derive(Debug, Clone)]
pub struct VelocityServo {
    config: VelocityServoConfig,
    /// Rates to drive to \[rad/s or m/s\].
    reference: DVector<f64>,
    integral: DVector<f64>,
    pull: DVector<f64>,
    efforts: DVector<f64>,
    workspace: Workspace,
}

impl VelocityServo {
    /// At rest.
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
            pull: DVector::zeros(n),
            efforts: DVector::zeros(n),
            workspace: Workspace::new(model),
        })
    }

    /// Inverse time constant of the fastest motion that the proportional part gives the joints at `q` \[1/s\].
    pub fn fastest(&self, model: &Model, q: &DVector<f64>) -> f64 {
        match &self.config.gains {
            ServoGains::Bandwidth(omega) => *omega,
            ServoGains::PerJoint(gains) => {
                let mut workspace = Workspace::new(model);
                workspace.set_positions(model, q);
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

    /// Rates to drive to \[rad/s or m/s\].
    pub fn reference(&self) -> &DVector<f64> {
        &self.reference
    }

    /// Sets the rate that joint `j` is driven to, cut to its limit. Returns whether it was cut.
    pub fn refer(&mut self, model: &Model, j: usize, rate: f64) -> bool {
        let limit = model.joints()[j].limits.velocity;
        self.reference[j] = rate.clamp(-limit, limit);
        self.reference[j] != rate
    }

    /// All rates to zero.
    pub fn halt(&mut self) {
        self.reference.fill(0.0);
    }

    /// Forgets reference and integral: a servo that takes over anew.
    pub fn reset(&mut self) {
        self.reference.fill(0.0);
        self.integral.fill(0.0);
    }

    /// Efforts \[N m or N\] for the next `dt` \[s\], within the joints' limits.
    pub fn efforts(&mut self, model: &Model, state: &State, dt: f64) -> &DVector<f64> {
        let omega_i = self.config.integral;
        for j in 0..model.dof() {
            let error = self.reference[j] - state.qd[j];
            self.pull[j] = error + omega_i * (self.integral[j] + error * dt);
        }
        match &self.config.gains {
            ServoGains::Bandwidth(omega) => {
                self.workspace.set_positions(model, &state.q);
                let inertia: &DMatrix<f64> = self.workspace.reduced_inertia();
                self.efforts.gemv(*omega, inertia, &self.pull, 0.0);
            }
            ServoGains::PerJoint(gains) => {
                let pairs = gains.iter().zip(self.pull.iter());
                for (effort, (gain, pull)) in self.efforts.iter_mut().zip(pairs) {
                    *effort = gain * pull;
                }
            }
        }
        for (j, joint) in model.joints().iter().enumerate() {
            let limit = joint.limits.effort;
            let wanted = self.efforts[j];
            self.efforts[j] = wanted.clamp(-limit, limit);
            // A drive at its limit cannot work off what would add up.
            if self.efforts[j] == wanted {
                self.integral[j] += (self.reference[j] - state.qd[j]) * dt;
            }
        }
        &self.efforts
    }
}
