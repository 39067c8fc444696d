//! Many free-floating robots of one model at once, for Monte Carlo studies.

use nalgebra::{DVector, Quaternion, UnitQuaternion, Vector3};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::kernel::{
    GROUP, Lanes, Place, Scalar, Slot, System, Tree, Vec3, forward_dynamics, momentum_map, sin_cos,
};
use super::{Momentum, State};
use crate::model::Model;
use crate::spatial::{exp_so3, rotation_vector_rate};

/// Many states of one model, each stepped under its own held joint efforts. States lie side by side, so
/// that one instruction serves several of them, and blocks of them go to all processors. Every state comes
/// out as if it were alone, whatever the number of states or threads.
///
/// External wrenches and limits are not part of it: momentum is that of free motion, kept to the bit.
#[derive(Debug, Clone)]
pub struct Batch {
    tree: Tree,
    arch: Arch,
    mass: f64,
    count: usize,
    blocks: Vec<Block>,
}

/// One number of each of eight states.
type Eight = [f64; GROUP];

/// Eight states.
#[derive(Debug, Clone)]
struct Block {
    time: Eight,
    q: Vec<Eight>,
    qd: Vec<Eight>,
    qdd: Vec<Eight>,
    efforts: Vec<Eight>,
    R_WB: [UnitQuaternion<f64>; GROUP],
    p_WC: [Vector3<f64>; GROUP],
    momentum_W: [Momentum; GROUP],
}

impl Batch {
    /// `count` states at rest, joints at zero, without efforts.
    pub fn new(model: &Model, count: usize) -> Self {
        let rest = State::at_rest(model);
        let block = Block {
            time: [0.0; GROUP],
            q: vec![[0.0; GROUP]; model.dof()],
            qd: vec![[0.0; GROUP]; model.dof()],
            qdd: vec![[0.0; GROUP]; model.dof()],
            efforts: vec![[0.0; GROUP]; model.dof()],
            R_WB: [rest.R_WB; GROUP],
            p_WC: [rest.p_WC; GROUP],
            momentum_W: [rest.momentum_W; GROUP],
        };
        Self {
            tree: Tree::new(model),
            arch: Arch::new(),
            mass: model.total_mass(),
            count,
            blocks: vec![block; count.div_ceil(GROUP)],
        }
    }

    /// Number of states.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there is no state.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Block and lane of a state.
    fn find(&self, index: usize) -> (usize, usize) {
        assert!(index < self.count, "state {index} of {}", self.count);
        (index / GROUP, index % GROUP)
    }

    /// Replaces state `index`. Work is not kept.
    ///
    /// # Panics
    /// If there is no such state, or it has another number of joints.
    pub fn set_state(&mut self, index: usize, state: &State) {
        assert_eq!(state.q.len(), self.tree.dof(), "one position per joint");
        let (block, lane) = self.find(index);
        let block = &mut self.blocks[block];
        block.time[lane] = state.time;
        block.R_WB[lane] = state.R_WB;
        block.p_WC[lane] = state.p_WC;
        block.momentum_W[lane] = state.momentum_W;
        for j in 0..self.tree.dof() {
            block.q[j][lane] = state.q[j];
            block.qd[j][lane] = state.qd[j];
        }
    }

    /// State `index`; its work is not a number.
    ///
    /// # Panics
    /// If there is no such state.
    pub fn state(&self, index: usize) -> State {
        let (block, lane) = self.find(index);
        let block = &self.blocks[block];
        let of = |rows: &[Eight]| DVector::from_iterator(rows.len(), rows.iter().map(|r| r[lane]));
        State {
            time: block.time[lane],
            R_WB: block.R_WB[lane],
            p_WC: block.p_WC[lane],
            momentum_W: block.momentum_W[lane],
            q: of(&block.q),
            qd: of(&block.qd),
            work: f64::NAN,
        }
    }

    /// Holds joint efforts \[N m or N\] for state `index` from now on.
    ///
    /// # Panics
    /// If there is no such state, or `efforts` does not have one element per joint.
    pub fn hold_efforts(&mut self, index: usize, efforts: &[f64]) {
        assert_eq!(efforts.len(), self.tree.dof(), "one effort per joint");
        let (block, lane) = self.find(index);
        for (row, effort) in self.blocks[block].efforts.iter_mut().zip(efforts) {
            row[lane] = *effort;
        }
    }

    /// Computes the joint accelerations of all states under the held efforts.
    pub fn accelerate(&mut self) {
        self.run(Task::Accelerate);
    }

