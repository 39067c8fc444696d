//! The robot's own motion from gyro and encoders.

use nalgebra::{DVector, UnitQuaternion, Vector3};

use crate::control::prediction::BaseMotion;
use crate::dynamics::{Momentum, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::{Pose, Twist};

/// The robot's motion in I, the frame at the system's centre of mass with fixed axes: those of the base at the first
/// sample. I is inertial while no external force acts.
#[derive(Debug, Clone)]
pub struct OwnMotion {
    workspace: Workspace,
    tip: Frame,
    history: BaseMotion,
    state: State,
    w_IB_B: Vector3<f64>,
}

impl OwnMotion {
    /// The motion before the first sample.
    pub fn new(model: &Model, tip: &Frame) -> Self {
        Self {
            workspace: Workspace::new(model),
            tip: tip.clone(),
            history: BaseMotion::default(),
            state: State::at_rest(model),
            w_IB_B: Vector3::zeros(),
        }
    }

    /// Adds a sample: time \[s\], joint positions and rates from the encoders, angular velocity of the base from the
    /// gyro (base axes, \[rad/s\]). Returns whether I was redefined, because time went back or had a gap.
    ///
    /// # Panics
    /// If `q` and `qd` do not fit the robot.
    pub fn add(&mut self, time: f64, q: &[f64], qd: &[f64], w_IB_B: &Vector3<f64>) -> bool {
        self.state.time = time;
        self.state.q.as_mut_slice().copy_from_slice(q);
        self.state.qd.as_mut_slice().copy_from_slice(qd);
        self.w_IB_B = *w_IB_B;
        self.workspace.set_positions(&self.state.q);
        let X_BE = self.workspace.X_BF(&self.tip);
        let p_BC = *self.workspace.p_BC();
        let is_new = self.history.advance(time, w_IB_B, &p_BC, &X_BE);
        let R_IB = self.history.last().map(|last| last.R_IB);
        let (q, qd) = (self.state.q.clone(), self.state.qd.clone());
        let R_IB = R_IB.unwrap_or_default();
        self.state = inertial_state(&mut self.workspace, time, (R_IB, w_IB_B), (&q, &qd));
        is_new
    }

    /// The state in I, with the momentum computed from gyro and encoders.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Angular velocity of the base from the gyro, base axes \[rad/s\].
    pub fn w_IB_B(&self) -> &Vector3<f64> {
        &self.w_IB_B
    }

    /// Pose of the tip in the base frame, from the encoders.
    pub fn X_BE(&self) -> Pose {
        self.workspace.X_BF(&self.tip)
    }

    /// Pose of the base in I at `time` \[s\]; `None` outside the last 20 s.
    pub fn X_IB_at(&self, time: f64) -> Option<Pose> {
        Some(self.history.at(time)?.X_IB())
    }

    /// Pose of the tip in the base frame at `time` \[s\]; `None` outside the last 20 s.
    pub fn X_BE_at(&self, time: f64) -> Option<Pose> {
        Some(self.history.at(time)?.X_BE)
    }
}

/// State in I of the tree of `workspace` (the robot, or the robot with its payload), from the base's attitude and
/// angular velocity (base axes) and joint positions and rates. Its centre of mass is at rest at the origin.
pub fn inertial_state(
    workspace: &mut Workspace,
    time: f64,
    (R_IB, w_IB_B): (UnitQuaternion<f64>, &Vector3<f64>),
    (q, qd): (&DVector<f64>, &DVector<f64>),
) -> State {
    workspace.set_positions(q);
    let momentum_B = workspace.momentum_of(&Twist::new(*w_IB_B, Vector3::zeros()), qd);
    let mut state = State::at_rest(workspace.model());
    state.time = time;
    state.R_WB = R_IB;
    state.p_WC = Vector3::zeros();
    state.momentum_W = Momentum {
        linear: Vector3::zeros(),
        angular: R_IB * momentum_B.angular,
    };
    state.q.copy_from(q);
    state.qd.copy_from(qd);
    state
}
