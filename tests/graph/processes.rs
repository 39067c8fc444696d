//! Several nodes in one process, without rclpy.

use fuyu::{
    msg::std_msgs::String as Text,
    ros::{DiscoveryRange, Domain, Node, NodeError, Process, Qos, RosArgs},
};
use std::{
    sync::mpsc,
    time::{Duration, Instant},
};

use crate::{lateness::repeat_if_late, waiting::PATIENCE};

fn process(domain: u16) -> Process {
    let range = DiscoveryRange::Localhost;
    Process::new(RosArgs::default(), Domain { id: domain, range })
}

fn text(data: impl ToString) -> Text {
    Text {
        data: data.to_string(),
    }
}

#[test]
fn nodes_of_one_process_talk_and_stop_last_first() {
    repeat_if_late(|| talk_and_stop(process(55)));
}

#[test]
fn isolated_nodes_of_one_process_talk_and_stop_last_first() {
    repeat_if_late(|| talk_and_stop(process(55).isolated()));
}

fn talk_and_stop(mut process: Process) {
    let (ended, order) = mpsc::channel();
    let (said, heard) = (ended.clone(), ended);
    let (latency, latencies) = mpsc::channel();
    process
        .start("listener", move |node: &Node| {
            let pings = node.subscribe::<Text>("ping", Qos::RELIABLE)?;
            let pongs = node.advertise::<Text>("pong", Qos::RELIABLE)?;
            while node.wait() {
                while let Some(ping) = pings.take() {
                    pongs.publish(&ping.message);
                }
            }
            heard
                .send("listener")
                .map_err(|e| NodeError::Failed(e.to_string()))
        })
        .unwrap();
    process
        .start("talker", move |node: &Node| {
            let pings = node.advertise::<Text>("ping", Qos::RELIABLE)?;
            let pongs = node.subscribe::<Text>("pong", Qos::RELIABLE)?;
            while node.ok() {
                let sent = Instant::now();
                pings.publish(&text(node.now()));
                if pongs.wait_next(Duration::from_millis(100)).is_some() {
                    let _ = latency.send(sent.elapsed());
                }
                node.sleep_until(node.now() + Duration::from_millis(2));
            }
            said.send("talker")
                .map_err(|e| NodeError::Failed(e.to_string()))
        })
        .unwrap();
    // A fraction of a millisecond on an idle computer; with polling, or a wait for a heartbeat, most round trips would take
    // 50 ms. So the limit applies to the median; the slowest round trip depends on the scheduler.
    let mut round_trips: Vec<_> = (0..500)
        .map(|_| latencies.recv_timeout(PATIENCE).unwrap())
        .collect();
    round_trips.sort();
    let (median, most) = (round_trips[250], round_trips[495]);
    println!("median round trip {median:?}, 99 % within {most:?}");
    assert!(median < Duration::from_millis(15), "{median:?}");
    assert!(process.run_for(Duration::ZERO), "no node has ended");
    process.finish().unwrap();
    assert_eq!(order.iter().collect::<Vec<_>>(), ["talker", "listener"]);
}

#[test]
fn a_failing_node_ends_the_process_with_its_error() {
    let mut process = process(56);
    process
        .start("steady", |node: &Node| {
            while node.wait() {}
            Ok(())
        })
        .unwrap();
    process
        .start("broken", |_: &Node| {
            Err(NodeError::Input("no such robot".into()))
        })
        .unwrap();
    let error = process.wait().unwrap_err();
    assert_eq!(
        (error.to_string().as_str(), error.exit_code()),
        ("no such robot", 2)
    );
}

// Fails if the node continues without its handler.
#[test]
fn a_handlers_panic_is_a_failure_too() {
    let mut process = process(61);
    process
        .start("touchy", |node: &Node| {
            let _said = node.subscribe_raw("say", "std_msgs/msg/String", Qos::RELIABLE, |_| {
                panic!("on purpose")
            })?;
            while node.wait() {}
            Ok(())
        })
        .unwrap();
    process
        .start("talker", |node: &Node| {
            let say = node.advertise::<Text>("say", Qos::RELIABLE)?;
            while node.wait_for(Duration::from_millis(50)) {
                say.publish(&text("now"));
            }
            Ok(())
        })
        .unwrap();
    let error = process.wait().unwrap_err();
    assert_eq!(error.to_string(), "node /touchy: a handler has panicked");
}

#[test]
fn a_panic_is_a_failure_not_a_hang() {
    let mut process = process(57);
    process
        .start("shaky", |_: &Node| panic!("on purpose"))
        .unwrap();
    let error = process.wait().unwrap_err();
    assert_eq!(error.to_string(), "node /shaky: program panicked");
    assert_eq!(error.exit_code(), 1);
}
