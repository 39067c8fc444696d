//! The bag of a recorder that is killed lacks at most its last second; the bag of one whose disk is full has all that
//! was written before.

use fuyu::bag::{Bag, Recorder, Topic, Writer, WriterOptions};
use fuyu::msg::cdr;
use fuyu::msg::sensor_msgs::JointState;
use fuyu::ros::Qos;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::{lateness::repeat_if_late, measuring::worst_below, sample};

const FOLDER: &str = "FUYU_TEST_KILLED_BAG";
/// Set if the bag is to have several files.
const SPLIT: &str = "FUYU_TEST_KILLED_SPLIT";

/// The process that the test below starts and kills.
#[test]
#[ignore = "started by another test"]
fn child_records_until_it_is_killed() {
    let Some(folder) = std::env::var_os(FOLDER) else {
        return;
    };
    let options = WriterOptions {
        max_duration: std::env::var_os(SPLIT).map(|_| Duration::from_secs(2)),
        ..WriterOptions::default()
    };
    let writer = Writer::create(folder, options).unwrap();
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
            "not killed within a minute"
        );
    }
}

#[test]
fn a_killed_recorder_loses_a_second_at_most() {
    // One second, and a little more for the flush; every kill must meet the limit.
    repeat_if_late(|| {
        worst_below("loss of a killed recorder [s]", 1.3, 3, || {
            lost_by_a_kill(false)
        });
        worst_below("its loss of a split bag [s]", 1.3, 3, || {
            lost_by_a_kill(true)
        });
    });
}

/// How long before the kill the first message was sent that is not in the bag \[s\].
fn lost_by_a_kill(split: bool) -> f64 {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("run");
    let mut command = Command::new(std::env::current_exe().unwrap());
    command
        .args([
            "--exact",
            "killed::child_records_until_it_is_killed",
            "--ignored",
            "--nocapture",
        ])
        .env(FOLDER, &folder)
        .stdout(Stdio::piped());
    if split {
        command.env(SPLIT, "1");
    }
    let mut child = command.spawn().unwrap();
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
    // 10 ms of the bag's time pass with every message.
    let files = 1 + joint_states(&bag).len().saturating_sub(1) / 200;
    // The last file may have no closed chunk yet.
    let expected = if split { files..=files + 1 } else { 1..=1 };
    assert!(expected.contains(&bag.files().len()), "{:?}", bag.files());
    let info = bag.info().unwrap();
    assert!(!info.complete && !info.has_metadata);
    let joints = bag.read::<JointState>("/joint_states").unwrap();
    for (i, m) in (0..).zip(&joints) {
        assert_eq!(m.message, sample::joint_state(i));
    }
    let lost = sent.get(joints.len());
    lost.map_or(0.0, |at| (killed - *at).as_secs_f64())
}

fn joint_states(bag: &Bag) -> Vec<fuyu::bag::Stamped<JointState>> {
    bag.read("/joint_states").unwrap()
}

const FULL: &str = "FUYU_TEST_FULL_DISK_BAG";

/// The process that the test below starts, on a disk that seems full.
#[test]
#[ignore = "started by another test"]
fn child_records_until_the_disk_is_full() {
    let Some(folder) = std::env::var_os(FULL) else {
        return;
    };
    let options = WriterOptions {
        chunk_size: 10_000,
        ..WriterOptions::default()
    };
    let recorder = Recorder::start(Writer::create(folder, options).unwrap()).unwrap();
    let handle = recorder.handle();
    let topic = handle
        .add_topic(Topic::of::<JointState>("/joint_states", Qos::RELIABLE))
        .unwrap();
    let begin = Instant::now();
    for i in 0.. {
        let cdr = cdr::encode(&sample::joint_state(i));
        handle.write(&topic, sample::time(i), sample::time(i), cdr);
        // The process continues, and further messages are counted as dropped.
        if handle.status().failure.is_some() && handle.status().dropped > 100 {
            println!("\nfailure: {}", handle.status().failure.unwrap());
            println!("finish: {}", recorder.finish().unwrap_err());
            return;
        }
        if i % 100 == 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(begin.elapsed() < Duration::from_secs(60), "nothing fails");
    }
}

#[test]
fn a_full_disk_is_reported_and_what_was_written_stays() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("run");
    // 200 kB; the signal is ignored, so that writing fails as it does on a full disk.
    let script = "trap '' XFSZ; ulimit -f 200; exec \"$@\"";
    let output = Command::new("bash")
        .args(["-c", script, "bash"])
        .arg(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "killed::child_records_until_the_disk_is_full",
            "--ignored",
            "--nocapture",
        ])
        .env(FULL, &folder)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}");
    for who in ["failure: ", "finish: "] {
        let line = text
            .lines()
            .find(|l| l.starts_with(who))
            .unwrap_or_default();
        assert!(line.contains("run_0.mcap"), "{text}");
    }
    let bag = Bag::open(&folder).unwrap();
    let joints = joint_states(&bag);
    // 200 kB hold many more messages than a few chunks of 50.
    assert!(joints.len() > 500, "{} are left", joints.len());
    for (i, m) in (0..).zip(&joints) {
        assert_eq!(m.message, sample::joint_state(i));
    }
}
