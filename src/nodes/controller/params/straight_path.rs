//! Parameters of the straight-path law.

use super::{Group, LARGEST_GAIN};
use crate::{
    control::{ControllerConfig, LawConfig, Shaping, StraightPathConfig},
    nodes::choice,
    ros::{Declare, Param},
};

#[derive(Debug)]
pub(super) struct StraightPath {
    shaping: Param<String>,
    k_r: Param<f64>,
    psi_max: Param<f64>,
    d_along: Param<f64>,
    d_across: Param<f64>,
    d_turn: Param<f64>,
    joint_damping_fraction: Param<f64>,
    period: Param<f64>,
}

impl StraightPath {
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let default = StraightPathConfig::default();
        let shaping = choice::declare(
            declare,
            "straight_path.shaping",
            &Shaping::NAMES,
            "How straight_path keeps the path straight",
        )
        .live();
        let mut number = |name: &str, default: f64, most: f64, text: &str| {
            let name = format!("straight_path.{name}");
            declare.param(&name, default, text).range(0.0, most).live()
        };
        Self {
            shaping,
            k_r: number("k_r", default.k_r, 1e3, "Gain of the rotation of the force"),
            psi_max: number(
                "psi_max",
                default.psi_max,
                std::f64::consts::PI,
                "Largest rotation of the force [rad]",
            ),
            d_along: number(
                "d_along",
                default.d_along,
                LARGEST_GAIN,
                "Damping of the tip along the line to the goal [N s/m]",
            ),
            d_across: number(
                "d_across",
                default.d_across,
                LARGEST_GAIN,
                "Damping of the tip across the line [N s/m]",
            ),
            d_turn: number(
                "d_turn",
                default.d_turn,
                LARGEST_GAIN,
                "Damping of the angular velocity of the tip, where k_o is not 0 [N m s/rad]",
            ),
            joint_damping_fraction: declare
                .param(
                    "straight_path.joint_damping_fraction",
                    default.joint_damping_fraction,
                    "Fraction of k_v that remains on the joints while the tip is damped",
                )
                .range(1e-3, 1.0)
                .live(),
            period: declare
                .param(
                    "straight_path.period",
                    0.01,
                    "Time from one joint state to the next, which bounds the damping of the tip; 0: no bound [s]",
                )
                .range(0.0, 1.0)
                .live(),
        }
    }
}

impl Group for StraightPath {
    fn write(&self, config: &mut ControllerConfig) {
        let LawConfig::StraightPath(law) = &mut config.law else {
            return;
        };
        *law = StraightPathConfig {
            jacobian: law.jacobian,
            // Any other text has been refused by the declaration.
            shaping: choice::find(&Shaping::NAMES, &self.shaping.get())
                .unwrap_or(Shaping::Rotation),
            k_r: self.k_r.get(),
            psi_max: self.psi_max.get(),
            d_along: self.d_along.get(),
            d_across: self.d_across.get(),
            d_turn: self.d_turn.get(),
            joint_damping_fraction: self.joint_damping_fraction.get(),
            period: self.period.get(),
        };
    }
}
