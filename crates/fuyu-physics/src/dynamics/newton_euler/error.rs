//! Errors in the description of a system.

use super::Axis;
use crate::spatial::InertiaError;

/// Why a [`super::SystemBuilder`] or a [`super::System`] refuses its input.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SystemError {
    /// No bodies.
    #[error("the system has no bodies")]
    NoBodies,
    /// A name is empty or reserved for inertial space.
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
    /// No real body has these mass properties.
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
        /// The unknown name.
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
        /// Name of the number.
        what: String,
        /// Its value.
        value: f64,
        /// The allowed range.
        expected: &'static str,
    },
    /// A property of free axes is given for a constrained one.
    #[error("hinge `{hinge}`: {what} on {axis}, which the hinge constrains")]
    Constrained {
        /// The hinge.
        hinge: String,
        /// The axis.
        axis: Axis,
        /// The property: a spring, a damper or a start value.
        what: &'static str,
    },
    /// No chain of hinges connects a body to inertial space.
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
        /// The unknown name.
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
        /// Displacement \[m or rad\].
        residual: f64,
    },
    /// The rates at the start violate the constraints of a loop.
    #[error("hinge `{hinge}` is torn open by the rates at the start: {axis} moves at {residual:.3e} {unit}/s", unit = axis.unit())]
    Opening {
        /// The hinge.
        hinge: String,
        /// The constrained axis.
        axis: Axis,
        /// Rate \[m/s or rad/s\].
        residual: f64,
    },
    /// Redundant constraints, whose forces are not determined.
    #[error(
        "hinge `{hinge}` is over-constrained: {axes} {verb} held by {others} already; free {them}, or leave redundant constraints out",
        axes = list(axes), verb = if axes.len() == 1 { "is" } else { "are" },
        others = names(others), them = if axes.len() == 1 { "it" } else { "them" }
    )]
    Redundant {
        /// The hinge, the last declared of those that share the constraint.
        hinge: String,
        /// Its redundant axes.
        axes: Vec<Axis>,
        /// The hinges, declared before, that constrain the same directions together.
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
