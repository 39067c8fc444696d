//! From the last camera frame to the present.

use nalgebra::Vector3;

use super::{BaseMotion, GoalMotion, GoalMotionConfig, Moment};
use crate::spatial::{Pose, Twist};

/// What is done about the age of what the camera has seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Prediction {
    /// Nothing: tip and goal are taken to be where they were seen.
    #[default]
    None,
    /// Tip and base are carried on to the present; the goal is taken to stand still.
    Latency,
    /// The goal is carried on too, with the motion that the frames tell, and its velocity is fed forward.
    Motion,
}

impl Prediction {
    /// All by name.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("none", Self::None),
        ("latency", Self::Latency),
        ("motion", Self::Motion),
    ];
}

/// Tip and goal at the present, in the base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Predicted {
    /// Tip pose.
    pub X_BE: Pose,
    /// Goal pose.
    pub X_BD: Pose,
    /// Twist of the goal in I, its origin's velocity beside the system's centre of mass; base axes.
    pub V_ID_B: Twist,
    /// Its rate of change in I, base axes.
    pub A_ID_B: Twist,
}

impl Predicted {
    /// Tip and goal as they were seen, the goal at rest.
    pub fn as_seen(X_BE: Pose, X_BD: Pose) -> Self {
        Self {
            X_BE,
            X_BD,
            V_ID_B: Twist::ZERO,
            A_ID_B: Twist::ZERO,
        }
    }
}

/// Time over which differences between camera and encoders are averaged \[s\]: they are errors of the kinematics,
/// which last.
const AVERAGED: f64 = 10.0;

/// Carries what the camera has seen on to the present.
#[derive(Debug, Clone)]
pub struct Predictor {
    base: BaseMotion,
    goal: GoalMotion,
    last: Option<Seen>,
}

/// The last camera frame.
#[derive(Debug, Clone, Copy)]
struct Seen {
    time: f64,
    X_ID: Pose,
    /// What the camera saw of the tip beside what the encoders told: an error of the kinematics, in the tip's axes.
    X_EE: Pose,
    /// Frames so far.
    count: f64,
}

impl Predictor {
    /// Nothing is known yet.
    pub fn new(config: GoalMotionConfig) -> Self {
        Self {
            base: BaseMotion::default(),
            goal: GoalMotion::new(config),
            last: None,
        }
    }

    /// Changes what is known of goals and sensor, from now on.
    pub fn set_config(&mut self, config: GoalMotionConfig) {
        self.goal.set_config(config);
    }

    /// Goes on to the present: see [`BaseMotion::advance`].
    pub fn advance(&mut self, time: f64, w_IB_B: &Vector3<f64>, p_BC: &Vector3<f64>, X_BE: &Pose) {
        if self.base.advance(time, w_IB_B, p_BC, X_BE) {
            // What was known was told in another frame I.
            self.goal.clear();
            self.last = None;
        }
    }

    /// Takes in a camera frame that was exposed at `time` \[s\]. Frames must come in the order of time; one from
    /// before the first joint state is dropped.
    pub fn see(&mut self, time: f64, X_BE: &Pose, X_BD: &Pose) {
        if self.last.is_some_and(|last| time <= last.time) {
            return;
        }
        let Some(then) = self.base.at(time) else {
            return;
        };
        let X_ID = then.X_IB() * X_BD;
        let mut X_EE = then.X_BE.inverse() * X_BE;
        let mut count = 1.0;
        if let Some(last) = &self.last {
            count += last.count;
            let part = 1.0 - (-(time - last.time) / AVERAGED).exp();
            X_EE = last.X_EE.lerp_slerp(&X_EE, part.max(1.0 / count));
        }
        self.goal.see(time, &X_ID);
        self.last = Some(Seen {
            time,
            X_ID,
            X_EE,
            count,
        });
    }

    /// Takes in the goal's angular velocity `w_ID_B` \[rad/s\] at `time` \[s\], in base axes of that time, as
    /// somebody else has estimated it.
    pub fn see_rate(&mut self, time: f64, w_ID_B: &Vector3<f64>) {
        if let Some(then) = self.base.at(time) {
            self.goal.see_rate(time, &(then.R_IB * w_ID_B));
        }
    }

    /// How the robot is now.
    pub fn present(&self) -> Option<&Moment> {
        self.base.now()
    }

    /// Tip and goal at the present, the goal at rest beside the system's centre of mass or moving as it was seen
    /// to. `None` before a frame has come.
    pub fn now(&self, prediction: Prediction) -> Option<Predicted> {
        let (now, seen) = (self.base.now()?, self.last.as_ref()?);
        let X_BI = now.X_IB().inverse();
        let X_BE = now.X_BE * seen.X_EE;
        if prediction != Prediction::Motion {
            return Some(Predicted::as_seen(X_BE, X_BI * seen.X_ID));
        }
        let goal = self.goal.at(now.time)?;
        let in_base = |t: &Twist| Twist::new(X_BI.rotation * t.angular, X_BI.rotation * t.linear);
        Some(Predicted {
            X_BE,
            X_BD: X_BI * goal.X_ID,
            V_ID_B: in_base(&goal.V_ID_I),
            A_ID_B: in_base(&goal.A_ID_I),
        })
    }
}
