//! `fuyu inspect`: its JSON against Pinocchio's numbers, its options, its table.

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3};
use serde_json::Value;

use super::fuyu::{file, fuyu};

/// Pinocchio's numbers for three free-floating trees, computed with other formulas in another language. They
/// are doubles; 1e-12 of the largest entry allows for accumulated rounding errors.
const REFERENCE: &str = include_str!("../validation/fixtures/gjm.json");
const RELATIVE: f64 = 1e-12;

fn numbers(value: &Value) -> Vec<f64> {
    let list = value.as_array().expect("a list");
    list.iter().map(|x| x.as_f64().expect("a number")).collect()
}

fn matrix(value: &Value) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = value
        .as_array()
        .expect("rows")
        .iter()
        .map(numbers)
        .collect();
    let columns = rows.first().map_or(0, Vec::len);
    DMatrix::from_row_slice(rows.len(), columns, &rows.concat())
}

fn words(values: &[f64]) -> String {
    let words: Vec<String> = values.iter().map(|x| format!("{x:?}")).collect();
    words.join(" ")
}

fn origin(position: &[f64], rotation: &DMatrix<f64>) -> String {
    let rotation = Matrix3::from_iterator(rotation.iter().copied());
    let (roll, pitch, yaw) = Rotation3::from_matrix_unchecked(rotation).euler_angles();
    format!(
        "<origin xyz=\"{}\" rpy=\"{roll:?} {pitch:?} {yaw:?}\"/>",
        words(position)
    )
}

fn link(name: &str, mass: &Value, com: &[f64], inertia: &Value) -> String {
    let (mass, i) = (mass.as_f64().unwrap(), matrix(inertia));
    format!(
        "<link name=\"{name}\"><inertial><origin xyz=\"{}\"/><mass value=\"{mass:?}\"/><inertia ixx=\"{:?}\" ixy=\"{:?}\" ixz=\"{:?}\" iyy=\"{:?}\" iyz=\"{:?}\" izz=\"{:?}\"/></inertial></link>\n",
        words(com),
        i[(0, 0)],
        i[(0, 1)],
        i[(0, 2)],
        i[(1, 1)],
        i[(1, 2)],
        i[(2, 2)]
    )
}

/// The case's robot; links in the file's order, which is not always depth first.
fn urdf(case: &Value) -> String {
    let base = &case["base"];
    let mut urdf = "<robot name=\"case\">\n".to_owned();
    urdf += &link("base_link", &base["m"], &[0.0; 3], &base["I"]);
    for (k, l) in case["links"].as_array().unwrap().iter().enumerate() {
        let kind = match l["type"].as_str() {
            Some("P") => "prismatic",
            _ => "revolute",
        };
        let parent = match l["parent"].as_u64() {
            Some(p) => format!("link{p}"),
            None => "base_link".to_owned(),
        };
        urdf += &format!(
            "<joint name=\"joint{k}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"link{k}\"/>{}<axis xyz=\"{}\"/><limit lower=\"-9\" upper=\"9\" effort=\"9\" velocity=\"9\"/></joint>\n",
            origin(&numbers(&l["p0"]), &matrix(&l["R0"])),
            words(&numbers(&l["axis"]))
        );
        urdf += &link(&format!("link{k}"), &l["m"], &numbers(&l["c"]), &l["I"]);
    }
    let tip = &case["ee"];
    urdf += &format!(
        "<joint name=\"weld\" type=\"fixed\"><parent link=\"link{}\"/><child link=\"hand\"/>{}</joint><link name=\"hand\"/></robot>\n",
        tip["link"],
        origin(&numbers(&tip["p"]), &matrix(&tip["R"]))
    );
    urdf
}

/// The largest difference is within [`RELATIVE`] of the largest entry.
#[track_caller]
fn assert_close(what: &str, ours: &DMatrix<f64>, theirs: &DMatrix<f64>) {
    assert_eq!(ours.shape(), theirs.shape(), "{what}");
    let difference = (ours - theirs).amax() / theirs.amax();
    assert!(difference <= RELATIVE, "{what} differs by {difference:e}");
}

