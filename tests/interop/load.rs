//! Twenty megabytes a second through DDS into a bag.

use fuyu::{
    bag::{Bag, Stamped},
    msg::{diagnostic_msgs::DiagnosticArray, sensor_msgs::Image, std_msgs::Float64MultiArray},
    ros::{Node, NodeError, Publisher, Qos, Subscription},
};
use rand::{Rng, RngExt, SeedableRng, rngs::SmallRng};
use std::{
    thread,
    time::{Duration, Instant},
};

use crate::{
    child::{Running, executable},
    namespace::Namespace,
    speed::{after, used},
    waiting::PATIENCE,
};

/// The test has a separate network namespace.
const DOMAIN: u16 = 3;
/// Numbers in a message of 40 kB; 500 messages a second are 20 MB/s.
const NUMBERS: usize = 5000;
const PERIOD: Duration = Duration::from_millis(2);
const MESSAGES: u64 = 4000;
/// Largest number of messages in flight: fewer than a reader keeps, and fewer than the recorder's queue holds. If the
/// computer is fast enough, the recorder reports its progress so often that this limit does not delay the publisher.
const WINDOW: u64 = 950;
/// Images of 900 kB, best effort: 20 MB/s, too.
const IMAGES: u32 = 100;
const IMAGE_PERIOD: Duration = Duration::from_millis(45);

/// The recorder's diagnostics: messages taken, messages dropped.
struct Reports {
    reports: Subscription<DiagnosticArray>,
    last: (u64, u64),
}

impl Reports {
    fn last(&mut self) -> (u64, u64) {
        while let Some(report) = self.reports.take() {
            for status in report.message.status {
                if status.name == "recorder: bag" {
                    let value = |key: &str| {
                        let found = status.values.iter().find(|v| v.key == key);
                        found.map_or(0, |v| v.value.parse().expect("a count"))
                    };
                    self.last = (value("messages"), value("dropped"));
                }
            }
        }
        self.last
    }

    /// Waits until the recorder has taken this many messages, or has received none for long; returns how many it has taken.
    fn wait_for(&mut self, node: &Node, messages: u64) -> u64 {
        let mut last = (self.last().0, Instant::now());
        while last.0 < messages && last.1.elapsed() < PATIENCE && node.ok() {
            node.wait_for(Duration::from_millis(20));
            let taken = self.last().0;
            if taken > last.0 {
                last = (taken, Instant::now());
            }
        }
        last.0
    }
}

/// A message number followed by noise, which cannot be compressed.
fn message(number: u64, noise: &mut SmallRng) -> Float64MultiArray {
    let mut data = vec![number as f64];
    data.resize_with(NUMBERS, || noise.random());
    Float64MultiArray {
        data,
        ..Default::default()
    }
}

/// Publishes number zero until the recorder has taken some, and returns how many: from then on it must record every reliable
/// message. `None` if it takes none for long.
fn meet(node: &Node, reports: &mut Reports, say: impl Fn()) -> Option<u64> {
    let (before, begin) = (reports.last().0, Instant::now());
    while begin.elapsed() < PATIENCE && node.wait_for(Duration::from_millis(100)) {
        let taken = reports.last().0;
        if taken > before {
            return Some(taken);
        }
        say();
    }
    None
}

