//! One interface for the independent ways to compute forward dynamics.

use nalgebra::{DVector, UnitQuaternion};

use super::newton_euler::{NewtonEuler, SystemError};
use super::{ArticulatedBody, Input, Kane, Reduced};
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

/// Formulations to choose from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FormulationKind {
    /// [`ArticulatedBody`]: the default, since it is the fastest and loses no digits in long chains.
    #[default]
    ArticulatedBody,
    /// [`Reduced`].
    Reduced,
    /// [`Kane`].
    Kane,
    /// [`NewtonEuler`].
    NewtonEuler,
}

impl FormulationKind {
    /// All formulations by name, the default first.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("articulated_body", Self::ArticulatedBody),
        ("reduced", Self::Reduced),
        ("kane", Self::Kane),
        ("newton_euler", Self::NewtonEuler),
    ];

    /// Scratch of this formulation for `model`.
    ///
    /// # Errors
    /// [`SystemError`] if the matrix method cannot take the model, such as one with a body without mass.
    pub fn prepare(self, model: &Model) -> Result<ForwardDynamics, SystemError> {
        Ok(match self {
            Self::ArticulatedBody => ForwardDynamics::articulated_body(model),
            Self::Reduced => ForwardDynamics::Reduced(Box::new(Reduced::new(model))),
            Self::Kane => ForwardDynamics::Kane(Box::new(Kane::new(model))),
            Self::NewtonEuler => ForwardDynamics::NewtonEuler(Box::new(NewtonEuler::new(model)?)),
        })
    }
}

/// A formulation that was chosen by name, prepared for a model.
#[derive(Debug, Clone)]
pub enum ForwardDynamics {
    /// By articulated bodies.
    ArticulatedBody(Box<ArticulatedBody>),
    /// By the reduced system.
    Reduced(Box<Reduced>),
    /// By Kane's method.
    Kane(Box<Kane>),
    /// By the matrix method.
    NewtonEuler(Box<NewtonEuler>),
}

impl ForwardDynamics {
    /// The default formulation.
    pub(super) fn articulated_body(model: &Model) -> Self {
        Self::ArticulatedBody(Box::new(ArticulatedBody::new(model)))
    }
}

impl Formulation for ForwardDynamics {
    fn accelerations(
        &mut self,
        model: &Model,
        motion: &TreeMotion,
        input: &Input,
        out: &mut TreeAcceleration,
    ) {
        let chosen: &mut dyn Formulation = match self {
            Self::ArticulatedBody(formulation) => formulation.as_mut(),
            Self::Reduced(formulation) => formulation.as_mut(),
            Self::Kane(formulation) => formulation.as_mut(),
            Self::NewtonEuler(formulation) => formulation.as_mut(),
        };
        chosen.accelerations(model, motion, input, out);
    }
}
