//! The state machine of managed nodes, as in rcl.

use crate::msg::lifecycle_msgs::{
    State, Transition as Way, TransitionDescription, services::ChangeStateRequest,
};

/// States by number, with the names of rcl.
pub(super) const STATES: [(u8, &str); 11] = [
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

pub(super) const SUCCESS: &str = "transition_success";
pub(super) const FAILURE: &str = "transition_failure";
const ERROR: &str = "transition_error";

/// Transitions of rcl's state machine: number, name, start state, goal state. Error processing ([`ERRORS`]) is omitted:
/// here an error counts as a failed transition.
pub(super) const GRAPH: [(u8, &str, u8, u8); 17] = {
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
    [
        (
            W::TRANSITION_CONFIGURE,
            "configure",
            unconfigured,
            configuring,
        ),
        (
            W::TRANSITION_ON_CONFIGURE_SUCCESS,
            SUCCESS,
            configuring,
            inactive,
        ),
        (
            W::TRANSITION_ON_CONFIGURE_FAILURE,
            FAILURE,
            configuring,
            unconfigured,
        ),
        (W::TRANSITION_CLEANUP, "cleanup", inactive, cleaning),
        (
            W::TRANSITION_ON_CLEANUP_SUCCESS,
            SUCCESS,
            cleaning,
            unconfigured,
        ),
        (
            W::TRANSITION_ON_CLEANUP_FAILURE,
            FAILURE,
            cleaning,
            inactive,
        ),
        (W::TRANSITION_ACTIVATE, "activate", inactive, activating),
        (
            W::TRANSITION_ON_ACTIVATE_SUCCESS,
            SUCCESS,
            activating,
            active,
        ),
        (
            W::TRANSITION_ON_ACTIVATE_FAILURE,
            FAILURE,
            activating,
            inactive,
        ),
        (W::TRANSITION_DEACTIVATE, "deactivate", active, deactivating),
        (
            W::TRANSITION_ON_DEACTIVATE_SUCCESS,
            SUCCESS,
            deactivating,
            inactive,
        ),
        (
            W::TRANSITION_ON_DEACTIVATE_FAILURE,
            FAILURE,
            deactivating,
            active,
        ),
        (
            W::TRANSITION_UNCONFIGURED_SHUTDOWN,
            "shutdown",
            unconfigured,
            shutting,
        ),
        (
            W::TRANSITION_INACTIVE_SHUTDOWN,
            "shutdown",
            inactive,
            shutting,
        ),
        (W::TRANSITION_ACTIVE_SHUTDOWN, "shutdown", active, shutting),
        (
            W::TRANSITION_ON_SHUTDOWN_SUCCESS,
            SUCCESS,
            shutting,
            finalized,
        ),
        (
            W::TRANSITION_ON_SHUTDOWN_FAILURE,
            FAILURE,
            shutting,
            finalized,
        ),
    ]
};

/// Transitions of rcl's state machine that [`GRAPH`] omits. They never occur here, but clients that query the graph
/// expect them.
pub(super) const ERRORS: [(u8, &str, u8, u8); 8] = {
    use State as S;
    use Way as W;
    let errors = S::TRANSITION_STATE_ERRORPROCESSING;
    [
        (
            W::TRANSITION_ON_CONFIGURE_ERROR,
            ERROR,
            S::TRANSITION_STATE_CONFIGURING,
            errors,
        ),
        (
            W::TRANSITION_ON_CLEANUP_ERROR,
            ERROR,
            S::TRANSITION_STATE_CLEANINGUP,
            errors,
        ),
        (
            W::TRANSITION_ON_ACTIVATE_ERROR,
            ERROR,
            S::TRANSITION_STATE_ACTIVATING,
            errors,
        ),
        (
            W::TRANSITION_ON_DEACTIVATE_ERROR,
            ERROR,
            S::TRANSITION_STATE_DEACTIVATING,
            errors,
        ),
        (
            W::TRANSITION_ON_SHUTDOWN_ERROR,
            ERROR,
            S::TRANSITION_STATE_SHUTTINGDOWN,
            errors,
        ),
        (
            W::TRANSITION_ON_ERROR_SUCCESS,
            SUCCESS,
            errors,
            S::PRIMARY_STATE_UNCONFIGURED,
        ),
        (
            W::TRANSITION_ON_ERROR_FAILURE,
            FAILURE,
            errors,
            S::PRIMARY_STATE_FINALIZED,
        ),
        (
            W::TRANSITION_ON_ERROR_ERROR,
            ERROR,
            errors,
            S::PRIMARY_STATE_FINALIZED,
        ),
    ]
};

/// A transition: number, name, start state, goal state.
pub(super) type Edge = (u8, &'static str, u8, u8);

/// The transition called `label` that starts in state `from`.
pub(super) fn edge(label: &str, from: u8) -> Option<Edge> {
    GRAPH
        .into_iter()
        .find(|&(_, name, start, _)| name == label && start == from)
}

/// The transition that a client requests: by name if one is given, otherwise by number.
pub(super) fn requested(request: &ChangeStateRequest, from: u8) -> Result<Edge, String> {
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

pub(super) fn available(from: u8) -> impl Iterator<Item = Edge> {
    GRAPH
        .into_iter()
        .filter(move |&(_, _, start, _)| start == from)
}

fn name_of(id: u8) -> &'static str {
    STATES.iter().find(|s| s.0 == id).map_or("unknown", |s| s.1)
}

pub(super) fn state(id: u8) -> State {
    State {
        id,
        label: name_of(id).to_owned(),
    }
}

pub(super) fn describe((id, label, from, to): Edge) -> TransitionDescription {
    TransitionDescription {
        transition: Way {
            id,
            label: label.to_owned(),
        },
        start_state: state(from),
        goal_state: state(to),
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

    // Fails if a transition is possible from a state in which it does not start.
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
            Err(
                "no transition 3 leads out of state unconfigured; there is configure, shutdown"
                    .into()
            )
        );
        assert!(to(ask(0, "fly")).unwrap_err().contains("'fly'"));
        // Clients may not request the transitions that are outcomes of callbacks.
        let inside = State::TRANSITION_STATE_CONFIGURING;
        assert!(requested(&ask(10, ""), inside).is_err());
    }

    #[test]
    fn every_way_ends_in_states_that_there_are() {
        for (number, _, from, to) in GRAPH.into_iter().chain(ERRORS) {
            for id in [from, to] {
                assert!(STATES.iter().any(|s| s.0 == id), "{number}: {id}");
            }
        }
    }
}
