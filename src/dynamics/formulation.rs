//! One interface for the independent ways to compute forward dynamics.

use nalgebra::{DVector, UnitQuaternion};

use super::Input;
use crate::model::Model;
use crate::spatial::Twist;

/// How a free-floating tree moves at an instant: what every formulation starts from. Where the base is
/// does not matter, since nothing but contact and actuators acts on the tree.
#[derive(Debug, Clone, Copy)]
pub struct TreeMotion<'a> {
    /// Attitude of the base in the world. Forward dynamics does not depend on it; a formulation that
    /// works in world axes needs some attitude.
    pub R_WB: UnitQuaternion<f64>,
    /// Twist of the base frame (its origin's velocity), base axes.
    pub V_WB_B: Twist,
    /// Joint positions \[rad or m\].
    pub q: &'a [f64],
    /// Joint rates \[rad/s or m/s\].
    pub qd: &'a [f64],
}

/// How that motion changes: the answer of every formulation.
#[derive(Debug, Clone, PartialEq)]
pub struct TreeAcceleration {
    /// Angular acceleration of the base \[rad/s²\] and acceleration of its frame's origin as a point
    /// \[m/s²\], base axes.
    pub A_WB_B: Twist,
    /// Joint accelerations \[rad/s² or m/s²\].
    pub qdd: DVector<f64>,
}

impl TreeAcceleration {
    /// No acceleration, sized for `model`.
    pub fn zero(model: &Model) -> Self {
        Self {
            A_WB_B: Twist::ZERO,
            qdd: DVector::zeros(model.dof()),
        }
    }
}

/// Forward dynamics of a free-floating tree. A formulation owns its scratch, is made for one model and
/// asked with that model.
pub trait Formulation {
    /// Accelerations under joint efforts, springs, dampers and external wrenches.
    fn accelerations(
        &mut self,
        model: &Model,
        motion: &TreeMotion,
        input: &Input,
        out: &mut TreeAcceleration,
    );
}
