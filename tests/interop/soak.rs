//! Joint states at 1 kHz, recorded to a bag, for a minute; `scripts/soak.sh` runs it for an hour.

use fuyu::{bag::Bag, msg::sensor_msgs::JointState};
use std::{
    thread,
    time::{Duration, Instant},
};

use crate::{
    child::{Running, executable},
    namespace::Namespace,
    speed::{DOMAIN, after},
    waiting::eventually,
};

/// Memory that processes have in use \[kB\]: medians over some seconds, in which chunks fill and are written.
fn usual(processes: &[&Running], seconds: u64) -> Vec<u64> {
    let mut samples = vec![Vec::new(); processes.len()];
    for _ in 0..2 * seconds {
        for (process, samples) in processes.iter().zip(&mut samples) {
            samples.push(process.resident());
        }
        thread::sleep(Duration::from_millis(500));
    }
    let median = |mut samples: Vec<u64>| {
        samples.sort_unstable();
        samples[samples.len() / 2]
    };
    samples.into_iter().map(median).collect()
}

// Fails when a reliable message is lost, time goes backwards, or memory grows.
#[test]
fn joint_states_at_1_khz_with_a_bag() {
    let Some(namespace) = Namespace::new("soak") else {
        return;
    };
    let seconds = std::env::var("FUYU_SOAK_SECONDS").ok();
    let seconds: u64 = seconds.map_or(60, |s| s.parse().expect("FUYU_SOAK_SECONDS is a number"));
    let count = 1000 * seconds;
    let folder = tempfile::tempdir().expect("a folder");
    let bag = folder.path().join("bag");
    // A file's index stays in memory until the file is closed: 17 kB a minute, of a chunk a second.
    let split = ["-p", "max_bagfile_duration:=300.0"];
    let recorder = Running::recorder(&namespace, DOMAIN, "/speed", &bag, &split);
    let parameter = format!("count:={count}");
    let program = |name: &str| {
        let node = format!("__node:={name}");
        let args = [
            "--ros-args",
            "-r",
            &node,
            "-p",
            &parameter,
            "-p",
            "reliable:=true",
        ];
        Running::program(namespace.command(executable()), name, DOMAIN, &args)
    };
    let send = program("send");
    let take = program("take");
    // In one minute the bounded caches, such as that of rustdds's announcements, do not fill up. In ten minutes they do,
    // and memory can be averaged over whole minutes, in each of which about a megabyte of free pages is returned once.
    let long = seconds >= 600;
    let window = if long { 60 } else { 10 };
    // At first memory grows while windows, chunks and queues fill. A third of the time is enough for that.
    let begin = Instant::now();
    let memory = |second: u64| {
        let left = Duration::from_secs(second).saturating_sub(begin.elapsed());
        thread::sleep(left);
        usual(&[&send, &take, &recorder], window)
    };
    let before = memory(seconds / 3 + 5);
    let after_all = memory(seconds - window - 2);
    eventually("the end", Duration::from_secs(3 * seconds + 120), || {
        take.said().contains(" p99 ").then_some(())
    });
    let said = take.interrupt();
    println!("{said}{before:?} kB after a third, {after_all:?} kB at the end");
    let line = said
        .lines()
        .find(|line| line.contains(" p99 "))
        .expect("it was said");
    assert_eq!(after(line, "lost"), 0.0, "{line}");
    assert_eq!(after(line, "backwards"), 0.0, "{line}");
    assert_eq!(after(line, "took"), count as f64, "{line}");
    for process in [send, recorder] {
        process.interrupt();
    }
    // In this network a participant receives its own announcements, which must not count as another node.
    assert!(!said.contains("another node of this name"), "{said}");
    for (before, after) in before.into_iter().zip(after_all) {
        // Even a run of one minute reveals a leak of 50 bytes per message.
        let filling = if long { 0.0 } else { 1000.0 };
        assert!(
            after as f64 <= 1.02 * before as f64 + filling,
            "from {before} to {after} kB"
        );
    }
    let states = Bag::open(&bag)
        .and_then(|bag| bag.read::<JointState>("/speed"))
        .expect("a bag");
    // The recorder may discover the topic after the first messages; from then on it must record all of them.
    let numbers: Vec<_> = states.iter().map(|s| s.message.position[0]).collect();
    assert!(
        numbers.windows(2).all(|pair| pair[1] == pair[0] + 1.0),
        "the bag lacks messages"
    );
    assert_eq!(numbers.last(), Some(&((count - 1) as f64)));
    println!("the bag has {} of {count}", numbers.len());
    assert!(
        states.is_sorted_by_key(|s| s.log_time),
        "the bag's time goes backwards"
    );
}
