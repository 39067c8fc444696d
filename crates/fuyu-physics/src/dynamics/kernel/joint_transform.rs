//! Transforms across a joint ([`JointTransform`], defined in [`super::tree`]): motions, forces and inertias from a body's
//! frame to its parent's and back.

use super::articulated_inertia::{ArticulatedInertia, rotate_sym_x_90};
use super::tree::{ALPHA_RIGHT_ANGLE, ALPHA_ZERO, JointTransform};
use super::vector::other_axes;
use super::{PlanarRotation, Scalar, Sym3, Vec3};

/// Spatial force: a force, and its moment about a frame's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialForce<S> {
    /// Moment \[N m\].
    pub torque: Vec3<S>,
    /// Force \[N\].
    pub force: Vec3<S>,
}

/// Spatial velocity or acceleration; the linear part is that of the point at the frame's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialMotion<S> {
    /// Angular part.
    pub angular: Vec3<S>,
    /// Linear part.
    pub linear: Vec3<S>,
}

impl<S: Scalar> SpatialForce<S> {
    /// Zero.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn zero(like: S) -> Self {
        Self {
            torque: Vec3::zero(like),
            force: Vec3::zero(like),
        }
    }

    /// Sum with a force about the same point.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn plus(self, o: Self) -> Self {
        Self {
            torque: self.torque + o.torque,
            force: self.force + o.force,
        }
    }

    /// The same force about a new reference point, from which the present one lies at `p`, along one axis.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn shifted<const AXIS: usize>(mut self, p: S) -> Self {
        let (j, k) = other_axes(AXIS);
        self.torque[j] = p.mul_sub_from(self.force[k], self.torque[j]);
        self.torque[k] = p.mul_add(self.force[j], self.torque[k]);
        self
    }
}

impl<S: Scalar> SpatialMotion<S> {
    /// Zero.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn zero(like: S) -> Self {
        Self {
            angular: Vec3::zero(like),
            linear: Vec3::zero(like),
        }
    }

    /// The same motion, with the linear part of another point, at `p` along one axis.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn shifted<const AXIS: usize>(mut self, p: S) -> Self {
        let (j, k) = other_axes(AXIS);
        self.linear[j] = p.mul_add(self.angular[k], self.linear[j]);
        self.linear[k] = p.mul_sub_from(self.angular[j], self.linear[k]);
        self
    }
}

/// `Rx(90°) v`.
#[cfg_attr(not(debug_assertions), inline(always))]
pub(super) fn rotate_x_90<S: Scalar>(v: Vec3<S>) -> Vec3<S> {
    Vec3([v[0], -v[2], v[1]])
}

/// `Rx(-90°) v`.
#[cfg_attr(not(debug_assertions), inline(always))]
fn rotate_x_minus_90<S: Scalar>(v: Vec3<S>) -> Vec3<S> {
    Vec3([v[0], v[2], -v[1]])
}

/// [`JointTransform::shape`] as compile-time constants, so that the compiler omits operations with zeros: the kind of
/// `alpha`, and whether there are translations along the joint axis (`D`) and along the common normal (`A`). `GENERAL`
/// stands for any transform.
#[derive(Debug, Clone, Copy)]
pub(super) struct TransformShape<const GENERAL: bool, const ALPHA: u8, const D: bool, const A: bool>;

impl JointTransform {
    /// Rotation by `theta` from cosine and sine of the joint position.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn rotation<S: Scalar>(&self, cos: S, sin: S) -> PlanarRotation<S> {
        let (c, s) = (cos.constant(self.theta_0[0]), cos.constant(self.theta_0[1]));
        if self.is_prismatic {
            PlanarRotation::new(c, s)
        } else if self.theta_0_is_zero {
            PlanarRotation::new(cos, sin)
        } else {
            PlanarRotation::new(s.mul_sub_from(sin, c * cos), s.mul_add(cos, c * sin))
        }
    }

    /// Origin of the body's frame in the parent's frame.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn p_PK<S: Scalar>(&self, q: S) -> Vec3<S> {
        let p = Vec3::constant(q, &self.p_PK);
        if self.is_prismatic {
            Vec3::constant(q, &self.axis_P).mul_add(q, p)
        } else {
            p
        }
    }

    /// Translation along the joint's axis.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn d_at<S: Scalar>(&self, q: S) -> S {
        if self.is_prismatic {
            q.plus(self.d)
        } else {
            q.constant(self.d)
        }
    }
}

