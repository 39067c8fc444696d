//! A model in the frames that suit the recursions.
//!
//! Every body gets a frame of its own beside the one of its description: z along the axis of the joint
//! that moves it, x along the common normal with the axis of the body that follows it, origin on the
//! axis. Then the way from a body to its parent is a turn about z, a turn about x (often none, or a
//! quarter, which costs nothing) and a shift along few axes, as in Denavit and Hartenberg's convention;
//! a turn about the parent's z comes in where bodies branch. Only the description's frames are seen
//! from outside.

use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

use super::Turn;
use crate::model::{Joint, Model};
use crate::spatial::{Pose, SpatialInertia};

/// Entries of a rotation below this are rounding.
const ROUNDING: f64 = 1e-15;

/// A [`Model`] compiled for the kernels.
#[derive(Debug, Clone)]
pub struct Tree {
    /// Body 0 is the base.
    pub(crate) bodies: Vec<Body>,
    /// Hop `j` joins body `j + 1` to its parent.
    pub(crate) hops: Vec<Hop>,
}

/// One body in its kernel frame K.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    /// Pose of the kernel frame in the body's frame B.
    pub X_BK: Pose,
    /// Inertia about the kernel frame's origin.
    pub inertia: SpatialInertia,
    /// Whether a body hangs on this one whose number is not the next.
    pub branches: bool,
    /// Whether its inertia has entries off the diagonal.
    pub is_oblique: bool,
    /// Whether its centre of mass is off the kernel frame's origin.
    pub is_heavy: bool,
}

/// How a body moves against its parent: `R_PK = Rz(swing) Rx(bend) Rz(home + q)`, and the origin at
/// `Rz(swing) p` (for a slide with `q` along K's z added).
#[derive(Debug, Clone)]
pub(crate) struct Hop {
    pub parent: usize,
    /// Whether the parent is the body before this one.
    pub follows: bool,
    /// Whether no other body with this parent comes later.
    pub is_last: bool,
    pub slides: bool,
    pub swing: Option<Turn<f64>>,
    pub bend: Bend,
    pub home: [f64; 2],
    pub p: [f64; 3],
    /// The same in the parent's axes.
    pub p_PK: [f64; 3],
    /// K's z in the parent's axes.
    pub axis_P: [f64; 3],
    pub shifts: bool,
    pub damping: f64,
    pub stiffness: f64,
    pub rest: f64,
}

/// Turn about x between two joint axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Bend {
    /// Parallel axes.
    Straight,
    /// A right angle.
    Quarter,
    /// Any other angle.
    By(Turn<f64>),
}

impl Tree {
    /// Compiles `model`.
    pub fn new(model: &Model) -> Self {
        let frames = kernel_frames(model);
        let mut bodies: Vec<Body> = (model.bodies().iter().zip(&frames))
            .map(|(body, X_BK)| {
                let inertia = without_rounding(SpatialInertia::from(
                    &body.inertia.expressed_in(&X_BK.inverse()),
                ));
                Body {
                    X_BK: *X_BK,
                    is_oblique: inertia.about_origin.off_diagonal != Vector3::zeros(),
                    is_heavy: inertia.first_moment != Vector3::zeros(),
                    inertia,
                    branches: false,
                }
            })
            .collect();
        let mut hops = Vec::with_capacity(model.dof());
        for (j, joint) in model.joints().iter().enumerate() {
            let parent = model.joint_parent(j);
            bodies[parent].branches |= parent != j;
            let end = model.bodies()[parent].subtree_end;
            let is_last = model.bodies()[j + 1].subtree_end == end;
            hops.push(Hop::new(
                joint,
                parent,
                j,
                is_last,
                [&frames[parent], &frames[j + 1]],
            ));
        }
        Self { bodies, hops }
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.hops.len()
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

/// `X_BK` of every body.
fn kernel_frames(model: &Model) -> Vec<Pose> {
    let bodies = model.bodies();
    let mut frames = vec![Pose::identity(); bodies.len()];
    for b in (0..bodies.len()).rev() {
        let own = b.checked_sub(1).map(|j| &model.joints()[j]);
        let next = (bodies[b].subtree_end > b + 1).then(|| &model.joints()[b]);
        frames[b] = match (own, next) {
            (None, None) => Pose::identity(),
            // The base has no axis of its own; it takes that of the first joint.
            (None, Some(next)) => {
                let z = next.X_PJ.rotation * next.axis;
                let p = (next.X_PJ * frames[b + 1]).translation.vector;
                Pose::from_parts(Translation3::identity(), axes(&z, &(p - *z * z.dot(&p))))
            }
            (Some(own), None) => {
                Pose::from_parts(Translation3::identity(), axes(&own.axis, &Vector3::zeros()))
            }
            (Some(own), Some(next)) => {
                let at = next.X_PJ * frames[b + 1];
                let (z, w) = (*own.axis, *(next.X_PJ.rotation * next.axis));
                let p = at.translation.vector;
                let normal = z.cross(&w);
                let sine = normal.norm_squared();
                let (x, along) = if sine < 1e-12 {
                    (p - z * z.dot(&p), z.dot(&p))
                } else {
                    // Where the common normal meets this body's axis.
                    (normal, normal.dot(&p.cross(&w)) / sine)
                };
                // Nearly parallel axes have their normal far away, which would cost digits.
                let size = p.norm() + bodies[b].inertia.com.norm();
                let along = if along.abs() <= size { along } else { 0.0 };
                Pose::from_parts(Translation3::from(z * along), axes(&z, &x))
            }
        };
    }
    frames
}

/// Axes with the given z, and x as near to `x` as can be (anywhere if that is zero).
fn axes(z: &Vector3<f64>, x: &Vector3<f64>) -> Rotation3<f64> {
    let z = z.normalize();
    let mut x = x - z * z.dot(x);
    if x.norm() <= 1e-9 {
        let mut least = Vector3::zeros();
        least[z.iamin()] = 1.0;
        x = least - z * z.dot(&least);
    }
    let x = x.normalize();
    let y = z.cross(&x).normalize();
    Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y.cross(&z), y, z]))
}

