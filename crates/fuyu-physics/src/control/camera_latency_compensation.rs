//! Latency compensation: predicts tips and goals at the time of the joint state from older camera measurements.

use nalgebra::{UnitQuaternion, Vector3};

use super::prediction::{GoalMotionConfig, Prediction, Predictor, TipPrediction};
use super::{GoalRate, Manipulator, Measurement, MovingGoal, PoseError, TipMeasurement};
use crate::dynamics::Momentum;

/// Tips, goals and base at the time of the joint state. The predictors receive all measurements even if no prediction
/// is chosen, so that a later choice takes effect at once.
#[derive(Debug)]
pub(super) struct LatencyCompensation {
    /// One predictor for each tip.
    predictors: Vec<Predictor>,
    tips: Vec<Option<TipPrediction>>,
    w_IB_B: Vector3<f64>,
    R_IB: UnitQuaternion<f64>,
    /// Time of the last [`GoalRate`] that was used.
    rate_time: f64,
}

impl LatencyCompensation {
    pub fn new(manipulator: &Manipulator, config: GoalMotionConfig) -> Self {
        let tips = manipulator.tips().count();
        Self {
            predictors: (0..tips).map(|_| Predictor::new(config)).collect(),
            tips: vec![None; tips],
            w_IB_B: Vector3::zeros(),
            R_IB: UnitQuaternion::identity(),
            rate_time: f64::NEG_INFINITY,
        }
    }

    pub fn set_config(&mut self, config: GoalMotionConfig) {
        for predictor in &mut self.predictors {
            predictor.set_config(config);
        }
    }

    /// Adds a measurement and computes tips, goals and base at its time. Sets the positions of the workspace.
    pub fn update(
        &mut self,
        manipulator: &mut Manipulator,
        measurement: &Measurement<'_>,
        prediction: Prediction,
    ) {
        let Manipulator {
            tip,
            more_tips,
            workspace,
            ..
        } = manipulator;
        workspace.set_positions(measurement.q);
        self.w_IB_B = match measurement.w_IB_B {
            Some(measured) => *measured,
            None => {
                let motion = workspace.base_twist(&Momentum::default(), measurement.qd);
                motion.angular
            }
        };
        let new = |rate: &&GoalRate| rate.time != self.rate_time;
        let rate = measurement.goal_rate.filter(new);
        for (k, predictor) in self.predictors.iter_mut().enumerate() {
            let (tip, measured) = match k.checked_sub(1) {
                None => (&*tip, measurement.tip),
                Some(k) => (
                    &more_tips[k],
                    measurement.more_tips.get(k).and_then(Option::as_ref),
                ),
            };
            let X_BE = workspace.X_BF(tip);
            predictor.advance(measurement.time, &self.w_IB_B, workspace.p_BC(), &X_BE);
            if let Some(TipMeasurement { time, X_BE, X_BD }) = measured {
                predictor.add_frame(*time, X_BE, X_BD);
            }
            if let (Some(rate), 0) = (rate, k) {
                predictor.add_rate(rate.time, &rate.w_ID_B);
            }
            self.tips[k] = measured.map(|measured| {
                let at_rest = || TipPrediction::at_rest(measured.X_BE, measured.X_BD);
                match prediction {
                    Prediction::None => at_rest(),
                    _ => predictor.predict(prediction).unwrap_or_else(at_rest),
                }
            });
        }
        self.rate_time = rate.map_or(self.rate_time, |rate| rate.time);
        if let Some(sample) = self.predictors[0].base() {
            self.R_IB = sample.R_IB;
        }
    }

    /// Tip and goal of each arm; `None` without a camera measurement.
    pub fn tips(&self) -> &[Option<TipPrediction>] {
        &self.tips
    }

    /// Angular velocity of the base, base axes \[rad/s\].
    pub fn w_IB_B(&self) -> &Vector3<f64> {
        &self.w_IB_B
    }

    /// Attitude of the base in I.
    pub fn R_IB(&self) -> &UnitQuaternion<f64> {
        &self.R_IB
    }

    /// Deviation of the second tip, if there is one with a camera measurement.
    pub fn second_error(&self) -> Option<PoseError> {
        let second = self.tips.get(1)?.as_ref()?;
        Some(PoseError::between(&second.X_BE, &second.X_BD))
    }

    /// Motion of the first tip's goal.
    pub fn moving_goal<'a>(&'a self, measurement: &Measurement<'a>) -> Option<MovingGoal<'a>> {
        let goal = self.tips[0].as_ref()?;
        Some(MovingGoal {
            q: measurement.q,
            qd: measurement.qd,
            w_IB_B: &self.w_IB_B,
            V_ID_B: &goal.V_ID_B,
            A_ID_B: &goal.A_ID_B,
        })
    }
}
