//! The services of the recorder node, called with ros2-client.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use fuyu::bag::Bag;
use fuyu::msg::rosbag2_interfaces as srv;
use fuyu::msg::std_msgs::String as Text;
use fuyu::ros::{DiscoveryRange, Domain, Process, Qos, RosArgs};
use ros2_client::dds::Client;
use ros2_client::{Context, Message, Name, NodeName, NodeOptions, ServiceMapping, ServiceTypeName};

use crate::child_guard::ChildGuard;
use crate::peer::DomainClaim;
use crate::waiting::{PATIENCE, eventually};

pub struct Recorder(ChildGuard);

impl Recorder {
    pub fn start(domain: u16, bag: &Path, parameters: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_recorder"));
        command
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .env_remove("ROS_LOCALHOST_ONLY")
            .args(["--ros-args", "-p", &format!("bag:={}", bag.display())]);
        for parameter in parameters {
            command.args(["-p", parameter]);
        }
        Self(ChildGuard(command.spawn().unwrap()))
    }

    fn signal(&self, name: &str) {
        let sent = Command::new("kill")
            .args([format!("-{name}"), self.0.id().to_string()])
            .status();
        assert!(sent.unwrap().success());
    }
}

/// Publishes on several topics until it is dropped.
struct Talker(Option<Process>);

