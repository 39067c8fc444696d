//! Many states of one free-floating robot, stepped together, for Monte Carlo studies.

mod block;
mod joints;
mod lanes;
mod rows;
mod simd_group;

use std::any::Any;
use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use self::block::{Block, put, read};
use self::joints::JointScratch;
use self::lanes::LaneStepper;
pub use self::rows::EffortRows;
pub use self::simd_group::SimdGroup;
use super::joint_physics::JointSteps;
use super::kernel::{GROUP_SIZE, Tree};
use super::{InstructionSets, IntegrationMethod, JointPhysics, State, Tableau, checks};
use crate::model::Model;

/// Many states of one robot, each under its own efforts. One instruction computes several states (SIMD lanes), and
/// rayon distributes them over the processors.
///
/// Results are bit-identical to those of [`Integrator`](super::Integrator) and [`Floating`](super::Floating) with the same
/// method and the default formulation, for any number of states and threads. Robots with joint damping, joint friction or
/// mimic joints are stepped one by one in each thread, and so is a step in which a joint reaches a limit. External wrenches,
/// closed loops and other formulations are not supported; for these, step one `Floating` per state in a parallel iterator.
///
/// Efforts are either held ([`Batch::hold_efforts`]), sampled from one control law per state
/// ([`Batch::control`]), or functions of state and time ([`Batch::step_with`]):
///
/// ```
/// use fuyu_physics::dynamics::{Batch, IntegrationMethod, State};
/// use fuyu_physics::model::{JointKind, ModelBuilder};
/// use fuyu_physics::spatial::RigidInertia;
/// use nalgebra::{DVector, Matrix3, Translation3, Vector3};
///
/// // A base of 10 kg with a boom of 1 kg, hinged 0.5 m from the base's centre.
/// let inertia = |mass, x| RigidInertia { mass, com: Vector3::new(x, 0.0, 0.0), about_com: Matrix3::identity() * (0.1 * mass) };
/// let mut builder = ModelBuilder::new("boom", "base_link", inertia(10.0, 0.0));
/// let hinge = Translation3::new(0.5, 0.0, 0.0).into();
/// builder.body("arm", 0, JointKind::Continuous, Vector3::z_axis(), hinge, inertia(1.0, 0.5));
/// let model = builder.build();
///
/// // 1000 robots start at different joint positions.
/// let mut batch = Batch::new(&model, IntegrationMethod::Rk4, 1000);
/// for index in 0..batch.len() {
///     let q = DVector::from_element(1, -1.0 + 0.002 * index as f64);
///     batch.set_state(index, &State::at_rest_with(&model, &q));
/// }
///
/// // Closed loop: each robot has its own controller, here a PI controller with an integral as its state. It acts every
/// // 0.05 s; the dynamics take 5 steps of 0.01 s in between.
/// let mut integrals = vec![0.0; batch.len()];
/// for _ in 0..400 {
///     batch.control(&mut integrals, |integral, state, efforts| {
///         *integral += 0.05 * state.q[0];
///         efforts[0] = -0.2 * state.q[0] - 0.4 * state.qd[0] - 0.02 * *integral;
///     });
///     batch.step(0.01, 5);
/// }
/// assert!((0..1000).all(|index| batch.state(index).q[0].abs() < 0.1));
///
/// // Efforts as functions of time and state, at every stage of every step; each robot has its own amplitude.
/// let mut amplitudes: Vec<f64> = (0..1000).map(|index| 0.001 * index as f64).collect();
/// batch.step_with(0.01, 10, &mut amplitudes, |amplitude, state, efforts| {
///     efforts[0] = *amplitude * (2.0 * state.time).sin() - 0.1 * state.qd[0];
/// });
/// ```
#[derive(Debug, Clone)]
pub struct Batch {
    setup: Setup,
    count: usize,
    blocks: Vec<Block>,
    /// Scratch memory of each thread.
    scratch: Vec<Scratch>,
}

