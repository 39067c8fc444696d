//! Two robots in one world, each with nodes in its namespace, on one clock.

use fuyu::{
    bag::Bag,
    msg::{nav_msgs::Odometry, sensor_msgs::JointState},
};
use serde_json::{Value, json};
use std::path::Path;

use crate::{
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    observer::{JOINT_STATE, fresh},
    peer::Peer,
    process::{Check, Running, command, fuyu, read, source},
    waiting::{PATIENCE, eventually},
};

const CONFIG: &str = "config/two_servicers.yaml";
const CLOCK: &str = "rosgraph_msgs/msg/Clock";

/// Joint states and base odometry of both robots, without those that were published again to wake a late joiner.
fn runs(bag: &Path) -> Vec<(Vec<JointState>, Vec<Odometry>)> {
    let robots = ["/chaser1", "/chaser2"].into_iter();
    let robots = robots.map(|robot| {
        let mut joints = read::<JointState>(bag, &format!("{robot}/joint_states"));
        let mut bases = read::<Odometry>(bag, &format!("{robot}/ground_truth/odom"));
        joints.dedup();
        bases.dedup();
        (joints, bases)
    });
    robots.collect()
}

// Would break if a robot ran ahead of the other, if a state were lost, or if the second camera saw the first base late.
#[test]
fn a_launched_run_equals_the_simulated_one() {
    repeat_if_late(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let simulated = folder.path().join("bag");
        let output = simulated.to_str().expect("text");
        fuyu(&["simulate", CONFIG, "--duration", "8", "--output", output]).well();
        let mut launch = Running::launch(130, &source(CONFIG), &["--lockstep", "--duration", "8"]);
        let ended = launch.wait(5 * PATIENCE).well();
        println!("{}", ended.stdout);
        let (ours, theirs) = (runs(&simulated), runs(&launch.bag()));
        for (ours, theirs) in ours.iter().zip(&theirs) {
            assert_eq!((ours.0.len(), theirs.0.len()), (801, 801));
            assert!(ours == theirs, "the robots move differently");
        }
        let check = Check::of(&launch.bag());
        for robot in ["chaser1", "chaser2"] {
            for part in ["linear", "angular"] {
                let change = check.value(&format!("{robot}: {part} momentum"));
                assert!(change < 1e-13, "{robot} {part} {change}");
            }
        }
        let bag = Bag::open(launch.bag()).expect("a bag");
        let topics = bag.info().expect("an index").topics;
        let topics: Vec<_> = topics.into_iter().map(|topic| topic.name).collect();
        assert!(topics.contains(&"/chaser2/tf".to_owned()), "{topics:?}");
        assert!(!topics.contains(&"/tf".to_owned()), "{topics:?}");
        assert!(!topics.contains(&"/chaser2/clock".to_owned()), "{topics:?}");
    });
}

fn nanos(message: &Value) -> u64 {
    let stamp = if message["clock"].is_object() {
        &message["clock"]
    } else {
        &message["header"]["stamp"]
    };
    let part = |name: &str| stamp[name].as_u64().expect("a time");
    part("sec") * 1_000_000_000 + part("nanosec")
}

/// The dynamics node of a robot, as a process.
fn dynamics(robot: &str, domain: u16) -> Running {
    let mut dynamics = command("dynamics", domain);
    dynamics
        .args([
            "--ros-args",
            "-r",
            &format!("__ns:={robot}"),
            "--params-file",
        ])
        .arg(source(CONFIG))
        .args(["-r", "/tf:=tf", "-r", "/tf_static:=tf_static"])
        .args(["-p", "start_on_command:=false", "-p", "duration:=0.0"]);
    Running::start(dynamics)
}

fn call(peer: &mut Peer, robot: &str, service: &str, kind: &str, request: Value) -> Value {
    let answer = peer.does(json!({
        "do": "call", "service": format!("{robot}/dynamics/{service}"),
        "type": format!("simulation_interfaces/srv/{kind}"), "request": request,
    }));
    answer["response"]["result"].clone()
}

