//! Accelerations by the articulated-body algorithm, with modes and rotors eliminated body by body.
//!
//! A rotor with inertia J, axis a and spin Ω on a body with angular velocity w has `J (Ω' + a·w') = τ`. It acts on the
//! body with `-τ a - w × (J Ω a)`, and reduces the body's inertia, which includes the locked rotor, by `J a aᵀ`. Modes with
//! modal mass M and coupling P (n x 6) have `M μ'' + P A + bias = -K μ - C μ'`; eliminating them reduces the body's inertia
//! by `Pᵀ M⁻¹ P` (Kida 1993, chapter 2, eliminates the rigid body instead).

use nalgebra::Vector3;

use super::composite::Articulated;
use super::section::Section;
use super::workspace::{ModalNode, Node, quadratic};
use super::{
    FlexibleInput, FlexibleState, FlexibleSystem, FlexibleWorkspace, Losses, ModalBody,
    PartialWork, RotorModel,
};
use crate::dynamics::Evaluation;
use crate::spatial::{Twist, Wrench};

/// Result of the equations of motion at one state.
#[derive(Clone, Debug)]
pub(super) struct FlexibleEvaluation {
    /// Accelerations and power of the tree; its power includes wheels and thrusters.
    pub tree: Evaluation,
    /// Accelerations of modes, motors and wheels.
    pub xdd: Vec<f64>,
    /// Dissipated power, by cause \[W\].
    pub losses: Losses,
    /// Parts of the power in `tree` \[W\].
    pub partial_power: PartialWork,
    /// Torque between motor and link of each elastic joint.
    pub(super) link_efforts: Vec<f64>,
    /// Torque on each motor, on the output side, then on each wheel.
    pub(super) rotor_torques: Vec<f64>,
}

impl FlexibleEvaluation {
    pub fn zero(system: &FlexibleSystem) -> Self {
        let rotors = system.extras() - system.modes();
        Self {
            tree: Evaluation::zero(system.model()),
            xdd: vec![0.0; system.extras()],
            losses: Losses::default(),
            partial_power: PartialWork::default(),
            link_efforts: vec![0.0; system.elastic_joints().len()],
            rotor_torques: vec![0.0; rotors],
        }
    }

    /// Sets all power to zero.
    pub fn clear_power(&mut self) {
        self.losses = Losses::default();
        self.partial_power = PartialWork::default();
        self.tree.power = 0.0;
    }

    /// Sets the torques of elastic joints, motors and wheels, their power and their losses. For the limit of the
    /// wheels' speeds, their torques are assumed to act for `hold` \[s\] from `start_speeds` on.
    pub fn set_rotor_torques(
        &mut self,
        system: &FlexibleSystem,
        state: &FlexibleState,
        input: &FlexibleInput,
        (hold, start_speeds): (f64, &[f64]),
    ) {
        self.clear_power();
        let motors = system.elastic_joints().len();
        let (angles, rates) = (state.motor_angles(), state.motor_rates());
        for (e, (joint, j)) in (system.elastic_joints().iter())
            .zip(&system.compiled().joint_of)
            .enumerate()
        {
            let (wind_up, rate) = (angles[e] - state.tree.q[*j], rates[e] - state.tree.qd[*j]);
            let effort = input.tree.efforts[*j];
            self.link_efforts[e] = joint.stiffness * wind_up + joint.damping * rate;
            self.rotor_torques[e] = effort - self.link_efforts[e];
            self.losses.elastic_joints += joint.damping * rate * rate;
            self.tree.power += effort * rates[e];
        }
        for (i, (wheel, speed)) in (system.wheels().iter())
            .zip(state.wheel_speeds())
            .enumerate()
        {
            let torque = wheel.limited_torque(input.wheel_torques[i], start_speeds[i], hold);
            let friction = wheel.friction(*speed);
            self.rotor_torques[motors + i] = torque + friction;
            self.partial_power.wheel_motors += torque * speed;
            self.losses.wheel_friction -= friction * speed;
        }
        self.tree.power += self.partial_power.wheel_motors;
    }

