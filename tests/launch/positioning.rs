//! The positioning run of Masutani 1995 chapter 5: simulated, and over DDS in real time.

use fuyu::{
    msg::{geometry_msgs::PoseStamped, nav_msgs::Odometry},
    nodes::geometry::{pose_from_msg, with_matrix},
    spatial::{Pose, roll_pitch_yaw_intrinsic},
};
use nalgebra::Vector3;
use std::{collections::BTreeMap, fs, path::Path, process::Command};

use crate::{
    lateness::repeat_if_late,
    peer::python,
    process::{Check, Running, fuyu, read, scenario, source},
    waiting::PATIENCE,
};

const CONFIG: &str = "config/positioning.yaml";
/// The scenario's goal in the world \[m\].
const GOAL: [f64; 3] = [3.662078985521887, 5.4440225463358125, 0.37996776327278203];
/// Results of an independent simulation with a continuous law.
const SETTLED: f64 = 33.9;
const DISPLACEMENT: [f64; 3] = [-0.018847, -0.064008, 0.035397];
const ATTITUDE_DEG: [f64; 3] = [15.5028, -11.1076, -2.7442];

fn assert_near(what: &str, ours: [f64; 3], reference: [f64; 3], ratio: f64) {
    let (ours, reference) = (Vector3::from(ours), Vector3::from(reference));
    let off = (ours - reference).norm() / reference.norm();
    println!("{what} {:?}: off by {:.3} %", ours.as_slice(), 100.0 * off);
    assert!(off < ratio, "{what} {ours} is off by {off}");
}

/// Deviation of the tip from the goal \[m\] over time, and the base's first and last pose, from what the
/// graph published: base pose and the camera's tip pose of the same stamp.
fn run(bag: &Path) -> (Vec<(f64, f64)>, Pose, Pose) {
    let seconds = |stamp: &fuyu::msg::builtin_interfaces::Time| {
        f64::from(stamp.sec) + 1e-9 * f64::from(stamp.nanosec)
    };
    let pose = |pose| with_matrix(&pose_from_msg(pose).expect("a pose"));
    let bases = read::<Odometry>(bag, "/ground_truth/odom");
    let tips = read::<PoseStamped>(bag, "/camera/tip_pose");
    let tips: BTreeMap<_, _> = tips
        .iter()
        .map(|tip| ((tip.header.stamp.sec, tip.header.stamp.nanosec), tip))
        .collect();
    let goal = Vector3::from(GOAL);
    let errors = bases.iter().filter_map(|base| {
        let stamp = &base.header.stamp;
        let tip = tips.get(&(stamp.sec, stamp.nanosec))?;
        let X_WE = pose(&base.pose.pose) * pose(&tip.pose);
        Some((seconds(stamp), (X_WE.translation.vector - goal).norm()))
    });
    let errors: Vec<_> = errors.collect();
    let first = pose(&bases.first().expect("bases").pose.pose);
    let last = pose(&bases.last().expect("bases").pose.pose);
    (errors, first, last)
}

/// Counts and decoding by independent readers.
fn python_reads(bag: &Path) {
    let script = source("tests/bags/read_bag.py");
    let output = Command::new(python())
        .arg(script)
        .arg(bag)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let info = fuyu(&["bag", "info", "--json", bag.to_str().unwrap()])
        .well()
        .json();
    let counts: serde_json::Map<_, _> = info["topics"]
        .as_array()
        .unwrap()
        .iter()
        // Other readers do not list topics without messages.
        .filter(|topic| topic["count"] != 0)
        .map(|topic| {
            (
                topic["name"].as_str().unwrap().to_owned(),
                topic["count"].clone(),
            )
        })
        .collect();
    assert_eq!(report["rosbags"], serde_json::Value::from(counts.clone()));
    assert_eq!(report["mcap"], serde_json::Value::from(counts.clone()));
    assert_eq!(report["undecoded"], serde_json::json!([]));
    println!("rosbags and mcap agree with fuyu on {counts:?}");
}

