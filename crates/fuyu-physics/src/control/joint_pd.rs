//! Joint PD control: a law for robots with a fixed base; on a free-floating robot the tip misses its goal.

use nalgebra::DVector;

use super::gains::check_joint_gains;
use super::unreachable_goal::UnreachableGoal;
use super::{
    ConfigError, IkError, Law, LawConfig, LawError, LawInput, LawStatus, Manipulator,
    inverse_kinematics,
};
use crate::spatial::Pose;

/// Settings of [`JointPd`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JointPdConfig {
    /// Position gains \[N m/rad or N/m\], one per joint.
    pub k_p: Vec<f64>,
}

impl JointPdConfig {
    /// Refuses gains that do not fit a robot with `joints` joints.
    ///
    /// # Errors
    /// [`ConfigError`] names the gain.
    pub fn check(&self, joints: usize) -> Result<(), ConfigError> {
        check_joint_gains("joint_k_p", &self.k_p, joints)
    }
}

/// `τ = K_P (q_D - q) - K_V q̇` with joint positions `q_D` from inverse kinematics, computed once from the first camera
/// measurement; later ones are ignored. Because the base moves meanwhile, the tip ends next to the goal: Masutani 1995
/// Fig. 5.3(a).
#[derive(Debug, Clone)]
pub struct JointPd {
    config: JointPdConfig,
    /// `q_D` \[rad or m\].
    goal: Option<DVector<f64>>,
    unreachable: UnreachableGoal,
}

impl JointPd {
    /// The law, without a goal yet.
    pub fn new(config: JointPdConfig) -> Self {
        Self {
            config,
            goal: None,
            unreachable: UnreachableGoal::default(),
        }
    }

    fn joint_goal(
        &mut self,
        manipulator: &Manipulator,
        X_BD: &Pose,
        q: &DVector<f64>,
    ) -> Result<DVector<f64>, IkError> {
        self.unreachable.check(X_BD, (1e-3, 1e-3))?;
        inverse_kinematics(&manipulator.model, &manipulator.tip, X_BD, q)
            .inspect_err(|error| self.unreachable.remember(X_BD, error))
    }
}

impl Law for JointPd {
    fn efforts(
        &mut self,
        input: &LawInput<'_>,
        manipulator: &mut Manipulator,
        efforts: &mut DVector<f64>,
    ) -> Result<LawStatus, LawError> {
        if let (None, Some(tip)) = (&self.goal, input.tip()) {
            self.goal = Some(self.joint_goal(manipulator, &tip.X_BD, input.q)?);
        }
        let Some(goal) = &self.goal else {
            return Ok(LawStatus::Inactive);
        };
        for (j, k_p) in self.config.k_p.iter().enumerate() {
            efforts[j] = k_p * (goal[j] - input.q[j]);
        }
        Ok(LawStatus::JointFeedback)
    }

    fn reset(&mut self) {
        self.goal = None;
        self.unreachable = UnreachableGoal::default();
    }

    fn configure(&mut self, config: &LawConfig) -> bool {
        let LawConfig::JointPd(config) = config else {
            return false;
        };
        self.config.clone_from(config);
        true
    }
}
