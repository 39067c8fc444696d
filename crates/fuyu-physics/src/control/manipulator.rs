//! The robot arm that a law controls.

use crate::dynamics::Workspace;
use crate::model::{Frame, Model};

/// A robot with its tips, and scratch memory for its kinematics and dynamics.
#[derive(Debug, Clone)]
pub struct Manipulator {
    /// The robot.
    pub model: Model,
    /// Frame E of the first tip.
    pub tip: Frame,
    /// Frames of the second and further tips, in order.
    pub more_tips: Vec<Frame>,
    /// Scratch. When a law is called it holds the measured joint positions.
    pub workspace: Workspace,
}

impl Manipulator {
    /// A robot whose tip is the frame `tip` of `model`.
    pub fn new(model: Model, tip: Frame) -> Self {
        Self {
            workspace: Workspace::new(&model),
            model,
            tip,
            more_tips: Vec::new(),
        }
    }

    /// The same robot with further tips.
    pub fn with_more_tips(self, more_tips: Vec<Frame>) -> Self {
        Self { more_tips, ..self }
    }

    /// All tips, the first one first.
    pub fn tips(&self) -> impl Iterator<Item = &Frame> {
        std::iter::once(&self.tip).chain(&self.more_tips)
    }
}
