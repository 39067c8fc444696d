//! Many free-floating robots of one model at once, for Monte Carlo studies.

mod evaluation;

use std::any::Any;

use nalgebra::{DVector, Quaternion, UnitQuaternion};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use self::evaluation::Evaluation;
use super::kernel::{F64x8, GROUP_SIZE, Tree};
use super::{Momentum, State};
use crate::model::Model;

/// Many states of one model, each stepped under its own held joint efforts. States lie side by side, so
/// that one instruction serves several of them, and blocks of them go to all processors. Every state comes
/// out as if it were alone, whatever the number of states or threads.
///
/// External wrenches and limits are not part of it: momentum is that of free motion, kept to the bit.
#[derive(Debug, Clone)]
pub struct Batch {
    tree: Tree,
    pub(super) arch: Arch,
    mass: f64,
    count: usize,
    blocks: Vec<Block>,
    scratch: Vec<Scratch>,
}

/// Writes a state's numbers into its lane.
fn put(rows: &mut [F64x8], lane: usize, values: &[f64]) {
    for (row, value) in rows.iter_mut().zip(values) {
        row.0[lane] = *value;
    }
}

/// A state's numbers.
fn get<const N: usize>(rows: &[F64x8; N], lane: usize) -> [f64; N] {
    rows.map(|row| row.0[lane])
}

/// Eight states.
#[derive(Debug, Clone)]
struct Block {
    time: F64x8,
    q: Vec<F64x8>,
    qd: Vec<F64x8>,
    qdd: Vec<F64x8>,
    efforts: Vec<F64x8>,
    /// Quaternions `i j k w`.
    R_WB: [F64x8; 4],
    p_WC: [F64x8; 3],
    linear_momentum_W: [F64x8; 3],
    angular_momentum_W: [F64x8; 3],
}

impl Batch {
    /// `count` states at rest, joints at zero, without efforts.
    pub fn new(model: &Model, count: usize) -> Self {
        let rest = State::at_rest(model);
        let block = Block {
            time: F64x8::ZERO,
            q: vec![F64x8::ZERO; model.dof()],
            qd: vec![F64x8::ZERO; model.dof()],
            qdd: vec![F64x8::ZERO; model.dof()],
            efforts: vec![F64x8::ZERO; model.dof()],
            R_WB: [0.0, 0.0, 0.0, 1.0].map(|entry| F64x8([entry; GROUP_SIZE])),
            p_WC: <[f64; 3]>::from(rest.p_WC).map(|entry| F64x8([entry; GROUP_SIZE])),
            linear_momentum_W: [F64x8::ZERO; 3],
            angular_momentum_W: [F64x8::ZERO; 3],
        };
        Self {
            tree: Tree::new(model),
            arch: Arch::new(),
            mass: model.total_mass(),
            count,
            blocks: vec![block; count.div_ceil(GROUP_SIZE)],
            scratch: Vec::new(),
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
        (index / GROUP_SIZE, index % GROUP_SIZE)
    }

    /// Replaces state `index`. Work is not kept.
    ///
    /// # Panics
    /// If there is no such state, or it has another number of joints.
    pub fn set_state(&mut self, index: usize, state: &State) {
        assert_eq!(state.q.len(), self.tree.dof(), "one position per joint");
        let (block, lane) = self.find(index);
        let block = &mut self.blocks[block];
        block.time.0[lane] = state.time;
        put(&mut block.R_WB, lane, state.R_WB.coords.as_slice());
        put(&mut block.p_WC, lane, state.p_WC.as_slice());
        let Momentum { linear, angular } = &state.momentum_W;
        put(&mut block.linear_momentum_W, lane, linear.as_slice());
        put(&mut block.angular_momentum_W, lane, angular.as_slice());
        put(&mut block.q, lane, state.q.as_slice());
        put(&mut block.qd, lane, state.qd.as_slice());
    }

    /// State `index`; its work is not a number.
    ///
    /// # Panics
    /// If there is no such state.
    pub fn state(&self, index: usize) -> State {
        let (block, lane) = self.find(index);
        let block = &self.blocks[block];
        let of =
            |rows: &[F64x8]| DVector::from_iterator(rows.len(), rows.iter().map(|r| r.0[lane]));
        State {
            time: block.time.0[lane],
            R_WB: UnitQuaternion::new_unchecked(Quaternion::from(get(&block.R_WB, lane))),
            p_WC: get(&block.p_WC, lane).into(),
            momentum_W: Momentum {
                linear: get(&block.linear_momentum_W, lane).into(),
                angular: get(&block.angular_momentum_W, lane).into(),
            },
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
        put(&mut self.blocks[block].efforts, lane, efforts);
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
        self.blocks[block].qdd[joint].0[lane]
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
            scratch,
            ..
        } = self;
        // One piece for each thread: a piece has scratch of its own.
        let threads = rayon::current_num_threads();
        let size = blocks.len().div_ceil(threads).max(1);
        if scratch.len() < threads {
            scratch.resize_with(threads, Scratch::default);
        }
        let pieces = blocks.par_chunks_mut(size).zip(scratch);
        pieces.for_each(|(blocks, scratch)| {
            arch.dispatch(Blocks {
                tree,
                mass: *mass,
                blocks,
                scratch,
                task,
            });
        });
    }
}

/// An [`Evaluation`] kept from call to call. Its type depends on the machine's lanes.
#[derive(Debug, Default)]
struct Scratch(Option<Box<dyn Any + Send + Sync>>);

impl Scratch {
    fn of<S: Simd>(&mut self, simd: S, tree: &Tree) -> &mut Evaluation<S> {
        let Self(kept) = self;
        if !kept.as_ref().is_some_and(|kept| kept.is::<Evaluation<S>>()) {
            *kept = Some(Box::new(Evaluation::new(simd, tree)));
        }
        let kept = kept.as_mut().and_then(|kept| kept.downcast_mut());
        kept.expect("of the type that was just made")
    }
}

impl Clone for Scratch {
    /// There is nothing in it that another would need.
    fn clone(&self) -> Self {
        Self::default()
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
    scratch: &'a mut Scratch,
    task: Task,
}

impl WithSimd for Blocks<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let evaluation = self.scratch.of(simd, self.tree);
        for block in self.blocks {
            for first in (0..GROUP_SIZE).step_by(S::F64_LANES) {
                evaluation.run(self.tree, block, first, self.task, self.mass);
            }
        }
    }
}
