//! `LOCALHOST` sends on loopback only.

use serde_json::json;
use std::{thread, time::Duration};

use crate::{
    namespace::{Namespace, must_work},
    peer::{Peer, python},
    probe::Probe,
    waiting::{PATIENCE, eventually},
};

const TEXT: &str = "std_msgs/msg/String";

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
    // IPv6 sends packets on its own, so it is disabled on the interface.
    let quiet = namespace
        .command("sysctl")
        .args(["-qw", "net.ipv6.conf.all.disable_ipv6=1"])
        .status();
    if !quiet.is_ok_and(|s| s.success()) {
        assert!(!must_work(), "IPv6 cannot be switched off");
        println!("skipped: IPv6 cannot be switched off in a network namespace here");
        return;
    }
    if let Err(e) = namespace.add_wire("10.99.0.1/24") {
        assert!(!must_work(), "no second interface can be made: {e}");
        println!("skipped: no second interface can be made here: {e}");
        return;
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
            // Shows that the counters work: without traffic on loopback, zero on the others would prove nothing.
            eventually("it is heard", PATIENCE, || (sent() > 0).then_some(()));
        }
        sent()
    };
    assert_eq!(packets_of("LOCALHOST"), 0);
    assert_eq!(packets_of("OFF"), 0);
    // Checked last, because the kernel sends a report some time after a multicast group was left.
    packets_of("SUBNET");
}
