//! The inertia of a subtree, handed on from body to body towards the base.
//!
//! A subtree is held about the foot of the common normal that its joint's axis has with the parent's axis,
//! not about the origin of the frame. Then all that a hop adds is known beforehand, the parent's own
//! inertia included ([`Hop::arrival`]), and goes into the sums that the turn makes anyway: what has to wait
//! for the subtree before it is one turn and, of each shift that there is, one product.

use super::joint_transform::{Path, on_path};
use super::tree::Hop;
use super::vector::others;
use super::{ArticulatedInertia, Force, Scalar, Sym3, Turn, Vec3};
use crate::spatial::SpatialInertia;

/// A body with its whole subtree, in the axes of the body's kernel frame. Its mass is known to the tree.
#[derive(Debug, Clone, Copy)]
pub(super) struct Composite<S> {
    /// First moment about the foot.
    pub first_moment: Vec3<S>,
    /// Moment of inertia about the foot.
    pub inertia: Sym3<S>,
}

impl<S: Scalar> Composite<S> {
    /// A body whose inertia does not depend on positions, numbers of the kind of `like`.
    #[inline(always)]
    pub(super) fn constant(like: S, body: &SpatialInertia) -> Self {
        Self {
            first_moment: Vec3::constant(like, &body.first_moment.into()),
            inertia: Sym3::constant(like, &body.about_origin),
        }
    }

    /// Two that hang on the same body.
    #[inline(always)]
    pub(super) fn plus(self, o: Self) -> Self {
        Self {
            first_moment: self.first_moment + o.first_moment,
            inertia: self.inertia + o.inertia,
        }
    }

    /// Row of the moment of inertia along the joint's axis, about the frame's origin, which lies `rise`
    /// along the axis from the foot.
    #[inline(always)]
    pub(super) fn along_axis(&self, rise: f64) -> Vec3<S> {
        let (Vec3([x, y, _]), Sym3 { diagonal, off }) = (self.first_moment, self.inertia);
        let rise = x.constant(rise);
        Vec3([
            x.mul_add(rise, off[1]),
            y.mul_add(rise, off[0]),
            diagonal[2],
        ])
    }

    /// The whole tree's, all joints locked.
    #[inline(always)]
    pub(crate) fn with_mass(&self, mass: f64) -> ArticulatedInertia<S> {
        let mass = self.first_moment[0].constant(mass);
        ArticulatedInertia::rigid(mass, self.first_moment, self.inertia)
    }

    /// The subtree of the body that a joint moves, as a part of its parent's subtree.
    #[inline(always)]
    pub(super) fn handed_on(self, hop: &Hop, turn: &Turn<S>, q: S, mass: f64) -> Self {
        on_path!(hop, path => path.hand_on(hop, turn, q, mass, self))
    }

    /// To the place where a slide's foot is, from which the present one lies at `p` along z.
    #[inline(always)]
    fn slid(mut self, p: S, mass: f64) -> Self {
        let moment = p.times(mass);
        let (h, J) = (&mut self.first_moment, &mut self.inertia);
        let more = (p + p).mul_add(h[2], p * moment);
        J.diagonal[0] = J.diagonal[0] + more;
        J.diagonal[1] = J.diagonal[1] + more;
        J.off[1] = p.mul_sub_from(h[0], J.off[1]);
        J.off[0] = p.mul_sub_from(h[1], J.off[0]);
        h[2] = h[2] + moment;
        self
    }
}

impl<const GENERAL: bool, const BEND: u8, const D: bool, const A: bool> Path<GENERAL, BEND, D, A> {
    #[inline(always)]
    pub(super) fn hand_on<S: Scalar>(
        self,
        hop: &Hop,
        turn: &Turn<S>,
        q: S,
        mass: f64,
        mut subtree: Composite<S>,
    ) -> Composite<S> {
        if hop.slides {
            subtree = subtree.slid(hop.distance(q), mass);
        }
        let h = turn.out::<2>(subtree.first_moment);
        let more = Sym3::constant(q, &hop.arrival.about_origin);
        let J = turn.sym_onto::<2>(subtree.inertia, more);
        let (mut h, mut J) = (self.bent_out(hop, h), self.bent_sym_out(hop, J));
        if GENERAL {
            let swing = Turn::constant(q, &hop.swing);
            (h, J) = (swing.out::<2>(h), swing.sym::<2>(J));
            J = seen_from::<S, 1>(hop.foot[1], h, J);
        }
        if A || GENERAL {
            J = seen_from::<S, 0>(hop.foot[0], h, J);
        }
        if hop.foot[2] != 0.0 {
            J = seen_from::<S, 2>(hop.foot[2], h, J);
        }
        Composite {
            first_moment: h + Vec3::constant(q, &hop.arrival.first_moment.into()),
            inertia: J,
        }
    }

    /// A force about the moved body's foot as one about the parent's.
    #[inline(always)]
    pub(super) fn force_on_foot<S: Scalar>(
        self,
        hop: &Hop,
        turn: &Turn<S>,
        q: S,
        mut f: Force<S>,
    ) -> Force<S> {
        if hop.slides {
            f = f.shifted::<2>(hop.distance(q));
        }
        f = Force {
            torque: self.bent_out(hop, turn.out::<2>(f.torque)),
            force: self.bent_out(hop, turn.out::<2>(f.force)),
        };
        let [x, y, z] = hop.foot;
        if GENERAL {
            let swing = Turn::constant(q, &hop.swing);
            f = Force {
                torque: swing.out::<2>(f.torque),
                force: swing.out::<2>(f.force),
            };
            f = f.shifted::<1>(q.constant(y));
        }
        if A || GENERAL {
            f = f.shifted::<0>(q.constant(x));
        }
        if z != 0.0 {
            f = f.shifted::<2>(q.constant(z));
        }
        f
    }
}

/// `J + 2 (p·h) 1 - p hᵀ - h pᵀ` for a `p` along one axis: what the first moment adds to an inertia about a point
/// from which its own lies at `p`.
#[inline(always)]
fn seen_from<S: Scalar, const AXIS: usize>(p: f64, h: Vec3<S>, mut J: Sym3<S>) -> Sym3<S> {
    let (i, (j, k)) = (AXIS, others(AXIS));
    let (once, twice) = (h[i].constant(p), h[i].constant(p + p));
    J.diagonal[j] = twice.mul_add(h[i], J.diagonal[j]);
    J.diagonal[k] = twice.mul_add(h[i], J.diagonal[k]);
    J.off[k] = once.mul_sub_from(h[j], J.off[k]);
    J.off[j] = once.mul_sub_from(h[k], J.off[j]);
    J
}