impl Hop {
    fn new(
        joint: &Joint,
        parent: usize,
        j: usize,
        is_last: bool,
        [X_PF, X_BK]: [&Pose; 2],
    ) -> Self {
        let X_FK = X_PF.inverse() * joint.X_PJ * X_BK;
        let R = X_FK.rotation.matrix();
        let sine = R[(0, 2)].hypot(R[(1, 2)]);
        let turn = |cos: f64, sin: f64| Turn::new(cos, sin);
        let (swing, bend) = if sine < ROUNDING {
            if R[(2, 2)] > 0.0 {
                (None, Bend::Straight)
            } else {
                (None, Bend::By(turn(-1.0, 0.0)))
            }
        } else {
            // K's z is (sin a sin s, -sin a cos s, cos a).
            let (cos_s, sin_s) = (-R[(1, 2)] / sine, R[(0, 2)] / sine);
            let swing = if R[(0, 2)].abs() < ROUNDING && cos_s > 0.0 {
                None
            } else {
                Some(turn(cos_s, sin_s))
            };
            let bend = if R[(2, 2)].abs() < ROUNDING {
                Bend::Quarter
            } else {
                Bend::By(turn(R[(2, 2)], sine))
            };
            (swing, bend)
        };
        let swung = swing.map_or(Matrix3::identity(), |t| turn_matrix(2, &t));
        let bent = turn_matrix(0, &bend.turn());
        // What the two leave over is the turn about z.
        let rest = (swung * bent).transpose() * R;
        let scale = rest[(0, 0)].hypot(rest[(1, 0)]);
        let home = [rest[(0, 0)] / scale, rest[(1, 0)] / scale]
            .map(|x| if x.abs() < ROUNDING { 0.0 } else { x });
        let p_PK = X_FK.translation.vector;
        let size = p_PK.norm().max(1e-3);
        let p = (swung.transpose() * p_PK).map(|x| if x.abs() < ROUNDING * size { 0.0 } else { x });
        Self {
            parent,
            follows: parent == j,
            is_last,
            slides: !joint.kind.is_rotational(),
            swing,
            bend,
            home,
            p: p.into(),
            p_PK: (swung * p).into(),
            axis_P: (swung * bent).column(2).into_owned().into(),
            shifts: p != Vector3::zeros(),
            damping: joint.damping,
            stiffness: joint.spring.stiffness,
            rest: joint.spring.rest,
        }
    }
}

impl Bend {
    fn turn(&self) -> Turn<f64> {
        match self {
            Self::Straight => Turn::new(1.0, 0.0),
            Self::Quarter => Turn::new(0.0, 1.0),
            Self::By(turn) => *turn,
        }
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
