//! Poses, composite inertias, momentum map and generalized Jacobian, linear in the number of joints.
//!
//! Masutani 1995 eqs. (4.9)-(4.26), (4.36), (4.37), which App. G computes with matrices. Composite inertias are summed
//! in link frames, where the momentum of a joint's subtree is a row of the composite inertia and costs no arithmetic;
//! only these rows are rotated to base axes.

use super::composite_inertia::CompositeInertia;
use super::joint_transform::{TransformShape, with_shape};
use super::momentum_columns::{JointMotion, JointSubtree, MomentumColumn};
use super::tree::{ALPHA_RIGHT_ANGLE, ALPHA_ZERO, JointTransform, Tree};
use super::vector::other_axes;
use super::{PlanarRotation, Scalar, Sym3, Vec3};

/// Placement of a link (a body and the joint that moves it) in the base frame B, and the inertia of its subtree.
/// Scratch of [`momentum_map`], one element per body.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct LinkPlacement<S> {
    /// Joint position \[rad or m\]: an input.
    pub q: S,
    /// Rotation of the joint transform by `theta` ([`Tree::joint_rotation`]): an input.
    pub rotation: PlanarRotation<S>,
    /// Axes of the body's kernel frame, base axes.
    pub axes: [Vec3<S>; 3],
    /// Origin of the kernel frame from the base's \[m\].
    pub p_BK: Vec3<S>,
    /// First moment of the subtree, its x and y components in the kernel frame.
    first_moment_xy: [S; 2],
    /// Row z (the joint's axis) of the subtree's moment of inertia, kernel frame.
    inertia_z: Vec3<S>,
    /// Partial sum of the subtree's inertia at branches.
    subtree: CompositeInertia<S>,
}

/// Storage of the placements of all links: an array of structures, or groups of eight joints.
pub(super) trait LinkPlacements<S> {
    /// Position of the joint that moves a body.
    fn q(&self, body: usize) -> S;
    /// Rotation of that joint by `theta`.
    fn rotation(&self, body: usize) -> PlanarRotation<S>;
    /// Pose of a body's kernel frame.
    fn pose(&self, body: usize) -> KernelPose<S>;
    /// Sets the pose of a body's kernel frame.
    fn set_pose(&mut self, body: usize, pose: KernelPose<S>);
    /// Sets the entries of a subtree's inertia that determine the joint's columns.
    fn set_joint_terms(&mut self, body: usize, first_moment_xy: [S; 2], inertia_z: Vec3<S>);
    /// Partial sum of a subtree's inertia.
    fn subtree(&self, body: usize) -> CompositeInertia<S>;
    /// Sets the partial sum of a subtree's inertia.
    fn set_subtree(&mut self, body: usize, subtree: CompositeInertia<S>);
}

/// Centre of mass and inertia of the whole tree, base axes.
#[derive(Debug, Clone, Copy)]
pub struct SystemInertia<S> {
    /// Centre of mass from the base frame's origin.
    pub p_BC: Vec3<S>,
    /// Inertia about the centre of mass, `H_B` of eq. (4.25).
    pub H_B: Sym3<S>,
    /// `H_B⁻¹`.
    pub H_B_inverse: Sym3<S>,
}

/// Axes and origin of a kernel frame, base axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct KernelPose<S> {
    pub axes: [Vec3<S>; 3],
    pub p_BK: Vec3<S>,
}

impl<S: Scalar> KernelPose<S> {
    /// Pose of the base's kernel frame.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn base_motion(tree: &Tree, like: S) -> Self {
        let R_BK = tree.base_axes().matrix();
        let axis = |i| [R_BK[(0, i)], R_BK[(1, i)], R_BK[(2, i)]];
        Self {
            axes: [
                Vec3::constant(like, &axis(0)),
                Vec3::constant(like, &axis(1)),
                Vec3::constant(like, &axis(2)),
            ],
            p_BK: Vec3::zero(like),
        }
    }

    /// Rotates a vector from the kernel frame's axes to base axes.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn rotate(&self, v: Vec3<S>) -> Vec3<S> {
        let [x, y, z] = self.axes;
        x.mul_add(v[0], y.mul_add(v[1], z.scaled(v[2])))
    }
}

impl<S: Scalar> LinkPlacement<S> {
    /// All zero, with numbers of the kind of `like`.
    pub fn new(like: S) -> Self {
        let (zero, zeros) = (like.constant(0.0), Vec3::zero(like));
        Self {
            q: zero,
            rotation: PlanarRotation::new(like.constant(1.0), zero),
            axes: [zeros; 3],
            p_BK: zeros,
            first_moment_xy: [zero; 2],
            inertia_z: zeros,
            subtree: CompositeInertia {
                first_moment: zeros,
                inertia: Sym3 {
                    diagonal: [zero; 3],
                    off: [zero; 3],
                },
            },
        }
    }

    /// The joint and its subtree.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn joint_subtree(&self) -> JointSubtree<S> {
        JointSubtree {
            axes: self.axes,
            p_BK: self.p_BK,
            first_moment_xy: self.first_moment_xy,
            inertia_z: self.inertia_z,
        }
    }
}

