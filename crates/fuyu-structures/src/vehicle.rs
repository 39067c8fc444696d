//! A vehicle of rigid bodies with appendages, for small motion: frequencies, poles and transmission zeros.

use nalgebra::{Complex, DMatrix, Matrix6, Rotation3, Vector3};

use crate::{Appendage, HybridModel, StructureError, error};

/// A vehicle whose rigid motion has N coordinates, with appendages on any of its bodies.
///
/// Coordinates 0 to 2 are the translation of the base along its axes, 3 to 5 its rotation about them, the others joints that are free to move.
#[derive(Clone, Debug)]
pub struct Vehicle {
    hybrid: HybridModel,
}

/// An appendage and how its attachment moves with the vehicle.
#[derive(Clone, Debug)]
pub struct Attachment<'a> {
    /// The appendage.
    pub appendage: &'a Appendage,
    /// 6 x N: velocity (rows 0 to 2) and angular velocity of the attachment frame, in its axes, for unit rates of the vehicle's
    /// coordinates.
    pub jacobian: DMatrix<f64>,
}

impl<'a> Attachment<'a> {
    /// An appendage on the base: rotation `R_BA` and position `p_BA` \[m\] of the attachment frame A in the base frame B. `N` is
    /// how many coordinates the vehicle has.
    pub fn on_base(
        appendage: &'a Appendage,
        R_BA: &Rotation3<f64>,
        p_BA: &Vector3<f64>,
        N: usize,
    ) -> Self {
        let mut jacobian = DMatrix::zeros(6, N.max(6));
        jacobian
            .view_mut((0, 0), (6, 6))
            .copy_from(&base_to_attachment(R_BA, p_BA));
        Self {
            appendage,
            jacobian,
        }
    }
}

/// Velocity and angular velocity of the attachment frame, in its axes, from those of the base.
fn base_to_attachment(R_BA: &Rotation3<f64>, p_BA: &Vector3<f64>) -> Matrix6<f64> {
    let R_AB = R_BA.matrix().transpose();
    let mut X = Matrix6::zeros();
    X.fixed_view_mut::<3, 3>(0, 0).copy_from(&R_AB);
    X.fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(-R_AB * p_BA.cross_matrix()));
    X.fixed_view_mut::<3, 3>(3, 3).copy_from(&R_AB);
    X
}

impl Vehicle {
    /// A vehicle with mass matrix `M` (N x N) of everything as rigid, the undeformed appendages included, about the origin of the base frame.
    ///
    /// # Errors
    /// Fewer than 6 coordinates, sizes that differ, a mass matrix that lacks the appendages, or as [`Appendage::check`].
    pub fn new(M: DMatrix<f64>, attachments: &[Attachment]) -> Result<Self, StructureError> {
        let coordinates = M.nrows();
        error::count(
            "number of the vehicle's coordinates",
            coordinates,
            6,
            10_000,
        )?;
        let n: usize = attachments.iter().map(|a| a.appendage.modes()).sum();
        let mut P = DMatrix::zeros(n, coordinates);
        let mut modal = [
            DMatrix::zeros(n, n),
            DMatrix::zeros(n, n),
            DMatrix::zeros(n, n),
        ];
        let mut at = 0;
        for attachment in attachments {
            let body = attachment.appendage;
            body.check()?;
            let size = body.modes();
            error::size(
                format_args!("{}, jacobian of the attachment", body.name),
                attachment.jacobian.shape(),
                (6, coordinates),
            )?;
            P.rows_mut(at, size)
                .copy_from(&(body.coupling() * &attachment.jacobian));
            for (whole, part) in
                modal
                    .iter_mut()
                    .zip([&body.modal_mass, &body.modal_damping, &body.modal_stiffness])
            {
                whole.view_mut((at, at), (size, size)).copy_from(part);
            }
            at += size;
        }
        let [mass, damping, stiffness] = modal;
        Ok(Self {
            hybrid: HybridModel::with_matrices(M, P, mass, damping, stiffness)?,
        })
    }

    /// The linear model.
    pub fn hybrid(&self) -> &HybridModel {
        &self.hybrid
    }

    /// Undamped frequencies \[Hz\] with base and joints free, ascending.
    ///
    /// # Errors
    /// An eigenvalue iteration that does not converge.
    pub fn frequencies_hz(&self) -> Result<Vec<f64>, StructureError> {
        let frequencies = self.hybrid.frequencies()?;
        Ok(frequencies
            .iter()
            .map(|w| w / std::f64::consts::TAU)
            .collect())
    }

    /// Elastic poles with base and joints free.
    ///
    /// # Errors
    /// An eigenvalue iteration that does not converge.
    pub fn poles(&self) -> Result<Vec<Complex<f64>>, StructureError> {
        self.hybrid.poles()
    }

    /// Transmission zeros from torques on the base to its attitude, three of each.
    ///
    /// # Errors
    /// An eigenvalue iteration that does not converge.
    pub fn attitude_zeros(&self) -> Result<Vec<Complex<f64>>, StructureError> {
        self.hybrid.held(&[3, 4, 5])?.poles()
    }

    /// Transmission zeros from the torque about base axis `axis` (0, 1, 2) to the angle about it, the other axes free.
    ///
    /// # Errors
    /// Another axis; an eigenvalue iteration that does not converge.
    pub fn axis_zeros(&self, axis: usize) -> Result<Vec<Complex<f64>>, StructureError> {
        error::count("axis", axis, 0, 2)?;
        self.hybrid.held(&[3 + axis])?.poles()
    }

    /// Transmission zeros from forces and torques on the base to its position and attitude, six of each.
    ///
    /// # Errors
    /// An eigenvalue iteration that does not converge.
    pub fn wrench_zeros(&self) -> Result<Vec<Complex<f64>>, StructureError> {
        self.hybrid.held(&[0, 1, 2, 3, 4, 5])?.poles()
    }

    /// Poles with torques `-P θ - D θ'` on the base (3 x 3 each), base position and joints free: 2 (3 + n) of them.
    ///
    /// # Errors
    /// Sizes that differ; singular `P`; an eigenvalue iteration that does not converge.
    pub fn attitude_feedback_poles(
        &self,
        P: &DMatrix<f64>,
        D: &DMatrix<f64>,
    ) -> Result<Vec<Complex<f64>>, StructureError> {
        let others: Vec<usize> = (0..self.hybrid.rigid())
            .filter(|i| !(3..6).contains(i))
            .collect();
        self.hybrid.without(&others)?.feedback_poles(P, D)
    }
}
