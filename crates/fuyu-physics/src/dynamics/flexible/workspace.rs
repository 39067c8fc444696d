//! Scratch memory of a robot with flexible parts, and the quantities computed at one state.

use nalgebra::{Translation3, Vector3};

use super::composite::{Articulated, Composite};
use super::modal_body::ModalShape;
use super::section::Section;
use super::system::Rotor;
use super::{FlexibleState, FlexibleSystem, RotorModel};
use crate::dynamics::Momentum;
use crate::model::Frame;
use crate::spatial::{Pose, Twist, Wrench};

/// Kinematics and dynamics terms of one [`FlexibleSystem`], in preallocated memory. Fill it with
/// [`FlexibleWorkspace::set_state`], then read. Components are in base axes unless a name says otherwise.
#[derive(Clone, Debug)]
pub struct FlexibleWorkspace {
    pub(super) system: FlexibleSystem,
    pub(super) nodes: Vec<Node>,
    pub(super) modal: Vec<ModalNode>,
    /// Sections of the elastic links.
    pub(super) sections: Vec<Section>,
    pub(super) p_BC: Vector3<f64>,
    /// Composite inertia of the whole locked system about the base frame's origin, and its momentum with the base at
    /// rest.
    pub(super) whole: Composite,
    pub(super) at_rest: Wrench,
    /// External wrench on the whole system about the base frame's origin, and its power \[W\].
    pub(super) external: Wrench,
    pub(super) external_power: f64,
}

/// Terms of a body, in its frame B.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Pose of B in the frame that carries it: the parent's, or the section of an elastic link.
    pub X: Pose,
    /// Pose of B in the base frame.
    pub X_0: Pose,
    pub composite: Composite,
    pub momentum: Wrench,
    /// Inertial twist of B.
    pub V: Twist,
    /// Acceleration while the carrying frame and the joint do not accelerate.
    pub bias: Twist,
    pub inertia: Articulated,
    pub force: Wrench,
    /// Wrench per unit of joint acceleration (`U` in Featherstone's notation), and the inverse of its component along
    /// the axis.
    pub U: Wrench,
    pub d_inverse: f64,
    /// Joint acceleration if nothing else accelerates.
    pub free: f64,
    /// Acceleration of B; the linear part is that of the origin as a point.
    pub A: Twist,
    /// External wrench about B's origin.
    pub external: Wrench,
}

/// Terms of a deformable body.
#[derive(Clone, Debug)]
pub(super) struct ModalNode {
    pub shape: ModalShape,
    /// Cholesky factor of the modal mass, including the bodies that the section carries, in its lower triangle by rows.
    pub factor: Vec<f64>,
    /// For each mode: coupling to B, and its solution with the Cholesky factor.
    pub coupling: Vec<Wrench>,
    pub solved: Vec<Wrench>,
    /// Modal accelerations while B does not accelerate, then their final values.
    pub free: Vec<f64>,
}

impl FlexibleWorkspace {
    /// A workspace for `system`. Allocates; no other method does.
    pub fn new(system: &FlexibleSystem) -> Self {
        let node = Node {
            X: Pose::identity(),
            X_0: Pose::identity(),
            composite: Composite::zero(),
            momentum: Wrench::ZERO,
            V: Twist::ZERO,
            bias: Twist::ZERO,
            inertia: Articulated::zero(),
            force: Wrench::ZERO,
            U: Wrench::ZERO,
            d_inverse: 0.0,
            free: 0.0,
            A: Twist::ZERO,
            external: Wrench::ZERO,
        };
        let modal = system.modal_bodies().iter().map(|body| {
            let n = body.modes();
            ModalNode {
                shape: ModalShape::new(body),
                factor: vec![0.0; n * n],
                coupling: vec![Wrench::ZERO; n],
                solved: vec![Wrench::ZERO; n],
                free: vec![0.0; n],
            }
        });
        let bodies = system.modal_bodies().iter().enumerate();
        let sections = bodies.filter_map(|(i, b)| b.section.map(|at| Section::new(i, b, at)));
        Self {
            sections: sections.collect(),
            nodes: vec![node; system.compiled().bodies.len()],
            modal: modal.collect(),
            system: system.clone(),
            p_BC: Vector3::zeros(),
            whole: Composite::zero(),
            at_rest: Wrench::ZERO,
            external: Wrench::ZERO,
            external_power: 0.0,
        }
    }

    /// The robot.
    pub fn system(&self) -> &FlexibleSystem {
        &self.system
    }

