//! A model compiled into kernel frames.
//!
//! Each body has a kernel frame K in addition to its URDF frame B: z along the axis of the joint that moves the
//! body, x along the common normal with the axis of the next body, origin on the axis. The transform between
//! parent and child is then that of Denavit and Hartenberg, extended to trees by Khalil and Kleinfinger (1986):
//! `Rz(gamma) Tz(b) Rx(alpha) Tx(a) Rz(theta) Tz(d)`. `alpha` is often 0 or 90°, which needs no arithmetic, and `gamma` and
//! `b` differ from zero only at branches ([`JointTransform::p`] holds `a` and `b`). Results are in the frames of the URDF.

use std::sync::Arc;

use nalgebra::{Matrix3, Rotation3, Vector3};
use pulp::Simd;

use super::kernel_frames::kernel_frames;
use super::{F64x8, GROUP_SIZE, Lanes, Mat3, PlanarRotation, Scalar, SpatialForce, Vec3, sin_cos};
use crate::model::{Frame, Joint, Model};
use crate::spatial::{Pose, SpatialInertia, Wrench};

/// Entries of a rotation below this are rounding.
const ROUNDING: f64 = 1e-15;

/// A [`Model`] compiled for the kernels.
#[derive(Debug, Clone)]
pub struct Tree {
    /// All bodies; body 0 is the base.
    pub(crate) bodies: Vec<Body>,
    /// Joint `j` connects body `j + 1` to its parent.
    pub(crate) joints: Vec<JointTransform>,
    /// Joints by their depth in the tree. This order interleaves branches, so that the processor works on one
    /// while it waits for the last result of another.
    pub(crate) outward: Vec<usize>,
    /// Bodies without children.
    pub(super) leaves: Vec<usize>,
    /// `theta_0` of all joints, in groups of eight.
    theta_offsets: Vec<ThetaOffsets>,
}

/// One body in its kernel frame K.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(crate) struct Body {
    /// Pose of the kernel frame K in the body's URDF frame B.
    pub X_BK: Pose,
    /// Its inverse.
    pub X_KB: Pose,
    /// Inertia about the kernel frame's origin.
    pub inertia: SpatialInertia,
    /// Coordinate of the kernel frame's origin along the joint axis, from the reference point: the point where the
    /// common normal with the parent's axis meets the joint axis. This is `d`, or 0 for a prismatic joint, whose
    /// reference point is the origin \[m\].
    pub d_from_reference: f64,
    /// Inertia about the reference point.
    pub about_reference: SpatialInertia,
    /// One past the last body of the subtree.
    pub subtree_end: usize,
    /// Whether the inertia about the kernel frame's origin is not diagonal.
    pub inertia_is_non_diagonal: bool,
    /// Whether the centre of mass is not at the kernel frame's origin.
    pub com_is_off_origin: bool,
    /// Mass of the body with its whole subtree.
    pub subtree_mass: f64,
}

