//! Defects of rustdds 0.15.1, ros2-client 0.12.1 and Fast DDS that fuyu works around or is affected by
//! (docs/upstream.md), each reproduced with as little code as possible and without fuyu. If one of these tests fails
//! after an update, the defect is probably fixed: remove its workaround.

mod announcements;
pub mod deadlocks;
mod early_samples;
mod fragments;
mod histories;
mod last_samples;
mod late_joiners;
pub mod lost_peers;
mod wall_clock;

use rustdds::{
    DomainParticipant, DomainParticipantBuilder, QosPolicies, QosPolicyBuilder, RTPSEntity,
    TopicKind,
    no_key::{DataReader, DataWriter},
    policy::{Durability, History, Reliability},
};
use std::{
    fs,
    io::{BufRead, BufReader},
    net::{Ipv4Addr, UdpSocket},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::{
    peer::DomainClaim,
    waiting::{PATIENCE, eventually},
};

/// For what must not arrive: many times what arrival takes.
const SILENCE: Duration = Duration::from_secs(3);

fn participant(domain: u16) -> DomainParticipant {
    let builder = DomainParticipantBuilder::new(domain);
    let builder = builder.with_only_networks([Ipv4Addr::LOCALHOST]);
    builder.build().expect("a participant")
}

fn qos() -> QosPolicies {
    let max_blocking_time = rustdds::Duration::from_millis(100);
    QosPolicyBuilder::new()
        .reliability(Reliability::Reliable { max_blocking_time })
        .history(History::KeepLast { depth: 10 })
        .build()
}

fn writer(participant: &DomainParticipant) -> DataWriter<Vec<u8>> {
    writer_with(participant, &qos())
}

fn writer_with(participant: &DomainParticipant, qos: &QosPolicies) -> DataWriter<Vec<u8>> {
    writer_of(participant, "bytes", qos)
}

fn writer_of(
    participant: &DomainParticipant,
    topic: &str,
    qos: &QosPolicies,
) -> DataWriter<Vec<u8>> {
    let topic = participant.create_topic(topic.into(), "Bytes".into(), qos, TopicKind::NoKey);
    let publisher = participant.create_publisher(qos).unwrap();
    let writer = publisher.create_datawriter_no_key_cdr(&topic.unwrap(), None);
    writer.unwrap()
}

fn reader(participant: &DomainParticipant) -> DataReader<Vec<u8>> {
    reader_with(participant, &qos())
}

fn reader_with(participant: &DomainParticipant, qos: &QosPolicies) -> DataReader<Vec<u8>> {
    reader_of(participant, "bytes", qos)
}

fn reader_of(
    participant: &DomainParticipant,
    topic: &str,
    qos: &QosPolicies,
) -> DataReader<Vec<u8>> {
    let topic = participant.create_topic(topic.into(), "Bytes".into(), qos, TopicKind::NoKey);
    let subscriber = participant.create_subscriber(qos).unwrap();
    let reader = subscriber.create_datareader_no_key_cdr(&topic.unwrap(), None);
    reader.unwrap()
}

/// The length of the next sample that arrives within `patience` and pleases.
fn next(
    reader: &mut DataReader<Vec<u8>>,
    patience: Duration,
    pleases: impl Fn(usize) -> bool,
) -> Option<usize> {
    let end = Instant::now() + patience;
    while Instant::now() < end {
        match reader.take_next_sample() {
            Ok(Some(sample)) => {
                let length = sample.into_value().len();
                if pleases(length) {
                    return Some(length);
                }
            }
            _ => thread::sleep(Duration::from_millis(10)),
        }
    }
    None
}

/// The same of what [`connect`] did not send.
fn length(reader: &mut DataReader<Vec<u8>>, patience: Duration) -> Option<usize> {
    next(reader, patience, |length| length != GREETING)
}

/// Length of the samples that [`connect`] sends. The last of them may come at any time after.
const GREETING: usize = 1;

/// Writes until the reader receives: then both have discovered each other.
fn connect(writer: &DataWriter<Vec<u8>>, reader: &mut DataReader<Vec<u8>>) {
    eventually("reader and writer find each other", PATIENCE, || {
        writer.write(vec![0; GREETING], None).unwrap();
        next(reader, Duration::from_millis(200), |_| true)
    });
}

#[test]
fn a_participant_on_loopback_does_not_hear_itself() {
    let domain = 62;
    let _claim = DomainClaim::new(domain);
    let (ours, other) = (participant(domain), participant(domain));
    let (writer, mut theirs, mut own) = (writer(&ours), reader(&other), reader(&ours));
    connect(&writer, &mut theirs);
    writer.write(vec![0; 5], None).unwrap();
    assert_eq!(length(&mut theirs, PATIENCE), Some(5));
    // It would if `lo` were a multicast interface, which takes an `ip link set lo multicast on`.
    assert_eq!(length(&mut own, SILENCE), None);
}

/// Reliable, with the last `depth` kept.
fn kept(depth: i32, durability: Durability) -> QosPolicies {
    let more = QosPolicyBuilder::new()
        .history(History::KeepLast { depth })
        .durability(durability);
    qos().modify_by(&more.build())
}

#[test]
fn transient_local_gives_more_than_its_depth() {
    let domain = 13;
    let _claim = DomainClaim::new(domain);
    let (here, there) = (participant(domain), participant(domain));
    let writer = writer_with(&here, &kept(1, Durability::TransientLocal));
    for length in 1..=5 {
        writer.write(vec![0; length], None).unwrap();
    }
    let mut late = reader_with(&there, &kept(10, Durability::TransientLocal));
    let first = next(&mut late, PATIENCE, |_| true).expect("what was retained");
    assert!(first < 5, "the last one alone is given, as its depth says");
}

#[test]
fn it_announces_itself_every_ten_seconds() {
    let domain = 14;
    let _claim = DomainClaim::new(domain);
    // Where the third participant of this computer would listen.
    let port = 7410 + 250 * domain + 2 * 2;
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let _participant = participant(domain);
    let mut buffer = [0; 65_536];
    let mut gaps = Vec::new();
    let mut last = None;
    // The first ones may come together.
    while gaps.is_empty() {
        socket.recv(&mut buffer).expect("it announces itself");
        let now = Instant::now();
        let gap = last.replace(now).map(|last| now - last);
        gaps.extend(gap.filter(|gap| *gap > Duration::from_secs(1)));
    }
    println!("announced again after {gaps:?}");
    assert!(
        gaps[0] > Duration::from_secs(5),
        "it announces itself more often: {gaps:?}"
    );
}

/// The process of a test below: a reader that listens until it is killed.
#[test]
#[ignore = "started by another test"]
fn listener() {
    if std::env::var_os(VICTIM).is_none() {
        return;
    }
    let participant = participant(15);
    let mut reader = reader(&participant);
    loop {
        let _ = next(&mut reader, SILENCE, |_| true);
        eprintln!("listening");
    }
}

#[test]
fn a_reader_that_died_holds_up_the_writer() {
    let _claim = DomainClaim::new(15);
    let here = participant(15);
    let writer = writer(&here);
    let mut listener = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "upstream::listener", "--ignored", "--nocapture"])
        .env(VICTIM, "1")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It takes samples one after the other, so it says a word after each.
    let mut said = BufReader::new(listener.stderr.take().unwrap()).lines();
    let mut heard = false;
    eventually("the listener receives", PATIENCE, || {
        writer.write(vec![0], None).unwrap();
        thread::sleep(Duration::from_millis(100));
        heard |= said
            .next()
            .is_some_and(|line| line.is_ok_and(|line| line == "listening"));
        heard.then_some(())
    });
    listener.kill().unwrap();
    listener.wait().unwrap();
    // More than its window, in much less time than its lease.
    let begin = Instant::now();
    let blocked = (0..20_000).find(|_| {
        let begin = Instant::now();
        let written = writer.write(vec![0], None);
        written.is_err() || begin.elapsed() >= Duration::from_millis(90)
    });
    println!("blocked at sample {blocked:?} after {:?}", begin.elapsed());
    assert!(blocked.is_some(), "nothing holds the writer up");
}

