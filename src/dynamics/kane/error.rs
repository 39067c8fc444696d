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
    /// The loop's own hinges cannot meet so many constraints.
    #[error(
        "cut {cut} constrains {constraints} directions, but its loop has only {hinges} hinges besides; \
         leave out directions that the hinges never move in"
    )]
    OverConstrained {
        /// The cut.
        cut: usize,
        /// Constrained directions.
        constraints: usize,
        /// Hinges on the loop, the cut not counted.
        hinges: usize,
    },
    /// All loops together have fewer hinges than constraints.
    #[error(
        "{constraints} constrained directions in all cuts, but their loops have only {hinges} hinges besides; \
         leave out directions that the hinges never move in"
    )]
    TooManyConstraints {
        /// Constrained directions of all cuts.
        constraints: usize,
        /// Hinges on at least one loop.
        hinges: usize,
    },
}
