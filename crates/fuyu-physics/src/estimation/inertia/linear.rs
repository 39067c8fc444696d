//! Linear least squares with a report on the excitation.

use nalgebra::{DMatrix, DVector};

/// Relative singular value, with all columns scaled to the same size, below which a combination of unknowns is not
/// determined.
const DEPENDENT: f64 = 1e-9;

/// How well data determine the unknowns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Excitation {
    /// Number of combinations of the unknowns that the data determine.
    pub rank: usize,
    /// Number of unknowns.
    pub unknowns: usize,
    /// Condition number with all columns scaled to length one; infinite if the rank is not full.
    pub condition: f64,
}

/// Why there is no result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IdentificationError {
    /// The motion does not determine all parameters.
    #[error(
        "the motion determines {rank} of {unknowns} unknowns; move more joints, at least two of the wrist with axes that are not parallel"
    )]
    NotExcited {
        /// Combinations that are determined.
        rank: usize,
        /// Unknowns.
        unknowns: usize,
    },
    /// The motion determines the parameters too badly.
    #[error(
        "the motion determines the mass to {sd:.3} kg of {mass:.3} kg only; move more joints, further or faster"
    )]
    Uncertain {
        /// Mass \[kg\].
        mass: f64,
        /// Its standard deviation \[kg\].
        sd: f64,
    },
    /// No body has the parameters.
    #[error(
        "the data give a mass of {0:.3} kg, which no body has: check the order and units of the measurements"
    )]
    Mass(f64),
    /// A measurement that does not fit the robot, or is not finite.
    #[error("sample {index}: {problem}")]
    Sample {
        /// Which one.
        index: usize,
        /// What is wrong.
        problem: &'static str,
    },
    /// The iteration does not converge.
    #[error(
        "the estimate does not converge after {0} iterations: the measurements do not fit a rigid body"
    )]
    NotConverged(usize),
}

/// The equations of a least-squares problem, with columns scaled to length one.
pub(super) struct Scaled {
    svd: nalgebra::SVD<f64, nalgebra::Dyn, nalgebra::Dyn>,
    lengths: DVector<f64>,
    pub excitation: Excitation,
}

impl Scaled {
    /// Columns without any entry count as not determined; without equations, all of them.
    pub fn new(matrix: DMatrix<f64>) -> Self {
        let unknowns = matrix.ncols();
        let rows = matrix.nrows().max(1);
        let mut matrix = matrix.resize_vertically(rows, 0.0);
        let mut lengths = DVector::zeros(unknowns);
        for (j, mut column) in matrix.column_iter_mut().enumerate() {
            let length = column.norm();
            lengths[j] = if length > 1e-12 { length } else { 0.0 };
            if lengths[j] > 0.0 {
                column /= length;
            } else {
                column.fill(0.0);
            }
        }
        let svd = matrix.svd(true, true);
        let largest = svd.singular_values.max();
        let rank = svd
            .singular_values
            .iter()
            .filter(|s| **s > DEPENDENT * largest)
            .count();
        let condition = match rank == unknowns {
            true => largest / svd.singular_values.min(),
            false => f64::INFINITY,
        };
        let excitation = Excitation {
            rank,
            unknowns,
            condition,
        };
        Self {
            svd,
            lengths,
            excitation,
        }
    }

    /// Fails unless all unknowns are determined.
    pub fn check(&self) -> Result<(), IdentificationError> {
        let Excitation { rank, unknowns, .. } = self.excitation;
        if rank == unknowns {
            return Ok(());
        }
        Err(IdentificationError::NotExcited { rank, unknowns })
    }

    /// The least-squares solution.
    pub fn solve(&self, rhs: &DVector<f64>) -> DVector<f64> {
        let solution = self.svd.solve(rhs, 0.0);
        // Both factors were computed.
        solution.map_or_else(
            |_| DVector::zeros(self.lengths.len()),
            |x| x.component_div(&self.lengths),
        )
    }

    /// `(Aᵀ A)⁻¹`.
    pub fn covariance(&self) -> DMatrix<f64> {
        let n = self.lengths.len();
        let Some(v_t) = &self.svd.v_t else {
            return DMatrix::zeros(n, n);
        };
        let mut scaled = v_t.clone();
        for (i, mut row) in scaled.row_iter_mut().enumerate() {
            row /= self.svd.singular_values[i];
        }
        for (j, mut column) in scaled.column_iter_mut().enumerate() {
            column /= self.lengths[j];
        }
        scaled.transpose() * scaled
    }
}
