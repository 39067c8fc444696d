//! Settings of a controller.

use super::gains::{ConfigError, check_not_negative};
use super::prediction::{GoalMotionConfig, Prediction};
use super::{AutoGains, Gains, LawConfig, SingularityEscapeConfig};
use crate::model::{Frame, Model};

/// Settings of a [`Controller`](super::Controller): the law with its own settings, and those that all laws share.
#[derive(Debug, Clone, PartialEq)]
pub struct ControllerConfig {
    /// The law with its settings.
    pub law: LawConfig,
    /// Gains on the deviation of the tip; `k_v` damps the joints under every law.
    pub gains: Gains,
    /// Time constant of the bumpless transfer \[s\], with which the effort difference of a change of settings decays.
    /// With zero the efforts jump.
    pub bumpless_transfer_time: f64,
    /// Compensation of the age of the camera measurements.
    pub prediction: Prediction,
    /// Noise of the camera and smoothness of the goal's motion, for the prediction of that motion.
    pub goal: GoalMotionConfig,
    /// Escape of the arm from a singular position in which it rests away from its goal.
    pub singularity_escape: SingularityEscapeConfig,
}

impl ControllerConfig {
    /// A law with these gains, and defaults for the rest. `law` is a [`LawKind`](super::LawKind) for the law's default
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

    /// The same settings with computed gains ([`AutoGains`]) where none are given: all [`Gains`] if `k_v` is empty, and
    /// the position gains of joint PD control if they are empty. Saturation does not change.
    ///
    /// # Errors
    /// [`ConfigError::NoAutoGains`] for a robot without joints, or whose tip no joint moves.
    pub fn with_auto_gains(
        mut self,
        model: &Model,
        tip: &Frame,
        period: f64,
    ) -> Result<Self, ConfigError> {
        let needs_joint_gains =
            matches!(&self.law, LawConfig::JointPd(config) if config.k_p.is_empty());
        if !self.gains.k_v.is_empty() && !needs_joint_gains {
            return Ok(self);
        }
        let auto = AutoGains::new(model, tip, period).ok_or(ConfigError::NoAutoGains)?;
        if self.gains.k_v.is_empty() {
            let saturation = self.gains.saturation;
            self.gains = Gains {
                saturation,
                ..auto.gains
            };
        }
        if let (LawConfig::JointPd(config), true) = (&mut self.law, needs_joint_gains) {
            config.k_p = auto.joint_k_p;
        }
        Ok(self)
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
