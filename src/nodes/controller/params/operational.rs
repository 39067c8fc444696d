//! Parameters of the operational-space law.

use super::{Group, SMALLEST_GAIN};
use crate::{
    control::{BaseTask, ControllerConfig, LawConfig, OperationalSpaceConfig, TipTask},
    nodes::choice,
    ros::{Declare, Param},
};

#[derive(Debug)]
pub(super) struct Operational {
    frequency: Param<f64>,
    damping_ratio: Param<f64>,
    null_space_damping: Param<f64>,
    max_joint_rate: Param<f64>,
    task_damping: Param<f64>,
    tip: Param<String>,
    second_tip: Param<String>,
    base: Param<String>,
}

impl Operational {
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let usual = OperationalSpaceConfig::default();
        let mut number = |name: &str, default: f64, most: f64, text: &str| {
            let parameter = declare.param(&format!("operational_space.{name}"), default, text);
            parameter.range(SMALLEST_GAIN, most).live()
        };
        let frequency = number(
            "frequency",
            usual.frequency,
            1e3,
            "Natural frequency of the deviations [rad/s]",
        );
        let damping_ratio = number(
            "damping_ratio",
            usual.damping_ratio,
            1e3,
            "Damping ratio of the deviations",
        );
        let null_space_damping = number(
            "null_space_damping",
            usual.null_space_damping,
            1e3,
            "Rate at which joint motion decays that no task uses [1/s]",
        );
        let max_joint_rate = number(
            "max_joint_rate",
            usual.max_joint_rate,
            1e3,
            "Largest joint rate, also where tasks conflict [rad/s or m/s]",
        );
        let task_damping = number(
            "task_damping",
            usual.task_damping,
            1.0,
            "Singular value below which a task's directions are damped",
        );
        let mut task = |name: &str, of: &str| {
            let text =
                format!("Part of the pose of the {of} that the operational-space law controls");
            choice::declare(declare, name, &TipTask::NAMES, &text).live()
        };
        let tip = task("tip_task", "tip");
        let second_tip = task("second_tip_task", "second tip");
        let text = "Priority with which the operational-space law holds the attitude of the base";
        let base = choice::declare(declare, "base_task", &BaseTask::NAMES, text).live();
        Self {
            frequency,
            damping_ratio,
            null_space_damping,
            max_joint_rate,
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
        let LawConfig::OperationalSpace(law) = &mut config.law else {
            return;
        };
        *law = OperationalSpaceConfig {
            frequency: self.frequency.get(),
            damping_ratio: self.damping_ratio.get(),
            null_space_damping: self.null_space_damping.get(),
            max_joint_rate: self.max_joint_rate.get(),
            task_damping: self.task_damping.get(),
            tips: vec![task(&self.tip), task(&self.second_tip)],
            base: choice::find(&BaseTask::NAMES, &self.base.get()).unwrap_or_default(),
        };
    }
}