    /// Computes poses, shapes and the twists of all bodies at `state`.
    ///
    /// # Panics
    /// If the state is of another system.
    pub fn set_state(&mut self, state: &FlexibleState) {
        self.set_positions(state);
        self.set_base_twist(state);
        self.propagate_motion(state);
        self.set_poses();
    }

    /// The system's centre of mass in the base frame \[m\].
    pub fn p_BC(&self) -> &Vector3<f64> {
        &self.p_BC
    }

    /// Pose of the base frame in the world, at the state of the last [`FlexibleWorkspace::set_state`].
    pub fn X_WB(&self, state: &FlexibleState) -> Pose {
        let R_WB = state.tree.R_WB.to_rotation_matrix();
        let p = state.tree.p_WC - R_WB * self.p_BC;
        Pose::from_parts(Translation3::from(p), R_WB)
    }

    /// Twist of the base frame in the world, base axes.
    pub fn V_WB_B(&self) -> &Twist {
        &self.nodes[0].V
    }

    /// Pose of `frame` in the base frame. A frame on an elastic link moves with the section that carries the next link.
    ///
    /// # Panics
    /// If the robot has no such frame.
    pub fn X_BF(&self, frame: &Frame) -> Pose {
        let X_0B = self.nodes[frame.body].X_0;
        match self.carrying_section(frame.body) {
            None => X_0B * frame.X_BF,
            Some(section) => {
                X_0B * section.X_BE * Translation3::from(-section.p_BE_straight) * frame.X_BF
            }
        }
    }

    /// Twist of `frame`'s origin in the world, base axes.
    ///
    /// # Panics
    /// If the robot has no such frame.
    pub fn V_WF_B(&self, frame: &Frame) -> Twist {
        let node = &self.nodes[frame.body];
        let p = frame.X_BF.translation.vector;
        let (V, R, p) = match self.carrying_section(frame.body) {
            None => (node.V, node.X_0.rotation, p),
            Some(section) => (
                section.twist(&node.V),
                node.X_0.rotation * section.X_BE.rotation,
                p - section.p_BE_straight,
            ),
        };
        Twist {
            angular: R * V.angular,
            linear: R * (V.linear + V.angular.cross(&p)),
        }
    }

    /// Acceleration of `frame`'s origin as a point, and angular acceleration, in the world, base axes (needs
    /// [`FlexibleIntegrator::set_accelerations`](super::FlexibleIntegrator::set_accelerations)).
    ///
    /// # Panics
    /// If the robot has no such frame.
    pub fn A_WF_B(&self, frame: &Frame) -> Twist {
        let node = &self.nodes[frame.body];
        let p = frame.X_BF.translation.vector;
        let (A, w, R, p) = match self.carrying_section(frame.body) {
            None => (node.A, node.V.angular, node.X_0.rotation, p),
            Some(section) => (
                section.acceleration(&node.A, &self.modal[section.modal_body].free),
                section.twist(&node.V).angular,
                node.X_0.rotation * section.X_BE.rotation,
                p - section.p_BE_straight,
            ),
        };
        Twist {
            angular: R * A.angular,
            linear: R * (A.linear + A.angular.cross(&p) + w.cross(&w.cross(&p))),
        }
    }

    /// The section to which frames of body `b` are fixed, if the body is an elastic link.
    fn carrying_section(&self, b: usize) -> Option<&Section> {
        (self.system.compiled().bodies[b].section).map(|s| &self.sections[s])
    }

    /// Displacement of output point `output` of deformable body `i` in axes of its attachment frame \[m\].
    ///
    /// # Panics
    /// If there is no such point.
    pub fn deflection(&self, state: &FlexibleState, i: usize, output: usize) -> Vector3<f64> {
        let body = &self.system.modal_bodies()[i];
        body.appendage.outputs[output].displacement(&state.mu()[body.range()])
    }

    /// Angular momentum that the wheels and the motors of elastic joints have relative to their bodies \[N m s\], base
    /// axes.
    pub fn rotor_momentum(&self, state: &FlexibleState) -> Vector3<f64> {
        self.momentum_of(&self.system.compiled().rotors, state)
    }

    /// Angular momentum of the wheels relative to their bodies \[N m s\], base axes.
    pub fn wheel_momentum(&self, state: &FlexibleState) -> Vector3<f64> {
        self.momentum_of(self.system.wheel_rotors(), state)
    }

    fn momentum_of(&self, rotors: &[Rotor], state: &FlexibleState) -> Vector3<f64> {
        let momenta = rotors
            .iter()
            .map(|rotor| self.nodes[rotor.body].X_0.rotation * rotor.momentum(state));
        momenta.sum()
    }

