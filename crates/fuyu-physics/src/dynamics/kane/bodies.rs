//! The recursions from body to body of TR-942 section 2.3.4, in world axes.
//!
//! A body's reference point is its hinge `h`: the origin of its frame. Where the report uses `r̂`, the code uses the
//! first moment `m̂ r̂`, so that no division fails for a body without mass (the part between the two freedoms of one
//! hinge).

use nalgebra::{Matrix3, Rotation3, Unit, UnitQuaternion, Vector3};

use crate::dynamics::TreeMotion;
use crate::model::{Body, Joint, Model};
use crate::spatial::{Pose, Twist, Wrench};

/// A body and the hinge that moves it; numbered as in the model.
#[derive(Debug, Clone)]
pub(super) struct KaneBody {
    /// The body on the main body's side; `None` for the main body.
    pub(super) inner: Option<usize>,
    hinge: Hinge,
    mass: f64,
    com_B: Vector3<f64>,
    /// Inertia about the hinge, body axes.
    inertia_B: Matrix3<f64>,
    pub(super) R_WB: Rotation3<f64>,
    /// `P_k`: position of the hinge from that of the main body.
    pub(super) p: Vector3<f64>,
    /// `d_k`: position of the hinge from that of the inner body.
    d: Vector3<f64>,
    /// Direction in which the hinge moves.
    pub(super) z: Vector3<f64>,
    /// `v_k`, `ω_k`.
    pub(super) velocity: Twist,
    /// `a_k`, `α_k` of eq. (2.3.9): acceleration while the generalized speeds are constant.
    pub(super) bias: Twist,
    /// Mass of the outer set: the body and all bodies outward of it. The following fields are also of the outer set.
    pub(super) mass_hat: f64,
    /// `m̂ r̂`.
    pub(super) moment_hat: Vector3<f64>,
    /// Moment of inertia about the hinge.
    inertia_hat: Matrix3<f64>,
    /// `f̂*₀ + f̂_g` and `t̂*₀ + t̂_g`: inertial and external force, about the hinge.
    pub(super) force_hat: Wrench,
    /// Momentum of the outer set while this hinge alone moves, at unit rate; about the hinge.
    pub(super) unit_momentum: Wrench,
}

/// A hinge with one degree of freedom.
#[derive(Debug, Clone)]
struct Hinge {
    is_prismatic: bool,
    /// Pose in the inner body at position zero.
    X_PJ: Pose,
    axis_J: Unit<Vector3<f64>>,
}

impl KaneBody {
    pub(super) fn all(model: &Model) -> Vec<Self> {
        let joints = std::iter::once(None).chain(model.tree_joints().map(Some));
        let bodies = model.bodies().iter().zip(joints);
        bodies.map(|(body, joint)| Self::new(body, joint)).collect()
    }

    fn new(body: &Body, joint: Option<&Joint>) -> Self {
        let (mass, com) = (body.inertia.mass, body.inertia.com);
        Self {
            inner: body.parent,
            hinge: joint.map_or_else(Hinge::none, Hinge::new),
            mass,
            com_B: com,
            inertia_B: body.inertia.about_com + point_inertia(mass, &com),
            R_WB: Rotation3::identity(),
            p: Vector3::zeros(),
            d: Vector3::zeros(),
            z: Vector3::zeros(),
            velocity: Twist::ZERO,
            bias: Twist::ZERO,
            mass_hat: 0.0,
            moment_hat: Vector3::zeros(),
            inertia_hat: Matrix3::zeros(),
            force_hat: Wrench::ZERO,
            unit_momentum: Wrench::ZERO,
        }
    }

    /// Whether the hinge translates (`h ∈ T`).
    pub(super) fn is_prismatic(&self) -> bool {
        self.hinge.is_prismatic
    }

    /// Steps (i): the main body's motion, then (2.3.48)-(2.3.57) outwards.
    pub(super) fn set_motion(bodies: &mut [Self], motion: &TreeMotion) {
        let base = &mut bodies[0];
        base.R_WB = motion.R_WB.to_rotation_matrix();
        base.velocity = Twist::new(
            base.R_WB * motion.V_WB_B.angular,
            base.R_WB * motion.V_WB_B.linear,
        );
        let hinges = motion.q.iter().zip(motion.qd);
        for (k, (&q, &qd)) in (1..).zip(hinges) {
            let (inward, rest) = bodies.split_at_mut(k);
            let body = &mut rest[0];
            let inner = body.inner.expect("only the main body has no inner body");
            body.set_motion_from(&inward[inner], q, qd);
        }
    }

