//! Extrapolation from the last camera frame to the present.

use std::collections::VecDeque;

use nalgebra::Vector3;

use super::{BaseMotion, BaseState, GoalMotion, GoalMotionConfig};
use crate::spatial::{Pose, Twist};

/// Compensation of the age of the camera measurements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Prediction {
    /// No compensation: tip and goal are assumed to be where they were measured.
    #[default]
    None,
    /// The motion of tip and base since the exposure is added; the goal is assumed to be at rest.
    Latency,
    /// The motion of the goal, estimated from the frames, is added too, and its velocity is fed forward.
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

/// Tip and goal at the time of the joint state, in the base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipPrediction {
    /// Tip pose.
    pub X_BE: Pose,
    /// Goal pose.
    pub X_BD: Pose,
    /// Twist of the goal in I, with its origin's velocity relative to the system's centre of mass; base axes.
    pub V_ID_B: Twist,
    /// Rate of change of the goal's twist in I, base axes.
    pub A_ID_B: Twist,
}

impl TipPrediction {
    /// Tip and goal at their measured poses, the goal at rest.
    pub fn at_rest(X_BE: Pose, X_BD: Pose) -> Self {
        Self {
            X_BE,
            X_BD,
            V_ID_B: Twist::ZERO,
            A_ID_B: Twist::ZERO,
        }
    }
}

/// Time over which differences between camera and encoders are averaged \[s\]; they are constant errors of the
/// kinematics.
const AVERAGING_TIME: f64 = 10.0;

/// Largest number of frames that wait for evaluation: 10 s at 100 Hz, longer than the memory of the goal filter.
const MAX_WAITING: usize = 1000;

/// Extrapolates camera measurements of one tip and its goal to the present.
///
/// Frames are evaluated when a prediction is requested. Without requests they only wait, which costs little, and the
/// first prediction evaluates the frames of the last seconds.
#[derive(Debug, Clone)]
pub(in crate::control) struct Predictor {
    base: BaseMotion,
    goal: GoalMotion,
    last: Option<LastFrame>,
    /// Frames that have not been evaluated yet, oldest first.
    waiting: VecDeque<Frame>,
}

/// A camera frame.
#[derive(Debug, Clone, Copy)]
struct Frame {
    time: f64,
    X_BE: Pose,
    X_BD: Pose,
}

/// The last camera frame.
#[derive(Debug, Clone, Copy)]
struct LastFrame {
    time: f64,
    X_ID: Pose,
    /// Tip pose from the camera relative to that from the encoders, averaged: an error of the kinematics, in the tip's
    /// axes.
    X_EE: Pose,
    /// Number of frames so far.
    count: f64,
}

impl Predictor {
    /// A predictor without measurements.
    pub fn new(config: GoalMotionConfig) -> Self {
        Self {
            base: BaseMotion::default(),
            goal: GoalMotion::new(config),
            last: None,
            waiting: VecDeque::with_capacity(MAX_WAITING),
        }
    }

    /// Changes the noise of the sensor and the smoothness of the goal's motion from now on.
    pub fn set_config(&mut self, config: GoalMotionConfig) {
        self.evaluate_waiting();
        self.goal.set_config(config);
    }

    /// Adds the motion of the base up to the present: see [`BaseMotion::advance`].
    pub fn advance(&mut self, time: f64, w_IB_B: &Vector3<f64>, p_BC: &Vector3<f64>, X_BE: &Pose) {
        if self.base.advance(time, w_IB_B, p_BC, X_BE) {
            // The estimates refer to the old frame I.
            self.goal.clear();
            self.last = None;
            self.waiting.clear();
        }
    }

    /// Adds a camera frame that was exposed at `time` \[s\]. Frames must be in the order of time; a frame from before
    /// the first joint state is dropped.
    pub fn add_frame(&mut self, time: f64, X_BE: &Pose, X_BD: &Pose) {
        let waiting = self.waiting.back().map(|frame| frame.time);
        let last = waiting.or(self.last.map(|last| last.time));
        if last.is_some_and(|last| time <= last) {
            return;
        }
        if self.waiting.len() == MAX_WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back(Frame {
            time,
            X_BE: *X_BE,
            X_BD: *X_BD,
        });
    }

    fn evaluate_waiting(&mut self) {
        while let Some(frame) = self.waiting.pop_front() {
            self.evaluate(&frame);
        }
    }

    fn evaluate(&mut self, Frame { time, X_BE, X_BD }: &Frame) {
        let time = *time;
        let Some(then) = self.base.at(time) else {
            return;
        };
        let X_ID = then.X_IB() * X_BD;
        let mut X_EE = then.X_BE.inverse() * X_BE;
        let mut count = 1.0;
        if let Some(last) = &self.last {
            count += last.count;
            let weight = 1.0 - (-(time - last.time) / AVERAGING_TIME).exp();
            X_EE = last.X_EE.lerp_slerp(&X_EE, weight.max(1.0 / count));
        }
        self.goal.add_pose(time, &X_ID);
        self.last = Some(LastFrame {
            time,
            X_ID,
            X_EE,
            count,
        });
    }

    /// Adds the goal's angular velocity `w_ID_B` \[rad/s\] at `time` \[s\], in base axes of that time, from an
    /// external estimator.
    pub fn add_rate(&mut self, time: f64, w_ID_B: &Vector3<f64>) {
        self.evaluate_waiting();
        if let Some(then) = self.base.at(time) {
            self.goal.add_rate(time, &(then.R_IB * w_ID_B));
        }
    }

    /// State of the base at the present.
    pub fn base(&self) -> Option<&BaseState> {
        self.base.last()
    }

    /// Tip and goal at the present time; the goal is at rest relative to the system's centre of mass, or has its
    /// estimated motion. `None` before the first frame.
    pub fn predict(&mut self, prediction: Prediction) -> Option<TipPrediction> {
        self.evaluate_waiting();
        let (now, frame) = (self.base.last()?, self.last.as_ref()?);
        let X_BI = now.X_IB().inverse();
        let X_BE = now.X_BE * frame.X_EE;
        if prediction != Prediction::Motion {
            return Some(TipPrediction::at_rest(X_BE, X_BI * frame.X_ID));
        }
        let goal = self.goal.at(now.time)?;
        let in_base = |t: &Twist| Twist::new(X_BI.rotation * t.angular, X_BI.rotation * t.linear);
        Some(TipPrediction {
            X_BE,
            X_BD: X_BI * goal.X_ID,
            V_ID_B: in_base(&goal.V_ID_I),
            A_ID_B: in_base(&goal.A_ID_I),
        })
    }
}
