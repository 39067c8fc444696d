//! Errors in the description and in the simulation of contacts.

use super::law::LawError;

/// Why a pair of colliders is refused, the initial state is refused, or the integration fails.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ContactError {
    /// A parameter of the law is out of range.
    #[error("contact of {first} and {second}: {problem}")]
    Law {
        /// First body.
        first: String,
        /// Second body.
        second: String,
        /// What is wrong.
        problem: LawError,
    },
    /// Both colliders are on one body, or both are half-spaces.
    #[error("{first} and {second} cannot touch each other: {reason}")]
    Pair {
        /// First body.
        first: String,
        /// Second body.
        second: String,
        /// Why not.
        reason: &'static str,
    },
    /// The motion cannot be integrated.
    #[error(
        "contact at {time} s cannot be integrated to the tolerance: states or efforts are not finite, or the law is too stiff; \
         raise the tolerance or the stiction speed, or lower the stiffness"
    )]
    NotConverged {
        /// Time \[s\].
        time: f64,
    },
    /// Two bodies overlap at the start.
    #[error("{first} and {second} overlap by {depth:.2e} m at the start; move them apart")]
    Overlap {
        /// First body.
        first: String,
        /// Second body.
        second: String,
        /// Depth \[m\].
        depth: f64,
    },
}
