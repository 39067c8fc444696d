//! Robots with flexible parts in scenarios: motions and vibration against an independent program, and wrong input.

use std::path::Path;

use nalgebra::{Rotation3, Unit, Vector3};
use serde_json::Value;

use super::fuyu::{Run, fuyu};

pub const CONFIG: &str = include_str!("../../config/flexible_servicer.yaml");
pub const SERVICER: &str = include_str!("../../urdf/servicer.urdf");
pub const RUNS: &str =
    include_str!("../../crates/fuyu-physics/tests/flexible/fixtures/flexible_panels_runs.json");
const LINEAR: &str =
    include_str!("../../crates/fuyu-structures/tests/fixtures/flexible_panels_linear.json");
/// Postures of the fixtures.
pub const POSTURES: [(&str, [f64; 6]); 3] = [
    ("A", [0.0; 6]),
    ("B", [0.3, 0.8, -1.4, 0.6, 0.4, 0.0]),
    ("C", [1.2, 1.9, -2.2, -0.7, 0.5, 0.3]),
];

/// The scenario without its wheels, which the fixtures do not have.
pub fn without_wheels() -> String {
    let (before, rest) = CONFIG.split_once("    wheels:").unwrap();
    let (_, after) = rest.split_once("recorder:").unwrap();
    format!("{before}recorder:{after}")
}

/// `text` with `from`, which it contains, replaced by `to`.
pub fn with(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from}");
    text.replace(from, to)
}

/// Turns both panels by `alpha` \[rad\] about the base's x axis.
pub fn turned(text: &str, alpha: f64) -> String {
    let plus = "origin_xyz: [1.2, 0.0, 0.0]";
    let text = with(
        text,
        plus,
        &format!("{plus}\n      origin_rpy: [{alpha:?}, 0.0, 0.0]"),
    );
    let minus = |roll: f64| format!("origin_rpy: [{roll:?}, 0.0, 3.141592653589793]");
    // Rx(alpha) Rz(pi) = Rz(pi) Rx(-alpha).
    with(&text, &minus(0.0), &minus(-alpha))
}

/// Runs a command on a scenario in a folder with `robot.urdf`.
pub fn run(command: &str, scenario: &str, urdf: &str, options: &[&str]) -> Run {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.yaml");
    std::fs::write(folder.path().join("robot.urdf"), urdf).unwrap();
    std::fs::write(&path, scenario).unwrap();
    run_at(command, &path, options)
}

fn run_at(command: &str, path: &Path, options: &[&str]) -> Run {
    let mut args = vec![command, path.to_str().unwrap()];
    args.extend(options);
    fuyu(&args)
}

/// The servicer with its joints fixed at `q`.
pub fn locked(q: &[f64]) -> String {
    let mut parts = SERVICER.split(r#"type="continuous">"#);
    let mut out = parts.next().unwrap().to_owned();
    for (part, q) in parts.zip(q) {
        let numbers = |element: &str, attribute: &str| -> Vec<f64> {
            let at = part.find(element).unwrap();
            let of_element = &part[at..];
            let (_, value) = of_element.split_once(&format!("{attribute}=\"")).unwrap();
            let (value, _) = value.split_once('"').unwrap();
            value
                .split_whitespace()
                .map(|x| x.parse().unwrap())
                .collect()
        };
        let (rpy, axis) = (numbers("<origin", "rpy"), numbers("<axis", "xyz"));
        let axis = Unit::new_normalize(Vector3::from_column_slice(&axis));
        let turned = Rotation3::from_euler_angles(rpy[0], rpy[1], rpy[2])
            * Rotation3::from_axis_angle(&axis, *q);
        let (r, p, y) = turned.euler_angles();
        let (before, rest) = part.split_once("rpy=\"").unwrap();
        let (_, rest) = rest.split_once('"').unwrap();
        let (to_axis, rest) = rest.split_once("<axis").unwrap();
        let (_, after_axis) = rest.split_once("/>").unwrap();
        out += &format!("type=\"fixed\">{before}rpy=\"{r:?} {p:?} {y:?}\"{to_axis}{after_axis}");
    }
    out
}

pub fn numbers(value: &Value) -> Vec<f64> {
    let list = value
        .as_array()
        .unwrap_or_else(|| panic!("no list: {value}"));
    list.iter().map(|x| x.as_f64().unwrap()).collect()
}

pub fn difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f64::max)
}

