//! Loopback only means loopback only.

use serde_json::json;
use std::{fs, os::unix::fs::MetadataExt, process::Command, thread, time::Duration};

use crate::{
    peer::{Peer, python},
    probe::Probe,
    waiting::{PATIENCE, eventually},
};

const TEXT: &str = "std_msgs/msg/String";

/// In continuous integration root can make network namespaces, and a skipped test would go unseen.
fn must_work() -> bool {
    std::env::var_os("CI").is_some() && fs::metadata("/proc/self").is_ok_and(|me| me.uid() == 0)
}

/// A network namespace that is deleted when dropped.
struct Namespace(String);

impl Namespace {
    /// With loopback up; `None`, and the reason printed, where that is not permitted.
    fn new(name: &str) -> Option<Self> {
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

    fn ip(&self, args: &[&str]) -> Result<(), String> {
        ip(&[&["-n", &self.0], args].concat())
    }

    /// A command that runs `program` inside.
    fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.0]).arg(program);
        command
    }

    fn sent_packets(&self, interface: &str) -> u64 {
        let path = format!("/sys/class/net/{interface}/statistics/tx_packets");
        let output = self.command("cat").arg(path).output().unwrap();
        String::from_utf8_lossy(&output.stdout)
            .trim()
            .parse()
            .unwrap()
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

#[test]
fn works_where_there_is_only_loopback() {
    let Some(namespace) = Namespace::new("lo") else {
        return;
    };
    let domain = 51;
    let probe = namespace.command(Probe::executable());
    let _probe = Probe::start_with(probe, domain, &[]);
    let mut peer = Peer::start_with(namespace.command(python()), "peer", domain);
    peer.subscribe("chatter", TEXT, "reliable");
    peer.receive("chatter", 5);
    peer.subscribe("heard", TEXT, "reliable");
    let said = json!({"data": "here"});
    peer.does(json!({"do": "publish", "topic": "say", "type": TEXT, "message": said}));
    peer.receive("heard", 1);
}

#[test]
fn sends_nothing_elsewhere() {
    let Some(namespace) = Namespace::new("wire") else {
        return;
    };
    // Without IPv6 the interface is silent by itself.
    let quiet = namespace
        .command("sysctl")
        .args(["-qw", "net.ipv6.conf.all.disable_ipv6=1"])
        .status();
    if !quiet.is_ok_and(|s| s.success()) {
        assert!(!must_work(), "IPv6 cannot be switched off");
        println!("skipped: IPv6 cannot be switched off in a network namespace here");
        return;
    }
    for args in [
        &[
            "link", "add", "wire0", "type", "veth", "peer", "name", "wire1",
        ][..],
        &["addr", "add", "10.99.0.1/24", "dev", "wire0"],
        &["link", "set", "wire1", "up"],
        &["link", "set", "wire0", "up", "multicast", "on"],
    ] {
        if let Err(e) = namespace.ip(args) {
            assert!(!must_work(), "no second interface can be made: {e}");
            println!("skipped: no second interface can be made here: {e}");
            return;
        }
    }
    let packets_of = |range: &str| {
        let before = namespace.sent_packets("wire0");
        let mut command = namespace.command(Probe::executable());
        command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", range);
        let mut probe = Probe::start_with(command, 52, &[]);
        probe.runs();
        // It announces itself a tenth of a second after the start.
        thread::sleep(Duration::from_secs(3));
        let sent = || namespace.sent_packets("wire0") - before;
        if range == "SUBNET" {
            // Else the counts of the others would mean nothing.
            eventually("it is heard", PATIENCE, || (sent() > 0).then_some(()));
        }
        sent()
    };
    assert_eq!(packets_of("LOCALHOST"), 0);
    assert_eq!(packets_of("OFF"), 0);
    // Last: the kernel tells of multicast groups that were left some time later.
    packets_of("SUBNET");
}
