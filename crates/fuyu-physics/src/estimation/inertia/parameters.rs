//! The ten inertia parameters of a rigid body.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::spatial::RigidInertia;

/// Mass, first moment and inertia of a body about the origin of its frame, in the frame's axes. In vectors: `m`,
/// `mc` (3), `Ixx`, `Iyy`, `Izz`, `Ixy`, `Ixz`, `Iyz`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertiaParameters {
    /// Mass \[kg\].
    pub mass: f64,
    /// First moment `m c` \[kg m\].
    pub first_moment: Vector3<f64>,
    /// Inertia about the frame's origin \[kg m²\].
    pub about_origin: Matrix3<f64>,
}

/// Rows and columns of the entries of an inertia in vectors.
const ENTRIES: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

impl InertiaParameters {
    /// From a vector.
    pub fn from_vector(v: &SVector<f64, 10>) -> Self {
        let mut about_origin = Matrix3::zeros();
        for (k, (i, j)) in ENTRIES.into_iter().enumerate() {
            (about_origin[(i, j)], about_origin[(j, i)]) = (v[4 + k], v[4 + k]);
        }
        Self {
            mass: v[0],
            first_moment: v.fixed_rows::<3>(1).into(),
            about_origin,
        }
    }

    /// As a vector.
    pub fn to_vector(&self) -> SVector<f64, 10> {
        let mut v = SVector::<f64, 10>::zeros();
        v[0] = self.mass;
        v.fixed_rows_mut::<3>(1).copy_from(&self.first_moment);
        for (k, (i, j)) in ENTRIES.into_iter().enumerate() {
            v[4 + k] = self.about_origin[(i, j)];
        }
        v
    }

    /// Mass, centre of mass and inertia about it.
    pub fn rigid(&self) -> RigidInertia {
        let com = self.first_moment / self.mass;
        RigidInertia {
            mass: self.mass,
            com,
            about_com: self.about_origin - point_inertia(&self.first_moment) / self.mass,
        }
    }
}

impl From<&RigidInertia> for InertiaParameters {
    fn from(body: &RigidInertia) -> Self {
        Self {
            mass: body.mass,
            first_moment: body.com * body.mass,
            about_origin: body.about_com + point_inertia(&body.com) * body.mass,
        }
    }
}

/// `[a]ᵀ [a]`, with `[a]` the matrix of the cross product.
pub(super) fn point_inertia(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * a.norm_squared() - a * a.transpose()
}

/// Entry `k` of an inertia: the inertia with a one there.
pub(super) fn unit_inertia(k: usize) -> Matrix3<f64> {
    let (i, j) = ENTRIES[k];
    let mut unit = Matrix3::zeros();
    (unit[(i, j)], unit[(j, i)]) = (1.0, 1.0);
    unit
}

/// Covariance of [`InertiaParameters`], and of the mass, centre of mass and inertia that follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertiaCovariance {
    /// Of the ten parameters.
    pub parameters: SMatrix<f64, 10, 10>,
    /// Of mass, centre of mass and inertia about it, in the same order.
    pub rigid: SMatrix<f64, 10, 10>,
}

impl InertiaCovariance {
    /// From the covariance of the parameters, at their values.
    pub fn new(at: &InertiaParameters, parameters: SMatrix<f64, 10, 10>) -> Self {
        let about_com = |v: &SVector<f64, 10>| {
            let rigid = InertiaParameters::from_vector(v).rigid();
            InertiaParameters {
                mass: rigid.mass,
                first_moment: rigid.com,
                about_origin: rigid.about_com,
            }
            .to_vector()
        };
        let jacobian = jacobian(&at.to_vector(), about_com);
        Self {
            parameters,
            rigid: jacobian * parameters * jacobian.transpose(),
        }
    }

    /// Standard deviation of the mass \[kg\].
    pub fn mass(&self) -> f64 {
        self.parameters[(0, 0)].sqrt()
    }

    /// Standard deviations of the centre of mass \[m\].
    pub fn com(&self) -> Vector3<f64> {
        Vector3::from_fn(|i, _| self.rigid[(1 + i, 1 + i)].sqrt())
    }

    /// Standard deviations of the inertia about the centre of mass \[kg m²\]: `Ixx`, `Iyy`, `Izz`, `Ixy`, `Ixz`,
    /// `Iyz`.
    pub fn about_com(&self) -> [f64; 6] {
        std::array::from_fn(|k| self.rigid[(4 + k, 4 + k)].sqrt())
    }
}

/// Derivatives by central differences, to some nine digits.
pub(super) fn jacobian(
    at: &SVector<f64, 10>,
    of: impl Fn(&SVector<f64, 10>) -> SVector<f64, 10>,
) -> SMatrix<f64, 10, 10> {
    let size = at.amax();
    let mut jacobian = SMatrix::<f64, 10, 10>::zeros();
    for j in 0..10 {
        let step = 1e-5 * at[j].abs().max(1e-3 * size);
        let (mut before, mut after) = (*at, *at);
        before[j] -= step;
        after[j] += step;
        jacobian.set_column(j, &((of(&after) - of(&before)) / (after[j] - before[j])));
    }
    jacobian
}

#[cfg(test)]
mod tests {
    use super::*;

    // Divided by the mass, nothing would have been 0 / 0.
    #[test]
    fn a_body_without_mass_has_parameters() {
        let mut body = RigidInertia {
            mass: 0.0,
            com: Vector3::new(1.0, 2.0, 3.0),
            about_com: Matrix3::from_diagonal(&Vector3::new(4.0, 5.0, 6.0)),
        };
        let none = InertiaParameters::from(&body);
        assert_eq!(none.first_moment, Vector3::zeros());
        assert_eq!(none.about_origin, body.about_com);
        body.mass = 2.0;
        let some = InertiaParameters::from(&body).about_origin;
        assert_eq!(some[(0, 0)], 4.0 + 2.0 * 13.0);
        assert_eq!(some[(0, 1)], -2.0 * 2.0);
    }
}
