//! One commands the robot at a time.

use serde_json::{Value, json};

use crate::{
    peer::Peer,
    process::{Running, command, source},
    starvation::in_time,
    view::{DIAGNOSTICS, JOINT_STATE, fresh, now, numbers, told},
    waiting::{PATIENCE, eventually},
};

fn effort(value: f64) -> Value {
    let message = json!({"name": ["joint1"], "effort": [value]});
    json!({"do": "publish", "topic": "joint_commands", "type": JOINT_STATE, "message": message})
}

/// Waits until joint 1 has this effort, while `commander` asks for what it asks for.
fn until(watcher: &mut Peer, value: f64, mut commander: impl FnMut(&mut Peer)) {
    eventually(&format!("an effort of {value}"), PATIENCE, || {
        commander(watcher);
        let state = fresh(watcher, "joint_states", 1).pop()?;
        let off = numbers(&state["effort"])[0] - value;
        (off.abs() < 1e-9).then_some(())
    });
}

#[test]
fn a_second_commander_is_refused_by_name_until_the_first_ends() {
    in_time(|| {
        let domain = 4;
        let mut dynamics = command("dynamics", domain);
        dynamics
            .args(["--ros-args", "--params-file"])
            .arg(source("config/positioning.yaml"))
            .args(["-p", "duration:=0.0", "-p", "command_timeout:=3600.0"]);
        let mut dynamics = Running::start(dynamics);
        let mut alpha = Peer::start("alpha", domain);
        let mut beta = Peer::start("beta", domain);
        alpha.subscribe("joint_states", JOINT_STATE, "reliable");
        alpha.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        until(&mut alpha, 0.5, |alpha| drop(alpha.does(effort(0.5))));

        // Names come with discovery, a little later than commands may.
        let since = now();
        let text = eventually("both are named", PATIENCE, || {
            beta.does(effort(-0.5));
            told(
                &mut alpha,
                "dynamics: commands",
                since,
                0.0,
                |level, text| level == 1 && text.contains("node /beta, while node /alpha commands"),
            )
        });
        println!("{text}");
        until(&mut alpha, 0.5, |_| {});

        alpha.does(json!({"do": "withdraw", "topic": "joint_commands"}));
        until(&mut alpha, -0.5, |_| drop(beta.does(effort(-0.5))));
        dynamics.interrupt().well();
    });
}
