//! The parameter `law`, and the parameters common to all laws.

use super::{LARGEST_GAIN, PerJoint, SMALLEST_GAIN};
use crate::{
    control::{ControllerConfig, Gains, JacobianKind, LawConfig, LawKind, Saturation},
    nodes::choice,
    ros::{Declare, Param},
};

pub(super) const PER_JOINT: &[PerJoint] = &[PerJoint {
    name: "k_v",
    law: None,
}];

/// Chooses the law by the parameters that are given.
const AUTO: &str = "auto";

#[derive(Debug)]
pub(super) struct Shared {
    law: Param<String>,
    jacobian: Param<String>,
    k_p: Param<f64>,
    k_o: Param<f64>,
    k_v: Param<Vec<f64>>,
    e_p_max: Param<f64>,
    e_o_max: Param<f64>,
    bumpless_transfer_time: Param<f64>,
}

impl Shared {
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let laws = format!("{AUTO}, {}", choice::list(&LawKind::NAMES));
        let law = declare
            .param(
                "law",
                AUTO,
                &format!(
                    "Control law: {laws}; {AUTO} is computed_torque, or transpose_jacobian if k_v is given"
                ),
            )
            .check(&format!("one of {laws}"), |text| match text.as_str() {
                AUTO => Ok(()),
                text => choice::find(&LawKind::NAMES, text).map(|_| ()),
            })
            .live();
        let jacobian = choice::declare(
            declare,
            "jacobian",
            &JacobianKind::NAMES,
            "Jacobian of transpose_jacobian and straight_path",
        )
        .live();
        let mut number = |name: &str, default: f64, least: f64, text: &str| {
            declare
                .param(name, default, text)
                .range(least, LARGEST_GAIN)
                .live()
        };
        let k_p = number(
            "k_p",
            75.0,
            SMALLEST_GAIN,
            "Gain on the position error [N/m]; computed if k_v is empty",
        );
        let k_o = number(
            "k_o",
            100.0,
            0.0,
            "Gain on the orientation error; 0 leaves the attitude of the tip free; computed if k_v is empty [N m]",
        );
        let e_p_max = number(
            "e_p_max",
            0.2,
            SMALLEST_GAIN,
            "Position error beyond which the force is constant [m]",
        );
        let e_o_max = number(
            "e_o_max",
            0.1,
            SMALLEST_GAIN,
            "Orientation error beyond which the torque is constant",
        );
        let bumpless_transfer_time = declare
            .param(
                "bumpless_transfer_time",
                0.5,
                "Time constant of the bumpless transfer after a change of settings; 0: the efforts jump [s]",
            )
            .range(0.0, 1e3)
            .live();
        let k_v = declare
            .param(
                "k_v",
                Vec::<f64>::new(),
                "Gains on the joint rates, one per joint [N m s/rad or N s/m]; empty: k_v, k_p and k_o are computed from the robot's inertia and sample_period",
            )
            .range(SMALLEST_GAIN, LARGEST_GAIN)
            .live();
        Self {
            law,
            jacobian,
            k_p,
            k_o,
            k_v,
            e_p_max,
            e_o_max,
            bumpless_transfer_time,
        }
    }

    /// The revision of the node's parameters, which changes whenever one is set.
    pub(super) fn revision(&self) -> u64 {
        self.law.revision()
    }

    /// The configuration, with defaults for the settings of the individual laws.
    pub(super) fn config(&self) -> ControllerConfig {
        // Any other text has been refused by the declaration.
        let default = match self.k_v.get().is_empty() {
            true => LawKind::ComputedTorque,
            false => LawKind::TransposeJacobian,
        };
        let law = choice::find(&LawKind::NAMES, &self.law.get()).unwrap_or(default);
        let gains = Gains {
            k_p: self.k_p.get(),
            k_o: self.k_o.get(),
            k_v: self.k_v.get(),
            saturation: Saturation {
                position: self.e_p_max.get(),
                orientation: self.e_o_max.get(),
            },
        };
        let jacobian = choice::find(&JacobianKind::NAMES, &self.jacobian.get())
            .unwrap_or(JacobianKind::Generalized);
        let mut law = LawConfig::from(law);
        match &mut law {
            LawConfig::TransposeJacobian(law) => law.jacobian = jacobian,
            LawConfig::StraightPath(law) => law.jacobian = jacobian,
            LawConfig::JointPd(_)
            | LawConfig::OperationalSpace(_)
            | LawConfig::ComputedTorque(_)
            | LawConfig::Custom => {}
        }
        ControllerConfig {
            bumpless_transfer_time: self.bumpless_transfer_time.get(),
            ..ControllerConfig::new(law, gains)
        }
    }
}
