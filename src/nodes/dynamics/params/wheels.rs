//! Parameters of reaction wheels.

use super::numbers::{direction, limit, not_negative, positive};
use crate::{dynamics::flexible::Wheel, ros::Declare};

/// Parameters of a reaction wheel.
#[derive(Debug, Clone)]
pub struct WheelParams {
    /// Link that carries it; empty is the root link.
    pub link: String,
    /// The wheel.
    pub wheel: Wheel,
    /// Initial speed relative to the link \[rad/s\].
    pub initial_speed: f64,
}

impl WheelParams {
    /// Declares the parameters of the wheel called `name`, and reads them.
    pub(super) fn declare(declare: &mut Declare, name: &str) -> Self {
        let key = |parameter: &str| format!("{name}.{parameter}");
        let link = declare
            .param(
                &key("link"),
                "",
                "Link that carries the wheel, whose inertia contains it; empty is the root link",
            )
            .read_only()
            .value();
        let axis = direction(
            declare,
            &key("axis"),
            "Axis of the wheel in its link's frame",
        );
        let wheel = Wheel {
            name: name.to_owned(),
            axis,
            inertia: positive(
                declare,
                &key("inertia"),
                "Moment of inertia of the wheel about its axis [kg m2]",
            ),
            max_torque: limit(
                declare,
                &key("max_torque"),
                "Largest torque of the wheel's motor [N m]",
            ),
            max_momentum: limit(
                declare,
                &key("max_momentum"),
                "Largest angular momentum of the wheel relative to its link [N m s]",
            ),
            max_speed: limit(
                declare,
                &key("max_speed"),
                "Largest speed of the wheel relative to its link [rad/s]",
            ),
            viscous_friction: not_negative(
                declare,
                &key("viscous_friction"),
                0.0,
                "Viscous friction of the wheel's bearing [N m s/rad]",
            ),
            coulomb_friction: not_negative(
                declare,
                &key("coulomb_friction"),
                0.0,
                "Coulomb friction of the wheel's bearing [N m]",
            ),
        };
        let most = wheel.speed_limit();
        let initial_speed = declare
            .param(
                &key("initial_speed"),
                0.0,
                "Speed of the wheel relative to its link at the start [rad/s]",
            )
            .check(
                "a number within the wheel's speed limits",
                move |speed: &f64| match speed.is_finite() && speed.abs() <= most {
                    true => Ok(()),
                    false => Err(format!(
                        "{speed} is out of range, expected {} to {most} rad/s",
                        -most
                    )),
                },
            )
            .read_only()
            .value();
        Self {
            link,
            wheel,
            initial_speed,
        }
    }
}
