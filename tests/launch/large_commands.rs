//! Commands and requests that are valid but too large: the dynamics node goes on for everybody else.

use serde_json::{Value, json};

use crate::{
    lateness::repeat_if_late,
    observer::{DIAGNOSTICS, JOINT_STATE, fresh, now, numbers},
    simulation_control::{FAILED, OK, PAUSED, PLAYING, Simulation},
    waiting::{PATIENCE, eventually},
};

const ERROR: u64 = 2;

/// Pushes a light joint, which a constant effort accelerates until no integration step can follow.
fn push(sim: &mut Simulation, effort: f64) {
    let message = json!({"name": ["joint5"], "effort": [effort]});
    sim.peer.does(json!({
        "do": "publish", "topic": "/chaser/joint_commands", "type": JOINT_STATE, "message": message,
    }));
}

fn finite(states: &[Value]) {
    for state in states {
        for field in ["position", "velocity", "effort"] {
            let values = numbers(&state[field]);
            assert!(
                values.len() == 6 && values.iter().all(|x| x.is_finite()),
                "{state}"
            );
        }
    }
}

/// Waits until diagnostics have an error about a motion that has diverged.
fn diverged(sim: &mut Simulation, since: f64, mut attack: impl FnMut(&mut Simulation)) {
    let text = eventually("a divergence is reported", PATIENCE, || {
        attack(sim);
        let wait = json!({
            "do": "wait", "topic": "/chaser/diagnostics", "since": since, "timeout": 0.05,
        });
        let reports = sim.peer.does(wait);
        let reports = reports.as_array().expect("a list").iter();
        let mut parts = reports.flat_map(|r| r["message"]["status"].as_array().expect("a list"));
        let motion = parts.find(|part| {
            part["name"] == "chaser/dynamics: motion" && part["level"][0].as_u64() == Some(ERROR)
        })?;
        Some(motion["message"].as_str().expect("a text").to_owned())
    });
    println!("{text}");
    assert!(text.contains("has diverged"), "{text}");
}

// Each attack ended the node within a second.
#[test]
fn large_efforts_and_rates_never_end_the_simulation() {
    repeat_if_late(|| {
        let mut sim = Simulation::start(26);
        sim.peer
            .subscribe("/chaser/joint_states", JOINT_STATE, "reliable");
        sim.peer
            .subscribe("/chaser/diagnostics", DIAGNOSTICS, "reliable");
        let entities = sim.entities(json!({}));
        let robot = entities[0].clone();
        sim.go(OK, PLAYING);
        let spin = |sim: &mut Simulation, code: u64, rate: f64| {
            let state = json!({"twist": {"angular": {"z": rate}}});
            let request = json!({"entity": robot, "state": state, "set_twist": true});
            sim.gets(code, "set_entity_state", "SetEntityState", request)
        };
        let since = now();
        diverged(&mut sim, since, |sim| push(sim, 300.0));
        for rate in [100.0, 1e5] {
            spin(&mut sim, OK, rate);
            finite(&fresh(&mut sim.peer, "/chaser/joint_states", 50));
        }
        let refused = spin(&mut sim, FAILED, 1e7).to_string();
        assert!(refused.contains("turns at 1.0e7 rad/s"), "{refused}");
        // Service calls publish the state between two steps, too.
        for _ in 0..100 {
            push(&mut sim, 300.0);
            sim.time();
        }
        finite(&fresh(&mut sim.peer, "/chaser/joint_states", 50));
        let nothing = json!({"entity": robot});
        let refused = sim.gets(FAILED, "set_entity_state", "SetEntityState", nothing);
        assert!(refused.to_string().contains("nothing to set"), "{refused}");
        let before = sim.time();
        eventually("time goes on", PATIENCE, || {
            (sim.time() > before + 500_000_000).then_some(())
        });
        let ended = sim.dynamics.interrupt().well();
        assert!(ended.stderr.contains("has diverged"), "{}", ended.stderr);
    });
}

#[test]
fn steps_are_whole_and_few_enough() {
    repeat_if_late(|| {
        let mut sim = Simulation::start(27);
        // Commands act between two ticks. A pause ends at a tick nevertheless.
        for _ in 0..10 {
            sim.go(OK, PLAYING);
            push(&mut sim, 0.1);
            sim.go(OK, PAUSED);
            let paused = sim.time();
            assert_eq!(paused % 10_000_000, 0);
            sim.step(OK, 50);
            assert_eq!(sim.time(), paused + 500_000_000);
        }
        // A client that asks for centuries is refused, and one that asks for hours can be interrupted by others.
        let said = sim.step(FAILED, u64::MAX).to_string();
        assert!(said.contains("at most 1000000"), "{said}");
        sim.step(OK, 1);
        sim.dynamics.interrupt().well();
    });
}
