//! Targets with joints in `fuyu simulate`, against closed forms of a hull and a panel that share a hinge.

use std::{fs, path::Path};

use fuyu::{
    bag::Bag,
    msg::{nav_msgs::Odometry, sensor_msgs::JointState},
};
use serde_json::Value;

use super::fuyu::{Run, fuyu};

/// Mass \[kg\], moment of inertia about the hinge's direction \[kg m²\], and distance from centre of mass to hinge \[m\].
struct Part {
    mass: f64,
    inertia: f64,
    arm: f64,
}

const HULL: Part = Part {
    mass: 40.0,
    inertia: 20.0,
    arm: 0.8,
};
const PANEL: Part = Part {
    mass: 10.0,
    inertia: 5.0,
    arm: 1.1,
};

/// A hull and a panel; the hinge is `hull` and `panel` metres away from their centres of mass.
fn satellite(hull: f64, panel: f64, joint: &str) -> String {
    let inertial = |part: &Part, x: f64| {
        let Part { mass, inertia, .. } = part;
        format!(
            r#"<inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/><inertia ixx="{inertia}" iyy="{inertia}"
            izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial>"#
        )
    };
    let (hull_mass, panel_mass) = (inertial(&HULL, 0.0), inertial(&PANEL, panel));
    format!(
        r#"<robot name="satellite"><link name="hull">{hull_mass}</link><link name="panel">{panel_mass}</link>
        <joint name="hinge" type="revolute"><origin xyz="{hull} 0 0"/><parent link="hull"/><child link="panel"/>
        <axis xyz="0 0 1"/>{joint}</joint>
        <joint name="edge" type="fixed"><origin xyz="2 0 0"/><parent link="panel"/><child link="tip"/></joint>
        <link name="tip"/></robot>"#
    )
}

const DURATION: f64 = 10.0;
const DAMPING: f64 = 2.0;
const RATE: f64 = 0.5;
const RESTITUTION: f64 = 0.5;

/// Joint angle and rate of the swinging panel at the start, where it has no angular momentum \[rad, rad/s\].
const SWING: [f64; 2] = [0.3, 0.4];

