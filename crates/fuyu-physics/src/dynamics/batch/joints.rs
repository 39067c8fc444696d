//! Steps of single states of a batch, where SIMD lanes cannot step states together: robots with damping, friction or
//! limits of joints, or with mimic joints.

use super::block::{Block, put, read};
use super::{Forced, Piece, Setup, Task};
use crate::dynamics::joint_physics::JointSteps;
use crate::dynamics::kernel::GROUP_SIZE;
use crate::dynamics::{Input, Integrator, JointPhysics, State, Tableau, Workspace};
use crate::model::Model;

impl JointSteps {
    /// Which steps of a batch are taken state by state. With mimic joints, all steps: the lanes support only joints
    /// that move independently.
    pub(super) fn of_batch(
        model: &Model,
        tableau: &'static Tableau,
        settings: &JointPhysics,
    ) -> Self {
        if model.has_mimics() {
            return Self::Always;
        }
        let integrator = Integrator::with_tableau(model, tableau);
        integrator.with_joint_physics(settings).joint_steps()
    }
}

/// Scratch memory of one thread.
#[derive(Debug, Clone)]
pub(super) struct JointScratch {
    /// States before the step.
    pub(super) before: Block,
    integrator: Integrator,
    workspace: Workspace,
    state: State,
    after: State,
    input: Input,
}

impl JointScratch {
    pub(super) fn new(setup: &Setup) -> Self {
        let model = &setup.model;
        let state = State::at_rest(model);
        Self {
            before: Block::repeating(&state),
            integrator: Integrator::with_tableau(model, setup.tableau)
                .with_joint_physics(&setup.joint_physics),
            workspace: Workspace::new(model),
            after: state.clone(),
            state,
            input: Input::zero(model),
        }
    }

    /// Repeats the step in the lanes of `block` that reached a limit. `index` is the number of the block's first state
    /// in its piece.
    pub(super) fn correct(
        &mut self,
        block: &mut Block,
        index: usize,
        dt: f64,
        forced: &mut Option<Forced>,
    ) {
        for lane in 0..GROUP_SIZE {
            if forced
                .as_ref()
                .is_some_and(|forced| index + lane >= forced.count)
            {
                break;
            }
            self.before.read_state(lane, &mut self.state);
            block.read_state(lane, &mut self.after);
            let start = (self.state.q.as_slice(), self.state.qd.as_slice());
            let end = (self.after.q.as_slice(), self.after.qd.as_slice());
            if !self.integrator.is_free(start, end, dt) {
                self.step(block, lane, index + lane, dt, 1, forced);
            }
        }
    }

    /// Steps `self.state` under the efforts of a lane, and writes the result to the lane.
    fn step(
        &mut self,
        block: &mut Block,
        lane: usize,
        index: usize,
        dt: f64,
        steps: usize,
        forced: &mut Option<Forced>,
    ) {
        read(&block.efforts, lane, self.input.efforts.as_mut_slice());
        self.integrator.set_input(&self.input);
        let mut forcing = |_: f64, state: &State, input: &mut Input| {
            if let Some(forced) = forced {
                (forced.apply)(index, state, input.efforts.as_mut_slice());
            }
        };
        (self.integrator).steps(
            &mut self.state,
            &mut self.workspace,
            dt,
            steps,
            &mut forcing,
        );
        put(
            &mut block.efforts,
            lane,
            self.integrator.input().efforts.as_slice(),
        );
        block.set_state(lane, &self.state);
    }

    /// Computes the accelerations of `self.state` under the efforts of a lane, and writes them to the lane.
    fn accelerate(&mut self, block: &mut Block, lane: usize) {
        read(&block.efforts, lane, self.input.efforts.as_mut_slice());
        (self.integrator).evaluate(&self.state, &mut self.workspace, &self.input);
        put(
            &mut block.qdd,
            lane,
            self.integrator.accelerations().qdd.as_slice(),
        );
    }
}

impl Piece<'_> {
    /// Executes the task state by state.
    pub(super) fn run_one_by_one(self, forced: &mut Option<Forced>) {
        let Some(joints) = &mut self.scratch.joints else {
            return;
        };
        for (b, block) in self.blocks.iter_mut().enumerate() {
            for lane in 0..GROUP_SIZE {
                let index = b * GROUP_SIZE + lane;
                if forced.as_ref().is_some_and(|forced| index >= forced.count) {
                    return;
                }
                block.read_state(lane, &mut joints.state);
                match self.task {
                    Task::Step { dt, steps } => {
                        joints.step(block, lane, index, dt, steps, forced);
                    }
                    Task::Accelerate => joints.accelerate(block, lane),
                }
            }
        }
    }
}
