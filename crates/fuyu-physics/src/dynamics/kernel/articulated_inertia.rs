//! Articulated-body inertia: change of reference point and axes, and the acceleration of a free body.

use super::joint_transform::{SpatialForce, SpatialMotion, rotate_x_90};
use super::vector::other_axes;
use super::{Mat3, PlanarRotation, Scalar, Sym3, Vec3};

/// Articulated-body inertia: inertia of a body and its subtree with freely moving joints. `torque = rotational ·
/// angular + coupling · linear`, `force = couplingᵀ · angular + mass · linear`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArticulatedInertia<S> {
    /// Torque per angular acceleration \[kg m²\].
    pub rotational: Sym3<S>,
    /// Torque per linear acceleration \[kg m\].
    pub coupling: Mat3<S>,
    /// Force per linear acceleration \[kg\].
    pub mass: Sym3<S>,
}

impl<S: Scalar> ArticulatedInertia<S> {
    /// Sum of two inertias about the same point.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn plus(self, o: Self) -> Self {
        Self {
            rotational: self.rotational + o.rotational,
            coupling: self.coupling + o.coupling,
            mass: self.mass + o.mass,
        }
    }

    /// Sum with the inertia of a rigid body, from its mass and its moments about the same point.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn plus_rigid(mut self, mass: S, first_moment: Vec3<S>, inertia: Sym3<S>) -> Self {
        self.rotational = self.rotational + inertia;
        for i in 0..3 {
            let (j, k) = other_axes(i);
            let H = &mut self.coupling.0;
            H[k][j] = H[k][j] + first_moment[i];
            H[j][k] = H[j][k] - first_moment[i];
            self.mass.diagonal[i] = self.mass.diagonal[i] + mass;
        }
        self
    }

    /// The same inertia about a new reference point, from which the present one lies at `p`, along one axis.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn shifted<const AXIS: usize>(mut self, p: S) -> Self {
        let (i, (j, k)) = (AXIS, other_axes(AXIS));
        // J becomes J - H [p×] + [p×] H'ᵀ with H' = H + [p×] M.
        let old = self.coupling.0;
        let (to_j, to_k) = (self.mass.row(k), self.mass.row(j));
        for c in 0..3 {
            self.coupling.0[j][c] = p.mul_sub_from(to_j[c], old[j][c]);
            self.coupling.0[k][c] = p.mul_add(to_k[c], old[k][c]);
        }
        let new = self.coupling.0;
        let t = &mut self.rotational;
        t.off[k] = p.mul_sub_from(old[i][k], t.off[k]);
        t.off[j] = p.mul_add(old[i][j], t.off[j]);
        t.diagonal[j] = p.mul_sub_from(old[j][k] + new[j][k], t.diagonal[j]);
        t.diagonal[k] = p.mul_add(old[k][j] + new[k][j], t.diagonal[k]);
        t.off[i] = p.mul_add(old[j][j] - new[k][k], t.off[i]);
        self
    }

    /// [`Self::shifted`] along z by `d`, for an inertia that is zero about z.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn shifted_in_plane(mut self, d: S) -> Self {
        let old = self.coupling.0;
        let (to_x, to_y) = (self.mass.row(1), self.mass.row(0));
        for c in 0..3 {
            self.coupling.0[0][c] = d.mul_sub_from(to_x[c], old[0][c]);
            self.coupling.0[1][c] = d.mul_add(to_y[c], old[1][c]);
        }
        let new = self.coupling.0;
        let t = &mut self.rotational;
        t.diagonal[0] = d.mul_sub_from(old[0][1] + new[0][1], t.diagonal[0]);
        t.diagonal[1] = d.mul_add(old[1][0] + new[1][0], t.diagonal[1]);
        t.off[2] = d.mul_add(old[0][0] - new[1][1], t.off[2]);
        self
    }

    /// Components in A of an inertia given in B.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn rotated<const AXIS: usize>(self, rotation: &PlanarRotation<S>) -> Self {
        Self {
            rotational: rotation.rotate_sym::<AXIS>(self.rotational),
            coupling: rotation.rotate_mat::<AXIS>(self.coupling),
            mass: rotation.rotate_sym::<AXIS>(self.mass),
        }
    }

    /// [`Self::rotated`] by 90° about x.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn rotated_x_90(self) -> Self {
        Self {
            rotational: rotate_sym_x_90(self.rotational),
            coupling: rotate_mat_x_90(self.coupling),
            mass: rotate_sym_x_90(self.mass),
        }
    }

    /// Inertia of a rigid body, from its mass and its moments about the frame's origin.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn rigid(mass: S, first_moment: Vec3<S>, inertia: Sym3<S>) -> Self {
        let (zero, Vec3([x, y, z])) = (mass.constant(0.0), first_moment);
        Self {
            rotational: inertia,
            coupling: Mat3([
                Vec3([zero, -z, y]),
                Vec3([z, zero, -x]),
                Vec3([-y, x, zero]),
            ]),
            mass: Sym3 {
                diagonal: [mass; 3],
                off: [zero; 3],
            },
        }
    }

    /// Acceleration of a free body with this inertia on which `-force` acts.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn free_acceleration(&self, force: SpatialForce<S>) -> SpatialMotion<S> {
        let (H, inverse) = (self.coupling, self.mass.inverse());
        let Mat3([x, y, z]) = H;
        let eliminated = Mat3([inverse.times(x), inverse.times(y), inverse.times(z)]);
        let mut schur = self.rotational;
        for i in 0..3 {
            let (j, k) = other_axes(i);
            schur.diagonal[i] = schur.diagonal[i] - eliminated.0[i].dot(H.0[i]);
            schur.off[i] = schur.off[i] - eliminated.0[j].dot(H.0[k]);
        }
        let angular = schur
            .inverse()
            .times(eliminated.times(force.force) - force.torque);
        let linear = -inverse.times(force.force + H.tr_mul(angular));
        SpatialMotion { angular, linear }
    }
}

/// `Rx(90°) m Rx(90°)ᵀ`.
#[cfg_attr(not(debug_assertions), inline(always))]
pub(super) fn rotate_sym_x_90<S: Scalar>(m: Sym3<S>) -> Sym3<S> {
    let ([x, y, z], [yz, xz, xy]) = (m.diagonal, m.off);
    Sym3 {
        diagonal: [x, z, y],
        off: [-yz, xy, -xz],
    }
}

/// `Rx(90°) m Rx(90°)ᵀ`.
#[cfg_attr(not(debug_assertions), inline(always))]
fn rotate_mat_x_90<S: Scalar>(m: Mat3<S>) -> Mat3<S> {
    let [x, y, z] = m.0;
    Mat3([rotate_x_90(x), -rotate_x_90(z), rotate_x_90(y)])
}