    fn set_motion_from(&mut self, inner: &Self, q: f64, qd: f64) {
        let Hinge {
            is_prismatic,
            X_PJ,
            axis_J,
        } = &self.hinge;
        let R_WJ = inner.R_WB * X_PJ.rotation;
        self.z = R_WJ * axis_J.as_ref();
        self.d = inner.R_WB * X_PJ.translation.vector;
        if *is_prismatic {
            self.R_WB = R_WJ;
            self.d += self.z * q;
        } else {
            self.R_WB = R_WJ * UnitQuaternion::from_axis_angle(axis_J, q).to_rotation_matrix();
        }
        self.p = inner.p + self.d;
        let w = inner.velocity.angular;
        self.velocity = inner.velocity;
        self.velocity.linear += w.cross(&self.d);
        self.bias = inner.bias;
        self.bias.linear += inner.bias.angular.cross(&self.d) + w.cross(&w.cross(&self.d));
        if *is_prismatic {
            self.velocity.linear += self.z * qd;
            self.bias.linear += w.cross(&self.z) * (2.0 * qd);
        } else {
            self.velocity.angular += self.z * qd;
            self.bias.angular += w.cross(&self.z) * qd;
        }
    }

    /// Step (ii): the outer sets, (2.3.58)-(2.3.64) inwards. `wrenches` act on the bodies, about their hinges in
    /// their axes.
    pub(super) fn set_outer_sets(bodies: &mut [Self], wrenches: &[Wrench]) {
        for (body, wrench) in bodies.iter_mut().zip(wrenches) {
            body.start_outer_set(wrench);
        }
        for k in (1..bodies.len()).rev() {
            let (inward, rest) = bodies.split_at_mut(k);
            let body = &mut rest[0];
            body.set_unit_momentum();
            inward[body.inner.expect("only the main body has no inner body")].add_outer_set(body);
        }
    }

    /// Initializes the outer set with the body alone: its inertial force and torque (2.3.11), (2.3.12).
    fn start_outer_set(&mut self, wrench: &Wrench) {
        let R = self.R_WB.matrix();
        let r = R * self.com_B;
        let inertia = R * self.inertia_B * R.transpose();
        let (w, a, alpha) = (
            &self.velocity.angular,
            &self.bias.linear,
            &self.bias.angular,
        );
        self.mass_hat = self.mass;
        self.moment_hat = r * self.mass;
        self.inertia_hat = inertia;
        let a_com = a + alpha.cross(&r) + w.cross(&w.cross(&r));
        let torque = inertia * alpha + w.cross(&(inertia * w)) + self.moment_hat.cross(a);
        self.force_hat = Wrench {
            torque: R * wrench.torque - torque,
            force: R * wrench.force - a_com * self.mass,
        };
    }

    fn add_outer_set(&mut self, outer: &Self) {
        let (d, s) = (&outer.d, &outer.moment_hat);
        let sd = s * d.transpose();
        self.mass_hat += outer.mass_hat;
        self.moment_hat += s + d * outer.mass_hat;
        self.inertia_hat += outer.inertia_hat
            + point_inertia(outer.mass_hat, d)
            + Matrix3::from_diagonal_element(2.0 * s.dot(d))
            - sd
            - sd.transpose();
        self.force_hat.force += outer.force_hat.force;
        self.force_hat.torque += outer.force_hat.torque + d.cross(&outer.force_hat.force);
    }

    fn set_unit_momentum(&mut self) {
        let (z, s) = (&self.z, &self.moment_hat);
        self.unit_momentum = if self.hinge.is_prismatic {
            Wrench::new(s.cross(z), z * self.mass_hat)
        } else {
            Wrench::new(self.inertia_hat * z, z.cross(s))
        };
    }

    /// Inertia of the outer set about a point at `from_hinge` from the hinge, which is either zero or the set's centre of
    /// mass.
    pub(super) fn inertia_hat_about(&self, from_hinge: &Vector3<f64>) -> Matrix3<f64> {
        self.inertia_hat - point_inertia(self.mass_hat, from_hinge)
    }
}

impl Hinge {
    fn new(joint: &Joint) -> Self {
        Self {
            is_prismatic: !joint.kind.is_rotational(),
            X_PJ: joint.X_PJ,
            axis_J: joint.axis,
        }
    }

    /// Unused hinge of the main body, which floats.
    fn none() -> Self {
        Self {
            is_prismatic: false,
            X_PJ: Pose::identity(),
            axis_J: Vector3::z_axis(),
        }
    }
}

/// `m (r·r U - r r)`.
fn point_inertia(mass: f64, r: &Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::from_diagonal_element(r.norm_squared()) - r * r.transpose()) * mass
}
