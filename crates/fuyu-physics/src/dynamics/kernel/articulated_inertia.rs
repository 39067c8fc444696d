//! The inertia of a body with what hangs on it, and how it looks from elsewhere.

use super::joint_transform::{Force, Motion, quarter};
use super::vector::others;
use super::{Mat3, Scalar, Sym3, Turn, Vec3};

/// Inertia of a body with everything that hangs on it by joints that give way: `torque = turning ·
/// angular + coupling · linear`, `force = couplingᵀ · angular + mass · linear`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArticulatedInertia<S> {
    /// Torque per angular acceleration \[kg m²\].
    pub turning: Sym3<S>,
    /// Torque per linear acceleration \[kg m\].
    pub coupling: Mat3<S>,
    /// Force per linear acceleration \[kg\].
    pub mass: Sym3<S>,
}

impl<S: Scalar> ArticulatedInertia<S> {
    /// Two that move together.
    #[inline(always)]
    pub fn plus(self, o: Self) -> Self {
        Self {
            turning: self.turning + o.turning,
            coupling: self.coupling + o.coupling,
            mass: self.mass + o.mass,
        }
    }

    /// About a point from which the present one lies at `p` along one axis.
    #[inline(always)]
    pub(super) fn shifted<const AXIS: usize>(mut self, p: S) -> Self {
        let (i, (j, k)) = (AXIS, others(AXIS));
        // J becomes J - H [p×] + [p×] H'ᵀ with H' = H + [p×] M.
        let old = self.coupling.0;
        let (to_j, to_k) = (self.mass.row(k), self.mass.row(j));
        for c in 0..3 {
            self.coupling.0[j][c] = p.mul_sub_from(to_j[c], old[j][c]);
            self.coupling.0[k][c] = p.mul_add(to_k[c], old[k][c]);
        }
        let new = self.coupling.0;
        let t = &mut self.turning;
        t.off[k] = p.mul_sub_from(old[i][k], t.off[k]);
        t.off[j] = p.mul_add(old[i][j], t.off[j]);
        t.diagonal[j] = p.mul_sub_from(old[j][k] + new[j][k], t.diagonal[j]);
        t.diagonal[k] = p.mul_add(old[k][j] + new[k][j], t.diagonal[k]);
        t.off[i] = p.mul_add(old[j][j] - new[k][k], t.off[i]);
        self
    }

    /// [`Self::shifted`] along z by `d`, of an inertia that feels nothing about z.
    #[inline(always)]
    pub(super) fn shifted_in_plane(mut self, d: S) -> Self {
        let old = self.coupling.0;
        let (to_x, to_y) = (self.mass.row(1), self.mass.row(0));
        for c in 0..3 {
            self.coupling.0[0][c] = d.mul_sub_from(to_x[c], old[0][c]);
            self.coupling.0[1][c] = d.mul_add(to_y[c], old[1][c]);
        }
        let new = self.coupling.0;
        let t = &mut self.turning;
        t.diagonal[0] = d.mul_sub_from(old[0][1] + new[0][1], t.diagonal[0]);
        t.diagonal[1] = d.mul_add(old[1][0] + new[1][0], t.diagonal[1]);
        t.off[2] = d.mul_add(old[0][0] - new[1][1], t.off[2]);
        self
    }

    #[inline(always)]
    pub(super) fn turned<const AXIS: usize>(self, turn: &Turn<S>) -> Self {
        Self {
            turning: turn.sym::<AXIS>(self.turning),
            coupling: turn.mat::<AXIS>(self.coupling),
            mass: turn.sym::<AXIS>(self.mass),
        }
    }

    #[inline(always)]
    pub(super) fn quarter_turned(self) -> Self {
        Self {
            turning: quarter_sym(self.turning),
            coupling: quarter_mat(self.coupling),
            mass: quarter_sym(self.mass),
        }
    }

    /// Of a rigid body, from its mass and moments about the frame's origin.
    #[inline(always)]
    pub(super) fn rigid(mass: S, first_moment: Vec3<S>, inertia: Sym3<S>) -> Self {
        let (zero, Vec3([x, y, z])) = (mass.constant(0.0), first_moment);
        Self {
            turning: inertia,
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

    /// Acceleration of a free body with this inertia that needs `force` to stay where it is.
    #[inline(always)]
    pub(crate) fn answer(&self, force: Force<S>) -> Motion<S> {
        let (H, inverse) = (self.coupling, self.mass.inverse());
        let Mat3([x, y, z]) = H;
        let eliminated = Mat3([inverse.times(x), inverse.times(y), inverse.times(z)]);
        let mut left = self.turning;
        for i in 0..3 {
            let (j, k) = others(i);
            left.diagonal[i] = left.diagonal[i] - eliminated.0[i].dot(H.0[i]);
            left.off[i] = left.off[i] - eliminated.0[j].dot(H.0[k]);
        }
        let angular = left
            .inverse()
            .times(eliminated.times(force.force) - force.torque);
        let linear = -inverse.times(force.force + H.tr_mul(angular));
        Motion { angular, linear }
    }
}

#[inline(always)]
pub(super) fn quarter_sym<S: Scalar>(m: Sym3<S>) -> Sym3<S> {
    let ([x, y, z], [yz, xz, xy]) = (m.diagonal, m.off);
    Sym3 {
        diagonal: [x, z, y],
        off: [-yz, xy, -xz],
    }
}

#[inline(always)]
fn quarter_mat<S: Scalar>(m: Mat3<S>) -> Mat3<S> {
    let [x, y, z] = m.0;
    Mat3([quarter(x), -quarter(z), quarter(y)])
}
