//! Parameters of latency compensation and of the prediction of moving goals.

use super::{Group, LARGEST_GAIN, SMALLEST_GAIN};
use crate::{
    control::{
        ControllerConfig,
        prediction::{GoalMotionConfig, Prediction},
    },
    nodes::choice,
    ros::{Declare, Param},
};

#[derive(Debug)]
pub(super) struct Predictions {
    prediction: Param<String>,
    position_noise: Param<f64>,
    attitude_noise: Param<f64>,
    jerk: Param<f64>,
    angular_jerk: Param<f64>,
    rate_noise: Param<f64>,
}

impl Predictions {
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let text = "How the age of the camera measurements is compensated";
        let prediction = choice::declare(declare, "prediction", &Prediction::NAMES, text).live();
        let usual = GoalMotionConfig::default();
        let mut number = |name: &str, default: f64, least: f64, text: &str| {
            let parameter = declare.param(name, default, text);
            parameter.range(least, LARGEST_GAIN).live()
        };
        Self {
            prediction,
            position_noise: number(
                "goal_position_noise",
                usual.position_noise,
                SMALLEST_GAIN,
                "Standard deviation of each coordinate of a goal measured by the camera [m]",
            ),
            attitude_noise: number(
                "goal_attitude_noise",
                usual.attitude_noise,
                SMALLEST_GAIN,
                "Standard deviation of each component of its attitude [rad]",
            ),
            jerk: number(
                "goal_jerk",
                usual.jerk,
                SMALLEST_GAIN,
                "How fast the goal's acceleration may change [m/s^2.5]",
            ),
            angular_jerk: number(
                "goal_angular_jerk",
                usual.angular_jerk,
                SMALLEST_GAIN,
                "How fast the goal's angular acceleration may change [rad/s^2.5]",
            ),
            rate_noise: number(
                "goal_rate_noise",
                usual.rate_noise,
                0.0,
                "Standard deviation of estimator/angular_velocity; 0: it is not used [rad/s]",
            ),
        }
    }
}

impl Group for Predictions {
    fn write(&self, config: &mut ControllerConfig) {
        // Any other text has been refused by the declaration.
        config.prediction =
            choice::find(&Prediction::NAMES, &self.prediction.get()).unwrap_or_default();
        config.goal = GoalMotionConfig {
            position_noise: self.position_noise.get(),
            attitude_noise: self.attitude_noise.get(),
            jerk: self.jerk.get(),
            angular_jerk: self.angular_jerk.get(),
            rate_noise: self.rate_noise.get(),
        };
    }
}
