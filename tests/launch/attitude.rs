//! Attitude control in the graph: in real time with rclpy nodes in place of star tracker and attitude node, and a change of
//! law.

use fuyu::msg::{
    fuyu_msgs::{AppendageStates, AttitudeState, ThrusterCommands},
    geometry_msgs::QuaternionStamped,
    nav_msgs::Odometry,
    sensor_msgs::{Imu, JointState},
};
use serde_json::{Value, json};
use std::{fs, path::PathBuf, process::Command, thread, time::Duration};
use tempfile::TempDir;

use crate::{
    joining::peer_with_interfaces,
    lateness::repeat_if_late,
    observer::{DIAGNOSTICS, diagnosed, fresh, now, reported},
    peer::{DomainClaim, python},
    process::{Check, Running, fuyu, read, scenario, source},
    waiting::{PATIENCE, eventually},
};

pub const CONFIG: &str = "config/attitude_hold.yaml";
/// Simulated time of the runs, at real time \[s\].
const DURATION: &str = "40";

/// The scenario without its attitude node.
fn without_attitude() -> (TempDir, PathBuf) {
    without_nodes_from("attitude:\n")
}

/// The scenario without the nodes from one on, but with its recorder.
fn without_nodes_from(first: &str) -> (TempDir, PathBuf) {
    let text = fs::read_to_string(source(CONFIG)).expect("a scenario");
    let (before, after) = text.split_once(first).expect("the node");
    let (_, recorder) = after.split_once("recorder:\n").expect("the node after it");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("no_attitude.yaml");
    fs::write(&path, format!("{before}recorder:\n{recorder}")).expect("a file");
    (folder, path)
}

/// A program in Python next to this file.
fn program(name: &str, domain: u16) -> Running {
    let mut own = Command::new(python());
    own.arg(source(&format!("tests/launch/{name}")))
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env_remove("ROS_LOCALHOST_ONLY");
    Running::start(own)
}

/// Turns of the base from its attitude at the start in each of the states \[deg\].
fn turns(bag: &std::path::Path) -> Vec<f64> {
    let states = read::<Odometry>(bag, "/ground_truth/odom");
    let turn = |state: Odometry| {
        let q = state.pose.pose.orientation;
        let vector = (q.x * q.x + q.y * q.y + q.z * q.z).sqrt();
        2.0 * vector.atan2(q.w.abs()).to_degrees()
    };
    states.into_iter().map(turn).collect()
}

/// Launches the scenario in real time with a program in Python, and returns the largest turn of the base in the last ten
/// seconds \[deg\]. Nothing outside acts on the robot.
fn held_with(name: &str, domain: u16, config: &std::path::Path) -> (f64, Running) {
    let _domain = DomainClaim::new(domain);
    let mut launch = Running::launch(domain, config, &["--duration", DURATION]);
    let own = program(name, domain);
    let ended = launch.wait(Duration::from_secs(180));
    assert!(ended.code == Some(0), "{}\n{}", ended.stdout, ended.stderr);
    own.kill_running();
    let turns = turns(&launch.bag());
    let last = &turns[turns.len().saturating_sub(1000)..];
    let largest = last.iter().copied().fold(0.0, f64::max);
    let all = turns.iter().copied().fold(0.0, f64::max);
    println!(
        "{name}: {largest:.4} deg in the last 10 s of {} states, {all:.4} deg at most",
        turns.len()
    );
    let check = Check::of(&launch.bag());
    for part in ["linear momentum", "angular momentum"] {
        assert!(check.value(part) < 1e-12, "{part} {}", check.value(part));
    }
    (largest, launch)
}

// The attitude node finds bias and attitude from a star tracker in rclpy, late and noisy as the simulated one. Without its
// measurements the gyro's bias of 0.03 deg/s would turn the base by more than half a degree.
#[test]
fn a_star_tracker_in_rclpy_gives_the_attitude() {
    repeat_if_late(|| {
        let (_folder, config) = scenario(CONFIG, &[("      rate: 4.0\n", "      rate: 0.0\n")]);
        let (turn, launch) = held_with("own_star_tracker.py", 207, &config);
        assert!(turn < 0.1, "{turn} deg");
        let states = read::<AttitudeState>(&launch.bag(), "/attitude/state");
        let last = states.last().expect("a state");
        assert!(last.attitude_known && last.mode == "law", "{last:?}");
        assert!(
            last.star_tracker_age < 1.0 && last.outliers == 0,
            "{last:?}"
        );
        let bias = &last.gyro_bias;
        // That of the scenario.
        for (found, true_bias) in [(bias.x, 4e-4), (bias.y, -3e-4), (bias.z, 2e-4)] {
            assert!((found - true_bias).abs() < 5e-5, "{bias:?}");
        }
    });
}

