//! What a controller makes of its measurements before a law sees them.

use nalgebra::Vector3;

use super::prediction::{GoalMotionConfig, Predicted, Prediction, Predictor};
use super::{Manipulator, Measurement, MovingGoal, PoseError, Present, TipMeasurement};
use crate::dynamics::Momentum;

/// Tips and goals at present. It listens whatever the prediction is, so that a change of it acts at once.
#[derive(Debug)]
pub(super) struct LatencyCompensation {
    /// One for each tip.
    predictors: Vec<Predictor>,
    goals: Vec<Option<Predicted>>,
    sight: Option<TipMeasurement>,
    w_IB_B: Vector3<f64>,
    /// Time of the last angular velocity of the goal that was taken in.
    rate_time: f64,
}

impl LatencyCompensation {
    pub fn new(arm: &Manipulator, config: GoalMotionConfig) -> Self {
        let tips = arm.tips().count();
        Self {
            predictors: vec![Predictor::new(config); tips],
            goals: vec![None; tips],
            sight: None,
            w_IB_B: Vector3::zeros(),
            rate_time: f64::NEG_INFINITY,
        }
    }

    pub fn set_config(&mut self, config: GoalMotionConfig) {
        for predictor in &mut self.predictors {
            predictor.set_config(config);
        }
    }

    /// Takes in what is measured, and finds out how tips and goals are now.
    pub fn look(&mut self, arm: &mut Manipulator, seen: &Measurement<'_>, prediction: Prediction) {
        let Manipulator {
            model,
            tip,
            more_tips,
            workspace,
        } = arm;
        workspace.set_positions(model, seen.q);
        self.w_IB_B = match seen.w_IB_B {
            Some(measured) => *measured,
            None => workspace.base_twist(&Momentum::default(), seen.qd).angular,
        };
        let rate = seen.goal_rate.filter(|rate| rate.time != self.rate_time);
        for (k, predictor) in self.predictors.iter_mut().enumerate() {
            let (tip, sight) = match k.checked_sub(1) {
                None => (&*tip, seen.tip),
                Some(k) => (
                    &more_tips[k],
                    seen.more_tips.get(k).and_then(Option::as_ref),
                ),
            };
            let X_BE = workspace.X_BF(tip);
            predictor.advance(seen.time, &self.w_IB_B, workspace.p_BC(), &X_BE);
            if let Some(TipMeasurement { time, X_BE, X_BD }) = sight {
                predictor.see(*time, X_BE, X_BD);
            }
            if let (Some(rate), 0) = (rate, k) {
                predictor.see_rate(rate.time, &rate.w_ID_B);
            }
            self.goals[k] = sight.map(|sight| {
                let as_seen = || Predicted::as_seen(sight.X_BE, sight.X_BD);
                match prediction {
                    Prediction::None => as_seen(),
                    _ => predictor.now(prediction).unwrap_or_else(as_seen),
                }
            });
        }
        self.rate_time = rate.map_or(self.rate_time, |rate| rate.time);
        self.sight = self.goals[0].map(|goal| TipMeasurement::new(seen.time, goal.X_BE, goal.X_BD));
    }

    /// The measurement as it would be if the camera were not late.
    pub fn at_present<'a>(&'a self, seen: &Measurement<'a>) -> Measurement<'a> {
        let present = self.predictors[0].present().map(|moment| Present {
            w_IB_B: &self.w_IB_B,
            R_IB: &moment.R_IB,
            goals: &self.goals,
        });
        Measurement {
            tip: self.sight.as_ref(),
            present,
            ..*seen
        }
    }

    /// Deviation of the second tip at present, if there is one and it is seen.
    pub fn second_error(&self) -> Option<PoseError> {
        let second = self.goals.get(1)?.as_ref()?;
        Some(PoseError::between(&second.X_BE, &second.X_BD))
    }

    /// How the first tip's goal moves.
    pub fn moving_goal<'a>(&'a self, seen: &Measurement<'a>) -> Option<MovingGoal<'a>> {
        let goal = self.goals[0].as_ref()?;
        Some(MovingGoal {
            q: seen.q,
            qd: seen.qd,
            w_IB_B: &self.w_IB_B,
            V_ID_B: &goal.V_ID_B,
            A_ID_B: &goal.A_ID_B,
        })
    }
}
