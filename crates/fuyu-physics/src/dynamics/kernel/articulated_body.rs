//! Forward dynamics by the articulated-body algorithm, linear in the number of joints.
//!
//! Featherstone's algorithm in link frames, with three differences from the textbook. Accelerations are those of the
//! frames' origins as points, so that linear velocities are not needed. Inertias are kept in three 3 × 3 blocks, and
//! entries that a joint makes zero are not computed. Since every joint axis is the z axis, a joint's motion subspace
//! selects one row.

use super::articulated_inertia::ArticulatedInertia;
use super::joint_transform::{SpatialForce, SpatialMotion, TransformShape, with_shape};
use super::link_scratch::centripetal_tensor;
use super::tree::{ALPHA_GENERAL, Body, JointTransform, Tree};
use super::vector::other_axes;
use super::{LinkScratch, Mat3, Scalar, Sym3, Vec3};

impl Body {
    /// Velocity-product force: the force that the body's rotation requires while its origin does not accelerate.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn centrifugal_force<S: Scalar>(&self, centripetal: Sym3<S>) -> SpatialForce<S> {
        let like = centripetal.off[0];
        let m = &self.inertia.about_origin;
        let mut torque = Vec3([like; 3]);
        for i in 0..3 {
            let (j, k) = other_axes(i);
            // w × I w, from the products of w in the centripetal tensor.
            torque[i] = centripetal.off[i].times(m.diagonal[k] - m.diagonal[j]);
        }
        if self.inertia_is_non_diagonal {
            let Vec3(off) = Vec3::constant(like, &m.off_diagonal.into());
            for i in 0..3 {
                let (j, k) = other_axes(i);
                let squares = centripetal.diagonal[j] - centripetal.diagonal[k];
                let sum = squares.mul_add(off[i], centripetal.off[k].mul_add(off[j], torque[i]));
                torque[i] = centripetal.off[j].mul_sub_from(off[k], sum);
            }
        }
        let h = &self.inertia.first_moment;
        SpatialForce {
            torque,
            force: if self.com_is_off_origin {
                centripetal.times(Vec3::constant(like, &[h.x, h.y, h.z]))
            } else {
                Vec3::zero(like)
            },
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn rigid_inertia<S: Scalar>(&self, like: S) -> ArticulatedInertia<S> {
        let h = &self.inertia.first_moment;
        ArticulatedInertia::rigid(
            like.constant(self.inertia.mass),
            Vec3::constant(like, &[h.x, h.y, h.z]),
            Sym3::constant(like, &self.inertia.about_origin),
        )
    }

    /// Sum of `subtree`, about this body's origin, and this body's inertia.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn plus<S: Scalar>(&self, subtree: ArticulatedInertia<S>) -> ArticulatedInertia<S> {
        let (like, h) = (subtree.mass.off[0], &self.inertia.first_moment);
        subtree.plus_rigid(
            like.constant(self.inertia.mass),
            Vec3::constant(like, &[h.x, h.y, h.z]),
            Sym3::constant(like, &self.inertia.about_origin),
        )
    }
}

/// Articulated inertia and bias force of a subtree.
pub(crate) type ArticulatedSubtree<S> = (ArticulatedInertia<S>, SpatialForce<S>);

