//! Every instruction set gives the same results, to the last bit.

use nalgebra::{DVector, Matrix3, Matrix6xX, Rotation3, Translation3, UnitQuaternion, Vector3};
use pulp::Arch;

use super::{
    ArticulatedBody, Formulation, Input, IntegrationMethod, Integrator, State, TreeAcceleration,
    TreeMotion, Workspace,
};
use crate::model::{JointKind, Model, ModelBuilder};
use crate::spatial::{Pose, RigidInertia, Twist};

/// The instruction sets of this machine: scalar, AVX2 and AVX-512 if available.
fn instruction_sets() -> Vec<Arch> {
    let mut sets = vec![Arch::Scalar, Arch::new()];
    #[cfg(target_arch = "x86_64")]
    sets.extend(pulp::x86::V3::try_new().map(Arch::V3));
    sets
}

/// A tree with all kinds of joint transforms: branches, prismatic joints, axes parallel, at right angles and at any angle.
fn tree() -> Model {
    let body = |mass: f64| RigidInertia {
        mass,
        com: Vector3::new(0.2, -0.03, 0.05),
        about_com: Matrix3::from_diagonal(&Vector3::new(0.1, 0.2, 0.25)) * mass,
    };
    let mut builder = ModelBuilder::new("tree", "base_link", body(100.0));
    let mut parent = 0;
    for k in 0..11 {
        let quarter = std::f64::consts::FRAC_PI_2;
        let turn = [0.0, quarter, 0.7][k % 3];
        let placement = Pose::from_parts(
            Translation3::new(0.4, 0.1 * (k % 2) as f64, 0.2 * (k % 4) as f64),
            Rotation3::from_euler_angles(turn, 0.0, 0.3 * (k % 5) as f64),
        );
        let kind = match k % 4 {
            2 => JointKind::Prismatic,
            _ => JointKind::Continuous,
        };
        let from = if k == 6 { 2 } else { parent };
        let (name, axis) = (format!("link{k}"), Vector3::z_axis());
        parent = builder.body(&name, from, kind, axis, placement, body(5.0));
    }
    builder.frame("tip", parent, Some("link10".to_owned()), Pose::identity());
    builder.build()
}

/// Position-dependent terms, accelerations, and the state after some steps.
fn all_results(model: &Model, arch: Arch) -> Vec<f64> {
    let n = model.dof();
    let q = DVector::from_fn(n, |j, _| 3.0 * (1.0 + j as f64).sin());
    let mut state = State::at_rest_with(model, &q);
    state.qd = DVector::from_fn(n, |j, _| (2.0 + j as f64).cos());
    state.R_WB = UnitQuaternion::new(Vector3::new(0.3, -1.0, 0.4));
    state.momentum_W.angular = Vector3::new(3.0, -5.0, 2.0);
    let mut input = Input::zero(model);
    input.efforts = DVector::from_fn(n, |j, _| (3.0 * j as f64).sin());

    let mut workspace = Workspace::new(model);
    workspace.arch = arch;
    workspace.set_positions(&q);
    let mut jacobian = Matrix6xX::zeros(n);
    workspace.generalized_jacobian(model.frame("tip").unwrap(), &mut jacobian);
    let mut results = jacobian.as_slice().to_vec();
    workspace.base_map(&mut jacobian);
    results.extend(jacobian.as_slice());
    results.extend(workspace.reduced_inertia().as_slice());

    let mut dynamics = ArticulatedBody::new(model);
    dynamics.scratch.arch = arch;
    let motion = TreeMotion {
        R_WB: state.R_WB,
        V_WB_B: Twist::new(Vector3::new(0.1, 0.2, -0.3), Vector3::zeros()),
        q: state.q.as_slice(),
        qd: state.qd.as_slice(),
    };
    let mut answer = TreeAcceleration::zero(model);
    dynamics.accelerations(&motion, &input, &mut answer);
    results.extend(answer.qdd.as_slice());

    let mut integrator = Integrator::new(model, IntegrationMethod::Rk4);
    integrator.set_arch(arch);
    let mut hold = |_: f64, _: &State, into: &mut Input| into.copy_from(&input);
    integrator.steps(&mut state, &mut workspace, 0.01, 5, &mut hold);
    results.extend(state.q.as_slice());
    results.extend(state.R_WB.coords.as_slice());
    results
}

/// Fails if a kernel rounds differently with one instruction set, or mixes up lanes.
#[test]
fn every_instruction_set_gives_the_same_bits() {
    let model = tree();
    let [first, others @ ..] = &instruction_sets()[..] else {
        unreachable!("there is always the scalar width");
    };
    let expected = all_results(&model, *first);
    assert!(expected.iter().all(|x| x.is_finite()));
    for arch in others {
        assert_eq!(all_results(&model, *arch), expected, "{arch:?}");
    }
}

/// The same for a batch, whose lanes are states.
#[cfg(feature = "batch")]
#[test]
fn a_batch_gives_the_same_bits_with_every_instruction_set() {
    let model = tree();
    let n = model.dof();
    let results = |arch| {
        let mut batch = super::Batch::new(&model, IntegrationMethod::Rk4, 11);
        batch.set_arch(arch);
        for index in 0..batch.len() {
            let q = DVector::from_fn(n, |j, _| 3.0 * ((1 + j + 7 * index) as f64).sin());
            let mut state = State::at_rest_with(&model, &q);
            state.qd = DVector::from_fn(n, |j, _| ((2 + j + index) as f64).cos());
            batch.set_state(index, &state);
        }
        batch.accelerate();
        let mut results: Vec<f64> = Vec::new();
        for index in 0..batch.len() {
            results.extend((0..n).map(|j| batch.qdd(index, j)));
        }
        batch.step(0.01, 5);
        for index in 0..batch.len() {
            results.extend(batch.state(index).q.as_slice());
        }
        results
    };
    let expected = results(Arch::Scalar);
    assert!(expected.iter().all(|x| x.is_finite()));
    for arch in instruction_sets() {
        assert_eq!(results(arch), expected, "{arch:?}");
    }
}
