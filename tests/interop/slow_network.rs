//! A controller on another computer, over a network with a round trip longer than the period of the states.

use serde_json::json;

use crate::{link_loss::Split, waiting::PATIENCE, wire::Wire};

/// States that are compared.
const STATES: usize = 400;
/// The largest joint rate of the run without a network is 1.9 rad/s \[rad/s\].
const LARGEST_RATE: f64 = 2.5;

/// The largest joint rate of the run over a network with this delay in each direction \[s\]; `None` if there can be
/// none.
fn largest_rate(names: [&str; 2], domain: u16, delay: f64) -> Option<f64> {
    let wire = Wire::new(names, 0.0, delay)?;
    // An answer that a busy machine delays for longer than the default would act late.
    let patient = ["-p", "answer_timeout:=10.0"];
    let mut robot = Split::new(wire, domain, [&[], &[]], &patient);
    robot.all_receive(0.0, 3 * PATIENCE);
    let wait = json!({"do": "wait", "topic": "joint_states", "count": STATES});
    let states = robot.observer.does(wait);
    let states = states.as_array().expect("a list");
    assert!(states.len() >= STATES, "{} states", states.len());
    let rates = states
        .iter()
        .flat_map(|s| s["message"]["velocity"].as_array().expect("rates"));
    Some(
        rates
            .filter_map(|r| r.as_f64())
            .fold(0.0, |most: f64, rate| most.max(rate.abs())),
    )
}

// Fails if a period during which time waits for the answer to its state is simulated with the efforts before: each
// answer then acts a whole period late, and joint rates reach 14 rad/s.
#[test]
fn time_that_waits_for_a_slow_network_changes_no_motion() {
    for (delay, names, domain) in [
        (0.006, ["slow", "slowfar"], 118),
        (0.02, ["lag", "lagfar"], 119),
    ] {
        let Some(rate) = largest_rate(names, domain, delay) else {
            return;
        };
        println!("{delay} s in each direction: the largest joint rate is {rate:.2} rad/s");
        assert!(
            rate < LARGEST_RATE,
            "{delay} s in each direction: {rate} rad/s"
        );
    }
}
