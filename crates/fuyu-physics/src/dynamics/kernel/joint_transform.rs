//! Motions and forces from a body to its parent and back.

use super::articulated_inertia::{ArticulatedInertia, quarter_sym};
use super::tree::{Hop, QUARTER, STRAIGHT};
use super::vector::others;
use super::{Scalar, Sym3, Turn, Vec3};

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
    pub(super) fn shifted<const AXIS: usize>(mut self, p: S) -> Self {
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

/// `Rx(90°) v`.
#[inline(always)]
pub(super) fn quarter<S: Scalar>(v: Vec3<S>) -> Vec3<S> {
    Vec3([v[0], -v[2], v[1]])
}

/// `Rx(-90°) v`.
#[inline(always)]
fn quarter_back<S: Scalar>(v: Vec3<S>) -> Vec3<S> {
    Vec3([v[0], v[2], -v[1]])
}

/// What of a hop is computed, known to the compiler: the bend, and whether there are shifts along the
/// joint's axis and along the common normal. `GENERAL` does everything that the hop has.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path<const GENERAL: bool, const BEND: u8, const D: bool, const A: bool>;

impl Hop {
    /// The turn about z at a joint position whose cosine and sine are known.
    #[inline(always)]
    pub(crate) fn turn<S: Scalar>(&self, cos: S, sin: S) -> Turn<S> {
        let (c, s) = (cos.constant(self.home[0]), cos.constant(self.home[1]));
        if self.slides {
            Turn::new(c, s)
        } else if self.is_home {
            Turn::new(cos, sin)
        } else {
            Turn::new(s.mul_sub_from(sin, c * cos), s.mul_add(cos, c * sin))
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

    /// Distance along the joint's axis.
    #[inline(always)]
    pub(super) fn distance<S: Scalar>(&self, q: S) -> S {
        if self.slides {
            q.plus(self.d)
        } else {
            q.constant(self.d)
        }
    }
}

impl<const GENERAL: bool, const BEND: u8, const D: bool, const A: bool> Path<GENERAL, BEND, D, A> {
    #[inline(always)]
    pub(super) fn bent_sym_out<S: Scalar>(self, hop: &Hop, m: Sym3<S>) -> Sym3<S> {
        match BEND {
            STRAIGHT => m,
            QUARTER => quarter_sym(m),
            _ => Turn::constant(m.off[0], &hop.bend).sym::<0>(m),
        }
    }

    #[inline(always)]
    pub(super) fn bent_out<S: Scalar>(self, hop: &Hop, v: Vec3<S>) -> Vec3<S> {
        match BEND {
            STRAIGHT => v,
            QUARTER => quarter(v),
            _ => Turn::constant(v[0], &hop.bend).out::<0>(v),
        }
    }

    #[inline(always)]
    fn bent_back<S: Scalar>(self, hop: &Hop, v: Vec3<S>) -> Vec3<S> {
        match BEND {
            STRAIGHT => v,
            QUARTER => quarter_back(v),
            _ => Turn::constant(v[0], &hop.bend).back::<0>(v),
        }
    }

    /// Whether the moved body's origin may be elsewhere than the parent's.
    #[inline(always)]
    pub(super) fn shifts(self) -> bool {
        GENERAL || D || A
    }

    /// A free vector from the parent's axes to the moved body's.
    #[inline(always)]
    pub(super) fn back<S: Scalar>(self, hop: &Hop, turn: &Turn<S>, v: Vec3<S>) -> Vec3<S> {
        let v = if GENERAL {
            Turn::constant(turn.cos, &hop.swing).back::<2>(v)
        } else {
            v
        };
        turn.back::<2>(self.bent_back(hop, v))
    }

    /// A tensor of the parent's axes times the moved body's origin.
    #[inline(always)]
    pub(super) fn times_origin<S: Scalar>(self, hop: &Hop, q: S, m: Sym3<S>) -> Vec3<S> {
        if A && !D && !GENERAL && !hop.slides {
            m.row(0).scaled(q.constant(hop.p[0]))
        } else {
            m.times(hop.p_PK(q))
        }
    }

    /// A force on the moved body as one on the parent.
    #[inline(always)]
    pub(super) fn force_out<S: Scalar>(
        self,
        hop: &Hop,
        turn: &Turn<S>,
        q: S,
        f: Force<S>,
    ) -> Force<S> {
        let f = if D || GENERAL {
            f.shifted::<2>(hop.distance(q))
        } else {
            f
        };
        let mut f = Force {
            torque: self.bent_out(hop, turn.out::<2>(f.torque)),
            force: self.bent_out(hop, turn.out::<2>(f.force)),
        };
        let p = Vec3::constant(q, &hop.p);
        if A || GENERAL {
            f = f.shifted::<0>(p[0]);
        }
        if GENERAL {
            f = f.shifted::<1>(p[1]).shifted::<2>(p[2]);
            let swing = Turn::constant(q, &hop.swing);
            f = Force {
                torque: swing.out::<2>(f.torque),
                force: swing.out::<2>(f.force),
            };
        }
        f
    }

    /// The parent's motion as the moved body would share it.
    #[inline(always)]
    pub(super) fn motion_back<S: Scalar>(
        self,
        hop: &Hop,
        turn: &Turn<S>,
        q: S,
        mut m: Motion<S>,
    ) -> Motion<S> {
        let p = Vec3::constant(q, &hop.p);
        if GENERAL {
            let swing = Turn::constant(q, &hop.swing);
            m = Motion {
                angular: swing.back::<2>(m.angular),
                linear: swing.back::<2>(m.linear),
            };
            m = m.shifted::<1>(p[1]).shifted::<2>(p[2]);
        }
        if A || GENERAL {
            m = m.shifted::<0>(p[0]);
        }
        let m = Motion {
            angular: turn.back::<2>(self.bent_back(hop, m.angular)),
            linear: turn.back::<2>(self.bent_back(hop, m.linear)),
        };
        if D || GENERAL {
            m.shifted::<2>(hop.distance(q))
        } else {
            m
        }
    }

    /// The inertia that the parent feels of a body whose joint has given way, in the parent's frame. A
    /// turning joint feels nothing along its axis any more, which saves a part of the first turn.
    #[inline(always)]
    pub(super) fn inertia_out<S: Scalar, const SLIDES: bool>(
        self,
        hop: &Hop,
        turn: &Turn<S>,
        q: S,
        mut inertia: ArticulatedInertia<S>,
    ) -> ArticulatedInertia<S> {
        let like = q;
        if SLIDES {
            inertia = inertia.shifted::<2>(hop.distance(q)).turned::<2>(turn);
        } else {
            if D || GENERAL {
                inertia = inertia.shifted_in_plane(hop.distance(q));
            }
            inertia = ArticulatedInertia {
                turning: turn.sym_in_plane::<2>(inertia.turning),
                coupling: turn.mat_across::<2>(inertia.coupling),
                mass: turn.sym::<2>(inertia.mass),
            };
        }
        match BEND {
            STRAIGHT => {}
            QUARTER => inertia = inertia.quarter_turned(),
            _ => inertia = inertia.turned::<0>(&Turn::constant(like, &hop.bend)),
        }
        let p = Vec3::constant(like, &hop.p);
        if A || GENERAL {
            inertia = inertia.shifted::<0>(p[0]);
        }
        if GENERAL {
            inertia = inertia.shifted::<1>(p[1]).shifted::<2>(p[2]);
            inertia = inertia.turned::<2>(&Turn::constant(like, &hop.swing));
        }
        inertia
    }
}

/// Runs the expression with the [`Path`] of a hop, by the hop's `shape`.
macro_rules! on_path {
    ($hop:expr, $path:ident => $run:expr) => {{
        use crate::dynamics::kernel::joint_transform::Path;
        use crate::dynamics::kernel::tree::{BENT, QUARTER, STRAIGHT};
        match $hop.shape {
            0 => {
                let $path = Path::<false, STRAIGHT, false, false>;
                $run
            }
            1 => {
                let $path = Path::<false, STRAIGHT, false, true>;
                $run
            }
            2 => {
                let $path = Path::<false, STRAIGHT, true, false>;
                $run
            }
            3 => {
                let $path = Path::<false, STRAIGHT, true, true>;
                $run
            }
            4 => {
                let $path = Path::<false, QUARTER, false, false>;
                $run
            }
            5 => {
                let $path = Path::<false, QUARTER, false, true>;
                $run
            }
            6 => {
                let $path = Path::<false, QUARTER, true, false>;
                $run
            }
            7 => {
                let $path = Path::<false, QUARTER, true, true>;
                $run
            }
            8 => {
                let $path = Path::<false, BENT, false, false>;
                $run
            }
            9 => {
                let $path = Path::<false, BENT, false, true>;
                $run
            }
            10 => {
                let $path = Path::<false, BENT, true, false>;
                $run
            }
            11 => {
                let $path = Path::<false, BENT, true, true>;
                $run
            }
            _ => {
                let $path = Path::<true, BENT, true, true>;
                $run
            }
        }
    }};
}
pub(super) use on_path;
