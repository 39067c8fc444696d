//! Roles: who may do what.

/// Holder of a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The robot: may do everything.
    Robot,
    /// Nodes that control the robot: may read everything, publish commands, estimates and reports, serve and call.
    Controller,
    /// A person who steers: may read everything, publish goals and inputs, and call services and actions.
    Operator,
    /// May read everything, and do nothing else.
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
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Robot, Self::Controller, Self::Operator, Self::Viewer];

    /// As files and certificates are named: `viewer`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Robot => "robot",
            Self::Controller => "controller",
            Self::Operator => "operator",
            Self::Viewer => "viewer",
        }
    }

    /// Names of topics that it may publish on, in any namespace; `None` for all.
    pub(super) fn topics(self) -> Option<Vec<&'static str>> {
        match self {
            Self::Robot => None,
            Self::Controller => Some([REPORTS.as_slice(), &CONTROL].concat()),
            Self::Operator => Some([REPORTS.as_slice(), &INPUTS].concat()),
            Self::Viewer => Some(Vec::new()),
        }
    }

    /// Whether it may call services and actions, and so set parameters.
    pub(super) fn may_call(self) -> bool {
        self != Self::Viewer
    }

    /// Whether it may offer services; every node with parameters does.
    pub(super) fn may_serve(self) -> bool {
        self != Self::Viewer
    }
}
