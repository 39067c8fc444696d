//! Parameters of the operational-space law.

use super::{Group, SMALLEST_GAIN};
use crate::{
    control::{BaseTask, ControllerConfig, OperationalConfig, TipTask},
    nodes::choice,
    ros::{Declare, Param},
};

#[derive(Debug)]
pub(super) struct Operational {
    frequency: Param<f64>,
    damping_ratio: Param<f64>,
    null_space_damping: Param<f64>,
    fastest: Param<f64>,
    task_damping: Param<f64>,
    tip: Param<String>,
    second_tip: Param<String>,
    base: Param<String>,
}

impl Operational {
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let usual = OperationalConfig::default();
        let mut number = |name: &str, default: f64, most: f64, text: &str| {
            let parameter = declare.param(&format!("operational_space.{name}"), default, text);
            parameter.range(SMALLEST_GAIN, most).live()
        };
        let frequency = number(
            "frequency",
            usual.frequency,
            1e3,
            "Natural frequency with which deviations die out [rad/s]",
        );
        let damping_ratio = number(
            "damping_ratio",
            usual.damping_ratio,
            1e3,
            "Damping ratio with which deviations die out",
        );
        let null_space_damping = number(
            "null_space_damping",
            usual.null_space_damping,
            1e3,
            "Decay rate of joint motion in the null space of all tasks [1/s]",
        );
        let fastest = number(
            "fastest",
            usual.fastest,
            1e3,
            "Largest joint rate, which no task may exceed [rad/s or m/s]",
        );
        let task_damping = number(
            "task_damping",
            usual.task_damping,
            1.0,
            "Singular value of a task's Jacobian below which its direction is damped",
        );
        let mut task = |name: &str, of: &str| {
            let text = format!("What the operational-space law controls of the {of}");
            choice::declare(declare, name, &TipTask::NAMES, &text).live()
        };
        let tip = task("tip_task", "tip");
        let second_tip = task("second_tip_task", "second tip");
        let text = "Whether the operational-space law keeps the base from turning";
        let base = choice::declare(declare, "base_task", &BaseTask::NAMES, text).live();
        Self {
            frequency,
            damping_ratio,
            null_space_damping,
            fastest,
            task_damping,
            tip,
            second_tip,
            base,
        }
    }
}

impl Group for Operational {
    fn write(&self, config: &mut ControllerConfig) {
        // Any other text has been refused by the declarations.
        let task =
            |name: &Param<String>| choice::find(&TipTask::NAMES, &name.get()).unwrap_or_default();
        config.operational = OperationalConfig {
            frequency: self.frequency.get(),
            damping_ratio: self.damping_ratio.get(),
            null_space_damping: self.null_space_damping.get(),
            fastest: self.fastest.get(),
            task_damping: self.task_damping.get(),
            tips: vec![task(&self.tip), task(&self.second_tip)],
            base: choice::find(&BaseTask::NAMES, &self.base.get()).unwrap_or_default(),
        };
    }
}
