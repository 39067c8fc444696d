//! Composite inertia of a subtree, and its transform towards the base.
//!
//! The reference point of a subtree's inertia is not the origin of the frame but the point where the common normal with
//! the parent's axis meets the joint axis. All constant terms of a joint transform, including the parent's own inertia,
//! are then precomputed ([`JointTransform::parent_term`]) and added within the rotation. The chain of dependent
//! operations is one rotation per joint, plus one product for each translation.

use super::joint_transform::{TransformShape, with_shape};
use super::tree::JointTransform;
use super::vector::other_axes;
use super::{ArticulatedInertia, PlanarRotation, Scalar, SpatialForce, Sym3, Vec3};
use crate::spatial::SpatialInertia;

/// Composite inertia of a subtree about its reference point, in the axes of its first body's kernel frame. The mass is
/// stored in the tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CompositeInertia<S> {
    /// First moment \[kg m\].
    pub first_moment: Vec3<S>,
    /// Moment of inertia \[kg m²\].
    pub inertia: Sym3<S>,
}

impl<S: Scalar> CompositeInertia<S> {
    /// A constant inertia, with numbers of the kind of `like`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn constant(like: S, body: &SpatialInertia) -> Self {
        Self {
            first_moment: Vec3::constant(like, &body.first_moment.into()),
            inertia: Sym3::constant(like, &body.about_origin),
        }
    }

    /// Sum of two inertias about the same point.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn plus(self, o: Self) -> Self {
        Self {
            first_moment: self.first_moment + o.first_moment,
            inertia: self.inertia + o.inertia,
        }
    }

    /// Row z (the joint axis) of the moment of inertia about the frame's origin, which lies at `d_from_reference` on
    /// that axis.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn axis_row(&self, d_from_reference: f64) -> Vec3<S> {
        let (Vec3([x, y, _]), Sym3 { diagonal, off }) = (self.first_moment, self.inertia);
        let d_from_reference = x.constant(d_from_reference);
        Vec3([
            x.mul_add(d_from_reference, off[1]),
            y.mul_add(d_from_reference, off[0]),
            diagonal[2],
        ])
    }

    /// The subtree with all its joints locked, as a rigid body of mass `mass`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn rigid_inertia(&self, mass: f64) -> ArticulatedInertia<S> {
        let mass = self.first_moment[0].constant(mass);
        ArticulatedInertia::rigid(mass, self.first_moment, self.inertia)
    }

    /// Transforms the inertia to the parent's frame and reference point, and adds `parent_term`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn to_parent(
        self,
        joint: &JointTransform,
        rotation: &PlanarRotation<S>,
        q: S,
        mass: f64,
    ) -> Self {
        with_shape!(joint, shape => shape.inertia_about_parent_reference(joint, rotation, q, mass, self))
    }

    /// The same inertia about a new reference point, from which the present one lies at `p` along z.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn shifted_along_z(mut self, p: S, mass: f64) -> Self {
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

impl<const GENERAL: bool, const ALPHA: u8, const D: bool, const A: bool>
    TransformShape<GENERAL, ALPHA, D, A>
{
    /// [`CompositeInertia::to_parent`] of `subtree`, which has mass `mass`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn inertia_about_parent_reference<S: Scalar>(
        self,
        joint: &JointTransform,
        rotation: &PlanarRotation<S>,
        q: S,
        mass: f64,
        mut subtree: CompositeInertia<S>,
    ) -> CompositeInertia<S> {
        if joint.is_prismatic {
            subtree = subtree.shifted_along_z(joint.d_at(q), mass);
        }
        let h = rotation.apply::<2>(subtree.first_moment);
        let parent_term = Sym3::constant(q, &joint.parent_term.about_origin);
        let J = rotation.rotate_sym_and_add::<2>(subtree.inertia, parent_term);
        let (mut h, mut J) = (
            self.rotate_by_alpha(joint, h),
            self.rotate_sym_by_alpha(joint, J),
        );
        if GENERAL {
            let gamma = PlanarRotation::constant(q, &joint.gamma);
            (h, J) = (gamma.apply::<2>(h), gamma.rotate_sym::<2>(J));
            J = add_first_moment::<S, 1>(joint.p_reference[1], h, J);
        }
        if A || GENERAL {
            J = add_first_moment::<S, 0>(joint.p_reference[0], h, J);
        }
        if joint.p_reference[2] != 0.0 {
            J = add_first_moment::<S, 2>(joint.p_reference[2], h, J);
        }
        CompositeInertia {
            first_moment: h + Vec3::constant(q, &joint.parent_term.first_moment.into()),
            inertia: J,
        }
    }

    /// Transforms a force about the body's reference point to the parent's reference point and axes.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn force_about_parent_reference<S: Scalar>(
        self,
        joint: &JointTransform,
        rotation: &PlanarRotation<S>,
        q: S,
        mut f: SpatialForce<S>,
    ) -> SpatialForce<S> {
        if joint.is_prismatic {
            f = f.shifted::<2>(joint.d_at(q));
        }
        f = SpatialForce {
            torque: self.rotate_by_alpha(joint, rotation.apply::<2>(f.torque)),
            force: self.rotate_by_alpha(joint, rotation.apply::<2>(f.force)),
        };
        let [x, y, z] = joint.p_reference;
        if GENERAL {
            let gamma = PlanarRotation::constant(q, &joint.gamma);
            f = SpatialForce {
                torque: gamma.apply::<2>(f.torque),
                force: gamma.apply::<2>(f.force),
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

/// `J + 2 (p·h) 1 - p hᵀ - h pᵀ` for a `p` along one axis: the terms with the first moment `h` when an inertia is moved
/// to a point from which its reference point lies at `p`.
#[cfg_attr(not(debug_assertions), inline(always))]
fn add_first_moment<S: Scalar, const AXIS: usize>(p: f64, h: Vec3<S>, mut J: Sym3<S>) -> Sym3<S> {
    let (i, (j, k)) = (AXIS, other_axes(AXIS));
    let (once, twice) = (h[i].constant(p), h[i].constant(p + p));
    J.diagonal[j] = twice.mul_add(h[i], J.diagonal[j]);
    J.diagonal[k] = twice.mul_add(h[i], J.diagonal[k]);
    J.off[k] = once.mul_sub_from(h[j], J.off[k]);
    J.off[j] = once.mul_sub_from(h[k], J.off[j]);
    J
}
