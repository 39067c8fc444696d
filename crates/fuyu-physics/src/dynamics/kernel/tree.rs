//! A model in the frames that suit the recursions.
//!
//! Every body gets a frame of its own beside the one of its description: z along the axis of the joint
//! that moves it, x along the common normal with the axis of the body that follows it, origin on the
//! axis. Then the way from a body to its parent is a turn about z, a turn about x (often none, or a
//! quarter, which costs nothing) and a shift along few axes, as in Denavit and Hartenberg's convention;
//! a turn about the parent's z comes in where bodies branch. Only the description's frames are seen
//! from outside.

use nalgebra::{Matrix3, Rotation3, Vector3};
use pulp::Simd;

use super::kernel_frames::kernel_frames;
use super::{Eight, Force, GROUP, Lanes, Mat3, Scalar, Turn, Vec3, sin_cos};
use crate::model::{Frame, Joint, Model};
use crate::spatial::{Pose, SpatialInertia, Wrench};

/// Entries of a rotation below this are rounding.
const ROUNDING: f64 = 1e-15;

/// A [`Model`] compiled for the kernels.
#[derive(Debug, Clone)]
pub struct Tree {
    /// Body 0 is the base.
    pub(crate) bodies: Vec<Body>,
    /// Hop `j` joins body `j + 1` to its parent.
    pub(crate) hops: Vec<Hop>,
    /// The hops by their distance from the base. In this order branches are taken side by side, and the
    /// processor works on one while another waits for its last result.
    pub(crate) outward: Vec<usize>,
    /// Bodies that carry no other.
    pub(super) leaves: Vec<usize>,
    /// What joints turn by beyond their positions, eight side by side.
    homes: Vec<Homes>,
}

/// One body in its kernel frame K.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(crate) struct Body {
    /// Pose of the kernel frame in the body's frame B.
    pub X_BK: Pose,
    /// Its inverse.
    pub X_KB: Pose,
    /// Inertia about the kernel frame's origin.
    pub inertia: SpatialInertia,
    /// Where the kernel frame's origin is on the axis of the joint that moves the body, from the foot of the
    /// common normal with the parent's axis (0 for a slide: it has its foot at the origin).
    pub rise: f64,
    /// Inertia about that foot.
    pub about_foot: SpatialInertia,
    /// First of the bodies beyond the subtree.
    pub subtree_end: usize,
    /// Whether its inertia has entries off the diagonal.
    pub is_oblique: bool,
    /// Whether its centre of mass is off the kernel frame's origin.
    pub is_heavy: bool,
    /// Mass of the body with its whole subtree.
    pub subtree_mass: f64,
}

/// How a body moves against its parent: `R_PK = Rz(swing) Rx(bend) Rz(home + q)`, and the origin at
/// `Rz(swing) (p + d z)` with K's z before the swing; a slide adds its position to `d`.
#[derive(Debug, Clone)]
pub(crate) struct Hop {
    pub parent: usize,
    pub slides: bool,
    /// What of the hop has to be computed: 4 times the bend, 2 for a shift along K's z, 1 for one along the
    /// common normal. With a swing or any other shift it is [`GENERAL`], and everything is computed.
    pub shape: u8,
    pub swing: Turn<f64>,
    pub bend: Turn<f64>,
    pub home: [f64; 2],
    /// Whether that is no turn.
    pub is_home: bool,
    /// Whether the parent is the body that comes before this one in [`Tree::outward`]: a sweep then hands on
    /// what it found in registers, since to write it and to read it again takes longer than a sum.
    pub follows: bool,
    /// The body that comes before there.
    pub before: usize,
    pub p: [f64; 3],
    pub d: f64,
    /// Origin in the parent (a slide at zero), in the parent's axes.
    pub p_PK: [f64; 3],
    /// K's z in the parent's axes.
    pub axis_P: [f64; 3],
    /// The moved body's foot from the parent's foot (a slide's before it slides), in the parent's axes.
    pub foot: [f64; 3],
    /// What the parent's inertia about its foot has more than the moved subtree's first moment and inertia as it
    /// was about its own, turned: all of it known beforehand. The inertia is in the axes before bend and swing.
    pub arrival: SpatialInertia,
    /// Whether it leads to the parent's last child, which all sweeps inward meet before its others: `arrival` then
    /// brings in the parent's own inertia.
    pub arrives_first: bool,
    pub damping: f64,
    pub stiffness: f64,
    pub rest: f64,
}

