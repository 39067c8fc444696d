//! Participants that are lost and return.

use rustdds::{DomainParticipantStatusEvent as Event, StatusEvented};
use std::{io::Write, process::Child};

use super::*;
use crate::peer;

const DOMAIN: u16 = 110;

/// Fast DDS with a lease of two seconds instead of twenty.
const SHORT_LEASE: &str = r#"<?xml version="1.0"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="short_lease" is_default_profile="true">
    <rtps><builtin><discovery_config>
      <leaseDuration><sec>2</sec></leaseDuration>
      <leaseAnnouncement><sec>0</sec><nanosec>500000000</nanosec></leaseAnnouncement>
    </discovery_config></builtin></rtps>
  </participant>
</profiles>
"#;

/// A file with [`SHORT_LEASE`], for `FASTRTPS_DEFAULT_PROFILES_FILE`.
pub fn short_lease() -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().expect("a file");
    file.write_all(SHORT_LEASE.as_bytes())
        .expect("it is written");
    file
}

/// A node that publishes ten times a second.
const SCRIPT: &str = "
import os, time, rclpy
from std_msgs.msg import String
rclpy.init(domain_id=int(os.environ['ROS_DOMAIN_ID']))
publisher = rclpy.create_node('returning').create_publisher(String, 'returning', 10)
while True:
    publisher.publish(String(data='here'))
    time.sleep(0.1)
";

/// Killed when dropped.
struct Publisher(Child);

impl Drop for Publisher {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Whether a sample arrives within `patience`.
fn arrives(reader: &mut DataReader<String>, patience: Duration) -> bool {
    let end = Instant::now() + patience;
    while Instant::now() < end {
        match reader.take_next_sample() {
            Ok(Some(_)) => return true,
            _ => thread::sleep(Duration::from_millis(10)),
        }
    }
    false
}

fn string_reader(participant: &DomainParticipant) -> DataReader<String> {
    let kind = "std_msgs::msg::dds_::String_".to_owned();
    let topic = participant.create_topic("rt/returning".into(), kind, &qos(), TopicKind::NoKey);
    let subscriber = participant.create_subscriber(&qos()).unwrap();
    let reader = subscriber.create_datareader_no_key_cdr(&topic.unwrap(), None);
    reader.unwrap()
}

// The publisher is stopped for longer than its lease, which looks like an interrupted network.
#[test]
fn a_peer_that_returns_after_its_lease_is_not_found_again() {
    let _claim = DomainClaim::new(DOMAIN);
    let profile = short_lease();
    let here = participant(DOMAIN);
    let mut reader = string_reader(&here);
    let publisher = Command::new(peer::python())
        .args(["-c", SCRIPT])
        .env("ROS_DOMAIN_ID", DOMAIN.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
        .env("FASTRTPS_DEFAULT_PROFILES_FILE", profile.path())
        .env_remove("ROS_LOCALHOST_ONLY")
        .spawn();
    let publisher = Publisher(publisher.expect("python can be started"));
    let signal = |name: &str| {
        let id = publisher.0.id().to_string();
        let kill = Command::new("kill").args([name, &id]).status();
        assert!(kill.expect("kill is there").success());
    };
    assert!(arrives(&mut reader, PATIENCE), "before");
    let events = here.status_listener();
    while events.try_recv_status().is_some() {}
    signal("-STOP");
    eventually("its lease ends", PATIENCE, || {
        matches!(events.try_recv_status()?, Event::ParticipantLost { .. }).then_some(())
    });
    while arrives(&mut reader, Duration::from_millis(500)) {}
    signal("-CONT");
    // It announces itself twice a second.
    assert!(!arrives(&mut reader, SILENCE), "it is matched again");
    // A new participant receives what it publishes.
    let new = participant(DOMAIN);
    assert!(arrives(&mut string_reader(&new), PATIENCE), "after");
}
