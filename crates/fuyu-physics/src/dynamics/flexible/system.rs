//! A robot with flexible parts, wheels and thrusters: its checked description.

use std::sync::Arc;

use fuyu_structures::FirstOrderLimits;
use nalgebra::{Unit, Vector3};

use super::composite::Composite;
use super::{ElasticJoint, FlexibleBuilder, FlexibleState, ModalBody, Thruster, Wheel};
use crate::dynamics::JointPhysics;
use crate::model::Model;
use crate::spatial::{Pose, RigidInertia};

/// A robot with deformable bodies, elastic joints, reaction wheels and thrusters. Immutable; clones share one copy.
#[derive(Clone, Debug)]
pub struct FlexibleSystem {
    pub(super) parts: Arc<Parts>,
}

#[derive(Debug)]
pub(super) struct Parts {
    pub model: Model,
    pub modal_bodies: Vec<ModalBody>,
    pub joints: Vec<ElasticJoint>,
    pub wheels: Vec<Wheel>,
    pub thrusters: Vec<Thruster>,
    /// First-order limits of each deformable body without second-order terms.
    pub limits: Vec<Option<FirstOrderLimits>>,
    pub compiled: Compiled,
}

/// Precomputed data of the recursions.
#[derive(Debug)]
pub(super) struct Compiled {
    pub bodies: Vec<CompiledBody>,
    /// Rotors: those of motors with [`RotorModel::Full`](super::RotorModel::Full), then the wheels.
    pub rotors: Vec<Rotor>,
    /// For each joint the index of its elastic joint.
    pub elastic: Vec<Option<usize>>,
    /// For each elastic joint the index of its joint.
    pub joint_of: Vec<usize>,
    /// For each thruster the index of its body, and position and force in the body's frame.
    pub thrusters: Vec<(usize, Vector3<f64>, Vector3<f64>)>,
    pub modes: usize,
    pub mass: f64,
}

impl Compiled {
    /// The section that carries body `b`, if its parent is an elastic link.
    pub fn carrier(&self, b: usize) -> Option<usize> {
        self.bodies[self.bodies[b].parent].section
    }
}

/// A body and the joint that moves it.
#[derive(Debug)]
pub(super) struct CompiledBody {
    pub parent: usize,
    pub is_prismatic: bool,
    pub axis: Vector3<f64>,
    /// Pose of the joint frame in the frame that carries it: the parent's, or the section of an elastic link.
    pub X_PJ: Pose,
    /// Inertia without deformable bodies, about the body frame's origin; zero for an elastic link.
    pub rigid: Composite,
    /// The section that carries the following links, if this body is an elastic link.
    pub section: Option<usize>,
    /// The deformable bodies fixed to this body; for an elastic link, only the link itself.
    pub modal_bodies: Vec<usize>,
    pub rotors: Vec<usize>,
}

/// A rotor on a body. The body's inertia contains the locked rotor.
#[derive(Debug)]
pub(super) struct Rotor {
    pub body: usize,
    /// Axis in the body's axes.
    pub axis: Vector3<f64>,
    pub inertia: f64,
    /// Its index among motor angles and wheel angles, and its speed for a unit rate of that coordinate.
    pub coordinate: usize,
    pub ratio: f64,
}

impl Rotor {
    /// Angular momentum relative to its body, in the body's axes \[N m s\].
    pub fn momentum(&self, state: &FlexibleState) -> Vector3<f64> {
        self.axis * (self.inertia * self.spin(state))
    }

    /// Angular velocity relative to its body \[rad/s\].
    pub fn spin(&self, state: &FlexibleState) -> f64 {
        state.rotor_rates()[self.coordinate] * self.ratio
    }
}

impl FlexibleSystem {
    /// Starts with a robot without flexible parts.
    pub fn builder(model: &Model) -> FlexibleBuilder {
        FlexibleBuilder::new(model)
    }

