//! `fuyu estimate`: tables and bags in, motion and prediction out.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use fuyu::estimation::free_body::FreeRotation;
use fuyu::spatial::Pose;
use fuyu::vision::{BodyPoint, FeatureCamera, FeatureCameraConfig};
use nalgebra::{Matrix3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;

/// True motion in the recordings below; the moments of inertia are in the ratio 7 : 4 : 3.
pub fn truth() -> FreeRotation {
    let inertia = Matrix3::from_diagonal(&Vector3::new(7.0, 4.0, 3.0));
    let rate = Vector3::new(0.1, 0.35, 0.2);
    FreeRotation::new(&inertia, UnitQuaternion::identity(), &rate, 0.0).unwrap()
}

pub fn table(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

/// 601 frames over 60 s of 20 points of a ball, rounded to pixels.
pub fn tracks() -> String {
    let motion = truth();
    let config = FeatureCameraConfig {
        quantised: true,
        ..FeatureCameraConfig::ideal(1024, 1.25)
    };
    let mut camera = FeatureCamera::new(config, BodyPoint::on_sphere(20, 0.45, 5));
    let mut text = String::from("t,id,u,v\n");
    for k in 0..=600 {
        let time = 0.1 * f64::from(k);
        let R_CB = motion.attitude(time).to_rotation_matrix();
        camera.show(
            time,
            &Pose::from_parts(Translation3::new(0.0, 0.0, 0.9), R_CB),
        );
        for f in camera.deliver(time).unwrap().features {
            writeln!(text, "{time},{},{},{}", f.id, f.u, f.v).unwrap();
        }
    }
    text
}

pub fn rates() -> String {
    let mut text = String::from("t,wx,wy,wz\n");
    for k in 0..=600 {
        let time = 0.6 * f64::from(k);
        let w = truth().angular_velocity(time);
        writeln!(text, "{time},{},{},{}", w.x, w.y, w.z).unwrap();
    }
    text
}

pub fn estimate(input: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .arg("estimate")
        .arg(input)
        .args(args)
        .output()
        .unwrap()
}

/// Runs `fuyu estimate`, which must refuse the input, and returns its error message.
pub fn refused(input: &Path, args: &[&str]) -> String {
    let output = estimate(input, args);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(output.stdout.is_empty() && !said.contains("panicked"));
    said
}

pub fn json(input: &Path, args: &[&str]) -> Value {
    let output = estimate(input, &[args, &["--json"]].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    serde_json::from_slice(&output.stdout).unwrap()
}

pub const CAMERA: [&str; 8] = [
    "--fx", "819.2", "--fy", "819.2", "--cx", "511.5", "--cy", "511.5",
];

pub fn numbers(list: &Value) -> Vec<f64> {
    let list = list.as_array().unwrap_or_else(|| panic!("{list}"));
    list.iter().map(|x| x.as_f64().unwrap()).collect()
}

/// Largest angle between predicted and true attitudes \[rad\]; the body axes are aligned at the first one.
pub fn prediction_error(found: &Value) -> f64 {
    let prediction = found["prediction"].as_array().unwrap();
    let attitude = |entry: &Value| {
        let q = numbers(&entry["q"]);
        UnitQuaternion::from_quaternion(Quaternion::new(q[3], q[0], q[1], q[2]))
    };
    let time = |entry: &Value| entry["t"].as_f64().unwrap();
    let first = &prediction[0];
    let offset = attitude(first).inverse() * truth().attitude(time(first));
    let errors = prediction.iter().map(|entry| {
        let R = attitude(entry) * offset;
        R.angle_to(&truth().attitude(time(entry)))
    });
    errors.fold(0.0, f64::max)
}

// Fails for wrong units or axes, a wrong order of J or of the quaternion, and if the prediction starts at another time.
#[test]
fn motion_and_prediction_are_estimated_from_tracks() {
    let folder = tempfile::tempdir().unwrap();
    let input = table(folder.path(), "tracks.csv", &tracks());
    let found = json(&input, &CAMERA);
    assert_eq!(
        (&found["method"], &found["model"]),
        (&"bundle".into(), &"asymmetric".into())
    );
    let parameters = truth().parameters().copied().unwrap();
    let J = numbers(&found["J"]);
    for (J, right) in J.iter().zip(parameters.J().iter()) {
        assert!((J / right - 1.0).abs() < 2e-3, "{J} for {right}");
    }
    let alpha = found["alpha"].as_f64().unwrap();
    assert!((alpha / parameters.alpha() - 1.0).abs() < 1e-3, "{alpha}");
    let rates = found["angular_velocity"].as_array().unwrap();
    assert_eq!(rates.len(), 601);
    for entry in rates {
        let w = Vector3::from_row_slice(&numbers(&entry["w"]));
        let right = truth().angular_velocity(entry["t"].as_f64().unwrap());
        assert!((w - right).norm() < 1e-3 * right.norm(), "{entry}");
    }
    let prediction = found["prediction"].as_array().unwrap();
    assert_eq!(prediction.len(), 301, "30 s at 10 Hz");
    for (k, entry) in prediction.iter().enumerate() {
        let t = entry["t"].as_f64().unwrap();
        assert!((t - 60.0 - 0.1 * k as f64).abs() < 1e-9, "{t}");
    }
    // The body turns by 0.04 rad in a tenth of a second: if successive quaternions differ by more, the sign has
    // changed.
    let q: Vec<_> = prediction.iter().map(|p| numbers(&p["q"])).collect();
    for pair in q.windows(2) {
        let dot: f64 = pair[0].iter().zip(&pair[1]).map(|(a, b)| a * b).sum();
        assert!(dot > 0.99, "{pair:?}");
    }
    // The errors that Masutani 1995 prints are of the order of degrees, those of bundle adjustment of hundredths.
    let error = prediction_error(&found).to_degrees();
    assert!(error < 0.05, "{error} deg");
    let rms = found["rms"].as_f64().unwrap();
    assert!((0.2..0.4).contains(&rms), "{rms} px: rounding leaves 0.29");
    let covariance = found["covariance"].as_array().unwrap();
    assert_eq!((covariance.len(), numbers(&covariance[3]).len()), (4, 4));

    let shorter = json(
        &input,
        &[&CAMERA[..], &["--predict", "5", "--predict-rate", "2"]].concat(),
    );
    let shorter = shorter["prediction"].as_array().unwrap();
    assert_eq!(shorter.len(), 11);
    assert_eq!(shorter[10]["t"].as_f64().unwrap(), 65.0);
    // A focal length that is wrong by 1 % is corrected if it is to be estimated.
    let mut wrong = CAMERA;
    (wrong[1], wrong[3]) = ("827.4", "827.4");
    let refined = json(&input, &[&wrong[..], &["--focal-length"]].concat());
    let focal = refined["focal_length"].as_f64().unwrap();
    assert!((focal / 819.2 - 1.0).abs() < 1e-3, "{focal}");
}

/// A symmetric, positive matrix of three rows.
fn covariance(value: &Value) -> Matrix3<f64> {
    let rows = value.as_array().unwrap();
    let rows: Vec<f64> = rows.iter().flat_map(numbers).collect();
    let matrix = Matrix3::from_row_slice(&rows);
    let skew = (matrix - matrix.transpose()).norm();
    assert!(
        skew <= 1e-12 * matrix.norm() && matrix.symmetric_eigenvalues().min() >= 0.0,
        "{matrix}"
    );
    matrix
}

// Fails if a covariance is left out, in other axes or not that of the error.
#[test]
fn predictions_come_with_covariances() {
    let folder = tempfile::tempdir().unwrap();
    let input = table(folder.path(), "tracks.csv", &tracks());
    let found = json(&input, &[&CAMERA[..], &["--distance", "0,1,0.5"]].concat());
    let prediction = found["prediction"].as_array().unwrap();
    let attitude = |entry: &Value| {
        let q = numbers(&entry["q"]);
        UnitQuaternion::from_quaternion(Quaternion::new(q[3], q[0], q[1], q[2]))
    };
    let first = attitude(&prediction[0]);
    assert!(covariance(&prediction[0]["turn_covariance"]).norm() < 1e-15);
    for entry in &prediction[100..] {
        let t = entry["t"].as_f64().unwrap();
        let turn = attitude(entry) / first;
        let error = (turn / (truth().attitude(t) / truth().attitude(60.0))).scaled_axis();
        let spread = covariance(&entry["turn_covariance"]);
        let off = error.dot(&(spread.try_inverse().unwrap() * error)).sqrt();
        assert!(off < 5.0, "{t} s: {off}");
    }
    let axes: Vec<f64> = found["principal_axes"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(numbers)
        .collect();
    let axes = Matrix3::from_row_slice(&axes);
    assert!((axes * axes.transpose() - Matrix3::identity()).norm() < 1e-9);
    // The moments of the principal axes are J: in them, J w has the direction of the momentum.
    let w = Vector3::from_row_slice(&numbers(&found["state"]["w"]));
    let w_P = axes * (first.inverse() * w);
    let J = Vector3::from_row_slice(&numbers(&found["J"]));
    let momentum = first * (axes.transpose() * J.component_mul(&w_P));
    let direction = Vector3::from_row_slice(&numbers(&found["momentum"]["direction"]));
    assert!(
        momentum.normalize().dot(&direction) > 1.0 - 1e-6,
        "{momentum} {direction}"
    );
    covariance(&found["state"]["attitude_covariance"]);
    covariance(&found["state"]["w_covariance"]);
    assert_eq!(found["points"].as_array().unwrap().len(), 20);
    let point = |k: usize| Vector3::from_row_slice(&numbers(&found["points"][k]["p"]));
    assert!(((point(0) - point(1)).norm() - 0.5).abs() < 1e-9);
    assert_eq!(found["centre"]["unit"], "m");
    let without = json(&input, &CAMERA);
    let notes = without["notes"].as_array().unwrap();
    assert!(
        notes
            .iter()
            .any(|n| n.as_str().unwrap().contains("scale is not determined"))
    );
}

#[test]
fn angular_velocity_is_fitted_by_maximum_likelihood() {
    let folder = tempfile::tempdir().unwrap();
    let input = table(folder.path(), "rates.csv", &rates());
    let found = json(&input, &[]);
    assert_eq!(found["method"], "maximum_likelihood");
    let error = prediction_error(&found).to_degrees();
    assert!(error < 0.01, "{error} deg");
}

#[test]
fn angular_velocity_is_analysed_by_the_thesis() {
    let folder = tempfile::tempdir().unwrap();
    let input = table(folder.path(), "rates.csv", &rates());
    let found = json(&input, &["--method", "masutani1995"]);
    assert_eq!(
        (&found["method"], &found["model"]),
        (&"masutani1995".into(), &"asymmetric".into())
    );
    // From true rates, the thesis's method has a median error of 0.45 degrees and a maximum of 2.4.
    let error = prediction_error(&found).to_degrees();
    assert!(error < 2.4, "{error} deg");
    let people = estimate(&input, &[]);
    let text = String::from_utf8(people.stdout).unwrap();
    assert!(text.contains("model") && text.contains("J [s2]"), "{text}");
}

#[test]
fn of_two_targets_the_one_that_is_watched_is_estimated() {
    let folder = tempfile::tempdir().unwrap();
    let body = std::fs::read_to_string("urdf/target.urdf").unwrap();
    let inertia = r#"<inertia ixx="94.2" ixy="0" ixz="0" iyy="53.82857142857143" iyz="0" izz="40.371428571428574"/>"#;
    assert!(body.contains(inertia));
    let other = body.replace(
        inertia,
        r#"<inertia ixx="50" ixy="0" ixz="0" iyy="90" iyz="0" izz="80"/>"#,
    );
    let other = table(folder.path(), "other.urdf", &other);
    let scenario = std::fs::read_to_string("config/servicing.yaml").unwrap();
    let second = format!(
        "    other:\n      urdf: {}\n      position: [-1.5, 12.0, -1.0]\n      angular_velocity: [0.15, -0.06, 0.1]\n",
        other.display()
    );
    let both = scenario
        .replace("targets: [target]", "targets: [target, other]")
        .replace(
            "camera:\n  ros__parameters",
            &format!("{second}camera:\n  ros__parameters"),
        );
    for (watched, moments, rate) in [
        ("target", [40.371, 53.829, 94.2], [0.04, 0.05, 0.12]),
        ("other", [50.0, 80.0, 90.0], [0.15, -0.06, 0.1]),
    ] {
        let text = both.replace("target: target\n", &format!("target: {watched}\n"));
        let config = table(folder.path(), "scenario.yaml", &text);
        let bag = folder.path().join(watched);
        let run = crate::fuyu::fuyu(&[
            "simulate".as_ref(),
            config.as_os_str(),
            "--output".as_ref(),
            bag.as_os_str(),
        ]);
        assert_eq!(run.code, 0, "{}", run.stderr);
        let found = json(&bag, &[]);
        let J = numbers(&found["J"]);
        let (sum, total): (f64, f64) = (J.iter().sum(), moments.iter().sum());
        let mut parts: Vec<_> = J.iter().map(|J| J / sum).collect();
        parts.sort_by(f64::total_cmp);
        for (part, moment) in parts.iter().zip(moments) {
            assert!((part - moment / total).abs() < 4e-3, "{watched}: {J:?}");
        }
        let first = numbers(&found["angular_velocity"][0]["w"]);
        let speed = |w: &[f64]| w.iter().map(|w| w * w).sum::<f64>().sqrt();
        assert!(
            (speed(&first) / speed(&rate) - 1.0).abs() < 0.01,
            "{watched}: {first:?}"
        );
    }
}

#[test]
fn the_motion_of_the_target_is_estimated_from_a_simulated_bag() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let status = Command::new(env!("CARGO_BIN_EXE_fuyu"))
        .args(["simulate", "config/servicing.yaml", "--output"])
        .arg(&bag)
        .output()
        .unwrap();
    assert!(status.status.success());
    // The camera swings with the base, which the arm turns by 15 degrees; the gyro compensates this.
    let found = json(&bag, &[]);
    let J = numbers(&found["J"]);
    let sum: f64 = J.iter().sum();
    let mut parts: Vec<_> = J.iter().map(|J| J / sum).collect();
    parts.sort_by(f64::total_cmp);
    for (part, right) in parts.iter().zip([3.0, 4.0, 7.0]) {
        assert!((part - right / 14.0).abs() < 2e-3, "{J:?}");
    }
}
