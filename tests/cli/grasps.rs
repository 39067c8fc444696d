//! Scenarios in which the robot grasps a target, against the independent computations of
//! `crates/fuyu-physics/tests/capture/fixtures`.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde_json::Value;

use super::fuyu::{Run, fuyu};

const IMPULSES: &str =
    include_str!("../../crates/fuyu-physics/tests/capture/fixtures/capture_impulse.json");
const MOTIONS: &str =
    include_str!("../../crates/fuyu-physics/tests/capture/fixtures/capture_motion.json");

fn cases(text: &str) -> Vec<Value> {
    let file: Value = serde_json::from_str(text).unwrap();
    file["cases"].as_array().unwrap().clone()
}

fn numbers(value: &Value) -> Vec<f64> {
    serde_json::from_value(value.clone()).unwrap_or_else(|e| panic!("{e}: {value}"))
}

fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_column_slice(&numbers(value))
}

fn rotation(value: &Value) -> UnitQuaternion<f64> {
    let rows: Vec<Vec<f64>> = serde_json::from_value(value.clone()).unwrap();
    let matrix = Matrix3::from_fn(|i, j| rows[i][j]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
}

/// A list of numbers in YAML, without exponents.
fn list(values: &[f64]) -> String {
    let numbers = values.iter().map(|x| match x.fract() == 0.0 {
        true => format!("{x:.1}"),
        false => x.to_string(),
    });
    format!("[{}]", numbers.collect::<Vec<_>>().join(", "))
}

/// A scenario that latches at time zero what a case describes, with its robot and target.
struct Scene {
    folder: tempfile::TempDir,
    text: String,
}

impl Scene {
    fn new(case: &Value, at: &Value) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let damping = case["joint_damping"].as_f64().unwrap();
        let robot = include_str!("../../urdf/servicer.urdf")
            .replace("<axis", &format!("<dynamics damping=\"{damping}\"/><axis"));
        std::fs::write(folder.path().join("robot.urdf"), robot).unwrap();
        let inertia: Vec<Vec<f64>> =
            serde_json::from_value(case["target"]["inertia_com"].clone()).unwrap();
        let target = format!(
            "<robot name=\"t\"><link name=\"body\"><inertial><mass value=\"{}\"/><inertia ixx=\"{}\" ixy=\"{}\" \
             ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/></inertial></link></robot>",
            case["target"]["mass"],
            inertia[0][0],
            inertia[0][1],
            inertia[0][2],
            inertia[1][1],
            inertia[1][2],
            inertia[2][2]
        );
        std::fs::write(folder.path().join("body.urdf"), target).unwrap();
        let motion = |p: &str, R: &str, v: &str, w: &str| {
            let R = rotation(&at[R]);
            let w_B = R.inverse() * vector(&at[w]);
            let q = R.coords;
            format!(
                "      position: {}\n      orientation: {}\n      velocity: {}\n      angular_velocity: {}\n",
                list(&numbers(&at[p])),
                list(q.as_slice()),
                list(&numbers(&at[v])),
                list(w_B.as_slice())
            )
        };
        let X_TG = rotation(&case["target"]["grasp_R"]);
        let text = format!(
            "dynamics:\n  ros__parameters:\n    urdf: robot.urdf\n    integrator: dop8\n    time_step: 0.01\n    \
             state_rate: 10.0\n    initial_joint_positions: {}\n    initial_joint_velocities: {}\n    base:\n{}    \
             targets: [debris]\n    debris:\n      urdf: body.urdf\n{}    grasps: [hand]\n    hand:\n      frame: tool0\n      \
             target: debris\n      target_position: {}\n      target_orientation: {}\n      kind: {}\n      joints: {}\n      \
             at: 0.0\n      distance: 1.0e-9\n      angle: 1.0e-6\n",
            list(&numbers(&at["q"])),
            list(&numbers(&at["qd"])),
            motion("base_p", "base_R", "base_v", "base_w"),
            motion("target_com", "target_R", "target_v", "target_w"),
            list(&numbers(&case["target"]["grasp_p"])),
            list(X_TG.coords.as_slice()),
            case["grasp"].as_str().unwrap(),
            case["joints"].as_str().unwrap(),
        );
        Self { folder, text }
    }

    fn run(&self, duration: &str) -> Run {
        let path = self.folder.path().join("capture.yaml");
        std::fs::write(&path, &self.text).unwrap();
        let path = path.to_str().unwrap();
        fuyu(&["simulate", path, "--duration", duration, "--json"])
    }
}

#[track_caller]
fn near(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (a, b) in found.iter().zip(expected) {
        assert!(
            (a - b).abs() <= tolerance,
            "{what}: {:.1e} > {tolerance:.0e}",
            (a - b).abs()
        );
    }
}

fn by_joint(values: &Value) -> Vec<f64> {
    let names = (1..=6).map(|k| values[format!("joint{k}")].as_f64().unwrap());
    names.collect()
}

/// A grasp at time zero: `final` of a run of no duration is the motion after the impulse. Fails if the latch acts after
/// the state is shown, or if robot and target are shown in wrong axes.
#[test]
fn a_grasp_at_the_start_gives_the_twists_after_the_impulse() {
    for case in cases(IMPULSES) {
        let name = case["name"].as_str().unwrap();
        let run = Scene::new(&case, &case["before"]).run("1e-9").json();
        let (end, after) = (&run["final"], &case["after"]);
        let target = &end["targets"]["debris"];
        for (what, found, expected) in [
            ("base v", &end["base_velocity"], "base_v"),
            ("base w", &end["base_angular_velocity"], "base_w"),
            ("target v", &target["velocity"], "target_v"),
            ("target w", &target["angular_velocity"], "target_w"),
        ] {
            let expected = numbers(&after[expected]);
            near(&format!("{name} {what}"), &numbers(found), &expected, 1e-12);
        }
        near(name, &by_joint(&end["qd"]), &numbers(&after["qd"]), 1e-12);
        let P = numbers(&case["momentum"]["P"]);
        near(name, &numbers(&end["momentum"]["linear"]), &P, 1e-11);
        let energy = case["energy"]["after"].as_f64().unwrap();
        let found = end["kinetic_energy"].as_f64().unwrap();
        assert!((found - energy).abs() <= 1e-12 * energy, "{name}: {found}");
        let first = run["events"][0]["what"].as_str().unwrap();
        assert!(first.starts_with("grasp 'hand' holds debris"), "{first}");
    }
}

