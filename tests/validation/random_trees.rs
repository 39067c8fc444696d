//! Identities on random trees that do not use the code under test: finite differences of poses, sums over
//! bodies, and the balance of power.

use fuyu::dynamics::{Input, Integrator, Method, Momentum, State, Workspace};
use fuyu::model::{JointKind, Model, ModelBuilder};
use fuyu::spatial::{Pose, RigidInertia, Wrench};
use nalgebra::{
    DVector, Matrix3, Matrix6xX, Rotation3, Translation3, Unit, UnitQuaternion, Vector3,
};
use proptest::prelude::*;

fn vector(scale: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-scale..scale).prop_map(Vector3::from)
}

fn direction() -> impl Strategy<Value = Unit<Vector3<f64>>> {
    vector(1.0)
        .prop_filter("not zero", |v| v.norm() > 0.1)
        .prop_map(Unit::new_normalize)
}

fn rotation() -> impl Strategy<Value = Rotation3<f64>> {
    vector(2.0).prop_map(Rotation3::new)
}

/// Principal moments from three positive second moments, so the triangle inequality holds strictly.
fn inertia(mass: std::ops::Range<f64>) -> impl Strategy<Value = RigidInertia> {
    (
        mass,
        vector(0.5),
        prop::array::uniform3(0.02..0.5f64),
        rotation(),
    )
        .prop_map(|(mass, com, s, r)| {
            let principal = Vector3::new(s[1] + s[2], s[0] + s[2], s[0] + s[1]) * mass;
            let m = r.matrix();
            let about_com = m * Matrix3::from_diagonal(&principal) * m.transpose();
            RigidInertia {
                mass,
                com,
                about_com: (about_com + about_com.transpose()) * 0.5,
            }
        })
}

#[derive(Debug, Clone)]
struct Link {
    up: usize,
    prismatic: bool,
    axis: Unit<Vector3<f64>>,
    placement: (Vector3<f64>, Rotation3<f64>),
    inertia: RigidInertia,
}

fn link() -> impl Strategy<Value = Link> {
    (
        0usize..4,
        any::<bool>(),
        direction(),
        (vector(1.0), rotation()),
        inertia(1.0..20.0),
    )
        .prop_map(|(up, prismatic, axis, placement, inertia)| Link {
            up,
            prismatic,
            axis,
            placement,
            inertia,
        })
}

