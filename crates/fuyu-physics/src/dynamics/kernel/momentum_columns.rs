//! A joint's columns of the momentum map and of the generalized Jacobian.

use super::{Scalar, Sym3, Vec3};

/// A joint with the subtree that it moves: what its columns are made of. Base axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lever<S> {
    /// Axes of the kernel frame of the body that the joint moves.
    pub axes: [Vec3<S>; 3],
    /// Origin of that frame from the base's.
    pub p_BK: Vec3<S>,
    /// First moment of the subtree across the joint's axis, kernel frame.
    pub across: [S; 2],
    /// Row of the subtree's inertia along the joint's axis, kernel frame.
    pub inertia: Vec3<S>,
}

/// How a joint moves.
#[derive(Debug, Clone, Copy)]
pub(super) enum Moves<S> {
    Turning,
    /// Carrying this mass.
    Sliding(S),
    /// Some of several joints turn (1 there) and some slide: the mass that they carry, or 0.
    Mixed {
        turning: S,
        sliding: S,
    },
}

/// A joint's columns of the momentum map and of what follows from it, base axes.
#[derive(Debug, Clone, Copy)]
pub struct Column<S> {
    /// Angular momentum of the subtree at unit joint rate with the base held, about the kernel frame's
    /// origin.
    pub torque: Vec3<S>,
    /// Linear momentum of the subtree at unit joint rate with the base held.
    pub force: Vec3<S>,
    /// Column of `J_C`, eq. (4.12).
    pub J_C: Vec3<S>,
    /// Column of `H_M`, eq. (4.26).
    pub H_M: Vec3<S>,
    /// Column of `H_A = -H_B⁻¹ H_M`, eq. (4.24).
    pub H_A: Vec3<S>,
}

impl<S: Scalar> Column<S> {
    /// A column of zeros, numbers of the kind of `like`.
    pub fn zero(like: S) -> Self {
        let none = Vec3::zero(like);
        Self {
            torque: none,
            force: none,
            J_C: none,
            H_M: none,
            H_A: none,
        }
    }

    /// `answer` is `-H_B⁻¹`, `per` one over the whole mass.
    #[inline(always)]
    pub(super) fn new(
        lever: &Lever<S>,
        moves: Moves<S>,
        p_BC: Vec3<S>,
        answer: &Sym3<S>,
        per: S,
    ) -> Self {
        let ([x, y, z], [h, k], inertia) = (lever.axes, lever.across, lever.inertia);
        let spun = || x.mul_add(inertia[0], y.mul_add(inertia[1], z.scaled(inertia[2])));
        let swept = || y.mul_add(h, x.scaled(-k));
        let (torque, force) = match moves {
            Moves::Turning => (spun(), swept()),
            Moves::Sliding(mass) => (-swept(), z.scaled(mass)),
            Moves::Mixed { turning, sliding } => {
                let swept = swept();
                let slides = turning.mul_sub_from(turning, turning.constant(1.0));
                (
                    spun().mul_add(turning, -swept.scaled(slides)),
                    swept.mul_add(turning, z.scaled(sliding)),
                )
            }
        };
        let H_M = torque + (lever.p_BK - p_BC).cross(force);
        Self {
            torque,
            force,
            J_C: force.scaled(per),
            H_M,
            H_A: answer.times(H_M),
        }
    }

    /// Motion of a point of the base at `r_CE` from the centre of mass, linear part first.
    #[inline(always)]
    pub(super) fn of_base(&self, r_CE: Vec3<S>) -> [Vec3<S>; 2] {
        [self.H_A.cross(r_CE) - self.J_C, self.H_A]
    }
}
