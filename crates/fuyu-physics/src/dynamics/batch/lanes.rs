//! SIMD steps of a group of states of a batch, one state per lane of a register.
//!
//! Every lane performs the operations of [`Integrator`](crate::dynamics::Integrator) in the same order, so its result
//! is bit-identical. Where the integrator calls nalgebra, the functions below repeat nalgebra's operations.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use pulp::Simd;

use super::block::{Block, get, put, read};
use super::{Forced, Setup, Task};
use crate::dynamics::State;
use crate::dynamics::kernel::{
    F64x8, GROUP_SIZE, Lanes, LinkScratch, Quat, SERIES_LIMIT, Scalar, SubtreeMomentum, Tree, Vec3,
    base_angular_velocity, forward_dynamics, rotation_vector_rate_series, sin_cos,
};
use crate::spatial::{exp_so3, rotation_vector_rate};

/// Rates of change of the states at one stage, except those of the joints.
#[derive(Debug, Clone, Copy)]
struct StageRate<S: Simd> {
    /// Rate of the rotation vector since the start of the step.
    turned: Vec3<Lanes<S>>,
    work: Lanes<S>,
}

/// Scratch memory for as many states as there are lanes.
#[derive(Debug)]
pub(super) struct LaneStepper<S: Simd> {
    simd: S,
    links: Vec<LinkScratch<Lanes<S>>>,
    subtrees: Vec<SubtreeMomentum<Lanes<S>>>,
    rates: Vec<StageRate<S>>,
    /// Rates of joint positions and joint rates, stage by stage.
    joint_rates: Vec<[Lanes<S>; 2]>,
    /// The stage's states, for a forcing.
    stage: Block,
    state: State,
    efforts: Vec<f64>,
}

/// States of the base, and the work done.
#[derive(Debug, Clone, Copy)]
struct BaseState<S: Simd> {
    attitude: Quat<Lanes<S>>,
    p_WC: Vec3<Lanes<S>>,
    work: Lanes<S>,
}

