//! Errors of inputs, and reasons why a problem has no solution.

use crate::Complex;

/// Why a routine of this crate refuses its input or gives up.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LtiError {
    /// A matrix has the wrong number of rows or columns.
    #[error("{what} is {rows} x {cols}; it must be {expected}")]
    Shape {
        /// Name of the matrix.
        what: String,
        /// Its rows.
        rows: usize,
        /// Its columns.
        cols: usize,
        /// The size that would be right.
        expected: String,
    },
    /// An entry is infinite or not a number.
    #[error("{what} contains {value} in row {row}, column {col}; every entry must be finite")]
    NotFinite {
        /// Name of the matrix.
        what: String,
        /// The entry.
        value: f64,
        /// Its row, from 0.
        row: usize,
        /// Its column, from 0.
        col: usize,
    },
    /// A matrix that must be symmetric is not.
    #[error(
        "{what} is not symmetric: its entries differ from those of the transpose by up to {difference:e}"
    )]
    NotSymmetric {
        /// Name of the matrix.
        what: String,
        /// Largest difference from the transpose.
        difference: f64,
    },
    /// A matrix that must be positive definite has an eigenvalue that is not positive.
    #[error(
        "{what} is not positive definite: its smallest eigenvalue is {smallest:e}; all must be positive"
    )]
    NotPositiveDefinite {
        /// Name of the matrix.
        what: String,
        /// Its smallest eigenvalue.
        smallest: f64,
    },
    /// A matrix that must be positive semidefinite has a negative eigenvalue.
    #[error(
        "{what} is not positive semidefinite: its smallest eigenvalue is {smallest:e}; none may be negative"
    )]
    NotSemidefinite {
        /// Name of the matrix.
        what: String,
        /// Its smallest eigenvalue.
        smallest: f64,
    },
    /// A mode that does not decay is not moved by any input.
    #[error(
        "(A, B) is not stabilisable: no input moves the mode at {eigenvalue}, which does not decay"
    )]
    NotStabilizable {
        /// Eigenvalue of that mode.
        eigenvalue: Complex,
    },
    /// A mode that does not decay is not seen by any output.
    #[error(
        "(C, A) is not detectable: no output sees the mode at {eigenvalue}, which does not decay"
    )]
    NotDetectable {
        /// Eigenvalue of that mode.
        eigenvalue: Complex,
    },
    /// The Hamiltonian (or symplectic) matrix has eigenvalues on the stability limit, so it has no stable invariant subspace of half the size.
    #[error(
        "the {equation} has no stabilising solution: its Hamiltonian has an eigenvalue at {eigenvalue}, on the stability limit"
    )]
    StabilityLimit {
        /// Which equation.
        equation: &'static str,
        /// An eigenvalue on the limit.
        eigenvalue: Complex,
    },
    /// Something that must be stable is not.
    #[error("{what} must be stable, but has a pole at {pole}")]
    Unstable {
        /// What is unstable.
        what: String,
        /// Its rightmost (discrete: outermost) pole.
        pole: Complex,
    },
    /// A matrix cannot be inverted.
    #[error("{what} is singular")]
    Singular {
        /// Name of the matrix.
        what: String,
    },
    /// A Lyapunov equation has no unique solution.
    #[error(
        "the Lyapunov equation has no unique solution: the eigenvalues {first} and {second} are mirror images about the stability limit"
    )]
    MirrorEigenvalues {
        /// One eigenvalue.
        first: Complex,
        /// The other.
        second: Complex,
    },
    /// An iteration reached its limit.
    #[error("{what} did not converge in {iterations} iterations")]
    NotConverged {
        /// Which iteration.
        what: &'static str,
        /// Its limit.
        iterations: usize,
    },
    /// A result misses the accuracy that the routine promises.
    #[error(
        "the solution of the {what} is inaccurate: relative residual {residual:e}, at most {limit:e} is accepted; the problem is too badly scaled"
    )]
    Inaccurate {
        /// Which equation.
        what: &'static str,
        /// Relative residual.
        residual: f64,
        /// Limit of it.
        limit: f64,
    },
    /// A number is outside of its range.
    #[error("{what} is {value}; it must be {expected}")]
    Range {
        /// Name of the number.
        what: String,
        /// Its value.
        value: f64,
        /// The range.
        expected: &'static str,
    },
    /// A continuous and a discrete system, or two with different sampling times, are combined.
    #[error("{what} needs {expected}")]
    TimeDomain {
        /// The operation.
        what: &'static str,
        /// What would be right.
        expected: String,
    },
    /// No controller meets the bound.
    #[error("no stabilising controller with H-infinity norm below {gamma}: {reason}")]
    NoController {
        /// The bound.
        gamma: f64,
        /// Which of the conditions fails.
        reason: String,
    },
}

impl LtiError {
    /// Whether an H-infinity design that fails with this error may succeed for another gamma.
    pub(crate) fn depends_on_gamma(&self) -> bool {
        matches!(
            self,
            Self::NoController { .. } | Self::Inaccurate { .. } | Self::Singular { .. }
        )
    }
}
