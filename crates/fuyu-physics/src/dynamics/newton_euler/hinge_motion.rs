//! Displacement, rate and acceleration across one hinge, as linear functions of the motion of its two bodies.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3, Vector6};

use super::axis::Rotations;
use super::system::CompiledHinge;
use super::{Axis, BodyState, Hinge, System};

/// Pose and velocity of a body, world axes. Inertial space is a body at rest at the origin.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyPlacement {
    pub p: Vector3<f64>,
    pub R_WB: UnitQuaternion<f64>,
    pub R: Matrix3<f64>,
    pub v: Vector3<f64>,
    pub w: Vector3<f64>,
}

impl BodyPlacement {
    pub const INERTIAL: Self = Self {
        p: Vector3::new(0.0, 0.0, 0.0),
        R_WB: UnitQuaternion::new_unchecked(Quaternion::new(1.0, 0.0, 0.0, 0.0)),
        R: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        v: Vector3::new(0.0, 0.0, 0.0),
        w: Vector3::new(0.0, 0.0, 0.0),
    };

    pub fn new(state: &BodyState) -> Self {
        let R_WB = state.R_WB();
        let R = R_WB.to_rotation_matrix().into_inner();
        Self {
            p: state.p_WC,
            R_WB,
            R,
            v: R * state.v_WC_B,
            w: R * state.w_WB_B,
        }
    }
}

/// Displacement, rate and directions of one hinge. Along each of its six axes the rate is `n · (v, ω of outer) - m ·
/// (v, ω of inner)`, where the columns `n` and `m` are [`HingeMotion::outer`] and [`HingeMotion::inner`]; the
/// acceleration is the same combination of accelerations plus [`HingeMotion::bias`]. The same columns are the wrenches
/// of a unit force along the axis on the two bodies.
#[derive(Debug, Clone)]
pub(super) struct HingeMotion {
    /// Directions of the axes, world axes.
    pub directions: [Vector3<f64>; 6],
    /// From each body's centre of mass to N's origin, where forces act, world axes.
    arm_inner: Vector3<f64>,
    arm_outer: Vector3<f64>,
    /// Displacement along free axes; error along constrained ones.
    pub displacement: Vector6<f64>,
    pub rate: Vector6<f64>,
    /// Acceleration due to the velocities alone.
    pub bias: Vector6<f64>,
}

impl HingeMotion {
    pub fn new(
        hinge: &Hinge,
        joined: &CompiledHinge,
        inner: &BodyPlacement,
        outer: &BodyPlacement,
    ) -> Self {
        let M = inner.R * joined.R_BM.to_rotation_matrix().into_inner();
        let N = outer.R * joined.R_BN.to_rotation_matrix().into_inner();
        let (e_m, e_n) = (inner.R * joined.e_inner, outer.R * joined.e_outer);
        // From M's origin to N's (y of TR-942), and its rate.
        let d = (outer.p - inner.p) + (e_n - e_m);
        let dd = (outer.v - inner.v) + outer.w.cross(&e_n) - inner.w.cross(&e_m);
        let centripetal = outer.w.cross(&outer.w.cross(&e_n)) - inner.w.cross(&inner.w.cross(&e_m));
        let turning = outer.w - inner.w;

        let m = |k: usize| M.column(k).into_owned();
        let mut directions = [m(0), m(1), m(2), m(0), m(1), m(2)];
        let mut direction_rates = directions.map(|u| inner.w.cross(&u));
        let rotations = hinge.freedom.rotations();
        if let Rotations::Two(a, b) = rotations {
            let (u, n) = (m(a), N.column(b).into_owned());
            let (du, dn) = (inner.w.cross(&u), outer.w.cross(&n));
            // a × b is the third axis, or its negative for x and z.
            let (c, sign) = (3 - a - b, if b == a + 1 { 1.0 } else { -1.0 });
            directions[3 + b] = n;
            direction_rates[3 + b] = dn;
            directions[3 + c] = u.cross(&n) * sign;
            direction_rates[3 + c] = (du.cross(&n) + u.cross(&dn)) * sign;
        }
        let (mut rate, mut bias) = (Vector6::zeros(), Vector6::zeros());
        let mut displacement = Vector6::zeros();
        for k in 0..3 {
            let (u, du) = (&directions[k], &direction_rates[k]);
            displacement[k] = u.dot(&d);
            rate[k] = u.dot(&dd) + du.dot(&d);
            bias[k] = u.dot(&centripetal) + 2.0 * du.dot(&dd) + inner.w.cross(du).dot(&d);
        }
        for k in 3..6 {
            rate[k] = directions[k].dot(&turning);
            bias[k] = direction_rates[k].dot(&turning);
        }
        let relative = (inner.R_WB * joined.R_BM).inverse() * (outer.R_WB * joined.R_BN);
        let angles = angles(hinge, rotations, &relative, joined.closes_loop);
        displacement.fixed_rows_mut::<3>(3).copy_from(&angles);
        Self {
            directions,
            arm_inner: e_m + d,
            arm_outer: e_n,
            displacement,
            rate,
            bias,
        }
    }

