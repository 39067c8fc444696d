//! The matrix method for a free-floating tree.

use nalgebra::{Rotation3, Translation3, Unit, Vector3};

use super::gear::Gear;
use super::{
    Axis, BodyState, Freedom, Hinge, INERTIAL, Load, MatrixMethod, System, SystemBuilder,
    SystemError,
};
use crate::dynamics::expanded_motion::ExpandedMotion;
use crate::dynamics::{Formulation, Input, TreeAcceleration, TreeMotion, checks};
use crate::model::{JointKind, Model};
use crate::spatial::{Pose, Twist};

impl System {
    /// The bodies and joints of `model`, including springs and dampers, with its base joined to inertial space by a
    /// free hinge. Hinge 0 is the base's; hinge `j + 1` is joint `j` of the tree, which moves along or about the
    /// hinge's z axis. Mimic joints are additional constraints.
    ///
    /// # Errors
    /// [`SystemError`] if the matrix method does not support the model, for example because of a body without mass.
    /// Moments of inertia may violate the triangle inequality.
    pub fn from_model(model: &Model) -> Result<Self, SystemError> {
        compile(model, true)
    }
}

fn compile(model: &Model, passive: bool) -> Result<System, SystemError> {
    let mut system = builder(model, passive).build()?;
    system.gears = Gear::of(model, |k| freedom_and_axis(model.tree_joint(k).kind).1);
    Ok(system)
}

fn builder(model: &Model, passive: bool) -> SystemBuilder {
    let mut system = SystemBuilder::new();
    system.allow_any_moments = true;
    for body in model.bodies() {
        system.body(&body.name, body.inertia);
    }
    let base = &model.bodies()[0].name;
    // No joint has this name or an empty one: names of URDF joints contain no slashes.
    system.hinge(Hinge::new("inertial/base", INERTIAL, base, Freedom::FREE));
    for (j, joint) in model.tree_joints().enumerate() {
        let (parent, body) = (model.tree_parent(j), &model.bodies()[j + 1]);
        let along_z = Pose::from_parts(Translation3::identity(), rotation_to(&joint.axis));
        let (freedom, axis) = freedom_and_axis(joint.kind);
        let mut hinge = Hinge::new(
            &joint.name,
            &model.bodies()[parent].name,
            &body.name,
            freedom,
        )
        .at(joint.X_PJ * along_z, along_z);
        if passive {
            let spring = &joint.spring;
            hinge = (hinge.spring(axis, spring.stiffness, spring.rest)).damper(axis, joint.damping);
        }
        system.hinge(hinge);
    }
    system
}

fn freedom_and_axis(kind: JointKind) -> (Freedom, Axis) {
    if kind.is_rotational() {
        (Freedom::REVOLUTE, Axis::RotationZ)
    } else {
        (Freedom::PRISMATIC, Axis::TranslationZ)
    }
}

/// A rotation from z to `axis`.
fn rotation_to(axis: &Unit<Vector3<f64>>) -> Rotation3<f64> {
    let half_turn = || Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    Rotation3::rotation_between(&Vector3::z(), axis).unwrap_or_else(half_turn)
}

/// Forward dynamics of a tree by the matrix method, with the accelerations of all bodies and all hinge forces as unknowns. It
/// shares neither kinematics nor equations with the reduced form. Costs O(n³).
#[derive(Debug, Clone)]
pub struct NewtonEuler {
    model: Model,
    system: System,
    method: MatrixMethod,
    load: Load,
    state: Vec<f64>,
    placed: Vec<(Pose, Twist)>,
    expanded: ExpandedMotion,
}

impl NewtonEuler {
    /// Scratch for `model`.
    ///
    /// # Errors
    /// [`SystemError`] as [`System::from_model`].
    pub fn new(model: &Model) -> Result<Self, SystemError> {
        let system = compile(model, false)?;
        Ok(Self {
            expanded: ExpandedMotion::new(model),
            model: model.clone(),
            method: MatrixMethod::new(&system),
            load: Load::zero(&system),
            state: vec![0.0; system.state_len()],
            placed: vec![(Pose::identity(), Twist::ZERO); system.bodies.len()],
            system,
        })
    }