/// 20 s as one system, with the default drives, in pose and rate. Fails if the target is stepped by itself, or if the
/// robot's joints do not act on the whole.
#[test]
fn what_is_held_moves_as_one_system() {
    for case in cases(MOTIONS) {
        let name = case["name"].as_str().unwrap();
        let run = Scene::new(&case, &case["initial"]).run("20").json();
        let end = &run["final"];
        let at = |what: &str| numbers(case[what].as_array().unwrap().last().unwrap());
        assert_eq!(case["t"].as_array().unwrap().last().unwrap(), 20.0);
        let target = &end["targets"]["debris"];
        for (what, found) in [
            ("base_p", &end["base_position"]),
            ("base_v", &end["base_velocity"]),
            ("base_w", &end["base_angular_velocity"]),
            ("target_com", &target["position"]),
            ("target_v", &target["velocity"]),
            ("target_w", &target["angular_velocity"]),
        ] {
            near(&format!("{name} {what}"), &numbers(found), &at(what), 1e-8);
        }
        near(name, &by_joint(&end["q"]), &at("q"), 1e-8);
        near(name, &by_joint(&end["qd"]), &at("qd"), 1e-8);
        let residual = &run["momentum_residual"];
        for part in ["linear", "angular"] {
            assert!(
                residual[part].as_f64().unwrap() < 1e-12,
                "{name}: {residual}"
            );
        }
        let energy = run["energy_residual"].as_f64().unwrap();
        assert!(energy < 1e-8, "{name}: {energy}");
    }
}

/// A target that is released drifts away from the robot, with the spring's energy; momentum and energy of both are
/// balanced, and the bag's physics holds.
#[test]
fn a_released_target_takes_its_part_of_momentum() {
    let case = &cases(MOTIONS)[0];
    let mut scene = Scene::new(case, &case["initial"]);
    scene.text += "      release_at: 1.005\n      release_energy: 2.0\n";
    let bag = scene.folder.path().join("bag");
    let path = scene.folder.path().join("capture.yaml");
    std::fs::write(&path, &scene.text).unwrap();
    let (path, bag) = (path.to_str().unwrap(), bag.to_str().unwrap());
    let args = [
        "simulate",
        path,
        "--duration",
        "3",
        "--json",
        "--output",
        bag,
    ];
    let run = fuyu(&args).json();
    let events = run["events"].as_array().unwrap();
    let released = events.iter().find(|e| e["what"] == "debris is released");
    assert_eq!(released.expect("a release")["time"], 1.005);
    let residual = &run["momentum_residual"];
    assert!(residual["linear"].as_f64().unwrap() < 1e-12, "{residual}");
    assert!(residual["angular"].as_f64().unwrap() < 1e-12, "{residual}");
    assert!(run["energy_residual"].as_f64().unwrap() < 1e-8, "{run}");
    let before = case["energy"][0].as_f64().unwrap();
    let after = run["final"]["kinetic_energy"].as_f64().unwrap();
    assert!((after - before - 2.0).abs() < 1e-8, "{after} {before}");
    let check = fuyu(&["bag", "check", bag, "--json"]);
    assert_eq!(check.code, 0, "{}{}", check.stdout, check.stderr);
}

/// What cannot latch is refused in one line before anything runs, or ends the run when it is due.
#[test]
fn wrong_grasps_are_refused() {
    let case = &cases(MOTIONS)[0];
    let good = Scene::new(case, &case["initial"]);
    for (from, to, says) in [
        (
            "target_position: [",
            "target_position: [1.0, 0.0, 0.0] # [",
            "grasp 'hand': the frames of the grasp are",
        ),
        (
            "target: debris",
            "target: station",
            "'station' is none of the targets (debris)",
        ),
        ("frame: tool0", "frame: hand", "'hand' is no link of robot"),
        (
            "kind: weld",
            "kind: glue",
            "'glue' is not one of weld, ball",
        ),
        ("distance: 1.0e-9", "distance: -1.0", "-1 is out of range"),
        (
            "grasps: [hand]",
            "grasps: [hand, hand]",
            "'hand' is given twice",
        ),
    ] {
        assert!(good.text.contains(from), "{from}");
        let wrong = Scene {
            folder: tempfile::tempdir().unwrap(),
            text: good.text.replacen(from, to, 1),
        };
        for name in ["robot.urdf", "body.urdf"] {
            std::fs::copy(
                good.folder.path().join(name),
                wrong.folder.path().join(name),
            )
            .unwrap();
        }
        let run = wrong.run("1");
        let message = run.refusal();
        assert!(message.contains(says), "{message}");
    }
    // A latch that is due later, when the target has drifted away.
    let late = Scene {
        text: good
            .text
            .replace("at: 0.0", "at: 0.5")
            .replace("distance: 1.0e-9", "distance: 0.0"),
        ..good
    };
    let run = late.run("1");
    assert_eq!(run.code, 1, "{}", run.stdout);
    assert!(
        run.stderr
            .contains("at 0.500 s: grasp 'hand': the frames of the grasp are"),
        "{}",
        run.stderr
    );
}
