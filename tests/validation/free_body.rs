//! A single free body against the closed form of its motion.

use fuyu::dynamics::{Input, IntegrationMethod, Integrator, State, Workspace};
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
    let mut integrator = Integrator::new(&model, IntegrationMethod::Dop8);
    let mut coast = |_: f64, _: &State, _: &mut Input| {};
    let (dt, steps) = (0.05, 7200);
    for _ in 0..steps {
        integrator.step(&mut state, &mut workspace, dt, &mut coast);
    }
    let t = dt * f64::from(steps);
    workspace.set_positions(&state.q);
    workspace.set_motion(&state);
    let precession = w0.z * (jz - jx) / jx;
    let (sin, cos) = (precession * t).sin_cos();
    // I w' = (I w) × w turns (w_x, w_y) about z at this rate.
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

/// Jacobi's sn, cn and dn by the arithmetic-geometric mean (descending Landen transformation).
fn jacobi(u: f64, k: f64) -> (f64, f64, f64) {
    let (mut a, mut c, mut b) = (vec![1.0], vec![k], (1.0 - k * k).sqrt());
    while c.last().unwrap().abs() > 1e-17 {
        let last = *a.last().unwrap();
        a.push(0.5 * (last + b));
        c.push(0.5 * (last - b));
        b = (last * b).sqrt();
    }
    let steps = a.len() - 1;
    let mut phi = 2f64.powi(steps as i32) * a[steps] * u;
    for i in (1..=steps).rev() {
        phi = 0.5 * (phi + (c[i] / a[i] * phi.sin()).asin());
    }
    let (sn, cn) = phi.sin_cos();
    (sn, cn, (1.0 - k * k * sn * sn).sqrt())
}

/// Asymmetric body: Euler's solution in elliptic functions, through several periods, and the attitude held
/// to it by the angular momentum, which must stay where it is in the world.
#[test]
fn an_asymmetric_body_tumbles_as_euler_s_solution_says() {
    let (i1, i2, i3) = (94.2, 53.9, 40.4);
    let inertia = RigidInertia {
        mass: 160.0,
        com: Vector3::zeros(),
        about_com: Matrix3::from_diagonal(&Vector3::new(i1, i2, i3)),
    };
    let model = ModelBuilder::new("tumbler", "tumbler", inertia).build();
    // Near the middle axis, with L² > 2 E I2: long swings about the axis of largest inertia.
    let (twice_energy, l_squared) = (2.0, 2.0 * 56.0);
    let a1 = ((l_squared - twice_energy * i3) / (i1 * (i1 - i3))).sqrt();
    let a2 = ((twice_energy * i1 - l_squared) / (i2 * (i1 - i2))).sqrt();
    let a3 = ((twice_energy * i1 - l_squared) / (i3 * (i1 - i3))).sqrt();
    let rate = ((l_squared - twice_energy * i3) * (i1 - i2) / (i1 * i2 * i3)).sqrt();
    let k = ((i2 - i3) * (twice_energy * i1 - l_squared)
        / ((i1 - i2) * (l_squared - twice_energy * i3)))
        .sqrt();
    let mut state = State::at_rest(&model);
    // At t = 0: sn = 0, cn = dn = 1.
    state.momentum_W.angular = Vector3::new(i1 * a1, 0.0, i3 * a3);
    let momentum = state.momentum_W.angular;
    let mut workspace = Workspace::new(&model);
    let mut integrator = Integrator::new(&model, IntegrationMethod::Dop8);
    let mut coast = |_: f64, _: &State, _: &mut Input| {};
    workspace.set_positions(&state.q);
    workspace.set_motion(&state);
    for step in 1..=7200 {
        integrator.step(&mut state, &mut workspace, 0.05, &mut coast);
        workspace.set_positions(&state.q);
        workspace.set_motion(&state);
        let (sn, cn, dn) = jacobi(rate * 0.05 * f64::from(step), k);
        let expected = Vector3::new(a1 * dn, -a2 * sn, a3 * cn);
        let w = workspace.V_WB_B().angular;
        // 360 s near the unstable axis stretch a rounding a thousandfold.
        assert!((w - expected).norm() < 1e-10, "{step}: {w} {expected}");
        let carried = state.R_WB * Vector3::new(i1 * w.x, i2 * w.y, i3 * w.z);
        assert!(
            (carried - momentum).norm() < 1e-12 * momentum.norm(),
            "{step}"
        );
    }
}