    /// The system of the model; hinge `j + 1` is joint `j` of the tree. Springs and dampers act as efforts.
    pub fn system(&self) -> &System {
        &self.system
    }

    /// The last solution, for forces in the hinges.
    pub fn method(&self) -> &MatrixMethod {
        &self.method
    }

    /// Sets poses and twists from the base outward, with the base frame at the world's origin and along its axes; then
    /// the 13 numbers of each body.
    fn set_state(&mut self, motion: &TreeMotion) {
        let model = &self.model;
        let TreeMotion { q, qd, .. } = self.expanded.of(model, motion);
        self.placed[0] = (Pose::identity(), motion.V_WB_B);
        for (j, joint) in model.tree_joints().enumerate() {
            let (X_WP, V_P) = self.placed[model.tree_parent(j)];
            let (q, qd) = (q[j], qd[j]);
            let moved = if joint.kind.is_rotational() {
                let rotation = Rotation3::from_axis_angle(&joint.axis, q);
                Pose::from_parts(Translation3::identity(), rotation)
            } else {
                Pose::from_parts(joint.axis.scale(q).into(), Rotation3::identity())
            };
            let X_WB = X_WP * joint.X_PJ * moved;
            let axis_W = X_WB.rotation * joint.axis.into_inner();
            let arm = X_WB.translation.vector - X_WP.translation.vector;
            let mut V = Twist::new(V_P.angular, V_P.linear + V_P.angular.cross(&arm));
            if joint.kind.is_rotational() {
                V.angular += axis_W * qd;
            } else {
                V.linear += axis_W * qd;
            }
            self.placed[j + 1] = (X_WB, V);
        }
        for (b, ((X_WB, V), body)) in self.placed.iter().zip(model.bodies()).enumerate() {
            let R = &X_WB.rotation;
            let com = R * body.inertia.com;
            let at = BodyState {
                p_WC: X_WB.translation.vector + com,
                Q_WB: nalgebra::UnitQuaternion::from(*R).into_inner(),
                v_WC_B: R.inverse() * (V.linear + V.angular.cross(&com)),
                w_WB_B: R.inverse() * V.angular,
            };
            at.write(&mut self.state, b);
        }
    }
}

impl Formulation for NewtonEuler {
    fn accelerations(&mut self, motion: &TreeMotion, input: &Input, out: &mut TreeAcceleration) {
        checks::formulation(motion, input, out, &self.model);
        self.set_state(motion);
        let model = &self.model;
        let loads = self.load.wrenches.iter_mut().zip(&input.wrenches);
        for ((wrench, given), body) in loads.zip(model.bodies()) {
            *wrench = given.shifted(&-body.inertia.com);
        }
        for (j, joint) in model.joints().iter().enumerate() {
            let (_, axis) = freedom_and_axis(joint.kind);
            let passive = joint.passive_effort(motion.q[j], motion.qd[j]);
            self.load.efforts[model.joint_body(j)][axis.index()] = input.efforts[j] + passive;
        }
        self.method.solve(&self.system, &self.state, &self.load);
        for (j, joint) in model.joints().iter().enumerate() {
            let (_, axis) = freedom_and_axis(joint.kind);
            let hinge = model.joint_body(j);
            out.qdd[j] = self.method.hinge_acceleration(&self.system, hinge)[axis.index()];
        }
        let (com, w) = (&model.bodies()[0].inertia.com, &motion.V_WB_B.angular);
        let base = self.method.acceleration(0);
        out.A_WB_B = Twist::new(
            base.angular,
            base.linear - base.angular.cross(com) - w.cross(&w.cross(com)),
        );
    }
}
