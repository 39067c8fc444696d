//! The base's angular velocity from the momentum that the system keeps.
//!
//! Masutani 1995 eq. (4.23) without its matrices: one sweep inward gathers every subtree's inertia and the
//! momentum that it has while the base is held; the base takes what is left. It needs neither poses nor
//! the columns of a momentum map.

use super::composite::about_com;
use super::hop::{Force, on_path};
use super::tree::{Body, Hop, Tree};
use super::{Scalar, Slot, Sym3, Vec3};

/// What the sweep keeps of a body with its whole subtree, in the body's kernel frame.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct Carried<S> {
    first_moment: Vec3<S>,
    /// Moment of inertia about the frame's origin.
    inertia: Sym3<S>,
    /// Momentum at the joints' rates while the base is held, about the frame's origin.
    momentum: Force<S>,
}

impl<S: Scalar> Carried<S> {
    /// With nothing in it, numbers of the kind of `like`.
    pub fn new(like: S) -> Self {
        let zero = like.constant(0.0);
        Self {
            first_moment: Vec3::zero(like),
            inertia: Sym3 {
                diagonal: [zero; 3],
                off: [zero; 3],
            },
            momentum: Force::zero(like),
        }
    }

    /// The body alone.
    #[inline(always)]
    fn begin(&mut self, body: &Body, like: S) {
        self.first_moment = Vec3::constant(like, &body.inertia.first_moment.into());
        self.inertia = Sym3::constant(like, &body.inertia.about_origin);
        self.momentum = Force::zero(like);
    }

    /// The subtree, moved by its joint, as the parent carries it.
    #[inline(always)]
    fn passed_on(self, hop: &Hop, mass: f64, slot: &Slot<S>) -> Self {
        let (h, J, q, qd) = (self.first_moment, self.inertia, slot.q, slot.qd);
        let mut momentum = self.momentum;
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
        on_path!(hop, path => {
            let (h, J) = path.composite_out(hop, &slot.turn, q, mass, h, J);
            Self {
                first_moment: h,
                inertia: J,
                momentum: path.force_out(hop, &slot.turn, q, momentum),
            }
        })
    }

    #[inline(always)]
    fn plus(self, o: Self) -> Self {
        Self {
            first_moment: self.first_moment + o.first_moment,
            inertia: self.inertia + o.inertia,
            momentum: self.momentum.plus(o.momentum),
        }
    }
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
    let count = tree.bodies.len();
    let (slots, carried) = (&slots[..count], &mut carried[..count]);
    let bodies = &tree.bodies[..count];
    for (carried, body) in carried.iter_mut().zip(bodies) {
        carried.begin(body, angular_momentum[0]);
    }
    let mut gathered = carried[tree.outward.last().map_or(0, |j| j + 1)];
    for &j in tree.outward.iter().rev() {
        let (hop, mass) = (&tree.hops[j], bodies[j + 1].subtree_mass);
        let passed = gathered.passed_on(hop, mass, &slots[j + 1]);
        gathered = carried[hop.parent].plus(passed);
        if !hop.follows {
            carried[hop.parent] = gathered;
            gathered = carried[hop.before];
        }
    }
    let base = &gathered;
    let (p, inertia) = about_com(base.first_moment, base.inertia, bodies[0].subtree_mass);
    let Force { torque, force } = base.momentum;
    // Without the moment of the linear momentum, the joints' share is about the centre of mass too.
    let left = (angular_momentum - torque) + p.cross(force);
    inertia.inverse().times(left)
}
