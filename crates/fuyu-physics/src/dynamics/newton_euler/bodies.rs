//! Placements of the bodies, and transforms to mass-weighted coordinates.

use nalgebra::{Matrix3, Vector3};

use super::hinge_motion::{BodyPlacement, HingeMotion};
use super::system::CompiledHinge;
use super::{Axis, System};
use crate::spatial::{Twist, Wrench};

/// Placements and velocities of the bodies, and the inverse Cholesky factors of their mass matrices.
#[derive(Debug, Clone)]
pub(super) struct Bodies {
    pub placed: Vec<BodyPlacement>,
    roots: Vec<InverseRoot>,
}

/// `L⁻¹` of a body's mass matrix `L Lᵀ`.
#[derive(Debug, Clone)]
struct InverseRoot {
    linear: f64,
    angular: Matrix3<f64>,
}

impl Bodies {
    pub fn new(system: &System) -> Self {
        let roots = system.bodies.iter().map(|body| {
            let root = (body.inertia.about_com.cholesky()).expect("inertias are checked");
            InverseRoot {
                linear: 1.0 / body.inertia.mass.sqrt(),
                angular: (root.l().try_inverse()).expect("a Cholesky factor is regular"),
            }
        });
        Self {
            placed: vec![BodyPlacement::INERTIAL; system.bodies.len()],
            roots: roots.collect(),
        }
    }

    pub fn get(&self, body: Option<usize>) -> BodyPlacement {
        body.map_or(BodyPlacement::INERTIAL, |b| self.placed[b])
    }

    /// Wrenches of a unit force or torque along `axis` of a hinge on the bodies that it joins, about their centres of mass,
    /// body axes.
    pub fn acted_on(
        &self,
        hinge: &CompiledHinge,
        motion: &HingeMotion,
        axis: Axis,
    ) -> impl Iterator<Item = (usize, Wrench)> {
        let outer = hinge.outer.map(|b| (b, motion.outer(axis), 1.0));
        let inner = hinge.inner.map(|b| (b, motion.inner(axis), -1.0));
        [outer, inner]
            .into_iter()
            .flatten()
            .map(|(b, (force, torque), sign)| {
                let R = &self.placed[b].R;
                let wrench = Wrench::new(R.tr_mul(&torque) * sign, R.tr_mul(&force) * sign);
                (b, wrench)
            })
    }

    /// `z += L⁻¹ wrench` for one body.
    pub fn add_weighted(&self, body: usize, wrench: &Wrench, z: &mut [f64]) {
        let root = &self.roots[body];
        let (linear, angular) = (wrench.force * root.linear, root.angular * wrench.torque);
        let z = &mut z[6 * body..6 * body + 6];
        for (z, x) in z.iter_mut().zip(linear.iter().chain(angular.iter())) {
            *z += x;
        }
    }

    /// `L⁻ᵀ z` of one body: its motion from mass-weighted coordinates.
    pub fn motion(&self, body: usize, z: &[f64]) -> Twist {
        let (z, root) = (&z[6 * body..6 * body + 6], &self.roots[body]);
        Twist {
            linear: Vector3::new(z[0], z[1], z[2]) * root.linear,
            angular: root.angular.tr_mul(&Vector3::new(z[3], z[4], z[5])),
        }
    }
}
