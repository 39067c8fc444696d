//! Network namespaces, for tests that need a separate network.

use std::{fs, os::unix::fs::MetadataExt, process::Command};

/// In continuous integration, as root, network namespaces must work: a skipped test would go unnoticed there.
pub fn must_work() -> bool {
    std::env::var_os("CI").is_some() && fs::metadata("/proc/self").is_ok_and(|me| me.uid() == 0)
}

/// A network namespace, by its name for `ip`, that is deleted when dropped.
pub struct Namespace(pub String);

impl Namespace {
    /// With loopback up; `None`, and the reason printed, where that is not permitted.
    pub fn new(name: &str) -> Option<Self> {
        let namespace = Self(format!("fuyu-{name}-{}", std::process::id()));
        let made = ip(&["netns", "add", &namespace.0]);
        let up = made.and_then(|()| namespace.ip(&["link", "set", "lo", "up", "multicast", "on"]));
        match up {
            Ok(()) => Some(namespace),
            Err(e) => {
                assert!(!must_work(), "network namespaces cannot be made here: {e}");
                println!("skipped: network namespaces cannot be made here: {e}");
                None
            }
        }
    }

    /// Runs `ip` inside.
    pub fn ip(&self, args: &[&str]) -> Result<(), String> {
        ip(&[&["-n", &self.0], args].concat())
    }

    /// A command that runs `program` inside.
    pub fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.0]).arg(program);
        command
    }

    /// Adds one end of a pair of virtual wires, with an address; the other end has no place to go.
    pub fn add_wire(&self, address: &str) -> Result<(), String> {
        for args in [
            &[
                "link", "add", "wire0", "type", "veth", "peer", "name", "wire1",
            ][..],
            &["addr", "add", address, "dev", "wire0"],
            &["link", "set", "wire1", "up"],
            &["link", "set", "wire0", "up", "multicast", "on"],
        ] {
            self.ip(args)?;
        }
        Ok(())
    }

    /// How many packets an interface inside has sent.
    pub fn sent_packets(&self, interface: &str) -> u64 {
        let path = format!("/sys/class/net/{interface}/statistics/tx_packets");
        let output = self.command("cat").arg(path).output().expect("ip is there");
        let text = String::from_utf8_lossy(&output.stdout);
        text.trim().parse().expect("a number")
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        let _ = ip(&["netns", "del", &self.0]);
    }
}

fn ip(args: &[&str]) -> Result<(), String> {
    let output = Command::new("ip")
        .args(args)
        .output()
        .map_err(|e| e.to_string())?;
    match output.status.success() {
        true => Ok(()),
        false => Err(String::from_utf8_lossy(&output.stderr).trim().to_owned()),
    }
}
