//! `fuyu inspect --json` against Pinocchio on random robot descriptions: the whole way from URDF text to
//! numbers, through other code. Trees with branches, all joint types, mimic joints, links fixed to links, massless
//! frames, a massless root, rotated inertial frames, links and joints in any order.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use serde_json::{Value, json};

use crate::{
    fixtures::{numbers, rows},
    python,
};

const TREES: u64 = 100;

/// Of the largest entry of each quantity. Pinocchio inverts the whole-body mass matrix, fuyu never builds
/// it; what is left is the rounding of the two ways.
const RELATIVE: f64 = 1e-12;

fn number(rng: &mut StdRng, scale: f64) -> f64 {
    rng.random_range(-scale..scale)
}

fn vector(rng: &mut StdRng, scale: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| number(rng, scale))
}

fn triple(v: &Vector3<f64>) -> String {
    format!("{:?} {:?} {:?}", v.x, v.y, v.z)
}

fn origin(rng: &mut StdRng) -> String {
    let (xyz, rpy) = (vector(rng, 1.0), vector(rng, 3.0));
    format!(
        "<origin xyz=\"{}\" rpy=\"{}\"/>",
        triple(&xyz),
        triple(&rpy)
    )
}

/// A physical inertia, full, in a frame that is shifted and turned.
fn inertial(rng: &mut StdRng, mass: std::ops::Range<f64>) -> String {
    let mass = rng.random_range(mass);
    let second = Vector3::from_fn(|_, _| rng.random_range(0.02..0.5));
    let principal = Vector3::from_element(second.sum()) - second;
    let turn = Rotation3::new(vector(rng, 2.0)).into_inner();
    let i = turn * Matrix3::from_diagonal(&(principal * mass)) * turn.transpose();
    format!(
        "<inertial>{}<mass value=\"{mass:?}\"/><inertia ixx=\"{:?}\" ixy=\"{:?}\" ixz=\"{:?}\" iyy=\"{:?}\" iyz=\"{:?}\" izz=\"{:?}\"/></inertial>",
        origin(rng),
        i[(0, 0)],
        i[(0, 1)],
        i[(0, 2)],
        i[(1, 1)],
        i[(1, 2)],
        i[(2, 2)],
    )
}

/// A random description and what to ask about it.
fn case(seed: u64) -> Value {
    let rng = &mut StdRng::seed_from_u64(seed);
    let moving = rng.random_range(2..=12);
    let mut elements = Vec::new();
    let mut links = vec!["base".to_owned()];
    // Links that a joint moves: others cannot be a tip.
    let mut moved: Vec<String> = Vec::new();
    let mut values: [BTreeMap<String, f64>; 4] = Default::default();
    let mut mimics: BTreeMap<String, (String, f64, f64)> = BTreeMap::new();

    let massless_root = rng.random_bool(0.2);
    let base = inertial(rng, 50.0..200.0);
    if massless_root {
        elements.push("<link name=\"base\"/>".to_owned());
        elements.push(format!("<link name=\"hull\">{base}</link>"));
        elements.push(format!(
            "<joint name=\"to_hull\" type=\"fixed\"><parent link=\"base\"/><child link=\"hull\"/>{}</joint>",
            origin(rng)
        ));
        links.push("hull".to_owned());
    } else {
        elements.push(format!("<link name=\"base\">{base}</link>"));
    }

    while values[0].len() < moving {
        let k = links.len();
        // Mostly chains, with branches.
        let parent = match rng.random_bool(0.6) {
            true => k - 1,
            false => rng.random_range(0..k),
        };
        let kinds = ["revolute", "continuous", "prismatic", "fixed"];
        let kind = kinds[rng.random_range(0..kinds.len())];
        if kind != "fixed" || moved.contains(&links[parent]) {
            moved.push(format!("l{k}"));
        }
        let mut joint = format!(
            "<joint name=\"j{k}\" type=\"{kind}\"><parent link=\"{}\"/><child link=\"l{k}\"/>{}",
            links[parent],
            origin(rng)
        );
        let frame_only = kind == "fixed" && rng.random_bool(0.5);
        if kind != "fixed" {
            let axis = Unit::new_normalize(vector(rng, 1.0));
            let damping = rng.random_range(0.0..2.0);
            let _ = write!(
                joint,
                "<axis xyz=\"{}\"/><limit lower=\"-4\" upper=\"4\" effort=\"9\" velocity=\"9\"/><dynamics damping=\"{damping:?}\"/>",
                triple(&axis)
            );
            let random = [
                number(rng, 3.0),
                number(rng, 1.0),
                number(rng, 5.0),
                damping,
            ];
            let leaders: Vec<String> = values[0].keys().cloned().collect();
            if !leaders.is_empty() && rng.random_bool(0.15) {
                // It follows a joint with a coordinate; the joints of the file are shuffled, so that this may come later.
                let leader = leaders[rng.random_range(0..leaders.len())].clone();
                let (ratio, offset) = (number(rng, 2.0), number(rng, 0.5));
                let _ = write!(
                    joint,
                    "<mimic joint=\"{leader}\" multiplier=\"{ratio:?}\" offset=\"{offset:?}\"/>"
                );
                values[3].insert(format!("j{k}"), damping);
                mimics.insert(format!("j{k}"), (leader, ratio, offset));
            } else {
                for (of_joint, value) in values.iter_mut().zip(random) {
                    of_joint.insert(format!("j{k}"), value);
                }
            }
        }
        elements.push(joint + "</joint>");
        elements.push(match frame_only {
            true => format!("<link name=\"l{k}\"/>"),
            false => format!("<link name=\"l{k}\">{}</link>", inertial(rng, 1.0..20.0)),
        });
        links.push(format!("l{k}"));
    }
    elements.shuffle(rng);
    let [q, qd, tau, damping] = values;
    let tip = &moved[rng.random_range(0..moved.len())];
    let twist: Vec<f64> = (0..6).map(|_| number(rng, 0.5)).collect();
    json!({
        "urdf": format!("<robot name=\"r{seed}\">\n{}\n</robot>\n", elements.join("\n")),
        "tip": tip, "q": q, "qd": qd, "tau": tau, "damping": damping, "base_twist": twist, "mimics": mimics,
    })
}

