//! A controller on another computer, over a network with a round trip longer than the period of the states.

use serde_json::{Value, json};
use std::time::Instant;

use crate::{
    lateness::repeat_if_late,
    two_computers::{START, Settings, TwoComputers},
    wire::Wire,
};

/// States that are compared: five seconds.
const STATES: usize = 500;
/// The largest joint rate of the run without a network is 1.94 rad/s \[rad/s\].
const LARGEST_RATE: f64 = 2.5;
/// Time does not wait for answers.
const NO_WAITING: [&str; 2] = ["-p", "answer_timeout:=0.0"];
/// Gains that bear delays which vary by several periods, but not one of a fifth of a second.
const GENTLE: [&str; 4] = [
    "-p",
    "k_o:=5.0",
    "-p",
    "k_v:=[400.0, 100.0, 200.0, 10.0, 2.0, 0.5]",
];
const COMPENSATED: [&str; 2] = ["-p", "delay_compensation:=true"];

/// What the first five seconds of a run were.
struct Run {
    /// Simulated time by the computer's.
    factor: f64,
    /// Largest joint rate \[rad/s\].
    fastest: f64,
    /// Largest change of a joint position \[rad\].
    moved: f64,
    said: String,
}

/// A run over a network with this loss, and this delay in each direction \[s\]; `None` if there can be none.
fn run(
    names: [&str; 2],
    domain: u16,
    (loss, delay): (f64, f64),
    settings: Settings,
) -> Option<Run> {
    first_states(STATES, names, domain, (loss, delay), settings)
}

/// The same until this number of states.
fn first_states(
    count: usize,
    names: [&str; 2],
    domain: u16,
    (loss, delay): (f64, f64),
    settings: Settings,
) -> Option<Run> {
    let wire = Wire::new(names, loss, delay)?;
    Some(observed(TwoComputers::start(wire, domain, settings), count))
}

/// The first states of a robot since its start.
fn observed(mut robot: TwoComputers, count: usize) -> Run {
    let observer = &mut robot.observers[0];
    let wait = |count: usize| {
        let patience = START.as_secs_f64();
        json!({"do": "wait", "topic": "joint_states", "count": count, "timeout": patience})
    };
    observer.does(wait(1));
    let start = Instant::now();
    let states = observer.does(wait(count));
    let states = states.as_array().expect("a list");
    assert!(states.len() >= count, "{} states", states.len());
    let list = |state: &Value, name: &str| -> Vec<f64> {
        let values = state["message"][name].as_array().expect("a list").iter();
        values.map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
    };
    let largest = |values: Vec<f64>| values.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let first = list(&states[0], "position");
    let moved = |state: &Value| {
        let now = list(state, "position");
        largest(now.iter().zip(&first).map(|(a, b)| a - b).collect())
    };
    Run {
        factor: 0.01 * states.len() as f64 / start.elapsed().as_secs_f64(),
        fastest: largest(
            states
                .iter()
                .map(|s| largest(list(s, "velocity")))
                .collect(),
        ),
        moved: largest(states.iter().map(moved).collect()),
        said: robot.said(),
    }
}

// Fails if a period during which time waits for the answer to its state is simulated with the efforts before: each
// answer then acts a whole period late, and joint rates reach 14 rad/s.
#[test]
fn time_that_waits_for_a_slow_network_changes_no_motion() {
    // An answer that a busy machine delays for longer than the default would act late.
    let settings = Settings {
        dynamics: &["-p", "answer_timeout:=10.0"],
        ..Settings::default()
    };
    let Some(run) = run(["lag", "lagfar"], 119, (0.0, 0.02), settings) else {
        return;
    };
    println!(
        "20 ms: {:.2} rad/s, real time factor {:.2}",
        run.fastest, run.factor
    );
    assert!(run.fastest < LARGEST_RATE, "{} rad/s", run.fastest);
    assert!(run.fastest > 1.5, "{} rad/s: it has not moved", run.fastest);
}

