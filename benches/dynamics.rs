//! What the dynamics costs: `cargo bench --bench dynamics --no-default-features`.

use std::hint::black_box;
use std::time::Duration;

use criterion::{
    BenchmarkGroup, Criterion, SamplingMode, criterion_group, criterion_main, measurement::WallTime,
};
use fuyu::control::{Gains, JacobianKind, Measurement, Saturation, TransposeJacobian};
use fuyu::dynamics::{Input, Integrator, Method, Momentum, State, Workspace};
use fuyu::model::{JointKind, Model, ModelBuilder};
use fuyu::spatial::{Pose, RigidInertia};
use nalgebra::{DVector, Matrix3, Matrix6xX, Rotation3, Translation3, UnitQuaternion, Vector3};

fn robots() -> [(&'static str, Model); 3] {
    let urdf = |xml, name| Model::from_urdf(xml, name).expect("a robot of the repository");
    [
        (
            "servicer",
            urdf(include_str!("../urdf/servicer.urdf"), "servicer"),
        ),
        (
            "planar",
            urdf(include_str!("../urdf/planar_two_link.urdf"), "planar"),
        ),
        ("chain of 30", chain(30)),
    ]
}

/// A chain of equal links, each turned against the one before it.
fn chain(links: usize) -> Model {
    let body = |mass: f64| RigidInertia {
        mass,
        com: Vector3::new(0.2, 0.01, 0.0),
        about_com: Matrix3::from_diagonal(&Vector3::new(0.02, 0.15, 0.15)) * mass,
    };
    let mut builder = ModelBuilder::new("chain", "base_link", body(1000.0));
    let mut parent = 0;
    for k in 0..links {
        let (name, axis) = (format!("link{k}"), Vector3::z_axis());
        let placement = Pose::from_parts(
            Translation3::new(0.4, 0.0, 0.0),
            Rotation3::from_euler_angles(1.2, 0.1, 0.3),
        );
        let kind = JointKind::Continuous;
        parent = builder.body(&name, parent, kind, axis, placement, body(5.0));
    }
    builder.build()
}

/// A state in which everything moves.
fn moving(model: &Model) -> State {
    let n = model.dof();
    let q = DVector::from_fn(n, |j, _| 0.3 + 0.7 * (j as f64).sin());
    let mut state = State::at_rest_with(model, &q);
    state.qd = DVector::from_fn(n, |j, _| 0.05 * (1.0 + j as f64).cos());
    state.R_WB = UnitQuaternion::new(Vector3::new(0.3, -0.2, 0.5));
    state.momentum_W = Momentum {
        linear: Vector3::new(3.0, -5.0, 2.0),
        angular: Vector3::new(20.0, -35.0, 12.0),
    };
    state
}

fn kernels(group: &mut BenchmarkGroup<WallTime>, model: &Model) {
    let n = model.dof();
    let state = moving(model);
    let mut workspace = Workspace::new(model);
    let input = Input::zero(model);
    // Two positions in turn, so that none is the one that the workspace holds already.
    let positions = [state.q.clone(), &state.q * 1.01];
    let states = positions.clone().map(|q| State { q, ..state.clone() });
    let mut turn = 0;
    let mut next = move || {
        turn ^= 1;
        turn
    };
    let tip = model.frames().last().expect("every model has frames");
    let mut jacobian = Matrix6xX::zeros(n);
    let mut qdd = DVector::zeros(n);

    group.bench_function("forward dynamics", |b| {
        b.iter(|| {
            let state = black_box(&states[next()]);
            workspace.set_positions(model, &state.q);
            workspace.set_motion(state);
            workspace.accelerations(model, state, &input, &mut qdd);
            black_box(&qdd);
        });
    });
    group.bench_function("generalized Jacobian", |b| {
        b.iter(|| {
            workspace.set_positions(model, black_box(&positions[next()]));
            workspace.generalized_jacobian(tip, &mut jacobian);
            black_box(&jacobian);
        });
    });
    group.bench_function("reduced inertia", |b| {
        b.iter(|| {
            workspace.set_positions(model, black_box(&positions[next()]));
            black_box(workspace.reduced_inertia());
        });
    });
    for (name, method) in [("RK4 step", Method::Rk4), ("DOP8 step", Method::Dop8)] {
        let mut integrator = Integrator::new(model, method);
        let mut coast = |_: f64, _: &State, _: &mut Input| {};
        let mut state = state.clone();
        group.bench_function(name, |b| {
            b.iter(|| integrator.step(model, &mut state, &mut workspace, 1e-3, &mut coast));
        });
    }
    let gains = Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: vec![10.0; n],
        saturation: Saturation {
            position: 0.2,
            orientation: 0.1,
        },
    };
    let mut law = TransposeJacobian::new(model, tip, gains, JacobianKind::Generalized)
        .expect("gains are positive");
    let X_BE = workspace.X_BF(tip);
    let X_BD = Pose::from_parts(Translation3::new(1.0, 2.0, 0.5), Rotation3::identity());
    let mut efforts = DVector::zeros(n);
    group.bench_function("control law", |b| {
        b.iter(|| {
            let seen = Measurement {
                q: black_box(&positions[next()]),
                qd: &state.qd,
                X_BE: &X_BE,
                X_BD: &X_BD,
            };
            law.efforts(model, &mut workspace, &seen, &mut efforts);
            black_box(&efforts);
        });
    });
}

fn dynamics(c: &mut Criterion) {
    for (name, model) in robots() {
        let mut group = c.benchmark_group(name);
        group
            // Many short samples, so that on a shared machine the median is of undisturbed ones.
            .sampling_mode(SamplingMode::Flat)
            .warm_up_time(Duration::from_millis(100))
            .measurement_time(Duration::from_millis(500))
            .sample_size(500);
        kernels(&mut group, &model);
        group.finish();
    }
}

criterion_group!(benches, dynamics);
criterion_main!(benches);
