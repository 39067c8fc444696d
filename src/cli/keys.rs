//! `fuyu keys`: keys and configurations for authenticated Zenoh.

use std::path::PathBuf;
use std::time::Duration;

use fuyu_ros::keys::{self, KeyError, KeyOptions};

use super::{Failure, print};

/// Create a certificate authority and Zenoh configurations for router, robot, controller, operator and viewer.
///
/// The router lets each role do only what it may. Every file contains a secret key, and only its owner may read it:
/// copy each to the computer that needs it, by a secure way. See docs/security.md.
#[derive(clap::Args)]
pub struct Args {
    /// Folder for the files; nothing that exists is overwritten
    folder: PathBuf,
    /// Host name or IP address of the router, as the other computers reach it
    #[arg(long, default_value = "localhost")]
    host: String,
    /// TCP port of the router
    #[arg(long, default_value_t = 7447)]
    port: u16,
    /// Days until the certificates end
    #[arg(long, default_value_t = 365)]
    days: u64,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let options = KeyOptions {
        host: args.host.clone(),
        port: args.port,
        validity: Duration::from_secs(args.days.saturating_mul(86_400)),
    };
    let files = keys::create(&args.folder, &options).map_err(|e| match e {
        KeyError::Certificate(_) => Failure::Runtime(e.to_string()),
        e => Failure::Input(e.to_string()),
    })?;
    let folder = args.folder.display();
    let mut text = String::new();
    for file in files {
        text.push_str(&format!("{}\n", file.display()));
    }
    text.push_str(&format!(
        "\nrouter:  fuyu router --config {folder}/router.json5\nothers:  export RMW_IMPLEMENTATION=rmw_zenoh_cpp \
         ZENOH_SESSION_CONFIG_URI={folder}/robot.json5\n"
    ));
    print(&text)
}
