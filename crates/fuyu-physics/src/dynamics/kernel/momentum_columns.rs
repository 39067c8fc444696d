//! Columns of the momentum map: the momentum of each joint's subtree at unit joint rate.

use super::{Scalar, Sym3, Vec3};

/// A joint and the inertia of its subtree, which determine its columns. Base axes unless stated otherwise.
#[derive(Debug, Clone, Copy)]
pub(super) struct JointSubtree<S> {
    /// Axes of the kernel frame of the body that the joint moves.
    pub axes: [Vec3<S>; 3],
    /// Origin of that frame from the base's.
    pub p_BK: Vec3<S>,
    /// First moment of the subtree, its x and y components in the kernel frame.
    pub first_moment_xy: [S; 2],
    /// Row z (the joint's axis) of the subtree's moment of inertia, kernel frame.
    pub inertia_z: Vec3<S>,
}

/// Type of a joint, or of a group of joints.
#[derive(Debug, Clone, Copy)]
pub(super) enum JointMotion<S> {
    /// Revolute.
    Revolute,
    /// Prismatic, with the mass of the subtree.
    Prismatic(S),
    /// A group with joints of both types.
    Mixed {
        /// 1 for revolute joints, 0 for prismatic ones.
        is_revolute: S,
        /// Mass of the subtree for prismatic joints, 0 for revolute ones.
        prismatic_mass: S,
    },
}

/// One joint's columns of the momentum map and of the matrices that follow from it, base axes.
#[derive(Debug, Clone, Copy)]
pub struct MomentumColumn<S> {
    /// Angular momentum of the subtree about the kernel frame's origin, at unit joint rate with the base at rest.
    pub angular_momentum: Vec3<S>,
    /// Linear momentum of the subtree, at unit joint rate with the base at rest.
    pub linear_momentum: Vec3<S>,
    /// Column of `J_C`, eq. (4.12).
    pub J_C: Vec3<S>,
    /// Column of `H_M`, eq. (4.26).
    pub H_M: Vec3<S>,
    /// Column of `H_A = -H_B⁻¹ H_M`, eq. (4.24).
    pub H_A: Vec3<S>,
}

impl<S: Scalar> MomentumColumn<S> {
    /// All zero, with numbers of the kind of `like`.
    pub fn zero(like: S) -> Self {
        let zeros = Vec3::zero(like);
        Self {
            angular_momentum: zeros,
            linear_momentum: zeros,
            J_C: zeros,
            H_M: zeros,
            H_A: zeros,
        }
    }

    /// Adds `ratio` times the columns of another joint. In the sum, `angular_momentum` has no meaning: each joint's is
    /// about another point.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn add_scaled(&mut self, joint: &Self, ratio: S) {
        self.angular_momentum = joint.angular_momentum.mul_add(ratio, self.angular_momentum);
        self.linear_momentum = joint.linear_momentum.mul_add(ratio, self.linear_momentum);
        self.J_C = joint.J_C.mul_add(ratio, self.J_C);
        self.H_M = joint.H_M.mul_add(ratio, self.H_M);
        self.H_A = joint.H_A.mul_add(ratio, self.H_A);
    }

    /// The columns of a joint, from its subtree; `inverse_mass` is the inverse mass of the whole tree.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn new(
        subtree: &JointSubtree<S>,
        motion: JointMotion<S>,
        p_BC: Vec3<S>,
        minus_H_B_inverse: &Sym3<S>,
        inverse_mass: S,
    ) -> Self {
        let ([x, y, z], [hx, hy], I) = (subtree.axes, subtree.first_moment_xy, subtree.inertia_z);
        // I z and z × h in base axes.
        let I_z = || x.mul_add(I[0], y.mul_add(I[1], z.scaled(I[2])));
        let z_h = || y.mul_add(hx, x.scaled(-hy));
        let (angular_momentum, linear_momentum) = match motion {
            JointMotion::Revolute => (I_z(), z_h()),
            JointMotion::Prismatic(mass) => (-z_h(), z.scaled(mass)),
            JointMotion::Mixed {
                is_revolute,
                prismatic_mass,
            } => {
                let z_h = z_h();
                let is_prismatic = is_revolute.mul_sub_from(is_revolute, is_revolute.constant(1.0));
                (
                    I_z().mul_add(is_revolute, -z_h.scaled(is_prismatic)),
                    z_h.mul_add(is_revolute, z.scaled(prismatic_mass)),
                )
            }
        };
        let H_M = angular_momentum + (subtree.p_BK - p_BC).cross(linear_momentum);
        Self {
            angular_momentum,
            linear_momentum,
            J_C: linear_momentum.scaled(inverse_mass),
            H_M,
            H_A: minus_H_B_inverse.times(H_M),
        }
    }

    /// Linear and angular velocity, at unit joint rate and zero momentum, of a point fixed to the base at `r_CE` from the
    /// centre of mass.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn base_motion(&self, r_CE: Vec3<S>) -> [Vec3<S>; 2] {
        [self.H_A.cross(r_CE) - self.J_C, self.H_A]
    }
}
