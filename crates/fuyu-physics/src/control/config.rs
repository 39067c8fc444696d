//! Settings of a controller.

use super::gains::{ConfigError, check_not_negative};
use super::prediction::{GoalMotionConfig, Prediction};
use super::{Gains, LawConfig, SingularityEscapeConfig};

/// Settings of a [`Controller`](super::Controller): the law with its own settings, and those that all laws share.
#[derive(Debug, Clone, PartialEq)]
pub struct ControllerConfig {
    /// The law with its settings.
    pub law: LawConfig,
    /// Gains on the deviation of the tip; `k_v` damps the joints under every law.
    pub gains: Gains,
    /// Time constant of the bumpless transfer \[s\]: the difference in the efforts that a change of settings makes decays
    /// with it. With zero the efforts jump.
    pub bumpless_transfer_time: f64,
    /// How the age of the camera measurements is compensated.
    pub prediction: Prediction,
    /// Noise of the camera and smoothness of the goal's motion, for the prediction of that motion.
    pub goal: GoalMotionConfig,
    /// How the arm leaves a singular position in which it rests away from its goal.
    pub singularity_escape: SingularityEscapeConfig,
}

impl ControllerConfig {
    /// A law with the gains, and defaults for the rest. `law` is a [`LawKind`](super::LawKind) for the law's default
    /// settings, or the settings of a law, such as [`StraightPathConfig`](super::StraightPathConfig).
    pub fn new(law: impl Into<LawConfig>, gains: Gains) -> Self {
        Self {
            law: law.into(),
            gains,
            bumpless_transfer_time: 0.5,
            prediction: Prediction::None,
            goal: GoalMotionConfig::default(),
            singularity_escape: SingularityEscapeConfig::default(),
        }
    }

    /// Refuses settings that do not fit a robot with `joints` joints, or are not finite.
    ///
    /// # Errors
    /// [`ConfigError`] names the setting.
    pub fn check(&self, joints: usize) -> Result<(), ConfigError> {
        self.gains.check(joints)?;
        check_not_negative("bumpless_transfer_time", self.bumpless_transfer_time)?;
        self.goal.check()?;
        self.singularity_escape.check()?;
        self.law.check(joints)
    }
}