/// Joint transform from a body's kernel frame K to its parent's kernel frame P, and the joint's other constants.
///
/// `R_PK = Rz(gamma) Rx(alpha) Rz(theta)` and `p_PK = Rz(gamma) (p + d z)`, where `z` is K's z axis in the axes after
/// `Rz(gamma)`. A revolute joint has `theta = theta_0 + q`; a prismatic joint has `theta = theta_0` and adds `q` to `d`.
#[derive(Debug, Clone)]
pub(crate) struct JointTransform {
    /// Parent body.
    pub parent: usize,
    /// Whether the joint is prismatic; otherwise it is revolute.
    pub is_prismatic: bool,
    /// Which of the transform's parameters are not zero: 4 times the kind of `alpha`, plus 2 if there is a translation
    /// along K's z, plus 1 if there is one along the common normal. [`GENERAL`] with `gamma` or any other translation.
    pub shape: u8,
    /// Rotation about the parent's z axis to the common normal.
    pub gamma: PlanarRotation<f64>,
    /// Link twist: rotation about the common normal, from the parent's z axis to K's.
    pub alpha: PlanarRotation<f64>,
    /// Cosine and sine of the rotation about K's z axis at `q = 0`.
    pub theta_0: [f64; 2],
    /// Whether `theta_0` is zero.
    pub theta_0_is_zero: bool,
    /// Whether the parent is the previous body in [`Tree::outward`]: sweeps then keep its results in registers, since
    /// storing and loading them takes longer than an addition.
    pub parent_is_previous: bool,
    /// The previous body in [`Tree::outward`].
    pub previous: usize,
    /// Translation after `gamma` and before `d` \[m\]: the link length `a` along x; y and z are zero except at branches
    /// and between nearly parallel axes.
    pub p: [f64; 3],
    /// Link offset: translation along K's z axis \[m\].
    pub d: f64,
    /// K's origin in the parent's axes (of a prismatic joint at zero) \[m\].
    pub p_PK: [f64; 3],
    /// K's z in the parent's axes.
    pub axis_P: [f64; 3],
    /// The body's reference point from the parent's reference point (of a prismatic joint at `d + q = 0`), in the
    /// parent's axes \[m\].
    pub p_reference: [f64; 3],
    /// Precomputed parent term: the part of the parent's composite inertia that does not depend on positions. It is the
    /// subtree as a point mass at its reference point and, if `adds_parent_inertia`, the parent's own inertia, both
    /// about the parent's reference point. Note: the first moment is in the parent's axes, the moment of inertia in
    /// those after `Rz(gamma) Rx(alpha)`, which differ from K's by `theta` only.
    pub parent_term: SpatialInertia,
    /// Whether `parent_term` contains the parent's own inertia: true for the parent's last child, which inward sweeps
    /// visit before its siblings.
    pub adds_parent_inertia: bool,
    /// Viscous damping \[N m s/rad or N s/m\].
    pub damping: f64,
    /// Spring stiffness \[N m/rad or N/m\].
    pub stiffness: f64,
    /// Rest position of the spring \[rad or m\].
    pub rest: f64,
}

/// `theta_0` of eight joints.
#[derive(Debug, Clone)]
struct ThetaOffsets {
    /// Cosines and sines.
    cos_sin: [F64x8; 2],
    /// Whether any angle is not zero.
    any_nonzero: bool,
    /// 1 for revolute joints, 0 for prismatic ones.
    is_revolute: F64x8,
    has_prismatic: bool,
}

impl ThetaOffsets {
    fn of(joints: &[JointTransform]) -> Self {
        let mut offsets = Self {
            cos_sin: [F64x8([1.0; GROUP_SIZE]), F64x8::ZERO],
            any_nonzero: joints.iter().any(|joint| !joint.theta_0_is_zero),
            is_revolute: F64x8([1.0; GROUP_SIZE]),
            has_prismatic: joints.iter().any(|joint| joint.is_prismatic),
        };
        for (i, joint) in joints.iter().enumerate() {
            (offsets.cos_sin[0].0[i], offsets.cos_sin[1].0[i]) =
                (joint.theta_0[0], joint.theta_0[1]);
            offsets.is_revolute.0[i] = if joint.is_prismatic { 0.0 } else { 1.0 };
        }
        offsets
    }
}

/// `alpha` is zero: parallel axes.
pub(crate) const ALPHA_ZERO: u8 = 0;
/// `alpha` is 90°.
pub(crate) const ALPHA_RIGHT_ANGLE: u8 = 1;
/// `alpha` is any other angle.
pub(crate) const ALPHA_GENERAL: u8 = 2;
/// [`JointTransform::shape`] without special structure.
pub(crate) const GENERAL: u8 = 12;

