//! Excitations of scenarios: driven arm, wheels and pushed links against an independent program, and wrong input.

use std::f64::consts::PI;

use serde_json::Value;

use super::flexible::{
    CONFIG, POSTURES, RUNS, SERVICER, compare, damped, difference, joint_error, last, locked,
    numbers, run, turned, with, without_wheels,
};

const WHEEL_RUN: &str =
    include_str!("../../crates/fuyu-physics/tests/flexible/fixtures/flexible_wheel_run.json");
/// Amplitudes \[N m\] and periods \[s\] of the joint efforts of the fixtures' runs.
pub const EFFORTS: [(f64, f64); 6] = [
    (5.0, 20.0),
    (10.0, 24.0),
    (-6.0, 16.0),
    (0.5, 10.0),
    (0.1, 12.0),
    (0.005, 8.0),
];

/// Excitations of all joints with the efforts of the fixtures' runs times `scale`, to be followed by others.
pub fn of_joints(scale: f64) -> String {
    let joints = EFFORTS.iter().enumerate().map(|(j, (amplitude, period))| {
        let (joint, amplitude) = (j + 1, scale * amplitude);
        format!(
            "      arm{joint}:\n        joint: joint{joint}\n        amplitude: {amplitude:?}\n        period: {period:?}\n"
        )
    });
    format!("    excitations:\n{}", joints.collect::<String>())
}

/// `scenario` from rest, with these lines among the parameters of the dynamics node, and `robot.urdf` as the robot.
fn excited(scenario: &str, lines: &str) -> String {
    let scenario = with(scenario, "[0.5, 0.05, 0.0, 0.02]", "[0.0, 0.0, 0.0, 0.0]");
    let scenario = with(&scenario, "[-0.3, 0.0, 0.01, 0.03]", "[0.0, 0.0, 0.0, 0.0]");
    let scenario = with(&scenario, "package://fuyu/urdf/servicer.urdf", "robot.urdf");
    with(
        &scenario,
        "    appendages:",
        &format!("{lines}    appendages:"),
    )
}

// Run a: the arm excites the panels. Would break if efforts were held over a step instead of evaluated at its stages:
// that is an error of 1e-5 in attitude. The energy is the work of the efforts less what panels and joints dissipate.
#[test]
fn a_driven_arm_excites_the_panels_as_in_the_independent_run() {
    let runs: Value = serde_json::from_str(RUNS).unwrap();
    let scenario = excited(&without_wheels(), &of_joints(1.0));
    let report = run("simulate", &scenario, &damped(), &["--json"]).json();
    compare(&report, &runs["a_slew"], 1e-10, 1e-9);
    assert!(joint_error(&report, &runs["a_slew"]) < 1e-9);
    let balance = report["energy_residual"].as_f64().unwrap();
    println!("energy balance {balance:.1e}");
    assert!(balance < 1e-9, "{balance:e}");
}

// Wheels and arm driven, 19 N m s in the wheels at most, none from outside.
#[test]
fn driven_wheels_turn_the_base_as_in_the_independent_run() {
    let fixture: Value = serde_json::from_str(WHEEL_RUN).unwrap();
    let wheels = [("x", -0.8, 30.0), ("y", 0.5, 20.0), ("z", -2.0, 30.0)];
    let wheels = wheels.map(|(axis, amplitude, period)| {
        format!(
            "      turn_{axis}:\n        wheel: wheel_{axis}\n        amplitude: {amplitude:?}\n        period: {period:?}\n"
        )
    });
    let scenario = excited(CONFIG, &(of_joints(0.3) + &wheels.concat()));
    let report = run("simulate", &scenario, &damped(), &["--json"]).json();
    compare(&report, &fixture, 1e-8, 1e-6);
    assert!(joint_error(&report, &fixture) < 1e-8);
    let speeds = ["wheel_x", "wheel_y", "wheel_z"]
        .map(|wheel| report["final"]["wheels"][wheel]["speed"].as_f64().unwrap());
    let error = difference(&speeds, &last(&fixture, "wheel_speed_relative"));
    println!("wheel speeds: {error:.1e} rad/s");
    assert!(error < 1e-6, "{error:e}");
}