#[test]
fn json_agrees_with_pinocchio() {
    let reference: Value = serde_json::from_str(REFERENCE).unwrap();
    let mut reordered = 0;
    for case in reference["cases"].as_array().unwrap() {
        let (_folder, path) = file("case.urdf", urdf(case));
        let path = path.to_str().unwrap();
        let joints = fuyu(&["inspect", path, "--json"]).json()["joints"].clone();
        // Ours are numbered depth first: the file's index of each.
        let order: Vec<usize> = joints
            .as_array()
            .unwrap()
            .iter()
            .map(|name| {
                name.as_str()
                    .unwrap()
                    .trim_start_matches("joint")
                    .parse()
                    .unwrap()
            })
            .collect();
        reordered += usize::from(!order.is_sorted());
        let list = |values: &[f64]| words(values).replace(' ', ",");
        let of_joints = |key: &str| {
            let values = numbers(&case[key]);
            list(&order.iter().map(|&k| values[k]).collect::<Vec<_>>())
        };
        let twist = numbers(&case["base_twist_bodyframe_lin_ang"]);
        let ours = fuyu(&[
            "inspect",
            path,
            "--json",
            "--tip=hand",
            &format!("--q={}", of_joints("q")),
            &format!("--qd={}", of_joints("qd")),
            &format!("--tau={}", of_joints("tau")),
            &format!("--base-twist={}", list(&twist)),
        ])
        .json();

        for (ours_key, theirs_key) in [
            ("generalized_jacobian", "GJM"),
            ("fixed_base_jacobian", "J_fixed"),
            ("base_map", "base_map_HL_HA"),
        ] {
            let theirs = matrix(&case[theirs_key]).select_columns(&order);
            assert_close(ours_key, &matrix(&ours[ours_key]), &theirs);
        }
        let theirs = matrix(&case["H_hat"])
            .select_columns(&order)
            .select_rows(&order);
        assert_close(
            "reduced_inertia",
            &matrix(&ours["reduced_inertia"]),
            &theirs,
        );
        let column = |values: Vec<f64>| DMatrix::from_column_slice(values.len(), 1, &values);
        let theirs = column(numbers(&case["ABA_qdd"])).select_rows(&order);
        assert_close("qdd", &column(numbers(&ours["qdd"])), &theirs);

        // Pinocchio's is in world axes; without momentum it is zero only up to rounding errors.
        let R_WB = matrix(&case["base_R"]);
        let world = numbers(&case["centroidal_momentum_world_lin_ang"]);
        let momentum = &ours["momentum"];
        let mut mass = case["base"]["m"].as_f64().unwrap();
        for l in case["links"].as_array().unwrap() {
            mass += l["m"].as_f64().unwrap();
        }
        for (part, theirs) in [("linear", &world[..3]), ("angular", &world[3..])] {
            let theirs = R_WB.transpose() * column(theirs.to_vec());
            let difference = (column(numbers(&momentum[part])) - theirs).amax();
            assert!(
                difference <= RELATIVE * mass,
                "{part} momentum: {difference:e}"
            );
        }
        let velocity = DVector::from_vec([twist, numbers(&case["qd"])].concat());
        let energy = 0.5 * velocity.dot(&(matrix(&case["M_full"]) * &velocity));
        let ours_energy = ours["kinetic_energy"].as_f64().unwrap();
        assert!(
            (ours_energy - energy).abs() <= RELATIVE * energy,
            "{ours_energy} {energy}"
        );
        assert!((ours["total_mass"].as_f64().unwrap() - mass).abs() <= RELATIVE * mass);
    }
    assert!(reordered > 0, "a case must test the numbering");
}

#[test]
fn json_holds_what_was_asked_for_and_nothing_else() {
    let keys = |options: &[&str]| -> Vec<String> {
        let args = [&["inspect", "urdf/planar_two_link.urdf", "--json"], options].concat();
        fuyu(&args)
            .json()
            .as_object()
            .unwrap()
            .keys()
            .cloned()
            .collect()
    };
    let always = [
        "base_map",
        "com",
        "fixed_base_jacobian",
        "generalized_jacobian",
        "joints",
        "reduced_inertia",
        "tip",
        "tip_pose",
        "total_mass",
    ];
    assert_eq!(keys(&[]), always);
    let with = |more: &[&'static str]| {
        let mut keys = [&always, more].concat();
        keys.sort_unstable();
        keys
    };
    assert_eq!(keys(&["--qd=1,2"]), with(&["momentum", "kinetic_energy"]));
    assert_eq!(keys(&["--tau=1,2"]), with(&["qdd"]));
}

#[test]
fn momentum_is_zero_unless_the_base_moves() {
    let run = |more: &[&str]| {
        let args = [
            &[
                "inspect",
                "urdf/servicer.urdf",
                "--json",
                "--q=1,-1,.5,2,-.3,.7",
            ],
            more,
        ]
        .concat();
        fuyu(&args).json()
    };
    let rates = "--qd=.1,.2,-.3,.4,.5,-.6";
    let still = run(&[rates]);
    let size = |report: &Value, part: &str| {
        numbers(&report["momentum"][part])
            .iter()
            .fold(0.0f64, |m, x| m.max(x.abs()))
    };
    assert!(size(&still, "linear") < 1e-12 && size(&still, "angular") < 1e-12);
    assert!(still["kinetic_energy"].as_f64().unwrap() > 1.0);
    // With all joints at rest the system is one rigid body of 2140 kg.
    let moving = run(&["--base-twist=.5,0,0,0,0,0"]);
    assert!((numbers(&moving["momentum"]["linear"])[0] - 1070.0).abs() < 1e-9);
    assert!(size(&moving, "angular") < 1e-10);
    assert!((moving["kinetic_energy"].as_f64().unwrap() - 267.5).abs() < 1e-9);
}