impl<S: Scalar> LinkPlacements<S> for [LinkPlacement<S>] {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn q(&self, body: usize) -> S {
        self[body].q
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn rotation(&self, body: usize) -> PlanarRotation<S> {
        self[body].rotation
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn pose(&self, body: usize) -> KernelPose<S> {
        let LinkPlacement { axes, p_BK, .. } = self[body];
        KernelPose { axes, p_BK }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn set_pose(&mut self, body: usize, pose: KernelPose<S>) {
        (self[body].axes, self[body].p_BK) = (pose.axes, pose.p_BK);
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn set_joint_terms(&mut self, body: usize, first_moment_xy: [S; 2], inertia_z: Vec3<S>) {
        (self[body].first_moment_xy, self[body].inertia_z) = (first_moment_xy, inertia_z);
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn subtree(&self, body: usize) -> CompositeInertia<S> {
        self[body].subtree
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn set_subtree(&mut self, body: usize, subtree: CompositeInertia<S>) {
        self[body].subtree = subtree;
    }
}

impl<const GENERAL: bool, const ALPHA: u8, const D: bool, const A: bool>
    TransformShape<GENERAL, ALPHA, D, A>
{
    /// Pose of a body from its parent's.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn child_pose<S: Scalar>(
        self,
        joint: &JointTransform,
        rotation: &PlanarRotation<S>,
        q: S,
        parent: KernelPose<S>,
    ) -> KernelPose<S> {
        let ([mut x, mut y, mut z], mut origin) = (parent.axes, parent.p_BK);
        let Vec3([p0, p1, p2]) = Vec3::constant(q, &joint.p);
        if GENERAL {
            (x, y) = rotate_axes(&PlanarRotation::constant(q, &joint.gamma), x, y);
            origin = y.mul_add(p1, z.mul_add(p2, origin));
        }
        if A || GENERAL {
            origin = x.mul_add(p0, origin);
        }
        match ALPHA {
            ALPHA_ZERO => {}
            ALPHA_RIGHT_ANGLE => (y, z) = (z, -y),
            _ => (y, z) = rotate_axes(&PlanarRotation::constant(q, &joint.alpha), y, z),
        }
        (x, y) = rotate_axes(rotation, x, y);
        if D || GENERAL {
            origin = z.mul_add(joint.d_at(q), origin);
        }
        KernelPose {
            axes: [x, y, z],
            p_BK: origin,
        }
    }
}

/// Two axes after a rotation in their plane.
#[cfg_attr(not(debug_assertions), inline(always))]
fn rotate_axes<S: Scalar>(
    rotation: &PlanarRotation<S>,
    x: Vec3<S>,
    y: Vec3<S>,
) -> (Vec3<S>, Vec3<S>) {
    (
        x.mul_add(rotation.cos, y.scaled(rotation.sin)),
        y.mul_add(rotation.cos, x.scaled(-rotation.sin)),
    )
}

/// Computes poses and composite inertias. `placements` hold joint positions and rotations. Returns the inertia of the
/// whole tree about the base's origin, in the axes of the base's kernel frame.
#[cfg_attr(not(debug_assertions), inline(always))]
pub(super) fn set_placements<S: Scalar>(
    tree: &Tree,
    like: S,
    placements: &mut (impl LinkPlacements<S> + ?Sized),
) -> CompositeInertia<S> {
    let bodies = &tree.bodies[..];
    for &leaf in &tree.leaves {
        placements.set_subtree(
            leaf,
            CompositeInertia::constant(like, &bodies[leaf].about_reference),
        );
    }
    // One loop for the outward sweep of poses and the inward sweep of inertias: they do not depend on each other, so that
    // the processor runs them in parallel.
    let mut pose = KernelPose::base_motion(tree, like);
    placements.set_pose(0, pose);
    let joints = tree.dof();
    let mut subtree = placements.subtree(joints);
    for outward in 0..joints {
        let (joint, body) = (&tree.joints[outward], outward + 1);
        if joint.parent != outward {
            pose = placements.pose(joint.parent);
        }
        let (rotation, q) = (placements.rotation(body), placements.q(body));
        pose = with_shape!(joint, shape => shape.child_pose(joint, &rotation, q, pose));
        placements.set_pose(body, pose);

        // The inward sweep visits bodies in descending order. If the next one is not the parent, it is the tip of another
        // branch.
        let inward = joints - 1 - outward;
        let (joint, body) = (&tree.joints[inward], inward + 1);
        let first_moment_xy = [subtree.first_moment[0], subtree.first_moment[1]];
        placements.set_joint_terms(
            body,
            first_moment_xy,
            subtree.axis_row(bodies[body].d_from_reference),
        );
        let (rotation, q) = (placements.rotation(body), placements.q(body));
        subtree = subtree.to_parent(joint, &rotation, q, bodies[body].subtree_mass);
        if !joint.adds_parent_inertia {
            subtree = subtree.plus(placements.subtree(joint.parent));
        }
        if joint.parent != inward {
            placements.set_subtree(joint.parent, subtree);
            subtree = placements.subtree(inward);
        }
    }
    subtree
}

/// Computes poses, composite inertias and momentum map. `placements`, one per body, hold joint positions and rotations;
/// `columns`, one per joint, receive the map.
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[cfg_attr(not(debug_assertions), inline(always))]
pub fn momentum_map<S: Scalar>(
    tree: &Tree,
    placements: &mut [LinkPlacement<S>],
    columns: &mut [MomentumColumn<S>],
) -> SystemInertia<S> {
    let (count, like) = (tree.dof(), placements[0].q);
    let tree_inertia = set_placements(tree, like, placements);
    let (moved, columns) = (&placements[1..=count], &mut columns[..count]);
    let system = SystemInertia::new(
        tree_inertia,
        &placements.pose(0),
        tree.bodies[0].subtree_mass,
    );
    let inverse_mass = like.constant(1.0 / tree.bodies[0].subtree_mass);
    let minus_H_B_inverse = -system.H_B_inverse;
    for (j, (placement, column)) in moved.iter().zip(columns).enumerate() {
        let motion = if tree.joints[j].is_prismatic {
            JointMotion::Prismatic(like.constant(tree.bodies[j + 1].subtree_mass))
        } else {
            JointMotion::Revolute
        };
        *column = MomentumColumn::new(
            &placement.joint_subtree(),
            motion,
            system.p_BC,
            &minus_H_B_inverse,
            inverse_mass,
        );
    }
    system
}

impl<S: Scalar> SystemInertia<S> {
    /// System inertia from the tree's inertia about the base's origin, and the total mass.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn new(tree_inertia: CompositeInertia<S>, base: &KernelPose<S>, mass: f64) -> Self {
        let (p, J) = about_com(tree_inertia, mass);
        let H_B = rotated(J, &base.axes);
        Self {
            p_BC: base.rotate(p),
            H_B,
            H_B_inverse: H_B.inverse(),
        }
    }
}

/// Centre of mass, and the moment of inertia about it.
#[cfg_attr(not(debug_assertions), inline(always))]
pub(super) fn about_com<S: Scalar>(
    tree_inertia: CompositeInertia<S>,
    mass: f64,
) -> (Vec3<S>, Sym3<S>) {
    let (h, mut J) = (tree_inertia.first_moment, tree_inertia.inertia);
    let p = h.scaled(h[0].constant(1.0 / mass));
    let squares = [p[0] * h[0], p[1] * h[1], p[2] * h[2]];
    for i in 0..3 {
        let (j, k) = other_axes(i);
        J.diagonal[i] = J.diagonal[i] - (squares[j] + squares[k]);
        J.off[i] = p[j].mul_add(h[k], J.off[i]);
    }
    (p, J)
}

/// Rotates a tensor from a frame with the given axes to the axes in which these are expressed.
#[cfg_attr(not(debug_assertions), inline(always))]
fn rotated<S: Scalar>(m: Sym3<S>, axes: &[Vec3<S>; 3]) -> Sym3<S> {
    let [x, y, z] = *axes;
    let rows = [
        Vec3([x[0], y[0], z[0]]),
        Vec3([x[1], y[1], z[1]]),
        Vec3([x[2], y[2], z[2]]),
    ];
    let images = [m.times(rows[0]), m.times(rows[1]), m.times(rows[2])];
    let mut result = m;
    for i in 0..3 {
        let (j, k) = other_axes(i);
        result.diagonal[i] = rows[i].dot(images[i]);
        result.off[i] = rows[j].dot(images[k]);
    }
    result
}

/// Generalized Jacobian of a point fixed to `body` at `p_KE` in its kernel frame, one column per joint with the linear
/// rows first, from the results of [`momentum_map`]. Masutani 1995 eqs. (4.36), (4.37).
///
/// # Panics
/// If a slice is shorter than the tree needs.
#[cfg_attr(not(debug_assertions), inline(always))]
pub fn generalized_jacobian<S: Scalar>(
    tree: &Tree,
    placements: &[LinkPlacement<S>],
    columns: &[MomentumColumn<S>],
    system: &SystemInertia<S>,
    body: usize,
    p_KE: &[f64; 3],
    out: &mut [[S; 6]],
) {
    let end = placements.pose(body);
    let p_BE = end.rotate(Vec3::constant(placements[body].q, p_KE)) + end.p_BK;
    let r_CE = p_BE - system.p_BC;
    for (column, out) in columns.iter().zip(out.iter_mut()) {
        let [Vec3([x, y, z]), Vec3([a, b, c])] = column.base_motion(r_CE);
        *out = [x, y, z, a, b, c];
    }
    let mut body = body;
    while body > 0 {
        let (placement, out) = (&placements[body], &mut out[body - 1]);
        let joint = &tree.joints[body - 1];
        let axis = placement.axes[2];
        let linear = if joint.is_prismatic {
            axis
        } else {
            for (entry, axis) in out[3..].iter_mut().zip(axis.0) {
                *entry = *entry + axis;
            }
            axis.cross(p_BE - placement.p_BK)
        };
        for (entry, linear) in out[..3].iter_mut().zip(linear.0) {
            *entry = *entry + linear;
        }
        body = joint.parent;
    }
}
