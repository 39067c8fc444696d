//! Non-smooth forces in the joints: Coulomb friction, stops, speed limits.

use nalgebra::DVector;

use super::JointPhysics;
use super::collocation::Acting;
use super::small_matrix::{factorize, solve_lower, solve_lower_transposed};
use crate::dynamics::{Evaluation, Input, State, Workspace};
use crate::model::Model;

/// Slowest rate at which a joint rebounds from a stop \[rad/s or m/s\]; below it the joint rests there, as a real joint
/// does after a finite number of rebounds.
const SLOWEST_REBOUND: f64 = 1e-4;

/// Excess of an effort over its range that counts as rounding, relative to the range plus one.
const EXCESS: f64 = 1e-10;

/// Limit of the chain of impacts that one impact causes in other joints. Each takes energy, so the chain decays.
const IMPACTS: usize = 100;

/// Properties of one joint.
#[derive(Debug, Clone, Copy)]
struct Limits {
    /// Coulomb friction \[N m or N\].
    friction: f64,
    lower: f64,
    upper: f64,
    speed: f64,
}

/// The next event of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Event {
    /// The joint stops sliding.
    Rest,
    /// The joint reaches a stop, at this position.
    Stop(f64),
    /// The joint reaches its speed limit, at this rate.
    Speed(f64),
    /// The effort that holds the joint reaches the end of its range.
    Release,
}

/// Pivot state of a joint in the linear complementarity problem of the joints that rest, touch a stop, or move at their
/// speed limit: whether an effort within its range holds the joint at its rate.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Holding {
    /// The joint keeps its rate; the effort follows.
    Held,
    /// The effort is the lowest of the range, and the joint accelerates upwards.
    Lowest,
    /// The effort is the highest of the range, and the joint accelerates downwards.
    Highest,
}

/// Modes of the joints: which ones slide, rest, touch a stop or move at their speed limit. Constant between two events.
#[derive(Debug, Clone)]
pub(super) struct JointContacts {
    restitution: f64,
    limits: Vec<Limits>,
    /// Position limits in this step; for a joint that starts beyond a limit, its position is the limit.
    within: Vec<[f64; 2]>,
    /// Joints that keep their rate.
    pub held: Vec<bool>,
    /// Friction on the joints that slide \[N m or N\].
    pub sliding: Vec<f64>,
    /// Direction in which a joint with friction slides, otherwise 0.
    direction: Vec<f64>,
    /// Range of the effort that can hold a joint.
    range: Vec<[f64; 2]>,
    /// Joints that any effort holds until the next event, since they would start to move only by rounding.
    pub locked: Vec<bool>,
    candidates: Vec<usize>,
    choice: Vec<Holding>,
    /// The equations of motion evaluated in the last [`JointContacts::choose`].
    pub at_start: Evaluation,
    /// Efforts of all holding joints in the last [`JointContacts::choose`].
    pub at_start_holding: DVector<f64>,
    /// `Ĥ⁻¹`, the columns of the candidates, in their order.
    columns: Vec<f64>,
    factor: Vec<f64>,
    matrix: Vec<f64>,
    right: Vec<f64>,
    free: Vec<usize>,
}

impl JointContacts {
    pub fn new(model: &Model, settings: &JointPhysics) -> Self {
        let n = model.dof();
        let limit = |is_on: bool, value: f64, none: f64| if is_on { value } else { none };
        let limits = model.joints().iter().map(|joint| Limits {
            friction: limit(settings.friction, joint.friction, 0.0),
            lower: limit(settings.stops, joint.limits.lower, f64::NEG_INFINITY),
            upper: limit(settings.stops, joint.limits.upper, f64::INFINITY),
            speed: limit(
                settings.velocity_limits,
                joint.limits.velocity,
                f64::INFINITY,
            ),
        });
        Self {
            restitution: settings.restitution,
            limits: limits.collect(),
            within: vec![[f64::NEG_INFINITY, f64::INFINITY]; n],
            held: vec![false; n],
            sliding: vec![0.0; n],
            direction: vec![0.0; n],
            range: vec![[0.0; 2]; n],
            locked: vec![false; n],
            candidates: Vec::with_capacity(n),
            choice: Vec::with_capacity(n),
            at_start: Evaluation::zero(model),
            at_start_holding: DVector::zeros(n),
            columns: vec![0.0; n * n],
            factor: vec![0.0; n * n],
            matrix: vec![0.0; n * n],
            right: vec![0.0; n],
            free: Vec::with_capacity(n),
        }
    }

    /// Whether any joint has friction.
    pub fn has_friction(&self) -> bool {
        self.limits.iter().any(|joint| joint.friction != 0.0)
    }

