//! What readers and writers of rustdds keep, and for how long.

use rustdds::{QosPolicies, QosPolicyBuilder, policy::History, policy::ResourceLimits};
use std::{
    thread,
    time::{Duration, Instant},
};

use super::*;

/// Reliable; all is kept, by a reader as far as `limit` goes.
fn all_kept(durability: Durability, limit: Option<i32>) -> QosPolicies {
    let more = QosPolicyBuilder::new()
        .history(History::KeepAll)
        .durability(durability);
    let more = match limit {
        None => more,
        Some(n) => more.resource_limits(ResourceLimits {
            max_samples: n,
            max_instances: n,
            max_samples_per_instance: n,
        }),
    };
    qos().modify_by(&more.build())
}

/// How many of `count` samples a reader still has after all of them have been acknowledged.
fn left_of(count: usize, limit: Option<i32>) -> usize {
    let (here, there) = (participant(95), participant(95));
    let writer = writer_with(&here, &all_kept(Durability::Volatile, None));
    let mut reader = reader_with(&there, &all_kept(Durability::Volatile, limit));
    connect(&writer, &mut reader);
    for _ in 0..count {
        writer.write(vec![0; 2], None).unwrap();
    }
    let acknowledged = writer.wait_for_acknowledgments(PATIENCE);
    assert!(acknowledged.is_ok_and(|all| all), "the reader has them");
    let mut left = 0;
    while let Some(sample) = reader.take_next_sample().unwrap() {
        left += usize::from(sample.into_value().len() != GREETING);
    }
    left
}

#[test]
fn a_reader_that_keeps_all_keeps_few_unless_told_how_many() {
    let _claim = DomainClaim::new(95);
    assert_eq!(left_of(1000, Some(4096)), 1000);
    let left = left_of(1000, None);
    println!("{left} of 1000 are left");
    assert!(left < 200, "{left} of 1000 are left");
}

#[test]
fn a_new_reader_gets_what_came_before_it() {
    let _claim = DomainClaim::new(95);
    let (here, there) = (participant(95), participant(95));
    let (writer, mut first) = (writer(&here), reader(&there));
    connect(&writer, &mut first);
    writer.write(vec![0; 7], None).unwrap();
    assert_eq!(length(&mut first, PATIENCE), Some(7));
    // Volatile, so it should begin with what is written from now on.
    let mut second = reader(&there);
    assert_eq!(length(&mut second, PATIENCE), Some(7));
}

/// The first of all samples that a writer still has, as a newcomer that wants all gets it: its length.
fn oldest(topic: &str) -> usize {
    let late = participant(96);
    let qos = all_kept(Durability::TransientLocal, Some(4096));
    let mut late = reader_of(&late, topic, &qos);
    length(&mut late, PATIENCE).expect("what is retained")
}

#[test]
fn a_best_effort_reader_makes_a_writer_keep_what_all_have() {
    const SAMPLES: usize = 1000;
    let _claim = DomainClaim::new(96);
    let (here, there) = (participant(96), participant(96));
    // What is kept is seen through latecomers; the depth says the last one.
    let last = kept(1, Durability::TransientLocal);
    let best_effort = QosPolicyBuilder::new().reliability(Reliability::BestEffort);
    let best_effort = best_effort.build();
    let (alone, mixed) = (
        writer_of(&here, "alone", &last),
        writer_of(&here, "mixed", &last),
    );
    let mut readers = [("alone", &last), ("mixed", &last), ("mixed", &best_effort)]
        .map(|(topic, qos)| reader_of(&there, topic, qos));
    connect(&alone, &mut readers[0]);
    connect(&mixed, &mut readers[1]);
    connect(&mixed, &mut readers[2]);
    // Numbered by their length.
    for number in 2..SAMPLES {
        for writer in [&alone, &mixed] {
            writer.write(vec![0; number], None).unwrap();
        }
    }
    for writer in [&alone, &mixed] {
        let acknowledged = writer.wait_for_acknowledgments(PATIENCE);
        assert!(acknowledged.is_ok_and(|all| all), "the reader has them");
    }
    // They let go of samples every four seconds.
    let begin = Instant::now();
    eventually("the other writer drops samples", PATIENCE, || {
        thread::sleep(Duration::from_millis(500));
        (oldest("alone") > SAMPLES / 2).then_some(())
    });
    thread::sleep(Duration::from_secs(5));
    let oldest = oldest("mixed");
    println!("after {:?} the oldest is {oldest}", begin.elapsed());
    assert!(oldest < SAMPLES / 2, "the oldest that it has is {oldest}");
}
