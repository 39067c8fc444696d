//! Managed nodes: a node's program sets up, starts, stops and takes down its work when it is told to, by the
//! services and in the states that rclcpp's lifecycle nodes have.

use std::sync::{
    Arc,
    atomic::{AtomicU8, Ordering},
};

use super::{
    Declare, Node, NodeError, Publisher, Qos, Time,
    service::{Calls, ServiceServer},
};
use crate::msg::lifecycle_msgs::{
    State, Transition as Way, TransitionDescription, TransitionEvent,
    services::{
        ChangeState, ChangeStateRequest, ChangeStateResponse, GetAvailableStates,
        GetAvailableStatesResponse, GetAvailableTransitions, GetAvailableTransitionsResponse,
        GetState, GetStateResponse,
    },
};

/// What a node is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transition {
    /// Make endpoints and whatever the work needs.
    Configure,
    /// Let go of it.
    CleanUp,
    /// Start to work.
    Activate,
    /// Stop.
    Deactivate,
    /// Stop and let go, for good.
    Shutdown,
}

/// Where a node is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// It has nothing but its parameters and these services.
    Unconfigured,
    /// It is set up but does nothing.
    Inactive,
    /// It works.
    Active,
    /// It will do nothing any more.
    Finalized,
}

impl Stage {
    fn of(id: u8) -> Self {
        match id {
            State::PRIMARY_STATE_INACTIVE => Self::Inactive,
            State::PRIMARY_STATE_ACTIVE => Self::Active,
            State::PRIMARY_STATE_FINALIZED => Self::Finalized,
            _ => Self::Unconfigured,
        }
    }
}

/// States by number, as rcl registers and names them.
const STATES: [(u8, &str); 11] = [
    (State::PRIMARY_STATE_UNKNOWN, "unknown"),
    (State::PRIMARY_STATE_UNCONFIGURED, "unconfigured"),
    (State::PRIMARY_STATE_INACTIVE, "inactive"),
    (State::PRIMARY_STATE_ACTIVE, "active"),
    (State::PRIMARY_STATE_FINALIZED, "finalized"),
    (State::TRANSITION_STATE_CONFIGURING, "configuring"),
    (State::TRANSITION_STATE_CLEANINGUP, "cleaningup"),
    (State::TRANSITION_STATE_SHUTTINGDOWN, "shuttingdown"),
    (State::TRANSITION_STATE_ACTIVATING, "activating"),
    (State::TRANSITION_STATE_DEACTIVATING, "deactivating"),
    (State::TRANSITION_STATE_ERRORPROCESSING, "errorprocessing"),
];

const SUCCESS: &str = "transition_success";
const FAILURE: &str = "transition_failure";
const ERROR: &str = "transition_error";

/// The state machine of rcl: number, name, from, to.
const GRAPH: [(u8, &str, u8, u8); 25] = {
    use State as S;
    use Way as W;
    let unconfigured = S::PRIMARY_STATE_UNCONFIGURED;
    let inactive = S::PRIMARY_STATE_INACTIVE;
    let active = S::PRIMARY_STATE_ACTIVE;
    let finalized = S::PRIMARY_STATE_FINALIZED;
    let configuring = S::TRANSITION_STATE_CONFIGURING;
    let cleaning = S::TRANSITION_STATE_CLEANINGUP;
    let shutting = S::TRANSITION_STATE_SHUTTINGDOWN;
    let activating = S::TRANSITION_STATE_ACTIVATING;
    let deactivating = S::TRANSITION_STATE_DEACTIVATING;
    let error = S::TRANSITION_STATE_ERRORPROCESSING;
    [
        (W::TRANSITION_CONFIGURE, "configure", unconfigured, configuring),
        (W::TRANSITION_ON_CONFIGURE_SUCCESS, SUCCESS, configuring, inactive),
        (W::TRANSITION_ON_CONFIGURE_FAILURE, FAILURE, configuring, unconfigured),
        (W::TRANSITION_ON_CONFIGURE_ERROR, ERROR, configuring, error),
        (W::TRANSITION_CLEANUP, "cleanup", inactive, cleaning),
        (W::TRANSITION_ON_CLEANUP_SUCCESS, SUCCESS, cleaning, unconfigured),
        (W::TRANSITION_ON_CLEANUP_FAILURE, FAILURE, cleaning, inactive),
        (W::TRANSITION_ON_CLEANUP_ERROR, ERROR, cleaning, error),
        (W::TRANSITION_ACTIVATE, "activate", inactive, activating),
        (W::TRANSITION_ON_ACTIVATE_SUCCESS, SUCCESS, activating, active),
        (W::TRANSITION_ON_ACTIVATE_FAILURE, FAILURE, activating, inactive),
        (W::TRANSITION_ON_ACTIVATE_ERROR, ERROR, activating, error),
        (W::TRANSITION_DEACTIVATE, "deactivate", active, deactivating),
        (W::TRANSITION_ON_DEACTIVATE_SUCCESS, SUCCESS, deactivating, inactive),
        (W::TRANSITION_ON_DEACTIVATE_FAILURE, FAILURE, deactivating, active),
        (W::TRANSITION_ON_DEACTIVATE_ERROR, ERROR, deactivating, error),
        (W::TRANSITION_UNCONFIGURED_SHUTDOWN, "shutdown", unconfigured, shutting),
        (W::TRANSITION_INACTIVE_SHUTDOWN, "shutdown", inactive, shutting),
        (W::TRANSITION_ACTIVE_SHUTDOWN, "shutdown", active, shutting),
        (W::TRANSITION_ON_SHUTDOWN_SUCCESS, SUCCESS, shutting, finalized),
        (W::TRANSITION_ON_SHUTDOWN_FAILURE, FAILURE, shutting, finalized),
        (W::TRANSITION_ON_SHUTDOWN_ERROR, ERROR, shutting, error),
        (W::TRANSITION_ON_ERROR_SUCCESS, SUCCESS, error, unconfigured),
        (W::TRANSITION_ON_ERROR_FAILURE, FAILURE, error, finalized),
        (W::TRANSITION_ON_ERROR_ERROR, ERROR, error, finalized),
    ]
};

