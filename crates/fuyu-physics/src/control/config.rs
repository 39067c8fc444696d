//! Settings of a controller.

use super::gains::check_not_negative;
use super::prediction::{GoalMotionConfig, Prediction};
use super::{
    GainError, Gains, JacobianKind, JointPdGains, LawKind, OperationalConfig,
    SingularityEscapeConfig, StraightPathConfig,
};

/// Settings of a [`Controller`](super::Controller): which law, what all laws share, and what each has for
/// itself.
#[derive(Debug, Clone, PartialEq)]
pub struct ControllerConfig {
    /// Which law.
    pub law: LawKind,
    /// Which Jacobian turns wrenches on the tip into joint efforts.
    pub jacobian: JacobianKind,
    /// Gains on the deviation of the tip; `k_v` damps the joints under every law.
    pub gains: Gains,
    /// Time constant with which the difference decays that a change of settings makes \[s\]; zero lets the
    /// efforts jump.
    pub bumpless_transfer_time: f64,
    /// What is done about the age of what the camera has seen.
    pub prediction: Prediction,
    /// What is known of goals and camera, to predict how a goal moves.
    pub goal: GoalMotionConfig,
    /// The operational-space law's own.
    pub operational: OperationalConfig,
    /// What happens when the tip rests away from its goal.
    pub singularity_escape: SingularityEscapeConfig,
    /// The joint PD's own.
    pub joint_pd: JointPdGains,
    /// The straight-path law's own.
    pub straight_path: StraightPathConfig,
}

impl ControllerConfig {
    /// A law with its gains, the generalized Jacobian, and defaults for the rest. Laws other than
    /// transpose-Jacobian control have gains of their own, to be filled in.
    pub fn new(law: LawKind, gains: Gains) -> Self {
        Self {
            law,
            jacobian: JacobianKind::Generalized,
            gains,
            bumpless_transfer_time: 0.5,
            prediction: Prediction::None,
            goal: GoalMotionConfig::default(),
            operational: OperationalConfig::default(),
            singularity_escape: SingularityEscapeConfig::default(),
            joint_pd: JointPdGains::default(),
            straight_path: StraightPathConfig::default(),
        }
    }

    /// Refuses settings that do not fit a robot with `joints` joints.
    ///
    /// # Errors
    /// [`GainError`] naming the gain.
    pub fn check(&self, joints: usize) -> Result<(), GainError> {
        self.gains.check(joints)?;
        check_not_negative("bumpless_transfer_time", self.bumpless_transfer_time)?;
        self.goal.check()?;
        self.singularity_escape.check()?;
        match self.law {
            LawKind::TransposeJacobian => Ok(()),
            LawKind::OperationalSpace => self.operational.check(),
            LawKind::JointPd => self.joint_pd.check(joints),
            LawKind::StraightPath => self.straight_path.check(),
        }
    }
}