impl<S: Scalar> LinkScratch<S> {
    /// Sets angular velocity and bias acceleration from the parent's angular velocity `w` and its centripetal tensor.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn set_velocity(
        &mut self,
        joint: &JointTransform,
        w: Vec3<S>,
        centripetal: Sym3<S>,
    ) {
        let mut w = with_shape!(joint, shape => {
            if shape.has_translation() || joint.is_prismatic {
                let acceleration = shape.times_child_origin(joint, self.q, centripetal);
                self.bias.linear = shape.to_child(joint, &self.rotation, acceleration);
            }
            shape.to_child(joint, &self.rotation, w)
        });
        let coriolis = [w[1] * self.qd, -(w[0] * self.qd)];
        if joint.is_prismatic {
            for (bias, coriolis) in self.bias.linear.0.iter_mut().zip(coriolis) {
                *bias = coriolis.times(2.0) + *bias;
            }
        } else {
            (self.bias.angular[0], self.bias.angular[1]) = (coriolis[0], coriolis[1]);
            w[2] = w[2] + self.qd;
        }
        self.w = w;
    }

    /// Initializes the force on the subtree with that on its first body alone.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn start_force(&mut self, body: &Body, external: Option<&SpatialForce<S>>) {
        self.centripetal = centripetal_tensor(self.w);
        self.force = body.centrifugal_force(self.centripetal);
        if let Some(external) = external {
            self.force = SpatialForce {
                torque: self.force.torque - external.torque,
                force: self.force.force - external.force,
            };
        }
    }

    /// Projects inertia and force of the subtree onto the directions that the joint transmits, and transforms them to the
    /// parent's frame.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn project(
        &mut self,
        joint: &JointTransform,
        subtree: ArticulatedSubtree<S>,
    ) -> ArticulatedSubtree<S> {
        if joint.is_prismatic {
            let (inertia, force) = self.project_prismatic(subtree);
            let shape = TransformShape::<true, ALPHA_GENERAL, true, true>;
            let inertia =
                shape.inertia_to_parent::<S, true>(joint, &self.rotation, self.q, inertia);
            (
                inertia,
                shape.force_to_parent(joint, &self.rotation, self.q, force),
            )
        } else {
            with_shape!(joint, shape => {
                let (inertia, force) = self.project_revolute(shape.has_translation(), subtree);
                let inertia = shape.inertia_to_parent::<S, false>(joint, &self.rotation, self.q, inertia);
                (inertia, shape.force_to_parent(joint, &self.rotation, self.q, force))
            })
        }
    }

    /// [`Self::project`] in the body's frame, for a revolute joint.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn project_revolute(
        &mut self,
        has_translation: bool,
        (inertia, force): ArticulatedSubtree<S>,
    ) -> ArticulatedSubtree<S> {
        let ArticulatedInertia {
            rotational: mut J,
            coupling: Mat3([mut hx, mut hy, u]),
            mass: mut M,
        } = inertia;
        let (ux, uy) = (J.off[1], J.off[0]);
        let inverse = J.diagonal[2].recip();
        let (kx, ky, k) = (ux * inverse, uy * inverse, u.scaled(inverse));
        J.diagonal[0] = ux.mul_sub_from(kx, J.diagonal[0]);
        J.diagonal[1] = uy.mul_sub_from(ky, J.diagonal[1]);
        J.off[2] = ux.mul_sub_from(ky, J.off[2]);
        for c in 0..3 {
            hx[c] = kx.mul_sub_from(u[c], hx[c]);
            hy[c] = ky.mul_sub_from(u[c], hy[c]);
        }
        subtract_outer_product(&mut M, u, k);
        let zero = inverse.constant(0.0);
        (J.off[0], J.off[1], J.diagonal[2]) = (zero, zero, zero);

        let effort = self.effort - force.torque[2];
        self.free_qdd = effort * inverse;
        self.gain = SpatialForce {
            torque: Vec3([kx, ky, zero]),
            force: k,
        };
        let ([ax, ay, _], a) = (self.bias.angular.0, self.bias.linear);
        let mut transmitted = SpatialForce {
            torque: Vec3([
                J.diagonal[0].mul_add(ax, J.off[2].mul_add(ay, force.torque[0])),
                J.off[2].mul_add(ax, J.diagonal[1].mul_add(ay, force.torque[1])),
                self.effort,
            ]),
            force: hx.mul_add(ax, hy.mul_add(ay, force.force)),
        };
        transmitted.torque[0] = kx.mul_add(effort, transmitted.torque[0]);
        transmitted.torque[1] = ky.mul_add(effort, transmitted.torque[1]);
        transmitted.force = k.mul_add(effort, transmitted.force);
        if has_translation {
            transmitted.torque[0] = transmitted.torque[0] + hx.dot(a);
            transmitted.torque[1] = transmitted.torque[1] + hy.dot(a);
            transmitted.force = transmitted.force + M.times(a);
        }
        let projected = ArticulatedInertia {
            rotational: J,
            coupling: Mat3([hx, hy, Vec3([zero; 3])]),
            mass: M,
        };
        (projected, transmitted)
    }

    /// [`Self::project`] in the body's frame, for a prismatic joint.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn project_prismatic(
        &mut self,
        (inertia, force): ArticulatedSubtree<S>,
    ) -> ArticulatedSubtree<S> {
        let ArticulatedInertia {
            rotational: mut J,
            coupling: mut H,
            mass: mut M,
        } = inertia;
        let u = H.column(2);
        let (ux, uy) = (M.off[1], M.off[0]);
        let inverse = M.diagonal[2].recip();
        let (kx, ky, k) = (ux * inverse, uy * inverse, u.scaled(inverse));
        M.diagonal[0] = ux.mul_sub_from(kx, M.diagonal[0]);
        M.diagonal[1] = uy.mul_sub_from(ky, M.diagonal[1]);
        M.off[2] = ux.mul_sub_from(ky, M.off[2]);
        let zero = inverse.constant(0.0);
        for r in 0..3 {
            H.0[r][0] = u[r].mul_sub_from(kx, H.0[r][0]);
            H.0[r][1] = u[r].mul_sub_from(ky, H.0[r][1]);
            H.0[r][2] = zero;
        }
        subtract_outer_product(&mut J, u, k);
        (M.off[0], M.off[1], M.diagonal[2]) = (zero, zero, zero);

        let effort = self.effort - force.force[2];
        self.free_qdd = effort * inverse;
        self.gain = SpatialForce {
            torque: k,
            force: Vec3([kx, ky, zero]),
        };
        let [ax, ay, _] = self.bias.linear.0;
        let mut transmitted = SpatialForce {
            torque: H
                .column(0)
                .mul_add(ax, H.column(1).mul_add(ay, force.torque)),
            force: Vec3([
                M.diagonal[0].mul_add(ax, M.off[2].mul_add(ay, force.force[0])),
                M.off[2].mul_add(ax, M.diagonal[1].mul_add(ay, force.force[1])),
                self.effort,
            ]),
        };
        transmitted.torque = k.mul_add(effort, transmitted.torque);
        transmitted.force[0] = kx.mul_add(effort, transmitted.force[0]);
        transmitted.force[1] = ky.mul_add(effort, transmitted.force[1]);
        let projected = ArticulatedInertia {
            rotational: J,
            coupling: H,
            mass: M,
        };
        (projected, transmitted)
    }

    /// Sets the accelerations of joint and body from the parent's acceleration; returns the body's.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn solve_acceleration(
        &mut self,
        joint: &JointTransform,
        parent: &SpatialMotion<S>,
    ) -> SpatialMotion<S> {
        if joint.is_prismatic {
            let shape = TransformShape::<true, ALPHA_GENERAL, true, true>;
            let mut m = shape.motion_to_child(joint, &self.rotation, self.q, *parent);
            m.linear = m.linear + self.bias.linear;
            let g = &self.gain;
            let in_plane = g.force[0].mul_add(m.linear[0], g.force[1] * m.linear[1]);
            self.qdd = (self.free_qdd - m.linear[2]) - (in_plane + g.torque.dot(m.angular));
            m.linear[2] = m.linear[2] + self.qdd;
            self.acceleration = m;
            m
        } else {
            with_shape!(joint, shape => {
                let m = shape.motion_to_child(joint, &self.rotation, self.q, *parent);
                self.solve_revolute_acceleration(shape.has_translation(), m)
            })
        }
    }

    /// [`Self::solve_acceleration`] for a revolute joint, from the parent's motion in the body's frame.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn solve_revolute_acceleration(
        &mut self,
        has_translation: bool,
        mut m: SpatialMotion<S>,
    ) -> SpatialMotion<S> {
        let (g, bias) = (&self.gain, &self.bias);
        m.angular[0] = m.angular[0] + bias.angular[0];
        m.angular[1] = m.angular[1] + bias.angular[1];
        if has_translation {
            m.linear = m.linear + bias.linear;
        }
        let in_plane = g.torque[0].mul_add(m.angular[0], g.torque[1] * m.angular[1]);
        self.qdd = (self.free_qdd - m.angular[2]) - (in_plane + g.force.dot(m.linear));
        m.angular[2] = m.angular[2] + self.qdd;
        self.acceleration = m;
        m
    }
}

