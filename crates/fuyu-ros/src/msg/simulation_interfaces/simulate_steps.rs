//! The action that steps a paused simulation.

use super::Result;

crate::action! {
    package simulation_interfaces;

    /// Steps a paused simulation with feedback after every step; can be cancelled.
    action SimulateSteps {
        goal {
            /// How many steps.
            steps: u64,
        }
        outcome {
            /// Outcome.
            result: Result,
        }
        feedback {
            /// Steps done.
            completed_steps: u64,
            /// Steps to do.
            remaining_steps: u64,
        }
    }
}
