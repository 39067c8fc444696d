//! Exponential collocation: the motion between two events of the joints.

use nalgebra::{DMatrix, DVector, Vector3};

use super::joint_contacts::JointContacts;
use super::modes::Modes;
use super::phi::phi;
use crate::dynamics::integrator::EquationsOfMotion;
use crate::dynamics::rate::{turn, turn_rate};
use crate::dynamics::{Dissipated, Forcing, Input, State, Workspace};
use crate::model::Model;

/// Nodes and weights of Gauss's quadrature on \[0, 1\] with 2 and 4 nodes (M. Abramowitz and I. Stegun, table 25.4).
const GAUSS_2: ([f64; 2], [f64; 2]) =
    ([0.211_324_865_405_187_1, 0.788_675_134_594_812_9], [0.5; 2]);
const GAUSS_4: ([f64; 4], [f64; 4]) = (
    [
        0.069_431_844_202_973_71,
        0.330_009_478_207_571_87,
        0.669_990_521_792_428_1,
        0.930_568_155_797_026_3,
    ],
    [
        0.173_927_422_568_726_93,
        0.326_072_577_431_273_07,
        0.326_072_577_431_273_07,
        0.173_927_422_568_726_93,
    ],
);

/// Products of decay rate and step up to which two nodes, and four nodes, resolve a decay.
const RESOLVED: [f64; 2] = [0.01, 0.2];

/// Limit of the iterations. Each reduces the error by the step times the rates of change; if they do not converge, the
/// step is divided.
const ITERATIONS: usize = 20;

/// Change of the rates, relative to their size, at which the iteration has converged.
const CONVERGED: f64 = 1e-15;
/// Change of the rates that also counts as converged if rounding makes the iteration stagnate, or after the last
/// iteration.
const NEARLY_CONVERGED: f64 = 1e-11;

/// The equations of motion, the forcing and the input of a robot during a step.
pub(in crate::dynamics) struct Acting<'a> {
    pub equations: &'a mut EquationsOfMotion,
    pub workspace: &'a mut Workspace,
    pub forcing: &'a mut dyn Forcing,
    /// Last input written by the forcing: actuators and external wrenches.
    pub input: &'a mut Input,
}

/// Values at a node of the collocation.
#[derive(Debug, Clone)]
pub(super) struct Node {
    pub state: State,
    /// Efforts of stops, static friction and speed limits on held joints.
    pub holding: DVector<f64>,
    /// Efforts of the actuators.
    efforts: DVector<f64>,
    /// Rate of the base's rotation vector minus the part due to the base map at the start.
    turn: Vector3<f64>,
    /// External force and torque, world axes.
    force: Vector3<f64>,
    torque: Vector3<f64>,
    external_power: f64,
}

/// A step of exponential collocation at Gauss's nodes.
///
/// The equations of motion are written as `x' = -Λ x + g`, with the [`Modes`] of the damping at the start of the step.
/// The forcing `g` contains everything else: Coriolis terms, efforts, and the deviation of the damping from the modes
/// as the configuration changes. `g` is interpolated by a polynomial through the nodes, for which the differential
/// equation and its integral are solved exactly; the values of `g` at the nodes are found by iteration. Without damping
/// this is Gauss's implicit Runge-Kutta method, of order 2 s with s nodes. With damping it is stable for any step, and
/// exact if Coriolis terms, efforts and inertia are constant (M. Hochbruck and A. Ostermann, Exponential Runge-Kutta
/// methods for parabolic problems, Applied Numerical Mathematics 53, 2005, section 2). The base attitude is integrated
/// in the same way: the base map at the start times the joints' exact displacement, plus a polynomial for the
/// remainder.
#[derive(Debug, Clone)]
pub(super) struct Collocation {
    nodes: &'static [f64],
    weights: &'static [f64],
    /// Coefficient of θ^m in the j-th Lagrange polynomial, at `j * s + m`.
    lagrange: Vec<f64>,
    /// Integral of the j-th Lagrange polynomial from 0 to the i-th point (the nodes, then 1), at `i * s + j`.
    integrals: Vec<f64>,
    damping: DMatrix<f64>,
    modes: Modes,
    /// `x` at the start.
    x_0: Vec<f64>,
    /// Angular part of the base map at the start, one column per joint.
    base_map: Vec<Vector3<f64>>,
    /// For mode k and point i, at `k * (s + 1) + i`: `e^{-z θ}` and its integral.
    decays: Vec<[f64; 2]>,
    /// The same for the response to the j-th Lagrange polynomial, at `(k * (s + 1) + i) * s + j`.
    answers: Vec<[f64; 2]>,
    /// `g` of mode k at node j, at `j * n + k`.
    forcing: Vec<f64>,
    forcing_before: Vec<f64>,
    x: Vec<f64>,
    x_integral: Vec<f64>,
    displacement: Vec<f64>,
    total: Input,
    /// Energy supplied and dissipated in the last step \[J\].
    balance: (f64, f64),
    /// Scratch: the state at a point.
    point: State,
    pub at_nodes: Vec<Node>,
    /// The end of the last step.
    pub end: Node,
}

