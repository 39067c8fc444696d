//! Errors in closed loops.

/// Why a loop closure was rejected. Displays as one line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LoopError {
    /// A frame that the model does not have.
    #[error("loop closure '{closure}': there is no link '{frame}'; the links are {known}")]
    UnknownFrame {
        /// The closure.
        closure: String,
        /// The name given.
        frame: String,
        /// The names that exist.
        known: String,
    },
    /// No constrained direction.
    #[error(
        "loop closure '{0}' constrains no direction; give at least one of along_x, along_y, along_z, about_x, about_y, about_z"
    )]
    NoDirection(String),
    /// Both frames are fixed to the same body.
    #[error(
        "loop closure '{closure}': '{frame_a}' and '{frame_b}' are on the same body '{body}'; give frames of two bodies"
    )]
    SameBody {
        /// The closure.
        closure: String,
        /// Frame A.
        frame_a: String,
        /// Frame B.
        frame_b: String,
        /// The body that carries both.
        body: String,
    },
    /// Two closures with one name.
    #[error("loop closure '{0}' is given twice; names must differ")]
    DuplicateName(String),
    /// The joints do not close the loop.
    #[error(
        "loop closure '{closure}' is open by {gap} {unit} {direction} at the initial joint positions; up to {limit} {unit} is closed by moving the joints"
    )]
    Open {
        /// The closure.
        closure: String,
        /// Its direction.
        direction: &'static str,
        /// Its gap.
        gap: f64,
        /// `m` or `rad`.
        unit: &'static str,
        /// Tolerance of the assembly.
        limit: f64,
    },
    /// No joint positions near those given close the loop.
    #[error(
        "loop closure '{closure}' cannot be closed near the initial joint positions: a gap of {gap:.3e} {unit} {direction} is left"
    )]
    NotClosable {
        /// The closure.
        closure: String,
        /// Its direction.
        direction: &'static str,
        /// The gap that is left.
        gap: f64,
        /// `m` or `rad`.
        unit: &'static str,
    },
    /// The joint rates violate the constraints.
    #[error(
        "loop closure '{closure}' opens at {rate} {unit}/s {direction} with the initial joint rates; up to {limit} {unit}/s is removed from them"
    )]
    Opening {
        /// The closure.
        closure: String,
        /// Its direction.
        direction: &'static str,
        /// Rate across the constraint.
        rate: f64,
        /// `m` or `rad`.
        unit: &'static str,
        /// Tolerance of the assembly.
        limit: f64,
    },
    /// All joints are locked.
    #[error(
        "the loop closures ({closures}) lock all {joints} joints: they take away {rank} degrees of freedom; constrain fewer directions"
    )]
    Locked {
        /// Their names.
        closures: String,
        /// Number of joints.
        joints: usize,
        /// Independent constraints.
        rank: usize,
    },
}