impl<S: Simd> LaneStepper<S> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn new(simd: S, setup: &Setup) -> Self {
        let (tree, stages) = (&setup.tree, setup.tableau.c.len());
        let zero = Lanes::splat(simd, 0.0);
        let rate = StageRate {
            turned: Vec3::zero(zero),
            work: zero,
        };
        let state = State::at_rest(&setup.model);
        Self {
            simd,
            links: vec![LinkScratch::new(zero); tree.bodies.len()],
            subtrees: vec![SubtreeMomentum::new(zero); tree.bodies.len()],
            rates: vec![rate; stages],
            joint_rates: vec![[zero; 2]; stages * tree.dof()],
            stage: Block::repeating(&state),
            state,
            efforts: vec![0.0; tree.dof()],
        }
    }

    /// Executes the task for the states of a block from lane `first` on. `index` is the number of the block's first
    /// state in its piece of the batch.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn run(
        &mut self,
        setup: &Setup,
        block: &mut Block,
        (first, index): (usize, usize),
        task: Task,
        forced: &mut Option<Forced>,
    ) {
        match task {
            Task::Accelerate => self.accelerate(&setup.tree, block, first),
            Task::Step { dt, steps } => {
                for _ in 0..steps {
                    self.step(setup, block, (first, index), dt, forced);
                }
            }
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn accelerate(&mut self, tree: &Tree, block: &mut Block, first: usize) {
        self.set_joints(block, first);
        let start = self.load_base(block, first);
        self.evaluate(tree, block, first, start.attitude);
        for (link, qdd) in self.links[1..].iter().zip(&mut block.qdd) {
            link.qdd.store(&mut qdd.0[first..]);
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn step(
        &mut self,
        setup: &Setup,
        block: &mut Block,
        (first, index): (usize, usize),
        dt: f64,
        forced: &mut Option<Forced>,
    ) {
        let n = setup.tree.dof();
        self.set_joints(block, first);
        let start = self.load_base(block, first);
        let com_rate = self.com_rate(block, first, setup.mass);
        let (mut now, mut turned) = (start, Vec3::zero(start.work));
        for (i, c) in setup.tableau.c.iter().enumerate() {
            if let Some(forced) = forced {
                if i > 0 {
                    self.store_stage(block, first, now, c * dt);
                }
                self.apply(block, (first, index), i > 0, forced);
            }
            let w = self.evaluate(&setup.tree, block, first, now.attitude);
            let mut power = Lanes::splat(self.simd, 0.0);
            let joint_rates = &mut self.joint_rates[i * n..][..n];
            for (link, rate) in self.links[1..].iter().zip(joint_rates) {
                power = power + link.effort * link.qd;
                *rate = [link.qd, link.qdd];
            }
            self.rates[i] = StageRate {
                turned: self.turn_rate(turned, w),
                work: power,
            };
            let weights = setup.tableau.weights_after(i);
            (now, turned) = self.advance(block, first, (start, com_rate), weights, dt);
        }
        self.finish_step(block, first, now, dt);
    }

    /// Copies positions and rates of the block to the links.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn set_joints(&mut self, block: &Block, first: usize) {
        for (j, link) in self.links[1..].iter_mut().enumerate() {
            link.q = Lanes::load(self.simd, &block.q[j].0[first..]);
            link.qd = Lanes::load(self.simd, &block.qd[j].0[first..]);
        }
    }

    /// Evaluates the forcing at the states of the block, or of the stage if `is_within_step`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn apply(
        &mut self,
        block: &mut Block,
        (first, index): (usize, usize),
        is_within_step: bool,
        forced: &mut Forced,
    ) {
        for lane in first..first + S::F64_LANES {
            if index + lane >= forced.count {
                break;
            }
            let from = if is_within_step { &self.stage } else { &*block };
            from.read_state(lane, &mut self.state);
            read(&block.efforts, lane, &mut self.efforts);
            (forced.apply)(index + lane, &self.state, &mut self.efforts);
            put(&mut block.efforts, lane, &self.efforts);
        }
    }

    /// Computes the accelerations at the links' positions and rates. Returns the base's angular velocity, base axes.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn evaluate(
        &mut self,
        tree: &Tree,
        block: &Block,
        first: usize,
        attitude: Quat<Lanes<S>>,
    ) -> Vec3<Lanes<S>> {
        let simd = self.simd;
        for (j, joint) in tree.joints.iter().enumerate() {
            let link = &mut self.links[j + 1];
            let (cos, sin) = sin_cos(link.q);
            link.rotation = joint.rotation(cos, sin);
            let actuator = Lanes::load(simd, &block.efforts[j].0[first..]);
            let slack = (-link.q).plus(joint.rest).times(joint.stiffness);
            link.effort = actuator + (slack - link.qd.times(joint.damping));
        }
        let momentum_W = self.load(&block.angular_momentum_W, first);
        let momentum = tree.to_base_kernel(inverse_transform(attitude, momentum_W));
        let w = base_angular_velocity(tree, &self.links, &mut self.subtrees, momentum);
        self.links[0].w = w;
        forward_dynamics(tree, &mut self.links, None);
        tree.to_base_frame(w)
    }

    /// Computes the states of the next stage, or of the end of the step, and the rotation vectors since its start.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn advance(
        &mut self,
        block: &Block,
        first: usize,
        (start, com_rate): (BaseState<S>, Vec3<Lanes<S>>),
        weights: &[f64],
        dt: f64,
    ) -> (BaseState<S>, Vec3<Lanes<S>>) {
        let n = self.links.len() - 1;
        let (mut next, mut turned) = (start, Vec3::zero(start.work));
        let mut is_started = false;
        for (stage, weight) in weights.iter().enumerate() {
            if *weight == 0.0 {
                continue;
            }
            let (rate, k) = (self.rates[stage], Lanes::splat(self.simd, dt * weight));
            turned = turned + rate.turned.scaled(k);
            next.p_WC = next.p_WC + com_rate.scaled(k);
            next.work = next.work + rate.work * k;
            let joint_rates = &self.joint_rates[stage * n..][..n];
            let joints = self.links[1..].iter_mut().zip(joint_rates).enumerate();
            for (j, (link, [q_rate, qd_rate])) in joints {
                if !is_started {
                    link.q = Lanes::load(self.simd, &block.q[j].0[first..]);
                    link.qd = Lanes::load(self.simd, &block.qd[j].0[first..]);
                }
                link.q = link.q + *q_rate * k;
                link.qd = link.qd + *qd_rate * k;
            }
            is_started = true;
        }
        if !is_started {
            self.set_joints(block, first);
        }
        next.attitude = self.turned(start.attitude, turned);
        (next, turned)
    }

    /// Velocity of the centre of mass, constant within a step.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn com_rate(&self, block: &Block, first: usize, mass: f64) -> Vec3<Lanes<S>> {
        let mut rates = [F64x8::ZERO; 3];
        for (rate, momentum) in rates.iter_mut().zip(&block.linear_momentum_W) {
            for lane in 0..S::F64_LANES {
                rate.0[lane] = momentum.0[first + lane] / mass;
            }
        }
        self.load(&rates, 0)
    }

    /// Stores the stage's states, a time `dt` after those of `block`, for the forcing.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn store_stage(&mut self, block: &Block, first: usize, now: BaseState<S>, dt: f64) {
        for (j, link) in self.links[1..].iter().enumerate() {
            link.q.store(&mut self.stage.q[j].0[first..]);
            link.qd.store(&mut self.stage.qd[j].0[first..]);
        }
        let Quat { w, v } = now.attitude;
        let [i, j, k, l] = &mut self.stage.R_WB;
        v[0].store(&mut i.0[first..]);
        v[1].store(&mut j.0[first..]);
        v[2].store(&mut k.0[first..]);
        w.store(&mut l.0[first..]);
        for (axis, p) in self.stage.p_WC.iter_mut().enumerate() {
            now.p_WC[axis].store(&mut p.0[first..]);
        }
        now.work.store(&mut self.stage.work.0[first..]);
        self.stage.linear_momentum_W = block.linear_momentum_W;
        self.stage.angular_momentum_W = block.angular_momentum_W;
        for lane in first..first + S::F64_LANES {
            self.stage.time.0[lane] = block.time.0[lane] + dt;
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn finish_step(&self, block: &mut Block, first: usize, end: BaseState<S>, dt: f64) {
        for (j, link) in self.links[1..].iter().enumerate() {
            link.q.store(&mut block.q[j].0[first..]);
            link.qd.store(&mut block.qd[j].0[first..]);
        }
        let Quat { w, v } = renormalized(end.attitude);
        let [i, j, k, l] = &mut block.R_WB;
        v[0].store(&mut i.0[first..]);
        v[1].store(&mut j.0[first..]);
        v[2].store(&mut k.0[first..]);
        w.store(&mut l.0[first..]);
        for (axis, p) in block.p_WC.iter_mut().enumerate() {
            end.p_WC[axis].store(&mut p.0[first..]);
        }
        end.work.store(&mut block.work.0[first..]);
        for time in &mut block.time.0[first..first + S::F64_LANES] {
            *time += dt;
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn load(&self, rows: &[F64x8; 3], first: usize) -> Vec3<Lanes<S>> {
        let [x, y, z] = rows;
        Vec3([
            Lanes::load(self.simd, &x.0[first..]),
            Lanes::load(self.simd, &y.0[first..]),
            Lanes::load(self.simd, &z.0[first..]),
        ])
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn load_base(&self, block: &Block, first: usize) -> BaseState<S> {
        let [i, j, k, w] = &block.R_WB;
        BaseState {
            attitude: Quat {
                w: Lanes::load(self.simd, &w.0[first..]),
                v: self.load(&[*i, *j, *k], first),
            },
            p_WC: self.load(&block.p_WC, first),
            work: Lanes::load(self.simd, &block.work.0[first..]),
        }
    }

    /// Whether a rotation vector is too large for the series in some lane.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn is_large(u: Vec3<Lanes<S>>) -> bool {
        let mut squares = F64x8::ZERO;
        (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]).store(&mut squares.0);
        let mut is_large = false;
        for square in squares.0 {
            is_large |= is_far(square);
        }
        is_large
    }

    /// `attitude exp([u×])`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn turned(&self, attitude: Quat<Lanes<S>>, u: Vec3<Lanes<S>>) -> Quat<Lanes<S>> {
        let small = attitude.compose(Quat::exp_series(u));
        if !Self::is_large(u) {
            return small;
        }
        let mut after = rows(small);
        turn_far(&rows(attitude), &vector_rows(u), &mut after);
        let [i, j, k, w] = after;
        Quat {
            w: Lanes::load(self.simd, &w.0),
            v: self.load(&[i, j, k], 0),
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn turn_rate(&self, u: Vec3<Lanes<S>>, w: Vec3<Lanes<S>>) -> Vec3<Lanes<S>> {
        let small = rotation_vector_rate_series(u, w);
        if !Self::is_large(u) {
            return small;
        }
        let mut rates = vector_rows(small);
        turn_rate_far(&vector_rows(u), &vector_rows(w), &mut rates);
        self.load(&rates, 0)
    }
}

/// [`UnitQuaternion::inverse_transform_vector`] in lanes.
#[cfg_attr(not(debug_assertions), inline(always))]
fn inverse_transform<S: Simd>(attitude: Quat<Lanes<S>>, x: Vec3<Lanes<S>>) -> Vec3<Lanes<S>> {
    let v = -attitude.v;
    let t = cross(v, x);
    let t = t + t;
    t.scaled(attitude.w) + cross(v, t) + x
}

/// [`Vector3::cross`] in lanes: every product is rounded.
#[cfg_attr(not(debug_assertions), inline(always))]
fn cross<S: Simd>(a: Vec3<Lanes<S>>, b: Vec3<Lanes<S>>) -> Vec3<Lanes<S>> {
    Vec3([
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ])
}

/// [`UnitQuaternion::renormalize_fast`] in lanes.
#[cfg_attr(not(debug_assertions), inline(always))]
fn renormalized<S: Simd>(attitude: Quat<Lanes<S>>) -> Quat<Lanes<S>> {
    let Quat { w, v } = attitude;
    let square = (v[0] * v[0] + v[2] * v[2]) + (v[1] * v[1] + w * w);
    let scale = (-square).plus(3.0).times(0.5);
    Quat {
        w: w * scale,
        v: v.scaled(scale),
    }
}

#[cfg_attr(not(debug_assertions), inline(always))]
fn vector_rows<S: Simd>(v: Vec3<Lanes<S>>) -> [F64x8; 3] {
    let mut rows = [F64x8::ZERO; 3];
    v[0].store(&mut rows[0].0);
    v[1].store(&mut rows[1].0);
    v[2].store(&mut rows[2].0);
    rows
}

#[cfg_attr(not(debug_assertions), inline(always))]
fn rows<S: Simd>(attitude: Quat<Lanes<S>>) -> [F64x8; 4] {
    let [i, j, k] = vector_rows(attitude.v);
    let mut w = F64x8::ZERO;
    attitude.w.store(&mut w.0);
    [i, j, k, w]
}

/// Whether the squared angle is too large for the series.
#[cfg_attr(not(debug_assertions), inline(always))]
fn is_far(square: f64) -> bool {
    square > SERIES_LIMIT || square.is_nan()
}

/// `from exp([u×])` in the lanes where `u` is too large for the series.
#[cold]
fn turn_far(from: &[F64x8; 4], u: &[F64x8; 3], into: &mut [F64x8; 4]) {
    for lane in 0..GROUP_SIZE {
        let u = Vector3::from(get(u, lane));
        if is_far(u.norm_squared()) {
            let from = UnitQuaternion::new_unchecked(Quaternion::from(get(from, lane)));
            put(into, lane, (from * exp_so3(&u)).coords.as_slice());
        }
    }
}

/// The rate of the rotation vector in the lanes where `u` is too large for the series.
#[cold]
fn turn_rate_far(u: &[F64x8; 3], w: &[F64x8; 3], rates: &mut [F64x8; 3]) {
    for lane in 0..GROUP_SIZE {
        let u = Vector3::from(get(u, lane));
        if is_far(u.norm_squared()) {
            let rate = rotation_vector_rate(&u, &get(w, lane).into());
            put(rates, lane, rate.as_slice());
        }
    }
}
