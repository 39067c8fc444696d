//! What a control law is.

use std::fmt;

use nalgebra::{DVector, Vector3};

use super::{
    ControllerConfig, ConvergenceFailure, IkError, JointPd, Measurement, OperationalSpace,
    PoseError, Saturation, StraightPath, TransposeJacobian,
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

    /// Writes the joint efforts without damping \[N m or N\]. The arm's workspace has the positions of `seen`, and keeps
    /// them. Where the law lacks what it needs, such as [`Measurement::tip`], it says so in [`ControlReport::active`] and what it
    /// writes is not used.
    ///
    /// # Errors
    /// [`LawError`] when there are no efforts; the joints are only damped then.
    fn efforts(
        &mut self,
        arm: &mut Manipulator,
        seen: &Measurement<'_>,
        pull: &mut DVector<f64>,
    ) -> Result<ControlReport, LawError>;

    /// The part of `K_V` that is added while the law pulls, 0 to 1: less for a law that damps by itself.
    fn joint_damping(&self) -> f64 {
        1.0
    }

    /// Whether the pull is that of the potential of chapter 5 (or less), so that a tip that comes no nearer is in
    /// trouble.
    fn seeks_the_goal(&self) -> bool {
        true
    }

    /// Whether the controller adds what a moving goal takes, [`FeedForward`](super::FeedForward), when it predicts the goal's motion.
    fn feeds_forward(&self) -> bool {
        false
    }
}

/// Which law drives the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawKind {
    /// Transpose-Jacobian control, [`TransposeJacobian`].
    TransposeJacobian,
    /// Joint PD towards joint positions found by inverse kinematics when it starts, [`JointPd`].
    JointPd,
    /// Resolved acceleration with the generalized inertia, [`OperationalSpace`].
    OperationalSpace,
    /// Transpose-Jacobian control whose tip keeps to a straight line, [`StraightPath`].
    StraightPath,
}

impl LawKind {
    /// All laws by name.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("transpose_jacobian", Self::TransposeJacobian),
        ("straight_path", Self::StraightPath),
        ("joint_pd", Self::JointPd),
        ("operational_space", Self::OperationalSpace),
    ];

    /// The law with its settings, for an arm.
    pub(super) fn start(self, config: &ControllerConfig, arm: &Manipulator) -> Box<dyn Law> {
        let joints = arm.model.dof();
        match self {
            Self::TransposeJacobian => Box::new(TransposeJacobian::new(config, joints)),
            Self::OperationalSpace => Box::new(OperationalSpace::new(config, arm)),
            Self::JointPd => Box::new(JointPd::new(config)),
            Self::StraightPath => Box::new(StraightPath::new(config, arm)),
        }
    }
}

/// The arm as a law knows it, with scratch.
#[derive(Debug, Clone)]
pub struct Manipulator {
    /// The robot.
    pub model: Model,
    /// The tip's frame E.
    pub tip: Frame,
    /// The tips of further arms, in order.
    pub more_tips: Vec<Frame>,
    /// Scratch; at the positions that are measured while a law pulls.
    pub workspace: Workspace,
}

impl Manipulator {
    /// An arm with its tip at the frame `tip` of `model`.
    pub fn new(model: Model, tip: Frame) -> Self {
        Self {
            workspace: Workspace::new(&model),
            model,
            tip,
            more_tips: Vec::new(),
        }
    }

    /// All tips, the first one first.
    pub fn tips(&self) -> impl Iterator<Item = &Frame> {
        std::iter::once(&self.tip).chain(&self.more_tips)
    }
}

/// What a controller did at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ControlReport {
    /// Deviation that it acted on; `None` while no camera measurement was given.
    pub error: Option<PoseError>,
    /// Deviation of the second tip, of a robot with several arms; `None` while it is not seen.
    pub second_error: Option<PoseError>,
    /// Whether the position error was saturated.
    pub position_saturated: bool,
    /// Whether the orientation error was saturated.
    pub orientation_saturated: bool,
    /// Why the tip does not arrive, if it does not.
    pub convergence_failure: Option<ConvergenceFailure>,
    /// Whether the law had all that it needs; else the joints are only damped.
    pub active: bool,
}

impl ControlReport {
    /// ControlReport on what the camera saw, if anything, without saturation.
    pub fn on(seen: &Measurement<'_>) -> Self {
        Self {
            error: seen.tip.map(|s| PoseError::between(&s.X_BE, &s.X_BD)),
            active: seen.tip.is_some(),
            ..Self::default()
        }
    }

    /// Position and orientation error as they act, if anything was seen; notes what of them was cut.
    pub fn saturate(&mut self, saturation: &Saturation) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let error = self.error.as_ref()?;
        let (e_p, position_saturated) = saturation.position_error(error);
        let (e_o, orientation_saturated) = saturation.orientation_error(error);
        self.position_saturated = position_saturated;
        self.orientation_saturated = orientation_saturated;
        Some((e_p, e_o))
    }
}

/// Why a law gives no efforts.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LawError {
    /// The law needs joint positions for the goal, and there are none.
    #[error(transparent)]
    Unreachable(#[from] IkError),
}