/// Eight joints side by side: cosines and sines of what they turn by at position zero.
#[derive(Debug, Clone)]
struct Homes {
    turns: [Eight; 2],
    /// Whether any of them is not zero.
    is_any: bool,
    /// 1 where a joint turns, 0 where it slides.
    turning: Eight,
    is_mixed: bool,
}

impl Homes {
    fn of(hops: &[Hop]) -> Self {
        let mut homes = Self {
            turns: [Eight([1.0; GROUP]), Eight::ZERO],
            is_any: hops.iter().any(|hop| !hop.is_home),
            turning: Eight([1.0; GROUP]),
            is_mixed: hops.iter().any(|hop| hop.slides),
        };
        for (i, hop) in hops.iter().enumerate() {
            (homes.turns[0].0[i], homes.turns[1].0[i]) = (hop.home[0], hop.home[1]);
            homes.turning.0[i] = if hop.slides { 0.0 } else { 1.0 };
        }
        homes
    }
}

/// Parallel axes.
pub(crate) const STRAIGHT: u8 = 0;
/// Axes at a right angle.
pub(crate) const QUARTER: u8 = 1;
/// Axes at any angle.
pub(crate) const BENT: u8 = 2;
/// A shape that is none of the others.
pub(crate) const GENERAL: u8 = 12;

impl Tree {
    /// Compiles `model`.
    pub fn new(model: &Model) -> Self {
        let frames = kernel_frames(model);
        let hops = model.joints().iter().enumerate().map(|(j, joint)| {
            let parent = model.joint_parent(j);
            Hop::new(joint, parent, &frames[parent], &frames[j + 1])
        });
        let mut hops: Vec<Hop> = hops.collect();
        let bodies: Vec<Body> = (model.bodies().iter().zip(&frames))
            .enumerate()
            .map(|(b, (body, X_BK))| {
                let subtree = &model.bodies()[b..body.subtree_end];
                let inertia = without_rounding(SpatialInertia::from(
                    &body.inertia.expressed_in(&X_BK.inverse()),
                ));
                let own = b.checked_sub(1).map(|j| &hops[j]);
                let rise = own.map_or(0.0, |hop| if hop.slides { 0.0 } else { hop.d });
                Body {
                    X_BK: *X_BK,
                    X_KB: X_BK.inverse(),
                    is_oblique: inertia.about_origin.off_diagonal != Vector3::zeros(),
                    is_heavy: inertia.first_moment != Vector3::zeros(),
                    about_foot: inertia.shifted(&Vector3::new(0.0, 0.0, rise)),
                    inertia,
                    rise,
                    subtree_end: body.subtree_end,
                    subtree_mass: subtree.iter().map(|b| b.inertia.mass).sum(),
                }
            })
            .collect();
        let mut depths = vec![0; hops.len() + 1];
        for (j, hop) in hops.iter().enumerate() {
            depths[j + 1] = depths[hop.parent] + 1;
        }
        let mut outward: Vec<usize> = (0..hops.len()).collect();
        outward.sort_by_key(|&j| depths[j + 1]);
        let mut before = 0;
        for &j in &outward {
            (hops[j].before, hops[j].follows) = (before, hops[j].parent == before);
            before = j + 1;
        }
        let mut is_met = vec![false; bodies.len()];
        for j in (0..hops.len()).rev() {
            let hop = &mut hops[j];
            hop.arrives_first = !std::mem::replace(&mut is_met[hop.parent], true);
            hop.prepare_arrival(&bodies[hop.parent], bodies[j + 1].subtree_mass);
        }
        Self {
            leaves: (0..bodies.len()).filter(|&b| !is_met[b]).collect(),
            homes: hops.chunks(GROUP).map(Homes::of).collect(),
            bodies,
            hops,
            outward,
        }
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.hops.len()
    }

    /// Turn of the body that joint `j` moves, for cosine and sine of the joint's position.
    #[inline(always)]
    pub fn turn<S: Scalar>(&self, j: usize, cos: S, sin: S) -> Turn<S> {
        self.hops[j].turn(cos, sin)
    }

    /// Axes of the base's kernel frame in the base frame; the origins are the same.
    pub fn base_axes(&self) -> &Rotation3<f64> {
        &self.bodies[0].X_BK.rotation
    }

