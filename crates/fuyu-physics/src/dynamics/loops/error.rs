//! What can be wrong with closed loops.

/// Why a loop closure was refused. Displays as one line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LoopError {
    /// An end that the model does not have.
    #[error("loop closure '{closure}': there is no link '{frame}'; the links are {known}")]
    UnknownFrame {
        /// The closure.
        closure: String,
        /// The name given.
        frame: String,
        /// The names that exist.
        known: String,
    },
    /// Nothing to close.
    #[error(
        "loop closure '{0}' constrains no direction; give at least one of along_x, along_y, along_z, about_x, about_y, about_z"
    )]
    NoDirection(String),
    /// Both ends move as one.
    #[error(
        "loop closure '{closure}': '{frame_a}' and '{frame_b}' are on the same body '{body}', which no joint moves against itself; give frames of two bodies"
    )]
    SameBody {
        /// The closure.
        closure: String,
        /// First end.
        frame_a: String,
        /// Second end.
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
        /// The direction at fault.
        direction: &'static str,
        /// How far it is open.
        gap: f64,
        /// `m` or `rad`.
        unit: &'static str,
        /// What assembly accepts.
        limit: f64,
    },
    /// No joint positions near those given close the loop.
    #[error(
        "loop closure '{closure}' cannot be closed near the initial joint positions: {gap:.3e} {unit} are left {direction}"
    )]
    NotClosable {
        /// The closure.
        closure: String,
        /// The direction at fault.
        direction: &'static str,
        /// How far it stays open.
        gap: f64,
        /// `m` or `rad`.
        unit: &'static str,
    },
    /// The joint rates tear the loop open.
    #[error(
        "loop closure '{closure}' opens at {rate} {unit}/s {direction} with the initial joint rates; up to {limit} {unit}/s is taken off them"
    )]
    Opening {
        /// The closure.
        closure: String,
        /// The direction at fault.
        direction: &'static str,
        /// How fast.
        rate: f64,
        /// `m` or `rad`.
        unit: &'static str,
        /// What assembly accepts.
        limit: f64,
    },
    /// Nothing can move any more.
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
