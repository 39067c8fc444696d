//! Parameters of computed-torque control.

use super::{Group, SMALLEST_GAIN};
use crate::{
    control::{ComputedTorqueConfig, ControllerConfig, LawConfig},
    ros::{Declare, Param},
};

#[derive(Debug)]
pub(super) struct ComputedTorque {
    frequency: Param<f64>,
    max_joint_rate: Param<f64>,
}

impl ComputedTorque {
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let usual = ComputedTorqueConfig::default();
        let mut number = |name: &str, default: f64, text: &str| {
            let parameter = declare.param(&format!("computed_torque.{name}"), default, text);
            parameter.range(SMALLEST_GAIN, 1e3).live()
        };
        Self {
            frequency: number(
                "frequency",
                usual.frequency,
                "Natural frequency of the joints' deviations from the trajectory [rad/s]",
            ),
            max_joint_rate: number(
                "max_joint_rate",
                usual.max_joint_rate,
                "Largest joint rate of the trajectory [rad/s; a third of it in m/s]",
            ),
        }
    }
}

impl Group for ComputedTorque {
    fn write(&self, config: &mut ControllerConfig) {
        if let LawConfig::ComputedTorque(law) = &mut config.law {
            *law = ComputedTorqueConfig {
                frequency: self.frequency.get(),
                max_joint_rate: self.max_joint_rate.get(),
            };
        }
    }
}