    /// Momentum (base axes, angular about the system's centre of mass) summed over bodies, deformable bodies and rotors
    /// from their twists. The sum is independent of the one that gives the base's twist, so comparison with the state's
    /// momentum is a check.
    pub fn carried_momentum(&self, state: &FlexibleState) -> Momentum {
        let mut sum = Wrench::ZERO;
        for (b, node) in self.nodes.iter().enumerate() {
            sum += self.own_momentum(b, state).shifted_to_parent(&node.X_0);
        }
        self.about_com(&sum)
    }

    /// Sums of the magnitudes of the momenta of rigid bodies, deformable bodies and rotors (linear \[N s\], angular
    /// about the system's centre of mass \[N m s\]): the scale for rounding errors of the momentum.
    pub fn momentum_scale(&self, state: &FlexibleState) -> (f64, f64) {
        let compiled = self.system.compiled();
        let mut sum = (0.0, 0.0);
        for (node, body) in self.nodes.iter().zip(&compiled.bodies) {
            let mut add = |part: Wrench| {
                let part = self.about_com(&part.shifted_to_parent(&node.X_0));
                sum.0 += part.linear.norm();
                sum.1 += part.angular.norm();
            };
            add(body.rigid.momentum(&node.V));
            for i in &body.modal_bodies {
                add(self.modal[*i].shape.momentum(&node.V));
            }
            for i in &body.rotors {
                let momentum = compiled.rotors[*i].momentum(state);
                add(Wrench::new(momentum, Vector3::zeros()));
            }
        }
        sum
    }

    /// Converts a momentum about the base frame's origin to one about the system's centre of mass.
    fn about_com(&self, sum: &Wrench) -> Momentum {
        Momentum {
            linear: sum.force,
            angular: sum.torque - self.p_BC.cross(&sum.force),
        }
    }

    /// Momentum of body `b`, with its deformable bodies and rotors, in its frame.
    pub(super) fn own_momentum(&self, b: usize, state: &FlexibleState) -> Wrench {
        let (compiled, V) = (self.system.compiled(), &self.nodes[b].V);
        let body = &compiled.bodies[b];
        let mut own = body.rigid.momentum(V);
        for i in &body.modal_bodies {
            own += self.modal[*i].shape.momentum(V);
        }
        for i in &body.rotors {
            own.torque += compiled.rotors[*i].momentum(state);
        }
        own
    }

    /// Kinetic energy \[J\], summed over bodies, deformable bodies and rotors.
    pub fn kinetic_energy(&self, state: &FlexibleState) -> f64 {
        let compiled = self.system.compiled();
        let mut twice = 0.0;
        for (node, body) in self.nodes.iter().zip(&compiled.bodies) {
            let V = &node.V;
            twice += V.dot(&body.rigid.momentum(V));
            for i in &body.modal_bodies {
                let shape = &self.modal[*i].shape;
                let rates = &state.mu_dot()[self.system.modal_bodies()[*i].range()];
                twice += V.dot(&(shape.momentum(V) + shape.momentum));
                twice += quadratic(&shape.mass, rates);
            }
            for i in &body.rotors {
                let rotor = &compiled.rotors[*i];
                let spin = rotor.spin(state);
                twice += rotor.inertia * spin * (2.0 * rotor.axis.dot(&V.angular) + spin);
            }
        }
        // The rotor of a reduced joint moves as if its link were at rest.
        for (joint, rate) in (self.system.elastic_joints().iter()).zip(state.motor_rates()) {
            if joint.rotor == RotorModel::Reduced {
                twice += joint.reflected_inertia() * rate * rate;
            }
        }
        0.5 * twice
    }

    /// Strain energy of deformable bodies and elastic joints \[J\].
    pub fn strain_energy(&self, state: &FlexibleState) -> f64 {
        let mut twice = 0.0;
        for body in self.system.modal_bodies() {
            twice += quadratic(&body.appendage.modal_stiffness, &state.mu()[body.range()]);
        }
        let joint_of = &self.system.compiled().joint_of;
        let motors = self.system.elastic_joints().iter().zip(joint_of);
        for ((joint, j), angle) in motors.zip(state.motor_angles()) {
            let twist = angle - state.tree.q[*j];
            twice += joint.stiffness * twist * twist;
        }
        0.5 * twice
    }
}

/// `xᵀ m x`.
pub(super) fn quadratic(m: &nalgebra::DMatrix<f64>, x: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (l, column) in m.column_iter().enumerate() {
        for (k, entry) in column.iter().enumerate() {
            sum += entry * x[k] * x[l];
        }
    }
    sum
}