impl Collocation {
    /// A method with two nodes for tableaus of up to four stages, otherwise with four nodes.
    pub fn new(model: &Model, stages: usize) -> Self {
        let (nodes, weights): (&'static [f64], &'static [f64]) = match stages {
            0..=4 => (&GAUSS_2.0, &GAUSS_2.1),
            _ => (&GAUSS_4.0, &GAUSS_4.1),
        };
        let (n, s) = (model.dof(), nodes.len());
        let mut lagrange = vec![0.0; s * s];
        for j in 0..s {
            let polynomial = &mut lagrange[j * s..][..s];
            polynomial[0] = 1.0;
            for (degree, i) in (0..s).filter(|i| *i != j).enumerate() {
                let scale = 1.0 / (nodes[j] - nodes[i]);
                for m in (0..=degree + 1).rev() {
                    let lower = if m > 0 { polynomial[m - 1] } else { 0.0 };
                    polynomial[m] = (lower - nodes[i] * polynomial[m]) * scale;
                }
            }
        }
        let mut integrals = vec![0.0; (s + 1) * s];
        for i in 0..=s {
            for j in 0..s {
                let terms = lagrange[j * s..][..s].iter().enumerate();
                let power = |m: usize| point(nodes, i).powi(m as i32 + 1) / (m + 1) as f64;
                integrals[i * s + j] = terms.map(|(m, a)| a * power(m)).sum();
            }
        }
        let damping = DVector::from_iterator(n, model.joints().iter().map(|j| j.damping));
        let node = Node {
            state: State::at_rest(model),
            holding: DVector::zeros(n),
            efforts: DVector::zeros(n),
            turn: Vector3::zeros(),
            force: Vector3::zeros(),
            torque: Vector3::zeros(),
            external_power: 0.0,
        };
        Self {
            nodes,
            weights,
            lagrange,
            integrals,
            damping: DMatrix::from_diagonal(&damping),
            modes: Modes::new(n),
            x_0: vec![0.0; n],
            base_map: vec![Vector3::zeros(); n],
            decays: vec![[0.0; 2]; n * (s + 1)],
            answers: vec![[0.0; 2]; n * (s + 1) * s],
            forcing: vec![0.0; s * n],
            forcing_before: vec![0.0; n],
            x: vec![0.0; n],
            x_integral: vec![0.0; n],
            displacement: vec![0.0; n],
            total: Input::zero(model),
            balance: (0.0, 0.0),
            point: State::at_rest(model),
            at_nodes: vec![node.clone(); s],
            end: node,
        }
    }

    /// Sets the start of the following steps, of any length, and the joints that are held.
    pub fn start(&mut self, start: &State, contacts: &JointContacts, acting: &mut Acting) {
        let loops = &mut acting.equations.loops;
        if !loops.closures().is_empty() {
            loops.project_damping(&acting.equations.model, &mut self.damping);
        }
        let workspace = &mut *acting.workspace;
        workspace.set_positions(&start.q);
        for (j, column) in self.base_map.iter_mut().enumerate() {
            *column = workspace.column(j).H_A.0.into();
        }
        let inertia = workspace.reduced_inertia();
        self.modes.set(inertia, &self.damping, &contacts.held);
        self.modes.read(start.qd.as_slice(), &mut self.x_0);
    }

    /// Decay rate of the fastest mode of the damping \[1/s\].
    pub fn fastest_decay(&self) -> f64 {
        let decays = &self.modes.decay[..self.modes.count()];
        decays.iter().copied().fold(0.0, f64::max)
    }

