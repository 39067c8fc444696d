//! What happens when the tip rests away from its goal.

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
                "Joint rate of a kick out of a singular position; 0 never kicks [rad/s or m/s]",
            )
            .range(0.0, 1.0)
            .live();
        let delay = declare
            .param(
                "singularity_escape.delay",
                default.delay,
                "Time that the tip must have rested before a kick [s]",
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