/// Data common to all states.
#[derive(Debug, Clone)]
struct Setup {
    model: Model,
    tree: Arc<Tree>,
    arch: Arch,
    tableau: &'static Tableau,
    mass: f64,
    /// Which states are stepped one by one.
    joints: JointSteps,
    joint_physics: JointPhysics,
}

impl Batch {
    /// A batch of `count` states at rest, joints at zero, without efforts, to be stepped with `method`.
    pub fn new(model: &Model, method: IntegrationMethod, count: usize) -> Self {
        Self::with_tableau(model, method.tableau(), count)
    }

    /// As [`Batch::new`], with any explicit tableau.
    pub fn with_tableau(model: &Model, tableau: &'static Tableau, count: usize) -> Self {
        let block = Block::repeating(&State::at_rest(model));
        let joint_physics = JointPhysics::default();
        Self {
            setup: Setup {
                model: model.clone(),
                tree: Tree::shared(model),
                arch: InstructionSets::of_this_processor().batch,
                tableau,
                mass: model.total_mass(),
                joints: JointSteps::of_batch(model, tableau, &joint_physics),
                joint_physics,
            },
            count,
            blocks: vec![block; count.div_ceil(GROUP_SIZE)],
            scratch: Vec::new(),
        }
    }

    /// The same batch, with other settings for friction, stops and speed limits of the joints.
    pub fn with_joint_physics(mut self, settings: &JointPhysics) -> Self {
        let setup = &mut self.setup;
        setup.joints = JointSteps::of_batch(&setup.model, setup.tableau, settings);
        setup.joint_physics = *settings;
        self.scratch.clear();
        self
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.setup.model
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
    #[track_caller]
    fn find(&self, index: usize) -> (usize, usize) {
        assert!(
            index < self.count,
            "there is no state {index} in a batch of {}",
            self.count
        );
        (index / GROUP_SIZE, index % GROUP_SIZE)
    }

    /// Replaces state `index`.
    ///
    /// # Panics
    /// If there is no such state, or `state` has another number of joints.
    pub fn set_state(&mut self, index: usize, state: &State) {
        checks::state(state, &self.setup.model);
        let (block, lane) = self.find(index);
        self.blocks[block].set_state(lane, state);
    }

    /// State `index`.
    ///
    /// # Panics
    /// If there is no such state.
    pub fn state(&self, index: usize) -> State {
        let (block, lane) = self.find(index);
        let mut state = State::at_rest(&self.setup.model);
        self.blocks[block].read_state(lane, &mut state);
        state
    }

    /// Holds joint efforts \[N m or N\] for state `index` from now on, each clamped to its joint's effort limit.
    ///
    /// # Panics
    /// If there is no such state, or `efforts` does not have one element per joint.
    pub fn hold_efforts(&mut self, index: usize, efforts: &[f64]) {
        checks::joint_vector("efforts", efforts.len(), &self.setup.model);
        let (block, lane) = self.find(index);
        hold(&mut self.blocks[block], lane, efforts, &self.setup.model);
    }

    /// Samples one control law per state: `law(controller, state, efforts)` receives the state's controller, the state,
    /// and the held efforts \[N m or N\], which it may change. The new efforts are held, each clamped to its joint's
    /// effort limit. Controllers may be of any type, such as a [`Controller`](crate::control::Controller) with its
    /// measurement; a law that can fail stores its error in the controller.
    ///
    /// # Panics
    /// If `controllers` does not have one element per state.
    pub fn control<C: Send>(
        &mut self,
        controllers: &mut [C],
        law: impl Fn(&mut C, &State, &mut [f64]) + Sync,
    ) {
        self.check_count("controllers", controllers.len());
        let size = self.piece_size() * GROUP_SIZE;
        let pieces = self.pieces(Task::Accelerate);
        (pieces.zip(controllers.par_chunks_mut(size))).for_each(|(piece, controllers)| {
            let Piece {
                setup,
                blocks,
                scratch,
                ..
            } = piece;
            let Scratch { state, efforts, .. } = scratch;
            for (index, controller) in controllers.iter_mut().enumerate() {
                let (block, lane) = (&mut blocks[index / GROUP_SIZE], index % GROUP_SIZE);
                block.read_state(lane, state);
                read(&block.efforts, lane, efforts);
                law(controller, state, efforts);
                hold(block, lane, efforts, &setup.model);
            }
        });
    }

    /// Computes the joint accelerations of all states under the held efforts.
    pub fn accelerate(&mut self) {
        self.pieces(Task::Accelerate)
            .for_each(|piece| piece.run(None));
    }

    /// Acceleration \[rad/s² or m/s²\] of `joint` in state `index`, from [`Batch::accelerate`].
    ///
    /// # Panics
    /// If there is no such state or joint.
    pub fn qdd(&self, index: usize, joint: usize) -> f64 {
        let (block, lane) = self.find(index);
        self.blocks[block].qdd[joint].0[lane]
    }

    /// Advances all states by `steps` steps of `dt` \[s\] under the held efforts.
    pub fn step(&mut self, dt: f64, steps: usize) {
        self.pieces(Task::Step { dt, steps })
            .for_each(|piece| piece.run(None));
    }

    /// Advances all states by `steps` steps of `dt` \[s\] under efforts that depend on time and state, as
    /// [`Integrator::steps`](super::Integrator::steps) does: at every stage, `forcing(data, state, efforts)` receives
    /// the state's data (of any type), the stage's state (with its time), and the efforts \[N m or N\] of the last
    /// call, which it may change. The efforts are not clamped, and are held afterwards.
    ///
    /// # Panics
    /// If `data` does not have one element per state.
    pub fn step_with<D: Send>(
        &mut self,
        dt: f64,
        steps: usize,
        data: &mut [D],
        forcing: impl Fn(&mut D, &State, &mut [f64]) + Sync,
    ) {
        self.check_count("data", data.len());
        let size = self.piece_size() * GROUP_SIZE;
        let pieces = self.pieces(Task::Step { dt, steps });
        (pieces.zip(data.par_chunks_mut(size))).for_each(|(piece, data)| {
            let count = data.len();
            let mut apply = |index: usize, state: &State, efforts: &mut [f64]| {
                forcing(&mut data[index], state, efforts);
            };
            piece.run(Some(Forced {
                count,
                apply: &mut apply,
            }));
        });
    }

    #[track_caller]
    fn check_count(&self, name: &str, given: usize) {
        let count = self.count;
        assert!(
            given == count,
            "`{name}` has {given} elements, but the batch has {count} states"
        );
    }

    /// Number of blocks in a piece: one piece for each thread, which has its own scratch memory.
    fn piece_size(&self) -> usize {
        (self.blocks.len().div_ceil(rayon::current_num_threads())).max(1)
    }

    fn pieces(&mut self, task: Task) -> impl IndexedParallelIterator<Item = Piece<'_>> {
        let size = self.piece_size();
        let Self {
            setup,
            blocks,
            scratch,
            ..
        } = self;
        let count = blocks.len().div_ceil(size);
        if scratch.len() < count {
            scratch.resize_with(count, || Scratch::new(setup));
        }
        let setup = &*setup;
        let pieces = blocks.par_chunks_mut(size).zip(scratch);
        pieces.map(move |(blocks, scratch)| Piece {
            setup,
            blocks,
            scratch,
            task,
        })
    }

