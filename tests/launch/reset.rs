//! A simulation that is reset in the middle of a motion: the second run is bit-identical to the first.

use fuyu::{bag::Bag, msg::sensor_msgs::JointState, ros::Time};
use serde_json::json;
use std::path::{Path, PathBuf};

use crate::{
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    lockstep::{simulated, states, tracking},
    observer::{JOINT_STATE, fresh},
    peer::Peer,
    process::{Running, source},
    waiting::{PATIENCE, eventually},
};

const DOMAIN: u16 = 56;

fn stamp(state: &JointState) -> f64 {
    Time::from(&state.header.stamp).as_secs_f64()
}

/// Waits until simulated time is beyond `seconds`.
fn reach(peer: &mut Peer, seconds: u64) {
    eventually("time goes on", 3 * PATIENCE, || {
        let state = fresh(peer, "joint_states", 1).pop()?;
        let at = state["header"]["stamp"]["sec"].as_u64().expect("a time");
        (at >= seconds).then_some(())
    });
}

fn reset(peer: &mut Peer) {
    let answer = peer.does(json!({
        "do": "call", "service": "dynamics/reset_simulation",
        "type": "simulation_interfaces/srv/ResetSimulation", "request": {"scope": 0},
    }));
    assert_eq!(answer["response"]["result"]["result"], 1, "{answer}");
}

/// Both runs of a simulation in lockstep that is reset after some seconds, and where they are recorded.
fn twice(config: &Path) -> ([Vec<JointState>; 2], Vec<PathBuf>, Running) {
    let mut peer = peer_with_interfaces("operator", DOMAIN);
    peer.subscribe("joint_states", JOINT_STATE, "reliable");
    // In lockstep, but no faster than real time: the arm still moves when the reset comes.
    let args = [
        "--duration",
        "600",
        "--ros-args",
        "-p",
        "dynamics:lockstep:=true",
        "-p",
        "controller:lockstep:=true",
    ];
    let mut launch = Running::launch(DOMAIN, config, &args);
    reach(&mut peer, 2);
    reset(&mut peer);
    eventually("time restarts at zero", PATIENCE, || {
        let state = fresh(&mut peer, "joint_states", 1).pop()?;
        (state["header"]["stamp"]["sec"] == 0).then_some(())
    });
    reach(&mut peer, 3);
    launch.interrupt().well();
    let mut first = states(&launch.bag());
    let back = first.windows(2).position(|w| stamp(&w[1]) < stamp(&w[0]));
    let second = first.split_off(back.expect("a reset") + 1);
    let files = std::fs::read_dir(launch.bag()).expect("a bag");
    let mut files: Vec<_> = files
        .map(|file| file.expect("a file").path())
        .filter(|file| file.extension().is_some_and(|e| e == "mcap"))
        .collect();
    files.sort();
    ([first, second], files, launch)
}

// Fails if state of the first run remains in the second: an effort in transit, a planned path, a goal predicted from
// earlier motion, or the position in the camera's noise sequence.
#[test]
fn after_a_reset_all_is_as_at_the_start() {
    repeat_if_late(|| {
        let (_folder, tracking) = tracking();
        for config in [source("config/straight_path.yaml"), tracking] {
            let expected = simulated(&config, "8");
            let (runs, files, _launch) = twice(&config);
            for run in &runs {
                assert!(run.len() > 100, "{} states", run.len());
                for state in run {
                    // A recorder that is late misses the first states; one that waits for long is answered twice, which
                    // changes what is predicted by rounding.
                    let Some(expected) = expected.get((100.0 * stamp(state)).round() as usize)
                    else {
                        break;
                    };
                    assert_eq!(expected.header, state.header);
                    for (ours, theirs) in expected.position.iter().zip(&state.position) {
                        let off = (ours - theirs).abs();
                        assert!(off < 1e-9, "{}: {off} at {state:?}", config.display());
                    }
                }
            }
            // Time increases in each file of the bag.
            assert_eq!(files.len(), 2, "{files:?}");
            for file in files {
                let bag = Bag::open(&file).expect("a file of a bag");
                let times: Vec<_> = bag.messages().map(|m| m.log_time).collect();
                assert!(times.is_sorted(), "{}", file.display());
            }
        }
    });
}
