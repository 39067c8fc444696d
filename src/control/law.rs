//! What a control law is.

use std::fmt;

use nalgebra::DVector;

use super::{
    ControllerConfig, IkError, JointPd, Measurement, PoseError, StraightPath, TransposeJacobian,
    Trouble,
};
use crate::dynamics::Workspace;
use crate::model::{Frame, Model};

/// A control law: how it pulls the joints, given what is measured. Damping of the joints is not its
/// business; the [`Controller`](super::Controller) adds `-K_V q̇`.
///
/// A step takes no memory.
pub trait Law: fmt::Debug + Send {
    /// Takes over settings that have been checked. What the law has found out meanwhile stays.
    fn configure(&mut self, config: &ControllerConfig);

    /// Writes the joint efforts without damping \[N m or N\]. Where the law lacks what it needs, such as
    /// [`Measurement::sight`], it says so in [`Acted::pulls`] and what it writes is not used.
    ///
    /// # Errors
    /// [`LawError`] when there are no efforts; the joints are only damped then.
    fn pull(
        &mut self,
        arm: &mut Arm,
        seen: &Measurement<'_>,
        pull: &mut DVector<f64>,
    ) -> Result<Acted, LawError>;

    /// The part of `K_V` that is added while the law pulls, 0 to 1: less for a law that damps by itself.
    fn joint_damping(&self) -> f64 {
        1.0
    }

    /// Whether the pull is that of the potential of chapter 5 (or less), so that a tip that comes no nearer is in
    /// trouble.
    fn seeks_the_goal(&self) -> bool {
        true
    }
}

/// Which law drives the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawKind {
    /// Transpose-Jacobian control, [`TransposeJacobian`].
    TransposeJacobian,
    /// Joint PD towards joint positions found by inverse kinematics when it starts, [`JointPd`].
    JointPd,
    /// Transpose-Jacobian control whose tip keeps to a straight line, [`StraightPath`].
    StraightPath,
}

impl LawKind {
    /// All laws by name.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("transpose_jacobian", Self::TransposeJacobian),
        ("straight_path", Self::StraightPath),
        ("joint_pd", Self::JointPd),
    ];

    /// The law with its settings, for an arm with so many joints.
    pub(super) fn start(self, config: &ControllerConfig, joints: usize) -> Box<dyn Law> {
        match self {
            Self::TransposeJacobian => Box::new(TransposeJacobian::new(config, joints)),
            Self::JointPd => Box::new(JointPd::new(config)),
            Self::StraightPath => Box::new(StraightPath::new(config, joints)),
        }
    }
}

/// The arm as a law knows it, with scratch.
#[derive(Debug, Clone)]
pub struct Arm {
    /// The robot.
    pub model: Model,
    /// The tip's frame E.
    pub tip: Frame,
    /// Scratch; a law sets the positions from what is measured before it reads.
    pub workspace: Workspace,
}

impl Arm {
    /// An arm with its tip at the frame `tip` of `model`.
    pub fn new(model: Model, tip: Frame) -> Self {
        Self {
            workspace: Workspace::new(&model),
            model,
            tip,
        }
    }
}

/// What a controller did at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Acted {
    /// Deviation that it acted on; `None` while no camera measurement was given.
    pub error: Option<PoseError>,
    /// Whether the position error was saturated.
    pub position_saturated: bool,
    /// Whether the orientation error was saturated.
    pub orientation_saturated: bool,
    /// Why the tip does not arrive, if it does not.
    pub trouble: Option<Trouble>,
    /// Whether the law had all that it needs; else the joints are only damped.
    pub pulls: bool,
}

impl Acted {
    /// Acted on what the camera saw, if anything, without saturation.
    pub fn on(seen: &Measurement<'_>) -> Self {
        Self {
            error: seen.sight.map(|s| PoseError::between(&s.X_BE, &s.X_BD)),
            pulls: seen.sight.is_some(),
            ..Self::default()
        }
    }
}

/// Why a law gives no efforts.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LawError {
    /// The law needs joint positions for the goal, and there are none.
    #[error(transparent)]
    Unreachable(#[from] IkError),
}
