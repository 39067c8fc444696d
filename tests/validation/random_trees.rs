//! Identities on random trees that do not use the code under test: finite differences of poses, sums over
//! bodies, and the balance of power.

use fuyu::dynamics::{Input, IntegrationMethod, Integrator, Momentum, State, Workspace};
use fuyu::model::Model;
use fuyu::spatial::{Pose, Wrench};
use nalgebra::{DVector, Matrix6xX, Rotation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

use crate::trees::{trees, vector};

fn state(model: &Model, numbers: &[f64]) -> State {
    let n = model.dof();
    let mut state = State::at_rest_with(model, &DVector::from_fn(n, |j, _| numbers[j] * 2.0));
    state.qd = DVector::from_fn(n, |j, _| numbers[12 + j]);
    state.R_WB = UnitQuaternion::new(Vector3::new(numbers[24], numbers[25], numbers[26]));
    state.momentum_W = Momentum {
        linear: Vector3::new(numbers[27], numbers[28], numbers[29]) * 30.0,
        angular: Vector3::new(numbers[30], numbers[31], numbers[32]) * 30.0,
    };
    state
}

/// World poses of all bodies after coasting (with `input` held) for `t`.
fn poses_after(model: &Model, state: &State, input: &Input, t: f64) -> (Vec<Pose>, State) {
    let mut state = state.clone();
    let mut workspace = Workspace::new(model);
    let mut held = |_: f64, _: &State, into: &mut Input| into.copy_from(input);
    Integrator::new(model, IntegrationMethod::Dop8).step(&mut state, &mut workspace, t, &mut held);
    workspace.set_positions(&state.q);
    workspace.set_motion(&state);
    let X_WB = state.X_WB(&workspace);
    let poses = (0..model.bodies().len()).map(|b| X_WB * workspace.X_BF(&model.frames()[b]));
    (poses.collect(), state)
}

/// Momentum (world axes, angular about the system's centre of mass) and energy of bodies whose poses are
/// known at t - h, t, t + h: nothing but central differences of positions and attitudes.
fn from_differences(
    model: &Model,
    before: &[Pose],
    at: &[Pose],
    after: &[Pose],
    h: f64,
) -> ([Vector3<f64>; 2], f64) {
    let com = |poses: &[Pose], b: usize| {
        poses[b].rotation * model.bodies()[b].inertia.com + poses[b].translation.vector
    };
    let mass = model.total_mass();
    let bodies = model.bodies();
    let system: Vector3<f64> = (0..bodies.len())
        .map(|b| com(at, b) * (bodies[b].inertia.mass / mass))
        .sum();
    let (mut linear, mut angular, mut energy) = (Vector3::zeros(), Vector3::zeros(), 0.0);
    for (b, body) in bodies.iter().enumerate() {
        let v = (com(after, b) - com(before, b)) / (2.0 * h);
        let turned = UnitQuaternion::from(after[b].rotation * before[b].rotation.inverse());
        let w = turned.scaled_axis() / (2.0 * h);
        let r = at[b].rotation.matrix();
        let spin = r * body.inertia.about_com * r.transpose() * w;
        linear += v * body.inertia.mass;
        angular += spin + (com(at, b) - system).cross(&v) * body.inertia.mass;
        energy += 0.5 * (body.inertia.mass * v.norm_squared() + w.dot(&spin));
    }
    ([linear, angular], energy)
}

fn numbers() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-1.0..1.0f64, 33)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, rng_seed: RngSeed::Fixed(2026), ..ProptestConfig::default() })]

    /// The base twist that momentum and joint rates imply moves the bodies so that differences of their
    /// poses give that momentum back, and the kinetic energy. A wrong sign or term in (4.13)-(4.26)
    /// breaks this at first order; the tolerance is the difference's own error.
    #[test]
    fn motion_carries_the_momentum_and_energy_of_the_state(model in trees(1..=12), numbers in numbers()) {
        let state = state(&model, &numbers);
        let input = Input::zero(&model);
        let h = 1e-4;
        let (before, _) = poses_after(&model, &state, &input, -h);
        let (at, _) = poses_after(&model, &state, &input, 0.0);
        let (after, _) = poses_after(&model, &state, &input, h);
        let ([linear, angular], energy) = from_differences(&model, &before, &at, &after, h);
        let mut workspace = Workspace::new(&model);
        workspace.set_positions(&state.q);
        workspace.set_motion(&state);
        let scale = workspace.momentum_scale();
        // Rates reach some rad/s: third derivatives times h²/6 stay below 1e-5 of the bodies' momenta.
        prop_assert!((linear - state.momentum_W.linear).norm() < 1e-5 * scale.0);
        prop_assert!((angular - state.momentum_W.angular).norm() < 1e-5 * scale.1);
        let ours = workspace.kinetic_energy();
        prop_assert!((energy - ours).abs() < 1e-5 * ours, "{} {}", energy, ours);
    }

    /// The generalized Jacobian at zero momentum is the derivative of the tip's world pose by one joint,
    /// and the base map that of the base's centre of mass.
    #[test]
    fn jacobians_are_derivatives_of_poses(model in trees(1..=12), numbers in numbers()) {
        let mut state = state(&model, &numbers);
        state.momentum_W = Momentum::default();
        let tip = model.frames().last().unwrap().clone();
        let n = model.dof();
        let mut workspace = Workspace::new(&model);
        workspace.set_positions(&state.q);
        let (mut generalized, mut base) = (Matrix6xX::zeros(n), Matrix6xX::zeros(n));
        workspace.generalized_jacobian(&tip, &mut generalized);
        workspace.base_map(&mut base);
        let R_WB = state.R_WB.to_rotation_matrix();
        let com = model.bodies()[0].inertia.com;
        let h = 1e-5;
        for j in 0..n {
            state.qd.fill(0.0);
            state.qd[j] = 1.0;
            // No dynamics: the pose is moved along the twist by hand, exactly on the group, both ways.
            let moved = |s: f64| {
                let mut moved = state.clone();
                moved.q[j] += s;
                let mut middle = Workspace::new(&model);
                let mut half = state.clone();
                half.q[j] += 0.5 * s;
                middle.set_positions(&half.q);
                middle.set_motion(&half);
                moved.R_WB = state.R_WB * UnitQuaternion::new(middle.V_WB_B().angular * s);
                middle.set_positions(&moved.q);
                let X_WB = moved.X_WB(&middle);
                (X_WB, X_WB * middle.X_BF(&tip))
            };
            let ((base_b, tip_b), (base_a, tip_a)) = (moved(-h), moved(h));
            let rate = |a: &Pose, b: &Pose, p: Vector3<f64>| {
                let v = (a.rotation * p + a.translation.vector - b.rotation * p - b.translation.vector) / (2.0 * h);
                let w = UnitQuaternion::from(a.rotation * b.rotation.inverse()).scaled_axis() / (2.0 * h);
                (R_WB.inverse() * v, R_WB.inverse() * w)
            };
            let (v, w) = rate(&tip_a, &tip_b, Vector3::zeros());
            prop_assert!((v - generalized.fixed_view::<3, 1>(0, j)).norm() < 1e-7 * (1.0 + v.norm()));
            prop_assert!((w - generalized.fixed_view::<3, 1>(3, j)).norm() < 1e-7);
            let (v, w) = rate(&base_a, &base_b, com);
            prop_assert!((v - base.fixed_view::<3, 1>(0, j)).norm() < 1e-7 * (1.0 + v.norm()));
            prop_assert!((w - base.fixed_view::<3, 1>(3, j)).norm() < 1e-7);
        }
    }

    /// Newton and Euler on every subtree, from nothing but poses at three instants: the accelerations that
    /// second differences of the poses give each body, summed over the subtree beyond a joint and taken along
    /// its axis, must be what effort, damping and wrench put in; and the whole system's must be the wrench
    /// alone. Momentum is not zero. A wrong gyroscopic, Coriolis or elimination term breaks it at first order.
    #[test]
    fn accelerations_obey_newton_and_euler_on_every_subtree(
        model in trees(1..=12), numbers in numbers(), push in vector(20.0), twist in vector(20.0)
    ) {
        let state = state(&model, &numbers);
        let n = model.dof();
        let mut input = Input::zero(&model);
        input.efforts = DVector::from_fn(n, |j, _| numbers[(j * 7 + 3) % 33] * 20.0);
        let loaded = model.bodies().len() - 1;
        input.wrenches[loaded] = Wrench::new(twist, push);
        let h = 3e-4;
        let (before, _) = poses_after(&model, &state, &input, -h);
        let (at, _) = poses_after(&model, &state, &input, 0.0);
        let (after, _) = poses_after(&model, &state, &input, h);
        let rates: Vec<_> = (0..model.bodies().len())
            .map(|b| BodyRate::new(&model, b, [&before[b], &at[b], &after[b]], h))
            .collect();
        let force_W = at[loaded].rotation * push;
        let torque_W = at[loaded].rotation * twist;
        let origin_W = at[loaded].translation.vector;
        // What a set of bodies needs, less what the wrench gives, about a point.
        let needed = |bodies: std::ops::Range<usize>, about: Vector3<f64>| {
            let (mut force, mut torque, mut size) = (Vector3::zeros(), Vector3::zeros(), 0.0);
            for b in bodies.clone() {
                let arm = rates[b].com - about;
                force += rates[b].force;
                torque += rates[b].torque + arm.cross(&rates[b].force);
                size += rates[b].force.norm() * (1.0 + arm.norm()) + rates[b].torque.norm();
            }
            if bodies.contains(&loaded) {
                force -= force_W;
                torque -= torque_W + (origin_W - about).cross(&force_W);
                size += force_W.norm() * (1.0 + (origin_W - about).norm()) + torque_W.norm();
            }
            (force, torque, size)
        };
        for (j, joint) in model.joints().iter().enumerate() {
            let body = j + 1;
            let axis_W = at[body].rotation * joint.axis.into_inner();
            let subtree = body..model.bodies()[body].subtree_end;
            let (force, torque, size) = needed(subtree, at[body].translation.vector);
            let along = if joint.kind.is_rotational() { torque.dot(&axis_W) } else { force.dot(&axis_W) };
            let pull = joint.spring.stiffness * (joint.spring.rest - state.q[j]);
            let given = input.efforts[j] + pull - joint.damping * state.qd[j];
            // Second differences over 0.3 ms leave some 1e-6 of the terms that they sum.
            prop_assert!((along - given).abs() < 3e-5 * (1.0 + size + given.abs()), "{} {} of {}", along, given, size);
        }
        let (force, torque, size) = needed(0..model.bodies().len(), state.p_WC);
        prop_assert!(force.norm() < 3e-5 * (1.0 + size), "{} of {}", force, size);
        prop_assert!(torque.norm() < 3e-5 * (1.0 + size), "{} of {}", torque, size);
    }
}

