//! What can be wrong with a description of a system.

use super::Axis;
use crate::spatial::InertiaError;

/// Why a [`super::SystemBuilder`] or a [`super::System`] refuses what it was given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SystemError {
    /// There is nothing to move.
    #[error("the system has no bodies")]
    NoBodies,
    /// A name is empty, or is the one that stands for inertial space.
    #[error("a {kind} cannot be named \"{name}\"")]
    Name {
        /// `"body"` or `"hinge"`.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// Two bodies or two hinges have one name.
    #[error("two {kind} are named `{name}`")]
    DuplicateName {
        /// `"bodies"` or `"hinges"`.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A body's mass properties are those of no real body.
    #[error("body `{body}`: {problem}")]
    Inertia {
        /// The body.
        body: String,
        /// What is wrong with it.
        problem: InertiaError,
    },
    /// A hinge joins a body that does not exist.
    #[error("hinge `{hinge}` joins `{body}`, which is no body of the system")]
    UnknownBody {
        /// The hinge.
        hinge: String,
        /// The name that it gives.
        body: String,
    },
    /// A hinge joins a body to itself.
    #[error("hinge `{hinge}` joins `{body}` to itself")]
    SameBody {
        /// The hinge.
        hinge: String,
        /// The body.
        body: String,
    },
    /// A number of a hinge is not finite, or negative where it must not be.
    #[error("hinge `{hinge}`: {what} is {value}; it must be {expected}")]
    Value {
        /// The hinge.
        hinge: String,
        /// Which number.
        what: String,
        /// Its value.
        value: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// Something that only a free axis has is given for a constrained one.
    #[error("hinge `{hinge}`: {what} on {axis}, which the hinge constrains")]
    Constrained {
        /// The hinge.
        hinge: String,
        /// The axis.
        axis: Axis,
        /// What was given: a spring, a damper or a start value.
        what: &'static str,
    },
    /// No chain of hinges leads from inertial space to a body.
    #[error(
        "body `{body}` is joined to nothing: no chain of hinges leads to it from inertial space (a floating body needs a free hinge)"
    )]
    Unreachable {
        /// The body.
        body: String,
    },
    /// A start value names a hinge that does not exist.
    #[error("the start names hinge `{hinge}`, which is no hinge of the system")]
    UnknownHinge {
        /// The name that it gives.
        hinge: String,
    },
    /// A start value is given for a hinge whose position follows from the others.
    #[error("hinge `{hinge}` closes a loop: where it starts follows from the hinges before it")]
    StartOfLoop {
        /// The hinge.
        hinge: String,
    },
    /// At the start a loop is not closed.
    #[error("hinge `{hinge}` does not close its loop at the start: {axis} is off by {residual:.3e} {unit}", unit = axis.unit())]
    Open {
        /// The hinge.
        hinge: String,
        /// The constrained axis.
        axis: Axis,
        /// By how much \[m or rad\].
        residual: f64,
    },
    /// At the start the rates tear a loop open.
    #[error("hinge `{hinge}` is torn open by the rates at the start: {axis} moves at {residual:.3e} {unit}/s", unit = axis.unit())]
    Opening {
        /// The hinge.
        hinge: String,
        /// The constrained axis.
        axis: Axis,
        /// How fast \[m/s or rad/s\].
        residual: f64,
    },
    /// Constraints repeat others, so the forces in them are not determined.
    #[error(
        "hinge `{hinge}` is over-constrained: {axes} {verb} held by {others} already; free {them}, or leave redundant constraints out",
        axes = list(axes), verb = if axes.len() == 1 { "is" } else { "are" },
        others = names(others), them = if axes.len() == 1 { "it" } else { "them" }
    )]
    Redundant {
        /// The hinge, the last declared of those that share the constraint.
        hinge: String,
        /// Its axes that repeat what others hold.
        axes: Vec<Axis>,
        /// The hinges declared before that hold them together.
        others: Vec<String>,
    },
}

fn list(axes: &[Axis]) -> String {
    let axes: Vec<_> = axes.iter().map(Axis::to_string).collect();
    axes.join(", ")
}

fn names(hinges: &[String]) -> String {
    let hinges: Vec<_> = hinges.iter().map(|name| format!("`{name}`")).collect();
    hinges.join(", ")
}
