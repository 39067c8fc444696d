//! Parameters of joint PD control.

use super::{Group, LARGEST_GAIN, PerJoint, SMALLEST_GAIN};
use crate::{
    control::{ControllerConfig, LawConfig, LawKind},
    ros::{Declare, Param},
};

pub(super) const PER_JOINT: &[PerJoint] = &[PerJoint {
    name: "joint_k_p",
    law: Some(LawKind::JointPd),
}];

#[derive(Debug)]
pub(super) struct JointPd {
    k_p: Param<Vec<f64>>,
}

impl JointPd {
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let k_p = declare
            .param(
                "joint_k_p",
                Vec::<f64>::new(),
                "Gains on the joint positions for joint_pd, one per joint [N m/rad or N/m]; empty: computed",
            )
            .range(SMALLEST_GAIN, LARGEST_GAIN)
            .live();
        Self { k_p }
    }
}

impl Group for JointPd {
    fn write(&self, config: &mut ControllerConfig) {
        if let LawConfig::JointPd(law) = &mut config.law {
            law.k_p = self.k_p.get();
        }
    }
}
