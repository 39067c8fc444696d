//! The programs in `examples/`: short, compiled, and run as a reader would.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::OnceLock,
};

use crate::fuyu::fuyu;

/// The folder of the compiled examples. Cargo has compiled them for `cargo test`; this does it where a test was selected
/// by the name of its executable.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let test = std::env::current_exe().expect("the path of this test");
        // target/PROFILE/deps/cli-HASH
        let built = test.ancestors().nth(2).expect("a folder of the profile");
        let profile = built.file_name().and_then(|p| p.to_str()).expect("text");
        let profile = if profile == "debug" { "dev" } else { profile };
        let status = Command::new(env!("CARGO"))
            .args(["build", "--offline", "--locked", "--examples"])
            .args(["--profile", profile, "--target-dir"])
            .arg(built.parent().expect("a target folder"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .status();
        assert!(status.expect("cargo can be started").success());
        built.join("examples")
    })
}

/// Runs an example in the workspace's folder.
fn run(example: &str, args: &[&str]) -> Output {
    let mut command = Command::new(folder().join(example));
    command.args(args).current_dir(env!("CARGO_MANIFEST_DIR"));
    command.output().expect("the example can be started")
}

/// What an example prints; it must succeed.
fn printed(example: &str, args: &[&str]) -> String {
    let output = run(example, args);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{example}: {errors}");
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn a_robot_of_ones_own_has_a_generalized_jacobian() {
    let text = printed("own_robot", &[]);
    assert!(text.contains("satellite: 2 joints, 120 kg"), "{text}");
    assert!(text.contains("generalized Jacobian of tool0"), "{text}");
    let text = printed("own_robot", &["urdf/dual_arm.urdf", "left_tool"]);
    assert!(text.contains("14 joints"), "{text}");
    let output = run("own_robot", &["urdf/servicer.urdf", "nowhere"]);
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn a_captured_satellite_is_stopped() {
    let text = printed("capture", &[]);
    assert!(text.contains("latched, "), "{text}");
    assert!(text.contains("left after 99 % of it: 1.00 %"), "{text}");
}

#[test]
fn monte_carlo_prints_quantiles_in_order() {
    let text = printed("monte_carlo", &[]);
    let turns: Vec<f64> = (text.lines())
        .filter_map(|line| line.split("less than ").nth(1)?.split(' ').next())
        .map(|turn| turn.parse().expect("a number"))
        .collect();
    assert_eq!(turns.len(), 3, "{text}");
    assert!(turns[0] > 0.0 && turns.is_sorted(), "{text}");
}

#[test]
fn a_law_of_ones_own_brings_the_tip_to_its_goal() {
    let text = printed("own_law", &[]);
    let distance = text
        .split(" m from")
        .next()
        .and_then(|t| t.rsplit(' ').next());
    let distance: f64 = distance.and_then(|d| d.parse().ok()).expect("a distance");
    assert!(distance < 0.01, "{text}");
}

#[test]
fn a_node_of_ones_own_runs_until_it_is_interrupted() {
    let output = Command::new("timeout")
        // In the foreground: otherwise the signal also goes to the process group, and arrives twice.
        .args(["--foreground", "--preserve-status", "--signal=INT", "10"])
        .arg(folder().join("own_node"))
        .env("ROS_DOMAIN_ID", "102")
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .output()
        .expect("timeout is there");
    let log = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{log}");
    let output = run("own_node", &["--ros-args", "-p", "rate:=-1.0"]);
    let log = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{log}");
    assert!(log.contains("rate"), "{log}");
}

#[test]
fn a_bag_is_read_and_plotted() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (bag, pictures) = (path("bag"), path("."));
    let scenario = "config/positioning.yaml";
    let simulated = fuyu(&["simulate", scenario, "--duration", "2", "--output", &bag]);
    assert_eq!(simulated.code, 0, "{}", simulated.stderr);
    let text = printed("plot_bag", &[&bag, &pictures]);
    assert!(
        text.contains("/joint_states (sensor_msgs/msg/JointState)"),
        "{text}"
    );
    for name in ["joints.svg", "joints.png"] {
        assert!(fs::metadata(path(name)).is_ok_and(|file| file.len() > 1000));
    }
}

#[test]
fn examples_have_at_most_60_lines_and_are_all_run() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    for entry in fs::read_dir(folder).expect("examples") {
        let path = entry.expect("a file").path();
        let lines = fs::read_to_string(&path).expect("text").lines().count();
        assert!(lines <= 60, "{} has {lines} lines", path.display());
        let name = path.file_stem().and_then(|n| n.to_str()).expect("a name");
        let this = include_str!("examples.rs");
        assert!(this.contains(&format!("\"{name}\"")), "{name} is not run");
    }
}
