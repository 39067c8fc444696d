//! Steps of a paused simulation.

use crate::{
    msg::simulation_interfaces::{
        Result as Outcome,
        services::{StepSimulation, StepSimulationResponse},
        simulate_steps::{Feedback, Outcome as StepsOutcome, SimulateSteps},
    },
    nodes::dynamics::simulation::{Phase, Simulation},
    ros::{Goal, Reply},
};

/// Steps that somebody waits for.
pub struct Stepping {
    done: u64,
    total: u64,
    client: Client,
}

enum Client {
    Service(Reply<StepSimulation>),
    Action(Goal<SimulateSteps>),
}

impl Client {
    fn end(self, result: Outcome) {
        match self {
            Self::Service(reply) => reply.send(&StepSimulationResponse { result }),
            Self::Action(goal) => match result.result {
                Outcome::OK => goal.succeed(StepsOutcome { result }),
                _ => goal.abort(StepsOutcome { result }),
            },
        }
    }
}

impl Simulation<'_> {
    /// Takes in who wants steps, or does not any more.
    pub(super) fn attend_steps(&mut self) {
        while let Some(call) = self.control.step.take() {
            self.begin_steps(call.request.steps, Client::Service(call.reply));
        }
        while let Some(goal) = self.control.steps.take() {
            self.begin_steps(goal.goal.steps, Client::Action(goal));
        }
        let cancelled = |s: &mut Stepping| match &s.client {
            Client::Action(goal) => goal.is_canceling(),
            Client::Service(_) => false,
        };
        if let Some(Stepping {
            done,
            total,
            client: Client::Action(goal),
        }) = self.stepping.take_if(cancelled)
        {
            goal.canceled(StepsOutcome {
                result: Outcome::new(
                    Outcome::OPERATION_FAILED,
                    format!("cancelled after {done} of {total} steps"),
                ),
            });
            self.pause(Phase::Paused);
        }
    }

    fn begin_steps(&mut self, total: u64, client: Client) {
        let refused = self
            .check_active()
            .err()
            .or_else(|| match (self.phase, &self.stepping) {
                (Phase::Paused, None) => None,
                (Phase::Paused, Some(other)) => Some(Outcome::new(
                    Outcome::OPERATION_FAILED,
                    format!(
                        "{} of {} other steps are still to be simulated",
                        other.total - other.done,
                        other.total
                    ),
                )),
                (phase, _) => Some(Outcome::new(
                    Outcome::OPERATION_FAILED,
                    format!(
                        "the simulation is {}; pause it first (set_simulation_state)",
                        phase.name()
                    ),
                )),
            });
        match refused {
            Some(problem) => client.end(problem),
            None if total == 0 => client.end(Outcome::ok()),
            None => {
                self.stepping = Some(Stepping {
                    done: 0,
                    total,
                    client,
                });
            }
        }
    }

    /// Time has gone on by a step.
    pub(in crate::nodes::dynamics) fn count_step(&mut self) {
        let Some(stepping) = &mut self.stepping else {
            return;
        };
        stepping.done += 1;
        if let Client::Action(goal) = &stepping.client {
            goal.feedback(Feedback {
                completed_steps: stepping.done,
                remaining_steps: stepping.total - stepping.done,
            });
        }
        if let Some(stepping) = self.stepping.take_if(|s| s.done == s.total) {
            stepping.client.end(Outcome::ok());
            self.pause(Phase::Paused);
        }
    }

    /// Gives up steps that are still to be simulated.
    pub(in crate::nodes::dynamics) fn end_steps(&mut self, reason: &str) {
        if let Some(stepping) = self.stepping.take() {
            let text = format!(
                "{reason} after {} of {} steps",
                stepping.done, stepping.total
            );
            let result = Outcome::new(Outcome::OPERATION_FAILED, text);
            stepping.client.end(result);
        }
    }
}
