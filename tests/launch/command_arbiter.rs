//! Command arbitration: one publisher commands the robot at a time.

use serde_json::{Value, json};

use crate::{
    lateness::repeat_if_late,
    observer::{DIAGNOSTICS, JOINT_STATE, fresh, now, numbers, reported},
    peer::Peer,
    process::{Running, command, source},
    waiting::{PATIENCE, eventually},
};

fn effort(value: f64) -> Value {
    let message = json!({"name": ["joint1"], "effort": [value]});
    json!({"do": "publish", "topic": "joint_commands", "type": JOINT_STATE, "message": message})
}

/// Waits until joint 1 has this effort, while `commander` publishes its commands.
fn until(watcher: &mut Peer, value: f64, mut commander: impl FnMut(&mut Peer)) {
    eventually(&format!("an effort of {value}"), PATIENCE, || {
        commander(watcher);
        let state = fresh(watcher, "joint_states", 1).pop()?;
        let off = numbers(&state["effort"])[0] - value;
        (off.abs() < 1e-9).then_some(())
    });
}

/// The dynamics node, a commander that is accepted and another that is refused; diagnostics name both.
struct Rivals {
    dynamics: Running,
    alpha: Peer,
    beta: Peer,
}

impl Rivals {
    fn start(domain: u16, timeout: &str) -> Self {
        let mut dynamics = command("dynamics", domain);
        dynamics
            .args(["--ros-args", "--params-file"])
            .arg(source("config/positioning.yaml"))
            .args(["-p", "duration:=0.0", "-p", timeout]);
        let dynamics = Running::start(dynamics);
        let mut alpha = Peer::start("alpha", domain);
        let mut beta = Peer::start("beta", domain);
        alpha.subscribe("joint_states", JOINT_STATE, "reliable");
        alpha.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        until(&mut alpha, 0.5, |alpha| drop(alpha.does(effort(0.5))));

        // Node names are discovered, possibly a little after the first commands arrive.
        let since = now();
        let text = eventually("both are named", PATIENCE, || {
            alpha.does(effort(0.5));
            beta.does(effort(-0.5));
            reported(
                &mut alpha,
                "dynamics: commands",
                since,
                0.0,
                |level, text| level == 1 && text.contains("node /beta, while node /alpha commands"),
            )
        });
        println!("{text}");
        Self {
            dynamics,
            alpha,
            beta,
        }
    }
}

// Fails if two publishers can command alternately, if a publisher that has ended keeps the robot, or if diagnostics do
// not name them.
#[test]
fn a_second_commander_is_refused_by_name_until_the_first_ends() {
    repeat_if_late(|| {
        let Rivals {
            mut dynamics,
            mut alpha,
            mut beta,
        } = Rivals::start(4, "command_timeout:=3600.0");
        until(&mut alpha, 0.5, |_| {});
        alpha.does(json!({"do": "withdraw", "topic": "joint_commands"}));
        until(&mut alpha, -0.5, |_| drop(beta.does(effort(-0.5))));
        dynamics.interrupt().well();
    });
}

// Fails when a commander that is present but silent keeps the robot for ever, or loses it before the timeout.
#[test]
fn a_commander_that_is_silent_for_too_long_yields() {
    const TIMEOUT: f64 = 5.0;
    repeat_if_late(|| {
        let Rivals {
            mut dynamics,
            mut alpha,
            mut beta,
        } = Rivals::start(55, "command_timeout:=5.0");
        // On a slow machine the second publisher may have held the robot meanwhile. Now the first holds it and has just sent a
        // command.
        let spoken = now();
        until(&mut alpha, 0.5, |alpha| drop(alpha.does(effort(0.5))));
        let yielded = eventually("the second one commands", PATIENCE, || {
            beta.does(effort(-0.5));
            let wait =
                json!({"do": "wait", "topic": "joint_states", "since": spoken, "timeout": 0.2});
            let states = alpha.does(wait);
            let states = states.as_array().expect("a list");
            let pushed = |state: &&Value| numbers(&state["message"]["effort"])[0] < -0.4;
            states.iter().find(pushed)?["time"].as_f64()
        });
        let silent = yielded - spoken;
        println!("yielded after {silent:.1} s");
        assert!(silent > TIMEOUT, "{silent} s");
        // Now the second publisher may command.
        let since = now();
        eventually("the first one is refused", PATIENCE, || {
            beta.does(effort(-0.5));
            alpha.does(effort(0.5));
            let words = "node /alpha, while node /beta commands";
            let part = "dynamics: commands";
            reported(&mut alpha, part, since, 0.0, |level, text| {
                level == 1 && text.contains(words)
            })
        });
        dynamics.interrupt().well();
    });
}

// Fails if a refused command leaves time standing still without a reason, or if the answer of a commander that was refused
// is not taken once the robot is free: it answers each state once.
#[test]
fn lockstep_says_what_it_waits_for_and_takes_the_answer_of_the_next_commander() {
    repeat_if_late(|| {
        let domain = 28;
        let mut dynamics = command("dynamics", domain);
        dynamics
            .args(["--ros-args", "--params-file"])
            .arg(source("config/positioning.yaml"))
            .args(["-p", "lockstep:=true", "-p", "command_timeout:=5.0"]);
        let mut dynamics = Running::start(dynamics);
        let mut alpha = Peer::start("alpha", domain);
        let mut beta = Peer::start("beta", domain);
        alpha.subscribe("joint_states", JOINT_STATE, "reliable");
        alpha.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        let send = |peer: &mut Peer, sec: u64, value: f64| {
            let mut command = effort(value);
            command["message"]["header"] = json!({"stamp": {"sec": sec, "nanosec": 0}});
            peer.does(command);
        };
        let waits = |peer: &mut Peer, words: &[&str], mut again: Box<dyn FnMut(&mut Peer) + '_>| {
            let since = now();
            let text = eventually(words[0], PATIENCE, || {
                again(peer);
                reported(peer, "dynamics: time", since, 0.5, |_, text| {
                    words.iter().all(|word| text.contains(word))
                })
            });
            println!("{text}");
        };
        let words = [
            "held until the first command",
            "was refused",
            "must be finite",
        ];
        waits(
            &mut alpha,
            &words,
            Box::new(|alpha: &mut Peer| send(alpha, 0, 1e300)),
        );
        // A valid command that answers no state holds the robot. It is sent again until the other one has been refused,
        // however long that takes.
        let words = [
            "lockstep: waiting",
            "node /beta, while node /alpha commands",
        ];
        waits(
            &mut alpha,
            &words,
            Box::new(|alpha: &mut Peer| {
                send(alpha, 7, 0.1);
                send(&mut beta, 0, -0.5);
            }),
        );
        // Nobody sends any more. When the first one has been silent for too long, the answer that was refused acts.
        eventually("time advances", PATIENCE, || {
            let state = fresh(&mut alpha, "joint_states", 1).pop()?;
            (state["header"]["stamp"]["nanosec"] == 10_000_000).then_some(())
        });
        let ended = dynamics.interrupt().well();
        assert!(
            ended.stderr.contains("refused, it gives"),
            "{}",
            ended.stderr
        );
    });
}
