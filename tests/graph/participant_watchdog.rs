//! A node survives a deadlock in its DDS participant (docs/upstream.md).

use fuyu::{
    msg::std_msgs::String as Text,
    ros::{DiscoveryRange, Domain, Node, NodeError, Process, Qos, RosArgs},
};
use std::{
    sync::mpsc,
    time::{Duration, Instant},
};

use crate::{
    peer::DomainClaim,
    upstream::deadlocks::{Crowd, TOPIC},
    waiting::{PATIENCE, eventually},
};

/// A subscription that takes longer than this was delayed by a deadlock; shorter than the node's timeout.
const LONG: Duration = Duration::from_millis(1500);

// Fails if a node blocks on a deadlocked participant when it creates its next endpoint or drops the participant.
#[test]
fn a_node_outlives_its_participant() {
    let domain = 25;
    let _claim = DomainClaim::new(domain);
    let mut crowd = Crowd::new(domain, "std_msgs::msg::dds_::String_");
    let range = DiscoveryRange::Localhost;
    let mut process = Process::new(RosArgs::default(), Domain { id: domain, range });
    let (sender, receiver) = mpsc::channel();
    process
        .start("subscriber", move |node: &Node| {
            // Created before the deadlock, so it must move to the next participant.
            let old = node.subscribe::<Text>(TOPIC, Qos::SENSOR_DATA)?;
            // Not the same as that of `old`, which would share its DDS reader.
            let qos = Qos {
                lifespan: Some(Duration::from_secs(100)),
                ..Qos::SENSOR_DATA
            };
            let start = Instant::now();
            let mut slowest = Duration::ZERO;
            while slowest < LONG && start.elapsed() < 3 * PATIENCE {
                let start = Instant::now();
                node.subscribe::<Text>(TOPIC, qos)?;
                slowest = slowest.max(start.elapsed());
            }
            let new = node.subscribe::<Text>(TOPIC, Qos::SENSOR_DATA)?;
            while old.take().is_some() || new.take().is_some() {}
            let failed = |e: mpsc::SendError<_>| NodeError::Failed(e.to_string());
            sender.send(slowest).map_err(failed)?;
            let (mut olds, mut news) = (0, 0);
            while node.ok() && (olds == 0 || news == 0) {
                node.wait();
                olds += usize::from(old.take().is_some());
                news += usize::from(new.take().is_some());
            }
            Ok(())
        })
        .unwrap();
    let slowest = receiver.recv_timeout(4 * PATIENCE).unwrap();
    println!("the slowest subscription took {slowest:?}");
    assert!(slowest > LONG, "there was no deadlock");
    crowd.calms_down();
    // A byte sequence has the same encoding as a string: its length, then the bytes.
    let hello = b"hello\0".to_vec();
    eventually("both subscriptions receive", PATIENCE, || {
        crowd.writers[0].write(hello.clone(), None).unwrap();
        (!process.run_for(Duration::from_millis(20))).then_some(())
    });
    process.finish().unwrap();
}