/// Publishes [`MESSAGES`] reliably, then [`IMAGES`], and logs the result.
pub fn push(node: &Node) -> Result<(), NodeError> {
    let mut noise = SmallRng::seed_from_u64(1);
    let load: Publisher<Float64MultiArray> =
        node.advertise("load", Qos::RELIABLE.depth(2 * WINDOW as usize))?;
    let images: Publisher<Image> = node.advertise("images", Qos::SENSOR_DATA.depth(20))?;
    let mut reports = Reports {
        reports: node.subscribe("diagnostics", Qos::RELIABLE.depth(100))?,
        last: (0, 0),
    };
    let zero = message(0, &mut noise);
    let met = meet(node, &mut reports, || load.publish(&zero));
    let before = met.ok_or_else(|| NodeError::Failed("the recorder is not there".to_owned()))?;
    let begin = Instant::now();
    let mut due = begin;
    for number in 1..=MESSAGES {
        if number > WINDOW {
            reports.wait_for(node, before + number - WINDOW);
        }
        load.publish(&message(number, &mut noise));
        due = (due + PERIOD).max(Instant::now() - WINDOW as u32 * PERIOD);
        thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    let sent = begin.elapsed().as_secs_f64();
    reports.wait_for(node, before + MESSAGES);
    let (_, dropped) = reports.last();
    tracing::info!(
        "reliable: sent {MESSAGES} in {sent} s, unsent {} dropped {dropped}",
        load.dropped()
    );

    let image = |number: u32| {
        let mut image = Image {
            height: 600,
            width: 500,
            step: 1500,
            encoding: "rgb8".into(),
            data: vec![0; 900_000],
            ..Default::default()
        };
        image.header.stamp.nanosec = number;
        image
    };
    let zero = image(0);
    // An overloaded computer may lose all images; then none is recorded.
    let _ = meet(node, &mut reports, || images.publish(&zero));
    let begin = Instant::now();
    for number in 1..=IMAGES {
        let mut image = image(number);
        noise.fill_bytes(&mut image.data);
        images.publish(&image);
        let due = begin + number * IMAGE_PERIOD;
        thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    let sent = begin.elapsed().as_secs_f64();
    // Best effort: lost messages are not sent again.
    thread::sleep(Duration::from_secs(3));
    let (_, dropped) = reports.last();
    tracing::info!("images: sent {IMAGES} in {sent} s, dropped {dropped} over");
    while node.wait() {}
    Ok(())
}

// Fails when a reliable message is lost on the way to the bag, or the recorder drops any.
#[test]
fn twenty_megabytes_a_second_are_recorded() {
    let Some(namespace) = Namespace::new("load") else {
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let bag = folder.path().join("bag");
    let recorder = Running::recorder(&namespace, DOMAIN, "/load,/images", &bag, &[]);
    recorder.says("recording to");
    let args = ["--ros-args", "-r", "__node:=push"];
    let push = Running::program(namespace.command(executable()), "push", DOMAIN, &args);
    push.says("reliable: sent");
    let busy = used(recorder.id());
    push.says(" over");
    let (said, words) = (push.interrupt(), recorder.interrupt());
    let line = |what: &str| {
        let line = said.lines().find(|line| line.contains(what));
        line.expect("it was said").to_owned()
    };
    let (reliable, images) = (line("reliable: sent"), line("images: sent"));
    let rate = |line: &str, bytes: f64| after(line, "sent") * bytes / after(line, "in") * 1e-6;
    assert_eq!(after(&reliable, "unsent"), 0.0, "{reliable}");
    for line in [&reliable, &images] {
        assert_eq!(after(line, "dropped"), 0.0, "{line}");
    }
    assert!(!words.contains("dropped"), "{words}");
    let bag = Bag::open(&bag).expect("a bag");
    let load: Vec<Stamped<Float64MultiArray>> = bag.read("/load").expect("its messages");
    let numbers = load.iter().map(|m| m.message.data[0] as u64);
    let numbers: Vec<_> = numbers.filter(|n| *n > 0).collect();
    let seen: Vec<Stamped<Image>> = bag.read("/images").unwrap_or_default();
    let seen = seen.iter().filter(|m| m.message.header.stamp.nanosec > 0);
    println!(
        "reliable at {:.1} MB/s, {} of {MESSAGES} recorded with {busy:.1} s of processor; \
         images at {:.1} MB/s, {} of {IMAGES} recorded",
        rate(&reliable, 8.0 * NUMBERS as f64),
        numbers.len(),
        rate(&images, 900e3),
        seen.count(),
    );
    assert!(
        numbers == (1..=MESSAGES).collect::<Vec<_>>(),
        "the bag has {} of {MESSAGES}",
        numbers.len()
    );
}
