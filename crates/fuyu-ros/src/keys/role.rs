//! Roles: sets of permissions.

/// Role of the holder of a certificate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The robot: all permissions.
    Robot,
    /// Nodes that control the robot: read everything, publish commands, estimates and reports, offer and call services.
    Controller,
    /// A person who operates the robot: read everything, publish goals and inputs, call services and actions.
    Operator,
    /// Read everything, nothing else.
    Viewer,
}

/// Topics that every node publishes about itself.
const REPORTS: [&str; 3] = ["diagnostics", "rosout", "parameter_events"];
/// Topics that controllers publish. A `*` is one part of a name.
const CONTROL: [&str; 11] = [
    "joint_commands",
    "wheel_commands",
    "thruster_commands",
    "wrench",
    "camera/features",
    "controller/state",
    "controller/transition_event",
    "attitude/state",
    "attitude/transition_event",
    "mission/state",
    "estimator/*",
];
/// Topics that operators publish.
const INPUTS: [&str; 8] = [
    "joy",
    "cmd_vel",
    "goal_pose",
    "attitude_target",
    "joint_trajectory",
    "cartesian_path",
    "delta_twist_cmds",
    "wrench",
];

impl Role {
    /// All roles.
    pub const ALL: [Self; 4] = [Self::Robot, Self::Controller, Self::Operator, Self::Viewer];

    /// The name in file names and certificates: `viewer`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Robot => "robot",
            Self::Controller => "controller",
            Self::Operator => "operator",
            Self::Viewer => "viewer",
        }
    }

    /// Names of the topics that the role may publish, in any namespace; `None` for all topics.
    pub(super) fn topics(self) -> Option<Vec<&'static str>> {
        match self {
            Self::Robot => None,
            Self::Controller => Some([REPORTS.as_slice(), &CONTROL].concat()),
            Self::Operator => Some([REPORTS.as_slice(), &INPUTS].concat()),
            Self::Viewer => Some(Vec::new()),
        }
    }

    /// Whether the role may call services and actions, and thus set parameters.
    pub(super) fn may_call(self) -> bool {
        self != Self::Viewer
    }

    /// Whether the role may offer services, as every node with parameters does.
    pub(super) fn may_serve(self) -> bool {
        self != Self::Viewer
    }
}
