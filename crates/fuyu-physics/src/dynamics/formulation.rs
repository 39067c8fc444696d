//! The interface of the formulations of forward dynamics, and the choice between them.

use nalgebra::{DVector, UnitQuaternion, Vector3};

use super::newton_euler::{NewtonEuler, SystemError};
use super::{ArticulatedBody, Input, Kane, Reduced, State, Workspace};
use crate::model::Model;
use crate::spatial::{Twist, Wrench};

/// Motion of a free-floating tree at an instant: the argument of every formulation. The position of the base is not
/// part of it, since accelerations do not depend on it.
#[derive(Debug, Clone, Copy)]
pub struct TreeMotion<'a> {
    /// Attitude of the base in the world. Forward dynamics does not depend on it, but a formulation that works in
    /// world axes needs one.
    pub R_WB: UnitQuaternion<f64>,
    /// Twist of the base frame (its origin's velocity), base axes.
    pub V_WB_B: Twist,
    /// Joint positions \[rad or m\].
    pub q: &'a [f64],
    /// Joint rates \[rad/s or m/s\].
    pub qd: &'a [f64],
}

/// Accelerations of a free-floating tree: the result of every formulation.
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

/// The equations of motion evaluated at a [`State`], for an integrator.
#[derive(Debug, Clone)]
pub struct Evaluation {
    /// Accelerations of base and joints.
    pub acceleration: TreeAcceleration,
    /// Angular velocity of the base \[rad/s\], base axes.
    pub w_WB_B: Vector3<f64>,
    /// External wrench on the whole system, torque about its centre of mass, base axes; `None` if there is none.
    pub external: Option<Wrench>,
    /// Power of joint efforts, springs, dampers and external wrenches \[W\].
    pub power: f64,
}

impl Evaluation {
    /// All zero, sized for `model`.
    pub fn zero(model: &Model) -> Self {
        Self {
            acceleration: TreeAcceleration::zero(model),
            w_WB_B: Vector3::zeros(),
            external: None,
            power: 0.0,
        }
    }

    /// Takes the external wrench and the power from `workspace`, after [`Workspace::set_external`].
    pub(super) fn set_forces(&mut self, state: &State, workspace: &Workspace, input: &Input) {
        self.external = Some(workspace.external);
        self.power = workspace.external_power;
        let motion = state.q.as_slice().iter().zip(state.qd.as_slice());
        let joints = workspace.model.joints().iter();
        let actuated = joints.zip(input.efforts.as_slice());
        for ((joint, effort), (q, qd)) in actuated.zip(motion) {
            self.power += (effort + joint.passive_effort(*q, *qd)) * qd;
        }
    }
}

/// Forward dynamics of one free-floating tree. A formulation owns its scratch memory.
pub trait Formulation {
    /// Accelerations under joint efforts, springs, dampers and external wrenches.
    ///
    /// # Panics
    /// If a length does not fit the robot that the formulation was made for.
    fn accelerations(&mut self, motion: &TreeMotion, input: &Input, out: &mut TreeAcceleration);

    /// Evaluates the equations of motion at `state`, whose momentum determines the base twist. Integrators call this at
    /// every stage. `workspace` is scratch.
    ///
    /// # Panics
    /// As [`Formulation::accelerations`].
    fn evaluate(
        &mut self,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
        out: &mut Evaluation,
    ) {
        evaluate_with_base_twist(self, state, workspace, input, out);
    }
}

/// Implements [`Formulation::evaluate`] by the base twist and [`Formulation::accelerations`].
pub(super) fn evaluate_with_base_twist(
    formulation: &mut (impl Formulation + ?Sized),
    state: &State,
    workspace: &mut Workspace,
    input: &Input,
    out: &mut Evaluation,
) {
    workspace.set_positions(&state.q);
    workspace.set_base_motion(state);
    workspace.set_external(input, state.qd.as_slice());
    let motion = TreeMotion {
        R_WB: state.R_WB,
        V_WB_B: *workspace.V_WB_B(),
        q: state.q.as_slice(),
        qd: state.qd.as_slice(),
    };
    out.w_WB_B = motion.V_WB_B.angular;
    formulation.accelerations(&motion, input, &mut out.acceleration);
    out.set_forces(state, workspace, input);
}

/// Formulations to choose from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FormulationKind {
    /// [`ArticulatedBody`]: the default, the fastest and the most precise for long chains.
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

    /// This formulation for `model`.
    ///
    /// # Errors
    /// [`SystemError`] if the matrix method does not support the model, for example because of a body without mass.
    pub fn prepare(self, model: &Model) -> Result<ForwardDynamics, SystemError> {
        Ok(match self {
            Self::ArticulatedBody => ForwardDynamics::articulated_body(model),
            Self::Reduced => ForwardDynamics::Reduced(Box::new(Reduced::new(model))),
            Self::Kane => ForwardDynamics::Kane(Box::new(Kane::new(model))),
            Self::NewtonEuler => ForwardDynamics::NewtonEuler(Box::new(NewtonEuler::new(model)?)),
        })
    }
}

/// A formulation chosen at run time, for one model.
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

    fn chosen(&mut self) -> &mut dyn Formulation {
        match self {
            Self::ArticulatedBody(formulation) => formulation.as_mut(),
            Self::Reduced(formulation) => formulation.as_mut(),
            Self::Kane(formulation) => formulation.as_mut(),
            Self::NewtonEuler(formulation) => formulation.as_mut(),
        }
    }
}

impl Formulation for ForwardDynamics {
    fn accelerations(&mut self, motion: &TreeMotion, input: &Input, out: &mut TreeAcceleration) {
        self.chosen().accelerations(motion, input, out);
    }

    fn evaluate(
        &mut self,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
        out: &mut Evaluation,
    ) {
        self.chosen().evaluate(state, workspace, input, out);
    }
}