    /// Error of the energy balance of the last step, relative to the sum of kinetic energy at both ends, work, and
    /// dissipation.
    pub fn energy_error(&self, start: &State, acting: &mut Acting) -> f64 {
        let end = &self.end.state;
        let before = kinetic_energy(start, acting.workspace);
        let after = kinetic_energy(end, acting.workspace);
        // Not from the accumulated values of the states, whose rounding may exceed the energy of a short step.
        let (supplied, lost) = self.balance;
        let size = before + after + lost.abs() + supplied.abs();
        (after - before - (supplied - lost)).abs() / size.max(f64::MIN_POSITIVE)
    }

    /// Order of the method for smooth motion.
    pub fn order(&self) -> usize {
        2 * self.nodes.len()
    }

    /// Computes a step of `h` \[s\]: the result is in `end`, the states at the nodes in `at_nodes`. Returns whether the
    /// iteration has converged.
    pub fn step(
        &mut self,
        start: &State,
        h: f64,
        contacts: &mut JointContacts,
        acting: &mut Acting,
    ) -> bool {
        let (s, m) = (self.nodes.len(), self.modes.count());
        self.set_answers(h);
        self.guess(start, contacts);
        let (mut converged, mut last) = (false, f64::INFINITY);
        for iteration in 0..ITERATIONS {
            let (mut change, mut size) = (0.0_f64, f64::MIN_POSITIVE);
            for i in 0..s {
                let turned = self.set_point(i, start, h, contacts, acting);
                let n = self.x.len();
                (self.forcing_before).copy_from_slice(&self.forcing[i * n..][..n]);
                let turn_before = self.at_nodes[i].turn;
                self.evaluate(i, &turned, contacts, acting);
                for k in 0..m {
                    let answer = self.answers[(k * (s + 1) + s) * s + i][0].abs();
                    let [before, now] = [self.forcing_before[k], self.forcing[i * n + k]];
                    change = larger(change, answer * (now - before).abs());
                    size = size.max(answer * now.abs()).max(self.x_0[k].abs());
                }
                // The angle is not scaled: a state has no size to compare it with.
                let node = &self.at_nodes[i];
                let turning = h * (node.turn - turn_before).norm();
                change = larger(change, turning * size);
            }
            let relative = change / size;
            if relative <= CONVERGED || relative >= 0.3 * last && relative <= NEARLY_CONVERGED {
                converged = true;
                break;
            }
            last = relative;
            converged = iteration + 1 == ITERATIONS && relative <= NEARLY_CONVERGED;
        }
        self.set_point(s, start, h, contacts, acting);
        self.end.state.R_WB.renormalize_fast();
        self.account(start, h, contacts, acting);
        converged
    }

    /// Computes the efforts that hold joints at the end of the last step.
    pub fn evaluate_end(&mut self, contacts: &mut JointContacts, acting: &mut Acting) {
        let state = &self.end.state;
        acting.forcing.apply(state.time, state, acting.input);
        contacts.evaluate(state, acting, &mut self.total, &mut self.end.holding);
    }

    /// Computes the responses of the modes for a step of `h`.
    fn set_answers(&mut self, h: f64) {
        let s = self.nodes.len();
        for k in 0..self.modes.count() {
            let z = h * self.modes.decay[k];
            for i in 0..=s {
                let theta = point(self.nodes, i);
                let phi = phi(-z * theta);
                let at = k * (s + 1) + i;
                self.decays[at] = [phi[0], h * theta * phi[1]];
                let mut powers = [[0.0; 2]; 4];
                let mut factor = h * theta;
                for (power, pair) in powers.iter_mut().zip(phi[1..].windows(2)).take(s) {
                    *power = [factor * pair[0], factor * h * theta * pair[1]];
                    factor *= theta;
                }
                // m! of the formula.
                let mut factorial = 1.0;
                for (m, power) in powers.iter_mut().enumerate().skip(2) {
                    factorial *= m as f64;
                    power.iter_mut().for_each(|p| *p *= factorial);
                }
                for j in 0..s {
                    let coefficients = &self.lagrange[j * s..][..s];
                    let mut sum = [0.0; 2];
                    for (a, power) in coefficients.iter().zip(&powers) {
                        sum[0] += a * power[0];
                        sum[1] += a * power[1];
                    }
                    self.answers[at * s + j] = sum;
                }
            }
        }
    }

