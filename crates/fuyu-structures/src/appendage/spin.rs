//! Vibration of a body whose attachment turns at a constant rate.

use nalgebra::{Complex, DMatrix, Vector3};

use super::{Appendage, FIRST_ORDER_DEFLECTION, FIRST_ORDER_RATE, invariants::cross_moment};
use crate::{StructureError, eigen::cholesky, frequencies_hz, quadratic_roots};

impl Appendage {
    /// Stiffness (n x n) that the steady motion of the attachment frame adds to small vibrations about the undeformed shape:
    /// angular velocity `w_A` \[rad/s\] and inertial acceleration `a_A` \[m/s²\] of its origin, both in its axes.
    ///
    /// First-order modes give only the centrifugal softening `-Ω²`; the stiffening by the tension is in the second-order
    /// displacement chi.
    pub fn spin_stiffness(&self, w_A: &Vector3<f64>, a_A: &Vector3<f64>) -> DMatrix<f64> {
        let invariants = &self.invariants;
        let w_squared = w_A.norm_squared();
        let part = |k, l| {
            let mut moment = invariants.second(1 + l, 1 + k);
            let mut force = 0.0;
            if invariants.second_order() {
                let pair = invariants.pair_function(k, l);
                moment += invariants.second(0, pair);
                force = a_A.dot(&invariants.first(pair));
            }
            w_A.dot(&(moment * w_A)) - w_squared * moment.trace() + force
        };
        DMatrix::from_fn(self.modes(), self.modes(), part).symmetric_part()
    }

    /// Gyroscopic matrix (n x n, antisymmetric) of small vibrations in a frame that turns at `w_A` \[rad/s\]: the modal forces
    /// are minus this times μ'.
    pub fn gyroscopic_matrix(&self, w_A: &Vector3<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(self.modes(), self.modes(), |k, l| {
            2.0 * w_A.dot(&cross_moment(&self.invariants.second(1 + l, 1 + k)))
        })
    }

    /// Undamped frequencies \[rad/s\], ascending, in a frame that turns steadily at `w_A` \[rad/s\] about an axis through a point
    /// from which the attachment is `p_A` \[m\] away, both in attachment axes.
    ///
    /// # Errors
    /// If the rotation makes the undeformed shape unstable, or as [`Appendage::check`].
    pub fn spin_frequencies(
        &self,
        w_A: &Vector3<f64>,
        p_A: &Vector3<f64>,
    ) -> Result<Vec<f64>, StructureError> {
        self.check()?;
        let acceleration = w_A.cross(&w_A.cross(p_A));
        let K = &self.modal_stiffness + self.spin_stiffness(w_A, &acceleration);
        cholesky(
            K.clone(),
            format_args!("{}, stiffness at {:.4} rad/s", self.name, w_A.norm()),
            "the body diverges at this rate; use second-order modes or a lower rate",
        )?;
        let roots: Vec<Complex<f64>> =
            quadratic_roots(&self.modal_mass, &self.gyroscopic_matrix(w_A), &K)?;
        Ok(frequencies_hz(&roots)
            .iter()
            .map(|f| f * std::f64::consts::TAU)
            .collect())
    }

    /// Up to which rate and deflection first-order modes describe this body.
    ///
    /// # Errors
    /// As [`Appendage::check`].
    pub fn first_order_limits(&self) -> Result<FirstOrderLimits, StructureError> {
        let frequencies = self.frequencies()?;
        let lengths = self.outputs.iter().map(|o| o.position.norm());
        Ok(FirstOrderLimits {
            rate: frequencies
                .iter()
                .next()
                .map_or(f64::INFINITY, |w| FIRST_ORDER_RATE * w),
            deflection: lengths
                .reduce(f64::max)
                .map_or(f64::INFINITY, |l| FIRST_ORDER_DEFLECTION * l),
        })
    }
}

/// Up to where first-order modes suffice; beyond, use the second order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstOrderLimits {
    /// Angular rate of the attachment \[rad/s\]: [`FIRST_ORDER_RATE`] of the first frequency.
    pub rate: f64,
    /// Displacement of an output point \[m\]: [`FIRST_ORDER_DEFLECTION`] of the distance of the farthest one; infinite if there
    /// is none.
    pub deflection: f64,
}
