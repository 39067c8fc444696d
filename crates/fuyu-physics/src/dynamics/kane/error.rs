//! Errors in cut hinges.

/// Why loops cannot be closed by the given cuts. Cuts are counted from 0, in the order given.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CutError {
    /// The cut leaves every direction free.
    #[error(
        "cut {cut} constrains no direction; it needs at least one translation or rotation, or should be left out"
    )]
    Unconstrained {
        /// The cut.
        cut: usize,
    },
    /// The model does not have the cut's body.
    #[error("cut {cut} is on body {body}, but the model's bodies are 0 to {}", bodies - 1)]
    NoSuchBody {
        /// The cut.
        cut: usize,
        /// Index of the body.
        body: usize,
        /// Number of bodies.
        bodies: usize,
    },
    /// Both sides of the cut are on one body.
    #[error("cut {cut} connects {body} with itself; a loop needs two bodies")]
    SameBody {
        /// The cut.
        cut: usize,
        /// The body's name.
        body: String,
    },
    /// A frame of the cut has a component that is not finite.
    #[error("cut {cut} has a frame on {body} that is not finite")]
    NotFinite {
        /// The cut.
        cut: usize,
        /// The name of the body whose frame it is.
        body: String,
    },
    /// The hinges cannot satisfy the constraints of this cut, alone or together with those of earlier cuts.
    #[error(
        "cut {cut} over-constrains its loop: {hinges} hinges cannot satisfy {constraints} constrained directions; \
         leave out directions in which those hinges never move"
    )]
    OverConstrained {
        /// The cut.
        cut: usize,
        /// Smallest number of constrained directions that is too large (there may be more).
        constraints: usize,
        /// Number of hinges that move them.
        hinges: usize,
    },
}
