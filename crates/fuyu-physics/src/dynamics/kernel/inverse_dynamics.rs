//! Inverse dynamics by the recursive Newton-Euler algorithm, linear in the number of joints.

use super::joint_transform::{SpatialForce, SpatialMotion, with_shape};
use super::tree::{Body, JointTransform, Tree};
use super::{LinkScratch, Scalar, Sym3, Vec3};

impl Body {
    /// Force that the body's acceleration requires, without the velocity-product force.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn inertial_force<S: Scalar>(&self, m: &SpatialMotion<S>) -> SpatialForce<S> {
        let like = m.angular[0];
        let h = &self.inertia.first_moment;
        let h = Vec3::constant(like, &[h.x, h.y, h.z]);
        let rotational = Sym3::constant(like, &self.inertia.about_origin);
        SpatialForce {
            torque: rotational.times(m.angular) + h.cross(m.linear),
            force: m
                .linear
                .mul_add(like.constant(self.inertia.mass), m.angular.cross(h)),
        }
    }
}

impl<S: Scalar> LinkScratch<S> {
    /// Sets the body's acceleration from the parent's and the joint's.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn set_acceleration(&mut self, joint: &JointTransform, parent: &SpatialMotion<S>) {
        let m = with_shape!(joint, shape => shape.motion_to_child(joint, &self.rotation, self.q, *parent));
        self.acceleration = SpatialMotion {
            angular: m.angular + self.bias.angular,
            linear: m.linear + self.bias.linear,
        };
        let axis = if joint.is_prismatic {
            &mut self.acceleration.linear[2]
        } else {
            &mut self.acceleration.angular[2]
        };
        *axis = *axis + self.qdd;
    }

    /// Adds the body's inertial force to the force on its subtree.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn add_inertial_force(&mut self, body: &Body) {
        self.force = self.force.plus(body.inertial_force(&self.acceleration));
    }
}

/// Joint efforts for given accelerations. `links`, one per body, hold joint positions (with their rotations), rates and
/// accelerations, and angular velocity and acceleration of the base; they receive the total efforts. Returns the wrench
/// that the base needs in addition to the external ones. All quantities are in kernel frames.
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[cfg_attr(not(debug_assertions), inline(always))]
pub fn inverse_dynamics<S: Scalar>(
    tree: &Tree,
    links: &mut [LinkScratch<S>],
    external: Option<&[SpatialForce<S>]>,
) -> SpatialForce<S> {
    let count = tree.bodies.len();
    let (links, bodies) = (&mut links[..count], &tree.bodies[..count]);
    links[0].start_force(&bodies[0], external.map(|e| &e[0]));
    links[0].add_inertial_force(&bodies[0]);
    for (j, joint) in tree.joints.iter().enumerate() {
        let (inward, rest) = links.split_at_mut(j + 1);
        let (parent, link) = (&inward[joint.parent], &mut rest[0]);
        link.set_velocity(joint, parent.w, parent.centripetal);
        link.start_force(&bodies[j + 1], external.map(|e| &e[j + 1]));
        link.set_acceleration(joint, &parent.acceleration);
        link.add_inertial_force(&bodies[j + 1]);
    }
    for (j, joint) in tree.joints.iter().enumerate().rev() {
        let (inward, rest) = links.split_at_mut(j + 1);
        let (parent, link) = (&mut inward[joint.parent], &mut rest[0]);
        let force = link.force;
        link.effort = if joint.is_prismatic {
            force.force[2]
        } else {
            force.torque[2]
        };
        let transmitted = with_shape!(joint, shape => shape.force_to_parent(joint, &link.rotation, link.q, force));
        parent.force = parent.force.plus(transmitted);
    }
    links[0].force
}
