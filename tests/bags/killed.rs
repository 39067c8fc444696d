//! A recorder that is killed leaves everything but its last second behind.

use fuyu::bag::{Bag, Recorder, Topic, Writer, WriterOptions};
use fuyu::msg::cdr;
use fuyu::msg::sensor_msgs::JointState;
use fuyu::ros::Qos;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::{measuring::once_below, sample};

const FOLDER: &str = "FUYU_TEST_KILLED_BAG";

/// Not a test of its own: records until it is killed, when the test below starts it with a folder.
#[test]
fn child_records_until_it_is_killed() {
    let Some(folder) = std::env::var_os(FOLDER) else {
        return;
    };
    let writer = Writer::create(folder, WriterOptions::default()).unwrap();
    let recorder = Recorder::start(writer).unwrap();
    let handle = recorder.handle();
    let topic = handle
        .add_topic(Topic::of::<JointState>("/joint_states", Qos::RELIABLE))
        .unwrap();
    let start = Instant::now();
    for i in 0.. {
        assert!(handle.write(
            &topic,
            sample::time(i),
            sample::time(i),
            cdr::encode(&sample::joint_state(i))
        ));
        println!("\nsent {i}");
        std::thread::sleep(Duration::from_millis(2));
        assert!(
            start.elapsed() < Duration::from_secs(60),
            "nobody kills this"
        );
    }
}

#[test]
fn a_killed_recorder_loses_a_second_at_most() {
    // A second, and a little more until the flush is done.
    once_below("what a killed recorder loses [s]", 1.3, lost_by_a_kill);
}

/// How long before the kill the first message was sent that is not in the bag \[s\].
fn lost_by_a_kill() -> f64 {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("run");
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "killed::child_records_until_it_is_killed",
            "--nocapture",
        ])
        .env(FOLDER, &folder)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut sent = Vec::new();
    for line in BufReader::new(child.stdout.take().unwrap()).lines() {
        if line.unwrap().starts_with("sent ") {
            sent.push(Instant::now());
            if sent[0].elapsed() > Duration::from_millis(3300) && sent.len() > 500 {
                break;
            }
        }
    }
    // SIGKILL: no handler, no destructor, no flush.
    child.kill().unwrap();
    child.wait().unwrap();
    let killed = *sent.last().expect("the child records");

    let bag = Bag::open(&folder).unwrap();
    let info = bag.info().unwrap();
    assert!(!info.complete && !info.has_metadata);
    let joints = bag.read::<JointState>("/joint_states").unwrap();
    for (i, m) in (0..).zip(&joints) {
        assert_eq!(m.message, sample::joint_state(i));
    }
    let lost = sent.get(joints.len());
    lost.map_or(0.0, |at| (killed - *at).as_secs_f64())
}
