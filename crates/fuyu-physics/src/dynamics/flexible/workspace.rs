//! Scratch memory of a robot with flexible parts, and what can be read from it at one state.

use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

use super::composite::{Articulated, Composite, wrench_in_parent};
use super::modal_body::ModalShape;
use super::section::Section;
use super::{FlexibleState, FlexibleSystem};
use crate::dynamics::Momentum;
use crate::model::Frame;
use crate::spatial::{Pose, Twist, Wrench};

/// Kinematics and dynamics terms of one [`FlexibleSystem`], in preallocated memory. Fill it with [`FlexibleWorkspace::set_state`], then
/// read. Components are in base axes unless a name says otherwise.
#[derive(Clone, Debug)]
pub struct FlexibleWorkspace {
    pub(super) system: FlexibleSystem,
    pub(super) nodes: Vec<Node>,
    pub(super) modal: Vec<ModalNode>,
    pub(super) p_BC: Vector3<f64>,
    /// The whole system locked, about the base frame's origin, and its momentum while the base is at rest.
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
    pub R: Matrix3<f64>,
    pub p: Vector3<f64>,
    /// Pose in the base frame.
    pub R_0: Matrix3<f64>,
    pub p_0: Vector3<f64>,
    pub composite: Composite,
    pub momentum: Wrench,
    /// Twist, inertial.
    pub V: Twist,
    /// Acceleration while the carrying frame and the joint do not accelerate.
    pub bias: Twist,
    pub inertia: Articulated,
    pub force: Wrench,
    /// What an acceleration of the joint takes, and its inverse along the axis.
    pub U: Wrench,
    pub d_inverse: f64,
    /// Acceleration of the joint if nothing else accelerates.
    pub free: f64,
    /// Acceleration; the linear part is that of the origin as a point.
    pub A: Twist,
    /// External wrench, about the origin.
    pub external: Wrench,
}

/// Terms of a deformable body.
#[derive(Clone, Debug)]
pub(super) struct ModalNode {
    pub shape: ModalShape,
    pub section: Option<Box<Section>>,
    /// Cholesky factor of the modal mass, with what the section carries, in its lower triangle by rows.
    pub factor: Vec<f64>,
    /// For each mode: coupling to B, and its solution with the factor.
    pub coupling: Vec<Wrench>,
    pub solved: Vec<Wrench>,
    /// Modal accelerations while B does not accelerate, then their final values.
    pub free: Vec<f64>,
}