    /// Sets the accelerations of the motors of reduced joints, which follow from torques alone.
    pub fn set_reduced_motors(&mut self, system: &FlexibleSystem) {
        for (e, joint) in system.elastic_joints().iter().enumerate() {
            if joint.rotor == RotorModel::Reduced {
                self.xdd[system.modes() + e] = self.rotor_torques[e] / joint.reflected_inertia();
            }
        }
    }

    /// Effort on joint `j` of actuator (or elastic joint), spring and damper. Adds the power of the efforts of the
    /// tree.
    pub(super) fn joint_effort(
        &mut self,
        system: &FlexibleSystem,
        state: &FlexibleState,
        input: &FlexibleInput,
        j: usize,
    ) -> f64 {
        let (q, qd) = (state.tree.q[j], state.tree.qd[j]);
        let passive = system.model().joints()[j].passive_effort(q, qd);
        self.tree.power += passive * qd;
        match system.compiled().elastic[j] {
            Some(e) => passive + self.link_efforts[e],
            None => {
                let effort = input.tree.efforts[j];
                self.tree.power += effort * qd;
                passive + effort
            }
        }
    }
}

impl FlexibleWorkspace {
    /// Evaluates the equations of motion at `state`; `limits` is that of [`FlexibleEvaluation::set_rotor_torques`].
    pub(super) fn evaluate(
        &mut self,
        state: &FlexibleState,
        input: &FlexibleInput,
        limits: (f64, &[f64]),
        out: &mut FlexibleEvaluation,
    ) {
        self.set_positions(state);
        self.set_base_twist(state);
        self.propagate_motion(state);
        out.set_rotor_torques(&self.system, state, input, limits);
        self.set_external(state, input);
        self.sweep_inward(state, input, out);
        self.sweep_outward(out);
        out.tree.w_WB_B = self.nodes[0].V.angular;
        out.tree.external = Some(Wrench {
            torque: self.external.torque - self.p_BC.cross(&self.external.force),
            force: self.external.force,
        });
        out.tree.power += self.external_power;
        out.partial_power.external = self.external_power;
        out.losses.modal_damping = 0.0;
        for body in self.system.modal_bodies() {
            let rates = &state.mu_dot()[body.range()];
            out.losses.modal_damping += quadratic(&body.appendage.modal_damping, rates);
        }
    }

    /// Sets the external wrenches (with thrusters) on each body, their sum and their power. A wrench on an elastic link
    /// acts on its section, to which frames of the link are fixed.
    pub(super) fn set_external(&mut self, state: &FlexibleState, input: &FlexibleInput) {
        (self.external, self.external_power) = (Wrench::ZERO, 0.0);
        self.nodes
            .iter_mut()
            .for_each(|n| n.external = Wrench::ZERO);
        (self.sections.iter_mut()).for_each(|s| s.external = Wrench::ZERO);
        let is_on = state.on_time.iter().any(|t| *t > 0.0);
        if !is_on && !input.has_wrench() {
            return;
        }
        self.set_poses();
        let compiled = self.system.compiled();
        for (b, wrench) in input.tree.wrenches.iter().enumerate() {
            match compiled.bodies[b].section {
                Some(s) => {
                    let section = &mut self.sections[s];
                    section.external = wrench.shifted(&-section.p_BE_straight);
                }
                None => self.nodes[b].external = *wrench,
            }
        }
        for ((body, p, force), on_time) in compiled.thrusters.iter().zip(&state.on_time) {
            if *on_time > 0.0 {
                let thrust = Wrench::new(Vector3::zeros(), *force);
                self.nodes[*body].external += thrust.shifted(p);
            }
        }
        for node in &self.nodes {
            self.external += node.external.shifted_to_parent(&node.X_0);
            self.external_power += node.V.dot(&node.external);
        }
        for section in &self.sections {
            let link = &self.nodes[self.system.modal_bodies()[section.modal_body].body];
            let X_0E = link.X_0 * section.X_BE;
            self.external += section.external.shifted_to_parent(&X_0E);
            self.external_power += section.twist(&link.V).dot(&section.external);
        }
    }