    /// Whether any joint has a limit of position or speed.
    pub fn has_limits(&self) -> bool {
        let is_limited = |joint: &Limits| {
            joint.lower.is_finite() || joint.upper.is_finite() || joint.speed.is_finite()
        };
        self.limits.iter().any(is_limited)
    }

    /// Whether a step from `start` to `end`, computed without limits, respects them. A joint that reverses within the
    /// step could have exceeded a limit in between, by at most half of its motion in the step at its faster rate.
    pub fn respected(&self, start: (&[f64], &[f64]), end: (&[f64], &[f64]), dt: f64) -> bool {
        let rates = start.1.iter().zip(end.1);
        let moved = start.0.iter().zip(end.0).zip(rates);
        self.limits
            .iter()
            .zip(moved)
            .all(|(joint, ((q_0, q_1), (qd_0, qd_1)))| {
                let fastest = qd_0.abs().max(qd_1.abs());
                let is_reversed = qd_0 * qd_1 < 0.0;
                let beyond = if is_reversed { 0.5 * dt * fastest } else { 0.0 };
                q_0.max(*q_1) + beyond <= joint.upper
                    && q_0.min(*q_1) - beyond >= joint.lower
                    && fastest <= joint.speed
            })
    }

    /// Begins a step: sets the limits, and reduces rates that exceed them.
    pub fn begin(&mut self, state: &mut State, workspace: &mut Workspace) {
        for (j, joint) in self.limits.iter().enumerate() {
            self.within[j] = [joint.lower.min(state.q[j]), joint.upper.max(state.q[j])];
        }
        self.locked.fill(false);
        let is_fast = |(joint, rate): (&Limits, &f64)| rate.abs() > joint.speed;
        if self.limits.iter().zip(&state.qd).any(is_fast) {
            self.settle(state, workspace);
        }
    }

    /// Determines which joints are held from now on, and sets `at_start`.
    pub fn choose(&mut self, state: &State, acting: &mut Acting, total: &mut Input) {
        self.candidates.clear();
        self.held.fill(false);
        for (j, joint) in self.limits.iter().enumerate() {
            let (q, qd, friction) = (state.q[j], state.qd[j], joint.friction);
            let sign = if qd == 0.0 { 0.0 } else { qd.signum() };
            self.direction[j] = if friction > 0.0 { sign } else { 0.0 };
            self.sliding[j] = -friction * sign;
            let range = if self.locked[j] {
                [f64::NEG_INFINITY, f64::INFINITY]
            } else if qd == 0.0 {
                let [lower, upper] = self.within[j];
                [
                    if q >= upper {
                        f64::NEG_INFINITY
                    } else {
                        -friction
                    },
                    if q <= lower { f64::INFINITY } else { friction },
                ]
            } else if qd >= joint.speed {
                [f64::NEG_INFINITY, 0.0]
            } else if qd <= -joint.speed {
                [0.0, f64::INFINITY]
            } else {
                continue;
            };
            if range != [0.0, 0.0] {
                self.range[j] = range;
                self.candidates.push(j);
            }
        }
        acting.forcing.apply(state.time, state, acting.input);
        total.copy_from(acting.input);
        for (effort, friction) in total.efforts.iter_mut().zip(&self.sliding) {
            *effort += friction;
        }
        acting.equations.evaluate(state, acting.workspace, total);
        let found = &acting.equations.evaluation;
        self.at_start.acceleration.A_WB_B = found.acceleration.A_WB_B;
        self.at_start
            .acceleration
            .qdd
            .copy_from(&found.acceleration.qdd);
        self.at_start.w_WB_B = found.w_WB_B;
        self.at_start.external = found.external;
        self.at_start_holding.fill(0.0);
        if !self.candidates.is_empty() {
            acting.workspace.set_positions(&state.q);
            self.solve_complementarity(acting.workspace);
        }
    }

