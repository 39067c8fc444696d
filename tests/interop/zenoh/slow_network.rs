//! A controller on another computer, over a network with a round trip longer than the period of the states.

use super::{
    network::{Network, Transport},
    robot::Robot,
};
use crate::wire::Wire;

/// The largest joint rate of the run without a network is 1.94 rad/s \[rad/s\].
const LARGEST_RATE: f64 = 2.5;
/// An answer that a busy machine delays for longer than the default would act late.
const PATIENT: [&str; 2] = ["-p", "answer_timeout:=10.0"];

/// Five seconds of a robot over a network with this loss, and this delay in each direction \[s\]: the rate of simulated
/// time, and the largest joint rate \[rad/s\].
fn run(names: [&str; 2], domain: u16, loss: f64, delay: f64) -> Option<(f64, f64)> {
    let wire = Wire::new(names, loss, delay)?;
    let network = Network::new(wire, Transport::Zenoh, domain, "10.98.0.1");
    let robot = Robot::start(network, &PATIENT, &[]);
    let factor = robot.run_until(5.0);
    let heard = robot.watches[0].heard();
    println!(
        "{:.0} ms, {:.0} %: real time factor {factor:.2}, {:.2} rad/s",
        1e3 * delay,
        1e2 * loss,
        heard.rate
    );
    Some((factor, heard.rate))
}

// Fails if answers over a router act late, or if TCP keeps small messages back.
#[test]
fn time_that_waits_for_a_slow_network_changes_no_motion_over_zenoh() {
    let Some((factor, rate)) = run(["zlag", "zlagfar"], 212, 0.01, 0.02) else {
        return;
    };
    assert!(rate < LARGEST_RATE, "{rate} rad/s");
    assert!(rate > 1.5, "{rate} rad/s: it has not moved");
    assert!(factor > 0.05, "real time factor {factor}");
}

// The table in docs/machines.md.
#[test]
#[ignore = "takes five minutes on an idle machine"]
fn table_of_delays_over_zenoh() {
    for (loss, delay) in [
        (0.0, 0.0),
        (0.0, 0.002),
        (0.0, 0.005),
        (0.0, 0.01),
        (0.0, 0.02),
        (0.0, 0.05),
        (0.01, 0.0),
        (0.01, 0.01),
        (0.01, 0.02),
        (0.01, 0.05),
    ] {
        if run(["ztable", "ztablefar"], 213, loss, delay).is_none() {
            return;
        }
    }
}