// Left free, the base turns by more than a degree while the tip goes to its goal.
#[test]
fn a_wheel_commander_in_rclpy_holds_the_base() {
    repeat_if_late(|| {
        let (_folder, config) = without_attitude();
        let (turn, launch) = held_with("own_wheel_commander.py", 208, &config);
        assert!(turn < 0.2, "{turn} deg");
        let bag = launch.bag();
        assert!(read::<AttitudeState>(&bag, "/attitude/state").is_empty());
        let wheels = read::<JointState>(&bag, "/wheel_states");
        let fastest = wheels.iter().flat_map(|state| &state.velocity);
        let fastest = fastest.fold(0.0_f64, |most, speed| most.max(speed.abs()));
        assert!(fastest > 1.0, "the wheels took momentum: {fastest} rad/s");
    });
}

fn set_law(peer: &mut crate::peer::Peer, law: &str) -> Value {
    let set = json!({"do": "set_parameters", "node": "/attitude", "values": [["law", law]]});
    peer.does(set)["response"]["results"][0].clone()
}

// Would break if the torque jumped, if the law changed in name only, or if a law that does not exist were taken.
#[test]
fn laws_are_changed_while_the_base_is_held() {
    repeat_if_late(|| {
        let domain = 209;
        let mut launch = Running::launch(domain, &source(CONFIG), &["--duration", "600"]);
        let mut peer = peer_with_interfaces("operator", domain);
        peer.subscribe("attitude/state", "fuyu_msgs/msg/AttitudeState", "reliable");
        peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
        let services = ["/attitude/set_parameters"];
        peer.graph("attitude", "/", &json!({ "services": services }));
        fresh(&mut peer, "attitude/state", 20);
        for law in ["lqr", "hinf", "dvdfb"] {
            let result = set_law(&mut peer, law);
            assert_eq!(result["successful"], true, "{law}: {result}");
            eventually("the law", PATIENCE, || {
                let state = fresh(&mut peer, "attitude/state", 1).pop()?;
                (state["law"] == law).then_some(())
            });
            let stable = diagnosed(&mut peer, "attitude: law", |level, text| {
                level == 0 && text.starts_with(law)
            });
            println!("{stable}");
            fresh(&mut peer, "attitude/state", 30);
        }
        let refused = set_law(&mut peer, "pid");
        assert_eq!(refused["successful"], false, "{refused}");
        let reason = refused["reason"].as_str().expect("text");
        assert!(reason.contains("dvdfb, lqr, hinf"), "{reason}");
        launch.interrupt().well();

        let bag = launch.bag();
        let states = read::<AttitudeState>(&bag, "/attitude/state");
        let torque = |s: &AttitudeState| [s.law_torque.x, s.law_torque.y, s.law_torque.z];
        let change = |pair: &[AttitudeState]| {
            let (a, b) = (torque(&pair[0]), torque(&pair[1]));
            (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max)
        };
        let same = states
            .windows(2)
            .skip(50)
            .filter(|pair| pair[0].law == pair[1].law);
        let usual = same.map(change).fold(0.0, f64::max);
        let at_changes = states.windows(2).filter(|pair| pair[0].law != pair[1].law);
        let at_changes: Vec<_> = at_changes.map(change).collect();
        println!(
            "torque changes by {at_changes:?} N m at changes of law, by {usual:.3} N m at most otherwise"
        );
        assert_eq!(at_changes.len(), 3);
        assert!(
            at_changes.iter().all(|change| *change < 1e-9),
            "{at_changes:?}"
        );
        let largest = turns(&bag).into_iter().fold(0.0, f64::max);
        println!("largest turn {largest:.4} deg");
        assert!(largest < 0.3, "{largest} deg");
    });
}