#[test]
fn a_reader_of_the_same_participant_holds_up_the_writer() {
    let domain = 33;
    let _claim = DomainClaim::new(domain);
    let (ours, other) = (participant(domain), participant(domain));
    // Writers are matched with those readers of their participant that are older.
    let (_own, mut theirs) = (
        reader(&ours),
        reader_with(&other, &kept(50, Durability::Volatile)),
    );
    let writer = writer(&ours);
    connect(&writer, &mut theirs);
    let (mut written, mut received) = (0, 0);
    let mut is_blocked = false;
    while written < 20_000 && !is_blocked {
        let batch = (0..50).take_while(|_| writer.write(vec![0; 5], None).is_ok());
        let batch = batch.count();
        is_blocked = batch < 50;
        written += batch;
        let arrive = (0..batch).map_while(|_| length(&mut theirs, PATIENCE));
        received += arrive.count();
    }
    println!("blocked after {written} samples, {received} received");
    assert!(is_blocked, "nothing holds the writer up");
    assert_eq!(received, written, "the other participant has all of them");
}

/// Threads of rustdds in this process.
fn threads_of_rustdds() -> usize {
    let names = fs::read_dir("/proc/self/task").unwrap().filter_map(|task| {
        let name = task.ok()?.path().join("comm");
        fs::read_to_string(name).ok()
    });
    names.filter(|name| name.starts_with("RustDDS")).count()
}

/// Set in the process that `a_signal_ends_the_threads` starts.
const VICTIM: &str = "FUYU_UPSTREAM_VICTIM";

/// The process of a test below: prints every 100 ms how many threads rustdds has.
#[test]
#[ignore = "started by another test"]
fn victim() {
    if std::env::var_os(VICTIM).is_none() {
        return;
    }
    let _participant = participant(64);
    for _ in 0..600 {
        eprintln!("threads: {}", threads_of_rustdds());
        thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn a_signal_ends_the_threads() {
    let _claim = DomainClaim::new(64);
    let mut victim = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "upstream::victim", "--ignored", "--nocapture"])
        .env(VICTIM, "1")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let said = BufReader::new(victim.stderr.take().unwrap());
    let mut threads = said.lines().map_while(Result::ok).filter_map(|line| {
        let count = line.strip_prefix("threads: ")?;
        count.parse::<usize>().ok()
    });
    // Each names itself when it gets its turn.
    assert_eq!(threads.find(|count| *count == 2), Some(2));
    // Stopped and continued, as by Ctrl-Z and fg: nothing has happened to it but that its polls end with EINTR. A thread
    // that works at that moment is not in its poll.
    let id = victim.id().to_string();
    let after = (0..50).find_map(|_| {
        for signal in ["-STOP", "-CONT"] {
            let sent = Command::new("kill").args([signal, &id]).status();
            assert!(sent.unwrap().success());
            thread::sleep(Duration::from_millis(100));
        }
        threads.by_ref().take(5).find(|count| *count == 0)
    });
    victim.kill().unwrap();
    victim.wait().unwrap();
    assert_eq!(after, Some(0), "the threads live on");
}