impl<const GENERAL: bool, const ALPHA: u8, const D: bool, const A: bool>
    TransformShape<GENERAL, ALPHA, D, A>
{
    /// `Rx(alpha) m Rx(alpha)ᵀ`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn rotate_sym_by_alpha<S: Scalar>(
        self,
        joint: &JointTransform,
        m: Sym3<S>,
    ) -> Sym3<S> {
        match ALPHA {
            ALPHA_ZERO => m,
            ALPHA_RIGHT_ANGLE => rotate_sym_x_90(m),
            _ => PlanarRotation::constant(m.off[0], &joint.alpha).rotate_sym::<0>(m),
        }
    }

    /// `Rx(alpha) v`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn rotate_by_alpha<S: Scalar>(self, joint: &JointTransform, v: Vec3<S>) -> Vec3<S> {
        match ALPHA {
            ALPHA_ZERO => v,
            ALPHA_RIGHT_ANGLE => rotate_x_90(v),
            _ => PlanarRotation::constant(v[0], &joint.alpha).apply::<0>(v),
        }
    }

    /// `Rx(-alpha) v`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn rotate_by_minus_alpha<S: Scalar>(self, joint: &JointTransform, v: Vec3<S>) -> Vec3<S> {
        match ALPHA {
            ALPHA_ZERO => v,
            ALPHA_RIGHT_ANGLE => rotate_x_minus_90(v),
            _ => PlanarRotation::constant(v[0], &joint.alpha).apply_inverse::<0>(v),
        }
    }

    /// Whether the origins of the two frames may differ.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn has_translation(self) -> bool {
        GENERAL || D || A
    }

    /// Rotates a vector from the parent's axes to the body's.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn to_child<S: Scalar>(
        self,
        joint: &JointTransform,
        rotation: &PlanarRotation<S>,
        v: Vec3<S>,
    ) -> Vec3<S> {
        let v = if GENERAL {
            PlanarRotation::constant(rotation.cos, &joint.gamma).apply_inverse::<2>(v)
        } else {
            v
        };
        rotation.apply_inverse::<2>(self.rotate_by_minus_alpha(joint, v))
    }

    /// `m p_PK` for a tensor in the parent's axes.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn times_child_origin<S: Scalar>(
        self,
        joint: &JointTransform,
        q: S,
        m: Sym3<S>,
    ) -> Vec3<S> {
        if A && !D && !GENERAL && !joint.is_prismatic {
            m.row(0).scaled(q.constant(joint.p[0]))
        } else {
            m.times(joint.p_PK(q))
        }
    }

    /// Transforms a force from the body's frame to the parent's.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn force_to_parent<S: Scalar>(
        self,
        joint: &JointTransform,
        rotation: &PlanarRotation<S>,
        q: S,
        f: SpatialForce<S>,
    ) -> SpatialForce<S> {
        let f = if D || GENERAL {
            f.shifted::<2>(joint.d_at(q))
        } else {
            f
        };
        let mut f = SpatialForce {
            torque: self.rotate_by_alpha(joint, rotation.apply::<2>(f.torque)),
            force: self.rotate_by_alpha(joint, rotation.apply::<2>(f.force)),
        };
        let p = Vec3::constant(q, &joint.p);
        if A || GENERAL {
            f = f.shifted::<0>(p[0]);
        }
        if GENERAL {
            f = f.shifted::<1>(p[1]).shifted::<2>(p[2]);
            let gamma = PlanarRotation::constant(q, &joint.gamma);
            f = SpatialForce {
                torque: gamma.apply::<2>(f.torque),
                force: gamma.apply::<2>(f.force),
            };
        }
        f
    }

    /// Transforms a motion from the parent's frame to the body's.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn motion_to_child<S: Scalar>(
        self,
        joint: &JointTransform,
        rotation: &PlanarRotation<S>,
        q: S,
        mut m: SpatialMotion<S>,
    ) -> SpatialMotion<S> {
        let p = Vec3::constant(q, &joint.p);
        if GENERAL {
            let gamma = PlanarRotation::constant(q, &joint.gamma);
            m = SpatialMotion {
                angular: gamma.apply_inverse::<2>(m.angular),
                linear: gamma.apply_inverse::<2>(m.linear),
            };
            m = m.shifted::<1>(p[1]).shifted::<2>(p[2]);
        }
        if A || GENERAL {
            m = m.shifted::<0>(p[0]);
        }
        let m = SpatialMotion {
            angular: rotation.apply_inverse::<2>(self.rotate_by_minus_alpha(joint, m.angular)),
            linear: rotation.apply_inverse::<2>(self.rotate_by_minus_alpha(joint, m.linear)),
        };
        if D || GENERAL {
            m.shifted::<2>(joint.d_at(q))
        } else {
            m
        }
    }

    /// Transforms a projected inertia from the body's frame to the parent's. After a revolute joint the inertia is zero
    /// about the joint axis, which saves operations in the first rotation.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn inertia_to_parent<S: Scalar, const SLIDES: bool>(
        self,
        joint: &JointTransform,
        rotation: &PlanarRotation<S>,
        q: S,
        mut inertia: ArticulatedInertia<S>,
    ) -> ArticulatedInertia<S> {
        let like = q;
        if SLIDES {
            inertia = inertia.shifted::<2>(joint.d_at(q)).rotated::<2>(rotation);
        } else {
            if D || GENERAL {
                inertia = inertia.shifted_in_plane(joint.d_at(q));
            }
            inertia = ArticulatedInertia {
                rotational: rotation.rotate_sym_in_plane::<2>(inertia.rotational),
                coupling: rotation.rotate_mat_except_axis_row::<2>(inertia.coupling),
                mass: rotation.rotate_sym::<2>(inertia.mass),
            };
        }
        match ALPHA {
            ALPHA_ZERO => {}
            ALPHA_RIGHT_ANGLE => inertia = inertia.rotated_x_90(),
            _ => inertia = inertia.rotated::<0>(&PlanarRotation::constant(like, &joint.alpha)),
        }
        let p = Vec3::constant(like, &joint.p);
        if A || GENERAL {
            inertia = inertia.shifted::<0>(p[0]);
        }
        if GENERAL {
            inertia = inertia.shifted::<1>(p[1]).shifted::<2>(p[2]);
            inertia = inertia.rotated::<2>(&PlanarRotation::constant(like, &joint.gamma));
        }
        inertia
    }
}

