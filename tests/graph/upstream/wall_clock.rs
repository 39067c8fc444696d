//! A wall clock that is set back.

use super::*;
use crate::wall_clock::{SHIFT, WallClock, shift_own};

#[test]
fn a_wall_clock_that_is_set_back_stops_best_effort_readers() {
    let _claim = DomainClaim::new(105);
    let mut child = Command::new(std::env::current_exe().unwrap());
    child.args([
        "upstream::wall_clock::process_with_a_clock",
        "--exact",
        "--ignored",
        "--nocapture",
    ]);
    let clock = WallClock::new();
    clock.set_for(&mut child);
    assert!(child.status().unwrap().success());
}

/// Its process.
#[test]
#[ignore = "started by another test"]
fn process_with_a_clock() {
    if std::env::var_os(SHIFT).is_none() {
        return;
    }
    let best_effort = QosPolicyBuilder::new().reliability(Reliability::BestEffort);
    let best_effort = qos().modify_by(&best_effort.build());
    let (here, there) = (participant(105), participant(105));
    let (sender, mut receiver) = (
        writer_with(&here, &best_effort),
        reader_with(&there, &best_effort),
    );
    let (reliable_sender, mut reliable_receiver) = (
        writer_of(&here, "reliable", &qos()),
        reader_of(&there, "reliable", &qos()),
    );
    connect(&sender, &mut receiver);
    connect(&reliable_sender, &mut reliable_receiver);
    sender.write(vec![0; 5], None).unwrap();
    assert_eq!(length(&mut receiver, PATIENCE), Some(5));
    shift_own(-60);
    for _ in 0..10 {
        sender.write(vec![0; 6], None).unwrap();
        reliable_sender.write(vec![0; 6], None).unwrap();
    }
    assert_eq!(length(&mut reliable_receiver, PATIENCE), Some(6));
    assert_eq!(length(&mut receiver, SILENCE), None);
    // They are there; only the range of times that is read is empty.
    shift_own(0);
    assert_eq!(length(&mut receiver, PATIENCE), Some(6));
}
