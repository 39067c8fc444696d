//! What cannot be a cut hinge.

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
    /// The cut names a body that the model does not have.
    #[error("cut {cut} is on body {body}, but the model's bodies are 0 to {}", bodies - 1)]
    NoSuchBody {
        /// The cut.
        cut: usize,
        /// The body it names.
        body: usize,
        /// How many bodies there are.
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
    /// The hinges cannot meet so many constraints, of this cut alone or together with those before it.
    #[error(
        "cut {cut} over-constrains its loop: {hinges} hinges cannot meet {constraints} constrained directions; \
         leave out directions in which those hinges never move"
    )]
    OverConstrained {
        /// The cut.
        cut: usize,
        /// As many constrained directions as are too many (there may be more).
        constraints: usize,
        /// All the hinges that they move with.
        hinges: usize,
    },
}
