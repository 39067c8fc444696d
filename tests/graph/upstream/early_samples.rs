//! Samples that arrive before their writer is matched.

use super::*;
use crate::peer;

const DOMAIN: u16 = 109;
/// New publishers: so many at once that some publish before they are matched, so many times.
const AT_ONCE: usize = 25;
const TIMES: usize = 10;

/// New publishers, each of which publishes as soon as it knows the reader, and ends soon after.
fn script() -> String {
    format!(
        "
import time, rclpy
from std_msgs.msg import String
rclpy.init(domain_id={DOMAIN})
node = rclpy.create_node('eager')
for _ in range({TIMES}):
    publishers = [node.create_publisher(String, 'once', 10) for _ in range({AT_ONCE})]
    for publisher in publishers:
        while publisher.get_subscription_count() < 1:
            time.sleep(0.001)
        publisher.publish(String(data='early'))
    time.sleep(0.3)
    for publisher in publishers:
        node.destroy_publisher(publisher)
"
    )
}

#[test]
fn fast_dds_does_not_repeat_what_came_before_the_match() {
    let _claim = DomainClaim::new(DOMAIN);
    let participant = participant(DOMAIN);
    let kind = "std_msgs::msg::dds_::String_".to_owned();
    let topic = participant.create_topic("rt/once".into(), kind, &qos(), TopicKind::NoKey);
    let subscriber = participant.create_subscriber(&qos()).unwrap();
    let mut reader: DataReader<String> = subscriber
        .create_datareader_no_key_cdr(&topic.unwrap(), None)
        .unwrap();
    let mut child = Command::new(peer::python())
        .args(["-c", &script()])
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
        .env_remove("ROS_LOCALHOST_ONLY")
        .spawn()
        .unwrap();
    let mut arrived = 0;
    loop {
        let ended = child.try_wait().unwrap();
        while let Ok(Some(_)) = reader.take_next_sample() {
            arrived += 1;
        }
        if let Some(status) = ended {
            assert!(status.success());
            break;
        }
        thread::sleep(Duration::from_millis(5));
    }
    let published = AT_ONCE * TIMES;
    println!("{arrived} of {published} samples arrived");
    assert!(0 < arrived && arrived < published, "{arrived}");
}
