//! A batch of states, on one thread.

use fuyu::dynamics::{Batch, IntegrationMethod};
use fuyu::model::Model;

use super::ours::{DT, Program};
use super::robots::Moving;

/// States of a batch.
const STATES: usize = 128;

/// Operation on all states.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    Accelerate,
    Step,
}

/// A task on a batch; its time is per state.
pub struct Many {
    batch: Batch,
    task: Task,
}

impl Many {
    pub fn new(model: &Model, task: Task) -> Self {
        // From now on rayon uses this thread only; the first call in a process decides.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
        let _ = pool.use_current_thread().build_global();
        Self {
            batch: Batch::new(model, IntegrationMethod::Rk4, STATES),
            task,
        }
    }

    fn load(&mut self, index: usize, s: &Moving) {
        self.batch.set_state(index, &s.state);
        self.batch.hold_efforts(index, s.input.efforts.as_slice());
    }
}

impl Program for Many {
    fn call(&mut self, _: &Moving) {
        match self.task {
            Task::Accelerate => self.batch.accelerate(),
            Task::Step => self.batch.step(DT, 1),
        }
    }

    fn answer(&mut self, s: &Moving) -> Vec<f64> {
        self.load(0, s);
        self.call(s);
        match self.task {
            Task::Accelerate => {
                let joints = 0..s.state.q.len();
                joints.map(|j| self.batch.qdd(0, j)).collect()
            }
            Task::Step => {
                let after = self.batch.state(0);
                after.q.iter().chain(&after.qd).copied().collect()
            }
        }
    }

    fn calls(&mut self, states: &[Moving], calls: usize) -> usize {
        for (index, state) in (0..STATES).zip(states.iter().cycle()) {
            self.load(index, state);
        }
        let rounds = calls.div_ceil(STATES);
        for _ in 0..rounds {
            self.call(&states[0]);
        }
        rounds * STATES
    }
}
