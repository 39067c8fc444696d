//! Motions and forces from a body to its parent and back.

use super::tree::{Bend, Hop};
use super::vector::others;
use super::{Mat3, Scalar, Sym3, Turn, Vec3};

/// A force with its moment about a frame's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Force<S> {
    /// Moment \[N m\].
    pub torque: Vec3<S>,
    /// Force \[N\].
    pub force: Vec3<S>,
}

/// Angular and linear part of a motion; the linear part is that of the point at the frame's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<S> {
    /// Angular part.
    pub angular: Vec3<S>,
    /// Linear part.
    pub linear: Vec3<S>,
}

impl<S: Scalar> Force<S> {
    /// No force.
    #[inline(always)]
    pub fn zero(like: S) -> Self {
        Self {
            torque: Vec3::zero(like),
            force: Vec3::zero(like),
        }
    }

    /// Sum with a force about the same point.
    #[inline(always)]
    pub fn plus(self, o: Self) -> Self {
        Self {
            torque: self.torque + o.torque,
            force: self.force + o.force,
        }
    }

    /// About a point from which the present one lies at `p` along one axis.
    #[inline(always)]
    fn shifted<const AXIS: usize>(mut self, p: S) -> Self {
        let (j, k) = others(AXIS);
        self.torque[j] = p.mul_sub_from(self.force[k], self.torque[j]);
        self.torque[k] = p.mul_add(self.force[j], self.torque[k]);
        self
    }
}

impl<S: Scalar> Motion<S> {
    /// No motion.
    #[inline(always)]
    pub fn zero(like: S) -> Self {
        Self {
            angular: Vec3::zero(like),
            linear: Vec3::zero(like),
        }
    }

    /// Of the point that lies at `p` along one axis.
    #[inline(always)]
    fn shifted<const AXIS: usize>(mut self, p: S) -> Self {
        let (j, k) = others(AXIS);
        self.linear[j] = p.mul_add(self.angular[k], self.linear[j]);
        self.linear[k] = p.mul_sub_from(self.angular[j], self.linear[k]);
        self
    }
}

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

    #[inline(always)]
    fn turned<const AXIS: usize>(self, turn: &Turn<S>) -> Self {
        Self {
            turning: turn.sym::<AXIS>(self.turning),
            coupling: turn.mat::<AXIS>(self.coupling),
            mass: turn.sym::<AXIS>(self.mass),
        }
    }

    fn quarter_turned(self) -> Self {
        Self {
            turning: quarter_sym(self.turning),
            coupling: quarter_mat(self.coupling),
            mass: quarter_sym(self.mass),
        }
    }
}

/// `Rx(90°) v`.
#[inline(always)]
fn quarter<S: Scalar>(v: Vec3<S>) -> Vec3<S> {
    Vec3([v[0], -v[2], v[1]])
}

/// `Rx(-90°) v`.
#[inline(always)]
fn quarter_back<S: Scalar>(v: Vec3<S>) -> Vec3<S> {
    Vec3([v[0], v[2], -v[1]])
}

