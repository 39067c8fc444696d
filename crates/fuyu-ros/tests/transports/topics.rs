//! Topics between two sessions.

use fuyu_ros::{
    msg::std_msgs,
    ros::{Qos, Time},
};
use std::{
    sync::{Arc, Mutex},
    time::Duration,
};

use crate::router::{Network, PATIENCE, eventually, idle};

fn text(data: impl ToString) -> std_msgs::String {
    std_msgs::String {
        data: data.to_string(),
    }
}

// Fails if messages were lost, repeated or reordered, or if a subscription did not learn from whom they are.
#[test]
fn messages_arrive_in_order_with_their_time_and_publisher() {
    Network::each(
        202,
        messages_arrive_in_order_with_their_time_and_publisher_over,
    );
}

fn messages_arrive_in_order_with_their_time_and_publisher_over(network: &Network) {
    let (mut one, mut two) = (network.process(0), network.process(0));
    let talker = one.start("talker", idle).expect("it starts");
    let listener = two.start("listener", idle).expect("it starts");
    let qos = Qos::RELIABLE.depth(200);
    let heard = listener.subscribe::<std_msgs::String>("chatter", qos);
    let heard = heard.expect("it subscribes");
    let said = talker.advertise::<std_msgs::String>("chatter", qos);
    let said = said.expect("it publishes");
    eventually("the subscription knows the publisher", || {
        listener
            .discovered_publishers()
            .iter()
            .any(|p| p.topic == "/chatter" && p.qos.reliability == qos.reliability)
    });
    eventually("the publisher knows the subscription", || {
        said.publish(&text("first"));
        heard.take().is_some()
    });
    while heard.wait_next(Duration::from_millis(200)).is_some() {}
    let (first, ..) = heard.counts();
    let before = Time::wall();
    for i in 0..100 {
        said.publish(&text(i));
    }
    for i in 0..100 {
        let message = heard.wait_next(PATIENCE).expect("it arrives");
        assert_eq!(message.message.data, i.to_string());
        let source = message.source_time.expect("its time is stated");
        assert!(before <= source && source <= message.received_time);
        assert_eq!(
            listener.node_of(message.publisher).as_deref(),
            Some("/talker")
        );
        assert!(heard.is_matched(message.publisher));
    }
    assert_eq!(heard.counts(), (first + 100, 0, 0));
    assert!(heard.wait_next(Duration::from_millis(100)).is_none());
    one.finish().expect("no failure");
    two.finish().expect("no failure");
}

// Fails if other domains heard each other, although they use one router.
#[test]
fn domains_are_separate() {
    Network::each(204, domains_are_separate_over);
}

fn domains_are_separate_over(network: &Network) {
    let (mut one, mut two) = (network.process(0), network.process(1));
    let talker = one.start("talker", idle).expect("it starts");
    let listener = two.start("listener", idle).expect("it starts");
    let heard = listener.subscribe::<std_msgs::String>("chatter", Qos::RELIABLE);
    let heard = heard.expect("it subscribes");
    let said = talker.advertise::<std_msgs::String>("chatter", Qos::RELIABLE);
    let said = said.expect("it publishes");
    for _ in 0..20 {
        said.publish(&text("nobody"));
        assert!(heard.wait_next(Duration::from_millis(20)).is_none());
    }
    let others = listener.discovered_publishers();
    assert!(others.is_empty(), "{others:?}");
}

// Fails if the cache of a publisher, or the query of a late subscription, does not keep to the depth.
#[test]
fn a_late_joiner_gets_what_is_latched() {
    Network::each(206, a_late_joiner_gets_what_is_latched_over);
}

fn a_late_joiner_gets_what_is_latched_over(network: &Network) {
    let (mut one, mut two) = (network.process(0), network.process(0));
    let talker = one.start("talker", idle).expect("it starts");
    let qos = Qos::LATCHED.depth(3);
    let said = talker.advertise::<std_msgs::String>("description", qos);
    let said = said.expect("it publishes");
    (0..10).for_each(|i| said.publish(&text(i)));
    let listener = two.start("listener", idle).expect("it starts");
    let late = listener.subscribe::<std_msgs::String>("description", qos);
    let late = late.expect("it subscribes");
    let next = || late.wait_next(PATIENCE).expect("it arrives").message.data;
    let mut kept = Vec::new();
    while kept.last().is_none_or(|last| last != "9") {
        kept.push(next());
    }
    // rustdds may give older ones before (docs/upstream.md).
    if network.is_zenoh() {
        assert_eq!(kept, ["7", "8", "9"]);
    }
    said.publish(&text("new"));
    assert_eq!(next(), "new");
    // Only what comes from now on.
    let volatile = listener.subscribe::<std_msgs::String>("description", Qos::RELIABLE);
    let volatile = volatile.expect("it subscribes");
    assert!(volatile.wait_next(Duration::from_millis(300)).is_none());
}

// Fails if a type that is known by name only is not received, or arrives with other bytes.
#[test]
fn bytes_of_a_type_that_is_known_by_name_only_arrive() {
    Network::each(208, bytes_of_a_type_that_is_known_by_name_only_arrive_over);
}

fn bytes_of_a_type_that_is_known_by_name_only_arrive_over(network: &Network) {
    let (mut one, mut two) = (network.process(0), network.process(0));
    let talker = one.start("talker", idle).expect("it starts");
    let listener = two.start("listener", idle).expect("it starts");
    let received = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&received);
    let handler = move |sample: fuyu_ros::ros::RawSample| {
        sink.lock().unwrap().push(sample.cdr);
    };
    let _raw = listener
        .subscribe_raw("strange", "acme_msgs/msg/Strange", Qos::RELIABLE, handler)
        .expect("it subscribes");
    let publisher = talker
        .advertise_raw("strange", "acme_msgs/msg/Strange", Qos::RELIABLE)
        .expect("it publishes");
    let length = if network.is_zenoh() { 900_000 } else { 30_000 };
    let message = [&[0, 1, 0, 0], vec![5; length].as_slice()].concat();
    eventually("the bytes arrive", || {
        publisher.publish(message.clone());
        !received.lock().unwrap().is_empty()
    });
    assert_eq!(received.lock().unwrap()[0], message);
}
