//! The final state of a simulation, as `fuyu simulate --json` prints it.

use std::collections::BTreeMap;

use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;

use crate::{
    dynamics::{State, flexible::FlexibleFloating},
    nodes::dynamics::{FreeBody, World},
};

/// State of robot and targets. SI units; poses and velocities in the world and its axes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FinalState {
    /// Simulated time \[s\].
    pub time: f64,
    /// Position of the base frame's origin \[m\].
    pub base_position: [f64; 3],
    /// Attitude of the base: x, y, z, w.
    pub base_orientation: [f64; 4],
    /// Velocity of the base frame's origin \[m/s\].
    pub base_velocity: [f64; 3],
    /// Angular velocity of the base \[rad/s\].
    pub base_angular_velocity: [f64; 3],
    /// Joint positions by name \[rad or m\].
    pub q: BTreeMap<String, f64>,
    /// Joint rates by name \[rad/s or m/s\].
    pub qd: BTreeMap<String, f64>,
    /// The other free bodies by name.
    pub targets: BTreeMap<String, FinalTarget>,
    /// The robot's deformable bodies by name.
    pub appendages: BTreeMap<String, FinalAppendage>,
    /// The robot's wheels by name.
    pub wheels: BTreeMap<String, FinalWheel>,
    /// Motors of elastic joints by joint.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub motors: BTreeMap<String, FinalMotor>,
    /// Total momentum of all bodies in the world.
    pub momentum: FinalMomentum,
    /// Total kinetic energy of all bodies in the world \[J\].
    pub kinetic_energy: f64,
    /// Strain energy of deformable bodies and elastic joints \[J\].
    pub strain_energy: f64,
    /// Energy of contacts; `None` without contact.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact: Option<FinalContact>,
}

/// Energy of contacts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FinalContact {
    /// Number of contact points.
    pub points: usize,
    /// Elastic energy that they store \[J\].
    pub stored_energy: f64,
    /// Energy that contacts have dissipated since the start \[J\].
    pub dissipated_energy: f64,
}

/// State of a target's root frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FinalTarget {
    /// Position of the origin \[m\].
    pub position: [f64; 3],
    /// Attitude: x, y, z, w.
    pub orientation: [f64; 4],
    /// Velocity of the origin \[m/s\].
    pub velocity: [f64; 3],
    /// Angular velocity \[rad/s\].
    pub angular_velocity: [f64; 3],
}

/// Modal coordinates of a deformable body.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FinalAppendage {
    /// Modal coordinates \[kg^1/2 m\].
    pub mu: Vec<f64>,
    /// Their rates \[kg^1/2 m/s\].
    pub mud: Vec<f64>,
}

/// State of a wheel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FinalWheel {
    /// Speed relative to the link that carries it \[rad/s\].
    pub speed: f64,
}

/// State of the motor of an elastic joint, on the output side of the gear.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FinalMotor {
    /// Angle \[rad\].
    pub position: f64,
    /// Rate \[rad/s\].
    pub velocity: f64,
}

/// Momentum of a system of bodies.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FinalMomentum {
    /// Linear \[N s\].
    pub linear: [f64; 3],
    /// Angular, about the common centre of mass \[N m s\].
    pub angular: [f64; 3],
}