impl Tree {
    /// Compiles `model`.
    pub fn new(model: &Model) -> Self {
        let frames = kernel_frames(model);
        let joints = model.tree_joints().enumerate().map(|(j, joint)| {
            let parent = model.tree_parent(j);
            JointTransform::new(joint, parent, &frames[parent], &frames[j + 1])
        });
        let mut joints: Vec<JointTransform> = joints.collect();
        let bodies: Vec<Body> = (model.bodies().iter().zip(&frames))
            .enumerate()
            .map(|(b, (body, X_BK))| {
                let subtree = &model.bodies()[b..body.subtree_end];
                let inertia = without_rounding(SpatialInertia::from(
                    &body.inertia.expressed_in(&X_BK.inverse()),
                ));
                let own = b.checked_sub(1).map(|j| &joints[j]);
                let d_from_reference =
                    own.map_or(0.0, |joint| if joint.is_prismatic { 0.0 } else { joint.d });
                Body {
                    X_BK: *X_BK,
                    X_KB: X_BK.inverse(),
                    inertia_is_non_diagonal: inertia.about_origin.off_diagonal != Vector3::zeros(),
                    com_is_off_origin: inertia.first_moment != Vector3::zeros(),
                    about_reference: inertia.shifted(&Vector3::new(0.0, 0.0, d_from_reference)),
                    inertia,
                    d_from_reference,
                    subtree_end: body.subtree_end,
                    subtree_mass: subtree.iter().map(|b| b.inertia.mass).sum(),
                }
            })
            .collect();
        let mut depths = vec![0; joints.len() + 1];
        for (j, joint) in joints.iter().enumerate() {
            depths[j + 1] = depths[joint.parent] + 1;
        }
        let mut outward: Vec<usize> = (0..joints.len()).collect();
        outward.sort_by_key(|&j| depths[j + 1]);
        let mut previous = 0;
        for &j in &outward {
            (joints[j].previous, joints[j].parent_is_previous) =
                (previous, joints[j].parent == previous);
            previous = j + 1;
        }
        let mut is_met = vec![false; bodies.len()];
        for j in (0..joints.len()).rev() {
            let joint = &mut joints[j];
            joint.adds_parent_inertia = !std::mem::replace(&mut is_met[joint.parent], true);
            joint.set_parent_term(&bodies[joint.parent], bodies[j + 1].subtree_mass);
        }
        Self {
            leaves: (0..bodies.len()).filter(|&b| !is_met[b]).collect(),
            theta_offsets: joints.chunks(GROUP_SIZE).map(ThetaOffsets::of).collect(),
            bodies,
            joints,
            outward,
        }
    }

    /// The compiled form of `model`, shared by all users.
    pub(crate) fn shared(model: &Model) -> Arc<Self> {
        model.compiled(Self::new)
    }

