//! Joint-space PD: what a fixed-base robot would do, and what misses here.

use nalgebra::DVector;

use super::gains::check_joint_gains;
use super::{
    ControlReport, ControllerConfig, GainError, IkError, Law, LawError, Manipulator, Measurement,
    PoseError, inverse_kinematics,
};
use crate::spatial::Pose;

/// Gains of [`JointPd`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JointPdGains {
    /// Position gains \[N m/rad or N/m\], one per joint.
    pub k_p: Vec<f64>,
}

impl JointPdGains {
    /// Refuses gains that do not fit a robot with `joints` joints.
    ///
    /// # Errors
    /// [`GainError`] naming the gain.
    pub fn check(&self, joints: usize) -> Result<(), GainError> {
        check_joint_gains("joint_k_p", &self.k_p, joints)
    }
}

/// `τ = K_P (q_D - q) - K_V q̇` towards joint positions found once, by inverse kinematics at the start. It looks
/// at the camera then and never again. Because the base moves meanwhile, the tip ends beside the goal: Masutani
/// 1995 Fig. 5.3(a).
#[derive(Debug, Clone)]
pub struct JointPd {
    gains: JointPdGains,
    /// Joint positions to reach \[rad or m\].
    goal: Option<DVector<f64>>,
    /// A goal for which there are no joint positions, and why.
    out_of_reach: Option<(Pose, IkError)>,
}

impl JointPd {
    /// The law, without a goal yet.
    pub fn new(config: &ControllerConfig) -> Self {
        Self {
            gains: config.joint_pd.clone(),
            goal: None,
            out_of_reach: None,
        }
    }

    fn find(
        &mut self,
        arm: &Manipulator,
        X_BD: &Pose,
        q: &DVector<f64>,
    ) -> Result<DVector<f64>, IkError> {
        // The search is long where it fails: it is not made again for the same goal.
        if let Some((goal, error)) = &self.out_of_reach {
            let moved = PoseError::between(goal, X_BD);
            if moved.position.norm() < 1e-3 && moved.angle < 1e-3 {
                return Err(error.clone());
            }
        }
        inverse_kinematics(&arm.model, &arm.tip, X_BD, q)
            .inspect_err(|error| self.out_of_reach = Some((*X_BD, error.clone())))
    }
}

impl Law for JointPd {
    fn configure(&mut self, config: &ControllerConfig) {
        self.gains.clone_from(&config.joint_pd);
    }

    fn efforts(
        &mut self,
        arm: &mut Manipulator,
        seen: &Measurement<'_>,
        pull: &mut DVector<f64>,
    ) -> Result<ControlReport, LawError> {
        if let (None, Some(sight)) = (&self.goal, seen.tip) {
            self.goal = Some(self.find(arm, &sight.X_BD, seen.q)?);
        }
        if let Some(goal) = &self.goal {
            for (j, k_p) in self.gains.k_p.iter().enumerate() {
                pull[j] = k_p * (goal[j] - seen.q[j]);
            }
        }
        Ok(ControlReport {
            active: self.goal.is_some(),
            ..ControlReport::on(seen)
        })
    }

    /// It ends beside the goal, as it must.
    fn seeks_the_goal(&self) -> bool {
        false
    }
}