impl Talker {
    fn start(domain: u16) -> Self {
        let range = DiscoveryRange::Localhost;
        let mut process = Process::new(RosArgs::default(), Domain { id: domain, range });
        let talk = |node: &fuyu::ros::Node| {
            let latched = node.advertise::<Text>("/kept/latched", Qos::LATCHED)?;
            latched.publish(&Text {
                data: "said once".into(),
            });
            let names = ["/kept/words", "/kept/not", "/other"];
            let topics = names.map(|name| node.advertise::<Text>(name, Qos::RELIABLE));
            for i in 0.. {
                if !node.ok() {
                    break;
                }
                for topic in topics.iter().flatten() {
                    topic.publish(&Text {
                        data: i.to_string(),
                    });
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            Ok(())
        };
        process.start("talker", talk).unwrap();
        Self(Some(process))
    }
}

impl Drop for Talker {
    fn drop(&mut self) {
        if let Some(process) = self.0.take() {
            let _ = process.finish();
        }
    }
}

struct Caller(ros2_client::Node);

impl Caller {
    fn new(domain: u16) -> Self {
        let participant = rustdds::DomainParticipantBuilder::new(domain)
            .with_only_networks([std::net::Ipv4Addr::LOCALHOST])
            .build()
            .unwrap();
        let context = Context::from_domain_participant(participant).unwrap();
        let name = NodeName::new("/", "caller").unwrap();
        Self(context.new_node(name, NodeOptions::new()).unwrap())
    }

    fn client<Q: Message + Clone + 'static, R: Message + 'static>(
        &mut self,
        service: &str,
        type_name: &str,
    ) -> Client<Q, R> {
        let qos = ros2_client::qos::QosProfile::publisher_default();
        self.0
            .create_client(
                ServiceMapping::Enhanced,
                &Name::new("/recorder", service).unwrap(),
                &ServiceTypeName::new("rosbag2_interfaces", type_name),
                qos.clone(),
                qos,
            )
            .unwrap()
    }
}

/// Repeats a call until there is a response: a call that is sent before the service is discovered is lost.
fn call<Q: Message + Clone + 'static, R: Message + 'static>(
    client: &Client<Q, R>,
    request: &Q,
) -> R {
    eventually("an answer", PATIENCE, || {
        client.send_request(request.clone()).ok()?;
        let sent = Instant::now();
        while sent.elapsed() < Duration::from_secs(3) {
            if let Ok(Some((_, response))) = client.receive_response() {
                return Some(response);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        None
    })
}

fn texts(bag: &Path, topic: &str) -> Vec<String> {
    let Ok(bag) = Bag::open(bag) else {
        return Vec::new();
    };
    let texts = bag.read::<Text>(topic).unwrap_or_default();
    texts.into_iter().map(|m| m.message.data).collect()
}

#[test]
fn a_recorder_selects_splits_pauses_stops_and_records_again() {
    let domain = 7;
    let _claim = DomainClaim::new(domain);
    let dir = tempfile::tempdir().unwrap();
    let (first, second) = (dir.path().join("first"), dir.path().join("second"));
    let _talker = Talker::start(domain);
    let mut recorder = Recorder::start(
        domain,
        &first,
        &[
            "regex:=^/kept/",
            "exclude_regex:=not$",
            "topics:=[/absent]",
            &format!("record_folders:=[{}]", dir.path().display()),
        ],
    );
    eventually("something is recorded", PATIENCE, || {
        (texts(&first, "/kept/words").len() > 10).then_some(())
    });
    let mut caller = Caller::new(domain);

    let is_paused = caller.client("is_paused", "IsPaused");
    let paused = || {
        let response: srv::IsPausedResponse = call(&is_paused, &srv::IsPausedRequest::default());
        response.paused
    };
    assert!(!paused());
    let split = caller.client("split_bagfile", "SplitBagfile");
    let _: srv::SplitBagfileResponse = call(&split, &srv::SplitBagfileRequest::default());
    assert!(first.join("first_1.mcap").exists());

    let pause = caller.client("pause", "Pause");
    let _: srv::PauseResponse = call(&pause, &srv::PauseRequest::default());
    assert!(paused());
    let resume = caller.client("resume", "Resume");
    let _: srv::ResumeResponse = call(&resume, &srv::ResumeRequest::default());
    assert!(!paused());

    let record = caller.client("record", "Record");
    let request = srv::RecordRequest {
        uri: second.display().to_string(),
    };
    let response: srv::RecordResponse = call(&record, &request);
    assert_eq!(response.return_code, 1, "one goes on already");
    assert!(response.error_string.contains("stop it first"));

    let stop = caller.client("stop", "Stop");
    let _: srv::StopResponse = call(&stop, &srv::StopRequest::default());
    let bag = Bag::open(&first).unwrap();
    let info = bag.info().unwrap();
    assert!(info.complete && info.has_metadata, "{:?}", info.damage);
    assert!(bag.files().len() >= 2);
    let names: Vec<_> = info.topics.iter().map(|t| t.name.as_str()).collect();
    assert_eq!(names, ["/kept/latched", "/kept/words"]);
    assert_eq!(texts(&first, "/kept/latched"), ["said once"]);

    // A peer cannot have folders created anywhere.
    let outside = srv::RecordRequest {
        uri: "/tmp/fuyu_outside_of_the_folders/bag".to_owned(),
    };
    let response: srv::RecordResponse = call(&record, &outside);
    assert_eq!(response.return_code, 1);
    assert!(
        response.error_string.contains("record_folders"),
        "{}",
        response.error_string
    );
    assert!(!Path::new("/tmp/fuyu_outside_of_the_folders").exists());

    // A second recording by the same node also contains the latched topics.
    let _: srv::RecordResponse = call(&record, &request);
    eventually("the second bag fills", PATIENCE, || {
        let latched = !texts(&second, "/kept/latched").is_empty();
        (latched && texts(&second, "/kept/words").len() > 10).then_some(())
    });
    recorder.signal("INT");
    let code = eventually("the recorder ends", PATIENCE, || {
        recorder.0.try_wait().unwrap()
    });
    assert_eq!(code.code(), Some(0));
    let info = Bag::open(&second).unwrap().info().unwrap();
    assert!(info.complete && info.has_metadata, "{:?}", info.damage);
}

#[test]
fn wrong_parameters_of_a_recorder_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    for (parameter, words) in [
        ("regex:='^/(tf'", "unclosed group"),
        ("exclude_regex:='*'", "regular expression"),
        ("max_bagfile_size:=500", "0 or at least 10000"),
        ("max_bagfile_size:=-5", "0 or at least 10000"),
        ("max_bagfile_duration:=-1.0", "max_bagfile_duration"),
        ("compression:=rar", "one of zstd, lz4, none"),
        ("compression_level:=40", "compression_level"),
        ("max_cache_size:=0", "max_cache_size"),
    ] {
        let bag = dir.path().join("run");
        let output = Command::new(env!("CARGO_BIN_EXE_recorder"))
            .env("ROS_DOMAIN_ID", "8")
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .args(["--ros-args", "-p", &format!("bag:={}", bag.display())])
            .args(["-p", parameter])
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{parameter}: {text}");
        let line = text.lines().find(|l| l.starts_with("error: "));
        assert!(
            line.is_some_and(|l| l.contains(words)),
            "{parameter}: {text}"
        );
        assert!(!bag.exists(), "{parameter} has begun a bag");
    }
}