/// Last sample of a fixture's run.
pub fn last(run: &Value, key: &str) -> Vec<f64> {
    numbers(run[key].as_array().unwrap().last().unwrap())
}

/// The servicer with the joint damping of the fixtures' runs.
pub fn damped() -> String {
    let mut parts = SERVICER.split(r#"type="continuous">"#);
    let mut urdf = parts.next().unwrap().to_owned();
    for (part, damping) in parts.zip([20.0, 40.0, 30.0, 4.0, 1.0, 0.1]) {
        urdf += &format!(r#"type="continuous"><dynamics damping="{damping}"/>{part}"#);
    }
    urdf
}

/// Largest difference of the joints' positions and rates at the end of a run from the fixture.
pub fn joint_error(report: &Value, fixture: &Value) -> f64 {
    let errors = ["q", "qd"].map(|key| {
        let names = (1..=6).map(|j| format!("joint{j}"));
        let found: Vec<f64> = names
            .map(|name| report["final"][key][&name].as_f64().unwrap())
            .collect();
        difference(&found, &last(fixture, key))
    });
    println!("joints: {errors:?}");
    errors[0].max(errors[1])
}

/// Compares base, modes and momentum at the end of a run with the fixture: attitude and position to `pose`, modal
/// coordinates and energies to `modes`, rates to ten times as much.
pub fn compare(report: &Value, fixture: &Value, pose: f64, modes: f64) {
    let found = &report["final"];
    assert_eq!(found["time"].as_f64(), Some(30.0));
    let mut mu = numbers(&found["appendages"]["solar_plus"]["mu"]);
    mu.extend(numbers(&found["appendages"]["solar_minus"]["mu"]));
    let mut mud = numbers(&found["appendages"]["solar_plus"]["mud"]);
    mud.extend(numbers(&found["appendages"]["solar_minus"]["mud"]));
    for (key, found, expected, tolerance) in [
        (
            "attitude",
            numbers(&found["base_orientation"]),
            "base_quaternion_xyzw",
            pose,
        ),
        (
            "position",
            numbers(&found["base_position"]),
            "base_position",
            pose,
        ),
        (
            "velocity",
            numbers(&found["base_velocity"]),
            "base_velocity_world",
            10.0 * pose,
        ),
        (
            "angular velocity",
            numbers(&found["base_angular_velocity"]),
            "base_angular_velocity_world",
            10.0 * pose,
        ),
        ("modes", mu, "mu", modes),
        ("modal rates", mud, "mud", 10.0 * modes),
        (
            "linear momentum",
            numbers(&found["momentum"]["linear"]),
            "P",
            1e-10,
        ),
        (
            "angular momentum",
            numbers(&found["momentum"]["angular"]),
            "L_com",
            1e-10,
        ),
    ] {
        let mut error = difference(&found, &last(fixture, expected));
        if key == "attitude" {
            // The same attitude has two quaternions.
            let negated: Vec<f64> = found.iter().map(|x| -x).collect();
            error = error.min(difference(&negated, &last(fixture, expected)));
        }
        println!("{key}: {error:.1e}");
        assert!(error < tolerance, "{key}: {error:e}");
    }
    for (key, expected) in [("kinetic_energy", "kinetic"), ("strain_energy", "strain")] {
        let expected = fixture[expected].as_array().unwrap().last().unwrap();
        let error = found[key].as_f64().unwrap() - expected.as_f64().unwrap();
        println!("{key}: {error:.1e} J");
        assert!(error.abs() < modes, "{key}: {error:e}");
    }
    assert!(report["momentum_residual"]["angular"].as_f64().unwrap() < 1e-12);
    assert_eq!(report["events"], Value::Array(Vec::new()));
}

// Joints locked, released from rest with bent panels. Would break if modal coordinates were those of the other panel, or if the
// start gave momentum to the robot.
#[test]
fn bent_panels_released_on_a_locked_robot_move_as_in_the_independent_run() {
    let q = "    initial_joint_positions: [0.3, 0.8, -1.4, 0.6, 0.4, 0.0]\n";
    let scenario = with(&without_wheels(), q, "");
    let scenario = with(&scenario, "package://fuyu/urdf/servicer.urdf", "robot.urdf");
    let urdf = locked(&POSTURES[1].1);
    let report = run("simulate", &scenario, &urdf, &["--json"]).json();
    let runs: Value = serde_json::from_str(RUNS).unwrap();
    compare(&report, &runs["c_free"], 1e-8, 1e-6);
    assert_eq!(report["final"]["q"], serde_json::json!({}));
    // A step of the classical method takes (w h)^6 / 72 of a vibration's energy: 2e-8 at 3.4 Hz.
    assert!(report["energy_residual"].as_f64().unwrap() < 1e-5);
}

// Damped joints free, panels turned by .6 rad, tumbling. Angular velocity is in the base's axes, the velocity that of the base
// frame's origin: another meaning would show in momentum at once.
#[test]
fn a_tumbling_robot_with_damped_joints_moves_as_in_the_independent_run() {
    let runs: Value = serde_json::from_str(RUNS).unwrap();
    let fixture = &runs["d_tumble"];
    let urdf = damped();
    let scenario = turned(&without_wheels(), 0.6);
    let scenario = with(&scenario, "package://fuyu/urdf/servicer.urdf", "robot.urdf");
    let start = "    integrator: rk4\n    base:\n      angular_velocity: [0.03, -0.05, 0.04]\n";
    let scenario = with(&scenario, "    integrator: rk4\n", start);
    let report = run("simulate", &scenario, &urdf, &["--json"]).json();
    compare(&report, fixture, 1e-8, 1e-6);
    assert!(joint_error(&report, fixture) < 1e-7);
}

// Frequencies with the base free, and zeros from torques to attitude, which no posture changes.
#[test]
fn vibration_is_that_of_the_independent_program() {
    let fixture: Value = serde_json::from_str(LINEAR).unwrap();
    for alpha in [0.0, 0.6] {
        let scenario = turned(CONFIG, alpha);
        for (name, q) in POSTURES {
            let named: Vec<_> = (1..=6)
                .map(|j| format!("joint{j}={:?}", q[j - 1]))
                .collect();
            let q = format!("--q={}", named.join(","));
            let report = run("modes", &scenario, SERVICER, &[&q, "--json"]).json();
            let expected = &fixture["linear"][format!("{alpha:?}")][name];
            let zeros = expected["zeros_torque3_to_attitude3"].as_array().unwrap();
            let zeros = zeros.iter().map(numbers).filter(|s| s[1] > 0.0);
            let mut zeros: Vec<f64> = zeros
                .map(|s| s[0].hypot(s[1]) / std::f64::consts::TAU)
                .collect();
            zeros.sort_by(f64::total_cmp);
            let frequencies = numbers(&expected["frequencies_locked_hz"]);
            for (key, expected) in [("frequencies", frequencies), ("zeros", zeros)] {
                let found = numbers(&report[key]);
                let relative: Vec<f64> = found.iter().zip(&expected).map(|(a, b)| a / b).collect();
                let error = difference(&relative, &vec![1.0; expected.len()]);
                assert!(error < 1e-8, "{name} {alpha} {key}: {error:e}");
            }
            let panel = &report["appendages"]["solar_minus"];
            let clamped = difference(
                &numbers(&panel["frequencies"]),
                &numbers(&fixture["frequencies_hz"]),
            );
            assert!(clamped < 1e-9, "{clamped:e}");
            assert_eq!(numbers(&panel["damping"]).len(), 4);
            let rows = fixture["P_attachment"].as_array().unwrap();
            for (row, expected) in panel["participation"].as_array().unwrap().iter().zip(rows) {
                assert!(
                    difference(&numbers(row), &numbers(expected)) < 1e-7,
                    "{row} {expected}"
                );
            }
        }
    }
    let text = run("modes", CONFIG, SERVICER, &[]);
    assert_eq!(text.code, 0, "{}", text.stderr);
    assert!(
        text.stdout.contains("0.195513") && text.stdout.contains("1.230552"),
        "{}",
        text.stdout
    );
    let rigid = fuyu(&["modes", "config/positioning.yaml"]);
    assert!(rigid.refusal().contains("no appendage"), "{}", rigid.stderr);
}

// Each is one line that names file, parameter, value and what would be right.
#[test]
fn wrong_parts_are_refused_with_the_reason() {
    let elastic = |stiffness: f64| {
        format!(
            "    joints:\n      joint2:\n        stiffness: {stiffness:?}\n        rotor_inertia: 1.0e-4\n        gear_ratio: 100.0\n    wheels: ["
        )
    };
    let kind = "      kind: plate_strip\n";
    let modes = "      initial_mu: [0.5, 0.05, 0.0, 0.02]\n";
    for (from, to, says) in [
        (
            "EI: 3000.0",
            "EI: -3000.0",
            "solar_plus.EI of /dynamics: -3000 is out of range",
        ),
        (
            kind,
            "      kind: membrane\n",
            "'membrane' is not one of plate_strip, beam, modes_file",
        ),
        (
            "    wheels: [",
            &elastic(-5.0),
            "joints.joint2.stiffness of /dynamics: -5 is out of range",
        ),
        (
            "    wheels: [",
            &elastic(5e7),
            "parameter time_step is 0.005: the step of 0.005 s is above the stability limit",
        ),
        (
            "time_step: 0.005\n    state_rate: 100.0",
            "time_step: 0.5\n    state_rate: 1.0",
            "parameter time_step is 0.5",
        ),
        (
            "      axis: [1.0, 0.0, 0.0]\n",
            "",
            "parameter wheel_x.axis is not given",
        ),
        (
            "axis: [1.0, 0.0, 0.0]",
            "axis: [0.0, 0.0, 0.0]",
            "wheel_x.axis of /dynamics: [0.0, 0.0, 0.0] has no direction",
        ),
        (
            "inertia: 0.2",
            "inertia: 5000.0",
            "least moment of inertia without its wheels",
        ),
        (
            "link: base_link",
            "link: bus",
            "solar_plus.link is 'bus', which is not a link of the robot",
        ),
        (
            modes,
            "      initial_mu: [0.5]\n",
            "solar_plus.initial_mu has 1 values; the appendage has 4 modes: b1, b2, b3, t1",
        ),
        (
            "wheels: [wheel_x,",
            "wheels: [solar_plus, wheel_x,",
            "'solar_plus' is given twice",
        ),
        (
            "duration: 30.0",
            "duration: 30.0\n    formulation: kane",
            "formulation is 'kane'",
        ),
        (
            "torsion_modes: 1",
            "torsion_mode: 1",
            "did you mean solar_plus.torsion_modes?",
        ),
    ] {
        let text = CONFIG.replacen(from, to, if from.contains("inertia") { 1 } else { 9 });
        assert_ne!(text, CONFIG, "{from}");
        let run = run("simulate", &text, SERVICER, &["--duration", "0.1"]);
        assert_eq!(
            (run.code, run.stdout.as_str()),
            (2, ""),
            "{to}: {}",
            run.stderr
        );
        assert!(run.stderr.contains(says), "{to}: {}", run.stderr);
        assert!(run.stderr.contains("scenario.yaml"), "{}", run.stderr);
    }
}

// The motor is wound up by what the link's vibration does, and the energy of both is in the bag's balance: strain energy, the
// damping between motor and link.
#[test]
fn an_elastic_joint_winds_up_and_its_energy_is_accounted_for() {
    let joints = "    joints:\n      joint2:\n        stiffness: 20000.0\n        damping: 20.0\n        rotor_inertia: 1.0e-4\n        gear_ratio: 100.0\n    wheels: [";
    let scenario = with(CONFIG, "    wheels: [", joints);
    let start =
        "    initial_joint_velocities: [0.0, 0.1, 0.0, 0.0, 0.0, 0.0]\n    integrator: rk4\n";
    let scenario = with(&scenario, "    integrator: rk4\n", start);
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let bag = bag.to_str().unwrap();
    let options = ["--json", "--duration", "5", "--output", bag];
    let report = run("simulate", &scenario, SERVICER, &options).json();
    let number = |value: &Value| value.as_f64().unwrap();
    let motor = number(&report["final"]["motors"]["joint2"]["position"]);
    let link = number(&report["final"]["q"]["joint2"]);
    assert!(
        (motor - link).abs() < 1e-2 && motor != link,
        "{motor} {link}"
    );
    assert!(number(&report["final"]["strain_energy"]) > 1e-3);
    assert!(number(&report["energy_residual"]) < 1e-5);
    let check = fuyu(&["bag", "check", bag, "--json"]).json();
    let lines = check["checks"].as_array().unwrap();
    let energy = lines
        .iter()
        .find(|line| line["name"] == "energy balance")
        .unwrap();
    assert!(number(&energy["value"]) < 1e-4, "{energy}");
    assert_eq!(check["passed"], true, "{check}");
}

// The controller knows nothing of the panels. The tip arrives all the same, and the panels vibrate meanwhile.
#[test]
fn the_tip_arrives_although_panels_vibrate() {
    let (_, panels) = CONFIG.split_once("    appendages:").unwrap();
    let (panels, _) = panels.split_once("    wheels:").unwrap();
    let positioning = include_str!("../../config/positioning.yaml");
    let scenario = with(
        positioning,
        "camera:\n",
        &format!("    appendages:{panels}camera:\n"),
    );
    let report = run("simulate", &scenario, SERVICER, &["--json"]).json();
    let number = |key: &str| report[key].as_f64().unwrap();
    assert!(number("tip_position_error") < 0.01, "{report}");
    assert!(number("tip_attitude_error") < 0.02, "{report}");
    assert!(number("energy_residual") < 1e-4, "{report}");
    assert!(number("max_tip_acceleration") > 0.01, "{report}");
    let rigid = fuyu(&["simulate", "config/positioning.yaml", "--json"]).json();
    let turned = |report: &Value| {
        report["base_attitude_rpy"][2]
            .as_f64()
            .unwrap()
            .to_degrees()
    };
    let (flexible, rigid) = (turned(&report), turned(&rigid));
    println!("base yaw {flexible} deg with panels, {rigid} deg without");
    // Two panels double the base's inertia about z.
    assert!(flexible.abs() < 0.9 * rigid.abs(), "{flexible} {rigid}");
}

// A boom whose modes another program has computed, and the error that names its line.
#[test]
fn modes_of_another_program_are_read_from_a_file() {
    let csv = "record,name,with,frequency_hz,damping,mass,x,y,z,rx,ry,rz,xx,xy,xz,yx,yy,yz,zx,zy,zz\n\
        body,boom,,,,48,192,0,0,,,,16,0,0,0,1024,0,0,0,1040\n\
        mode,b1,,0.19551312267198,0.005,1,0,0,5.424726013472824,,,,0,0,31.52752284027897,0,0,0,0,0,0\n";
    let (before, rest) = CONFIG.split_once("    solar_plus:").unwrap();
    let (_, after) = rest.split_once("recorder:").unwrap();
    let before = with(before, "[solar_plus, solar_minus]", "[boom]");
    let boom = "    boom:\n      kind: modes_file\n      file: boom.csv\n      initial_mu: [0.5]\n";
    let scenario = format!("{before}{boom}recorder:{after}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.yaml");
    std::fs::write(&path, scenario).unwrap();
    let with_modes = |csv: &str, command: &str, options: &[&str]| {
        std::fs::write(folder.path().join("boom.csv"), csv).unwrap();
        run_at(command, &path, options)
    };
    let report = with_modes(csv, "modes", &["--json"]).json();
    let frequency = numbers(&report["appendages"]["boom"]["frequencies"])[0];
    assert!((frequency - 0.19551312267198).abs() < 1e-14, "{frequency}");
    let report = with_modes(csv, "simulate", &["--json", "--duration", "5"]).json();
    let mu = numbers(&report["final"]["appendages"]["boom"]["mu"])[0];
    assert!(mu.abs() > 0.01 && mu.abs() < 0.5, "{mu}");
    let wrong = with_modes(&csv.replace(",damping,", ",zeta,"), "modes", &[]);
    let line = wrong.refusal();
    assert!(
        line.contains("parameter boom.file") && line.contains("boom.csv, line 1"),
        "{line}"
    );
}

// A wheel at its limit from the start, and panels that are bent and turn too far for first-order modes.
#[test]
fn limits_and_large_deflections_are_events() {
    let inertia = "inertia: 0.2\n";
    let scenario = CONFIG.replacen(inertia, "inertia: 0.2\n      initial_speed: 500.0\n", 1);
    let scenario = with(&scenario, "[0.5, 0.05, 0.0, 0.02]", "[1.5, 0.0, 0.0, 0.0]");
    let run = run(
        "simulate",
        &scenario,
        SERVICER,
        &["--json", "--duration", "10"],
    );
    assert_eq!(run.code, 0);
    let warning = "solar_plus is deflected by 0.4330 m; first-order modes suffice up to 0.2419 m: set second_order";
    assert!(
        run.stderr.contains("warning") && run.stderr.contains(warning),
        "{}",
        run.stderr
    );
    let report: Value = serde_json::from_str(&run.stdout).unwrap();
    let events = report["events"].as_array().unwrap();
    let first = |what: &str| {
        let found = events
            .iter()
            .find(|e| e["what"].as_str().unwrap().contains(what));
        found.unwrap_or_else(|| panic!("{what}: {events:?}"))["time"].as_f64()
    };
    assert_eq!(
        first("wheel 'wheel_x' is at its speed limit, 500 rad/s"),
        Some(0.0)
    );
    assert_eq!(
        first("solar_plus is deflected by more than 0.2419 m"),
        Some(0.0)
    );
    // The panel swings through: the excess ends and comes back.
    let times = events
        .iter()
        .filter(|e| e["what"].as_str().unwrap().contains("solar_plus"));
    assert!(times.count() > 2, "{events:?}");
}

// The motion of the base that a scenario begins with, of robot and target.
#[test]
fn initial_motion_is_that_of_the_root_frames() {
    let scenario = "dynamics:\n  ros__parameters:\n    urdf: package://fuyu/urdf/servicer.urdf\n\
        \x20   initial_joint_positions: [0.3, 0.8, -1.4, 0.6, 0.4, 0.0]\n\
        \x20   initial_joint_velocities: [0.1, 0.0, 0.0, 0.0, 0.0, 0.2]\n\
        \x20   state_rate: 1000.0\n    time_step: 0.001\n\
        \x20   base:\n      position: [1.0, 2.0, 3.0]\n      orientation: [0.0, 0.0, 0.6, 0.8]\n\
        \x20     velocity: [0.01, 0.02, 0.03]\n      angular_velocity: [0.1, 0.0, 0.0]\n\
        \x20   targets: [debris]\n    debris:\n      position: [5.0, 0.0, 0.0]\n\
        \x20     orientation: [0.6, 0.0, 0.0, 0.8]\n      velocity: [0.0, -0.1, 0.0]\n\
        \x20     angular_velocity: [0.0, 0.2, 0.0]\n";
    let report = run(
        "simulate",
        scenario,
        SERVICER,
        &["--duration", "0.001", "--json"],
    )
    .json();
    let found = &report["final"];
    // z by 2 atan2(.6, .8), x by the same.
    let (s, c) = (0.96, 0.28);
    let near = |value: &Value, expected: [f64; 3]| {
        let error = difference(&numbers(value), &expected);
        assert!(error < 1e-3, "{value} {expected:?}");
    };
    near(&found["base_position"], [1.0, 2.0, 3.0]);
    near(&found["base_velocity"], [0.01, 0.02, 0.03]);
    near(&found["base_angular_velocity"], [0.1 * c, 0.1 * s, 0.0]);
    let target = &found["targets"]["debris"];
    near(&target["position"], [5.0, 0.0, 0.0]);
    near(&target["velocity"], [0.0, -0.1, 0.0]);
    near(&target["angular_velocity"], [0.0, 0.2 * c, 0.2 * s]);
    assert!((found["qd"]["joint1"].as_f64().unwrap() - 0.1).abs() < 1e-3);
    assert!((found["q"]["joint6"].as_f64().unwrap() - 0.0002).abs() < 1e-6);
    assert_eq!(found["strain_energy"], 0.0);
    assert_eq!(
        (&found["appendages"], &found["wheels"]),
        (&serde_json::json!({}), &serde_json::json!({}))
    );
}