impl FlexibleWorkspace {
    /// A workspace for `system`. Allocates; no other method does.
    pub fn new(system: &FlexibleSystem) -> Self {
        let node = Node {
            R: Matrix3::identity(),
            p: Vector3::zeros(),
            R_0: Matrix3::identity(),
            p_0: Vector3::zeros(),
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
                section: body.section.map(|_| Box::new(Section::new(body))),
                factor: vec![0.0; n * n],
                coupling: vec![Wrench::ZERO; n],
                solved: vec![Wrench::ZERO; n],
                free: vec![0.0; n],
            }
        });
        Self {
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
        let node = &self.nodes[frame.body];
        let p_0 = Translation3::from(node.p_0);
        let R_0 = Rotation3::from_matrix_unchecked(node.R_0);
        let X_0B = Pose::from_parts(p_0, R_0);
        match self.carrying_section(frame.body) {
            None => X_0B * frame.X_BF,
            Some((section, p_BE0)) => {
                let R_BE = Rotation3::from_matrix_unchecked(section.R_BE);
                let X_BE = Pose::from_parts(Translation3::from(section.p_BE), R_BE);
                X_0B * X_BE * Translation3::from(-p_BE0) * frame.X_BF
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
            None => (node.V, node.R_0, p),
            Some((section, p_BE0)) => (section.twist(&node.V), node.R_0 * section.R_BE, p - p_BE0),
        };
        Twist {
            angular: R * V.angular,
            linear: R * (V.linear + V.angular.cross(&p)),
        }
    }

    /// The section that carries frames of body `b`, and its undeformed position, if the body is an elastic link.
    fn carrying_section(&self, b: usize) -> Option<(&Section, Vector3<f64>)> {
        let link = self.system.compiled().bodies[b].link?;
        let body = &self.system.modal_bodies()[link];
        let section = self.modal[link].section.as_deref()?;
        Some((section, body.in_body.outputs[body.section?].position))
    }

    /// Displacement of output point `output` of deformable body `i` in axes of its attachment frame \[m\].
    ///
    /// # Panics
    /// If there is no such point.
    pub fn deflection(&self, state: &FlexibleState, i: usize, output: usize) -> Vector3<f64> {
        let body = &self.system.modal_bodies()[i];
        body.appendage.outputs[output].displacement(&state.mu()[body.range()])
    }

    /// Angular momentum that the wheels and the motors of elastic joints have relative to their bodies \[N m s\], base axes.
    pub fn rotor_momentum(&self, state: &FlexibleState) -> Vector3<f64> {
        let rotors = self.system.compiled().rotors.iter();
        rotors
            .map(|rotor| {
                self.nodes[rotor.body].R_0
                    * rotor.axis
                    * (rotor.inertia * self.rotor_speed(state, rotor))
            })
            .sum()
    }

    /// Angular momentum of the wheels relative to their bodies \[N m s\], base axes.
    pub fn wheel_momentum(&self, state: &FlexibleState) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for (i, (wheel, speed)) in (self.system.wheels().iter())
            .zip(state.wheel_speeds())
            .enumerate()
        {
            let (body, axis) = self.system.wheel_axis(i);
            sum += self.nodes[body].R_0 * *axis * (wheel.inertia * speed);
        }
        sum
    }

    /// Momentum (base axes, angular about the system's centre of mass) summed over bodies, deformable bodies and rotors from their
    /// twists. It does not use the sums from which the base's twist follows, so comparing it with that of the state is a check.
    pub fn carried_momentum(&self, state: &FlexibleState) -> Momentum {
        let compiled = self.system.compiled();
        let mut sum = Wrench::ZERO;
        for (node, body) in self.nodes.iter().zip(&compiled.bodies) {
            let rigid = Composite {
                mass: body.mass,
                S: body.S,
                J: body.J,
            };
            let mut own = rigid.momentum(&node.V);
            for i in &body.modal_bodies {
                let shape = &self.modal[*i].shape;
                let rigid = Composite {
                    mass: self.system.modal_bodies()[*i].integrals.mass,
                    S: shape.S,
                    J: shape.J,
                };
                own += rigid.momentum(&node.V);
                own.force += shape.S_dot;
                own.torque += shape.h;
            }
            for i in &body.rotors {
                let rotor = &compiled.rotors[*i];
                own.torque += rotor.axis * (rotor.inertia * self.rotor_speed(state, rotor));
            }
            sum += wrench_in_parent(&own, &node.R_0, &node.p_0);
        }
        Momentum {
            linear: sum.force,
            angular: sum.torque - self.p_BC.cross(&sum.force),
        }
    }

    /// Kinetic energy \[J\], summed over bodies, deformable bodies and rotors.
    pub fn kinetic_energy(&self, state: &FlexibleState) -> f64 {
        let compiled = self.system.compiled();
        let mut twice = 0.0;
        for (node, body) in self.nodes.iter().zip(&compiled.bodies) {
            let rigid = Composite {
                mass: body.mass,
                S: body.S,
                J: body.J,
            };
            twice += node.V.dot(&rigid.momentum(&node.V));
            for i in &body.modal_bodies {
                let modal = &self.system.modal_bodies()[*i];
                let shape = &self.modal[*i].shape;
                let rigid = Composite {
                    mass: modal.integrals.mass,
                    S: shape.S,
                    J: shape.J,
                };
                twice += node.V.dot(&rigid.momentum(&node.V));
                twice += 2.0 * (node.V.linear.dot(&shape.S_dot) + node.V.angular.dot(&shape.h));
                let rates = &state.mu_dot()[modal.range()];
                twice += quadratic(&shape.mass, rates);
            }
            for i in &body.rotors {
                let rotor = &compiled.rotors[*i];
                let speed = self.rotor_speed(state, rotor);
                let common = 2.0 * rotor.axis.dot(&node.V.angular) + speed;
                twice += rotor.inertia * speed * common;
            }
        }
        // The rotor of a reduced joint turns as if its link did not.
        let n = self.system.modes();
        for (e, joint) in self.system.elastic_joints().iter().enumerate() {
            if joint.rotor == super::RotorModel::Reduced {
                twice += joint.reflected_inertia() * state.xd[n + e] * state.xd[n + e];
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

    /// Spin of a rotor relative to its body \[rad/s\].
    pub(super) fn rotor_speed(&self, state: &FlexibleState, rotor: &super::system::Rotor) -> f64 {
        state.xd[self.system.modes() + rotor.coordinate] * rotor.ratio
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
