//! Scenarios in which bodies touch, against closed forms and the independent computations of
//! `crates/fuyu-physics/tests/capture/fixtures`.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;

use super::fuyu::{Run, fuyu};

const CONTACT: &str = include_str!("../../crates/fuyu-physics/tests/capture/fixtures/contact.json");
const GRIPPER: &str =
    include_str!("../../crates/fuyu-physics/tests/capture/fixtures/capture_gripper.json");

fn fixture(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

fn numbers(value: &Value) -> Vec<f64> {
    serde_json::from_value(value.clone()).unwrap_or_else(|e| panic!("{e}: {value}"))
}

fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_column_slice(&numbers(value))
}

/// A number in YAML, without exponent.
fn plain(x: f64) -> String {
    match x.fract() == 0.0 {
        true => format!("{x:.1}"),
        false => x.to_string(),
    }
}

fn list(values: &[f64]) -> String {
    let numbers: Vec<_> = values.iter().map(|x| plain(*x)).collect();
    format!("[{}]", numbers.join(", "))
}

/// A body with one shape.
fn body(mass: f64, inertia: &[Vec<f64>], shape: &str, origin: &str) -> String {
    format!(
        r#"<robot name="b"><link name="b"><inertial><mass value="{mass}"/><inertia ixx="{}" ixy="{}" ixz="{}" iyy="{}" iyz="{}" izz="{}"/></inertial>
        <collision><origin {origin}/><geometry>{shape}</geometry></collision></link></robot>"#,
        inertia[0][0], inertia[0][1], inertia[0][2], inertia[1][1], inertia[1][2], inertia[2][2]
    )
}

fn diagonal(x: f64) -> Vec<Vec<f64>> {
    vec![vec![x, 0.0, 0.0], vec![0.0, x, 0.0], vec![0.0, 0.0, x]]
}

/// A scenario with a robot and a target called `other`.
struct Scene {
    folder: tempfile::TempDir,
    text: String,
}

impl Scene {
    /// `start` and `of_target` are further parameters of base and target, `contact` those of contact; one a line.
    fn new(robot: &str, target: &str, start: &str, of_target: &str, contact: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("robot.urdf"), robot).unwrap();
        std::fs::write(folder.path().join("other.urdf"), target).unwrap();
        let indented = |text: &str, by: usize| {
            let lines = text
                .lines()
                .map(|line| format!("{:by$}{}\n", "", line.trim_start()));
            lines.collect::<String>()
        };
        let text = format!(
            "dynamics:\n  ros__parameters:\n    urdf: robot.urdf\n    integrator: dop8\n    state_rate: 10.0\n    base:\n{}    \
             targets: [other]\n    other:\n      urdf: other.urdf\n{}    contact:\n{}",
            indented(start, 6),
            indented(of_target, 6),
            indented(contact, 6),
        );
        Self { folder, text }
    }

    fn run(&self, duration: f64, more: &[&str]) -> Run {
        let path = self.folder.path().join("contact.yaml");
        std::fs::write(&path, &self.text).unwrap();
        let duration = duration.to_string();
        let mut args = vec![
            "simulate",
            path.to_str().unwrap(),
            "--json",
            "--duration",
            &duration,
        ];
        args.extend(more);
        fuyu(&args)
    }
}

/// Times at which `what` has happened.
fn times(run: &Value, what: &str) -> Vec<f64> {
    let events = run["events"].as_array().unwrap().iter();
    events
        .filter(|event| event["what"] == what)
        .map(|event| number(&event["time"]))
        .collect()
}

#[track_caller]
fn near(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (a, b) in found.iter().zip(expected) {
        let off = (a - b).abs();
        assert!(off <= tolerance, "{what}: {off:.1e} > {tolerance:.0e}");
    }
}

