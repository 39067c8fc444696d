//! The statements of `docs/security.md`.

use std::{fs, thread, time::Duration};

use crate::{
    binaries::binary,
    child::Running,
    namespace::{Namespace, must_work},
    waiting::{PATIENCE, eventually},
};

// Fails when `fuyu launch` sends on any other interface without being configured to.
#[test]
fn launch_sends_on_loopback_only() {
    let Some(namespace) = Namespace::new("quiet") else {
        return;
    };
    // Without IPv6 the interface is silent by itself.
    let quiet = namespace
        .command("sysctl")
        .args(["-qw", "net.ipv6.conf.all.disable_ipv6=1"])
        .status();
    let wire = match quiet {
        Ok(status) if status.success() => namespace.add_wire("10.96.0.1/24"),
        _ => Err("IPv6 cannot be switched off".to_owned()),
    };
    if let Err(e) = wire {
        assert!(!must_work(), "no silent second interface can be made: {e}");
        println!("skipped: no silent second interface can be made here: {e}");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/positioning.yaml");
    let launch = |range: &str| {
        let mut command = namespace.command(binary("fuyu"));
        command
            .args(["launch", config, "--duration", "600"])
            .current_dir(folder.path())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", range)
            .stdout(std::process::Stdio::null());
        // Empty is as if it were not there.
        Running::start(command, 17)
    };
    let before = namespace.sent_packets("wire0");
    let run = launch("");
    run.says("recording to");
    thread::sleep(Duration::from_secs(3));
    run.interrupt();
    assert_eq!(namespace.sent_packets("wire0") - before, 0);
    // Otherwise the zero would prove nothing.
    let run = launch("SUBNET");
    eventually("it sends when configured to", PATIENCE, || {
        (namespace.sent_packets("wire0") > before).then_some(())
    });
    run.interrupt();
}

/// Versions of which `docs/security.md` says that DDS Security is of no use.
const MEASURED: [(&str, &str); 2] = [("ros2-client", "0.12.1"), ("rustdds", "0.15.1")];

// Fails when the versions change: then try protection `ENCRYPT` again.
#[test]
fn the_stack_is_the_one_that_was_measured() {
    let lock = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.lock"));
    let lock = lock.expect("Cargo.lock");
    for (name, version) in MEASURED {
        let entry = format!("name = \"{name}\"\nversion = \"{version}\"");
        assert!(
            lock.contains(&entry),
            "{name} is not {version} any more: try whether DDS Security protects by now, and bring docs/security.md up to date"
        );
    }
}
