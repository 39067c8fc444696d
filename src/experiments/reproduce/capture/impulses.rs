//! Capture impulses, compared with values of two other programs.

use nalgebra::{DVector, Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;

use super::super::Report;
use crate::{
    dynamics::{
        Floating, IntegrationMethod, State, Workspace,
        capture::{Captured, Grasp, JointReaction, Latch},
    },
    model::{Frame, Model, ModelBuilder},
    spatial::{Pose, RigidInertia, Twist},
};

/// Cases computed by Pinocchio 4.1 (a system of equations with the constraint) and in maximal coordinates; both agree
/// to 4e-15 in velocities and 3e-13 in impulses. Velocities are those of the base's origin and of the target's centre
/// of mass, world axes.
const CASES: &str = include_str!("impulses.json");

fn numbers(value: &Value) -> Vec<f64> {
    let list = value.as_array().map_or(&[][..], Vec::as_slice);
    list.iter()
        .map(|x| x.as_f64().unwrap_or(f64::NAN))
        .collect()
}

fn vector(value: &Value) -> Vector3<f64> {
    match numbers(value).as_slice() {
        &[x, y, z] => Vector3::new(x, y, z),
        _ => Vector3::repeat(f64::NAN),
    }
}

fn matrix(value: &Value) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| value[i][j].as_f64().unwrap_or(f64::NAN))
}

/// A system whose base has this pose and twist, world axes.
fn placed(model: Model, at: &Value, [p, R, v, w]: [&str; 4], q: &[f64], qd: &[f64]) -> Floating {
    let rotation = Rotation3::from_matrix_unchecked(matrix(&at[R]));
    let R = UnitQuaternion::from_rotation_matrix(&rotation);
    let mut state = State::at_rest_with(&model, &DVector::from_row_slice(q));
    state.qd = DVector::from_row_slice(qd);
    let V = Twist::new(R.inverse() * vector(&at[w]), R.inverse() * vector(&at[v]));
    let X_WB = Isometry3::from_parts(Translation3::from(vector(&at[p])), R);
    state.set_base(&mut Workspace::new(&model), &X_WB, &V);
    Floating::new(model, state, IntegrationMethod::Dop8)
}

fn twist(system: &Floating) -> [Vector3<f64>; 2] {
    let V = system.workspace().V_WB_B();
    [V.linear, V.angular].map(|part| system.state().R_WB * part)
}

/// Grasps of a target of 20 to 6000 kg by the servicer, whose joints are free or locked.
pub(super) fn impulses(mut report: Report) -> Report {
    let cases: Value = serde_json::from_str(CASES).unwrap_or_default();
    for case in cases["cases"].as_array().into_iter().flatten() {
        grasp(&mut report, case);
    }
    report.note("Differences are the largest of base, joints and target in m/s and rad/s, and in N s and N m s.");
    report
}

fn grasp(report: &mut Report, case: &Value) {
    let name = case["name"].as_str().unwrap_or_default().replace('_', " ");
    let (before, after, of) = (&case["before"], &case["after"], &case["target"]);
    let text = include_str!("../../../../urdf/servicer.urdf");
    let Ok(model) = Model::from_urdf(text, "servicer.urdf") else {
        return report.holds("the servicer's description is read", 0.0, false);
    };
    let (q, qd) = (numbers(&before["q"]), numbers(&before["qd"]));
    let robot = placed(
        model,
        before,
        ["base_p", "base_R", "base_v", "base_w"],
        &q,
        &qd,
    );
    let inertia = RigidInertia {
        mass: of["mass"].as_f64().unwrap_or(f64::NAN),
        com: Vector3::zeros(),
        about_com: matrix(&of["inertia_com"]),
    };
    let body = ModelBuilder::new("target", "body", inertia).build();
    let names = ["target_com", "target_R", "target_v", "target_w"];
    let target = placed(body, before, names, &[], &[]);
    let R = Rotation3::from_matrix_unchecked(matrix(&of["grasp_R"]));
    let Some(tool) = robot.model().frame("tool0").cloned() else {
        return report.holds("the servicer has a tool", 0.0, false);
    };
    let grasp = Grasp {
        robot: tool,
        target: Frame {
            name: "grasp".to_owned(),
            body: 0,
            parent: Some("body".to_owned()),
            X_BF: Pose::from_parts(Translation3::from(vector(&of["grasp_p"])), R),
        },
        latch: match case["grasp"] == "ball" {
            true => Latch::Ball,
            false => Latch::Weld,
        },
        joints: match case["joints"] == "locked" {
            true => JointReaction::Locked,
            false => JointReaction::Free,
        },
    };
    let Ok((_, impulse)) = Captured::new(&robot, &target, &grasp, IntegrationMethod::Dop8) else {
        return report.holds(&format!("{name}: the grasp latches"), 0.0, false);
    };
    let mut moved = [robot, target];
    for (system, state) in moved.iter_mut().zip(&impulse.states) {
        system.set_state(state.clone());
    }
    let [v, w] = twist(&moved[0]);
    let [v_t, w_t] = twist(&moved[1]);
    let mut off: f64 = 0.0;
    for (found, what) in [
        (v, "base_v"),
        (w, "base_w"),
        (v_t, "target_v"),
        (w_t, "target_w"),
    ] {
        off = off.max((found - vector(&after[what])).amax());
    }
    let rates = DVector::from_vec(numbers(&after["qd"]));
    off = off.max((&moved[0].state().qd - rates).amax());
    report.near(
        &format!("{name}: difference of twists and rates"),
        0.0,
        off,
        1e-12,
    );
    let on_robot = &case["impulse_on_servicer"];
    let found = impulse.on_first[0];
    let off = (found.force - vector(&on_robot["linear"])).amax();
    let off = off.max((found.torque - vector(&on_robot["angular_about_grasp"])).amax());
    report.near(
        &format!("{name}: difference of the impulse"),
        0.0,
        off,
        1e-10,
    );
    let energy = &case["energy"];
    let of = |what: &str| energy[what].as_f64().unwrap_or(f64::NAN);
    let tolerance = 1e-12 * of("before");
    report.near(
        &format!("{name}: energy lost [J]"),
        of("lost"),
        impulse.energy_lost,
        tolerance,
    );
}