type Edge = (u8, &'static str, u8, u8);

/// The edge called `label` that leads out of state `from`.
fn edge(label: &str, from: u8) -> Option<Edge> {
    GRAPH
        .into_iter()
        .find(|&(_, name, start, _)| name == label && start == from)
}

/// What clients ask for: by name if there is one, else by number.
fn requested(request: &ChangeStateRequest, from: u8) -> Result<Edge, String> {
    let Way { id, label } = &request.transition;
    let asked = |&&(number, name, start, _): &&Edge| {
        let named = match label.as_str() {
            "" => number == *id,
            _ => name == label,
        };
        named && start == from && number < Way::TRANSITION_ON_CONFIGURE_SUCCESS
    };
    GRAPH.iter().find(asked).copied().ok_or_else(|| {
        let what = match label.as_str() {
            "" => format!("transition {id}"),
            _ => format!("transition '{label}'"),
        };
        let ways: Vec<_> = available(from).map(|(_, name, ..)| name).collect();
        format!(
            "no {what} leads out of state {}; there is {}",
            name_of(from),
            ways.join(", ")
        )
    })
}

fn available(from: u8) -> impl Iterator<Item = Edge> {
    GRAPH
        .into_iter()
        .filter(move |&(_, _, start, _)| start == from)
}

fn name_of(id: u8) -> &'static str {
    STATES.iter().find(|s| s.0 == id).map_or("unknown", |s| s.1)
}

fn state(id: u8) -> State {
    State {
        id,
        label: name_of(id).to_owned(),
    }
}

fn describe((id, label, from, to): Edge) -> TransitionDescription {
    TransitionDescription {
        transition: Way {
            id,
            label: label.to_owned(),
        },
        start_state: state(from),
        goal_state: state(to),
    }
}

/// The life of a managed node. Its program asks [`Self::follow`] often what clients want, and does it.
pub struct Lifecycle {
    node: Node,
    state: Arc<AtomicU8>,
    changes: Calls<ChangeState>,
    events: Publisher<TransitionEvent>,
    _services: [ServiceServer; 4],
}

impl Lifecycle {
    /// Declares whether a node configures and activates itself, and reads it.
    pub fn declare_autostart(declare: &mut Declare) -> bool {
        declare
            .param(
                "autostart",
                true,
                "Configure and activate the node at its start; else it waits for ~/change_state",
            )
            .read_only()
            .value()
    }