    fn sweep_inward(
        &mut self,
        state: &FlexibleState,
        input: &FlexibleInput,
        out: &mut FlexibleEvaluation,
    ) {
        let Self {
            system,
            nodes,
            modal,
            sections,
            ..
        } = self;
        let compiled = system.compiled();
        for node in nodes.iter_mut() {
            (node.inertia, node.force) = (Articulated::zero(), Wrench::ZERO);
        }
        for section in sections.iter_mut() {
            (section.inertia, section.force) = (Articulated::zero(), -section.external);
        }
        for b in (0..nodes.len()).rev() {
            let body = &compiled.bodies[b];
            let node = &mut nodes[b];
            let w = node.V.angular;
            node.inertia.add(&Articulated::of(&body.rigid));
            let turning = Twist::new(w, Vector3::zeros());
            node.force += turning.cross_force(&body.rigid.momentum(&turning)) - node.external;
            for i in &body.rotors {
                let rotor = &compiled.rotors[*i];
                let torque = out.rotor_torques[rotor.coordinate] / rotor.ratio;
                node.inertia.J -= rotor.axis * rotor.axis.transpose() * rotor.inertia;
                node.force.torque += w.cross(&rotor.momentum(state)) + rotor.axis * torque;
            }
            for i in &body.modal_bodies {
                let section = body.section.map(|s| &sections[s]);
                let of_system = &system.modal_bodies()[*i];
                eliminate_modes(node, &mut modal[*i], section, of_system, state);
            }
            if b == 0 {
                break;
            }
            let effort = out.joint_effort(system, state, input, b - 1);
            let along = body.joint_twist(1.0);
            node.U = node.inertia.times(&along);
            node.d_inverse = 1.0 / body.along_axis(&node.U);
            node.free = (effort - body.along_axis(&node.force)) * node.d_inverse;
            let mut inertia = node.inertia;
            inertia.subtract(&node.U, &(node.U * node.d_inverse));
            let force = node.force + inertia.times(&node.bias) + node.U * node.free;
            let inertia = inertia.in_parent(&node.X);
            let force = force.shifted_to_parent(&node.X);
            let (into, into_force) = match compiled.carrier(b) {
                Some(s) => {
                    let section = &mut sections[s];
                    (&mut section.inertia, &mut section.force)
                }
                None => {
                    let parent = &mut nodes[body.parent];
                    (&mut parent.inertia, &mut parent.force)
                }
            };
            into.add(&inertia);
            *into_force += force;
        }
    }

    fn sweep_outward(&mut self, out: &mut FlexibleEvaluation) {
        let Self {
            system,
            nodes,
            modal,
            sections,
            ..
        } = self;
        let compiled = system.compiled();
        nodes[0].A = nodes[0].inertia.free_acceleration(&nodes[0].force);
        out.tree.acceleration.A_WB_B = nodes[0].A;
        for b in 0..nodes.len() {
            let body = &compiled.bodies[b];
            if b > 0 {
                let parent = nodes[body.parent].A;
                let A = match compiled.carrier(b) {
                    Some(s) => {
                        let section = &sections[s];
                        section.acceleration(&parent, &modal[section.modal_body].free)
                    }
                    None => parent,
                };
                let node = &mut nodes[b];
                let mut A = A.shifted_to_child(&node.X) + node.bias;
                let qdd = node.free - A.dot(&node.U) * node.d_inverse;
                A += body.joint_twist(qdd);
                node.A = A;
                out.tree.acceleration.qdd[b - 1] = qdd;
            }
            let A = nodes[b].A;
            for i in &body.modal_bodies {
                let range = system.modal_bodies()[*i].range();
                let ModalNode { free, solved, .. } = &mut modal[*i];
                for ((rate, solved), into) in
                    (free.iter_mut().zip(&*solved)).zip(&mut out.xdd[range])
                {
                    *rate -= A.dot(solved);
                    *into = *rate;
                }
            }
        }
        out.set_reduced_motors(system);
        for rotor in &compiled.rotors {
            let along = rotor.axis.dot(&nodes[rotor.body].A.angular);
            let torque = out.rotor_torques[rotor.coordinate];
            let acceleration = torque / (rotor.inertia * rotor.ratio) - along;
            out.xdd[system.modes() + rotor.coordinate] = acceleration / rotor.ratio;
        }
    }
}

