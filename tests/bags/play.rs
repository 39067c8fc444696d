//! `fuyu bag play` publishes what was recorded.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;

use fuyu::bag::{Bag, Recorder, Topic, Writer, WriterOptions};
use fuyu::msg::rosgraph_msgs::Clock;
use fuyu::msg::std_msgs::String as Text;
use fuyu::msg::{Interface, cdr};
use fuyu::ros::{DiscoveryRange, Domain, Process, Qos, RosArgs};
use serde_json::json;

use crate::peer::{DomainClaim, Peer};
use crate::{
    child_guard::ChildGuard,
    lateness::repeat_if_late,
    waiting::{PATIENCE, eventually},
};

fn player(domain: u16, bag: &Path, args: &[&str]) -> ChildGuard {
    let player = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(["bag", "play"])
        .arg(bag)
        .args(args)
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env_remove("ROS_LOCALHOST_ONLY")
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    ChildGuard(player)
}

/// 200 texts in 2 s, one latched before them, and an unknown type.
fn record(folder: &Path) {
    let recorder = Recorder::start(Writer::create(folder, WriterOptions::default()).unwrap());
    let recorder = recorder.unwrap();
    let handle = recorder.handle();
    let add = |topic| handle.add_topic(topic).unwrap();
    let latched = add(Topic::of::<Text>("/latched", Qos::LATCHED));
    let words = add(Topic::of::<Text>("/words", Qos::RELIABLE.depth(500)));
    let unknown = add(Topic::named(
        "/gripper",
        "acme_msgs/msg/Gripper",
        Qos::RELIABLE,
    ));
    let text = |i: u64| {
        cdr::encode(&Text {
            data: i.to_string(),
        })
    };
    const START: u64 = 1_000_000_000_000;
    handle.write(&latched, START, START, text(4711));
    for i in 0..200 {
        let time = START + 10_000_000 * i;
        handle.write(&words, time, time, text(i));
        // DDS fills up to four bytes.
        handle.write(&unknown, time, time, vec![0, 1, 0, 0, i as u8, 0, 0, 0]);
    }
    recorder.finish().unwrap();
}

/// Receives in a separate thread.
struct Listener<M> {
    heard: mpsc::Receiver<M>,
    process: Option<Process>,
}

impl<M: Interface + Send + 'static> Listener<M> {
    fn start(domain: u16, topic: &'static str, qos: Qos) -> Self {
        let range = DiscoveryRange::Localhost;
        let mut process = Process::new(RosArgs::default(), Domain { id: domain, range });
        let (say, heard) = mpsc::channel();
        let listen = move |node: &fuyu::ros::Node| {
            let subscription = node.subscribe::<M>(topic, qos)?;
            while node.ok() {
                if let Some(received) = subscription.wait_next(std::time::Duration::from_millis(50))
                {
                    let _ = say.send(received.message);
                }
            }
            Ok(())
        };
        process.start("listener", listen).unwrap();
        Self {
            heard,
            process: Some(process),
        }
    }

    fn next(&self, what: &str) -> M {
        self.heard
            .recv_timeout(PATIENCE)
            .unwrap_or_else(|e| panic!("{what}: {e}"))
    }
}

impl<M> Drop for Listener<M> {
    fn drop(&mut self) {
        if let Some(process) = self.process.take() {
            let _ = process.finish();
        }
    }
}

fn signal(process: &str, signal: &str) {
    let sent = Command::new("kill").args([signal, process]).status();
    assert!(sent.unwrap().success());
}

fn interrupt(child: &mut Child) {
    signal(&child.id().to_string(), "-INT");
    let status = eventually("the end", PATIENCE, || child.try_wait().unwrap());
    assert!(status.success(), "{status}");
}

// Would break if a wait of centuries looked like a program that hangs, or could not be interrupted.
#[test]
fn a_message_far_in_the_future_is_waited_for_with_a_reason() {
    let domain = 29;
    let _claim = DomainClaim::new(domain);
    let dir = tempfile::tempdir().unwrap();
    let bag = dir.path().join("bag");
    let recorder = Recorder::start(Writer::create(&bag, WriterOptions::default()).unwrap());
    let recorder = recorder.unwrap();
    let handle = recorder.handle();
    let words = handle.add_topic(Topic::of::<Text>("/words", Qos::RELIABLE));
    let words = words.unwrap();
    for time in [1_000_000_000, 4_000_000_000_000_000_000] {
        let text = Text {
            data: "word".to_owned(),
        };
        handle.write(&words, time, time, cdr::encode(&text));
    }
    recorder.finish().unwrap();
    let player = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(["bag", "play"])
        .arg(&bag)
        .args(["--delay", "0"])
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut player = ChildGuard(player);
    let lines = BufReader::new(player.stderr.take().unwrap()).lines();
    let mut lines = lines.map_while(Result::ok);
    let said = lines.find(|line| line.contains("is 3999999999 s later"));
    assert!(said.is_some_and(|line| line.contains("--rate")));
    interrupt(&mut player);
    drop(lines);
}

#[test]
fn a_played_bag_has_its_topics_types_and_times() {
    repeat_if_late(|| {
        let domain = 9;
        let _claim = DomainClaim::new(domain);
        let dir = tempfile::tempdir().unwrap();
        let bag = dir.path().join("bag");
        record(&bag);
        played_and_recorded(domain, &bag, &dir.path().join("again"));
    });
}