#[test]
fn the_tip_is_tool0_or_the_last_leaf() {
    let jacobian = |urdf: &str, tip: &[&str]| {
        let args = [&["inspect", urdf, "--json"], tip].concat();
        fuyu(&args).json()["fixed_base_jacobian"].clone()
    };
    let servicer = "urdf/servicer.urdf";
    assert_eq!(
        jacobian(servicer, &[]),
        jacobian(servicer, &["--tip=tool0"])
    );
    assert_ne!(
        jacobian(servicer, &[]),
        jacobian(servicer, &["--tip=link6"])
    );
    let text = std::fs::read_to_string(servicer)
        .unwrap()
        .replace("tool0", "hand");
    let (_folder, path) = file("renamed.urdf", text);
    assert_eq!(
        jacobian(path.to_str().unwrap(), &[]),
        jacobian(servicer, &["--tip=tool0"])
    );
}

#[test]
fn json_has_the_tip_and_its_pose() {
    let report = fuyu(&["inspect", "urdf/planar_two_link.urdf", "--json"]).json();
    assert_eq!(report["tip"], "tool0");
    let stretched = numbers(&report["tip_pose"]["position"]);
    let turned = fuyu(&[
        "inspect",
        "urdf/planar_two_link.urdf",
        "--json",
        "--q=joint1=1.5707963267948966",
    ])
    .json();
    // Only the first joint turns, by a right angle about z: the attitude is the quaternion of that, in base axes.
    let [x, y, z, w] = numbers(&turned["tip_pose"]["orientation"])[..] else {
        panic!("four numbers");
    };
    let root = 0.5_f64.sqrt();
    assert!(x.abs() < 1e-15 && y.abs() < 1e-15);
    assert!((z - root).abs() < 1e-15 && (w - root).abs() < 1e-15);
    assert_ne!(numbers(&turned["tip_pose"]["position"]), stretched);
    let in_order = fuyu(&[
        "inspect",
        "urdf/planar_two_link.urdf",
        "--json",
        "--q=1.5707963267948966,0",
    ]);
    assert_eq!(in_order.json(), turned);
}

#[test]
fn a_tip_that_no_joint_moves_is_refused() {
    let run = fuyu(&["inspect", "urdf/servicer.urdf", "--tip=base_link"]);
    let message = run.refusal();
    assert!(message.contains("fixed to the base base_link"), "{message}");
    assert!(message.contains("joints move link1"), "{message}");
    // Without a link called tool0, the default is one that joints move.
    let text = std::fs::read_to_string("urdf/planar_two_link.urdf").unwrap();
    let camera = "<link name=\"camera\"/><joint name=\"mount\" type=\"fixed\"><parent link=\"base_link\"/><child link=\"camera\"/></joint></robot>";
    let text = text.replace("tool0", "hand").replace("</robot>", camera);
    let (_folder, path) = file("camera.urdf", text);
    let report = fuyu(&["inspect", path.to_str().unwrap(), "--json"]).json();
    assert_eq!(report["tip"], "hand");
    // A single body has no joints, and any link may be the tip.
    let report = fuyu(&["inspect", "urdf/target.urdf", "--json"]).json();
    assert!(report["tip"].is_string());
}

#[test]
fn goals_are_reached_by_the_free_floating_robot_or_not() {
    let here = fuyu(&[
        "inspect",
        "urdf/servicer.urdf",
        "--json",
        "--q=joint2=0.5,joint3=-1",
    ])
    .json();
    let [x, y, z] = numbers(&here["tip_pose"]["position"])[..] else {
        panic!("three numbers");
    };
    let goal = format!("--reach={},{},{}", x - 0.3, y + 0.2, z - 0.1);
    let args = [
        "inspect",
        "urdf/servicer.urdf",
        "--json",
        "--q=joint2=0.5,joint3=-1",
        &goal,
    ];
    let reach = fuyu(&args).json()["reach"].clone();
    assert_eq!(reach["reachable"], true);
    let found = numbers(&reach["tip_pose"]["position"]);
    for (found, wanted) in found.iter().zip([x - 0.3, y + 0.2, z - 0.1]) {
        assert!((found - wanted).abs() < 1e-8, "{found} {wanted}");
    }
    // The base has moved, and the tip's pose in it is what the joints say.
    assert!(
        numbers(&reach["base_pose"]["position"])
            .iter()
            .any(|p| p.abs() > 1e-4)
    );
    assert_eq!(numbers(&reach["q"]).len(), 6);
    let far = fuyu(&["inspect", "urdf/servicer.urdf", "--json", "--reach=100,0,0"]);
    assert_eq!(far.code, 1);
    assert!(
        far.stderr.contains("from the centre of mass"),
        "{}",
        far.stderr
    );
    assert_eq!(
        serde_json::from_str::<Value>(&far.stdout).unwrap()["reach"]["reachable"],
        false
    );
    let run = fuyu(&["inspect", "urdf/servicer.urdf", "--reach=1,2"]);
    assert!(run.stderr.contains("give X,Y,Z"), "{}", run.stderr);
}