    /// Restricts the instruction set.
    #[cfg(test)]
    pub(super) fn set_arch(&mut self, arch: Arch) {
        self.setup.arch = arch;
    }
}

/// Holds efforts in a lane, within the joints' limits.
fn hold(block: &mut Block, lane: usize, efforts: &[f64], model: &Model) {
    put(&mut block.efforts, lane, efforts);
    for (joint, row) in model.joints().iter().zip(&mut block.efforts) {
        let limit = joint.limits.effort;
        row.0[lane] = row.0[lane].clamp(-limit, limit);
    }
}

/// Operation on every state.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Task {
    Accelerate,
    Step { dt: f64, steps: usize },
}

/// Efforts that depend on state and time.
struct Forced<'a> {
    /// Number of states in the piece: lanes beyond it are unused.
    count: usize,
    /// Called with the number of a state in the piece, the state, and its efforts.
    apply: &'a mut dyn FnMut(usize, &State, &mut [f64]),
}

/// A thread's share of the batch.
struct Piece<'a> {
    setup: &'a Setup,
    blocks: &'a mut [Block],
    scratch: &'a mut Scratch,
    task: Task,
}

impl Piece<'_> {
    fn reborrow(&mut self) -> Piece<'_> {
        Piece {
            setup: self.setup,
            blocks: self.blocks,
            scratch: self.scratch,
            task: self.task,
        }
    }

    fn run(self, mut forced: Option<Forced>) {
        let arch = self.setup.arch;
        if self.setup.joints == JointSteps::Always
            || self.setup.joints == JointSteps::AtLimits && self.task == Task::Accelerate
        {
            self.run_one_by_one(&mut forced);
            return;
        }
        arch.dispatch(Run {
            piece: self,
            forced,
        });
    }
}

