//! Which endpoints a participant of Fast DDS discovers after joining.

use rustdds::{DomainParticipantStatusEvent as Event, StatusEvented};
use std::{
    process::Child,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc,
    },
};

use super::*;
use crate::peer;

const DOMAIN: u16 = 22;
/// Participants that exist before one joins, and endpoints of each. With a single participant nothing is
/// forgotten.
const PARTICIPANTS: usize = 6;
const EARLY: usize = 30;
/// Most participants that join, after the first.
const NEWCOMERS: usize = 10;

/// Joins repeatedly, each time as another participant, and prints how many of the early topics it has discovered in the end.
fn newcomers() -> Child {
    let all = PARTICIPANTS * EARLY;
    let script = format!(
        "
import time, rclpy
for patience in [{}] + [5] * {NEWCOMERS}:
    context = rclpy.Context()
    rclpy.init(context=context, domain_id={DOMAIN})
    node = rclpy.create_node('newcomer', context=context)
    end, early = time.monotonic() + patience, 0
    while early < {all} and time.monotonic() < end:
        early = sum(name.startswith('/early') for name, _ in node.get_topic_names_and_types())
        time.sleep(0.05)
    print(early, flush=True)
    node.destroy_node()
    rclpy.shutdown(context=context)
",
        PATIENCE.as_secs()
    );
    Command::new(peer::python())
        .args(["-c", &script])
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
        .env_remove("ROS_LOCALHOST_ONLY")
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

/// A participant with its endpoints, which makes one more when another joins, if it is `eager`.
fn host(number: usize, eager: &AtomicBool, over: &AtomicBool) {
    let here = participant(DOMAIN);
    let events = here.status_listener();
    let publisher = here.create_publisher(&qos()).unwrap();
    let made = |name: String| {
        let kind = "std_msgs::msg::dds_::String_".to_owned();
        let topic = here.create_topic(name, kind, &qos(), TopicKind::NoKey);
        let writer = publisher.create_datawriter_no_key_cdr(&topic.unwrap(), None);
        writer.unwrap()
    };
    let mut writers: Vec<DataWriter<Vec<u8>>> = (0..EARLY)
        .map(|i| made(format!("rt/early{number}x{i}")))
        .collect();
    while !over.load(Relaxed) {
        match events.try_recv_status() {
            Some(Event::ParticipantDiscovered { .. }) if eager.load(Relaxed) => {
                // Most of these are while the newcomer asks for the others.
                let pause = (7 * writers.len() + 11 * number) % 60;
                thread::sleep(Duration::from_millis(pause as u64));
                writers.push(made(format!("rt/late{number}x{}", writers.len())));
            }
            Some(_) => {}
            None => thread::sleep(Duration::from_millis(1)),
        }
    }
}

#[test]
fn fast_dds_forgets_what_was_announced_before_it_came() {
    let _claim = DomainClaim::new(DOMAIN);
    let [eager, over] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
    let hosts: Vec<_> = (0..PARTICIPANTS)
        .map(|number| {
            let (eager, over) = (Arc::clone(&eager), Arc::clone(&over));
            thread::spawn(move || host(number, &eager, &over))
        })
        .collect();
    let mut newcomers = newcomers();
    let said = BufReader::new(newcomers.stdout.take().unwrap());
    let (sender, receiver) = mpsc::channel();
    // Ends with the pipe, thus with the newcomers.
    thread::spawn(move || {
        for line in said.lines().map_while(Result::ok) {
            let _ = sender.send(line.parse::<usize>().unwrap());
        }
    });
    let all = PARTICIPANTS * EARLY;
    let first = receiver.recv_timeout(3 * PATIENCE);
    eager.store(true, Relaxed);
    let mut known = Vec::new();
    while known.len() < NEWCOMERS && known.last().is_none_or(|last| *last == all) {
        known.push(receiver.recv_timeout(PATIENCE).expect("another newcomer"));
    }
    let _ = newcomers.kill();
    let _ = newcomers.wait();
    over.store(true, Relaxed);
    for host in hosts {
        host.join().unwrap();
    }
    println!("of {all} the first newcomer knows {first:?}, later ones {known:?}");
    // Without anything new, all are known.
    assert_eq!(first, Ok(all));
    assert!(
        known.iter().any(|known| *known < all),
        "nothing is forgotten: {known:?}"
    );
}