/// `m -= u kᵀ` for a symmetric `u kᵀ`.
#[cfg_attr(not(debug_assertions), inline(always))]
fn subtract_outer_product<S: Scalar>(m: &mut Sym3<S>, u: Vec3<S>, k: Vec3<S>) {
    for i in 0..3 {
        let (a, b) = other_axes(i);
        m.diagonal[i] = u[i].mul_sub_from(k[i], m.diagonal[i]);
        m.off[i] = u[a].mul_sub_from(k[b], m.off[i]);
    }
}

/// Accelerations of a free-floating tree. `links`, one per body, hold joint positions (with their rotations), rates and
/// efforts and the base's angular velocity, and receive the accelerations. `external` are wrenches on the bodies. All
/// quantities are in kernel frames.
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[cfg_attr(not(debug_assertions), inline(always))]
pub fn forward_dynamics<S: Scalar>(
    tree: &Tree,
    links: &mut [LinkScratch<S>],
    external: Option<&[SpatialForce<S>]>,
) {
    let (inertia, force) = articulated_tree(tree, links, external);
    propagate_acceleration(tree, links, inertia.free_acceleration(force));
}

/// First part of [`forward_dynamics`]: articulated inertia and bias force of the whole tree, at the base.
#[cfg_attr(not(debug_assertions), inline(always))]
pub(crate) fn articulated_tree<S: Scalar>(
    tree: &Tree,
    links: &mut [LinkScratch<S>],
    external: Option<&[SpatialForce<S>]>,
) -> ArticulatedSubtree<S> {
    let count = tree.bodies.len();
    let (links, bodies) = (&mut links[..count], &tree.bodies[..count]);
    let external = external.map(|e| &e[..count]);
    links[0].start_force(&bodies[0], external.map(|e| &e[0]));
    let mut previous = (links[0].w, links[0].centripetal);
    for &j in &tree.outward {
        let joint = &tree.joints[j];
        if !joint.parent_is_previous {
            previous = (links[joint.parent].w, links[joint.parent].centripetal);
        }
        let link = &mut links[j + 1];
        link.set_velocity(joint, previous.0, previous.1);
        link.start_force(&bodies[j + 1], external.map(|e| &e[j + 1]));
        previous = (link.w, link.centripetal);
    }
    let like = links[0].q;
    for &leaf in &tree.leaves {
        links[leaf].inertia = bodies[leaf].rigid_inertia(like);
    }
    let last = &links[tree.outward.last().map_or(0, |j| j + 1)];
    let mut subtree = (last.inertia, last.force);
    for &j in tree.outward.iter().rev() {
        let joint = &tree.joints[j];
        let (inertia, force) = links[j + 1].project(joint, subtree);
        let parent = &mut links[joint.parent];
        let force = parent.force.plus(force);
        // The inertia of a body with one child is not stored: what is read back soon after is slow to read.
        if joint.adds_parent_inertia && joint.parent_is_previous {
            subtree = (bodies[joint.parent].plus(inertia), force);
            continue;
        }
        parent.force = force;
        parent.inertia = if joint.adds_parent_inertia {
            bodies[joint.parent].plus(inertia)
        } else {
            parent.inertia.plus(inertia)
        };
        let next = &links[joint.previous];
        subtree = (next.inertia, next.force);
    }
    subtree
}

/// Second part of [`forward_dynamics`]: accelerations of joints and bodies from the base's acceleration.
#[cfg_attr(not(debug_assertions), inline(always))]
pub(crate) fn propagate_acceleration<S: Scalar>(
    tree: &Tree,
    links: &mut [LinkScratch<S>],
    mut acceleration: SpatialMotion<S>,
) {
    let links = &mut links[..tree.bodies.len()];
    links[0].acceleration = acceleration;
    for &j in &tree.outward {
        let joint = &tree.joints[j];
        if !joint.parent_is_previous {
            acceleration = links[joint.parent].acceleration;
        }
        acceleration = links[j + 1].solve_acceleration(joint, &acceleration);
    }
}
