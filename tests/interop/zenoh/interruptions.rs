//! The network between two computers is interrupted for less and for longer than the lease of Zenoh's links, 10 s.

use std::{
    thread,
    time::{Duration, Instant},
};

use super::{
    network::{Network, Transport},
    robot::Robot,
};
use crate::{two_computers::START, wire::Wire};

/// Within this time after an interruption everything is exchanged again: routers connect again every 1 to 4 s, and TCP
/// repeats what was lost in a shorter interruption after at most as long as that was.
const BACK_WITHIN: Duration = Duration::from_secs(40);
/// `command_timeout` of the dynamics node and a margin.
const HALTED_AFTER: Duration = Duration::from_secs(4);

/// Interrupts the network for these times \[s\], one after the other.
fn interrupt(names: [&str; 2], domain: u16, seconds: &[u64]) {
    let Some(wire) = Wire::without_multicast(names) else {
        return;
    };
    let network = Network::new(wire, Transport::Zenoh, domain, "10.98.0.1");
    let mut robot = Robot::start(network, &[], &[]);
    robot.all_receive(START);
    for &seconds in seconds {
        let back = interrupt_once(&mut robot, Duration::from_secs(seconds));
        println!("{seconds} s: everything is exchanged within {back:.1} s");
    }
    let end = robot.watches[0].heard().stamp;
    let recorded = robot.recorded();
    let last = recorded.last().copied().unwrap_or(f64::NAN);
    assert!(last >= end - 1.0, "the bag ends at {last} s of {end} s");
}

/// Interrupts the network once. How long afterwards everything was exchanged again \[s\].
pub fn interrupt_once(robot: &mut Robot, how_long: Duration) -> f64 {
    let cut = Instant::now();
    robot.network.wire.set(1.0, 0.0);
    thread::sleep(HALTED_AFTER);
    let before = robot.watches[0].heard();
    thread::sleep(Duration::from_millis(500));
    let halted = robot.watches[0].heard();
    assert!(halted.states > before.states, "time goes on");
    assert_eq!(halted.effort, 0.0);
    thread::sleep(how_long.saturating_sub(cut.elapsed()));
    robot.network.wire.set(0.0, 0.0);
    robot.all_receive(BACK_WITHIN)
}

// Fails if a session or a router does not connect again, or if what is declared twice is not matched again.
#[test]
fn a_robot_survives_short_interruptions_over_zenoh() {
    interrupt(["zcut", "zcutfar"], 210, &[5, 28]);
}

#[test]
#[ignore = "takes eight minutes"]
fn a_robot_survives_long_interruptions_over_zenoh() {
    interrupt(["zlong", "zlongfar"], 211, &[15, 30, 60, 300]);
}