#[inline(always)]
fn quarter_sym<S: Scalar>(m: Sym3<S>) -> Sym3<S> {
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

impl Hop {
    /// A free vector from the moved body's axes to the parent's.
    #[inline(always)]
    pub(super) fn out<S: Scalar>(&self, turn: &Turn<S>, v: Vec3<S>) -> Vec3<S> {
        let v = self.bent_out(turn.out::<2>(v));
        match &self.swing {
            None => v,
            Some(swing) => Turn::constant(turn.cos, swing).out::<2>(v),
        }
    }

    /// A free vector from the parent's axes to the moved body's.
    #[inline(always)]
    pub(super) fn back<S: Scalar>(&self, turn: &Turn<S>, v: Vec3<S>) -> Vec3<S> {
        turn.back::<2>(self.bent_into(self.unswung(v)))
    }

    #[inline(always)]
    fn unswung<S: Scalar>(&self, v: Vec3<S>) -> Vec3<S> {
        match &self.swing {
            None => v,
            Some(swing) => Turn::constant(v[0], swing).back::<2>(v),
        }
    }

    #[inline(always)]
    fn bent_out<S: Scalar>(&self, v: Vec3<S>) -> Vec3<S> {
        match &self.bend {
            Bend::Straight => v,
            Bend::Quarter => quarter(v),
            Bend::By(turn) => Turn::constant(v[0], turn).out::<0>(v),
        }
    }

    #[inline(always)]
    fn bent_into<S: Scalar>(&self, v: Vec3<S>) -> Vec3<S> {
        match &self.bend {
            Bend::Straight => v,
            Bend::Quarter => quarter_back(v),
            Bend::By(turn) => Turn::constant(v[0], turn).back::<0>(v),
        }
    }

    /// Where the moved body's origin is in the parent, in the parent's axes.
    #[inline(always)]
    pub(super) fn p_PK<S: Scalar>(&self, q: S) -> Vec3<S> {
        let p = Vec3::constant(q, &self.p_PK);
        if self.slides {
            Vec3::constant(q, &self.axis_P).mul_add(q, p)
        } else {
            p
        }
    }

    /// A force on the moved body as one on the parent.
    #[inline(always)]
    pub(super) fn force_out<S: Scalar>(&self, turn: &Turn<S>, q: S, f: Force<S>) -> Force<S> {
        let f = if self.slides { f.shifted::<2>(q) } else { f };
        let mut f = Force {
            torque: self.bent_out(turn.out::<2>(f.torque)),
            force: self.bent_out(turn.out::<2>(f.force)),
        };
        if self.shifts {
            let p = self.p.map(|x| q.constant(x));
            if self.p[0] != 0.0 {
                f = f.shifted::<0>(p[0]);
            }
            if self.p[1] != 0.0 {
                f = f.shifted::<1>(p[1]);
            }
            if self.p[2] != 0.0 {
                f = f.shifted::<2>(p[2]);
            }
        }
        if let Some(swing) = &self.swing {
            let swing = Turn::constant(q, swing);
            f = Force {
                torque: swing.out::<2>(f.torque),
                force: swing.out::<2>(f.force),
            };
        }
        f
    }

    /// The parent's motion as the moved body would share it.
    #[inline(always)]
    pub(super) fn motion_into<S: Scalar>(&self, turn: &Turn<S>, q: S, m: Motion<S>) -> Motion<S> {
        let mut m = Motion {
            angular: self.unswung(m.angular),
            linear: self.unswung(m.linear),
        };
        if self.shifts {
            let p = self.p.map(|x| q.constant(x));
            if self.p[0] != 0.0 {
                m = m.shifted::<0>(p[0]);
            }
            if self.p[1] != 0.0 {
                m = m.shifted::<1>(p[1]);
            }
            if self.p[2] != 0.0 {
                m = m.shifted::<2>(p[2]);
            }
        }
        let m = Motion {
            angular: turn.back::<2>(self.bent_into(m.angular)),
            linear: turn.back::<2>(self.bent_into(m.linear)),
        };
        if self.slides { m.shifted::<2>(q) } else { m }
    }

    /// The inertia that the parent feels of a body whose joint has given way, in the parent's frame. The
    /// joint feels nothing along its axis any more, which saves a part of the first turn.
    #[inline(always)]
    pub(super) fn inertia_out<S: Scalar>(
        &self,
        turn: &Turn<S>,
        q: S,
        inertia: ArticulatedInertia<S>,
    ) -> ArticulatedInertia<S> {
        let inertia = if self.slides {
            inertia.shifted::<2>(q).turned::<2>(turn)
        } else {
            ArticulatedInertia {
                turning: turn.sym_in_plane::<2>(inertia.turning),
                coupling: turn.mat_across::<2>(inertia.coupling),
                mass: turn.sym::<2>(inertia.mass),
            }
        };
        let mut inertia = match &self.bend {
            Bend::Straight => inertia,
            Bend::Quarter => inertia.quarter_turned(),
            Bend::By(bend) => inertia.turned::<0>(&Turn::constant(q, bend)),
        };
        if self.shifts {
            let p = self.p.map(|x| q.constant(x));
            if self.p[0] != 0.0 {
                inertia = inertia.shifted::<0>(p[0]);
            }
            if self.p[1] != 0.0 {
                inertia = inertia.shifted::<1>(p[1]);
            }
            if self.p[2] != 0.0 {
                inertia = inertia.shifted::<2>(p[2]);
            }
        }
        match &self.swing {
            None => inertia,
            Some(swing) => inertia.turned::<2>(&Turn::constant(q, swing)),
        }
    }
}