/// Adds a deformable body, with its modes eliminated, and the bodies that its section carries to the body that it is
/// clamped to.
fn eliminate_modes(
    node: &mut Node,
    modal: &mut ModalNode,
    section: Option<&Section>,
    body: &ModalBody,
    state: &FlexibleState,
) {
    let n = body.modes();
    let (mu, mu_dot) = (&state.mu()[body.range()], &state.mu_dot()[body.range()]);
    let ModalNode {
        shape,
        factor,
        coupling,
        solved,
        free,
    } = modal;
    shape.set_bias(body, mu, mu_dot, &node.V.angular);
    node.inertia.add(&Articulated::of(&shape.locked));
    node.force += shape.bias;
    coupling.copy_from_slice(&shape.coupling);
    let (K, C) = (
        &body.appendage.modal_stiffness,
        &body.appendage.modal_damping,
    );
    for k in 0..n {
        let mut force = -shape.bias_modes[k];
        for l in 0..n {
            force -= K[(k, l)] * mu[l] + C[(k, l)] * mu_dot[l];
            if l <= k {
                factor[k * n + l] = shape.mass[(k, l)];
            }
        }
        free[k] = force;
    }
    if let Some(section) = section {
        let carried = section.force + section.inertia.times(&section.bias);
        for k in 0..n {
            let column = &section.columns[k];
            let moving = section.inertia.times(column);
            coupling[k] += moving.shifted_to_parent(&section.X_BE);
            free[k] -= column.dot(&carried);
            for l in 0..=k {
                factor[k * n + l] += section.columns[l].dot(&moving);
            }
        }
        node.inertia.add(&section.inertia.in_parent(&section.X_BE));
        node.force += carried.shifted_to_parent(&section.X_BE);
    }
    solved.copy_from_slice(coupling);
    factorize(factor, n);
    solve(factor, n, free, |x, l| *x *= l, |x, y, l| *x -= y * l);
    solve(
        factor,
        n,
        solved,
        |x, l| *x = *x * l,
        |x, y, l| *x -= *y * l,
    );
    for k in 0..n {
        node.inertia.subtract(&coupling[k], &solved[k]);
        node.force += coupling[k] * free[k];
    }
}

/// Cholesky factor in place: the lower triangle by rows, with inverses on the diagonal. NaN if the matrix is not
/// positive definite.
fn factorize(m: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..=i {
            let mut sum = m[i * n + j];
            for k in 0..j {
                sum -= m[i * n + k] * m[j * n + k];
            }
            m[i * n + j] = if i == j {
                1.0 / sum.sqrt()
            } else {
                sum * m[j * n + j]
            };
        }
    }
}

/// Solves with the factor in place, for right-hand sides of any type.
fn solve<T: Copy>(
    factor: &[f64],
    n: usize,
    x: &mut [T],
    scale: impl Fn(&mut T, f64),
    subtract: impl Fn(&mut T, &T, f64),
) {
    for i in 0..n {
        for j in 0..i {
            let known = x[j];
            subtract(&mut x[i], &known, factor[i * n + j]);
        }
        scale(&mut x[i], factor[i * n + i]);
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            let known = x[j];
            subtract(&mut x[i], &known, factor[j * n + i]);
        }
        scale(&mut x[i], factor[i * n + i]);
    }
}