/// Evaluates an expression with the [`TransformShape`] of a joint transform.
macro_rules! with_shape {
    ($joint:expr, $shape:ident => $run:expr) => {{
        use crate::dynamics::kernel::joint_transform::TransformShape;
        use crate::dynamics::kernel::tree::{ALPHA_GENERAL, ALPHA_RIGHT_ANGLE, ALPHA_ZERO};
        match $joint.shape {
            0 => {
                let $shape = TransformShape::<false, ALPHA_ZERO, false, false>;
                $run
            }
            1 => {
                let $shape = TransformShape::<false, ALPHA_ZERO, false, true>;
                $run
            }
            2 => {
                let $shape = TransformShape::<false, ALPHA_ZERO, true, false>;
                $run
            }
            3 => {
                let $shape = TransformShape::<false, ALPHA_ZERO, true, true>;
                $run
            }
            4 => {
                let $shape = TransformShape::<false, ALPHA_RIGHT_ANGLE, false, false>;
                $run
            }
            5 => {
                let $shape = TransformShape::<false, ALPHA_RIGHT_ANGLE, false, true>;
                $run
            }
            6 => {
                let $shape = TransformShape::<false, ALPHA_RIGHT_ANGLE, true, false>;
                $run
            }
            7 => {
                let $shape = TransformShape::<false, ALPHA_RIGHT_ANGLE, true, true>;
                $run
            }
            8 => {
                let $shape = TransformShape::<false, ALPHA_GENERAL, false, false>;
                $run
            }
            9 => {
                let $shape = TransformShape::<false, ALPHA_GENERAL, false, true>;
                $run
            }
            10 => {
                let $shape = TransformShape::<false, ALPHA_GENERAL, true, false>;
                $run
            }
            11 => {
                let $shape = TransformShape::<false, ALPHA_GENERAL, true, true>;
                $run
            }
            _ => {
                let $shape = TransformShape::<true, ALPHA_GENERAL, true, true>;
                $run
            }
        }
    }};
}
pub(super) use with_shape;
