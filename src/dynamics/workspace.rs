//! Scratch memory for one model, and the kinematics that everything else reads.

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Translation3, Vector3};

use super::State;
use super::joint_map::{Axis, JointMap};
use crate::model::{Frame, Model};
use crate::spatial::{Pose, SpatialInertia, Symmetric3, Twist, Wrench};

/// Preallocated scratch for one [`Model`]. Fill it with [`Workspace::set_positions`] (and
/// [`Workspace::set_motion`]), then read. Components are in base axes unless a name says otherwise.
///
/// Inside, everything is in base axes too, but each body's twist, inertia and force are about its own
/// frame's origin: going from body to body then costs a cross product instead of two rotations, and no
/// digits are lost to a distant point of reference.
#[derive(Debug, Clone)]
pub struct Workspace {
    /// The positions that all of this stands for.
    q: DVector<f64>,
    pub(super) bodies: Vec<BodyTerms>,
    pub(super) joints: Vec<JointTerms>,
    /// System centre of mass in the base frame, `r_C` of eq. (4.11) from the base frame's origin \[m\].
    pub(super) p_BC: Vector3<f64>,
    /// Velocity of the system's centre of mass in the world.
    pub(super) v_WC: Vector3<f64>,
    pub(super) mass: f64,
    /// `H_B⁻¹`, inverse of eq. (4.25).
    pub(super) H_B_inverse: Symmetric3,
    /// External wrench on the whole system, torque about its centre of mass.
    pub(super) external: Wrench,
    /// Power that the external wrenches deliver \[W\].
    pub(super) external_power: f64,
    /// `Ĥ`, upper triangle.
    pub(super) reduced: DMatrix<f64>,
}

/// What is known of a body.
#[derive(Debug, Clone)]
pub(super) struct BodyTerms {
    pub(super) R_0B: Matrix3<f64>,
    /// Its origin from the base's.
    pub(super) p_0B: Vector3<f64>,
    /// Its origin from its parent's.
    pub(super) p_PB: Vector3<f64>,
    /// Its own inertia.
    pub(super) inertia: SpatialInertia,
    /// Its inertia with its whole subtree.
    pub(super) composite: SpatialInertia,
    pub(super) twist: Twist,
    /// Acceleration while base and joints do not accelerate: centripetal and Coriolis terms. The linear
    /// part is that of the origin as a point.
    pub(super) bias: Twist,
    /// Acceleration, the linear part that of the origin as a point.
    pub(super) acceleration: Twist,
    /// Force that moves its subtree with the bias acceleration, external wrenches taken off.
    pub(super) force: Wrench,
}

/// What is known of a joint.
#[derive(Debug, Clone)]
pub(super) struct JointTerms {
    map: JointMap,
    /// The body that it hangs from; joint `j` moves body `j + 1`.
    pub(super) parent: usize,
    pub(super) axis: Axis,
    /// Momentum of its subtree at unit rate with the base held, about the moved body's origin.
    pub(super) momentum: Wrench,
    /// Column of `J_C`, eq. (4.12).
    pub(super) J_C: Vector3<f64>,
    /// Column of `H_M`, eq. (4.26).
    pub(super) H_M: Vector3<f64>,
    /// Column of `H_A = -H_B⁻¹ H_M`, eq. (4.24): base angular velocity per unit joint rate.
    pub(super) H_A: Vector3<f64>,
}

impl Workspace {
    /// Scratch for `model`; the only place where memory is taken.
    pub fn new(model: &Model) -> Self {
        let n = model.dof();
        let bodies = model.bodies().iter().map(|body| BodyTerms {
            R_0B: Matrix3::identity(),
            p_0B: Vector3::zeros(),
            p_PB: Vector3::zeros(),
            inertia: body.spatial_inertia,
            composite: body.spatial_inertia,
            twist: Twist::ZERO,
            bias: Twist::ZERO,
            acceleration: Twist::ZERO,
            force: Wrench::ZERO,
        });
        let joints = model
            .joints()
            .iter()
            .enumerate()
            .map(|(j, joint)| JointTerms {
                map: JointMap::new(joint),
                parent: model.joint_parent(j),
                axis: Axis::Turn(Vector3::zeros()),
                momentum: Wrench::ZERO,
                J_C: Vector3::zeros(),
                H_M: Vector3::zeros(),
                H_A: Vector3::zeros(),
            });
        let mut workspace = Self {
            q: DVector::zeros(n),
            bodies: bodies.collect(),
            joints: joints.collect(),
            p_BC: Vector3::zeros(),
            v_WC: Vector3::zeros(),
            mass: model.total_mass(),
            H_B_inverse: Symmetric3::ZERO,
            external: Wrench::ZERO,
            external_power: 0.0,
            reduced: DMatrix::zeros(n, n),
        };
        workspace.place_bodies(model);
        workspace.set_momentum_map();
        workspace
    }