    /// A vector of the base frame's axes in those of its kernel frame.
    #[inline(always)]
    pub(crate) fn to_base_kernel<S: Scalar>(&self, v: Vec3<S>) -> Vec3<S> {
        self.base_rotation(v[0]).tr_mul(v)
    }

    /// A vector of the base's kernel frame in the axes of the base frame.
    #[inline(always)]
    pub(crate) fn to_base_frame<S: Scalar>(&self, v: Vec3<S>) -> Vec3<S> {
        self.base_rotation(v[0]).times(v)
    }

    #[inline(always)]
    fn base_rotation<S: Scalar>(&self, like: S) -> Mat3<S> {
        let R = self.base_axes().matrix();
        let row = |i| [R[(i, 0)], R[(i, 1)], R[(i, 2)]];
        Mat3([
            Vec3::constant(like, &row(0)),
            Vec3::constant(like, &row(1)),
            Vec3::constant(like, &row(2)),
        ])
    }

    /// Sets the turns of the joints of a group, which are at positions `q`.
    #[inline(always)]
    pub(super) fn set_turns<V: Simd>(
        &self,
        simd: V,
        group: usize,
        q: &[f64],
        turns: &mut Turn<Eight>,
    ) {
        let homes = &self.homes[group];
        for (k, q) in q.chunks(V::F64_LANES).enumerate() {
            let first = k * V::F64_LANES;
            let mut angles = Lanes::load_some(simd, q);
            if homes.is_mixed {
                angles = angles * Lanes::load(simd, &homes.turning.0[first..]);
            }
            let (mut cos, mut sin) = sin_cos(angles);
            if homes.is_any {
                let home = &homes.turns;
                let c = Lanes::load(simd, &home[0].0[first..]);
                let s = Lanes::load(simd, &home[1].0[first..]);
                (cos, sin) = (s.mul_sub_from(sin, c * cos), s.mul_add(cos, c * sin));
            }
            turns.set(first, &Turn::new(cos, sin));
        }
    }

    /// Tells the turn of every joint at positions `q`.
    #[inline(always)]
    pub(crate) fn turns<V: Simd>(
        &self,
        simd: V,
        q: &[f64],
        mut tell: impl FnMut(usize, f64, Turn<f64>),
    ) {
        for (group, q) in q.chunks(GROUP).enumerate() {
            let mut turns = Turn::NONE;
            self.set_turns(simd, group, q, &mut turns);
            for (i, &q) in q.iter().enumerate() {
                tell(group * GROUP + i, q, turns.at(i));
            }
        }
    }

    /// Takes over wrenches on the bodies into the kernel frames. Says whether there is any.
    #[inline(always)]
    pub(crate) fn load(&self, wrenches: &[Wrench], external: &mut [Force<f64>]) -> bool {
        if !Wrench::any(wrenches) {
            return false;
        }
        for ((into, wrench), body) in external.iter_mut().zip(wrenches).zip(&self.bodies) {
            let wrench = wrench.shifted_to_child(&body.X_BK);
            *into = Force {
                torque: Vec3(wrench.torque.into()),
                force: Vec3(wrench.force.into()),
            };
        }
        true
    }

    /// `frame`'s origin in its body's kernel frame.
    pub(crate) fn p_KF(&self, frame: &Frame) -> Vector3<f64> {
        let p_BF = nalgebra::Point3::from(frame.X_BF.translation.vector);
        (self.bodies[frame.body].X_KB * p_BF).coords
    }

    /// Effort that joint `j` feels: the actuator's and those of spring and damper.
    #[inline(always)]
    pub(crate) fn effort(&self, j: usize, actuator: f64, q: f64, qd: f64) -> f64 {
        let hop = &self.hops[j];
        actuator + (hop.stiffness * (hop.rest - q) - hop.damping * qd)
    }
}

/// Zeros that a change of axes has smeared are zeros again.
fn without_rounding(mut inertia: SpatialInertia) -> SpatialInertia {
    let moment = inertia.about_origin.diagonal.amax();
    let first = (moment * inertia.mass).sqrt();
    let clean = |x: f64, size: f64| if x.abs() < ROUNDING * size { 0.0 } else { x };
    let tensor = &mut inertia.about_origin;
    tensor.off_diagonal.apply(|x| *x = clean(*x, moment));
    inertia.first_moment.apply(|x| *x = clean(*x, first));
    inertia
}

