//! The scenario whose base is held by wheels: in closed loop, its poles, and wrong input.

use serde_json::Value;

use super::fuyu::{Run, fuyu};

const CONFIG: &str = include_str!("../../config/attitude_hold.yaml");
const POLES: &str = include_str!("../../crates/fuyu-lti/tests/fixtures/flexible_dvdfb.json");

/// Runs a command on the scenario with `from` replaced by `to`.
fn run(command: &str, changes: &[(&str, &str)], options: &[&str]) -> Run {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.yaml");
    let mut text = CONFIG.to_owned();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    std::fs::write(&path, text).unwrap();
    let mut args = vec![command, path.to_str().unwrap()];
    args.extend(options);
    fuyu(&args)
}

fn json(run: &Run) -> Value {
    assert_eq!(run.code, 0, "{}", run.stderr);
    serde_json::from_str(&run.stdout).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    let list = value
        .as_array()
        .unwrap_or_else(|| panic!("no list: {value}"));
    list.iter().map(|x| x.as_f64().unwrap()).collect()
}

/// Turn of the base from its attitude at the start \[deg\].
fn turn(report: &Value) -> f64 {
    let q = numbers(&report["final"]["base_orientation"]);
    let [x, y, z, w] = q[..] else { panic!("{q:?}") };
    2.0 * (x * x + y * y + z * z).sqrt().atan2(w.abs()).to_degrees()
}

/// The scenario without its attitude controller.
fn free() -> (&'static str, &'static str) {
    let (_, rest) = CONFIG.split_once("attitude:\n").unwrap();
    let (node, _) = rest.split_once("recorder:").unwrap();
    let start = CONFIG.len() - rest.len() - "attitude:\n".len();
    let end = start + "attitude:\n".len() + node.len();
    (&CONFIG[start..end], "")
}

// Every law holds the base within some hundredths of a degree, with a gyro whose bias alone would turn it by 1.8 deg in
// 60 s. Left free, it turns by degrees.
#[test]
fn every_law_holds_the_base_while_the_tip_goes_to_its_goal() {
    let free = json(&run("simulate", &[free()], &["--json"]));
    println!("free: {:.3} deg", turn(&free));
    assert!(turn(&free) > 1.0, "{}", turn(&free));
    for law in ["dvdfb", "lqr", "hinf"] {
        let law_line = format!("law: {law}");
        let held = json(&run("simulate", &[("law: dvdfb", &law_line)], &["--json"]));
        println!("{law}: {:.4} deg", turn(&held));
        assert!(turn(&held) < 0.06, "{law}: {}", turn(&held));
        // Nothing outside has acted.
        for part in ["linear", "angular"] {
            let momentum = numbers(&held["final"]["momentum"][part]);
            assert!(momentum.iter().all(|x| x.abs() < 1e-9), "{momentum:?}");
        }
    }
}

#[test]
fn poles_are_those_of_the_independent_program() {
    let fixture: Value = serde_json::from_str(POLES).unwrap();
    for (posture, q) in [
        ("A", "0,0,0,0,0,0"),
        ("B", "0.3,0.8,-1.4,0.6,0.4,0"),
        ("C", "1.2,1.9,-2.2,-0.7,0.5,0.3"),
    ] {
        let report = json(&run("modes", &[], &["--q", q, "--json"]));
        let poles = report["poles"].as_array().unwrap();
        let poles: Vec<_> = poles.iter().map(numbers).collect();
        for expected in fixture[posture]["poles"].as_array().unwrap() {
            let expected = numbers(expected);
            let nearest = poles
                .iter()
                .map(|p| (p[0] - expected[0]).hypot(p[1] - expected[1]));
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-6, "{posture}: {expected:?} {nearest:e}");
        }
    }
    let text = run("modes", &[], &[]);
    assert!(
        text.stdout.contains("pole of the attitude loop"),
        "{}",
        text.stdout
    );
}

// Each is one line that names file, parameter, value and what would be right.
#[test]
fn wrong_attitude_parameters_are_refused_with_the_reason() {
    for (from, to, says) in [
        (
            "law: dvdfb",
            "law: pid",
            "'pid' is not one of dvdfb, lqr, hinf",
        ),
        (
            "p: [60.0, 60.0, 60.0]",
            "p: [60.0, 60.0]",
            "[60.0, 60.0] has 2 values, expected 3 values, one for each axis, or 9",
        ),
        (
            "p: [60.0, 60.0, 60.0]",
            "p: [60.0, 100.0, 0.0, -100.0, 60.0, 0.0, 0.0, 0.0, 60.0]",
            "it must be zero: the gain must be symmetric",
        ),
        (
            "d: [900.0, 900.0, 900.0]",
            "d: [900.0, 900.0, -900.0]",
            "smallest eigenvalue of D [N m s/rad] is -900; it must be positive",
        ),
        (
            "wheels: [wheel_x, wheel_y, wheel_z]",
            "wheels: [wheel_x, wheel_y]",
            "attitude control needs three or more whose axes span space",
        ),
        (
            "axis: [0.0, 0.0, 1.0]",
            "axis: [0.0, 1.0, 0.0]",
            "the wheels give no torque about one axis at least",
        ),
        (
            "target: [0.0, 0.0, 0.0, 1.0]",
            "target: [0.0, 0.0, 0.0, 0.5]",
            "parameter target: quaternion [0, 0, 0, 0.5] (x, y, z, w) has norm 0.5",
        ),
        (
            "min_on_time: 0.02",
            "min_on_time: 0.2",
            "thruster thruster_x1, min_on_time [s] is 0.2; it must be at most the control period",
        ),
        (
            "period: 0.1",
            "period: 0.1\n    unloading: {start: 0.2, stop: 0.5}",
            "parameter unloading.stop is 0.5; it must be above 0 and below unloading.start",
        ),
    ] {
        let refused = run("simulate", &[(from, to)], &[]);
        assert_eq!(refused.code, 2, "{to}: {}", refused.stderr);
        assert!(refused.stderr.contains(says), "{to}: {}", refused.stderr);
        assert_eq!(
            refused.stderr.trim().lines().count(),
            1,
            "{}",
            refused.stderr
        );
    }
}

// With ten seconds between steps the rate feedback overshoots: the warning names law, period and spectral radius.
#[test]
fn a_law_that_is_sampled_too_slowly_is_warned_of() {
    let run = run(
        "simulate",
        &[("period: 0.1", "period: 10.0")],
        &["--duration", "1"],
    );
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(
        run.stderr
            .contains("the law dvdfb with a period of 10 s makes the robot vibrate"),
        "{}",
        run.stderr
    );
}
