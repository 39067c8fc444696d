//! ROS package [`lifecycle_msgs`](https://docs.ros.org/en/jazzy/p/lifecycle_msgs/): managed nodes.

crate::messages! {
    package lifecycle_msgs;

    /// A state of a managed node.
    message State {
        /// One of the constants.
        id: u8,
        /// Name.
        label: String,
    }
    constants {
        /// Never set.
        PRIMARY_STATE_UNKNOWN: u8 = 0,
        /// Nothing is set up.
        PRIMARY_STATE_UNCONFIGURED: u8 = 1,
        /// Set up, but it does nothing.
        PRIMARY_STATE_INACTIVE: u8 = 2,
        /// At work.
        PRIMARY_STATE_ACTIVE: u8 = 3,
        /// At its end.
        PRIMARY_STATE_FINALIZED: u8 = 4,
        /// Being set up.
        TRANSITION_STATE_CONFIGURING: u8 = 10,
        /// Being taken down.
        TRANSITION_STATE_CLEANINGUP: u8 = 11,
        /// On its way to the end.
        TRANSITION_STATE_SHUTTINGDOWN: u8 = 12,
        /// Starting work.
        TRANSITION_STATE_ACTIVATING: u8 = 13,
        /// Ending work.
        TRANSITION_STATE_DEACTIVATING: u8 = 14,
        /// Recovering from an error.
        TRANSITION_STATE_ERRORPROCESSING: u8 = 15,
    }

    /// A way from state to state.
    message Transition {
        /// One of the constants.
        id: u8,
        /// Name.
        label: String,
    }
    constants {
        /// Only when a node is made.
        TRANSITION_CREATE: u8 = 0,
        /// Sets up.
        TRANSITION_CONFIGURE: u8 = 1,
        /// Takes down.
        TRANSITION_CLEANUP: u8 = 2,
        /// Starts work.
        TRANSITION_ACTIVATE: u8 = 3,
        /// Ends work.
        TRANSITION_DEACTIVATE: u8 = 4,
        /// Ends an unconfigured node.
        TRANSITION_UNCONFIGURED_SHUTDOWN: u8 = 5,
        /// Ends an inactive node.
        TRANSITION_INACTIVE_SHUTDOWN: u8 = 6,
        /// Ends an active node.
        TRANSITION_ACTIVE_SHUTDOWN: u8 = 7,
        /// Destroys the node.
        TRANSITION_DESTROY: u8 = 8,
        /// The node's work on a transition is done.
        TRANSITION_ON_CONFIGURE_SUCCESS: u8 = 10,
        /// It could not be done.
        TRANSITION_ON_CONFIGURE_FAILURE: u8 = 11,
        /// It went wrong.
        TRANSITION_ON_CONFIGURE_ERROR: u8 = 12,
        /// As for configure.
        TRANSITION_ON_CLEANUP_SUCCESS: u8 = 20,
        /// As for configure.
        TRANSITION_ON_CLEANUP_FAILURE: u8 = 21,
        /// As for configure.
        TRANSITION_ON_CLEANUP_ERROR: u8 = 22,
        /// As for configure.
        TRANSITION_ON_ACTIVATE_SUCCESS: u8 = 30,
        /// As for configure.
        TRANSITION_ON_ACTIVATE_FAILURE: u8 = 31,
        /// As for configure.
        TRANSITION_ON_ACTIVATE_ERROR: u8 = 32,
        /// As for configure.
        TRANSITION_ON_DEACTIVATE_SUCCESS: u8 = 40,
        /// As for configure.
        TRANSITION_ON_DEACTIVATE_FAILURE: u8 = 41,
        /// As for configure.
        TRANSITION_ON_DEACTIVATE_ERROR: u8 = 42,
        /// As for configure.
        TRANSITION_ON_SHUTDOWN_SUCCESS: u8 = 50,
        /// As for configure.
        TRANSITION_ON_SHUTDOWN_FAILURE: u8 = 51,
        /// As for configure.
        TRANSITION_ON_SHUTDOWN_ERROR: u8 = 52,
        /// The error was dealt with.
        TRANSITION_ON_ERROR_SUCCESS: u8 = 60,
        /// It was not.
        TRANSITION_ON_ERROR_FAILURE: u8 = 61,
        /// That went wrong too.
        TRANSITION_ON_ERROR_ERROR: u8 = 62,
        /// The outcome of a callback.
        TRANSITION_CALLBACK_SUCCESS: u8 = 97,
        /// The outcome of a callback.
        TRANSITION_CALLBACK_FAILURE: u8 = 98,
        /// The outcome of a callback.
        TRANSITION_CALLBACK_ERROR: u8 = 99,
    }

    /// A transition with the states at its ends.
    message TransitionDescription {
        /// The way.
        transition: Transition,
        /// From here.
        start_state: State,
        /// To there.
        goal_state: State,
    }

    /// A transition that has happened.
    message TransitionEvent {
        /// When \[ns\].
        timestamp: u64,
        /// The way.
        transition: Transition,
        /// From here.
        start_state: State,
        /// To there.
        goal_state: State,
    }
}

/// The services of a managed node.
pub mod services {
    use super::*;

    crate::services! {
        package lifecycle_msgs;

        /// Asks for a transition, by number or, if that is zero, by label.
        service ChangeState {
            ChangeStateRequest {
                /// Which.
                transition: Transition,
            }
            ChangeStateResponse {
                /// It was made.
                success: bool,
            }
        }

        /// Transitions that can be made; of `get_transition_graph` all that there are.
        service GetAvailableTransitions {
            GetAvailableTransitionsRequest {
                /// ROS sends one octet for an empty message.
                structure_needs_at_least_one_member: u8,
            }
            GetAvailableTransitionsResponse {
                /// The transitions.
                available_transitions: Vec<TransitionDescription>,
            }
        }

        /// States that there are.
        service GetAvailableStates {
            GetAvailableStatesRequest {
                /// ROS sends one octet for an empty message.
                structure_needs_at_least_one_member: u8,
            }
            GetAvailableStatesResponse {
                /// The states.
                available_states: Vec<State>,
            }
        }

        /// The present state.
        service GetState {
            GetStateRequest {
                /// ROS sends one octet for an empty message.
                structure_needs_at_least_one_member: u8,
            }
            GetStateResponse {
                /// The state.
                current_state: State,
            }
        }
    }
}