    /// Number of joints, including mimic joints ([`Model::tree_joints`]), which the kernels treat like all others.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Rotation by `theta` of joint `j`, from cosine and sine of the joint's position.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn joint_rotation<S: Scalar>(&self, j: usize, cos: S, sin: S) -> PlanarRotation<S> {
        self.joints[j].rotation(cos, sin)
    }

    /// Rotation from the base's kernel frame to the base frame; their origins coincide.
    pub fn base_axes(&self) -> &Rotation3<f64> {
        &self.bodies[0].X_BK.rotation
    }

    /// Rotates a vector from base axes to the axes of the base's kernel frame.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn to_base_kernel<S: Scalar>(&self, v: Vec3<S>) -> Vec3<S> {
        self.base_rotation(v[0]).tr_mul(v)
    }

    /// Rotates a vector from the axes of the base's kernel frame to base axes.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn to_base_frame<S: Scalar>(&self, v: Vec3<S>) -> Vec3<S> {
        self.base_rotation(v[0]).times(v)
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn base_rotation<S: Scalar>(&self, like: S) -> Mat3<S> {
        let R = self.base_axes().matrix();
        let row = |i| [R[(i, 0)], R[(i, 1)], R[(i, 2)]];
        Mat3([
            Vec3::constant(like, &row(0)),
            Vec3::constant(like, &row(1)),
            Vec3::constant(like, &row(2)),
        ])
    }

    /// Sets the rotations by `theta` of a group of joints at positions `q`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn set_rotations<V: Simd>(
        &self,
        simd: V,
        group: usize,
        q: &[f64],
        rotations: &mut PlanarRotation<F64x8>,
    ) {
        let offsets = &self.theta_offsets[group];
        for (k, q) in q.chunks(V::F64_LANES).enumerate() {
            let first = k * V::F64_LANES;
            let mut angles = Lanes::load_some(simd, q);
            if offsets.has_prismatic {
                angles = angles * Lanes::load(simd, &offsets.is_revolute.0[first..]);
            }
            let (mut cos, mut sin) = sin_cos(angles);
            if offsets.any_nonzero {
                let theta_0 = &offsets.cos_sin;
                let c = Lanes::load(simd, &theta_0[0].0[first..]);
                let s = Lanes::load(simd, &theta_0[1].0[first..]);
                (cos, sin) = (s.mul_sub_from(sin, c * cos), s.mul_add(cos, c * sin));
            }
            rotations.store_lanes(first, &PlanarRotation::new(cos, sin));
        }
    }

    /// Calls `set(joint, position, rotation by theta)` for every joint at positions `q`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn for_each_rotation<V: Simd>(
        &self,
        simd: V,
        q: &[f64],
        mut set: impl FnMut(usize, f64, PlanarRotation<f64>),
    ) {
        for (group, q) in q.chunks(GROUP_SIZE).enumerate() {
            let mut rotations = PlanarRotation::IDENTITY;
            self.set_rotations(simd, group, q, &mut rotations);
            for (i, &q) in q.iter().enumerate() {
                set(group * GROUP_SIZE + i, q, rotations.lane(i));
            }
        }
    }

    /// Transforms external wrenches, one per body in its URDF frame, to kernel frames. Returns whether any is not zero;
    /// if none is, `external` does not change.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn set_external_forces(
        &self,
        wrenches: &[Wrench],
        external: &mut [SpatialForce<f64>],
    ) -> bool {
        if !Wrench::any(wrenches) {
            return false;
        }
        for ((into, wrench), body) in external.iter_mut().zip(wrenches).zip(&self.bodies) {
            let wrench = wrench.shifted_to_child(&body.X_BK);
            *into = SpatialForce {
                torque: Vec3(wrench.torque.into()),
                force: Vec3(wrench.force.into()),
            };
        }
        true
    }

    /// Origin of `frame` in its body's kernel frame \[m\].
    pub(crate) fn p_KF(&self, frame: &Frame) -> Vector3<f64> {
        let p_BF = nalgebra::Point3::from(frame.X_BF.translation.vector);
        (self.bodies[frame.body].X_KB * p_BF).coords
    }

    /// Total effort on joint `j` \[N m or N\]: actuator, spring and damper.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn total_effort(&self, j: usize, actuator: f64, q: f64, qd: f64) -> f64 {
        let joint = &self.joints[j];
        actuator + (joint.stiffness * (joint.rest - q) - joint.damping * qd)
    }
}

/// Replaces entries that are rounding errors of a change of axes by zero.
fn without_rounding(mut inertia: SpatialInertia) -> SpatialInertia {
    let moment = inertia.about_origin.diagonal.amax();
    let first = (moment * inertia.mass).sqrt();
    let clean = |x: f64, size: f64| if x.abs() < ROUNDING * size { 0.0 } else { x };
    let tensor = &mut inertia.about_origin;
    tensor.off_diagonal.apply(|x| *x = clean(*x, moment));
    inertia.first_moment.apply(|x| *x = clean(*x, first));
    inertia
}

