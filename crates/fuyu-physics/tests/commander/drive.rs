//! The robot, driven as the dynamics node does it.

use fuyu_physics::control::commander::{
    ArmMotion, BaseState, JointDuty, JointPoint, JointServo, JointTrajectory, KeptTip, TipFollower,
    TipResolver, Waypoint,
};
use fuyu_physics::dynamics::{Floating, IntegrationMethod, State};
use fuyu_physics::model::{Frame, Model};
use fuyu_physics::spatial::Pose;
use nalgebra::{DVector, UnitQuaternion};

/// Sampling period of the drives \[s\].
pub const PERIOD: f64 = 0.01;
/// A posture with a bent elbow \[rad\].
pub const POSTURE: [f64; 7] = [0.3, 0.6, -0.2, 1.4, 0.2, 0.9, 0.1];

pub fn model() -> Model {
    let xml = include_str!("../../../../urdf/seven_joints.urdf");
    Model::from_urdf(xml, "seven_joints").unwrap()
}

pub fn tip(model: &Model) -> Frame {
    model.frame("tool0").unwrap().clone()
}

/// A robot at rest, and its drives.
pub struct Driven {
    pub robot: Floating,
    pub tip: Frame,
    servo: JointServo,
    pub reference: Vec<JointPoint>,
    pub time: f64,
}

impl Driven {
    pub fn at(q: &[f64]) -> Self {
        Self::with_momentum(q, [0.0; 3], [0.0; 3])
    }

    pub fn with_momentum(q: &[f64], linear: [f64; 3], angular: [f64; 3]) -> Self {
        let model = model();
        let mut state = State::at_rest_with(&model, &DVector::from_row_slice(q));
        state.momentum_W.linear = linear.into();
        state.momentum_W.angular = angular.into();
        let reference = q.iter().map(|&position| JointPoint {
            position,
            ..JointPoint::default()
        });
        Self {
            servo: JointServo::new(&model, 20.0),
            reference: reference.collect(),
            tip: tip(&model),
            robot: Floating::new(model, state, IntegrationMethod::Rk4),
            time: 0.0,
        }
    }

    pub fn model(&self) -> &Model {
        self.robot.model()
    }

    pub fn base(&self) -> BaseState {
        BaseState::of(self.robot.state(), self.robot.workspace())
    }

    pub fn follower(&self, kept: KeptTip, least_reaction: bool) -> TipFollower {
        let resolver = TipResolver::new(self.model(), &self.tip, kept, least_reaction);
        TipFollower::new(self.model(), resolver, &self.reference)
    }

    /// One sampling period of a motion.
    pub fn step(&mut self, motion: &mut ArmMotion) {
        let base = self.base();
        motion.advance(&base, self.time, PERIOD, &mut self.reference);
        let duties = vec![JointDuty::Track; self.model().dof()];
        let efforts = self
            .servo
            .efforts(self.robot.state(), &duties, &self.reference);
        let clamped = self.robot.hold_efforts(efforts.as_slice());
        assert!(!clamped);
        self.robot.step(PERIOD, 1);
        self.time += PERIOD;
    }

    /// Pose of the tip in the world.
    pub fn X_WE(&self) -> Pose {
        self.base().X_WB * self.X_BE()
    }

    /// Pose of the tip in the base frame.
    pub fn X_BE(&self) -> Pose {
        self.robot.workspace().X_BF(&self.tip)
    }

    /// Angle by which the base has turned since the start \[rad\].
    pub fn base_turn(&self) -> f64 {
        self.robot.state().R_WB.angle()
    }
}

/// Distance \[m\] and angle \[rad\] between two poses.
pub fn between(a: &Pose, b: &Pose) -> (f64, f64) {
    let distance = (a.translation.vector - b.translation.vector).norm();
    let turn = a.rotation.inverse() * b.rotation;
    (distance, UnitQuaternion::from(turn).angle())
}

/// A trajectory as MoveIt sends one: positions, velocities and accelerations at every 0.2 s on a smooth way from
/// [`POSTURE`], here a polynomial of degree 5 per joint.
pub fn moveit_trajectory(model: &Model, goal: &[f64], duration: f64) -> JointTrajectory {
    let names: Vec<String> = model.joints().iter().map(|j| j.name.clone()).collect();
    let count = (duration / 0.2).round() as usize;
    let waypoints = (0..=count).map(|i| {
        let s = i as f64 / count as f64;
        let of = |factor: f64| -> Vec<f64> {
            let ways = POSTURE.iter().zip(goal).map(|(a, b)| (b - a) * factor);
            ways.collect()
        };
        let way = of(s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s));
        Waypoint {
            time: duration * s,
            positions: POSTURE.iter().zip(way).map(|(a, way)| a + way).collect(),
            velocities: of(30.0 * (s * (1.0 - s)).powi(2) / duration),
            accelerations: of(60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / duration.powi(2)),
        }
    });
    JointTrajectory::new(model, &names, waypoints.collect()).unwrap()
}

/// Goal of [`moveit_trajectory`] in the tests \[rad\].
pub const GOAL: [f64; 7] = [-0.5, 0.9, 0.4, 1.0, -0.4, 1.2, 0.6];