/// Three satellites around a robot at rest.
fn write_scenario(folder: &Path, change: impl Fn(String) -> String) -> String {
    let unlimited = r#"<limit lower="-1000" upper="1000" velocity="100" effort="0"/>"#;
    let damped = format!(r#"{unlimited}<dynamics damping="{DAMPING}"/>"#);
    let stopped = r#"<limit lower="-1" upper="1" velocity="100" effort="0"/>"#;
    for (name, urdf) in [
        ("damped", satellite(0.0, 0.0, &damped)),
        ("bouncing", satellite(0.0, 0.0, stopped)),
        ("swinging", satellite(HULL.arm, PANEL.arm, unlimited)),
    ] {
        fs::write(folder.join(format!("{name}.urdf")), urdf).unwrap();
    }
    let [q, qd] = SWING;
    let w = hull_rate();
    let text = format!(
        "dynamics:
  ros__parameters:
    urdf: package://fuyu/urdf/planar_two_link.urdf
    duration: {DURATION:?}
    joint_physics.restitution: {RESTITUTION}
    targets: [damped, bouncing, swinging]
    damped:
      urdf: damped.urdf
      position: [0.0, 0.0, 5.0]
      velocity: [0.05, 0.0, 0.0]
      angular_velocity: [0.0, 0.0, 0.3]
      initial_joint_velocities: [{RATE}]
    bouncing:
      urdf: bouncing.urdf
      position: [0.0, 5.0, 0.0]
      velocity: [0.1, 0.0, -0.2]
      initial_joint_velocities: [{RATE}]
    swinging:
      urdf: swinging.urdf
      position: [0.0, 9.0, 0.0]
      angular_velocity: [0.0, 0.0, {w}]
      initial_joint_positions: [{q}]
      initial_joint_velocities: [{qd}]
"
    );
    let path = folder.join("satellites.yaml");
    fs::write(&path, change(text)).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Of the planar pair at joint angle `q`: reduced inertia of the joint, and rate of the hull per joint rate, without angular
/// momentum. With the reduced mass `μ` and distances `a`, `b` from the centres of mass to the hinge, `I₁' = I₁ + μ a²`,
/// `I₂' = I₂ + μ b²` and `c = μ a b cos q`, angular momentum about the common centre of mass is
/// `(I₁' + I₂' + 2c) θ' + (I₂' + c) q'`, and the kinetic energy without it `½ q'² (I₁' I₂' - c²) / (I₁' + I₂' + 2c)`.
fn planar_pair(q: f64) -> (f64, f64) {
    let reduced_mass = HULL.mass * PANEL.mass / (HULL.mass + PANEL.mass);
    let (a, b) = (HULL.arm, PANEL.arm);
    let first = HULL.inertia + reduced_mass * a * a;
    let second = PANEL.inertia + reduced_mass * b * b;
    let c = reduced_mass * a * b * q.cos();
    let total = first + second + 2.0 * c;
    ((first * second - c * c) / total, -(second + c) / total)
}

fn hull_rate() -> f64 {
    let [q, qd] = SWING;
    planar_pair(q).1 * qd
}

/// The integral of `f` from `a` to `b`, by Simpson's rule; its error is far below 1e-10 here.
fn integral(a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
    let panels = 2000;
    let h = (b - a) / f64::from(panels);
    let sum: f64 = (0..panels)
        .map(|i| a + h * f64::from(i))
        .map(|x| f(x) + 4.0 * f(x + 0.5 * h) + f(x + h))
        .sum();
    sum * h / 6.0
}

fn of(run: &Value, target: &str, key: &str) -> f64 {
    let value = &run["targets"][target][key];
    let value = if value.is_object() {
        &value["hinge"]
    } else {
        value
    };
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{target} {key}: {run}"))
}

// Would break if joints of a target were held, or moved without their damping or stops, with another inertia than the
// reduced one, or from other positions than those given.
#[test]
fn satellites_move_as_closed_forms_say() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_scenario(folder.path(), |text| text);
    let bag = folder.path().join("bag");
    let run = fuyu(&[
        "simulate",
        &config,
        "--json",
        "--output",
        bag.to_str().unwrap(),
    ]);
    let run = run.json();

    // The hinge goes through both centres of mass: the relative rate decays with the reduced inertia.
    let reduced = HULL.inertia * PANEL.inertia / (HULL.inertia + PANEL.inertia);
    let decay = (-DAMPING * DURATION / reduced).exp();
    let off = of(&run, "damped", "joint_velocities") - RATE * decay;
    assert!(off.abs() < 1e-12, "{off}");
    let off = of(&run, "damped", "joint_positions") - RATE * reduced / DAMPING * (1.0 - decay);
    assert!(off.abs() < 1e-12, "{off}");

    // The stop at 1 rad is reached after 2 s, the other one with half the rate 8 s later: just at the end.
    let (there, rebound) = (1.0 / RATE, RATE * RESTITUTION);
    let off = of(&run, "bouncing", "joint_positions") - (1.0 - rebound * (DURATION - there));
    assert!(off.abs() < 1e-12, "{off}");

    // The time that the panel takes to where it is, from energy without angular momentum.
    let [q0, qd0] = SWING;
    let q = of(&run, "swinging", "joint_positions");
    let start = planar_pair(q0).0.sqrt() * qd0;
    let time = integral(q0, q, |q| planar_pair(q).0.sqrt() / start);
    println!("{q} rad after {time} s");
    assert!((time - DURATION).abs() < 1e-9 && q > 3.0, "{q} at {time}");
    // The hull's turn, from momentum alone.
    let turn = integral(q0, q, |q| planar_pair(q).1);
    let bag = Bag::open(&bag).unwrap();
    let moved = bag.read::<Odometry>("/ground_truth/swinging/odom").unwrap();
    let last = &moved.last().unwrap().message.pose.pose.orientation;
    let off = (2.0 * last.z.atan2(last.w) - turn).sin();
    assert!(off.abs() < 1e-9, "{off}");

    for target in ["damped", "bouncing", "swinging"] {
        let residual = &run["targets"][target]["momentum_residual"];
        for part in ["linear", "angular"] {
            assert!(residual[part].as_f64().unwrap() < 1e-13, "{target} {run}");
        }
        assert!(
            of(&run, target, "energy_residual") < 1e-11,
            "{target} {run}"
        );
        let states = format!("/ground_truth/{target}/joint_states");
        let states = bag.read::<JointState>(&states).unwrap();
        assert_eq!(states.len(), 1001);
        assert_eq!(states[0].message.name, ["hinge"]);
        assert_eq!(states[0].message.header.frame_id, target);
    }
}

/// `fuyu bag check` of a run, as JSON.
fn check(bag: &Path) -> Value {
    let run: Run = fuyu(&["bag", "check", bag.to_str().unwrap(), "--json"]);
    serde_json::from_str(&run.stdout).unwrap_or_else(|e| panic!("{e}: {}", run.stderr))
}

// Momentum and energy of a target's bag are computed from its own description, joint states and odometry.
#[test]
fn bags_of_targets_with_joints_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_scenario(folder.path(), |text| text);
    let bag = folder.path().join("bag");
    let output = bag.to_str().unwrap();
    let args = ["simulate", &config, "--duration", "3", "--output", output];
    let run = fuyu(&args);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(
        run.stdout.contains("swinging: energy residual"),
        "{}",
        run.stdout
    );
    let report = check(&bag);
    assert_eq!(report["passed"], true, "{report}");
    let lines = report["checks"].as_array().unwrap();
    for target in ["damped", "bouncing", "swinging"] {
        for name in [
            "linear momentum",
            "angular momentum",
            "momentum from velocities",
            "energy balance",
        ] {
            let name = format!("{target}: {name}");
            let line = lines.iter().find(|line| line["name"] == name.as_str());
            let line = line.unwrap_or_else(|| panic!("no {name} in {report}"));
            assert_eq!(line["verdict"], "passed", "{line}");
        }
        let tip = format!("{target}: final");
        assert!(!report.to_string().contains(&tip), "a target has no tip");
    }
    let plotted = fuyu(&["bag", "plot", output]);
    assert_eq!(plotted.code, 0, "{}", plotted.stderr);
    let pictures: Vec<_> = (fs::read_dir(folder.path()).unwrap())
        .chain(fs::read_dir(&bag).unwrap())
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .collect();
    println!("{pictures:?} {}", plotted.stdout);
    assert!(
        plotted.stdout.contains("swinging_joint_rates"),
        "{}",
        plotted.stdout
    );
}