    /// Acceleration of `joint` in state `index` as [`Batch::accelerate`] found it.
    ///
    /// # Panics
    /// If there is no such state or joint.
    pub fn qdd(&self, index: usize, joint: usize) -> f64 {
        let (block, lane) = self.find(index);
        self.blocks[block].qdd[joint][lane]
    }

    /// Advances all states by `steps` steps of `dt` \[s\] with the classical Runge-Kutta method.
    pub fn step(&mut self, dt: f64, steps: usize) {
        self.run(Task::Step { dt, steps });
    }

    fn run(&mut self, task: Task) {
        let Self {
            tree,
            arch,
            mass,
            blocks,
            ..
        } = self;
        // One piece for each thread: a piece has to take scratch of its own.
        let size = blocks.len().div_ceil(rayon::current_num_threads()).max(1);
        blocks.par_chunks_mut(size).for_each(|blocks| {
            arch.dispatch(Blocks {
                tree,
                mass: *mass,
                blocks,
                task,
            });
        });
    }
}

/// What is done with every state.
#[derive(Debug, Clone, Copy)]
enum Task {
    Accelerate,
    Step { dt: f64, steps: usize },
}

/// Some blocks, for `pulp` to compile.
struct Blocks<'a> {
    tree: &'a Tree,
    mass: f64,
    blocks: &'a mut [Block],
    task: Task,
}

impl WithSimd for Blocks<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let mut evaluation = Evaluation::new(simd, self.tree);
        for block in self.blocks {
            for first in (0..GROUP).step_by(S::F64_LANES) {
                match self.task {
                    Task::Accelerate => evaluation.accelerate(block, first),
                    Task::Step { dt, steps } => {
                        for _ in 0..steps {
                            evaluation.step(block, first, dt, self.mass);
                        }
                    }
                }
            }
        }
    }
}

/// Scratch for as many states as there are lanes.
struct Evaluation<'a, S: Simd> {
    simd: S,
    tree: &'a Tree,
    slots: Vec<Slot<Lanes<S>>>,
    places: Vec<Place<Lanes<S>>>,
    /// Sums of the stages' rates of positions and rates.
    sums: Vec<[Lanes<S>; 2]>,
    /// Angular velocity of the base, base axes.
    w_WB_B: [Vector3<f64>; GROUP],
}