    /// Computes everything that depends on joint positions `q` alone: body poses, composite inertias,
    /// centre of mass, momentum map. Costs nothing when the workspace stands at `q` already.
    pub fn set_positions(&mut self, model: &Model, q: &DVector<f64>) {
        self.place(model, q.as_slice());
    }

    /// [`Workspace::set_positions`] from a slice.
    pub(super) fn place(&mut self, model: &Model, q: &[f64]) {
        if self.q.as_slice() != q {
            self.q.as_mut_slice().copy_from_slice(q);
            self.place_bodies(model);
            self.set_momentum_map();
        }
    }

    fn place_bodies(&mut self, model: &Model) {
        self.bodies[0].composite = self.bodies[0].inertia;
        let inertias = model.bodies()[1..].iter().map(|body| &body.spatial_inertia);
        let moved = (self.joints.iter_mut().zip(self.q.as_slice())).zip(inertias);
        for (j, ((joint, &position), inertia)) in moved.enumerate() {
            let (earlier, rest) = self.bodies.split_at_mut(j + 1);
            let (parent, body) = (&earlier[joint.parent], &mut rest[0]);
            (body.R_0B, body.p_PB, joint.axis) = joint.map.place(&parent.R_0B, position);
            body.p_0B = parent.p_0B + body.p_PB;
            body.inertia = inertia.rotated(&body.R_0B);
            body.composite = body.inertia;
        }
    }

    /// Adds what depends on motion: the twist of every body, for joint rates and momentum of `state`.
    /// Positions must be set for the same state.
    pub fn set_motion(&mut self, state: &State) {
        let momentum_B = state.momentum_W.expressed_in(&state.R_WB);
        self.v_WC = momentum_B.linear / self.mass;
        self.bodies[0].twist = self.base_twist(&momentum_B, &state.qd);
        self.spread_motion(state.qd.as_slice());
    }

    /// Twists and bias accelerations of all bodies from the base's twist and the joint rates.
    pub(super) fn spread_motion(&mut self, qd: &[f64]) {
        for (j, (joint, &rate)) in self.joints.iter().zip(qd).enumerate() {
            let (earlier, rest) = self.bodies.split_at_mut(j + 1);
            let (parent, body) = (&earlier[joint.parent], &mut rest[0]);
            let (w, p) = (parent.twist.angular, &body.p_PB);
            let turned = w.cross(p);
            body.twist = Twist::new(w, parent.twist.linear + turned);
            body.bias = Twist::new(
                parent.bias.angular,
                parent.bias.linear + parent.bias.angular.cross(p) + w.cross(&turned),
            );
            // The axis turns with the parent.
            match &joint.axis {
                Axis::Turn(axis) => {
                    let own = axis * rate;
                    body.twist.angular += own;
                    body.bias.angular += w.cross(&own);
                }
                Axis::Slide(axis) => {
                    let own = axis * rate;
                    body.twist.linear += own;
                    body.bias.linear += w.cross(&own) * 2.0;
                }
            }
        }
    }

    /// The system's centre of mass in the base frame \[m\].
    pub fn p_BC(&self) -> &Vector3<f64> {
        &self.p_BC
    }

    /// Pose of `frame` in the base frame.
    pub fn X_BF(&self, frame: &Frame) -> Pose {
        let body = &self.bodies[frame.body];
        let X_0B = Pose::from_parts(
            Translation3::from(body.p_0B),
            Rotation3::from_matrix_unchecked(body.R_0B),
        );
        X_0B * frame.X_BF
    }

    /// Twist of `frame`'s origin in the world, components in the base's axes
    /// (needs [`Workspace::set_motion`]).
    pub fn V_WF_B(&self, frame: &Frame) -> Twist {
        let body = &self.bodies[frame.body];
        let r = body.R_0B * frame.X_BF.translation.vector;
        let Twist { angular, linear } = body.twist;
        Twist::new(angular, linear + angular.cross(&r))
    }

    /// Twist of the base frame in the world, components in the base's axes
    /// (needs [`Workspace::set_motion`]).
    pub fn V_WB_B(&self) -> &Twist {
        &self.bodies[0].twist
    }
}
