//! Two computers at the ends of a wire, each with a router if it needs one.

use std::{ffi::OsStr, path::PathBuf, process::Command};

use crate::{binaries::binary, child::Running, namespace::Namespace, wire::Wire};

/// What carries messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transport {
    Dds,
    Zenoh,
}

impl Transport {
    /// Both, in the order of tables.
    pub const BOTH: [Self; 2] = [Self::Dds, Self::Zenoh];

    /// A command that runs `program` in a namespace with this transport.
    pub fn command(self, namespace: &Namespace, program: impl AsRef<OsStr>) -> Command {
        let mut command: Command = namespace.command("env");
        command.args(match self {
            Self::Dds => &["ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET"][..],
            // Waits for its router.
            Self::Zenoh => &[
                "RMW_IMPLEMENTATION=rmw_zenoh_cpp",
                "ZENOH_ROUTER_CHECK_ATTEMPTS=0",
            ],
        });
        command.arg(program);
        // What `Running` would set otherwise; `env` has priority.
        command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET");
        command
    }

    /// A router in a namespace that knows these other ones, if the transport needs it.
    pub fn router(self, namespace: &Namespace, domain: u16, others: &[&str]) -> Option<Running> {
        (self == Self::Zenoh).then(|| router(namespace, domain, others))
    }
}

/// The router of fuyu, or the program that `ZENOHD` names.
fn router(namespace: &Namespace, domain: u16, others: &[&str]) -> Running {
    let other = std::env::var_os("ZENOHD").map(PathBuf::from);
    let mut command: Command = namespace.command(match &other {
        Some(zenohd) => zenohd.clone(),
        None => binary("fuyu").into(),
    });
    if other.is_none() {
        command.arg("router");
    }
    command.args(["--listen", "tcp/0.0.0.0:7447"]);
    for other in others {
        command.args(["--connect", other]);
    }
    Running::start(command, domain)
}

/// Two computers.
pub struct Network {
    pub wire: Wire,
    pub transport: Transport,
    pub domain: u16,
    /// Of the near and of the far computer.
    pub routers: Vec<Running>,
}

impl Network {
    /// At the ends of a wire. The far router connects to the near one at `address`.
    pub fn new(wire: Wire, transport: Transport, domain: u16, address: &str) -> Self {
        let near = transport.router(&wire.ends[0], domain, &[]);
        let address = format!("tcp/{address}:7447");
        let far = transport.router(&wire.ends[1], domain, &[&address]);
        Self {
            routers: near.into_iter().chain(far).collect(),
            wire,
            transport,
            domain,
        }
    }

    /// A command that runs `program` on the near (0) or far (1) computer.
    pub fn command(&self, end: usize, program: impl AsRef<OsStr>) -> Command {
        self.transport.command(&self.wire.ends[end], program)
    }
}