impl FinalState {
    /// The current state of `world`.
    pub fn of(world: &World) -> Self {
        let robot = &world.robot;
        let base = frame_of(robot);
        let state = robot.state();
        let by_name = |values: &[f64]| {
            let names = robot.model().joints().iter().map(|j| j.name.clone());
            names.zip(values.iter().copied()).collect()
        };
        let targets = world.targets.iter();
        let mut of_parts = Parts::default();
        if let Some(flexible) = robot.flexible() {
            of_parts = Parts::of(flexible);
        }
        let kinetic = world
            .targets
            .iter()
            .map(|t| t.body.workspace().kinetic_energy());
        Self {
            time: world.time(),
            base_position: base.position,
            base_orientation: base.orientation,
            base_velocity: base.velocity,
            base_angular_velocity: base.angular_velocity,
            q: by_name(state.q.as_slice()),
            qd: by_name(state.qd.as_slice()),
            targets: targets
                .map(|t| (t.name.clone(), frame_of(&t.body)))
                .collect(),
            appendages: of_parts.appendages,
            wheels: of_parts.wheels,
            motors: of_parts.motors,
            momentum: momentum(world),
            kinetic_energy: kinetic.fold(robot.kinetic_energy(), |sum, own| sum + own),
            strain_energy: robot.strain_energy(),
            contact: world
                .contact_energy()
                .map(|(stored, dissipated)| FinalContact {
                    points: world.contact_points().count(),
                    stored_energy: stored,
                    dissipated_energy: dissipated,
                }),
        }
    }
}

/// States of the flexible parts of a robot.
#[derive(Default)]
struct Parts {
    appendages: BTreeMap<String, FinalAppendage>,
    wheels: BTreeMap<String, FinalWheel>,
    motors: BTreeMap<String, FinalMotor>,
}

impl Parts {
    fn of(robot: &FlexibleFloating) -> Self {
        let (system, state) = (robot.system(), robot.state());
        let appendages = system.modal_bodies().iter().map(|body| {
            let of_body = FinalAppendage {
                mu: state.mu()[body.range()].to_vec(),
                mud: state.mu_dot()[body.range()].to_vec(),
            };
            (body.name().to_owned(), of_body)
        });
        let wheels = system.wheels().iter().zip(state.wheel_speeds());
        let joints = system.elastic_joints().iter();
        let motors = joints.zip(state.motor_angles().iter().zip(state.motor_rates()));
        Self {
            appendages: appendages.collect(),
            wheels: wheels
                .map(|(wheel, speed)| (wheel.name.clone(), FinalWheel { speed: *speed }))
                .collect(),
            motors: motors
                .map(|(joint, (position, velocity))| {
                    let motor = FinalMotor {
                        position: *position,
                        velocity: *velocity,
                    };
                    (joint.joint.clone(), motor)
                })
                .collect(),
        }
    }
}

/// Pose and velocity of a body's root frame.
fn frame_of(body: &impl FreeBody) -> FinalTarget {
    let (X_WB, V_WB_B) = (body.X_WB(), body.V_WB_B());
    let R_WB: UnitQuaternion<f64> = body.state().R_WB;
    let q = R_WB.coords;
    FinalTarget {
        position: X_WB.translation.vector.into(),
        orientation: [q.x, q.y, q.z, q.w],
        velocity: (R_WB * V_WB_B.linear).into(),
        angular_velocity: (R_WB * V_WB_B.angular).into(),
    }
}

/// Momentum of robot and targets about their common centre of mass.
fn momentum(world: &World) -> FinalMomentum {
    let masses = world.targets.iter().map(|t| t.body.model().total_mass());
    let states = world.targets.iter().map(|t| t.body.state());
    let bodies: Vec<(f64, &State)> =
        std::iter::once((world.robot.total_mass(), world.robot.state()))
            .chain(masses.zip(states))
            .collect();
    let mass: f64 = bodies.iter().map(|(mass, _)| mass).sum();
    let moments = bodies.iter().map(|(mass, state)| state.p_WC * *mass);
    let p_WC = moments.sum::<Vector3<f64>>() / mass;
    let linear: Vector3<f64> = bodies.iter().map(|(_, s)| s.momentum_W.linear).sum();
    let angular: Vector3<f64> = (bodies.iter())
        .map(|(_, s)| s.momentum_W.angular + (s.p_WC - p_WC).cross(&s.momentum_W.linear))
        .sum();
    FinalMomentum {
        linear: linear.into(),
        angular: angular.into(),
    }
}
