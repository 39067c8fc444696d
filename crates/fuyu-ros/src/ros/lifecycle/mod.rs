//! Managed (lifecycle) nodes, with the services and states of rclcpp lifecycle nodes.

mod state_machine;

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
        ChangeState, ChangeStateResponse, GetAvailableStates, GetAvailableStatesResponse,
        GetAvailableTransitions, GetAvailableTransitionsResponse, GetState, GetStateResponse,
    },
};
use state_machine::{
    ERRORS, Edge, FAILURE, GRAPH, STATES, SUCCESS, available, describe, edge, requested, state,
};

/// A transition that the program carries out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transition {
    /// Create endpoints and other resources.
    Configure,
    /// Release the resources.
    CleanUp,
    /// Start working.
    Activate,
    /// Stop working.
    Deactivate,
    /// Stop and release everything, for good.
    Shutdown,
}

/// Primary state of a managed node, a node with a lifecycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LifecycleState {
    /// Only parameters and lifecycle services exist.
    Unconfigured,
    /// Configured, but not working.
    Inactive,
    /// Working.
    Active,
    /// Ended for good.
    Finalized,
}

impl LifecycleState {
    fn of(id: u8) -> Self {
        match id {
            State::PRIMARY_STATE_INACTIVE => Self::Inactive,
            State::PRIMARY_STATE_ACTIVE => Self::Active,
            State::PRIMARY_STATE_FINALIZED => Self::Finalized,
            _ => Self::Unconfigured,
        }
    }
}

/// Lifecycle of a managed node. Its program calls [`Self::follow`] often, to carry out the requested transitions.
pub struct Lifecycle {
    node: Node,
    state: Arc<AtomicU8>,
    changes: Calls<ChangeState>,
    events: Publisher<TransitionEvent>,
    _services: [ServiceServer; 4],
}

impl Lifecycle {
    /// Declares and reads the parameter that determines whether the node configures and activates itself.
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

    /// Lifecycle of a node that is unconfigured; creates its services.
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
                    transitions([&GRAPH[..], &ERRORS].concat())
                })?,
            ],
            state: now,
            node: node.clone(),
        })
    }

    /// Present state of the node.
    pub fn state(&self) -> LifecycleState {
        LifecycleState::of(self.now())
    }

    /// Whether the node is active.
    pub fn is_active(&self) -> bool {
        self.state() == LifecycleState::Active
    }

    /// Whether a transition has been requested.
    pub fn is_asked(&self) -> bool {
        !self.changes.is_empty()
    }

    /// Carries out the transitions that clients have requested; `work` performs each. If `work` fails, the error is
    /// logged, and the node stays in its state (or is finalized, for a shutdown).
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
    /// The error of `work`.
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

    /// Performs a transition with its callback and enters the resulting state.
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