/// Trees of 1 to 12 joints: each new body hangs `up` levels above the one before it.
fn tree() -> impl Strategy<Value = Model> {
    (inertia(5.0..500.0), prop::collection::vec(link(), 1..12)).prop_map(|(base, links)| {
        let mut builder = ModelBuilder::new("random", "base_link", base);
        let mut path = vec![0];
        for (k, link) in links.iter().enumerate() {
            path.truncate(path.len().saturating_sub(link.up).max(1));
            let kind = if link.prismatic {
                JointKind::Prismatic
            } else {
                JointKind::Continuous
            };
            let (p, r) = link.placement;
            let X_PJ = Pose::from_parts(Translation3::from(p), r);
            let parent = *path.last().unwrap();
            path.push(builder.body(
                &format!("l{k}"),
                parent,
                kind,
                link.axis,
                X_PJ,
                link.inertia,
            ));
        }
        builder.build()
    })
}

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
    Integrator::new(model, Method::Dop8).step(model, &mut state, &mut workspace, t, &mut held);
    workspace.set_positions(model, &state.q);
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
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// The base twist that momentum and joint rates imply moves the bodies so that differences of their
    /// poses give that momentum back, and the kinetic energy. A wrong sign or term in (4.13)-(4.26)
    /// breaks this at first order; the tolerance is the difference's own error.
    #[test]
    fn motion_carries_the_momentum_and_energy_of_the_state(model in tree(), numbers in numbers()) {
        let state = state(&model, &numbers);
        let input = Input::zero(&model);
        let h = 1e-4;
        let (before, _) = poses_after(&model, &state, &input, -h);
        let (at, _) = poses_after(&model, &state, &input, 0.0);
        let (after, _) = poses_after(&model, &state, &input, h);
        let ([linear, angular], energy) = from_differences(&model, &before, &at, &after, h);
        let mut workspace = Workspace::new(&model);
        workspace.set_positions(&model, &state.q);
        workspace.set_motion(&state);
        let scale = workspace.momentum_scale(&model);
        // Rates reach some rad/s: third derivatives times h²/6 stay below 1e-5 of the bodies' momenta.
        prop_assert!((linear - state.momentum_W.linear).norm() < 1e-5 * scale.0);
        prop_assert!((angular - state.momentum_W.angular).norm() < 1e-5 * scale.1);
        let ours = workspace.kinetic_energy(&model);
        prop_assert!((energy - ours).abs() < 1e-5 * ours, "{} {}", energy, ours);
    }

    /// The generalized Jacobian at zero momentum is the derivative of the tip's world pose by one joint,
    /// and the base map that of the base's centre of mass.
    #[test]
    fn jacobians_are_derivatives_of_poses(model in tree(), numbers in numbers()) {
        let mut state = state(&model, &numbers);
        state.momentum_W = Momentum::default();
        let tip = model.frames().last().unwrap().clone();
        let n = model.dof();
        let mut workspace = Workspace::new(&model);
        workspace.set_positions(&model, &state.q);
        let (mut generalized, mut base) = (Matrix6xX::zeros(n), Matrix6xX::zeros(n));
        workspace.generalized_jacobian(&tip, &mut generalized);
        workspace.base_map(&model, &mut base);
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
                middle.set_positions(&model, &half.q);
                middle.set_motion(&half);
                moved.R_WB = state.R_WB * UnitQuaternion::new(middle.V_WB_B().angular * s);
                middle.set_positions(&model, &moved.q);
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

    /// Forward dynamics keeps the balance of power and of momentum: along its own accelerations the
    /// momentum that the bodies carry changes by the external wrench, and the energy by the power of
    /// efforts and wrenches. Momentum and energy are sums over bodies, not the map that the dynamics uses.
    #[test]
    fn accelerations_keep_the_balances(model in tree(), numbers in numbers(), push in vector(5.0), twist in vector(5.0)) {
        let state = state(&model, &numbers);
        let n = model.dof();
        let mut input = Input::zero(&model);
        input.efforts = DVector::from_fn(n, |j, _| numbers[(j * 7 + 3) % 33] * 20.0);
        let last = model.bodies().len() - 1;
        input.wrenches[last] = Wrench::new(twist, push);
        let h = 1e-4;
        let measured = |t: f64| {
            let (_, moved) = poses_after(&model, &state, &input, t);
            let mut workspace = Workspace::new(&model);
            workspace.set_positions(&model, &moved.q);
            workspace.set_motion(&moved);
            let carried = workspace.carried_momentum(&model);
            let tip = moved.R_WB * (workspace.X_BF(&model.frames()[last]).rotation * push);
            (moved.R_WB * carried.linear, workspace.kinetic_energy(&model), tip, workspace)
        };
        let (p_b, e_b, ..) = measured(-h);
        let (_, energy, force_W, workspace) = measured(0.0);
        let (p_a, e_a, ..) = measured(h);
        let change = (p_a - p_b) / (2.0 * h);
        prop_assert!((change - force_W).norm() < 1e-5 * (1.0 + force_W.norm()), "{} {}", change, force_W);
        let V = workspace.V_WF_B(&model.frames()[last]);
        let R_BL = workspace.X_BF(&model.frames()[last]).rotation;
        let power = input.efforts.dot(&state.qd) + V.linear.dot(&(R_BL * push)) + V.angular.dot(&(R_BL * twist));
        let change = (e_a - e_b) / (2.0 * h);
        prop_assert!((change - power).abs() < 1e-4 * (1.0 + power.abs() + energy), "{} {}", change, power);
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
        workspace.set_positions(&model, q);
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
    workspace.set_positions(&model, &q);
    workspace.set_motion(&state);
    let mut qdd = DVector::zeros(6);
    workspace.accelerations(&model, &state, &input, &mut qdd);
    let residual = &reduced * &qdd + along * &state.qd - gradient - &input.efforts;
    // The inertias are of the order of 1e3; central differences leave 1e-10 of that.
    assert!(residual.amax() < 1e-6, "{residual}");
}
