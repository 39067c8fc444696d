//! Steps of robots with mimic joints, one state after another.

use super::block::{Block, put, read};
use super::{Forced, Setup, Task};
use crate::dynamics::kernel::GROUP_SIZE;
use crate::dynamics::{Input, Integrator, State, Workspace};

/// An integrator of single states, and its scratch memory.
#[derive(Debug)]
pub(super) struct CoupledStepper {
    integrator: Integrator,
    workspace: Workspace,
    state: State,
    input: Input,
}

impl CoupledStepper {
    pub(super) fn new(setup: &Setup) -> Box<Self> {
        Box::new(Self {
            integrator: Integrator::with_tableau(&setup.model, setup.tableau)
                .with_joint_physics(&setup.joint_physics),
            workspace: Workspace::new(&setup.model),
            state: State::at_rest(&setup.model),
            input: Input::zero(&setup.model),
        })
    }

    /// The task for the states of a block; `index` is the number of its first state in its piece of the batch.
    pub(super) fn run(
        &mut self,
        block: &mut Block,
        index: usize,
        task: Task,
        forced: &mut Option<Forced>,
    ) {
        let Self {
            integrator,
            workspace,
            state,
            input,
        } = self;
        for lane in 0..GROUP_SIZE {
            block.read_state(lane, state);
            read(&block.efforts, lane, input.efforts.as_mut_slice());
            match (task, forced.as_mut()) {
                (Task::Accelerate, _) => {
                    integrator.evaluate(state, workspace, input);
                    put(
                        &mut block.qdd,
                        lane,
                        integrator.accelerations().qdd.as_slice(),
                    );
                }
                (Task::Step { dt, steps }, None) => {
                    integrator.set_input(input);
                    let mut hold = |_: f64, _: &State, _: &mut Input| {};
                    integrator.steps(state, workspace, dt, steps, &mut hold);
                }
                (Task::Step { .. }, Some(forced)) if index + lane >= forced.count => {}
                (Task::Step { dt, steps }, Some(forced)) => {
                    integrator.set_input(input);
                    let mut apply = |_: f64, state: &State, acting: &mut Input| {
                        (forced.apply)(index + lane, state, acting.efforts.as_mut_slice());
                        input.copy_from(acting);
                    };
                    integrator.steps(state, workspace, dt, steps, &mut apply);
                    put(&mut block.efforts, lane, input.efforts.as_slice());
                }
            }
            block.set_state(lane, state);
        }
    }
}
