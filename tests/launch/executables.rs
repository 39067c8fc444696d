//! Every node as a process of its own, in a namespace, as `ros2 run` starts them.

use serde_json::json;
use std::fs;

use crate::{
    lateness::repeat_if_late,
    observer::{JOINT_STATE, fresh, numbers, tip_in_world, watch_tip},
    peer::Peer,
    process::{Check, GENTLE, Running, command, source},
    waiting::{PATIENCE, eventually},
};

const NAMESPACE: &str = "/chaser";
const GOAL: [f64; 3] = [3.662078985521887, 5.4440225463358125, 0.37996776327278203];

fn node(name: &str, domain: u16, more: &[&str]) -> Running {
    let mut node = command(name, domain);
    node.args(["--ros-args", "-r", "__ns:=/chaser", "--params-file"])
        .arg(source("config/positioning.yaml"))
        .args(more);
    Running::start(node)
}

#[test]
fn four_processes_in_a_namespace_are_the_same_graph() {
    repeat_if_late(|| {
        let domain = 84;
        let folder = tempfile::tempdir().unwrap();
        let bag = folder.path().join("bag");
        let mut recorder = node(
            "recorder",
            domain,
            &["-p", &format!("bag:={}", bag.display())],
        );
        let mut camera = node("camera", domain, &[]);
        // A parameter without the node's name in front.
        let gentle = GENTLE.map(|word| word.trim_start_matches("controller:"));
        let gentle = &gentle[1..];
        let mut first = node("controller", domain, gentle);
        let mut dynamics = node("dynamics", domain, &["-p", "duration:=0.0"]);
        let mut peer = Peer::start("observer", domain);
        watch_tip(&mut peer, NAMESPACE);
        peer.subscribe("/chaser/joint_states", JOINT_STATE, "reliable");

        let plumbing = [
            "/clock",
            "/tf",
            "/tf_static",
            "/rosout",
            "/parameter_events",
        ];
        for (name, publishes, hears) in [
            ("dynamics", "joint_states", "joint_commands"),
            ("camera", "camera/tip_pose", "goal_pose"),
            ("controller", "joint_commands", "camera/tip_pose"),
            ("recorder", "diagnostics", "joint_states"),
        ] {
            let below = |topic: &str| [format!("{NAMESPACE}/{topic}")];
            let expected = json!({
                "publishers": below(publishes), "subscribers": below(hears),
                "services": below(&format!("{name}/list_parameters")),
            });
            let graph = peer.graph(name, NAMESPACE, &expected);
            for kind in ["publishers", "subscribers", "services"] {
                for topic in graph[kind].as_object().unwrap().keys() {
                    let right = topic.starts_with("/chaser/") || plumbing.contains(&topic.as_str());
                    assert!(right, "{name} has {topic} among its {kind}");
                }
            }
        }
        let error = |peer: &mut Peer| {
            let tip = tip_in_world(peer, NAMESPACE).translation.vector;
            (tip - nalgebra::Vector3::from(GOAL)).norm()
        };
        let start = error(&mut peer);
        eventually("the tip nears the goal", 3 * PATIENCE, || {
            (error(&mut peer) < 0.7 * start).then_some(())
        });

        // Killed in the middle of the motion: efforts become zero, the arm coasts.
        first.signal("KILL");
        assert_eq!(first.wait(PATIENCE).code, None);
        let coasting = eventually("the efforts end", PATIENCE, || {
            let state = fresh(&mut peer, "/chaser/joint_states", 1).pop()?;
            (numbers(&state["effort"]) == [0.0; 6]).then_some(state)
        });
        let speed = numbers(&coasting["velocity"])
            .iter()
            .fold(0.0f64, |m, v| m.max(v.abs()));
        assert!(speed > 1e-4, "{coasting}");
        let lost = error(&mut peer);

        let mut second = node("controller", domain, gentle);
        eventually("the tip is within 1 cm", 5 * PATIENCE, || {
            (error(&mut peer) < 0.01).then_some(())
        });
        println!(
            "error {start:.2} m at first, {lost:.2} m when the controller was gone, then 1 cm"
        );
        for process in [&mut dynamics, &mut second, &mut camera, &mut recorder] {
            let ended = process.interrupt().well();
            assert!(!ended.stderr.contains("ERROR"), "{}", ended.stderr);
        }
        let check = Check::of(&bag);
        let report = fs::metadata(bag.join("metadata.yaml"));
        assert!(report.is_ok(), "{:?}", check.failed());
    });
}

// Fails if the launch looks for its controller's state where the scenario, not the command line, puts it.
#[test]
fn a_launch_in_a_namespace_shows_the_errors_of_its_tip() {
    let config = source("config/positioning.yaml");
    let args = [&["--duration", "12"], &GENTLE[..], &["-r", "__ns:=/chaser"]].concat();
    let mut launch = Running::launch(109, &config, &args);
    let ended = launch.wait(6 * PATIENCE);
    assert!(ended.stderr.contains(", tip error "), "{ended:?}");
}