impl<'a, S: Simd> Evaluation<'a, S> {
    #[inline(always)]
    fn new(simd: S, tree: &'a Tree) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self {
            simd,
            tree,
            slots: vec![Slot::new(zero); tree.bodies.len()],
            places: vec![Place::new(zero); tree.bodies.len()],
            sums: vec![[zero; 2]; tree.dof()],
            w_WB_B: [Vector3::zeros(); GROUP],
        }
    }

    #[inline(always)]
    fn load(&mut self, block: &Block, first: usize) {
        for (j, slot) in self.slots[1..].iter_mut().enumerate() {
            slot.q = Lanes::load(self.simd, &block.q[j][first..]);
            slot.qd = Lanes::load(self.simd, &block.qd[j][first..]);
        }
    }

    #[inline(always)]
    fn accelerate(&mut self, block: &mut Block, first: usize) {
        self.load(block, first);
        let attitudes = block.R_WB;
        self.evaluate(block, first, &attitudes);
        for (slot, qdd) in self.slots[1..].iter().zip(&mut block.qdd) {
            slot.qdd.store(&mut qdd[first..]);
        }
    }

    /// Accelerations at the slots' positions and rates.
    #[inline(always)]
    fn evaluate(&mut self, block: &Block, first: usize, R_WB: &[UnitQuaternion<f64>; GROUP]) {
        let simd = self.simd;
        for (j, hop) in self.tree.hops.iter().enumerate() {
            let (slot, place) = (&mut self.slots[j + 1], &mut self.places[j + 1]);
            let mut angles = [0.0; GROUP];
            slot.q.store(&mut angles);
            let (cos, sin) = sin_cos(&angles);
            slot.turn = hop.turn(Lanes::load(simd, &cos), Lanes::load(simd, &sin));
            (place.q, place.turn) = (slot.q, slot.turn);
            let actuator = Lanes::load(simd, &block.efforts[j][first..]);
            let slack = (-slot.q).plus(hop.rest).times(hop.stiffness);
            slot.effort = actuator + (slack - slot.qd.times(hop.damping));
        }
        let system = momentum_map(self.tree, &mut self.places);
        let w = self.angular_velocity(&system, block, first, R_WB);
        let mut rows = [[0.0; GROUP]; 3];
        for (i, row) in rows.iter_mut().enumerate() {
            w[i].store(row);
        }
        for (lane, w) in self.w_WB_B.iter_mut().enumerate().take(S::F64_LANES) {
            *w = Vector3::from(rows.map(|row| row[lane]));
        }
        let axes = self.places[0].axes;
        self.slots[0].w = Vec3(axes.map(|axis| axis.dot(w)));
        forward_dynamics(self.tree, &mut self.slots, None);
    }

    /// Masutani 1995 eq. (4.23) with the momentum kept, base axes.
    #[inline(always)]
    fn angular_velocity(
        &self,
        system: &System<Lanes<S>>,
        block: &Block,
        first: usize,
        R_WB: &[UnitQuaternion<f64>; GROUP],
    ) -> Vec3<Lanes<S>> {
        let mut rows = [[0.0; GROUP]; 3];
        for lane in 0..S::F64_LANES {
            let angular_W = &block.momentum_W[first + lane].angular;
            let angular = R_WB[first + lane].inverse_transform_vector(angular_W);
            for (row, component) in rows.iter_mut().zip(&angular) {
                row[lane] = *component;
            }
        }
        let mut angular = Vec3(rows.map(|row| Lanes::load(self.simd, &row)));
        for (place, slot) in self.places[1..].iter().zip(&self.slots[1..]) {
            angular = angular - place.H_M.scaled(slot.qd);
        }
        system.H_B_inverse.times(angular)
    }

    /// One step of the states from `first` on.
    #[inline(always)]
    fn step(&mut self, block: &mut Block, first: usize, dt: f64, mass: f64) {
        /// Where in the step a stage lies, and its weight.
        const STAGES: [(f64, f64); 4] = [
            (0.0, 1.0 / 6.0),
            (0.5, 1.0 / 3.0),
            (0.5, 1.0 / 3.0),
            (1.0, 1.0 / 6.0),
        ];
        let simd = self.simd;
        let lanes = first..first + S::F64_LANES;
        let mut turned = [Vector3::zeros(); GROUP];
        let mut attitudes = block.R_WB;
        self.load(block, first);
        for sum in &mut self.sums {
            *sum = [Lanes::splat(simd, 0.0); 2];
        }
        let mut sum_turned = [Vector3::zeros(); GROUP];
        for (stage, (_, weight)) in STAGES.into_iter().enumerate() {
            self.evaluate(block, first, &attitudes);
            let weight_dt = Lanes::splat(simd, weight * dt);
            // How far this stage's rates lead to the next.
            let lead = STAGES.get(stage + 1).map_or(0.0, |next| next.0) * dt;
            let lead_dt = Lanes::splat(simd, lead);
            for (j, (slot, sum)) in self.slots[1..].iter_mut().zip(&mut self.sums).enumerate() {
                let (q_rate, qd_rate) = (slot.qd, slot.qdd);
                sum[0] = q_rate.mul_add(weight_dt, sum[0]);
                sum[1] = qd_rate.mul_add(weight_dt, sum[1]);
                slot.q = q_rate.mul_add(lead_dt, Lanes::load(simd, &block.q[j][first..]));
                slot.qd = qd_rate.mul_add(lead_dt, Lanes::load(simd, &block.qd[j][first..]));
            }
            for (lane, state) in lanes.clone().enumerate() {
                let rate = rotation_vector_rate(&turned[lane], &self.w_WB_B[lane]);
                sum_turned[lane] += rate * (weight * dt);
                turned[lane] = rate * lead;
                attitudes[state] = block.R_WB[state] * exp_so3(&turned[lane]);
            }
        }
        for (j, sum) in self.sums.iter().enumerate() {
            let (q, qd) = (&mut block.q[j][first..], &mut block.qd[j][first..]);
            (Lanes::load(simd, q) + sum[0]).store(q);
            (Lanes::load(simd, qd) + sum[1]).store(qd);
        }
        for (lane, state) in lanes.enumerate() {
            let mut R_WB: Quaternion<f64> =
                (block.R_WB[state] * exp_so3(&sum_turned[lane])).into_inner();
            // A step leaves the norm within rounding of one.
            R_WB *= 1.5 - 0.5 * R_WB.norm_squared();
            block.R_WB[state] = UnitQuaternion::new_unchecked(R_WB);
            block.p_WC[state] += block.momentum_W[state].linear * (dt / mass);
            block.time[state] += dt;
        }
    }
}
