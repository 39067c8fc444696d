//! Two computers on a network that loses and delays: network namespaces, and a relay between them.

use std::{
    io::{BufRead, BufReader, Write},
    process::{Child, Command, Stdio},
};

use crate::{namespace::Namespace, peer::python};

/// Two network namespaces, and the relay that connects them with loss and delay.
pub struct Wire {
    pub ends: [Namespace; 2],
    relay: Child,
}

impl Wire {
    /// With names for the namespaces, a loss from 0 to 1 and a delay in each direction \[s\]. `None` where network
    /// interfaces cannot be created; the reason is printed.
    pub fn new(names: [&str; 2], loss: f64, delay: f64) -> Option<Self> {
        Self::with(names, &[loss.to_string(), delay.to_string()])
    }

    /// As [`Self::new`], without loss and delay, but multicast does not arrive.
    pub fn without_multicast(names: [&str; 2]) -> Option<Self> {
        Self::with(names, &["0", "0", "unicast"].map(str::to_owned))
    }

    fn with(names: [&str; 2], arguments: &[String]) -> Option<Self> {
        let ends = [Namespace::new(names[0])?, Namespace::new(names[1])?];
        let id = std::process::id();
        // At most 15 characters.
        let taps = names.map(|name| format!("{}{id}", &name[..name.len().min(7)]));
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/lossy_wire.py");
        let mut relay = Command::new(python())
            .arg(script)
            .args(&taps)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("python can be started");
        let mut line = String::new();
        let said =
            BufReader::new(relay.stdout.as_mut().expect("stdout is piped")).read_line(&mut line);
        let wire = Self { ends, relay };
        if said.is_err() || line.trim() != "ready" {
            // /dev/net/tun is missing in many containers, even for root.
            println!("skipped: no TAP interface can be made here");
            return None;
        }
        for (i, (tap, end)) in taps.iter().zip(&wire.ends).enumerate() {
            let moved = Command::new("ip")
                .args(["link", "set", tap, "netns", &end.0])
                .status();
            assert!(moved.expect("ip is there").success());
            let address = format!("10.98.0.{}/24", i + 1);
            for args in [
                &["addr", "add", &address, "dev", tap][..],
                &["link", "set", tap, "up", "multicast", "on"],
            ] {
                end.ip(args).expect("the interface takes it");
            }
        }
        Some(wire)
    }

    /// Changes loss and delay; a loss of 1 interrupts the network.
    pub fn set(&mut self, loss: f64, delay: f64) {
        let stdin = self.relay.stdin.as_mut().expect("stdin is piped");
        writeln!(stdin, "{loss} {delay}").expect("the relay runs");
    }
}

impl Drop for Wire {
    fn drop(&mut self) {
        let _ = self.relay.kill();
        let _ = self.relay.wait();
    }
}