    /// The robot. Bodies that are elastic links keep the rigid inertia of the description here.
    pub fn model(&self) -> &Model {
        &self.parts.model
    }

    /// Appendages in the order in which they were added, then elastic links.
    pub fn modal_bodies(&self) -> &[ModalBody] {
        &self.parts.modal_bodies
    }

    /// Number of modal coordinates.
    pub fn modes(&self) -> usize {
        self.parts.compiled.modes
    }

    /// The elastic joints.
    pub fn elastic_joints(&self) -> &[ElasticJoint] {
        &self.parts.joints
    }

    /// The reaction wheels.
    pub fn wheels(&self) -> &[Wheel] {
        &self.parts.wheels
    }

    /// Axis of wheel `i` in the axes of the body that carries it, and the index of that body.
    ///
    /// # Panics
    /// If there are fewer wheels.
    pub fn wheel_axis(&self, i: usize) -> (usize, Unit<Vector3<f64>>) {
        let rotor = &self.wheel_rotors()[i];
        (rotor.body, Unit::new_normalize(rotor.axis))
    }

    pub(super) fn wheel_rotors(&self) -> &[Rotor] {
        let rotors = &self.parts.compiled.rotors;
        &rotors[rotors.len() - self.parts.wheels.len()..]
    }

    /// The thrusters.
    pub fn thrusters(&self) -> &[Thruster] {
        &self.parts.thrusters
    }

    /// Index of the body that carries thruster `i`; in that body's frame the point of action \[m\] and the force \[N\].
    ///
    /// # Panics
    /// If there are fewer thrusters.
    pub fn thruster_force(&self, i: usize) -> (usize, Vector3<f64>, Vector3<f64>) {
        self.parts.compiled.thrusters[i]
    }

    /// Total mass \[kg\].
    pub fn total_mass(&self) -> f64 {
        self.parts.compiled.mass
    }

    /// Names of joints with Coulomb friction, stops or speed limits that `settings` enable but that are not simulated
    /// here. Springs and viscous damping are simulated.
    pub fn unsimulated_joints(&self, settings: &JointPhysics) -> impl Iterator<Item = &str> {
        let JointPhysics {
            friction,
            stops,
            velocity_limits,
            ..
        } = *settings;
        let joints = self.model().joints().iter();
        joints
            .filter(move |joint| {
                let limits = &joint.limits;
                (friction && joint.friction != 0.0)
                    || (stops && (limits.lower.is_finite() || limits.upper.is_finite()))
                    || (velocity_limits && limits.velocity.is_finite())
            })
            .map(|joint| &*joint.name)
    }

    /// The robot with its deformable bodies undeformed and locked: the inertia of each body includes the deformable
    /// bodies on it. Elastic links keep the inertia of the description.
    pub fn rigid_model(&self) -> Model {
        let mut model = self.model().clone();
        for (b, body) in self.compiled().bodies.iter().enumerate() {
            if body.section.is_none() && !body.modal_bodies.is_empty() {
                model = model.with_body_inertia(b, self.undeformed_inertia(b));
            }
        }
        model
    }

    /// Number of modal coordinates, motor angles and wheel angles together.
    pub(super) fn extras(&self) -> usize {
        self.modes() + self.elastic_joints().len() + self.wheels().len()
    }

    pub(super) fn compiled(&self) -> &Compiled {
        &self.parts.compiled
    }

    pub(super) fn limits(&self) -> &[Option<FirstOrderLimits>] {
        &self.parts.limits
    }

    /// Whether both are clones of the same system.
    pub(super) fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.parts, &other.parts)
    }

    /// Inertia of the undeformed robot's body `b`, including its appendages, in its frame.
    pub(super) fn undeformed_inertia(&self, b: usize) -> RigidInertia {
        let body = &self.compiled().bodies[b];
        let mut sum = body.rigid;
        for i in &body.modal_bodies {
            sum.add(&self.modal_bodies()[*i].integrals.rigid);
        }
        sum.rigid_inertia()
    }
}