fn inspect(case: &Value, folder: &Path) -> Value {
    let urdf = folder.join("robot.urdf");
    std::fs::write(&urdf, case["urdf"].as_str().unwrap()).unwrap();
    let run = |options: &[String]| {
        let output = Command::new(env!("CARGO_BIN_EXE_fuyu"))
            .args(["inspect".as_ref(), urdf.as_os_str(), "--json".as_ref()])
            .args(options)
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{}\n{}",
            String::from_utf8_lossy(&output.stderr),
            case["urdf"].as_str().unwrap()
        );
        serde_json::from_slice::<Value>(&output.stdout).unwrap()
    };
    // Only fuyu knows its order of joints.
    let joints = run(&[])["joints"].clone();
    let list = |values: Vec<&Value>| {
        let words: Vec<String> = values
            .iter()
            .map(|x| format!("{:?}", x.as_f64().unwrap()))
            .collect();
        words.join(",")
    };
    let mut options = vec![format!("--tip={}", case["tip"].as_str().unwrap())];
    for key in ["q", "qd", "tau"] {
        let names = joints.as_array().unwrap().iter();
        let values = names.map(|name| &case[key][name.as_str().unwrap()]);
        options.push(format!("--{key}={}", list(values.collect())));
    }
    let twist = case["base_twist"].as_array().unwrap();
    options.push(format!("--base-twist={}", list(twist.iter().collect())));
    run(&options)
}

fn pinocchio(cases: &[Value]) -> Vec<Value> {
    let interpreter = python::environment("test-venv.sh", &["pinocchio", "pin==4.1.0"]);
    let script = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/validation/ask_pinocchio.py"
    );
    let answer = python::run(&interpreter, &[script], &json!(cases).to_string());
    serde_json::from_str(&answer).unwrap()
}

/// Largest difference over the largest entry.
fn relative_difference(ours: &[f64], theirs: &[f64]) -> f64 {
    assert_eq!(ours.len(), theirs.len());
    let scale = theirs.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let pairs = ours.iter().zip(theirs);
    let largest = pairs.fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
    if largest == 0.0 { 0.0 } else { largest / scale }
}

#[test]
fn inspect_agrees_with_pinocchio_on_random_descriptions() {
    let cases: Vec<Value> = (0..TREES).map(case).collect();
    let folder = tempfile::tempdir().unwrap();
    let mut worst: BTreeMap<&str, f64> = BTreeMap::new();
    let (mut branched, mut mimicking) = (0, 0);
    for (case, theirs) in cases.iter().zip(pinocchio(&cases)) {
        let ours = inspect(case, folder.path());
        let names = |report: &Value| -> Vec<String> {
            let joints = report["joints"].as_array().unwrap();
            joints
                .iter()
                .map(|j| j.as_str().unwrap().to_owned())
                .collect()
        };
        // Pinocchio takes siblings in its own order: its column for each of our joints.
        let (our_names, their_names) = (names(&ours), names(&theirs));
        branched += usize::from(our_names != their_names);
        mimicking += usize::from(!case["mimics"].as_object().unwrap().is_empty());
        let column: Vec<usize> = our_names
            .iter()
            .map(|name| their_names.iter().position(|n| n == name).unwrap())
            .collect();
        let permuted = |row: &[f64]| -> Vec<f64> { column.iter().map(|&c| row[c]).collect() };

        let mut compare = |what, ours: &[f64], theirs: &[f64]| {
            let difference = relative_difference(ours, theirs);
            assert!(
                difference <= RELATIVE,
                "{what} differs by {difference:e}\n{}",
                case["urdf"].as_str().unwrap()
            );
            let so_far = worst.entry(what).or_default();
            *so_far = so_far.max(difference);
        };
        for what in ["total_mass", "kinetic_energy"] {
            let of = |report: &Value| [report[what].as_f64().unwrap()];
            compare(what, &of(&ours), &of(&theirs));
        }
        compare("com", &numbers(&ours["com"]), &numbers(&theirs["com"]));
        for part in ["linear", "angular"] {
            let of = |report: &Value| numbers(&report["momentum"][part]);
            compare(part, &of(&ours), &of(&theirs));
        }
        compare(
            "qdd",
            &numbers(&ours["qdd"]),
            &permuted(&numbers(&theirs["qdd"])),
        );
        for what in ["fixed_base_jacobian", "generalized_jacobian", "base_map"] {
            let theirs: Vec<f64> = rows(&theirs[what])
                .iter()
                .flat_map(|r| permuted(r))
                .collect();
            compare(what, &rows(&ours[what]).concat(), &theirs);
        }
        let theirs = rows(&theirs["reduced_inertia"]);
        let theirs: Vec<f64> = column.iter().flat_map(|&c| permuted(&theirs[c])).collect();
        compare(
            "reduced_inertia",
            &rows(&ours["reduced_inertia"]).concat(),
            &theirs,
        );
    }
    assert!(branched > 10, "the trees must have branches");
    assert!(mimicking > 10, "some must have mimic joints");
    println!("largest relative differences over {TREES} robots: {worst:?}");
}