    /// An unconfigured node, with its services.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn new(node: &Node) -> Result<Self, NodeError> {
        let now = Arc::new(AtomicU8::new(State::PRIMARY_STATE_UNCONFIGURED));
        let (seen, leaving) = (Arc::clone(&now), Arc::clone(&now));
        let transitions = |edges: Vec<Edge>| GetAvailableTransitionsResponse {
            available_transitions: edges.into_iter().map(describe).collect(),
        };
        Ok(Self {
            changes: node.serve_calls("~/change_state")?,
            events: node.advertise("~/transition_event", Qos::RELIABLE)?,
            _services: [
                node.serve::<GetState>("~/get_state", move |_| GetStateResponse {
                    current_state: state(seen.load(Ordering::Acquire)),
                })?,
                node.serve::<GetAvailableStates>("~/get_available_states", |_| {
                    GetAvailableStatesResponse {
                        available_states: STATES.iter().map(|&(id, _)| state(id)).collect(),
                    }
                })?,
                node.serve::<GetAvailableTransitions>("~/get_available_transitions", move |_| {
                    transitions(available(leaving.load(Ordering::Acquire)).collect())
                })?,
                node.serve::<GetAvailableTransitions>("~/get_transition_graph", move |_| {
                    transitions(GRAPH.to_vec())
                })?,
            ],
            state: now,
            node: node.clone(),
        })
    }

    /// Where the node is.
    pub fn stage(&self) -> Stage {
        Stage::of(self.now())
    }

    /// Whether the node is to work.
    pub fn is_active(&self) -> bool {
        self.stage() == Stage::Active
    }

    /// Whether somebody waits for a transition.
    pub fn is_asked(&self) -> bool {
        !self.changes.is_empty()
    }

    /// Makes the transitions that clients ask for; `work` does each. What it cannot do leaves the node where it
    /// was (or finalized, for a shutdown), and is told in the log.
    pub fn follow(&self, mut work: impl FnMut(Transition) -> Result<(), NodeError>) {
        while let Some(call) = self.changes.take() {
            let outcome = match requested(&call.request, self.now()) {
                Ok(edge) => self.pass(edge, &mut work).map_err(|e| e.to_string()),
                Err(problem) => Err(problem),
            };
            if let Err(problem) = &outcome {
                tracing::warn!("node {}: {problem}", self.node.name());
            }
            let success = outcome.is_ok();
            call.reply.send(&ChangeStateResponse { success });
        }
    }

    /// Configures and activates an unconfigured node.
    ///
    /// # Errors
    /// What `work` could not do.
    pub fn start(
        &self,
        mut work: impl FnMut(Transition) -> Result<(), NodeError>,
    ) -> Result<(), NodeError> {
        for label in ["configure", "activate"] {
            if let Some(edge) = edge(label, self.now()) {
                self.pass(edge, &mut work)?;
            }
        }
        Ok(())
    }

    fn now(&self) -> u8 {
        self.state.load(Ordering::Acquire)
    }

    /// Goes along an edge, does what belongs to it, and goes on to where its outcome leads.
    fn pass(
        &self,
        way: Edge,
        work: &mut impl FnMut(Transition) -> Result<(), NodeError>,
    ) -> Result<(), NodeError> {
        self.go(way);
        let outcome = work(match way.0 {
            Way::TRANSITION_CONFIGURE => Transition::Configure,
            Way::TRANSITION_CLEANUP => Transition::CleanUp,
            Way::TRANSITION_ACTIVATE => Transition::Activate,
            Way::TRANSITION_DEACTIVATE => Transition::Deactivate,
            _ => Transition::Shutdown,
        });
        let label = match outcome {
            Ok(()) => SUCCESS,
            Err(_) => FAILURE,
        };
        if let Some(way) = edge(label, self.now()) {
            self.go(way);
        }
        outcome
    }

    fn go(&self, way: Edge) {
        self.state.store(way.3, Ordering::Release);
        let TransitionDescription {
            transition,
            start_state,
            goal_state,
        } = describe(way);
        self.events.publish(&TransitionEvent {
            timestamp: Time::wall().as_nanos().unsigned_abs(),
            transition,
            start_state,
            goal_state,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(id: u8, label: &str) -> ChangeStateRequest {
        ChangeStateRequest {
            transition: Way {
                id,
                label: label.to_owned(),
            },
        }
    }

    // Would break if a transition could be made from a state that it does not lead out of.
    #[test]
    fn transitions_lead_out_of_their_states_only() {
        let from = State::PRIMARY_STATE_UNCONFIGURED;
        let to = |request| requested(&request, from).map(|edge: Edge| edge.3);
        assert_eq!(to(ask(1, "")), Ok(State::TRANSITION_STATE_CONFIGURING));
        assert_eq!(
            to(ask(0, "shutdown")),
            Ok(State::TRANSITION_STATE_SHUTTINGDOWN)
        );
        assert_eq!(
            to(ask(3, "")),
            Err("no transition 3 leads out of state unconfigured; there is configure, shutdown".into())
        );
        assert!(to(ask(0, "fly")).unwrap_err().contains("'fly'"));
        // The outcome of a transition is not for clients to decide.
        let inside = State::TRANSITION_STATE_CONFIGURING;
        assert!(requested(&ask(10, ""), inside).is_err());
    }

    #[test]
    fn every_way_ends_in_states_that_there_are() {
        for (number, _, from, to) in GRAPH {
            for id in [from, to] {
                assert!(STATES.iter().any(|s| s.0 == id), "{number}: {id}");
            }
        }
    }
}
