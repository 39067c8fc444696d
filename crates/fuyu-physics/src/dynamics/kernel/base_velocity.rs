//! The base's angular velocity from the momentum that the system keeps.
//!
//! Masutani 1995 eq. (4.23) without its matrices: one sweep inward gathers every subtree's inertia and the
//! momentum that it has while the base is held; the base takes what is left. It needs neither poses nor
//! the columns of a momentum map.

use super::composite_inertia::Composite;
use super::joint_transform::{Force, on_path};
use super::momentum_map::about_com;
use super::tree::{Hop, Tree};
use super::{ArticulatedInertia, Scalar, Slot, Sym3, Vec3};

/// What the sweep keeps of a body with its whole subtree where branches meet, in the body's kernel frame.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct Carried<S> {
    subtree: Composite<S>,
    /// Momentum at the joints' rates while the base is held, about the subtree's foot.
    momentum: Force<S>,
}

impl<S: Scalar> Carried<S> {
    /// With nothing in it, numbers of the kind of `like`.
    pub fn new(like: S) -> Self {
        let zero = like.constant(0.0);
        let subtree = Composite {
            first_moment: Vec3::zero(like),
            inertia: Sym3 {
                diagonal: [zero; 3],
                off: [zero; 3],
            },
        };
        Self {
            subtree,
            momentum: Force::zero(like),
        }
    }

    /// The subtree, moved by its joint, as the parent carries it.
    #[inline(always)]
    fn handed_on(self, hop: &Hop, mass: f64, slot: &Slot<S>) -> Self {
        let Composite {
            first_moment: h,
            inertia: J,
        } = self.subtree;
        let (q, qd, mut momentum) = (slot.q, slot.qd, self.momentum);
        if hop.slides {
            let [x, y, _] = &mut momentum.torque.0;
            *x = h[1].mul_add(qd, *x);
            *y = h[0].mul_sub_from(qd, *y);
            momentum.force[2] = qd.mul_add(qd.constant(mass), momentum.force[2]);
        } else {
            momentum.torque = J.row(2).mul_add(qd, momentum.torque);
            momentum.force[0] = h[1].mul_sub_from(qd, momentum.force[0]);
            momentum.force[1] = h[0].mul_add(qd, momentum.force[1]);
        }
        on_path!(hop, path => Self {
            subtree: path.hand_on(hop, &slot.turn, q, mass, self.subtree),
            momentum: path.force_on_foot(hop, &slot.turn, q, momentum),
        })
    }

    #[inline(always)]
    fn plus(self, o: Self) -> Self {
        Self {
            subtree: self.subtree.plus(o.subtree),
            momentum: self.momentum.plus(o.momentum),
        }
    }
}

/// The whole tree as the base carries it. `carried`, one per body, is scratch; `slots` hold positions (with
/// their turns) and rates of the joints.
#[inline(always)]
fn carry<S: Scalar>(tree: &Tree, slots: &[Slot<S>], carried: &mut [Carried<S>]) -> Carried<S> {
    let count = tree.bodies.len();
    let (slots, carried) = (&slots[..count], &mut carried[..count]);
    let (bodies, like) = (&tree.bodies[..count], slots[0].q);
    for &leaf in &tree.leaves {
        carried[leaf] = Carried {
            subtree: Composite::constant(like, &bodies[leaf].about_foot),
            momentum: Force::zero(like),
        };
    }
    let mut gathered = carried[tree.outward.last().map_or(0, |j| j + 1)];
    for &j in tree.outward.iter().rev() {
        let (hop, mass) = (&tree.hops[j], bodies[j + 1].subtree_mass);
        gathered = gathered.handed_on(hop, mass, &slots[j + 1]);
        if !hop.arrives_first {
            gathered = carried[hop.parent].plus(gathered);
        }
        if !hop.follows {
            carried[hop.parent] = gathered;
            gathered = carried[hop.before];
        }
    }
    gathered
}

/// Inertia of the whole tree, all joints locked, in the base's kernel frame. `slots` hold positions (with their
/// turns) and rates of the joints; `carried`, one per body, is scratch.
#[inline(always)]
pub(crate) fn whole_inertia<S: Scalar>(
    tree: &Tree,
    slots: &[Slot<S>],
    carried: &mut [Carried<S>],
) -> ArticulatedInertia<S> {
    let whole = carry(tree, slots, carried).subtree;
    whole.with_mass(tree.bodies[0].subtree_mass)
}

/// Angular velocity of the base when the system has an angular momentum about its centre of mass, both in
/// the base's kernel frame. `slots` hold positions (with their turns) and rates of the joints; `carried`,
/// one per body, is scratch.
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[inline(always)]
pub fn base_spin<S: Scalar>(
    tree: &Tree,
    slots: &[Slot<S>],
    carried: &mut [Carried<S>],
    angular_momentum: Vec3<S>,
) -> Vec3<S> {
    let Carried { subtree, momentum } = carry(tree, slots, carried);
    let (p, inertia) = about_com(subtree, tree.bodies[0].subtree_mass);
    let Force { torque, force } = momentum;
    // Without the moment of the linear momentum, the joints' share is about the centre of mass too.
    let left = (angular_momentum - torque) + p.cross(force);
    inertia.inverse().times(left)
}
