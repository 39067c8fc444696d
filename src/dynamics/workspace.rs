//! Scratch memory for one model, and the kinematics that everything else reads.

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Translation3, Vector3};

use super::{Momentum, State};
use crate::model::{Frame, Joint, Model};
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
    /// How each joint's position turns into a pose.
    maps: Vec<JointMap>,
    /// The body that each joint hangs from.
    pub(super) parents: Vec<usize>,
    /// Inertia of each body with its whole subtree, in the body's frame.
    pub(super) composite: Vec<SpatialInertia>,
    /// System centre of mass in the base frame, `r_C` of eq. (4.11) from the base frame's origin \[m\].
    pub(super) p_BC: Vector3<f64>,
    pub(super) mass: f64,
    /// Columns of `J_C`, eq. (4.12).
    pub(super) J_C: Vec<Vector3<f64>>,
    /// Columns of `H_M`, eq. (4.26).
    pub(super) H_M: Vec<Vector3<f64>>,
    /// `H_B⁻¹`, inverse of eq. (4.25).
    pub(super) H_B_inverse: Matrix3<f64>,
    /// Columns of `H_A = -H_B⁻¹ H_M`, eq. (4.24): base angular velocity per unit joint rate.
    pub(super) H_A: Vec<Vector3<f64>>,
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
            maps: model.joints().iter().map(JointMap::new).collect(),
            parents: (0..n).map(|j| model.joint_parent(j)).collect(),
            J_C: vec![Vector3::zeros(); n],
            H_M: vec![Vector3::zeros(); n],
            H_B_inverse: Matrix3::zeros(),
            H_A: vec![Vector3::zeros(); n],
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
        for (j, (map, &position)) in self.maps.iter().zip(q.iter()).enumerate() {
            let X_PB = map.pose(position);
            self.X_PB[j + 1] = X_PB;
            self.X_0B[j + 1] = self.X_0B[self.parents[j]] * X_PB;
        }
        self.set_composite_inertias(model);
    }

    /// Adds what depends on motion: the twist of every body, for joint rates and momentum of `state`.
    /// Positions must be set for the same state.
    pub fn set_motion(&mut self, state: &State) {
        let momentum_B = state.momentum_W.expressed_in(&state.R_WB);
        self.set_twists(&momentum_B, &state.qd);
    }

    fn set_twists(&mut self, momentum_B: &Momentum, qd: &DVector<f64>) {
        self.twist[0] = self.base_twist(momentum_B, qd);
        for j in 0..qd.len() {
            let parent = self.twist[self.parents[j]];
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

/// Pose of a moved body in its parent as a function of joint position, with everything that does not
/// depend on the position multiplied out: `R_PB = along + cos q · across + sin q · turning`.
#[derive(Debug, Clone)]
struct JointMap {
    along: Matrix3<f64>,
    across: Matrix3<f64>,
    turning: Matrix3<f64>,
    origin: Vector3<f64>,
    slide: Option<Vector3<f64>>,
}

impl JointMap {
    fn new(joint: &Joint) -> Self {
        let R_PJ = joint.X_PJ.rotation.matrix();
        let axis = joint.axis.into_inner();
        let origin = joint.X_PJ.translation.vector;
        if joint.kind.is_rotational() {
            let along = R_PJ * axis * axis.transpose();
            let across = R_PJ - along;
            let turning = R_PJ * axis.cross_matrix();
            Self {
                along,
                across,
                turning,
                origin,
                slide: None,
            }
        } else {
            let zero = Matrix3::zeros();
            let slide = Some(R_PJ * axis);
            Self {
                along: *R_PJ,
                across: zero,
                turning: zero,
                origin,
                slide,
            }
        }
    }

    #[inline]
    fn pose(&self, position: f64) -> Pose {
        let (R_PB, origin) = match &self.slide {
            None => {
                let (sin, cos) = position.sin_cos();
                (
                    self.along + self.across * cos + self.turning * sin,
                    self.origin,
                )
            }
            Some(slide) => (self.along, self.origin + slide * position),
        };
        Pose::from_parts(
            Translation3::from(origin),
            Rotation3::from_matrix_unchecked(R_PB),
        )
    }
}

fn joint_axis(joint: &Joint) -> Twist {
    let axis = joint.axis.into_inner();
    if joint.kind.is_rotational() {
        Twist::new(axis, Vector3::zeros())
    } else {
        Twist::new(Vector3::zeros(), axis)
    }
}
