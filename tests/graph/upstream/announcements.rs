//! What rustdds and ros2-client announce to the graph, and what they log.

use ros2_client::{Context, NodeName, NodeOptions};
use rustdds::{
    DomainParticipantStatusEvent as Event, EndpointDescription, QosPolicyBuilder, StatusEvented,
};
use std::{
    pin::pin,
    process::Command,
    task::{self, Waker},
};

use super::*;
use crate::peer::Peer;

/// What `observer` discovers of an endpoint of another participant.
fn described(observer: &DomainParticipant, topic: &str) -> EndpointDescription {
    let events = observer.status_listener();
    eventually("the endpoint is discovered", PATIENCE, || {
        match events.try_recv_status()? {
            Event::ReaderDetected { reader: found } | Event::WriterDetected { writer: found } => {
                (found.topic_name == topic).then_some(found)
            }
            _ => None,
        }
    })
}

#[test]
fn endpoints_cannot_be_announced_with_user_data() {
    let _claim = DomainClaim::new(69);
    let (here, observer) = (participant(69), participant(69));
    let _writer = writer(&here);
    // ROS puts the hash of the type there.
    assert_eq!(described(&observer, "bytes").user_data, [0; 0]);
    // Once user data can be set, type hashes can be announced.
    let policies = format!("{:?}", QosPolicyBuilder::new().build());
    assert!(!policies.contains("user_data"), "{policies}");
}

#[test]
fn user_data_is_reported_with_its_length_in_front() {
    let domain = 98;
    let observer = participant(domain);
    // A node of ROS has a writer of this topic, and states the hash of its type.
    let _peer = Peer::start("peer", domain);
    let user_data = described(&observer, "rt/rosout").user_data;
    let (length, text) = user_data.split_at(4);
    assert!(text.starts_with(b"typehash=RIHS01_"), "{user_data:?}");
    let length = u32::from_le_bytes(length.try_into().unwrap()) as usize;
    assert_eq!(text.len(), length.next_multiple_of(4));
}

#[test]
fn the_clock_of_ros2_client_has_a_wrong_type() {
    let _claim = DomainClaim::new(20);
    let (here, observer) = (participant(20), participant(20));
    let context = Context::from_domain_participant(here).unwrap();
    let name = NodeName::new("/", "timed").unwrap();
    let mut node = context.new_node(name, NodeOptions::new()).unwrap();
    let mut spin = pin!(node.spinner().unwrap().spin());
    let mut task = task::Context::from_waker(Waker::noop());
    // The first poll makes its endpoints.
    assert!(spin.as_mut().poll(&mut task).is_pending());
    let clock = described(&observer, "rt/clock");
    assert_eq!(clock.type_name, "builtin_interfaces::msg::dds_::Time_");
}

/// The process of the test below: a participant that comes, is discovered and goes.
#[test]
#[ignore = "started by another test"]
fn goer() {
    if std::env::var_os(VICTIM).is_none() {
        return;
    }
    tracing_subscriber::fmt()
        .with_max_level(tracing::Level::ERROR)
        .with_writer(std::io::stderr)
        .with_ansi(false)
        .init();
    let (here, there) = (participant(21), participant(21));
    let (writer, mut reader) = (writer(&here), reader(&there));
    connect(&writer, &mut reader);
    eprintln!("it ends");
}

#[test]
fn a_participant_that_ends_in_order_says_error() {
    let _claim = DomainClaim::new(21);
    let goer = Command::new(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "upstream::announcements::goer",
            "--ignored",
            "--nocapture",
        ])
        .env(VICTIM, "1")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&goer.stderr);
    assert!(goer.status.success(), "{said}");
    let (before, after) = said.split_once("it ends").expect("it ends");
    println!("{said}");
    assert!(!before.contains("ERROR"), "{before}");
    assert!(after.contains("ERROR"), "{said}");
}
