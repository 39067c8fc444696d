//! Inverse dynamics by recursive Newton-Euler, linear in the number of joints.

use super::joint_transform::{Force, Motion, on_path};
use super::tree::{Body, Hop, Tree};
use super::{Scalar, Slot, Sym3, Vec3};

impl Body {
    /// Force that accelerates the body, its spin aside.
    #[inline(always)]
    fn resists<S: Scalar>(&self, m: &Motion<S>) -> Force<S> {
        let like = m.angular[0];
        let h = &self.inertia.first_moment;
        let h = Vec3::constant(like, &[h.x, h.y, h.z]);
        let turning = Sym3::constant(like, &self.inertia.about_origin);
        Force {
            torque: turning.times(m.angular) + h.cross(m.linear),
            force: m
                .linear
                .mul_add(like.constant(self.inertia.mass), m.angular.cross(h)),
        }
    }
}

impl<S: Scalar> Slot<S> {
    /// Acceleration for the parent's and the joint's.
    #[inline(always)]
    fn follow(&mut self, hop: &Hop, parent: &Motion<S>) {
        let m = on_path!(hop, path => path.motion_back(hop, &self.turn, self.q, *parent));
        self.acceleration = Motion {
            angular: m.angular + self.own.angular,
            linear: m.linear + self.own.linear,
        };
        let along = if hop.slides {
            &mut self.acceleration.linear[2]
        } else {
            &mut self.acceleration.angular[2]
        };
        *along = *along + self.qdd;
    }

    #[inline(always)]
    fn resist(&mut self, body: &Body) {
        self.force = self.force.plus(body.resists(&self.acceleration));
    }
}

/// Joint efforts that go with accelerations. `slots`, one per body, hold positions (with their turns),
/// rates and accelerations of the joints, and angular velocity and acceleration of the base; they receive
/// the efforts. Returns the wrench that the base needs besides the external ones. All in kernel frames.
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[inline(always)]
pub fn inverse_dynamics<S: Scalar>(
    tree: &Tree,
    slots: &mut [Slot<S>],
    external: Option<&[Force<S>]>,
) -> Force<S> {
    let count = tree.bodies.len();
    let (slots, bodies) = (&mut slots[..count], &tree.bodies[..count]);
    slots[0].begin(&bodies[0], external.map(|e| &e[0]));
    slots[0].resist(&bodies[0]);
    for (j, hop) in tree.hops.iter().enumerate() {
        let (before, rest) = slots.split_at_mut(j + 1);
        let (parent, slot) = (&before[hop.parent], &mut rest[0]);
        slot.set_motion(hop, parent.w, parent.spin);
        slot.begin(&bodies[j + 1], external.map(|e| &e[j + 1]));
        slot.follow(hop, &parent.acceleration);
        slot.resist(&bodies[j + 1]);
    }
    for (j, hop) in tree.hops.iter().enumerate().rev() {
        let (before, rest) = slots.split_at_mut(j + 1);
        let (parent, slot) = (&mut before[hop.parent], &mut rest[0]);
        let force = slot.force;
        slot.effort = if hop.slides {
            force.force[2]
        } else {
            force.torque[2]
        };
        let passed = on_path!(hop, path => path.force_out(hop, &slot.turn, slot.q, force));
        parent.force = parent.force.plus(passed);
    }
    slots[0].force
}
