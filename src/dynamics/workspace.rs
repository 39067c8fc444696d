//! Scratch memory for one model, and the kinematics that everything else reads.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix3xX, Rotation3, Translation3, Vector3};

use super::{Momentum, State};
use crate::model::{Frame, JointKind, Model};
use crate::spatial::{Pose, SpatialInertia, Twist, Wrench};

/// Preallocated scratch for one [`Model`]. Fill it with [`Workspace::set_positions`] (and
/// [`Workspace::set_motion`]), then read. Components are in base axes unless a name says otherwise.
#[derive(Debug, Clone)]
pub struct Workspace {
    /// Pose of each body in its parent body (identity for the base).
    pub(super) X_PB: Vec<Pose>,
    /// Pose of each body in the base frame.
    pub(super) X_0B: Vec<Pose>,
    /// Each joint's motion per unit rate, in the moved body's frame.
    pub(super) axes: Vec<Twist>,
    /// Inertia of each body with its whole subtree, in the body's frame.
    pub(super) composite: Vec<SpatialInertia>,
    /// System centre of mass in the base frame, `r_C` of eq. (4.11) from the base frame's origin \[m\].
    pub(super) p_BC: Vector3<f64>,
    pub(super) mass: f64,
    /// `J_C` of eq. (4.12).
    pub(super) J_C: Matrix3xX<f64>,
    /// `H_M` of eq. (4.26).
    pub(super) H_M: Matrix3xX<f64>,
    /// `H_B⁻¹`, inverse of eq. (4.25).
    pub(super) H_B_inverse: Matrix3<f64>,
    /// Twist of each body in its own frame.
    pub(super) twist: Vec<Twist>,
    pub(super) acceleration: Vec<Twist>,
    pub(super) force: Vec<Wrench>,
    pub(super) reduced: DMatrix<f64>,
    pub(super) rhs: DVector<f64>,
}

impl Workspace {
    /// Scratch for `model`; the only place where memory is taken.
    pub fn new(model: &Model) -> Self {
        let (bodies, n) = (model.bodies().len(), model.dof());
        let mut workspace = Self {
            X_PB: vec![Pose::identity(); bodies],
            X_0B: vec![Pose::identity(); bodies],
            axes: model.joints().iter().map(joint_axis).collect(),
            composite: vec![SpatialInertia::zero(); bodies],
            p_BC: Vector3::zeros(),
            mass: model.total_mass(),
            J_C: Matrix3xX::zeros(n),
            H_M: Matrix3xX::zeros(n),
            H_B_inverse: Matrix3::zeros(),
            twist: vec![Twist::ZERO; bodies],
            acceleration: vec![Twist::ZERO; bodies],
            force: vec![Wrench::ZERO; bodies],
            reduced: DMatrix::zeros(n, n),
            rhs: DVector::zeros(n),
        };
        workspace.set_positions(model, &DVector::zeros(n));
        workspace
    }

    /// Computes everything that depends on joint positions `q` alone: body poses, composite inertias,
    /// centre of mass, momentum map.
    pub fn set_positions(&mut self, model: &Model, q: &DVector<f64>) {
        for (j, joint) in model.joints().iter().enumerate() {
            let parent = model.joint_parent(j);
            let X_PB = match joint.kind {
                JointKind::Prismatic => {
                    joint.X_PJ * Translation3::from(joint.axis.into_inner() * q[j])
                }
                JointKind::Revolute | JointKind::Continuous => {
                    joint.X_PJ * Rotation3::from_axis_angle(&joint.axis, q[j])
                }
            };
            self.X_PB[j + 1] = X_PB;
            self.X_0B[j + 1] = self.X_0B[parent] * X_PB;
        }
        self.set_composite_inertias(model);
    }

    /// Adds what depends on motion: the twist of every body, for joint rates and momentum of `state`.
    /// Positions must be set for the same state.
    pub fn set_motion(&mut self, model: &Model, state: &State) {
        let momentum_B = state.momentum_W.expressed_in(&state.R_WB);
        self.set_twists(model, &momentum_B, &state.qd);
    }

    pub(super) fn set_twists(&mut self, model: &Model, momentum_B: &Momentum, qd: &DVector<f64>) {
        self.twist[0] = self.base_twist(momentum_B, qd);
        for j in 0..model.dof() {
            let parent = self.twist[model.joint_parent(j)];
            self.twist[j + 1] = parent.shifted_to_child(&self.X_PB[j + 1]) + self.axes[j] * qd[j];
        }
    }

    /// The system's centre of mass in the base frame \[m\].
    pub fn p_BC(&self) -> &Vector3<f64> {
        &self.p_BC
    }

    /// Pose of `frame` in the base frame.
    pub fn X_BF(&self, frame: &Frame) -> Pose {
        self.X_0B[frame.body] * frame.X_BF
    }

    /// Twist of `frame`'s origin in the world, components in the base's axes
    /// (needs [`Workspace::set_motion`]).
    pub fn V_WF_B(&self, frame: &Frame) -> Twist {
        let at_body = self.twist[frame.body];
        let R_0B = &self.X_0B[frame.body].rotation;
        let linear = at_body.linear + at_body.angular.cross(&frame.X_BF.translation.vector);
        Twist::new(R_0B * at_body.angular, R_0B * linear)
    }

    /// Twist of the base frame in the world, components in the base's axes
    /// (needs [`Workspace::set_motion`]).
    pub fn V_WB_B(&self) -> &Twist {
        &self.twist[0]
    }
}

fn joint_axis(joint: &crate::model::Joint) -> Twist {
    let axis = joint.axis.into_inner();
    if joint.kind.is_rotational() {
        Twist::new(axis, Vector3::zeros())
    } else {
        Twist::new(Vector3::zeros(), axis)
    }
}
