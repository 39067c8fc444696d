//! Parameters of elastic joints.

use super::numbers::{not_negative, positive};
use crate::{
    dynamics::flexible::{ElasticJoint, RotorModel},
    nodes::choice,
    ros::Declare,
};

const ROTOR_MODELS: [(&str, RotorModel); 2] =
    [("full", RotorModel::Full), ("reduced", RotorModel::Reduced)];

/// Declares and reads `joints.JOINT.*` for every joint for which at least one of them is given.
pub(super) fn declare_elastic_joints(declare: &mut Declare) -> Vec<ElasticJoint> {
    let names = declare.children("joints");
    let joints = names.into_iter().map(|joint| {
        let key = |parameter: &str| format!("joints.{joint}.{parameter}");
        let stiffness = positive(
            declare,
            &key("stiffness"),
            "Torque between motor and link per angle between them [N m/rad, N/m]",
        );
        let damping = not_negative(
            declare,
            &key("damping"),
            0.0,
            "Torque per rate of this angle [N m s/rad, N s/m]",
        );
        let rotor_inertia = positive(
            declare,
            &key("rotor_inertia"),
            "Moment of inertia of the motor's rotor about its axis, which the inertia of the parent link contains [kg m2]",
        );
        let gear_ratio = declare
            .param(
                &key("gear_ratio"),
                1.0,
                "Revolutions of the rotor for one of the joint",
            )
            .check("a number other than 0.0", |ratio: &f64| {
                match *ratio != 0.0 && ratio.is_finite() {
                    true => Ok(()),
                    false => Err(format!(
                        "{ratio} is wrong, expected a number other than 0.0"
                    )),
                }
            })
            .read_only()
            .value();
        let rotor = choice::declare(
            declare,
            &key("rotor_model"),
            &ROTOR_MODELS,
            "Whether the rotor also turns with the link that carries it",
        )
        .read_only()
        .value();
        ElasticJoint {
            stiffness,
            damping,
            rotor_inertia,
            gear_ratio,
            rotor: choice::find(&ROTOR_MODELS, &rotor).unwrap_or_default(),
            joint,
        }
    });
    joints.collect()
}