    /// Force, and torque about its centre of mass, of a unit force or torque along `axis` on the outer body, world
    /// axes.
    pub fn outer(&self, axis: Axis) -> (Vector3<f64>, Vector3<f64>) {
        self.unit(axis, &self.arm_outer)
    }

    /// The same for the inner body; the actual wrench on it is the opposite.
    pub fn inner(&self, axis: Axis) -> (Vector3<f64>, Vector3<f64>) {
        self.unit(axis, &self.arm_inner)
    }

    fn unit(&self, axis: Axis, arm: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let u = self.directions[axis.index()];
        if axis.is_rotation() {
            (Vector3::zeros(), u)
        } else {
            (u, arm.cross(&u))
        }
    }
}

/// Angles about the three axes from N's attitude in M: coordinates about free axes, errors about constrained ones.
fn angles(
    hinge: &Hinge,
    rotations: Rotations,
    relative: &UnitQuaternion<f64>,
    closes_loop: bool,
) -> Vector3<f64> {
    let (w, v) = (relative.w, relative.imag());
    let rest = |k: usize| hinge.springs[3 + k].rest;
    // The equivalent angle within half a period of the spring's rest position.
    let near =
        |angle: f64, rest: f64, period: f64| angle - period * ((angle - rest) / period).round();
    match rotations {
        Rotations::One(a) => {
            // Tilt of N's axis in M, as a rotation vector.
            let axis = Vector3::ith(a, 1.0);
            let n = relative * axis;
            let tilt = axis.cross(&n);
            let size = tilt.norm();
            let mut angles = if size > 0.0 {
                tilt * (size.atan2(n[a]) / size)
            } else if n[a] < 0.0 {
                Vector3::repeat(PI)
            } else {
                tilt
            };
            // For an assembled start, the sign of the quaternion distinguishes two turns.
            let period = if closes_loop { TAU } else { 2.0 * TAU };
            angles[a] = near(2.0 * v[a].atan2(w), rest(a), period);
            angles
        }
        Rotations::Two(a, b) => {
            // Q = (c1 + s1 a)(c2 + s2 b): both pairs are multiples of (c1, s1) and of (c2, s2).
            let c = 3 - a - b;
            let sign = if b == a + 1 { 1.0 } else { -1.0 };
            let vc = sign * v[c];
            let pair = |p: (f64, f64), q: (f64, f64)| {
                let p_longer = p.0.hypot(p.1) >= q.0.hypot(q.1);
                let (x, y) = if p_longer { p } else { q };
                2.0 * y.atan2(x)
            };
            let mut angles = Vector3::zeros();
            angles[a] = near(pair((w, v[a]), (v[b], vc)), rest(a), TAU);
            angles[b] = near(pair((w, v[b]), (v[a], vc)), rest(b), TAU);
            let n = relative * Vector3::ith(b, 1.0);
            angles[c] = -sign * n[a].clamp(-1.0, 1.0).asin();
            angles
        }
        Rotations::None | Rotations::Three => relative.scaled_axis(),
    }
}

impl System {
    pub(super) fn placed(state: &[f64], body: Option<usize>) -> BodyPlacement {
        body.map_or(BodyPlacement::INERTIAL, |b| {
            BodyPlacement::new(&BodyState::read(state, b))
        })
    }

    pub(super) fn hinge_motion(&self, state: &[f64], hinge: usize) -> HingeMotion {
        let joined = &self.joined[hinge];
        let inner = Self::placed(state, joined.inner);
        let outer = Self::placed(state, joined.outer);
        HingeMotion::new(&self.hinges[hinge], joined, &inner, &outer)
    }

    /// Displacements of a hinge \[m, rad\] in the order of [`Axis::ALL`]: `y` and `θ` of TR-942; on constrained
    /// axes the error.
    ///
    /// An angle about a single free axis is unique within two turns of its spring's rest position, if the state comes
    /// from [`System::assemble`]; within half a turn if the hinge closes a loop or has two free rotations. Three free
    /// rotations are a rotation vector of at most half a turn.
    pub fn displacement(&self, state: &[f64], hinge: usize) -> [f64; 6] {
        self.hinge_motion(state, hinge).displacement.into()
    }

    /// Rates along and about the axes of a hinge \[m/s, rad/s\]; with three free rotations the components of the
    /// relative angular velocity along the inner frame's axes.
    pub fn rate(&self, state: &[f64], hinge: usize) -> [f64; 6] {
        self.hinge_motion(state, hinge).rate.into()
    }
}
