//! Parameters of the escape from singular positions.

use super::Group;
use crate::{
    control::{ControllerConfig, SingularityEscapeConfig},
    ros::{Declare, Param},
};

#[derive(Debug)]
pub(super) struct SingularityEscape {
    rate: Param<f64>,
    delay: Param<f64>,
}

impl SingularityEscape {
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let default = SingularityEscapeConfig::default();
        let rate = declare
            .param(
                "singularity_escape.rate",
                default.rate,
                "Amplitude of the motion out of a singular position, as a joint rate; 0: none [rad/s or m/s]",
            )
            .range(0.0, 1.0)
            .live();
        let delay = declare
            .param(
                "singularity_escape.delay",
                default.delay,
                "Time that the arm must have rested before it [s]",
            )
            .range(0.1, 1e6)
            .live();
        Self { rate, delay }
    }
}

impl Group for SingularityEscape {
    fn write(&self, config: &mut ControllerConfig) {
        config.singularity_escape = SingularityEscapeConfig {
            rate: self.rate.get(),
            delay: self.delay.get(),
        };
    }
}
