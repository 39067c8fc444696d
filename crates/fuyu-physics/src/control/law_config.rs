//! Choice of a law, with its settings.

use super::{
    ComputedTorque, ComputedTorqueConfig, ConfigError, JointPd, JointPdConfig, Law, Manipulator,
    OperationalSpace, OperationalSpaceConfig, StraightPath, StraightPathConfig, TransposeJacobian,
    TransposeJacobianConfig,
};

/// The built-in laws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawKind {
    /// Transpose-Jacobian control, [`TransposeJacobian`].
    TransposeJacobian,
    /// Joint PD control to joint positions found by inverse kinematics at the start, [`JointPd`].
    JointPd,
    /// Resolved acceleration with the generalized inertia, [`OperationalSpace`].
    OperationalSpace,
    /// Transpose-Jacobian control whose tip follows a straight line, [`StraightPath`].
    StraightPath,
    /// Computed torque to joint positions found on the floating base, [`ComputedTorque`].
    ComputedTorque,
}

impl LawKind {
    /// All laws by name.
    pub const NAMES: [(&'static str, Self); 5] = [
        ("transpose_jacobian", Self::TransposeJacobian),
        ("straight_path", Self::StraightPath),
        ("joint_pd", Self::JointPd),
        ("operational_space", Self::OperationalSpace),
        ("computed_torque", Self::ComputedTorque),
    ];
}

/// A law with its settings.
#[derive(Debug, Clone, PartialEq)]
pub enum LawConfig {
    /// Transpose-Jacobian control.
    TransposeJacobian(TransposeJacobianConfig),
    /// Joint PD control.
    JointPd(JointPdConfig),
    /// Resolved acceleration.
    OperationalSpace(OperationalSpaceConfig),
    /// Transpose-Jacobian control along a straight line.
    StraightPath(StraightPathConfig),
    /// Computed torque.
    ComputedTorque(ComputedTorqueConfig),
    /// A user-defined law, passed to [`Controller::with_law`](super::Controller::with_law). It manages its settings
    /// itself.
    Custom,
}

impl LawConfig {
    /// Kind of a built-in law; `None` for a user-defined one.
    pub fn kind(&self) -> Option<LawKind> {
        match self {
            Self::TransposeJacobian(_) => Some(LawKind::TransposeJacobian),
            Self::JointPd(_) => Some(LawKind::JointPd),
            Self::OperationalSpace(_) => Some(LawKind::OperationalSpace),
            Self::StraightPath(_) => Some(LawKind::StraightPath),
            Self::ComputedTorque(_) => Some(LawKind::ComputedTorque),
            Self::Custom => None,
        }
    }

    /// Name of the law: that of [`LawKind::NAMES`], or `custom`.
    pub fn name(&self) -> &'static str {
        let kind = self.kind();
        let mut names = LawKind::NAMES.iter();
        let known = names.find(|(_, named)| Some(*named) == kind);
        known.map_or("custom", |(name, _)| name)
    }

    /// Whether the controller damps the joints for this law, and so needs [`Gains::k_v`](super::Gains::k_v). Other laws
    /// use it only while there is no measurement.
    pub fn needs_joint_damping(&self) -> bool {
        !matches!(self, Self::OperationalSpace(_) | Self::ComputedTorque(_))
    }

    /// Refuses settings that do not fit a robot with `joints` joints.
    ///
    /// # Errors
    /// [`ConfigError`] names the setting.
    pub fn check(&self, joints: usize) -> Result<(), ConfigError> {
        match self {
            Self::TransposeJacobian(_) | Self::Custom => Ok(()),
            Self::JointPd(config) => config.check(joints),
            Self::OperationalSpace(config) => config.check(),
            Self::StraightPath(config) => config.check(),
            Self::ComputedTorque(config) => config.check(),
        }
    }

    /// The law for a robot; `None` for a user-defined one.
    pub(super) fn build(&self, manipulator: &Manipulator) -> Option<Box<dyn Law>> {
        Some(match self {
            Self::TransposeJacobian(config) => {
                Box::new(TransposeJacobian::new(*config, manipulator))
            }
            Self::JointPd(config) => Box::new(JointPd::new(config.clone())),
            Self::OperationalSpace(config) => {
                Box::new(OperationalSpace::new(config.clone(), manipulator))
            }
            Self::StraightPath(config) => Box::new(StraightPath::new(config.clone(), manipulator)),
            Self::ComputedTorque(config) => Box::new(ComputedTorque::new(*config, manipulator)),
            Self::Custom => return None,
        })
    }
}

impl From<LawKind> for LawConfig {
    /// The law with default settings. Joint PD control has no default gains: they must be set.
    fn from(kind: LawKind) -> Self {
        match kind {
            LawKind::TransposeJacobian => TransposeJacobianConfig::default().into(),
            LawKind::JointPd => JointPdConfig::default().into(),
            LawKind::OperationalSpace => OperationalSpaceConfig::default().into(),
            LawKind::StraightPath => StraightPathConfig::default().into(),
            LawKind::ComputedTorque => ComputedTorqueConfig::default().into(),
        }
    }
}

impl From<TransposeJacobianConfig> for LawConfig {
    fn from(config: TransposeJacobianConfig) -> Self {
        Self::TransposeJacobian(config)
    }
}

impl From<JointPdConfig> for LawConfig {
    fn from(config: JointPdConfig) -> Self {
        Self::JointPd(config)
    }
}

impl From<OperationalSpaceConfig> for LawConfig {
    fn from(config: OperationalSpaceConfig) -> Self {
        Self::OperationalSpace(config)
    }
}

impl From<ComputedTorqueConfig> for LawConfig {
    fn from(config: ComputedTorqueConfig) -> Self {
        Self::ComputedTorque(config)
    }
}

impl From<StraightPathConfig> for LawConfig {
    fn from(config: StraightPathConfig) -> Self {
        Self::StraightPath(config)
    }
}