    /// Initial guess: the forcing at the start, from `contacts.at_start`, at all nodes.
    fn guess(&mut self, start: &State, contacts: &JointContacts) {
        let s = self.nodes.len();
        let n = self.x.len();
        let at_start = &contacts.at_start;
        self.modes
            .read(at_start.acceleration.qdd.as_slice(), &mut self.x);
        let external = at_start.external.unwrap_or_default();
        let mut turn = at_start.w_WB_B;
        for (column, rate) in self.base_map.iter().zip(&start.qd) {
            turn -= column * *rate;
        }
        for i in 0..s {
            for k in 0..self.modes.count() {
                self.forcing[i * n + k] = self.x[k] + self.modes.decay[k] * self.x_0[k];
            }
            let node = &mut self.at_nodes[i];
            node.turn = turn;
            node.force = start.R_WB * external.force;
            node.torque = start.R_WB * external.torque;
            node.state.momentum_W = start.momentum_W;
        }
    }

    /// Writes the state at point `i` (the nodes, then the end); returns the rotation vector from the start.
    fn set_point(
        &mut self,
        i: usize,
        start: &State,
        h: f64,
        contacts: &JointContacts,
        acting: &mut Acting,
    ) -> Vector3<f64> {
        let (s, n) = (self.nodes.len(), self.x.len());
        for k in 0..self.modes.count() {
            let at = k * (s + 1) + i;
            let [decay, slide] = self.decays[at];
            let (mut x, mut integral) = (decay * self.x_0[k], slide * self.x_0[k]);
            for j in 0..s {
                let [rate, position] = self.answers[at * s + j];
                x += rate * self.forcing[j * n + k];
                integral += position * self.forcing[j * n + k];
            }
            (self.x[k], self.x_integral[k]) = (x, integral);
        }
        let duration = h * point(self.nodes, i);
        let state = &mut self.point;
        state.qd.copy_from(&start.qd);
        self.modes.write(&self.x, state.qd.as_mut_slice());
        for (j, displacement) in self.displacement.iter_mut().enumerate() {
            *displacement = if contacts.held[j] {
                duration * start.qd[j]
            } else {
                0.0
            };
        }
        self.modes.write(&self.x_integral, &mut self.displacement);
        let mut turned = Vector3::zeros();
        for (j, displacement) in self.displacement.iter().enumerate() {
            state.q[j] = start.q[j] + displacement;
            turned += self.base_map[j] * *displacement;
        }
        let mass = acting.equations.mass;
        let (mut impulse, mut twisted) = (Vector3::zeros(), Vector3::zeros());
        let mut gained = Vector3::zeros();
        for (j, node) in self.at_nodes.iter().enumerate() {
            let weight = h * self.integrals[i * s + j];
            turned += node.turn * weight;
            impulse += node.force * weight;
            twisted += node.torque * weight;
            // The point that is being written has no momentum yet.
            if j != i {
                gained += (node.state.momentum_W.linear - start.momentum_W.linear) * weight;
            }
        }
        state.momentum_W = start.momentum_W;
        state.momentum_W.linear += impulse;
        state.momentum_W.angular += twisted;
        if i < s {
            gained += impulse * (h * self.integrals[i * s + i]);
        }
        state.p_WC = start.p_WC + start.momentum_W.linear * (duration / mass) + gained / mass;
        state.R_WB = turn(&start.R_WB, &turned);
        state.time = start.time + duration;
        state.work = start.work;
        state.dissipated = start.dissipated;
        acting.equations.loops.project(state, acting.workspace);
        let node = self.at_nodes.get_mut(i).unwrap_or(&mut self.end);
        std::mem::swap(state, &mut node.state);
        turned
    }

    /// Evaluates the equations of motion at node `i`; `turned` is the rotation vector from the start.
    fn evaluate(
        &mut self,
        i: usize,
        turned: &Vector3<f64>,
        contacts: &mut JointContacts,
        acting: &mut Acting,
    ) {
        let n = self.x.len();
        let node = &mut self.at_nodes[i];
        let state = &node.state;
        acting.forcing.apply(state.time, state, acting.input);
        contacts.evaluate(state, acting, &mut self.total, &mut node.holding);
        node.efforts.copy_from(&acting.input.efforts);
        let evaluation = &acting.equations.evaluation;
        let (x, forcing) = (&mut self.x, &mut self.forcing[i * n..][..n]);
        self.modes
            .read(evaluation.acceleration.qdd.as_slice(), forcing);
        self.modes.read(state.qd.as_slice(), x);
        for k in 0..self.modes.count() {
            forcing[k] += self.modes.decay[k] * x[k];
        }
        let external = evaluation.external.unwrap_or_default();
        node.force = state.R_WB * external.force;
        node.torque = state.R_WB * external.torque;
        node.external_power = match evaluation.external {
            Some(_) => acting.workspace.external_power,
            None => 0.0,
        };
        node.turn = turn_rate(turned, &evaluation.w_WB_B);
        for (column, rate) in self.base_map.iter().zip(&state.qd) {
            node.turn -= column * *rate;
        }
    }