impl JointTransform {
    /// `X_LP` is the parent's kernel frame P in its link frame L, in which the description gives the joint frame;
    /// `X_BK` is the kernel frame of the moved body in that body's frame.
    fn new(joint: &Joint, parent: usize, X_LP: &Pose, X_BK: &Pose) -> Self {
        let X_PK = X_LP.inverse() * joint.X_PJ * X_BK;
        let R = X_PK.rotation.matrix();
        let clean = |x: f64| if x.abs() < ROUNDING { 0.0 } else { x };
        // K's z axis is (sin alpha sin gamma, -sin alpha cos gamma, cos alpha).
        let sine = clean(R[(0, 2)].hypot(R[(1, 2)]));
        let (gamma, alpha) = if sine == 0.0 {
            (
                PlanarRotation::new(1.0, 0.0),
                PlanarRotation::new(R[(2, 2)].signum(), 0.0),
            )
        } else {
            let (cos, sin) = (-R[(1, 2)] / sine, R[(0, 2)] / sine);
            let is_rotated = clean(R[(0, 2)]) != 0.0 || cos < 0.0;
            let gamma = if is_rotated {
                PlanarRotation::new(cos, sin)
            } else {
                PlanarRotation::new(1.0, 0.0)
            };
            (
                gamma,
                PlanarRotation::new(
                    clean(R[(2, 2)]),
                    if R[(2, 2)].abs() < ROUNDING {
                        1.0
                    } else {
                        sine
                    },
                ),
            )
        };
        let R_gamma = rotation_matrix(2, &gamma);
        let R_alpha = rotation_matrix(0, &alpha);
        // The remaining rotation is theta_0, about z.
        let theta_rotation = (R_gamma * R_alpha).transpose() * R;
        let scale = theta_rotation[(0, 0)].hypot(theta_rotation[(1, 0)]);
        let theta_0 = [theta_rotation[(0, 0)], theta_rotation[(1, 0)]].map(|x| clean(x / scale));

        let p_PK = X_PK.translation.vector;
        let size = p_PK.norm().max(1e-3);
        let mut p = R_gamma.transpose() * p_PK;
        let z = R_alpha.column(2).into_owned();
        let d = p.yz().dot(&z.yz());
        let normal = p - z * d;
        let is_dh = normal.y.abs().max(normal.z.abs()) < 4.0 * ROUNDING * size;
        let d = if is_dh { d } else { 0.0 };
        if is_dh {
            p = Vector3::new(p.x, 0.0, 0.0);
        }
        let clean = |x: f64| if x.abs() < ROUNDING * size { 0.0 } else { x };
        let (p, d) = (p.map(clean), clean(d));
        let alpha_kind = match (alpha.cos, alpha.sin) {
            (1.0, 0.0) => ALPHA_ZERO,
            (0.0, 1.0) => ALPHA_RIGHT_ANGLE,
            _ => ALPHA_GENERAL,
        };
        let is_prismatic = !joint.kind.is_rotational();
        Self {
            parent,
            is_prismatic,
            shape: if gamma.cos != 1.0 || !is_dh {
                GENERAL
            } else {
                4 * alpha_kind + 2 * u8::from(is_prismatic || d != 0.0) + u8::from(p.x != 0.0)
            },
            gamma,
            alpha,
            theta_0,
            theta_0_is_zero: theta_0 == [1.0, 0.0],
            parent_is_previous: false,
            previous: 0,
            p: p.into(),
            d,
            p_PK: (R_gamma * (p + z * d)).into(),
            axis_P: (R_gamma * z).into(),
            p_reference: (R_gamma * p).into(),
            parent_term: SpatialInertia::ZERO,
            adds_parent_inertia: false,
            damping: joint.damping,
            stiffness: joint.spring.stiffness,
            rest: joint.spring.rest,
        }
    }

    /// Sets `p_reference` and `parent_term`, where `mass` is that of the subtree that the joint moves.
    fn set_parent_term(&mut self, parent: &Body, mass: f64) {
        self.p_reference[2] += parent.d_from_reference;
        let point = SpatialInertia {
            mass,
            ..SpatialInertia::ZERO
        };
        let mut term = point.shifted(&self.p_reference.into());
        if self.adds_parent_inertia {
            term += parent.about_reference;
        }
        let R = rotation_matrix(2, &self.gamma) * rotation_matrix(0, &self.alpha);
        term.about_origin = term.about_origin.rotated(&R.transpose());
        self.parent_term = term;
    }
}

fn rotation_matrix(axis: usize, rotation: &PlanarRotation<f64>) -> Matrix3<f64> {
    let (j, k) = super::vector::other_axes(axis);
    let mut m = Matrix3::identity();
    m[(j, j)] = rotation.cos;
    m[(k, k)] = rotation.cos;
    m[(j, k)] = -rotation.sin;
    m[(k, j)] = rotation.sin;
    m
}