/// A ball that hits a slab: restitution and duration to 1e-9 of the closed forms, with the parameters' names and the default
/// tolerance. Fails if a parameter does not reach the law, or if events have the times of states.
#[test]
fn impacts_have_the_restitution_and_duration_of_the_closed_forms() {
    for case in fixture(CONTACT)["closed_form"].as_array().unwrap() {
        let of = |name: &str| number(&case[name]);
        let (radius, v, mass) = (of("R"), of("v0"), of("m1"));
        let ball = body(
            mass,
            &diagonal(0.01),
            &format!("<sphere radius=\"{radius}\"/>"),
            "",
        );
        let slab = body(
            of("m2"),
            &diagonal(of("m2")),
            "<box size=\"2 2 1\"/>",
            "xyz=\"0 0 -0.5\"",
        );
        let law = format!(
            "stiffness: {}\nexponent: {}\ndissipation: {}\nfriction: 0.0",
            plain(of("k")),
            plain(of("n")),
            plain(of("d"))
        );
        let start = format!(
            "position: [0.0, 0.0, {}]\nvelocity: [0.0, 0.0, {}]",
            radius + 1e-4,
            -v
        );
        let run = Scene::new(&ball, &slab, &start, "", &law)
            .run(0.2, &[])
            .json();
        let end = &run["final"];
        let speeds = [
            &end["base_velocity"][2],
            &end["targets"]["other"]["velocity"][2],
        ]
        .map(number);
        let e = (speeds[0] - speeds[1]) / v;
        near("restitution", &[e], &[of("restitution")], 1e-9);
        let begin = times(&run, "contact of b and other begins");
        let over = times(&run, "contact of b and other ends");
        near("touchdown", &begin, &[1e-4 / v], 1e-11);
        near(
            "duration",
            &[(over[0] - begin[0]) / of("duration")],
            &[1.0],
            1e-9,
        );
        let lost = 0.5 * of("m_eff") * v * v * (1.0 - e * e);
        near(
            "loss",
            &[number(&end["contact"]["dissipated_energy"])],
            &[lost],
            1e-10,
        );
        near(
            "P",
            &numbers(&end["momentum"]["linear"]),
            &[0.0, 0.0, -mass * v],
            1e-12,
        );
    }
}

