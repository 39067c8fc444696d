//! A single free body against the closed form of its motion.

use fuyu::dynamics::{Input, Integrator, Method, State, Workspace};
use fuyu::model::ModelBuilder;
use fuyu::spatial::RigidInertia;
use nalgebra::{Matrix3, Vector3};

/// Symmetric top: the body rates precess at Ω = w_z (J_z - J_x)/J_x about the symmetry axis, and the
/// symmetry axis turns about the angular momentum at |L|/J_x. A wrong sign in the gyroscopic term or in
/// the attitude kinematics breaks both.
#[test]
fn a_symmetric_top_precesses_as_the_closed_form_says() {
    let (jx, jz) = (94.2, 40.3);
    let inertia = RigidInertia {
        mass: 120.0,
        com: Vector3::new(0.1, -0.2, 0.3),
        about_com: Matrix3::from_diagonal(&Vector3::new(jx, jx, jz)),
    };
    let model = ModelBuilder::new("top", "top", inertia).build();
    let mut state = State::at_rest(&model);
    let w0 = Vector3::new(0.05, 0.0, 0.12);
    state.momentum_W.angular = Vector3::new(jx * w0.x, 0.0, jz * w0.z);
    state.momentum_W.linear = Vector3::new(6.0, 0.0, -3.0);
    let mut workspace = Workspace::new(&model);
    let mut integrator = Integrator::new(&model, Method::Dop8);
    let mut coast = |_: f64, _: &State, _: &mut Input| {};
    let (dt, steps) = (0.05, 7200);
    for _ in 0..steps {
        integrator.step(&model, &mut state, &mut workspace, dt, &mut coast);
    }
    let t = dt * f64::from(steps);
    workspace.set_positions(&model, &state.q);
    workspace.set_motion(&state);
    let precession = w0.z * (jz - jx) / jx;
    let (sin, cos) = (precession * t).sin_cos();
    // I w' = (I w) × w turns (w_x, w_y) at +precession... checked against the equations of motion.
    let expected = Vector3::new(w0.x * cos, w0.x * sin, w0.z);
    let w = workspace.V_WB_B().angular;
    assert!((w - expected).norm() < 1e-12, "{w} {expected}");
    let axis_W = state.R_WB * Vector3::z();
    let momentum = state.momentum_W.angular;
    let turn = nalgebra::Rotation3::new(momentum / jx * t);
    assert!((axis_W - turn * Vector3::z()).norm() < 1e-11);
    let drifted = Vector3::new(0.1, -0.2, 0.3) + Vector3::new(6.0, 0.0, -3.0) * (t / 120.0);
    assert!((state.p_WC - drifted).norm() < 1e-11);
}
