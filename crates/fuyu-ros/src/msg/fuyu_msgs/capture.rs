//! The action that captures a target.

use crate::msg::std_msgs::Header;

crate::action! {
    package fuyu_msgs;

    /// Captures a target: observe, plan, approach, grasp, detumble, identify.
    action Capture {
        goal {
            /// Name of the target; empty is the one that the node observes.
            target: String,
        }
        outcome {
            /// Whether the target is held and all phases have ended.
            captured: bool,
            /// How it ended.
            reason: String,
            /// Identified mass of the target \[kg\]; zero if it was not identified.
            mass: f64,
            /// Names of the phases.
            phases: Vec<String>,
            /// How long each took \[s\].
            durations: Vec<f64>,
        }
        feedback {
            /// Time of the state.
            header: Header,
            /// The present phase: observe, plan, approach, grasp, detumble or identify.
            phase: String,
            /// What of it is done, from 0 to 1.
            progress: f64,
            /// What it waits for; empty if it does not wait.
            waits_for: String,
            /// Whether an operator has paused it.
            is_held: bool,
        }
    }
}