// A half sine of 1 s on a spinning robot with locked joints. In axes of the world momentum changes by 2/pi of the
// force, at any attitude; in axes of the link, which turns by 3 degrees meanwhile, it does not. The torque about the
// centre of mass has no closed form, but energy must balance in both.
#[test]
fn a_half_sine_pulse_gives_its_impulse() {
    let force = [20.0, -30.0, 60.0];
    let scenario = |axes: &str| {
        let pulse = format!(
            "    base:\n      angular_velocity: [0.02, -0.03, 0.05]\n    excitations:\n      kick:\n        link: base_link\n        axes: {axes}\n        force: {force:?}\n        torque: [60.0, 120.0, 80.0]\n        position: [0.1, 0.2, -0.3]\n        period: 2.0\n        start: 0.5\n        duration: 1.0\n"
        );
        let scenario = excited(&turned(&without_wheels(), 0.6), &pulse);
        with(
            &scenario,
            "    initial_joint_positions: [0.3, 0.8, -1.4, 0.6, 0.4, 0.0]\n",
            "",
        )
    };
    let urdf = locked(&POSTURES[1].1);
    let momentum = |axes: &str, duration: &str| {
        let options = ["--json", "--duration", duration];
        let report = run("simulate", &scenario(axes), &urdf, &options).json();
        let residual = report["energy_residual"].as_f64().unwrap();
        println!("{axes}, {duration} s: energy balance {residual:.1e}");
        assert!(residual < 1e-5, "{residual:e}");
        numbers(&report["final"]["momentum"]["linear"])
    };
    let before = momentum("world", "0.5");
    for (axes, is_exact) in [("world", true), ("link", false)] {
        let after = momentum(axes, "3");
        let impulse: Vec<f64> = after.iter().zip(&before).map(|(a, b)| a - b).collect();
        let error = difference(&impulse, &force.map(|f| f * 2.0 / PI));
        println!("{axes}: {error:.1e} N s");
        assert_eq!(error < 1e-8, is_exact, "{axes}: {error:e}");
        assert!(error < 5.0, "{axes}: {error:e}");
    }
}

// A bag has the excitations in its mean efforts and external impulse, so that its checks hold. A rigid robot has them,
// too.
#[test]
fn recorded_excitations_satisfy_the_checks_of_a_bag() {
    let folder = tempfile::tempdir().unwrap();
    let push = "      kick:\n        link: link3\n        force: [0.0, 0.0, 1.0]\n        period: 2.0\n        duration: 1.0\n";
    let lines = of_joints(1.0) + push;
    let rigid = format!(
        "dynamics:\n  ros__parameters:\n    urdf: robot.urdf\n    initial_joint_positions: [0.3, 0.8, -1.4, 0.6, 0.4, 0.0]\n    state_rate: 100.0\n{lines}"
    );
    let flexible = excited(CONFIG, &lines);
    for (name, scenario) in [("rigid", rigid), ("flexible", flexible)] {
        let bag = folder.path().join(name);
        let bag = bag.to_str().unwrap();
        let options = ["--json", "--duration", "5", "--output", bag];
        let report = run("simulate", &scenario, &damped(), &options).json();
        let moved = report["final"]["q"]["joint1"].as_f64().unwrap() - 0.3;
        assert!(moved.abs() > 0.01, "{name}: {moved}");
        let check = super::fuyu::fuyu(&["bag", "check", bag, "--json"]).json();
        assert_eq!(check["passed"], true, "{name}: {check}");
    }
}

#[test]
fn wrong_excitations_are_refused_with_the_reason() {
    let wave = |lines: &str| format!("    excitations:\n      shake:\n{lines}");
    for (lines, says) in [
        (
            "        joint: joint7\n        amplitude: 1.0\n",
            "parameter excitations.shake.joint is 'joint7', which is not a joint of the robot; it must be one of joint1, joint2",
        ),
        (
            "        wheel: wheel_w\n        amplitude: 1.0\n",
            "excitations.shake.wheel is 'wheel_w', which is not a wheel of the robot; it must be one of wheel_x,",
        ),
        (
            "        link: panel\n        force: [1.0, 0.0, 0.0]\n",
            "excitations.shake.link is 'panel', which is not a link of the robot",
        ),
        (
            "        amplitude: 1.0\n",
            "excitations.shake: joint is '', wheel is '' and link is ''; one of the three must name what is excited",
        ),
        (
            "        joint: joint1\n",
            "excitations.shake.amplitude is not given",
        ),
        (
            "        link: link3\n        amplitude: 2.0\n        force: [1.0, 0.0, 0.0]\n",
            "amplitude is for a joint or wheel, force and torque are for a link",
        ),
        (
            "        joint: joint1\n        amplitude: 1.0\n        period: -3.0\n",
            "excitations.shake.period of /dynamics: -3 is out of range",
        ),
        (
            "        joint: joint1\n        amplitude: 1.0\n        perod: 3.0\n",
            "did you mean excitations.shake.period?",
        ),
    ] {
        let scenario = with(
            CONFIG,
            "    appendages:",
            &(wave(lines) + "    appendages:"),
        );
        let run = run("simulate", &scenario, SERVICER, &["--duration", "0.1"]);
        assert_eq!(
            (run.code, run.stdout.as_str()),
            (2, ""),
            "{lines}: {}",
            run.stderr
        );
        assert!(run.stderr.contains(says), "{lines}: {}", run.stderr);
    }
}
