//! As many states of a batch as there are lanes, evaluated and stepped together.

use nalgebra::Vector3;
use pulp::Simd;

use super::{Block, Task, get, put};
use crate::dynamics::kernel::{
    F64x8, GROUP_SIZE, Lanes, LinkScratch, Quat, SERIES_LIMIT, Scalar, SubtreeMomentum, Tree, Vec3,
    base_angular_velocity, forward_dynamics, rotation_vector_rate_series, sin_cos,
};
use crate::spatial::{exp_so3, rotation_vector_rate};

/// The classical method's stages: weight, and the part of the step that leads to the next one.
const STAGES: [[f64; 2]; 4] = [
    [1.0 / 6.0, 0.5],
    [1.0 / 3.0, 0.5],
    [1.0 / 3.0, 1.0],
    [1.0 / 6.0, 0.0],
];

/// Scratch for as many states as there are lanes.
#[derive(Debug)]
pub(super) struct Evaluation<S: Simd> {
    simd: S,
    links: Vec<LinkScratch<Lanes<S>>>,
    subtrees: Vec<SubtreeMomentum<Lanes<S>>>,
    /// Sums of the stages' rates of positions and rates.
    sums: Vec<[Lanes<S>; 2]>,
}

impl<S: Simd> Evaluation<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, tree: &Tree) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self {
            simd,
            links: vec![LinkScratch::new(zero); tree.bodies.len()],
            subtrees: vec![SubtreeMomentum::new(zero); tree.bodies.len()],
            sums: vec![[zero; 2]; tree.dof()],
        }
    }

    /// The task for the states from `first` on.
    #[inline(always)]
    pub(super) fn run(
        &mut self,
        tree: &Tree,
        block: &mut Block,
        first: usize,
        task: Task,
        mass: f64,
    ) {
        let (steps, dt, stages) = match task {
            Task::Accelerate => (1, 0.0, &STAGES[..1]),
            Task::Step { dt, steps } => (steps, dt, &STAGES[..]),
        };
        for _ in 0..steps {
            let zero = Lanes::splat(self.simd, 0.0);
            for (j, link) in self.links[1..].iter_mut().enumerate() {
                link.q = Lanes::load(self.simd, &block.q[j].0[first..]);
                link.qd = Lanes::load(self.simd, &block.qd[j].0[first..]);
                self.sums[j] = [zero; 2];
            }
            let start = self.attitude(block, first);
            let (mut attitude, mut turned) = (start, Vec3::zero(zero));
            let mut sum_turned = turned;
            for &[weight, lead] in stages {
                let w = self.evaluate(tree, block, first, attitude);
                // This stage's share of the step, and how far its rates lead to the next stage.
                let share = Lanes::splat(self.simd, weight * dt);
                let lead = Lanes::splat(self.simd, lead * dt);
                for (j, (link, sum)) in self.links[1..].iter_mut().zip(&mut self.sums).enumerate() {
                    let (q_rate, qd_rate) = (link.qd, link.qdd);
                    sum[0] = q_rate.mul_add(share, sum[0]);
                    sum[1] = qd_rate.mul_add(share, sum[1]);
                    link.q = q_rate.mul_add(lead, Lanes::load(self.simd, &block.q[j].0[first..]));
                    link.qd =
                        qd_rate.mul_add(lead, Lanes::load(self.simd, &block.qd[j].0[first..]));
                }
                let rate = self.turn_rate(turned, w);
                sum_turned = rate.mul_add(share, sum_turned);
                turned = rate.scaled(lead);
                attitude = start.compose(self.turn(turned));
            }
            match task {
                Task::Accelerate => self.tell_accelerations(block, first),
                Task::Step { dt, .. } => {
                    attitude = start.compose(self.turn(sum_turned));
                    self.finish_step(block, first, attitude, dt, mass);
                }
            }
        }
    }

    /// Accelerations at the slots' positions and rates. Returns the base's angular velocity, base axes.
    #[inline(always)]
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
        let momentum_B = attitude.apply_inverse(self.load(&block.angular_momentum_W, first));
        let momentum = tree.to_base_kernel(momentum_B);
        let w = base_angular_velocity(tree, &self.links, &mut self.subtrees, momentum);
        self.links[0].w = w;
        forward_dynamics(tree, &mut self.links, None);
        tree.to_base_frame(w)
    }

    #[inline(always)]
    fn tell_accelerations(&self, block: &mut Block, first: usize) {
        for (link, qdd) in self.links[1..].iter().zip(&mut block.qdd) {
            link.qdd.store(&mut qdd.0[first..]);
        }
    }

    #[inline(always)]
    fn finish_step(
        &self,
        block: &mut Block,
        first: usize,
        attitude: Quat<Lanes<S>>,
        dt: f64,
        mass: f64,
    ) {
        let simd = self.simd;
        for (j, sum) in self.sums.iter().enumerate() {
            let (q, qd) = (&mut block.q[j].0[first..], &mut block.qd[j].0[first..]);
            (Lanes::load(simd, q) + sum[0]).store(q);
            (Lanes::load(simd, qd) + sum[1]).store(qd);
        }
        // A step leaves the norm within rounding of one.
        let (v, w) = (attitude.v, attitude.w);
        let scale = w.mul_add(w, v.dot(v)).times(-0.5).plus(1.5);
        let [i, j, k, l] = &mut block.R_WB;
        (v[0] * scale).store(&mut i.0[first..]);
        (v[1] * scale).store(&mut j.0[first..]);
        (v[2] * scale).store(&mut k.0[first..]);
        (w * scale).store(&mut l.0[first..]);
        for (p, momentum) in block.p_WC.iter_mut().zip(&block.linear_momentum_W) {
            let rate = Lanes::load(simd, &momentum.0[first..]);
            let from = Lanes::load(simd, &p.0[first..]);
            rate.mul_add(Lanes::splat(simd, dt / mass), from)
                .store(&mut p.0[first..]);
        }
        for time in &mut block.time.0[first..first + S::F64_LANES] {
            *time += dt;
        }
    }

    #[inline(always)]
    fn load(&self, rows: &[F64x8; 3], first: usize) -> Vec3<Lanes<S>> {
        let [x, y, z] = rows;
        Vec3([
            Lanes::load(self.simd, &x.0[first..]),
            Lanes::load(self.simd, &y.0[first..]),
            Lanes::load(self.simd, &z.0[first..]),
        ])
    }

    #[inline(always)]
    fn attitude(&self, block: &Block, first: usize) -> Quat<Lanes<S>> {
        let [i, j, k, w] = &block.R_WB;
        Quat {
            w: Lanes::load(self.simd, &w.0[first..]),
            v: self.load(&[*i, *j, *k], first),
        }
    }

    #[inline(always)]
    fn rows(v: Vec3<Lanes<S>>) -> [F64x8; 3] {
        let mut rows = [F64x8::ZERO; 3];
        v[0].store(&mut rows[0].0);
        v[1].store(&mut rows[1].0);
        v[2].store(&mut rows[2].0);
        rows
    }

    /// Whether a rotation vector is too large for the series in some lane.
    #[inline(always)]
    fn is_large(u: Vec3<Lanes<S>>) -> bool {
        let mut squares = F64x8::ZERO;
        u.dot(u).store(&mut squares.0);
        let mut is_large = false;
        for square in squares.0 {
            is_large |= is_far(square);
        }
        is_large
    }

    #[inline(always)]
    fn turn(&self, u: Vec3<Lanes<S>>) -> Quat<Lanes<S>> {
        let small = Quat::exp_series(u);
        if !Self::is_large(u) {
            return small;
        }
        let mut v = Self::rows(small.v);
        let mut w = F64x8::ZERO;
        small.w.store(&mut w.0);
        turn_far(&Self::rows(u), &mut v, &mut w);
        Quat {
            w: Lanes::load(self.simd, &w.0),
            v: self.load(&v, 0),
        }
    }

    #[inline(always)]
    fn turn_rate(&self, u: Vec3<Lanes<S>>, w: Vec3<Lanes<S>>) -> Vec3<Lanes<S>> {
        let small = rotation_vector_rate_series(u, w);
        if !Self::is_large(u) {
            return small;
        }
        let mut rates = Self::rows(small);
        turn_rate_far(&Self::rows(u), &Self::rows(w), &mut rates);
        self.load(&rates, 0)
    }
}

/// Whether an angle of this square is none for the series.
#[inline(always)]
fn is_far(square: f64) -> bool {
    square > SERIES_LIMIT || square.is_nan()
}

/// What a step turns in lanes where that is too much for the series.
#[cold]
fn turn_far(u: &[F64x8; 3], v: &mut [F64x8; 3], w: &mut F64x8) {
    for lane in 0..GROUP_SIZE {
        let u = Vector3::from(get(u, lane));
        if is_far(u.norm_squared()) {
            let turn = exp_so3(&u);
            put(v, lane, turn.imag().as_slice());
            w.0[lane] = turn.w;
        }
    }
}

/// The rate of a rotation vector in such lanes.
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