/// Two free bodies as two other programs compute them; momentum is exact, and the bag's physics holds, although each body
/// alone loses momentum and energy.
#[test]
fn free_bodies_touch_as_other_programs_compute() {
    for (i, case) in fixture(CONTACT)["trajectories"]
        .as_array()
        .unwrap()
        .iter()
        .enumerate()
    {
        let name = case["name"].as_str().unwrap();
        let tolerance = if name.starts_with("box") { 1e-7 } else { 1e-8 };
        let (a, b) = (&case["A"], &case["B"]);
        let point = vector(&a["points"][0]).abs() * 2.0;
        let radius = &a["radius"][0];
        let (shape, origin) = match a["points"].as_array().unwrap().len() {
            1 => (format!("<sphere radius=\"{radius}\"/>"), ""),
            2 => (
                format!("<capsule radius=\"{radius}\" length=\"{}\"/>", point.x),
                "rpy=\"0 1.5707963267948966 0\"",
            ),
            _ => (
                format!("<box size=\"{} {} {}\"/>", point.x, point.y, point.z),
                "",
            ),
        };
        let (other, under) = match b["rB"].as_f64() {
            Some(radius) => (format!("<sphere radius=\"{radius}\"/>"), String::new()),
            None => (
                "<box size=\"4 4 1\"/>".to_owned(),
                format!("xyz=\"0 0 {}\"", number(&b["p0"][2]) - 0.5),
            ),
        };
        let solid = |of: &Value, shape: &str, origin: &str| {
            let inertia: Vec<Vec<f64>> = serde_json::from_value(of["I"].clone()).unwrap();
            body(number(&of["m"]), &inertia, shape, origin)
        };
        let at = |of: &str, k: usize| {
            let all = |what: &str| numbers(&case[format!("{of}_{what}")][k]);
            let q = all("quat_wxyz");
            let R = UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
            (all("com"), R, all("v"), all("w"))
        };
        let start = |of: &str| {
            let (p, R, v, w) = at(of, 0);
            let w_B = R.inverse() * Vector3::from_column_slice(&w);
            format!(
                "position: {}\norientation: {}\nvelocity: {}\nangular_velocity: {}",
                list(&p),
                list(R.coords.as_slice()),
                list(&v),
                list(w_B.as_slice())
            )
        };
        let law = &case["law"];
        let of = |name: &str| plain(number(&law[name]));
        let law = format!(
            "stiffness: {}\nexponent: {}\ndissipation: {}\npairs:\n",
            of("k"),
            of("n"),
            of("d")
        );
        let mut scene = Scene::new(
            &solid(a, &shape, origin),
            &solid(b, &other, &under),
            &start("A"),
            &start("B"),
            &law,
        );
        // A law of one pair overrides the default; its first body is the one whose deepest point counts.
        let pair = |name: &str| plain(number(&case["law"][name]));
        scene.text += &format!(
            "        b:\n          other:\n            friction: {}\n            stiction_speed: {}\n            point_weight: {}\n",
            pair("mu"),
            pair("vs"),
            pair("w")
        );
        let bag = scene.folder.path().join("bag");
        let bag = bag.to_str().unwrap();
        let run = scene.run(number(&case["T"]), &["--output", bag]).json();
        let end = &run["final"];
        let last = case["t"].as_array().unwrap().len() - 1;
        let target = &end["targets"]["other"];
        for (of, found) in [
            (
                "A",
                ["base_position", "base_velocity", "base_angular_velocity"].map(|k| &end[k]),
            ),
            (
                "B",
                ["position", "velocity", "angular_velocity"].map(|k| &target[k]),
            ),
        ] {
            let (p, _, v, w) = at(of, last);
            for (found, expected) in found.iter().zip([p, v, w]) {
                near(
                    &format!("{name} {of}"),
                    &numbers(found),
                    &expected,
                    tolerance,
                );
            }
        }
        near(
            name,
            &numbers(&end["momentum"]["linear"]),
            &numbers(&case["P"]),
            1e-12,
        );
        let residual = &run["momentum_residual"];
        assert!(
            number(&residual["linear"]) < 1e-14 && number(&residual["angular"]) < 1e-13,
            "{residual}"
        );
        assert!(number(&run["energy_residual"]) < 1e-8, "{run}");
        let events = case["events"].as_array().unwrap();
        let kinds = |kind: &str| events.iter().filter(|e| e["kind"] == kind).count();
        assert_eq!(
            times(&run, "contact of b and other begins").len(),
            kinds("touchdown"),
            "{name}"
        );
        assert_eq!(
            times(&run, "contact of b and other ends").len(),
            kinds("liftoff"),
            "{name}"
        );
        if i < 2 {
            let check = fuyu(&["bag", "check", bag, "--json"]);
            assert_eq!(check.code, 0, "{name}: {}{}", check.stdout, check.stderr);
        }
    }
}