    /// Solves `q̈ = q̈_0 + Ĥ⁻¹ f` for the candidates: each either keeps its rate by an effort within its range, or has
    /// the effort at an end of the range and accelerates away. `Ĥ⁻¹` is positive definite, so there is one solution.
    /// Principal pivoting with the least index finds it in finitely many pivots (R. W. Cottle, J.-S. Pang and R. E.
    /// Stone, The Linear Complementarity Problem, 1992, section 4.2, Murty's method, for bounds on both sides).
    fn solve_complementarity(&mut self, workspace: &mut Workspace) {
        let n = self.limits.len();
        let count = self.candidates.len();
        self.factor
            .copy_from_slice(workspace.reduced_inertia().as_slice());
        factorize(&mut self.factor, n);
        for (c, &j) in self.candidates.iter().enumerate() {
            let column = &mut self.columns[c * n..][..n];
            column.fill(0.0);
            column[j] = 1.0;
            solve_lower(&self.factor, n, column);
            solve_lower_transposed(&self.factor, n, column);
        }
        self.choice.clear();
        self.choice.resize(count, Holding::Held);
        let qdd = &mut self.at_start.acceleration.qdd;
        for _ in 0..10 * (count + 1) * (count + 1) {
            // The efforts at the ends of their ranges, then those of the held joints.
            self.free.clear();
            self.free
                .extend((0..count).filter(|&c| self.choice[c] == Holding::Held));
            for (c, &j) in self.candidates.iter().enumerate() {
                self.at_start_holding[j] = match self.choice[c] {
                    Holding::Held => 0.0,
                    Holding::Lowest => self.range[j][0],
                    Holding::Highest => self.range[j][1],
                };
            }
            let m = self.free.len();
            for (k, &held) in self.free.iter().enumerate() {
                let row = self.candidates[held];
                let mut left = qdd[row];
                for (c, &j) in self.candidates.iter().enumerate() {
                    left += self.columns[c * n + row] * self.at_start_holding[j];
                }
                self.right[k] = -left;
                for (i, &other) in self.free.iter().enumerate() {
                    self.matrix[k * m + i] = self.columns[held * n + self.candidates[other]];
                }
            }
            factorize(&mut self.matrix, m);
            solve_lower(&self.matrix, m, &mut self.right[..m]);
            solve_lower_transposed(&self.matrix, m, &mut self.right[..m]);
            for (effort, &held) in self.right.iter().zip(&self.free) {
                self.at_start_holding[self.candidates[held]] = *effort;
            }
            let wrong = (0..count).find_map(|c| {
                let j = self.candidates[c];
                let [lowest, highest] = self.range[j];
                let effort = self.at_start_holding[j];
                let accelerated = || {
                    let efforts = self.candidates.iter().map(|&j| self.at_start_holding[j]);
                    let added = efforts
                        .enumerate()
                        .map(|(c, f)| self.columns[c * n + j] * f);
                    qdd[j] + added.sum::<f64>()
                };
                match self.choice[c] {
                    Holding::Held if effort < lowest => Some((c, Holding::Lowest)),
                    Holding::Held if effort > highest => Some((c, Holding::Highest)),
                    Holding::Lowest if accelerated() < 0.0 => Some((c, Holding::Held)),
                    Holding::Highest if accelerated() > 0.0 => Some((c, Holding::Held)),
                    _ => None,
                }
            });
            match wrong {
                Some((c, choice)) => self.choice[c] = choice,
                None => break,
            }
        }
        for (c, &j) in self.candidates.iter().enumerate() {
            let effort = self.at_start_holding[j];
            for (qdd, column) in qdd.iter_mut().zip(&self.columns[c * n..][..n]) {
                *qdd += column * effort;
            }
            match self.choice[c] {
                Holding::Held => self.held[j] = true,
                end => {
                    // The joint slides from now on, with the friction that held it.
                    self.at_start_holding[j] = 0.0;
                    self.sliding[j] += effort;
                    if self.limits[j].friction > 0.0 && self.direction[j] == 0.0 {
                        self.direction[j] = if end == Holding::Lowest { 1.0 } else { -1.0 };
                    }
                }
            }
        }
        for (j, held) in self.held.iter().enumerate() {
            if *held {
                qdd[j] = 0.0;
            }
        }
    }

    /// Evaluates the equations of motion at `state` with the friction of sliding joints, and with the efforts that hold
    /// the other joints, which are written to `holding`.
    pub fn evaluate(
        &mut self,
        state: &State,
        acting: &mut Acting,
        total: &mut Input,
        holding: &mut DVector<f64>,
    ) {
        total.copy_from(acting.input);
        for (effort, friction) in total.efforts.iter_mut().zip(&self.sliding) {
            *effort += friction;
        }
        acting.equations.evaluate(state, acting.workspace, total);
        holding.fill(0.0);
        if !self.held.contains(&true) {
            return;
        }
        acting.workspace.set_positions(&state.q);
        let inertia = acting.workspace.reduced_inertia();
        let qdd = &mut acting.equations.evaluation.acceleration.qdd;
        // With the accelerations of the held joints removed, those of the others change by
        // Δ = Ĥ_FF⁻¹ Ĥ_FH q̈_H, and the holding efforts are Ĥ_HF Δ - Ĥ_HH q̈_H.
        self.free.clear();
        self.free
            .extend((0..self.held.len()).filter(|&j| !self.held[j]));
        let m = self.free.len();
        for (k, &j) in self.free.iter().enumerate() {
            let mut sum = 0.0;
            for (i, held) in self.held.iter().enumerate() {
                if *held {
                    sum += inertia[(j, i)] * qdd[i];
                }
            }
            self.right[k] = sum;
            for (i, &row) in self.free.iter().enumerate() {
                self.matrix[k * m + i] = inertia[(row, j)];
            }
        }
        factorize(&mut self.matrix, m);
        solve_lower(&self.matrix, m, &mut self.right[..m]);
        solve_lower_transposed(&self.matrix, m, &mut self.right[..m]);
        for (i, held) in self.held.iter().enumerate() {
            if *held {
                let moved = self.free.iter().zip(&self.right);
                let mut effort: f64 = moved.map(|(&j, change)| inertia[(i, j)] * change).sum();
                for (other, held) in self.held.iter().enumerate() {
                    if *held {
                        effort -= inertia[(i, other)] * qdd[other];
                    }
                }
                holding[i] = effort;
            }
        }
        for (&j, change) in self.free.iter().zip(&self.right) {
            qdd[j] += change;
        }
        for (qdd, held) in qdd.iter_mut().zip(&self.held) {
            if *held {
                *qdd = 0.0;
            }
        }
    }