/// The task of a piece; `pulp` compiles it for every instruction set.
struct Run<'a, 'b> {
    piece: Piece<'a>,
    forced: Option<Forced<'b>>,
}

impl WithSimd for Run<'_, '_> {
    type Output = ();
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let Piece {
            setup,
            blocks,
            scratch,
            task,
        } = self.piece;
        // Separate from the scratch memory of single steps.
        let stepper = Scratch::stepper(&mut scratch.stepper, simd, setup);
        // One step at a time if joints may reach limits.
        let (part, parts) = match (task, &scratch.joints) {
            (Task::Step { dt, steps }, Some(_)) => (Task::Step { dt, steps: 1 }, steps),
            _ => (task, 1),
        };
        for (b, block) in blocks.iter_mut().enumerate() {
            let index = b * GROUP_SIZE;
            for _ in 0..parts {
                if let Some(joints) = &mut scratch.joints {
                    joints.before.copy_states(block);
                }
                // The only call, and not from a closure: otherwise it would be compiled without the processor's
                // instructions.
                for first in (0..GROUP_SIZE).step_by(S::F64_LANES) {
                    stepper.run(setup, block, (first, index), part, &mut self.forced);
                }
                if let (Some(joints), Task::Step { dt, .. }) = (&mut scratch.joints, part) {
                    joints.correct(block, index, dt, &mut self.forced);
                }
            }
        }
    }
}

/// Scratch memory of one thread.
#[derive(Debug)]
struct Scratch {
    /// A [`LaneStepper`], whose type depends on the instruction set.
    stepper: Option<Box<dyn Any + Send + Sync>>,
    /// Scratch memory of single steps, for robots with mimic joints, or with damping, friction or limits of joints.
    joints: Option<Box<JointScratch>>,
    state: State,
    efforts: Vec<f64>,
}

impl Scratch {
    fn new(setup: &Setup) -> Self {
        let model = &setup.model;
        let needed = setup.joints != JointSteps::Never;
        Self {
            stepper: None,
            joints: needed.then(|| Box::new(JointScratch::new(setup))),
            state: State::at_rest(model),
            efforts: vec![0.0; model.dof()],
        }
    }

    fn stepper<'a, S: Simd>(
        kept: &'a mut Option<Box<dyn Any + Send + Sync>>,
        simd: S,
        setup: &Setup,
    ) -> &'a mut LaneStepper<S> {
        if !kept
            .as_ref()
            .is_some_and(|kept| kept.is::<LaneStepper<S>>())
        {
            *kept = Some(Box::new(LaneStepper::new(simd, setup)));
        }
        let kept = kept.as_mut().and_then(|kept| kept.downcast_mut());
        kept.expect("it has just been made with this type")
    }
}

impl Clone for Scratch {
    fn clone(&self) -> Self {
        Self {
            stepper: None,
            joints: self.joints.clone(),
            state: self.state.clone(),
            efforts: self.efforts.clone(),
        }
    }
}