/// What moves one body: rates of its momenta by second differences of its pose, world axes.
struct BodyRate {
    com: Vector3<f64>,
    force: Vector3<f64>,
    /// About the body's own centre of mass.
    torque: Vector3<f64>,
}

impl BodyRate {
    fn new(model: &Model, body: usize, [before, at, after]: [&Pose; 3], h: f64) -> Self {
        let inertia = &model.bodies()[body].inertia;
        let com = |X: &Pose| X.rotation * inertia.com + X.translation.vector;
        // Spin half a step away: the turn over the step, with the inertia as it lies halfway.
        let spin = |from: &Pose, to: &Pose| {
            let turn = UnitQuaternion::from(to.rotation * from.rotation.inverse()).scaled_axis();
            let halfway = Rotation3::new(turn * 0.5) * from.rotation;
            let r = halfway.matrix();
            r * inertia.about_com * r.transpose() * (turn / h)
        };
        let acceleration = (com(after) - com(at) * 2.0 + com(before)) / (h * h);
        Self {
            com: com(at),
            force: acceleration * inertia.mass,
            torque: (spin(at, after) - spin(before, at)) / h,
        }
    }
}

/// Lagrange's equation (4.49) with every derivative of the reduced inertia by finite differences.
#[test]
fn accelerations_satisfy_lagrange_s_equation_at_zero_momentum() {
    let model = crate::fixtures::servicer();
    let q = crate::fixtures::degrees(&[65.0, 99.0, -95.0, -22.0, 3.0, -42.0]);
    let mut state = State::at_rest_with(&model, &q);
    state.qd = DVector::from_row_slice(&[0.3, -0.5, 0.4, 0.8, -0.7, 1.1]);
    let mut workspace = Workspace::new(&model);
    let mut inertia_at = |q: &DVector<f64>| {
        workspace.set_positions(q);
        workspace.reduced_inertia().clone()
    };
    let h = 1e-5;
    let reduced = inertia_at(&q);
    let along = (inertia_at(&(&q + &state.qd * h)) - inertia_at(&(&q - &state.qd * h))) / (2.0 * h);
    let gradient = DVector::from_fn(6, |j, _| {
        let mut step = DVector::zeros(6);
        step[j] = h;
        let change = inertia_at(&(&q + &step)) - inertia_at(&(&q - &step));
        0.5 * state.qd.dot(&(change * &state.qd)) / (2.0 * h)
    });
    let mut input = Input::zero(&model);
    input.efforts = DVector::from_row_slice(&[5.0, -3.0, 2.0, 1.0, -0.5, 0.2]);
    workspace.set_positions(&q);
    workspace.set_motion(&state);
    let mut qdd = DVector::zeros(6);
    workspace.accelerations(&state, &input, &mut qdd);
    let residual = &reduced * &qdd + along * &state.qd - gradient - &input.efforts;
    // The inertias are of the order of 1e3; central differences leave 1e-10 of that.
    assert!(residual.amax() < 1e-6, "{residual}");
}
