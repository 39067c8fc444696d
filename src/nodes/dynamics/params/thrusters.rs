//! Parameters of thrusters.

use super::numbers::{direction, not_negative, positive};
use crate::{dynamics::flexible::Thruster, nodes::placement::declare_vector, ros::Declare};

/// Parameters of a thruster.
#[derive(Debug, Clone)]
pub struct ThrusterParams {
    /// Link that carries it; empty is the root link.
    pub link: String,
    /// The thruster.
    pub thruster: Thruster,
}

impl ThrusterParams {
    /// Declares the parameters of the thruster called `name`, and reads them.
    pub(super) fn declare(declare: &mut Declare, name: &str) -> Self {
        let key = |parameter: &str| format!("{name}.{parameter}");
        let link = declare
            .param(
                &key("link"),
                "",
                "Link that carries the thruster; empty is the root link",
            )
            .read_only()
            .value();
        let thruster = Thruster {
            name: name.to_owned(),
            position: declare_vector(
                declare,
                &key("position"),
                "Where the thruster's force acts, in its link's frame [m]",
            ),
            direction: direction(
                declare,
                &key("direction"),
                "Direction of the force on the robot, opposite to the exhaust, in the link's frame",
            ),
            thrust: positive(
                declare,
                &key("thrust"),
                "Force while the thruster is on [N]",
            ),
            min_on_time: not_negative(
                declare,
                &key("min_on_time"),
                0.0,
                "Shortest time that the thruster's valve is open [s]",
            ),
        };
        Self { link, thruster }
    }
}
