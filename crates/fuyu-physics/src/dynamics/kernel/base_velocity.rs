//! The base's angular velocity from the system's momentum.
//!
//! Masutani 1995 eq. (4.23) without its matrices: one inward sweep sums composite inertias and the momentum of each
//! subtree at the given joint rates with the base at rest. The base's motion accounts for the rest of the momentum.
//! Neither poses nor a momentum map are needed.

use super::composite_inertia::CompositeInertia;
use super::joint_transform::{SpatialForce, with_shape};
use super::momentum_map::about_com;
use super::tree::{JointTransform, Tree};
use super::{ArticulatedInertia, LinkScratch, Scalar, Sym3, Vec3};

/// Composite inertia and momentum of a subtree, in the kernel frame of its first body. Scratch of
/// [`base_angular_velocity`], one element per body.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct SubtreeMomentum<S> {
    pub(crate) subtree: CompositeInertia<S>,
    /// Momentum at the given joint rates with the base at rest, about the subtree's reference point.
    pub(crate) momentum: SpatialForce<S>,
}

impl<S: Scalar> SubtreeMomentum<S> {
    /// All zero, with numbers of the kind of `like`.
    pub fn new(like: S) -> Self {
        let zero = like.constant(0.0);
        let subtree = CompositeInertia {
            first_moment: Vec3::zero(like),
            inertia: Sym3 {
                diagonal: [zero; 3],
                off: [zero; 3],
            },
        };
        Self {
            subtree,
            momentum: SpatialForce::zero(like),
        }
    }

    /// Adds the momentum of the joint's motion, and transforms to the parent's frame and reference point.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn to_parent(self, joint: &JointTransform, mass: f64, link: &LinkScratch<S>) -> Self {
        let CompositeInertia {
            first_moment: h,
            inertia: J,
        } = self.subtree;
        let (q, qd, mut momentum) = (link.q, link.qd, self.momentum);
        if joint.is_prismatic {
            let [x, y, _] = &mut momentum.torque.0;
            *x = h[1].mul_add(qd, *x);
            *y = h[0].mul_sub_from(qd, *y);
            momentum.force[2] = qd.mul_add(qd.constant(mass), momentum.force[2]);
        } else {
            momentum.torque = J.row(2).mul_add(qd, momentum.torque);
            momentum.force[0] = h[1].mul_sub_from(qd, momentum.force[0]);
            momentum.force[1] = h[0].mul_add(qd, momentum.force[1]);
        }
        with_shape!(joint, shape => Self {
            subtree: shape.inertia_about_parent_reference(joint, &link.rotation, q, mass, self.subtree),
            momentum: shape.force_about_parent_reference(joint, &link.rotation, q, momentum),
        })
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn plus(self, o: Self) -> Self {
        Self {
            subtree: self.subtree.plus(o.subtree),
            momentum: self.momentum.plus(o.momentum),
        }
    }

    /// Angular velocity of the base, if `self` is the whole tree, from the system's mass and its angular momentum about
    /// its centre of mass.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn base_angular_velocity(self, mass: f64, angular_momentum: Vec3<S>) -> Vec3<S> {
        let (p, inertia) = about_com(self.subtree, mass);
        let SpatialForce { torque, force } = self.momentum;
        // Subtracting the moment of the linear momentum refers the joints' angular momentum to the centre of mass.
        let of_base = (angular_momentum - torque) + p.cross(force);
        inertia.inverse().times(of_base)
    }
}

/// Inertia and momentum of the whole tree about the base's origin, in the base's kernel frame. `subtrees`, one per
/// body, is scratch; `links` hold positions (with their rotations) and rates of the joints.
#[cfg_attr(not(debug_assertions), inline(always))]
pub(crate) fn whole_tree<S: Scalar>(
    tree: &Tree,
    links: &[LinkScratch<S>],
    subtrees: &mut [SubtreeMomentum<S>],
) -> SubtreeMomentum<S> {
    let count = tree.bodies.len();
    let (links, subtrees) = (&links[..count], &mut subtrees[..count]);
    let (bodies, like) = (&tree.bodies[..count], links[0].q);
    for &leaf in &tree.leaves {
        subtrees[leaf] = SubtreeMomentum {
            subtree: CompositeInertia::constant(like, &bodies[leaf].about_reference),
            momentum: SpatialForce::zero(like),
        };
    }
    let mut subtree = subtrees[tree.outward.last().map_or(0, |j| j + 1)];
    for &j in tree.outward.iter().rev() {
        let (joint, mass) = (&tree.joints[j], bodies[j + 1].subtree_mass);
        subtree = subtree.to_parent(joint, mass, &links[j + 1]);
        if joint.adds_parent_inertia && joint.parent_is_previous {
            continue;
        }
        let parent = &mut subtrees[joint.parent];
        *parent = if joint.adds_parent_inertia {
            subtree
        } else {
            parent.plus(subtree)
        };
        subtree = subtrees[joint.previous];
    }
    subtree
}

/// Inertia of the whole tree with all joints locked, in the base's kernel frame. `links` hold positions (with their
/// rotations) and rates of the joints; `subtrees`, one per body, is scratch.
#[cfg_attr(not(debug_assertions), inline(always))]
pub(crate) fn locked_inertia<S: Scalar>(
    tree: &Tree,
    links: &[LinkScratch<S>],
    subtrees: &mut [SubtreeMomentum<S>],
) -> ArticulatedInertia<S> {
    let whole = whole_tree(tree, links, subtrees).subtree;
    whole.rigid_inertia(tree.bodies[0].subtree_mass)
}

/// Angular velocity of the base for the system's angular momentum about its centre of mass, both in the base's kernel
/// frame. `links` hold positions (with their rotations) and rates of the joints; `subtrees`, one per body, is scratch.
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[cfg_attr(not(debug_assertions), inline(always))]
pub fn base_angular_velocity<S: Scalar>(
    tree: &Tree,
    links: &[LinkScratch<S>],
    subtrees: &mut [SubtreeMomentum<S>],
    angular_momentum: Vec3<S>,
) -> Vec3<S> {
    let mass = tree.bodies[0].subtree_mass;
    whole_tree(tree, links, subtrees).base_angular_velocity(mass, angular_momentum)
}
