//! Scratch memory of forward and inverse dynamics, one element per link.

use super::articulated_inertia::ArticulatedInertia;
use super::{Mat3, PlanarRotation, Scalar, SpatialForce, SpatialMotion, Sym3, Vec3};

/// Scratch of one link (a body and the joint that moves it), in the body's kernel frame. Element 0 is the base, which
/// no joint moves. Aligned so that no wide number crosses a cache line.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct LinkScratch<S> {
    /// Joint position \[rad or m\].
    pub q: S,
    /// Joint rate \[rad/s or m/s\].
    pub qd: S,
    /// Total joint effort, with spring and damper \[N m or N\].
    pub effort: S,
    /// Rotation of the joint transform by `theta` ([`Tree::joint_rotation`](super::Tree::joint_rotation)).
    pub rotation: PlanarRotation<S>,
    /// Joint acceleration \[rad/s² or m/s²\]: output of forward dynamics, input of inverse dynamics.
    pub qdd: S,
    /// Acceleration of the body; the linear part is that of the frame's origin as a point. An output, except that
    /// inverse dynamics takes the base's as input.
    pub acceleration: SpatialMotion<S>,
    /// Angular velocity \[rad/s\]; the base's is an input.
    pub w: Vec3<S>,
    /// `[w×]²` ([`centripetal_tensor`]).
    pub(super) centripetal: Sym3<S>,
    /// Bias acceleration of the joint: the body's acceleration relative to the parent's at zero joint acceleration.
    pub(super) bias: SpatialMotion<S>,
    /// Bias force of the articulated body (forward dynamics), or force on the subtree (inverse dynamics).
    pub(super) force: SpatialForce<S>,
    /// Articulated inertia of the subtree.
    pub(super) inertia: ArticulatedInertia<S>,
    /// Decrease of the joint acceleration per unit of the frame's acceleration: `U / D` in Featherstone's notation.
    pub(super) gain: SpatialForce<S>,
    /// Joint acceleration if the frame does not accelerate.
    pub(super) free_qdd: S,
}

impl<S: Scalar> LinkScratch<S> {
    /// All zero, with numbers of the kind of `like`.
    pub fn new(like: S) -> Self {
        let (zero, zeros) = (like.constant(0.0), Vec3::zero(like));
        let zero_tensor = centripetal_tensor(zeros);
        Self {
            q: zero,
            qd: zero,
            effort: zero,
            rotation: PlanarRotation::new(like.constant(1.0), zero),
            qdd: zero,
            acceleration: SpatialMotion::zero(like),
            w: zeros,
            centripetal: zero_tensor,
            bias: SpatialMotion::zero(like),
            force: SpatialForce::zero(like),
            inertia: ArticulatedInertia {
                rotational: zero_tensor,
                coupling: Mat3([zeros; 3]),
                mass: zero_tensor,
            },
            gain: SpatialForce::zero(like),
            free_qdd: zero,
        }
    }
}

/// `[w×]²`, which maps a position to its centripetal acceleration.
#[cfg_attr(not(debug_assertions), inline(always))]
pub(super) fn centripetal_tensor<S: Scalar>(w: Vec3<S>) -> Sym3<S> {
    let [x, y, z] = w.0;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    Sym3 {
        diagonal: [-(yy + zz), -(xx + zz), -(xx + yy)],
        off: [y * z, x * z, x * y],
    }
}