// Without a controller nobody answers the first state, which is therefore published again and again, while torques of the wheels
// come. Fails if they change the acceleration that the accelerometer has measured.
#[test]
fn a_state_that_is_published_again_has_the_same_measurements() {
    let (_folder, config) = without_nodes_from("controller:\n");
    let mut launch = Running::launch(215, &config, &["--lockstep"]);
    let mut peer = peer_with_interfaces("wheels", 215);
    peer.subscribe("imu", "sensor_msgs/msg/Imu", "reliable");
    eventually("states", PATIENCE, || peer.receive("imu", 1).pop());
    peer.subscribe("diagnostics", DIAGNOSTICS, "reliable");
    let torque = json!({
        "do": "publish", "topic": "wheel_commands", "type": "sensor_msgs/msg/JointState",
        "message": {"name": ["wheel_x", "wheel_y", "wheel_z"], "effort": [10.0, 0.0, 0.0]},
    });
    let since = now();
    // The first message of a publisher may come three seconds late (docs/upstream.md).
    eventually("a torque acts", PATIENCE, || {
        peer.does(torque.clone());
        let part = "dynamics: wheels and thrusters";
        reported(&mut peer, part, since, 0.2, |level, text| {
            level == 0 && text == "obeying commands"
        })
    });
    for _ in 0..10 {
        peer.does(torque.clone());
        thread::sleep(Duration::from_millis(200));
    }
    launch.interrupt();
    let bag = launch.bag();
    assert!(!read::<JointState>(&bag, "/wheel_commands").is_empty());
    let measured = read::<Imu>(&bag, "/imu");
    assert!(measured.len() > 15, "{}", measured.len());
    let is_first = |imu: &Imu| imu.header.stamp.nanos() == 0;
    assert!(measured.iter().all(is_first), "time has advanced");
    assert!(
        measured.windows(2).all(|pair| pair[0] == pair[1]),
        "{measured:?}"
    );
}

/// Whether all messages of a topic are those of the simulated run; an isolated recorder may miss the first ones.
fn same<M: fuyu::msg::Interface + PartialEq + std::fmt::Debug>(
    [simulated, launched]: [&std::path::Path; 2],
    topic: &str,
    is_complete: bool,
) {
    let [mut ours, mut theirs] = [simulated, launched].map(|bag| read::<M>(bag, topic));
    ours.dedup();
    theirs.dedup();
    let (all, recorded) = (ours.len(), theirs.len());
    println!("{topic}: {recorded} of {all} messages");
    assert!(
        recorded == all || !is_complete && (all / 2..=all).contains(&recorded),
        "{topic}"
    );
    // Each in its order.
    let mut ours = ours.iter();
    for theirs in &theirs {
        assert!(ours.any(|ours| ours == theirs), "{topic}: {theirs:?}");
    }
}

// Sensors, torques, wheels, base and what the controller reports: bit-identical, also with every message over DDS.
#[test]
fn a_lockstep_run_equals_the_simulated_one_on_every_topic() {
    repeat_if_late(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let simulated = folder.path().join("bag");
        let output = simulated.to_str().expect("text");
        fuyu(&["simulate", CONFIG, "--duration", "12", "--output", output]).well();
        for isolated in [false, true] {
            let mut args = vec!["--lockstep", "--duration", "12"];
            if isolated {
                args.push("--isolated");
            }
            let mut launch = Running::launch(214, &source(CONFIG), &args);
            launch.wait(5 * PATIENCE).well();
            let launched = launch.bag();
            let bags = [simulated.as_path(), launched.as_path()];
            same::<JointState>(bags, "/joint_states", !isolated);
            same::<JointState>(bags, "/wheel_states", !isolated);
            same::<JointState>(bags, "/wheel_commands", !isolated);
            same::<ThrusterCommands>(bags, "/thruster_commands", !isolated);
            same::<QuaternionStamped>(bags, "/star_tracker", !isolated);
            same::<Imu>(bags, "/imu", !isolated);
            same::<AttitudeState>(bags, "/attitude/state", !isolated);
            same::<AppendageStates>(bags, "/ground_truth/appendages", !isolated);
            same::<Odometry>(bags, "/ground_truth/odom", !isolated);
        }
    });
}
