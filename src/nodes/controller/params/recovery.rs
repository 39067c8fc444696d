//! What happens when the tip rests away from its goal.

use super::Group;
use crate::{
    control::{ControllerConfig, RecoveryConfig},
    ros::{Declare, Param},
};

#[derive(Debug)]
pub(super) struct Recovery {
    kick_rate: Param<f64>,
    patience: Param<f64>,
}

impl Recovery {
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let default = RecoveryConfig::default();
        let kick_rate = declare
            .param(
                "kick_rate",
                default.kick_rate,
                "Joint rate of a kick out of a singular position; 0 never kicks [rad/s or m/s]",
            )
            .range(0.0, 1.0)
            .live();
        let patience = declare
            .param(
                "patience",
                default.patience,
                "Time that the tip must have rested before a kick [s]",
            )
            .range(0.1, 1e6)
            .live();
        Self {
            kick_rate,
            patience,
        }
    }
}

impl Group for Recovery {
    fn write(&self, config: &mut ControllerConfig) {
        config.recovery = RecoveryConfig {
            kick_rate: self.kick_rate.get(),
            patience: self.patience.get(),
        };
    }
}
