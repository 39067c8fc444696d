//! A robot over a WireGuard tunnel, as docs/security.md describes it. Needs `wireguard-go`, which works without the
//! kernel's WireGuard, and `wg` (Debian: wireguard-go, wireguard-tools).

use std::{
    fs,
    io::Write,
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::{
    two_computers::{START, Settings, TwoComputers},
    waiting::PATIENCE,
    wire::Wire,
};

/// The user-space ends of a tunnel; killed when dropped.
pub struct Tunnel([Child; 2]);

impl Drop for Tunnel {
    fn drop(&mut self) {
        for end in &mut self.0 {
            let _ = end.kill();
            let _ = end.wait();
        }
    }
}

/// What `wg` prints, given this input.
fn wg(arguments: &[&str], input: &str) -> String {
    let mut wg = Command::new("wg")
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("wg can be started");
    let mut stdin = wg.stdin.take().expect("stdin is piped");
    stdin.write_all(input.as_bytes()).expect("wg reads");
    drop(stdin);
    let output = wg.wait_with_output().expect("wg ends");
    assert!(output.status.success(), "wg {arguments:?}");
    String::from_utf8(output.stdout)
        .expect("text")
        .trim()
        .to_owned()
}

/// A tunnel with the addresses 10.44.0.1 and 10.44.0.2.
pub fn tunnel(wire: &Wire, folder: &Path) -> Tunnel {
    let names = ["wgn", "wgf"].map(|name| format!("{name}{}", std::process::id()));
    let ends = [0, 1].map(|i| {
        let mut command = wire.ends[i].command("env");
        command.args(["LOG_LEVEL=error", "wireguard-go", "-f", &names[i]]);
        let command = command.stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().expect("wireguard-go can be started")
    });
    let tunnel = Tunnel(ends);
    let keys = [0, 1].map(|_| wg(&["genkey"], ""));
    for (i, name) in names.iter().enumerate() {
        let key = folder.join(name);
        fs::write(&key, &keys[i]).expect("the key is written");
        let peer = 2 - i;
        let configure = || {
            let mut command = wire.ends[i].command("wg");
            command.args(["set", name, "private-key"]).arg(&key);
            command.args([
                "listen-port",
                "51820",
                "peer",
                &wg(&["pubkey"], &keys[1 - i]),
            ]);
            command.args(["allowed-ips", &format!("10.44.0.{peer}/32")]);
            command.args(["endpoint", &format!("10.98.0.{peer}:51820")]);
            let output = command.output().expect("wg can be started");
            match output.status.success() {
                true => Ok(()),
                false => Err(String::from_utf8_lossy(&output.stderr).into_owned()),
            }
        };
        let end = Instant::now() + PATIENCE;
        while let Err(problem) = configure() {
            assert!(Instant::now() < end, "no tunnel: {problem}");
            thread::sleep(Duration::from_millis(50));
        }
        for args in [
            &["addr", "add", &format!("10.44.0.{}/24", i + 1), "dev", name][..],
            &["link", "set", name, "up"],
        ] {
            wire.ends[i].ip(args).expect("the interface takes it");
        }
    }
    tunnel
}

/// Whether there can be a tunnel; if not, the reason is printed.
pub fn is_installed() -> bool {
    let is_there = |program| Command::new(program).arg("--version").output().is_ok();
    let is_installed = is_there("wireguard-go") && is_there("wg");
    if !is_installed {
        println!("skipped: wireguard-go or wg is not installed");
    }
    is_installed
}

// Fails if static peers are not contacted, or if the participants announce other addresses than those of the tunnel.
#[test]
fn a_robot_works_over_wireguard() {
    if !is_installed() {
        return;
    }
    let Some(wire) = Wire::without_multicast(["guard", "guardfar"]) else {
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let _tunnel = tunnel(&wire, folder.path());
    let local = "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST";
    let [near, far] = ["ROS_STATIC_PEERS=10.44.0.2", "ROS_STATIC_PEERS=10.44.0.1"];
    let settings = Settings {
        environment: [&[local, near], &[local, far]],
        ..Settings::default()
    };
    TwoComputers::start(wire, 120, settings).all_receive(0.0, START);
}