/// The servicer with a gripper of two coupled fingers around a bar of a tumbling target: momentum of 20 s does not drift
/// (MuJoCo at 1 ms: 1.2e-5 N s, 5e-5 N m s), and the fingers hold.
#[test]
fn a_gripper_holds_a_tumbling_target() {
    let file = fixture(GRIPPER);
    let gripper = &file["gripper"];
    let of = |name: &str| number(&gripper[name]);
    let link = |name: &str, mass: f64, half: Vector3<f64>| {
        let s = half.component_mul(&half) * (mass / 3.0);
        let size = half * 2.0;
        format!(
            r#"<link name="{name}"><inertial><mass value="{mass}"/><inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial>
            <collision><geometry><box size="{} {} {}"/></geometry></collision></link>"#,
            s.y + s.z,
            s.x + s.z,
            s.x + s.y,
            size.x,
            size.y,
            size.z
        )
    };
    let finger = |name: &str, side: f64, mimic: &str| {
        format!(
            r#"{}<joint name="{name}_joint" type="prismatic"><parent link="tool0"/><child link="{name}"/>
            <origin xyz="{} {} 0"/><axis xyz="0 {} 0"/><limit effort="1000" velocity="10" lower="-1" upper="1"/>
            <dynamics damping="{}"/>{mimic}</joint>"#,
            link(name, of("finger_mass"), vector(&gripper["finger_half"])),
            of("finger_at_x"),
            side * of("finger_open_y"),
            -side,
            of("finger_damping"),
        )
    };
    let palm = vector(&gripper["palm_at"]);
    let added = format!(
        r#"{}<joint name="palm_joint" type="fixed"><parent link="tool0"/><child link="palm"/><origin xyz="{} {} {}"/></joint>{}{}</robot>"#,
        link("palm", of("palm_mass"), vector(&gripper["palm_half"])),
        palm.x,
        palm.y,
        palm.z,
        finger("left", 1.0, ""),
        finger("right", -1.0, "<mimic joint=\"left_joint\"/>"),
    );
    let mut robot = include_str!("../../urdf/servicer.urdf").replace("</robot>", &added);
    for (k, damping) in numbers(&gripper["joint_damping"]).iter().enumerate() {
        let at = robot
            .find(&format!("<joint name=\"joint{}\"", k + 1))
            .unwrap();
        let end = at + robot[at..].find("<axis").unwrap();
        robot.insert_str(end, &format!("<dynamics damping=\"{damping}\"/>"));
    }
    let behind = of("com_behind_bar");
    let inertia = vector(&gripper["target_inertia"]);
    let inertia = [inertia.x, inertia.y, inertia.z];
    let rows: Vec<Vec<f64>> = (0..3)
        .map(|i| {
            (0..3)
                .map(|j| if i == j { inertia[i] } else { 0.0 })
                .collect()
        })
        .collect();
    let bar = format!(
        "<capsule radius=\"{}\" length=\"{}\"/>",
        of("bar_radius"),
        2.0 * of("bar_half")
    );
    let target = body(
        of("target_mass"),
        &rows,
        &bar,
        &format!("xyz=\"{} 0 0\"", -behind),
    );
    // Where the tool is, by another command.
    let mut q = numbers(&file["q0"]);
    q.push(0.0);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.urdf");
    std::fs::write(&path, &robot).unwrap();
    let positions: Vec<_> = q.iter().map(f64::to_string).collect();
    let found = fuyu(&[
        "inspect",
        path.to_str().unwrap(),
        &format!("--q={}", positions.join(",")),
        "--json",
    ])
    .json();
    let o = numbers(&found["tip_pose"]["orientation"]);
    let X = Isometry3::from_parts(
        Translation3::from(vector(&found["tip_pose"]["position"])),
        UnitQuaternion::from_quaternion(Quaternion::new(o[3], o[0], o[1], o[2])),
    );
    let w = Vector3::new(0.03, 0.04, -0.036);
    let to_com = Vector3::new(behind, 0.0, 0.0);
    let v = X.rotation * (Vector3::new(3e-3, 3.6e-3, 2.7e-3) + w.cross(&to_com));
    let p = X * nalgebra::Point3::new(of("bar_at_x") + behind, 0.0, 0.0);
    let of_target = format!(
        "position: {}\norientation: {}\nvelocity: {}\nangular_velocity: {}",
        list(p.coords.as_slice()),
        list(&o),
        list(v.as_slice()),
        list(w.as_slice())
    );
    let law = "stiffness: 1.0e6\ndissipation: 10.0\nfriction: 0.8\nstiction_speed: 0.001";
    let mut scene = Scene::new(
        &robot,
        &target,
        "position: [0.0, 0.0, 0.0]",
        &of_target,
        law,
    );
    scene.text = scene.text.replace(
        "state_rate: 10.0",
        &format!(
            "state_rate: 10.0\n    time_step: 0.1\n    initial_joint_positions: {}",
            list(&q)
        ),
    );
    scene.text += "    joint_physics:\n      stops: false\n    excitations:\n      grip:\n        joint: left_joint\n        amplitude: 200.0\n";
    let start = scene.run(1e-9, &[]).json();
    let run = scene.run(20.0, &[]).json();
    println!(
        "{} s for 20 s, {}",
        run["wall_time"], run["final"]["contact"]
    );
    let change = |part: &str| {
        let at = |run: &Value| vector(&run["final"]["momentum"][part]);
        (at(&run) - at(&start)).norm()
    };
    assert!(
        change("linear") < 1e-9 && change("angular") < 1e-8,
        "{} {}",
        change("linear"),
        change("angular")
    );
    assert_eq!(run["final"]["contact"]["points"], 4);
    // Each finger presses with half of the effort: 2 points of 50 N each, and k = 1e6 N/m stores 2.5e-9 m² k / 2 each.
    let stored = number(&run["final"]["contact"]["stored_energy"]);
    assert!((stored / 0.005 - 1.0).abs() < 0.01, "{stored}");
}

