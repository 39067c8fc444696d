//! Nodes that lose their router.

use fuyu_ros::{msg::std_msgs, ros::Qos};

use crate::router::{Router, eventually, idle, process};

// Fails if nodes do not find each other once a router comes, or if those that are connected lose each other without it.
#[test]
fn nodes_find_each_other_when_the_router_comes_back() {
    let router = Router::start();
    let port = router.port();
    let mut one = router.process(0);
    let talker = one.start("talker", idle).expect("it starts");
    let said = talker.advertise::<std_msgs::String>("chatter", Qos::RELIABLE);
    let said = said.expect("it publishes");
    let mut two = router.process(0);
    let listener = two.start("listener", idle).expect("it starts");
    let heard = listener.subscribe::<std_msgs::String>("chatter", Qos::RELIABLE);
    let heard = heard.expect("it subscribes");
    let hears = |heard: &fuyu_ros::ros::Subscription<std_msgs::String>| {
        said.publish(&std_msgs::String::default());
        heard.take().is_some()
    };
    eventually("it hears", || hears(&heard));
    drop(router);
    while heard.take().is_some() {}
    eventually("peers need no router", || hears(&heard));
    // Starts without a router.
    let mut three = process(port, 0);
    let late = three.start("late", idle).expect("it starts");
    let late = late.subscribe::<std_msgs::String>("chatter", Qos::RELIABLE);
    let late = late.expect("it subscribes");
    let router = Router::start_at(port);
    eventually("the late one hears", || hears(&late));
    while heard.take().is_some() {}
    eventually("the first one hears", || hears(&heard));
    drop(router);
}