#[test]
fn in_real_time_it_is_the_run_of_the_thesis() {
    repeat_if_late(|| {
        // At the same time, since each takes a minute.
        let mut shared = Running::launch(70, &source(CONFIG), &[]);
        let mut isolated = Running::launch(57, &source(CONFIG), &["--isolated"]);
        // 60 s at 100 Hz, nothing lost.
        in_real_time(&mut shared, 6000);
        // An isolated recorder may be discovered after the first states.
        in_real_time(&mut isolated, 5900);
    });
}

/// A run with at least so many states in its bag.
fn in_real_time(launch: &mut Running, states: usize) {
    let ended = launch.wait(5 * PATIENCE).well();
    println!("{}", ended.stdout);
    let bag = launch.bag();
    let (errors, first, last) = run(&bag);
    assert!(errors.len() >= states, "{}", errors.len());

    let within = errors
        .iter()
        .rposition(|(_, e)| *e > 0.01)
        .map(|i| errors[i + 1].0);
    let within = within.expect("it starts far away");
    println!(
        "within 1 cm after {within:.2} s, {:.2e} m at the end",
        errors.last().unwrap().1
    );
    assert!((within / SETTLED - 1.0).abs() < 0.02, "{within}");
    assert!(errors.last().unwrap().1 < 1e-3);
    let moved = last.translation.vector - first.translation.vector;
    assert_near("displacement", moved.into(), DISPLACEMENT, 0.02);
    let angles = roll_pitch_yaw_intrinsic(&last.rotation).map(f64::to_degrees);
    assert_near("attitude", angles, ATTITUDE_DEG, 0.02);

    let check = Check::of(&bag);
    assert!(check.passed, "{:?}", check.failed());
    check.momentum_holds();
    python_reads(&bag);
    for line in [
        "positioning",
        "tip position error",
        "real-time factor",
        "momentum residual",
    ] {
        assert!(ended.stdout.contains(line), "{line} in {}", ended.stdout);
    }
}

#[test]
fn simulated_it_is_the_run_of_the_thesis_and_the_same_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let simulate = |name: &str| {
        // A bag holds its own name.
        let output = folder.path().join(name).join("bag");
        let output = output.to_str().unwrap();
        let args = ["simulate", CONFIG, "--json", "--output", output];
        let mut json = fuyu(&args).well().json();
        json.as_object_mut().unwrap().remove("wall_time").unwrap();
        let files = fs::read_dir(output).unwrap().map(|f| f.unwrap().path());
        let files = files.map(|file| {
            (
                file.file_name().unwrap().to_owned(),
                fs::read(file).unwrap(),
            )
        });
        let files: BTreeMap<_, _> = files.collect();
        assert_eq!(files.len(), 2, "metadata.yaml and one MCAP file");
        (json, files)
    };
    let (json, bag) = simulate("one");
    let number = |key: &str| json[key].as_f64().unwrap();
    let list = |key: &str| {
        let list: [f64; 3] = serde_json::from_value(json[key].clone()).unwrap();
        list
    };
    assert!((number("time_to_1cm") - SETTLED).abs() < 0.2, "{json}");
    assert!(number("tip_position_error") < 1e-3, "{json}");
    assert_near(
        "displacement",
        list("base_displacement"),
        DISPLACEMENT,
        0.01,
    );
    let angles = list("base_attitude_rpy").map(f64::to_degrees);
    assert_near("attitude", angles, ATTITUDE_DEG, 0.01);

    let (again, same) = simulate("two");
    assert_eq!(json, again);
    assert!(bag == same, "the bags differ");
    let check = Check::of(&folder.path().join("one/bag"));
    assert!(check.passed, "{:?}", check.failed());
    check.momentum_holds();
    python_reads(&folder.path().join("one/bag"));
}

/// The base turns away under an arm that follows joint angles: the tip ends far from the goal.
#[test]
fn joint_pd_misses() {
    let (_folder, config) = scenario(CONFIG, &[("law: transpose_jacobian", "law: joint_pd")]);
    let json = fuyu(&["simulate", config.to_str().unwrap(), "--json"])
        .well()
        .json();
    let miss = json["tip_position_error"].as_f64().unwrap();
    assert!((miss / 0.93 - 1.0).abs() < 0.02, "{miss}");
    assert!(json["time_to_1cm"].is_null());
}