/// Plays `bag` and records it as `again`.
fn played_and_recorded(domain: u16, bag: &Path, again: &Path) {
    let words = Listener::<Text>::start(domain, "/said", Qos::RELIABLE.depth(500));
    let clock = Listener::<Clock>::start(domain, "/clock", Qos::CLOCK.depth(500));
    let recorder = Command::new(env!("CARGO_BIN_EXE_recorder"))
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .args(["--ros-args", "-p", &format!("bag:={}", again.display())])
        .spawn()
        .unwrap();
    let mut recorder = ChildGuard(recorder);
    eventually("the recorder", PATIENCE, || again.exists().then_some(()));
    let remap = "/words:=/said";
    // A subscriber that has not found a topic by then misses its first messages. A participant that was not heard when
    // it came announces itself again after 10 s.
    let args = [
        "--rate", "2", "--clock", "100", "--delay", "15", "--remap", remap,
    ];
    let mut child = player(domain, bag, &args);
    let mut heard = Vec::new();
    while heard.last().is_none_or(|last| last != "199") {
        match words.heard.recv_timeout(PATIENCE) {
            Ok(word) => heard.push(word.data),
            Err(_) => break,
        }
    }
    let mut last = -1;
    for Clock { clock: time } in clock.heard.try_iter() {
        let nanos = i64::from(time.sec) * 1_000_000_000 + i64::from(time.nanosec);
        assert!(nanos >= last && (1_000_000_000_000..=1_002_000_000_000).contains(&nanos));
        last = nanos;
    }
    assert!(last > 0, "no clock came");
    let status = eventually("the end", PATIENCE, || child.try_wait().unwrap());
    assert!(status.success());
    interrupt(&mut recorder);

    // The recording of what was played: types of all kinds, latched topics latched, every byte the same.
    let (first, second) = (Bag::open(bag).unwrap(), Bag::open(again).unwrap());
    let described = |bag: &Bag, name: &str| {
        let info = bag.info().unwrap();
        let topic = info.topics.iter().find(|t| t.name == name)?;
        let qos = (topic.qos[0].reliability, topic.qos[0].durability);
        Some((topic.type_name.clone(), topic.count, qos))
    };
    let bytes = |bag: &Bag| {
        let messages = bag.messages().filter(|m| m.topic.name == "/gripper");
        messages.map(|m| m.data).collect::<Vec<_>>()
    };
    assert_eq!(heard, (0..200).map(|i| i.to_string()).collect::<Vec<_>>());
    for (name, played) in [
        ("/latched", "/latched"),
        ("/words", "/said"),
        ("/gripper", "/gripper"),
    ] {
        assert_eq!(described(&first, name), described(&second, played));
    }
    assert!(bytes(&first) == bytes(&second), "/gripper has other bytes");
}

// Would break if the player ended before a subscriber that does not run for two seconds has the last messages: what arrives
// after the end of their publisher is ignored.
#[test]
fn the_last_messages_reach_a_subscriber_that_is_late() {
    let domain = 26;
    let mut late = Peer::start("late", domain);
    late.subscribe("/words", "std_msgs/msg/String", "reliable");
    let process = late.does(json!({"do": "process_id"})).to_string();
    let dir = tempfile::tempdir().unwrap();
    let bag = dir.path().join("bag");
    record(&bag);
    let words = Listener::<Text>::start(domain, "/words", Qos::RELIABLE.depth(500));
    let mut child = player(domain, &bag, &["--delay", "3"]);
    while words.next("a word").data != "190" {}
    signal(&process, "-STOP");
    while words.next("a word").data != "199" {}
    std::thread::sleep(std::time::Duration::from_secs(2));
    assert_eq!(child.try_wait().unwrap(), None, "it has not waited");
    signal(&process, "-CONT");
    let status = eventually("the end", PATIENCE, || child.try_wait().unwrap());
    assert!(status.success());
    late.receive("/words", 200);
}

#[test]
fn a_loop_ends_with_ctrl_c_and_an_offset_leaves_out_the_beginning() {
    let domain = 10;
    let _claim = DomainClaim::new(domain);
    let dir = tempfile::tempdir().unwrap();
    let bag = dir.path().join("bag");
    record(&bag);
    let words = Listener::<Text>::start(domain, "/words", Qos::RELIABLE.depth(500));
    let latched = Listener::<Text>::start(domain, "/latched", Qos::LATCHED);
    let args = ["--loop", "--rate", "10", "--start-offset", "1.5"];
    let mut child = player(domain, &bag, &args);
    assert_eq!(latched.next("what was latched before").data, "4711");
    // The first round may have begun before the topic was found.
    while words.next("a word").data != "199" {}
    for round in 0..2 {
        for i in 150..200 {
            assert_eq!(words.next("a word").data, i.to_string(), "round {round}");
        }
    }
    interrupt(&mut child);
}

#[test]
fn what_cannot_be_played_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let bag = dir.path().join("bag");
    record(&bag);
    for (args, words) in [
        (["--topics", "/none"], "no topic /none"),
        (["--rate", "0"], "give a positive number"),
        (["--start-offset", "nan"], "give a number of seconds"),
        (["--remap", "/words"], "/words"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_fuyu"))
            .args(["bag", "play"])
            .arg(&bag)
            .args(args)
            .env("ROS_DOMAIN_ID", "8")
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
        assert!(text.contains(words), "{args:?}: {text}");
    }
}
