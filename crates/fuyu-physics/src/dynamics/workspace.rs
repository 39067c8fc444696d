//! Kinematics of one robot at one state, and its preallocated memory.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Translation3, Vector3};
use pulp::{Arch, Simd, WithSimd};

use super::axis::Axis;
use super::kernel::{JointKinematics, MomentumColumn, Tree};
use super::{InstructionSets, State, checks};
use crate::model::{Frame, Model};
use crate::spatial::{Pose, Symmetric3, Twist, Wrench};

/// Kinematics and dynamics terms of one robot, in preallocated memory. Fill it with [`Workspace::set_positions`] and
/// [`Workspace::set_motion`], then read the results. Components are in base axes unless a name says otherwise.
///
/// Methods panic if a vector or [`Frame`] does not fit the robot; the message names the argument.
// Each body's twist and force are about the origin of its kernel frame (`super::kernel`), in base axes: going from
// body to body then costs a cross product instead of two rotations, and no digits are lost to a distant point of
// reference.
#[derive(Debug, Clone)]
pub struct Workspace {
    /// Instruction set of the processor.
    pub(super) arch: Arch,
    pub(super) model: Model,
    pub(super) tree: Arc<Tree>,
    /// Position-dependent terms of the joints and the bodies that they move.
    pub(super) joints: JointKinematics,
    /// Motion-dependent terms, one per body.
    pub(super) bodies: Vec<BodyTerms>,
    /// System centre of mass in the base frame, `r_C` of eq. (4.11) from the base frame's origin \[m\].
    pub(super) p_BC: Vector3<f64>,
    /// Velocity of the system's centre of mass in the world.
    pub(super) v_WC: Vector3<f64>,
    pub(super) mass: f64,
    /// `H_B`, eq. (4.25), and its inverse.
    pub(super) H_B: Symmetric3,
    pub(super) H_B_inverse: Symmetric3,
    /// External wrench on the whole system, torque about its centre of mass.
    pub(super) external: Wrench,
    /// Power that the external wrenches deliver \[W\].
    pub(super) external_power: f64,
    /// `Ĥ`, upper triangle.
    pub(super) reduced: DMatrix<f64>,
    /// `Ĥ` of all joints of the tree, including mimic joints, upper triangle; empty without mimic joints.
    pub(super) tree_reduced: DMatrix<f64>,
    /// Scratch: a value for each joint of the tree; empty without mimic joints.
    tree_values: Vec<f64>,
}

/// Motion-dependent terms of a body.
#[derive(Debug, Clone, Default)]
pub(super) struct BodyTerms {
    pub(super) twist: Twist,
    /// Acceleration while base and joints do not accelerate: centripetal and Coriolis terms. The linear part is that of
    /// the origin as a point.
    pub(super) bias: Twist,
    /// Acceleration; the linear part is that of the origin as a point.
    pub(super) acceleration: Twist,
    /// Force that its subtree needs for the bias acceleration, minus the external wrenches.
    pub(super) force: Wrench,
}

/// Update of the position-dependent terms; `pulp` compiles it for every instruction set.
struct PositionUpdate<'a> {
    tree: &'a Tree,
    joints: &'a mut JointKinematics,
    q: &'a [f64],
    p_BC: &'a mut Vector3<f64>,
    H_B: &'a mut Symmetric3,
    H_B_inverse: &'a mut Symmetric3,
}

impl WithSimd for PositionUpdate<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let system = self.joints.set_positions(simd, self.tree, self.q);
        *self.p_BC = system.p_BC.0.into();
        *self.H_B = system.H_B.into();
        // Composite inertias are positive definite, so the inverse exists unless a position is not finite, and
        // then every result is NaN.
        *self.H_B_inverse = system.H_B_inverse.into();
    }
}

impl Workspace {
    /// A workspace for `model`, at joint positions zero. Allocates; no other method does.
    pub fn new(model: &Model) -> Self {
        let arch = InstructionSets::of_this_processor().positions;
        Self::with_instruction_set(model, arch)
    }