// Would break if the second robot had a time of its own: ran alone, went on while the first one is paused, or did not
// follow its reset.
#[test]
fn robots_in_two_processes_share_the_time_of_the_first() {
    repeat_if_late(|| {
        let domain = 131;
        let mut peer = peer_with_interfaces("operator", domain);
        peer.subscribe("/clock", CLOCK, "reliable");
        for robot in ["/chaser1", "/chaser2"] {
            peer.subscribe(&format!("{robot}/joint_states"), JOINT_STATE, "reliable");
        }
        let mut first = dynamics("/chaser1", domain);
        // It waits for the second robot.
        let clocks = fresh(&mut peer, "/clock", 12);
        assert!(clocks.iter().all(|clock| nanos(clock) == 0), "{clocks:?}");
        let second = dynamics("/chaser2", domain);
        let latest = |peer: &mut Peer, robot: &str| {
            let states = fresh(peer, &format!("{robot}/joint_states"), 1);
            nanos(states.last().expect("a state"))
        };
        eventually("time goes on for both", PATIENCE, || {
            (latest(&mut peer, "/chaser2") > 500_000_000).then_some(())
        });
        let (a, b) = (latest(&mut peer, "/chaser1"), latest(&mut peer, "/chaser2"));
        assert!(a.abs_diff(b) < 1_000_000_000, "{a} {b}");

        // Only the owner of the time can pause it.
        let paused = json!({"state": {"state": 2}});
        let refused = call(
            &mut peer,
            "/chaser2",
            "set_simulation_state",
            "SetSimulationState",
            paused.clone(),
        );
        assert_eq!(refused["result"], 3, "{refused}");
        let said = refused["error_message"].as_str().expect("text");
        assert!(said.contains("the robot /chaser1"), "{said}");
        let done = call(
            &mut peer,
            "/chaser1",
            "set_simulation_state",
            "SetSimulationState",
            paused,
        );
        assert_eq!(done["result"], 1, "{done}");
        eventually("both stand at the same time", PATIENCE, || {
            let times = ["/chaser1", "/chaser2", "/chaser1"].map(|robot| latest(&mut peer, robot));
            times.iter().all(|time| *time == times[0]).then_some(())
        });

        // A reset of the first one resets both.
        let reset = json!({"scope": 0});
        let refused = call(
            &mut peer,
            "/chaser2",
            "reset_simulation",
            "ResetSimulation",
            reset.clone(),
        );
        assert_eq!(refused["result"], 3, "{refused}");
        let done = call(
            &mut peer,
            "/chaser1",
            "reset_simulation",
            "ResetSimulation",
            reset,
        );
        assert_eq!(done["result"], 1, "{done}");
        eventually("both are at the start", PATIENCE, || {
            let times = ["/chaser1", "/chaser2"].map(|robot| latest(&mut peer, robot));
            (times == [0, 0]).then_some(())
        });
        let playing = json!({"state": {"state": 1}});
        let done = call(
            &mut peer,
            "/chaser1",
            "set_simulation_state",
            "SetSimulationState",
            playing,
        );
        assert_eq!(done["result"], 1, "{done}");
        eventually("time goes on again", PATIENCE, || {
            (latest(&mut peer, "/chaser2") > 100_000_000).then_some(())
        });

        // The first one goes on alone when the second one ends, and the second one catches up when it is back.
        second.signal("KILL");
        let before = latest(&mut peer, "/chaser1");
        eventually("the first one goes on", PATIENCE, || {
            (latest(&mut peer, "/chaser1") > before + 500_000_000).then_some(())
        });
        let _second = dynamics("/chaser2", domain);
        eventually("the second one catches up", PATIENCE, || {
            let times = ["/chaser1", "/chaser2"].map(|robot| latest(&mut peer, robot));
            (times[0].abs_diff(times[1]) < 500_000_000).then_some(())
        });
        first.interrupt().well();
    });
}
