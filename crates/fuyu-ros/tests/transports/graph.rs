//! What nodes know of the graph.

use fuyu_ros::{msg::std_msgs, ros::Qos};

use crate::router::{Network, Router, eventually, idle};

// Fails if a node that has left stays in the graph, or if one that is there is not found by a late one.
#[test]
fn publishers_come_and_go_with_their_nodes() {
    Network::each(218, publishers_come_and_go_with_their_nodes_over);
}

fn publishers_come_and_go_with_their_nodes_over(network: &Network) {
    let (mut one, mut two) = (network.process(0), network.process(0));
    let talker = one.start("talker", idle).expect("it starts");
    let _said = talker.advertise::<std_msgs::String>("chatter", Qos::SENSOR_DATA);
    let watcher = two.start("watcher", idle).expect("it starts");
    let found = || {
        let all = watcher.discovered_publishers().into_iter();
        all.filter(|p| p.topic == "/chatter").collect::<Vec<_>>()
    };
    eventually("the publisher is found", || found().len() == 1);
    let publisher = found().remove(0);
    assert_eq!(publisher.type_name, "std_msgs/msg/String");
    assert_eq!(publisher.qos.reliability, Qos::SENSOR_DATA.reliability);
    // DDS announces neither the depth nor, by rustdds, the hash.
    if network.is_zenoh() {
        assert_eq!(publisher.qos, Qos::SENSOR_DATA);
        let hash = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
        assert_eq!(publisher.type_hash.as_deref(), Some(hash));
    }
    eventually("its node is known", || {
        watcher.node_of(publisher.gid).as_deref() == Some("/talker")
    });
    let heard = watcher.subscribe::<std_msgs::String>("chatter", Qos::SENSOR_DATA);
    let heard = heard.expect("it subscribes");
    eventually("it is matched", || heard.is_matched(publisher.gid));
    one.finish().expect("no failure");
    eventually("the publisher is gone", || found().is_empty());
    eventually("it is not matched", || !heard.is_matched(publisher.gid));
    eventually("its node is gone", || {
        watcher.node_of(publisher.gid).is_none()
    });
}

// Fails if a subscription of another type were counted, or heard, as one of the topic. With rustdds one gets the
// samples of another subscription of its participant (docs/upstream.md), and discards them.
#[test]
fn types_must_agree_over_zenoh() {
    let router = Router::start();
    let (mut one, mut two) = (router.process(0), router.process(0));
    let talker = one.start("talker", idle).expect("it starts");
    let said = talker.advertise::<std_msgs::String>("chatter", Qos::RELIABLE);
    let said = said.expect("it publishes");
    let listener = two.start("listener", idle).expect("it starts");
    let right = listener.subscribe::<std_msgs::String>("chatter", Qos::RELIABLE);
    let right = right.expect("it subscribes");
    let wrong = listener.subscribe::<std_msgs::Header>("chatter", Qos::RELIABLE);
    let wrong = wrong.expect("it subscribes");
    eventually("the right one hears", || {
        said.publish(&std_msgs::String::default());
        right.take().is_some()
    });
    assert_eq!(wrong.counts(), (0, 0, 0));
}
