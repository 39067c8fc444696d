//! A user's controller in Python, `own_controller.py`, instead of fuyu's.

use fuyu::{
    dynamics::Workspace,
    model::Model,
    msg::{nav_msgs::Odometry, sensor_msgs::JointState, std_msgs},
    nodes::geometry::{pose_from_msg, with_matrix},
    spatial::Pose,
};
use nalgebra::{DVector, Point3, Vector3};
use std::{collections::BTreeMap, fs, process::Command};

use crate::{
    lateness::repeat_if_late,
    observer::{JOINT_STATE, fresh, numbers},
    peer::{Peer, python},
    process::{Check, Running, read, source},
    waiting::{PATIENCE, eventually},
};

/// Joint positions to which `own_controller.py` moves the arm \[rad\].
const POSTURE: [f64; 6] = [1.2, 1.5, -1.4, -0.2, 0.2, -0.5];

fn stamp(header: &std_msgs::Header) -> (i32, u32) {
    (header.stamp.sec, header.stamp.nanosec)
}

/// The positioning run without a controller.
pub fn without_controller() -> (tempfile::TempDir, std::path::PathBuf) {
    let text = fs::read_to_string(source("config/positioning.yaml")).unwrap();
    let (before, after) = text.split_once("controller:\n").unwrap();
    let (_, recorder) = after.split_once("recorder:\n").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("no_controller.yaml");
    fs::write(&path, format!("{before}recorder:\n{recorder}")).unwrap();
    (folder, path)
}

#[test]
fn a_python_node_replaces_the_controller() {
    repeat_if_late(|| {
        let domain = 76;
        let (_folder, config) = without_controller();
        let mut launch = Running::launch(domain, &config, &["--duration", "600"]);
        let mut peer = Peer::start("observer", domain);
        peer.subscribe("joint_states", JOINT_STATE, "reliable");
        // Simulated time waits for the first command.
        let state = &peer.receive("joint_states", 1)[0]["message"];
        assert_eq!(state["header"]["stamp"]["sec"], 0, "{state}");
        let mut own = Command::new(python());
        own.arg(source("tests/launch/own_controller.py"))
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        let own = Running::start(own);
        eventually(
            "the joints are where the program wants them",
            5 * PATIENCE,
            || {
                let state = fresh(&mut peer, "joint_states", 1).pop()?;
                let off = numbers(&state["position"]);
                let off = off.iter().zip(POSTURE).map(|(q, goal)| (q - goal).abs());
                (off.fold(0.0, f64::max) < 5e-3).then_some(())
            },
        );
        launch.interrupt().well();
        own.kill_running();

        let bag = launch.bag();
        assert!(
            read::<fuyu::msg::fuyu_msgs::ControllerState>(&bag, "/controller/state").is_empty()
        );
        Check::of(&bag).momentum_holds();
        // The base moves opposite to the tip, while the centre of mass of the whole system stays at rest.
        let description = read::<std_msgs::String>(&bag, "/robot_description");
        let model = Model::from_urdf(&description[0].data, "robot_description").unwrap();
        let (states, bases) = (
            read::<JointState>(&bag, "/joint_states"),
            read::<Odometry>(&bag, "/ground_truth/odom"),
        );
        let mut workspace = Workspace::new(&model);
        let mut place =
            |state: &JointState, base: &Odometry| -> (Vector3<f64>, Vector3<f64>, Pose) {
                workspace.set_positions(&DVector::from_row_slice(&state.position));
                let X_WB = with_matrix(&pose_from_msg(&base.pose.pose).unwrap());
                let tip = X_WB * workspace.X_BF(model.frame("tool0").unwrap());
                let com = X_WB * Point3::from(*workspace.p_BC());
                (com.coords, tip.translation.vector, X_WB)
            };
        // Match by stamp: the recorder discovers one topic before the other, and a state that waits for a command is
        // published repeatedly.
        let bases: BTreeMap<_, _> = bases.iter().map(|b| (stamp(&b.header), b)).collect();
        let mut both = states
            .iter()
            .filter_map(|s| Some((s, *bases.get(&stamp(&s.header))?)));
        let (first, last) = (
            both.next().expect("a state"),
            both.next_back().expect("more"),
        );
        let (com_before, tip_before, base_before) = place(first.0, first.1);
        let (com_after, tip_after, base_after) = place(last.0, last.1);
        let base = base_after.translation.vector - base_before.translation.vector;
        let tip = tip_after - tip_before;
        println!("base {:?} m, tip {:?} m", base.as_slice(), tip.as_slice());
        assert!(base.norm() > 1e-3 && tip.norm() > 0.1);
        assert!(base.dot(&tip) < 0.0);
        assert!((com_after - com_before).norm() < 1e-9);
    });
}

/// The largest joint rate \[rad/s\] in two seconds with a controller that responds after 50 ms. Its damping is unstable
/// for delays above 20 ms.
fn largest_rate_under_a_late_controller(domain: u16, answer_timeout: &str) -> f64 {
    let (_folder, config) = without_controller();
    let timeout = format!("dynamics:answer_timeout:={answer_timeout}");
    let args = ["--duration", "2", "--ros-args", "-p", &timeout];
    let mut launch = Running::launch(domain, &config, &args);
    let mut own = Command::new(python());
    own.arg(source("tests/launch/own_controller.py"))
        .args(["--ros-args", "-p", "delay:=0.05"])
        .args(["-p", "damping:=[400.0, 100.0, 200.0, 10.0, 2.0, 2.0]"])
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
    let own = Running::start(own);
    launch.wait(5 * PATIENCE);
    own.kill_running();
    let states = read::<JointState>(&launch.bag(), "/joint_states");
    let rates = states.iter().flat_map(|s| &s.velocity);
    rates.fold(0.0, |most, rate| rate.abs().max(most))
}

#[test]
fn time_waits_for_a_controller_that_is_late() {
    repeat_if_late(|| {
        let rate = largest_rate_under_a_late_controller(96, "0.5");
        println!("largest rate {rate} rad/s");
        assert!(rate < 1.0, "{rate}");
        // Without `answer_timeout` simulated time does not wait, and the joint rates diverge.
        let rate = largest_rate_under_a_late_controller(97, "0.0");
        println!("without patience {rate} rad/s");
        assert!(rate > 10.0, "{rate}");
    });
}
