//! Fixtures, the servicer and its targets.

use fuyu_physics::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu_physics::model::{Frame, Model, ModelBuilder};
use fuyu_physics::spatial::{Pose, RigidInertia, Twist};
use nalgebra::{
    DVector, Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3,
};
use serde_json::Value;

pub fn fixture(name: &str) -> Value {
    let folder = env!("CARGO_MANIFEST_DIR");
    let path = format!("{folder}/tests/capture/fixtures/{name}.json");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap()
}

pub fn cases(name: &str) -> Vec<Value> {
    fixture(name)["cases"].as_array().unwrap().clone()
}

pub fn list(value: &Value) -> &[Value] {
    value
        .as_array()
        .map_or_else(|| panic!("not a list: {value}"), Vec::as_slice)
}

pub fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("not a number: {value}"))
}

pub fn numbers(value: &Value) -> Vec<f64> {
    list(value).iter().map(number).collect()
}

pub fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_column_slice(&numbers(value))
}

pub fn matrix(value: &Value) -> Matrix3<f64> {
    let rows: Vec<_> = list(value)
        .iter()
        .map(|row| vector(row).transpose())
        .collect();
    Matrix3::from_rows(&rows)
}

pub fn rotation(value: &Value) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix(value)))
}

pub fn quaternion(value: &Value) -> UnitQuaternion<f64> {
    let [w, x, y, z] = numbers(value)[..] else {
        panic!("not a quaternion: {value}")
    };
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

pub fn servicer(damping: f64) -> Model {
    let text = include_str!("../../../../urdf/servicer.urdf");
    let text = text.replace("<axis", &format!("<dynamics damping=\"{damping}\"/><axis"));
    Model::from_urdf(&text, "servicer.urdf").unwrap()
}

/// A rigid body; its frame is at its centre of mass.
pub fn body(name: &str, mass: f64, about_com: Matrix3<f64>) -> Model {
    let inertia = RigidInertia {
        mass,
        com: Vector3::zeros(),
        about_com,
    };
    ModelBuilder::new(name, "body", inertia).build()
}

/// A system with its base at the given pose and twist, world axes, and joints.
#[allow(clippy::too_many_arguments)]
pub fn floating(
    model: &Model,
    p: Vector3<f64>,
    R: UnitQuaternion<f64>,
    v: Vector3<f64>,
    w: Vector3<f64>,
    q: &[f64],
    qd: &[f64],
) -> Floating {
    let mut state = State::at_rest_with(model, &DVector::from_row_slice(q));
    state.qd = DVector::from_row_slice(qd);
    let V = Twist::new(R.inverse() * w, R.inverse() * v);
    let X_WB = Isometry3::from_parts(Translation3::from(p), R);
    state.set_base(&mut Workspace::new(model), &X_WB, &V);
    Floating::new(model.clone(), state, IntegrationMethod::Dop8)
}

/// The servicer as the entries `base_*`, `q`, `qd` of `at` say.
pub fn servicer_at(at: &Value, damping: f64) -> Floating {
    let of = |name: &str| vector(&at[name]);
    let (q, qd) = (numbers(&at["q"]), numbers(&at["qd"]));
    let R = rotation(&at["base_R"]);
    floating(
        &servicer(damping),
        of("base_p"),
        R,
        of("base_v"),
        of("base_w"),
        &q,
        &qd,
    )
}

/// The target of a case as the entries `target_*` of `at` say.
pub fn target_at(target: &Value, at: &Value) -> Floating {
    let model = body(
        "target",
        number(&target["mass"]),
        matrix(&target["inertia_com"]),
    );
    let of = |name: &str| vector(&at[name]);
    let R = rotation(&at["target_R"]);
    floating(
        &model,
        of("target_com"),
        R,
        of("target_v"),
        of("target_w"),
        &[],
        &[],
    )
}

/// The grasp frame of a case's target.
pub fn grasp_frame(target: &Value) -> Frame {
    let R = Rotation3::from_matrix_unchecked(matrix(&target["grasp_R"]));
    Frame {
        name: "grasp".to_owned(),
        body: 0,
        parent: Some("body".to_owned()),
        X_BF: Pose::from_parts(Translation3::from(vector(&target["grasp_p"])), R),
    }
}

/// Velocity of a system's base and its angular velocity, world axes.
pub fn base_twist(system: &Floating) -> (Vector3<f64>, Vector3<f64>) {
    let V = system.workspace().V_WB_B();
    let R = system.state().R_WB;
    (R * V.linear, R * V.angular)
}

/// Total momentum of several systems, angular about the world's origin.
pub fn momentum(states: &[&State]) -> (Vector3<f64>, Vector3<f64>) {
    let mut sum = (Vector3::zeros(), Vector3::zeros());
    for state in states {
        sum.0 += state.momentum_W.linear;
        sum.1 += state.momentum_W.angular + state.p_WC.cross(&state.momentum_W.linear);
    }
    sum
}

/// Largest difference of two lists of the same length.
pub fn difference(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
    let differences = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f64::max)
}

#[track_caller]
pub fn near(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    let error = difference(found, expected);
    assert!(
        error <= tolerance,
        "{what}: {error:.2e} > {tolerance:.0e}: {found:?} {expected:?}"
    );
}