    /// Adds work and dissipation of the step to the end's state. `displacement` is that at the end.
    fn account(&mut self, start: &State, h: f64, contacts: &JointContacts, acting: &Acting) {
        let mut supplied = 0.0;
        let mut lost = Dissipated::default();
        for k in 0..self.modes.count() {
            lost.damping += self.dissipated_by(k, h);
        }
        let end = &mut self.end.state;
        for (j, joint) in acting.equations.model.joints().iter().enumerate() {
            let displacement = self.displacement[j];
            let held = self.at_nodes[0].efforts[j];
            supplied += held * displacement;
            let mut holding = 0.0;
            for (node, weight) in self.at_nodes.iter().zip(self.weights) {
                let power = (node.efforts[j] - held) * node.state.qd[j];
                supplied += h * weight * power;
                holding += h * weight * node.holding[j] * start.qd[j];
            }
            let middle = 0.5 * (start.q[j] + end.q[j]);
            supplied += joint.spring.stiffness * (joint.spring.rest - middle) * displacement;
            lost.friction -= contacts.sliding[j] * displacement;
            if contacts.held[j] {
                // Among the held joints, only those at their speed limits move.
                lost.velocity_limits -= holding;
                lost.damping += joint.damping * start.qd[j].powi(2) * h;
            }
        }
        for (node, weight) in self.at_nodes.iter().zip(self.weights) {
            supplied += h * weight * node.external_power;
        }
        self.balance = (supplied, lost.total());
        end.work = start.work + (supplied - lost.total());
        end.dissipated += lost;
    }

    /// Energy dissipated by the damping of mode `k` in the step, `λ ∫ x² dt` \[J\].
    fn dissipated_by(&self, k: usize, h: f64) -> f64 {
        let (s, n) = (self.nodes.len(), self.x.len());
        let decay = self.modes.decay[k];
        let (z, x_0) = (decay * h, self.x_0[k]);
        if z == 0.0 {
            return 0.0;
        }
        if z < RESOLVED[usize::from(s == 4)] {
            let mut sum = 0.0;
            for (i, weight) in self.weights.iter().enumerate() {
                let at = k * (s + 1) + i;
                let mut x = self.decays[at][0] * x_0;
                for j in 0..s {
                    x += self.answers[at * s + j][0] * self.forcing[j * n + k];
                }
                sum += weight * x * x;
            }
            return decay * h * sum;
        }
        // x = B e^{-zθ} + p(θ) with the polynomial p' = -z p + h g.
        let mut p = [0.0; 5];
        for m in (0..s).rev() {
            let coefficient = |j: usize| self.lagrange[j * s + m] * self.forcing[j * n + k];
            let g: f64 = (0..s).map(coefficient).sum();
            p[m] = (h * g - (m + 1) as f64 * p[m + 1]) / z;
        }
        let (fast, left) = (x_0 - p[0], (-z).exp());
        let mut sum = -fast * fast * (-2.0 * z).exp_m1() / (2.0 * z);
        let mut moment = -(-z).exp_m1() / z;
        for m in 0..s {
            sum += 2.0 * fast * p[m] * moment;
            moment = ((m + 1) as f64 * moment - left) / z;
            for (l, other) in p.iter().enumerate().take(s) {
                sum += p[m] * other / (m + l + 1) as f64;
            }
        }
        decay * h * sum
    }
}

fn kinetic_energy(state: &State, workspace: &mut Workspace) -> f64 {
    workspace.set_positions(&state.q);
    workspace.set_motion(state);
    workspace.kinetic_energy()
}

fn point(nodes: &[f64], i: usize) -> f64 {
    nodes.get(i).copied().unwrap_or(1.0)
}

/// The larger number; NaN if one of them is.
fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}