impl Hop {
    fn new(joint: &Joint, parent: usize, X_PF: &Pose, X_BK: &Pose) -> Self {
        let X_FK = X_PF.inverse() * joint.X_PJ * X_BK;
        let R = X_FK.rotation.matrix();
        let clean = |x: f64| if x.abs() < ROUNDING { 0.0 } else { x };
        // K's z is (sin bend sin swing, -sin bend cos swing, cos bend).
        let sine = clean(R[(0, 2)].hypot(R[(1, 2)]));
        let (swing, bend) = if sine == 0.0 {
            (Turn::new(1.0, 0.0), Turn::new(R[(2, 2)].signum(), 0.0))
        } else {
            let (cos, sin) = (-R[(1, 2)] / sine, R[(0, 2)] / sine);
            let swings = clean(R[(0, 2)]) != 0.0 || cos < 0.0;
            let swing = if swings {
                Turn::new(cos, sin)
            } else {
                Turn::new(1.0, 0.0)
            };
            (
                swing,
                Turn::new(
                    clean(R[(2, 2)]),
                    if R[(2, 2)].abs() < ROUNDING {
                        1.0
                    } else {
                        sine
                    },
                ),
            )
        };
        let swung = turn_matrix(2, &swing);
        let bent = turn_matrix(0, &bend);
        // What the two leave over is the turn about z.
        let rest = (swung * bent).transpose() * R;
        let scale = rest[(0, 0)].hypot(rest[(1, 0)]);
        let home = [rest[(0, 0)], rest[(1, 0)]].map(|x| clean(x / scale));

        let p_PK = X_FK.translation.vector;
        let size = p_PK.norm().max(1e-3);
        let mut p = swung.transpose() * p_PK;
        let z = bent.column(2).into_owned();
        let d = p.yz().dot(&z.yz());
        let across = p - z * d;
        let is_dh = across.y.abs().max(across.z.abs()) < 4.0 * ROUNDING * size;
        let d = if is_dh { d } else { 0.0 };
        if is_dh {
            p = Vector3::new(p.x, 0.0, 0.0);
        }
        let clean = |x: f64| if x.abs() < ROUNDING * size { 0.0 } else { x };
        let (p, d) = (p.map(clean), clean(d));
        let bend_kind = match (bend.cos, bend.sin) {
            (1.0, 0.0) => STRAIGHT,
            (0.0, 1.0) => QUARTER,
            _ => BENT,
        };
        let slides = !joint.kind.is_rotational();
        Self {
            parent,
            slides,
            shape: if swing.cos != 1.0 || !is_dh {
                GENERAL
            } else {
                4 * bend_kind + 2 * u8::from(slides || d != 0.0) + u8::from(p.x != 0.0)
            },
            swing,
            bend,
            home,
            is_home: home == [1.0, 0.0],
            follows: false,
            before: 0,
            p: p.into(),
            d,
            p_PK: (swung * (p + z * d)).into(),
            axis_P: (swung * z).into(),
            foot: (swung * p).into(),
            arrival: SpatialInertia::ZERO,
            arrives_first: false,
            damping: joint.damping,
            stiffness: joint.spring.stiffness,
            rest: joint.spring.rest,
        }
    }

    /// What is known of the moved subtree of mass `mass` once it is the parent's, before positions are known.
    fn prepare_arrival(&mut self, parent: &Body, mass: f64) {
        self.foot[2] += parent.rise;
        let point = SpatialInertia {
            mass,
            ..SpatialInertia::ZERO
        };
        let mut arrival = point.shifted(&self.foot.into());
        if self.arrives_first {
            arrival += parent.about_foot;
        }
        let R = turn_matrix(2, &self.swing) * turn_matrix(0, &self.bend);
        arrival.about_origin = arrival.about_origin.rotated(&R.transpose());
        self.arrival = arrival;
    }
}

fn turn_matrix(axis: usize, turn: &Turn<f64>) -> Matrix3<f64> {
    let (j, k) = super::vector::others(axis);
    let mut m = Matrix3::identity();
    m[(j, j)] = turn.cos;
    m[(k, k)] = turn.cos;
    m[(j, k)] = -turn.sin;
    m[(k, j)] = turn.sin;
    m
}