    /// The event that is exceeded most at `state`: its joint, the event, and the excess, which is negative if no event
    /// has happened. `holding` are the efforts that hold joints there.
    pub fn furthest(&self, state: &State, holding: Option<&DVector<f64>>) -> (usize, Event, f64) {
        let mut furthest = (0, Event::Release, -1.0);
        let mut consider = |j: usize, event: Event, past: f64| {
            if past > furthest.2 {
                furthest = (j, event, past);
            }
        };
        for (j, joint) in self.limits.iter().enumerate() {
            let (q, qd) = (state.q[j], state.qd[j]);
            if self.held[j] {
                if let Some(holding) = holding {
                    let [lowest, highest] = self.range[j];
                    let excess = |past: f64, end: f64| match end.is_finite() {
                        true => past - EXCESS * (1.0 + end.abs()),
                        false => -1.0,
                    };
                    consider(j, Event::Release, excess(holding[j] - highest, highest));
                    consider(j, Event::Release, excess(lowest - holding[j], lowest));
                }
                continue;
            }
            if self.direction[j] != 0.0 {
                consider(j, Event::Rest, -self.direction[j] * qd);
            }
            let [lower, upper] = self.within[j];
            if qd >= 0.0 {
                consider(j, Event::Stop(upper), q - upper);
            }
            if qd <= 0.0 {
                consider(j, Event::Stop(lower), lower - q);
            }
            consider(
                j,
                Event::Speed(joint.speed.copysign(qd)),
                qd.abs() - joint.speed,
            );
        }
        furthest
    }

    /// Applies the event of joint `j` to `state`.
    pub fn happen(&mut self, j: usize, event: Event, state: &mut State, workspace: &mut Workspace) {
        match event {
            Event::Rest => state.qd[j] = 0.0,
            Event::Speed(rate) => state.qd[j] = rate,
            Event::Stop(position) => {
                state.q[j] = position;
                self.settle(state, workspace);
            }
            Event::Release => {}
        }
    }

    /// Resolves impacts: a joint that moves into its stop rebounds, and a joint beyond its speed limit is braked to it,
    /// each by an impulse between the two bodies of the joint. The impulse changes the rates by `Ĥ⁻¹` times its size,
    /// and does not change momentum. One impact may cause others.
    fn settle(&mut self, state: &mut State, workspace: &mut Workspace) {
        workspace.set_positions(&state.q);
        let n = self.limits.len();
        self.factor
            .copy_from_slice(workspace.reduced_inertia().as_slice());
        factorize(&mut self.factor, n);
        for impact in 0..IMPACTS {
            let rates = state.qd.as_slice();
            let next = (0..n).find_map(|j| {
                let ([lower, upper], rate) = (self.within[j], rates[j]);
                if state.q[j] >= upper && rate > 0.0 || state.q[j] <= lower && rate < 0.0 {
                    // Without rebounds the chain of impacts ends.
                    let rebound = match impact < IMPACTS / 2 {
                        true => -self.restitution * rate,
                        false => 0.0,
                    };
                    let after = if rebound.abs() < SLOWEST_REBOUND {
                        0.0
                    } else {
                        rebound
                    };
                    return Some((j, after, true));
                }
                let speed = self.limits[j].speed;
                (rate.abs() > speed).then(|| (j, speed.copysign(rate), false))
            });
            let Some((j, after, is_stop)) = next else {
                return;
            };
            let answer = &mut self.right;
            answer.fill(0.0);
            answer[j] = 1.0;
            solve_lower(&self.factor, n, answer);
            solve_lower_transposed(&self.factor, n, answer);
            let before = state.qd[j];
            let impulse = (after - before) / answer[j];
            let lost = -0.5 * impulse * (before + after);
            for (rate, answer) in state.qd.iter_mut().zip(&*answer) {
                *rate += answer * impulse;
            }
            state.qd[j] = after;
            state.work -= lost;
            match is_stop {
                true => state.dissipated.stops += lost,
                false => state.dissipated.velocity_limits += lost,
            }
        }
    }
}
