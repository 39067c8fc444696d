//! `fuyu router`: a Zenoh router.

use std::path::PathBuf;

use crate::ros::{NodeError, ZenohConfig, ZenohRouter};

use super::Failure;

/// Run a Zenoh router: each computer of a graph over Zenoh needs one.
///
/// It listens at port 7447 like the router of rmw_zenoh (ros2 run rmw_zenoh_cpp rmw_zenohd), reads the same variables
/// (ZENOH_ROUTER_CONFIG_URI, ZENOH_CONFIG_OVERRIDE), and warns of what a role may not do. See docs/zenoh.md.
#[derive(clap::Args)]
pub struct Args {
    /// Configuration file of Zenoh, such as the router.json5 of `fuyu keys`
    #[arg(short, long)]
    config: Option<PathBuf>,
    /// Where to listen, in place of tcp/[::]:7447
    #[arg(short, long, value_name = "ENDPOINT")]
    listen: Vec<String>,
    /// The router of another computer: tcp/192.168.1.2:7447
    #[arg(short = 'e', long, value_name = "ENDPOINT")]
    connect: Vec<String>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let mut config = match &args.config {
        None => ZenohConfig::router_from_env().map_err(|e| Failure::Input(e.to_string()))?,
        Some(path) => ZenohConfig::from_file(path)
            .map_err(|e| Failure::Input(format!("{}: {e}", path.display())))?,
    };
    for (name, key, endpoints) in [
        ("--listen", "listen/endpoints", &args.listen),
        ("--connect", "connect/endpoints", &args.connect),
    ] {
        if !endpoints.is_empty() {
            let set = config.with(key, &format!("{endpoints:?}"));
            config = set.map_err(|e| Failure::Input(format!("{name}: {e}")))?;
        }
    }
    ZenohRouter::run(&config).map_err(|e: NodeError| match e.exit_code() {
        2 => Failure::Input(e.to_string()),
        _ => Failure::Runtime(e.to_string()),
    })
}