fn balls(gap: f64, contact: &str) -> Scene {
    let ball = body(1.0, &diagonal(0.01), "<sphere radius=\"0.1\"/>", "");
    let start = format!("position: [{}, 0.0, 0.0]", 0.2 + gap);
    Scene::new(&ball, &ball, &start, "", contact)
}

/// What cannot touch, or overlaps, is refused in one line before anything runs.
#[test]
fn wrong_contacts_are_refused() {
    let flat = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid s\n";
    let mesh = body(1.0, &diagonal(0.01), "<mesh filename=\"flat.stl\"/>", "");
    let bare = mesh.replace("<mesh filename=\"flat.stl\"/>", "");
    let ball = body(1.0, &diagonal(0.01), "<sphere radius=\"0.1\"/>", "");
    let with = |robot: &str, target: &str| {
        Scene::new(
            robot,
            target,
            "position: [5.0, 0.0, 0.0]",
            "",
            "friction: 0.3",
        )
    };
    for (scene, says) in [
        (
            balls(-1e-3, "friction: 0.3"),
            "b and other overlap by 1.00e-3 m at the start",
        ),
        (
            balls(1.0, "friction: -0.1"),
            "contact.friction of /dynamics: -0.1 is out of range, expected 0.0 or above",
        ),
        (
            balls(1.0, "stiffness: 0.0"),
            "contact.stiffness of /dynamics: 0 is out of range, expected a number above 0.0",
        ),
        (balls(1.0, "exponent: 0.5"), "contact.exponent"),
        (
            balls(1.0, "pairs.b.other.friction: -0.2"),
            "contact.pairs.b.other.friction of /dynamics: -0.2 is out of range",
        ),
        (
            balls(1.0, "pairs.b.station.friction: 0.2"),
            "'station' is no link, target or <collision> element",
        ),
        (balls(1.0, "frition: 0.2"), "did you mean contact.friction?"),
        (
            with(&mesh, &ball),
            "<collision> of link 'b': the mesh has no volume: its 3 points are in one plane",
        ),
        (
            with(&bare, &bare),
            "neither the robot nor a target has <collision> elements",
        ),
        (
            with(&mesh.replace("flat.stl", "none.stl"), &ball),
            "none.stl",
        ),
    ] {
        std::fs::write(scene.folder.path().join("flat.stl"), flat).unwrap();
        let run = scene.run(1.0, &[]);
        let message = run.refusal();
        assert!(message.contains(says), "{says}: {message}");
    }
    let mut flexible = balls(1.0, "friction: 0.3");
    flexible.text += "    wheels: [w]\n    w:\n      axis: [0.0, 0.0, 1.0]\n      inertia: 0.1\n";
    let run = flexible.run(1.0, &[]);
    assert!(
        run.refusal()
            .contains("parameter contact: a robot with appendages"),
        "{}",
        run.stderr
    );
}

/// Bodies that never come close move exactly as without contact, and pairs that are switched off pass through each other.
#[test]
fn bodies_that_do_not_touch_move_as_without_contact() {
    let moving = |contact: &str| {
        let mut scene = balls(1.0, contact);
        scene.text = scene.text.replace("    other:\n", "    other:\n      velocity: [0.3, 0.0, 0.0]\n      angular_velocity: [0.1, 0.2, 0.3]\n");
        if contact.is_empty() {
            scene.text = scene.text.replace("    contact:\n", "");
        }
        scene
    };
    let positions = |run: Value| run["final"]["targets"].clone();
    let free = positions(moving("").run(1.0, &[]).json());
    assert_eq!(
        positions(moving("friction: 0.3").run(1.0, &[]).json()),
        free
    );
    let through = moving("enabled: true\npairs.other.b.enabled: false")
        .run(8.0, &[])
        .json();
    assert_eq!(through["events"].as_array().unwrap().len(), 0);
    let hit = moving("friction: 0.3").run(8.0, &[]).json();
    assert_eq!(
        hit["events"].as_array().unwrap().len(),
        2,
        "{}",
        hit["events"]
    );
}