// Fails if the delay is not measured, or is compensated wrongly: joint rates exceed 200 rad/s within two seconds then.
#[test]
fn a_measured_delay_is_compensated() {
    repeat_if_late(|| {
        let free = Settings {
            dynamics: &NO_WAITING,
            controller: &GENTLE,
            ..Settings::default()
        };
        let names = ["free", "freefar"];
        let Some(run_free) = first_states(200, names, 125, (0.0, 0.1), free) else {
            return;
        };
        println!("100 ms, not compensated: {:.2} rad/s", run_free.fastest);
        assert!(
            run_free.fastest > LARGEST_RATE,
            "{} rad/s",
            run_free.fastest
        );
        let settings = Settings {
            controller: &[&COMPENSATED[..], &GENTLE].concat(),
            ..free
        };
        let Some(run) = run(["slow", "slowfar"], 125, (0.0, 0.1), settings) else {
            return;
        };
        println!("100 ms, compensated: {:.2} rad/s", run.fastest);
        assert!(run.said.contains("which is compensated"), "{}", run.said);
        // On a busy machine delays vary.
        assert!(run.fastest < 4.0 * LARGEST_RATE, "{} rad/s", run.fastest);
        assert!(run.moved > 0.1, "{} rad: it has not moved", run.moved);
    });
}

// Fails if the arm moves with gains that are not stable with what remains of the delay.
#[test]
fn a_delay_beyond_the_stability_limit_is_refused_before_the_arm_moves() {
    repeat_if_late(|| {
        let gains = "k_v:=[4000.0, 1000.0, 2000.0, 100.0, 20.0, 20.0]";
        let settings = Settings {
            dynamics: &NO_WAITING,
            controller: &[&COMPENSATED[..], &["-p", gains]].concat(),
            ..Settings::default()
        };
        let Some(wire) = Wire::new(["stiff", "stiffar"], 0.0, 0.02) else {
            return;
        };
        let robot = TwoComputers::start(wire, 126, settings);
        robot.nodes[3].says("efforts are zero");
        let run = observed(robot, STATES);
        assert!(run.said.contains("that is stable up to"), "{}", run.said);
        assert!(run.moved < 1e-9, "{} rad", run.moved);
    });
}

// The table in docs/machines.md.
#[test]
#[ignore = "takes ten minutes on an idle machine"]
fn table_of_delays() {
    println!(
        "| delay, loss | waiting: factor, rad/s | no waiting: rad/s | compensated | gentle gains, no waiting | compensated |"
    );
    for (loss, delay) in [
        (0.0, 0.0),
        (0.0, 0.002),
        (0.0, 0.005),
        (0.0, 0.01),
        (0.0, 0.02),
        (0.0, 0.05),
        (0.0, 0.1),
        (0.01, 0.0),
        (0.01, 0.01),
        (0.01, 0.05),
    ] {
        let patient = ["-p", "answer_timeout:=10.0"];
        let gentle = [&COMPENSATED[..], &GENTLE].concat();
        let cases = [
            (&patient[..], &[][..]),
            (&NO_WAITING, &[]),
            (&NO_WAITING, &COMPENSATED),
            (&NO_WAITING, &GENTLE),
            (&NO_WAITING, &gentle),
        ];
        let runs = cases.map(|(dynamics, controller)| {
            let settings = Settings {
                dynamics,
                controller,
                ..Settings::default()
            };
            run(["table", "tablefar"], 127, (loss, delay), settings)
        });
        let [
            Some(waiting),
            Some(free),
            Some(compensated),
            Some(soft),
            Some(gentle),
        ] = runs
        else {
            return;
        };
        println!(
            "| {} ms, {} % | {:.2}, {:.2} | {:.2} | {:.2} | {:.2} | {:.2} |",
            1e3 * delay,
            1e2 * loss,
            waiting.factor,
            waiting.fastest,
            free.fastest,
            compensated.fastest,
            soft.fastest,
            gentle.fastest
        );
    }
}