#[test]
fn repairs_are_warnings_unless_strict() {
    let text = std::fs::read_to_string("urdf/planar_two_link.urdf").unwrap();
    let text = text.replacen("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 2\"/>", 1);
    let (_folder, path) = file("long_axis.urdf", text);
    let path = path.to_str().unwrap();
    let run = fuyu(&["inspect", path, "--json"]);
    assert_eq!(run.code, 0);
    assert!(run.stderr.contains("fuyu: warning: "), "{}", run.stderr);
    assert!(
        run.stderr.contains("joint1 (length 2.000000)"),
        "{}",
        run.stderr
    );
    let refusal = fuyu(&["inspect", path, "--strict"]);
    assert!(refusal.refusal().contains("must be a unit vector"));
}

#[test]
fn values_may_start_with_a_minus_sign() {
    let joined = fuyu(&["inspect", "urdf/planar_two_link.urdf", "--json", "--q=-1,2"]);
    let apart = fuyu(&[
        "inspect",
        "urdf/planar_two_link.urdf",
        "--json",
        "--q",
        "-1,2",
    ]);
    assert_eq!(joined.json(), apart.json());
    let zero = fuyu(&["inspect", "urdf/planar_two_link.urdf", "--json"]);
    assert_ne!(joined.json()["com"], zero.json()["com"]);
}

#[test]
fn the_shipped_robots_have_their_published_masses() {
    let report = |name: &str| fuyu(&["inspect", &format!("urdf/{name}.urdf"), "--json"]).json();
    assert_eq!(report("servicer")["total_mass"], 2140.0);
    assert_eq!(report("planar_two_link")["total_mass"], 600.0);
    for (name, joints) in [("servicer", 6), ("planar_two_link", 2), ("target", 0)] {
        assert_eq!(
            report(name)["joints"].as_array().unwrap().len(),
            joints,
            "{name}"
        );
    }
}

#[test]
fn wrong_options_are_refused_by_name() {
    let says = |options: &[&str], parts: &[&str]| {
        let run = fuyu(&[&["inspect", "urdf/planar_two_link.urdf"], options].concat());
        let message = run.refusal();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    };
    says(&["--q=1"], &["--q has 1 of 2 values", "joint1, joint2"]);
    says(&["--tau=1,2,3"], &["--tau has 3 of 2 values"]);
    says(
        &["--base-twist=1,2"],
        &["--base-twist has 2 values", "vx,vy,vz,wx,wy,wz"],
    );
    says(
        &["--tip=hand"],
        &[
            "--tip 'hand' is not a link",
            "base_link, link1, link2, tool0",
        ],
    );
    says(&["--qd=1e200,1e200"], &["overflow"]);
    for values in ["--q=1,nan", "--q=1,,2", "--q=", "--q=1;2"] {
        let run = fuyu(&["inspect", "urdf/planar_two_link.urdf", values]);
        assert_eq!((run.code, run.stdout.as_str()), (2, ""));
        assert!(
            run.stderr.contains("is not a finite number"),
            "{}",
            run.stderr
        );
    }
    let run = fuyu(&["inspect", "urdf/target.urdf", "--q=1"]);
    assert!(run.refusal().contains("no moving joint"));
}

#[test]
fn the_table_names_joints_and_units() {
    let run = fuyu(&[
        "inspect",
        "urdf/servicer.urdf",
        "--tau=1,0,0,0,0,0",
        "--qd=0,0,0,0,0,0",
    ]);
    assert_eq!((run.code, run.stderr.as_str()), (0, ""));
    for part in [
        "2140 kg",
        "joint6",
        "tool0",
        "generalized Jacobian",
        "reduced inertia",
        "rad/s2",
    ] {
        assert!(run.stdout.contains(part), "no {part:?} in:\n{}", run.stdout);
    }
}