// Would break if a mistake in a target's joints were found only while it runs.
#[test]
fn wrong_joints_of_targets_are_refused() {
    let refused = |from: &str, to: &str, says: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        let config = write_scenario(folder.path(), |text| {
            assert!(text.contains(from), "the scenario has no {from}");
            text.replacen(from, to, 1)
        });
        for command in ["simulate", "launch"] {
            let run = fuyu(&[command, &config]);
            let message = run.refusal();
            for part in says {
                assert!(
                    message.contains(part),
                    "{command}: no {part:?} in {message}"
                );
            }
        }
    };
    refused(
        "initial_joint_positions: [0.3]",
        "initial_joint_positions: [0.3, 0.1]",
        &[
            "swinging.initial_joint_positions has 2 values",
            "target swinging has 1 joints",
        ],
    );
    refused(
        "initial_joint_positions: [0.3]",
        "initial_joint_positions: [.nan]",
        &["swinging.initial_joint_positions", "holds NaN"],
    );
    refused(
        "initial_joint_velocities: [0.4]",
        "initial_joint_velocities: [1.0e7]",
        &[
            "target swinging cannot be simulated",
            "joint 'hinge' moves at 1.0e7 rad/s",
        ],
    );
    refused(
        "initial_joint_positions: [0.3]",
        "initial_joint_position: [0.3]",
        &["swinging.initial_joint_position"],
    );
    refused(
        "urdf: swinging.urdf",
        "urdf: gone.urdf",
        &["swinging.urdf", "gone.urdf"],
    );
}