    pub(super) fn with_instruction_set(model: &Model, arch: Arch) -> Self {
        let n = model.dof();
        let tree = Tree::shared(model);
        let mimicking = if model.has_mimics() { tree.dof() } else { 0 };
        let mut workspace = Self {
            arch,
            model: model.clone(),
            joints: JointKinematics::new(&tree),
            tree,
            bodies: vec![BodyTerms::default(); model.bodies().len()],
            p_BC: Vector3::zeros(),
            v_WC: Vector3::zeros(),
            mass: model.total_mass(),
            H_B: Symmetric3::ZERO,
            H_B_inverse: Symmetric3::ZERO,
            external: Wrench::ZERO,
            external_power: 0.0,
            reduced: DMatrix::zeros(n, n),
            tree_reduced: DMatrix::zeros(mimicking, mimicking),
            tree_values: vec![0.0; mimicking],
        };
        workspace.move_to(&vec![0.0; workspace.tree.dof()]);
        workspace.set_positions_from(&vec![0.0; n]);
        workspace
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Computes all quantities that depend on joint positions `q` alone: body poses, composite inertias, centre of
    /// mass, momentum map. Returns at once if `q` has not changed since the last call.
    ///
    /// # Panics
    /// If `q` does not have one element per joint.
    pub fn set_positions(&mut self, q: &DVector<f64>) {
        self.set_positions_from(q.as_slice());
    }

    /// [`Workspace::set_positions`] from a slice.
    pub(super) fn set_positions_from(&mut self, q: &[f64]) {
        checks::joint_vector("q", q.len(), &self.model);
        if !self.model.has_mimics() {
            if self.joints.q() != q {
                self.move_to(q);
            }
            return;
        }
        let mut tree_q = std::mem::take(&mut self.tree_values);
        self.model.expand_positions(q, &mut tree_q);
        if self.joints.q() != tree_q {
            self.move_to(&tree_q);
        }
        self.tree_values = tree_q;
    }

    /// Calls `use_rates` with the rates, or accelerations, of all joints of the tree, including mimic joints.
    pub(super) fn with_tree_rates(
        &mut self,
        rates: &[f64],
        use_rates: impl FnOnce(&mut Self, &[f64]),
    ) {
        if !self.model.has_mimics() {
            use_rates(self, rates);
            return;
        }
        let mut tree_rates = std::mem::take(&mut self.tree_values);
        self.model.expand_rates(rates, &mut tree_rates);
        use_rates(self, &tree_rates);
        self.tree_values = tree_rates;
    }

    /// Moves all joints of the tree to positions `q`.
    fn move_to(&mut self, q: &[f64]) {
        self.arch.dispatch(PositionUpdate {
            tree: &self.tree,
            joints: &mut self.joints,
            q,
            p_BC: &mut self.p_BC,
            H_B: &mut self.H_B,
            H_B_inverse: &mut self.H_B_inverse,
        });
    }

    /// Computes the twist of every body from joint rates and momentum of `state`, whose positions must be set.
    ///
    /// # Panics
    /// If `state.qd` does not have one element per joint.
    pub fn set_motion(&mut self, state: &State) {
        checks::joint_vector("state.qd", state.qd.len(), &self.model);
        self.set_base_motion(state);
        self.propagate_motion(state.qd.as_slice());
    }

    /// [`Workspace::set_motion`] for the base alone.
    pub(super) fn set_base_motion(&mut self, state: &State) {
        let momentum_B = state.momentum_W.expressed_in(&state.R_WB);
        self.v_WC = momentum_B.linear / self.mass;
        self.bodies[0].twist = self.base_twist(&momentum_B, &state.qd);
    }

    /// Twists and bias accelerations of all bodies from the base's twist and the joint rates.
    pub(super) fn propagate_motion(&mut self, qd: &[f64]) {
        self.with_tree_rates(qd, Self::propagate_tree_motion);
    }

    /// [`Workspace::propagate_motion`] from the rates of all joints of the tree.
    fn propagate_tree_motion(&mut self, qd: &[f64]) {
        for (j, (joint, &rate)) in self.tree.joints.iter().zip(qd).enumerate() {
            let (earlier, rest) = self.bodies.split_at_mut(j + 1);
            let (parent, body) = (&earlier[joint.parent], &mut rest[0]);
            let p = self.joints.p_BK(j + 1) - self.joints.p_BK(joint.parent);
            let p = Vector3::from(p.0);
            let w = parent.twist.angular;
            let turned = w.cross(&p);
            body.twist = Twist::new(w, parent.twist.linear + turned);
            body.bias = Twist::new(
                parent.bias.angular,
                parent.bias.linear + parent.bias.angular.cross(&p) + w.cross(&turned),
            );
            // The axis turns with the parent.
            let own = Vector3::from(self.joints.axes(j + 1)[2].0) * rate;
            if joint.is_prismatic {
                body.twist.linear += own;
                body.bias.linear += w.cross(&own) * 2.0;
            } else {
                body.twist.angular += own;
                body.bias.angular += w.cross(&own);
            }
        }
    }

    /// The system's centre of mass in the base frame \[m\].
    pub fn p_BC(&self) -> &Vector3<f64> {
        &self.p_BC
    }

    /// Columns of the momentum map of coordinate `j`: the sum over the joints that the coordinate moves.
    #[inline]
    pub(super) fn column(&self, j: usize) -> MomentumColumn<f64> {
        if self.model.has_mimics() {
            self.coupled_column(j)
        } else {
            self.joints.column(j)
        }
    }

    /// [`Workspace::column`] of a robot with mimic joints.
    #[cold]
    fn coupled_column(&self, j: usize) -> MomentumColumn<f64> {
        let mut sum = MomentumColumn::zero(0.0);
        for &(k, ratio) in self.model.members(j) {
            sum.add_scaled(&self.joints.column(k), ratio);
        }
        sum
    }

    /// Axis of joint `j` of the tree.
    pub(super) fn axis(&self, j: usize) -> Axis {
        let direction = Vector3::from(self.joints.axes(j + 1)[2].0);
        if self.tree.joints[j].is_prismatic {
            Axis::Slide(direction)
        } else {
            Axis::Turn(direction)
        }
    }

    /// Origin of the kernel frame of the body that joint `j` of the tree moves, relative to that of its parent.
    pub(super) fn p_PK(&self, j: usize) -> Vector3<f64> {
        self.p_BK(j + 1) - self.p_BK(self.tree.joints[j].parent)
    }

    /// Axes of a body's kernel frame.
    pub(super) fn R_BK(&self, body: usize) -> Matrix3<f64> {
        Matrix3::from_columns(&self.joints.axes(body).map(|axis| axis.0.into()))
    }

    /// Origin of a body's kernel frame relative to the base's.
    pub(super) fn p_BK(&self, body: usize) -> Vector3<f64> {
        self.joints.p_BK(body).0.into()
    }

    /// Pose of a body in the base frame.
    pub(super) fn X_0B(&self, body: usize) -> Pose {
        self.X_0K(body) * self.tree.bodies[body].X_KB
    }

    fn X_0K(&self, body: usize) -> Pose {
        Pose::from_parts(
            Translation3::from(self.p_BK(body)),
            Rotation3::from_matrix_unchecked(self.R_BK(body)),
        )
    }

    /// Origin of `frame` relative to its body's kernel frame.
    pub(super) fn p_KF(&self, frame: &Frame) -> Vector3<f64> {
        checks::frame(frame, &self.model);
        self.R_BK(frame.body) * self.tree.p_KF(frame)
    }

    /// Pose of `frame` in the base frame.
    pub fn X_BF(&self, frame: &Frame) -> Pose {
        checks::frame(frame, &self.model);
        self.X_0K(frame.body) * (self.tree.bodies[frame.body].X_KB * frame.X_BF)
    }

    /// Twist of `frame`'s origin in the world, components in the base's axes
    /// (needs [`Workspace::set_motion`]).
    pub fn V_WF_B(&self, frame: &Frame) -> Twist {
        let p_KF = self.p_KF(frame);
        let Twist { angular, linear } = self.bodies[frame.body].twist;
        Twist::new(angular, linear + angular.cross(&p_KF))
    }

    /// Twist of the base frame in the world, components in the base's axes
    /// (needs [`Workspace::set_motion`]).
    pub fn V_WB_B(&self) -> &Twist {
        &self.bodies[0].twist
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ModelBuilder;
    use crate::spatial::RigidInertia;

    /// A universal joint whose cross has no mass: the formulations that accept it agree.
    #[test]
    fn bodies_without_mass_between_joints_move_as_the_mass_behind_them() {
        use crate::dynamics::{Evaluation, Formulation as _, FormulationKind, Input};
        use crate::model::JointKind;

        let heavy = |mass: f64, x: f64| RigidInertia {
            mass,
            com: Vector3::new(x, 0.1, -0.2),
            about_com: Matrix3::from_diagonal(&Vector3::new(1.0, 1.2, 1.5)) * (0.1 * mass),
        };
        let mut builder = ModelBuilder::new("universal", "base", heavy(20.0, 0.1));
        let (turn, at) = (JointKind::Continuous, Pose::translation(0.5, 0.0, 0.2));
        let cross = RigidInertia::zero();
        let cross = builder.body("cross", 0, turn, Vector3::z_axis(), at, cross);
        let origin = Pose::identity();
        builder.body(
            "arm",
            cross,
            turn,
            Vector3::y_axis(),
            origin,
            heavy(3.0, 0.4),
        );
        let model = builder.build();
        let mut state = State::at_rest_with(&model, &DVector::from_row_slice(&[0.4, -0.7]));
        state.qd = DVector::from_row_slice(&[0.8, 0.3]);
        state.momentum_W.angular = Vector3::new(0.3, -0.2, 0.5);
        let mut input = Input::zero(&model);
        input.efforts = DVector::from_row_slice(&[1.0, -2.0]);
        let of = |kind: FormulationKind| {
            let mut out = Evaluation::zero(&model);
            let mut dynamics = kind.prepare(&model).unwrap();
            dynamics.evaluate(&state, &mut Workspace::new(&model), &input, &mut out);
            out.acceleration.qdd
        };
        let expected = of(FormulationKind::Reduced);
        assert!(expected.iter().all(|x| x.is_finite()) && expected.norm() > 0.1);
        for kind in [FormulationKind::ArticulatedBody, FormulationKind::Kane] {
            assert!(
                (of(kind) - &expected).norm() < 1e-12 * expected.norm(),
                "{kind:?}"
            );
        }
        assert!(FormulationKind::NewtonEuler.prepare(&model).is_err());
    }

    #[test]
    fn a_single_body_has_its_centre_of_mass_from_the_start() {
        let com = Vector3::new(0.1, -0.2, 0.3);
        let about_com = Matrix3::identity();
        let inertia = RigidInertia {
            mass: 2.0,
            com,
            about_com,
        };
        let model = ModelBuilder::new("ball", "base", inertia).build();
        let mut workspace = Workspace::new(&model);
        assert_eq!(*workspace.p_BC(), com);
        workspace.set_positions(&DVector::zeros(0));
        assert_eq!(*workspace.p_BC(), com);
        assert!((workspace.H_B.to_matrix() - about_com).norm() < 1e-15);
    }
}
