//! Requests for steps of a paused simulation, by a service and an action.

use crate::{
    msg::simulation_interfaces::{
        Result as Outcome,
        services::{StepSimulation, StepSimulationResponse},
        simulate_steps::{Feedback, Outcome as StepsOutcome, SimulateSteps},
    },
    nodes::dynamics::clock::Phase,
    ros::{ActionServer, Calls, Goal, Node, NodeError, Reply},
};

/// Maximum number of steps per request. More would keep other clients waiting for hours.
const MAX_STEPS: u64 = 1_000_000;

/// The service, the action and the pending request. There is at most one pending request.
pub struct StepRequests {
    service: Calls<StepSimulation>,
    action: ActionServer<SimulateSteps>,
    pending: Option<StepRequest>,
}

/// Pending request for steps.
struct StepRequest {
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

impl StepRequests {
    /// Advertises service and action.
    ///
    /// # Errors
    /// When DDS reports an error.
    pub fn new(node: &Node) -> Result<Self, NodeError> {
        Ok(Self {
            service: node.serve_calls("~/step_simulation")?,
            action: ActionServer::new(node, "~/simulate_steps")?,
            pending: None,
        })
    }

    /// Whether a request for steps is pending.
    pub fn is_pending(&self) -> bool {
        self.pending.is_some()
    }

    /// Accepts or refuses new requests, depending on the simulation's phase and on `active`, an error if steps are not
    /// allowed. Ends the pending request if it was cancelled, and returns whether it was.
    pub(super) fn take_requests(&mut self, phase: Phase, active: &Result<(), Outcome>) -> bool {
        while let Some(call) = self.service.take() {
            self.begin(
                call.request.steps,
                Client::Service(call.reply),
                phase,
                active,
            );
        }
        while let Some(goal) = self.action.take() {
            self.begin(goal.goal.steps, Client::Action(goal), phase, active);
        }
        let is_cancelled = |request: &mut StepRequest| match &request.client {
            Client::Action(goal) => goal.is_canceling(),
            Client::Service(_) => false,
        };
        let Some(StepRequest {
            done,
            total,
            client: Client::Action(goal),
        }) = self.pending.take_if(is_cancelled)
        else {
            return false;
        };
        goal.canceled(StepsOutcome {
            result: Outcome::new(
                Outcome::OPERATION_FAILED,
                format!("cancelled after {done} of {total} steps"),
            ),
        });
        true
    }

    fn begin(&mut self, total: u64, client: Client, phase: Phase, active: &Result<(), Outcome>) {
        let refused = active
            .clone()
            .err()
            .or_else(|| match (phase, &self.pending) {
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
        let refused = refused.or_else(|| too_many(total));
        match refused {
            Some(problem) => client.end(problem),
            None if total == 0 => client.end(Outcome::ok()),
            None => {
                self.pending = Some(StepRequest {
                    done: 0,
                    total,
                    client,
                });
            }
        }
    }

    /// Counts a simulated step, and sends feedback. After the last requested step, answers the client and returns true.
    pub fn count(&mut self) -> bool {
        let Some(request) = &mut self.pending else {
            return false;
        };
        request.done += 1;
        if let Client::Action(goal) = &request.client {
            goal.feedback(Feedback {
                completed_steps: request.done,
                remaining_steps: request.total - request.done,
            });
        }
        let finished = self.pending.take_if(|s| s.done == s.total);
        let is_finished = finished.is_some();
        if let Some(request) = finished {
            request.client.end(Outcome::ok());
        }
        is_finished
    }

    /// Ends the pending request early with an error.
    pub fn end(&mut self, reason: &str) {
        if let Some(request) = self.pending.take() {
            let text = format!("{reason} after {} of {} steps", request.done, request.total);
            let result = Outcome::new(Outcome::OPERATION_FAILED, text);
            request.client.end(result);
        }
    }
}

/// The error for a request for `total` steps, if that is too many.
fn too_many(total: u64) -> Option<Outcome> {
    (total > MAX_STEPS).then(|| {
        Outcome::new(
            Outcome::OPERATION_FAILED,
            format!("{total} steps are too many for one request; ask for at most {MAX_STEPS}"),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    // Would break if one client could occupy the simulation for centuries.
    #[test]
    fn the_number_of_steps_is_limited() {
        assert_eq!(too_many(MAX_STEPS), None);
        let refused = too_many(u64::MAX).unwrap();
        assert_eq!(refused.result, Outcome::OPERATION_FAILED);
        assert!(refused.error_message.contains("at most 1000000"));
    }
}
