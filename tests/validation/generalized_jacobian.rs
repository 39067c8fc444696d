//! Jacobians, base map, reduced inertia and accelerations against Pinocchio's centroidal quantities and
//! articulated-body algorithm (`fixtures/gjm.json`): different formulas, in independent code.

use fuyu::dynamics::{Input, State, Workspace};
use fuyu::spatial::Twist;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6xX, Translation3, UnitQuaternion};

use crate::fixtures::{Case, numbers, rotation, rows, vector};

/// The fixtures are doubles from a different order of operations; 1e-12 allows for the accumulated rounding errors.
const RELATIVE: f64 = 1e-12;

fn assert_close(what: &str, ours: &DMatrix<f64>, theirs: &[Vec<f64>], column_of: &[usize]) {
    let scale = theirs.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
    for (i, row) in theirs.iter().enumerate() {
        for (k, value) in row.iter().enumerate() {
            let difference = (ours[(i, column_of[k])] - value).abs();
            assert!(
                difference <= RELATIVE * scale,
                "{what}[{i}][{k}] differs by {difference:e}"
            );
        }
    }
}

fn dynamic(matrix: &Matrix6xX<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(6, matrix.ncols(), matrix.as_slice())
}

#[test]
fn jacobians_base_map_and_reduced_inertia_agree() {
    for case in Case::all() {
        let (model, n) = (&case.model, case.model.dof());
        let tip = model.frame("tip").unwrap();
        let mut workspace = Workspace::new(model);
        workspace.set_positions(&case.joint_vector("q"));
        let mut matrix = Matrix6xX::zeros(n);
        workspace.generalized_jacobian(tip, &mut matrix);
        assert_close(
            "GJM",
            &dynamic(&matrix),
            &rows(&case.data["GJM"]),
            &case.order,
        );
        workspace.fixed_base_jacobian(tip, &mut matrix);
        assert_close(
            "J",
            &dynamic(&matrix),
            &rows(&case.data["J_fixed"]),
            &case.order,
        );
        workspace.base_map(&mut matrix);
        assert_close(
            "base map",
            &dynamic(&matrix),
            &rows(&case.data["base_map_HL_HA"]),
            &case.order,
        );
        let reduced = workspace.reduced_inertia().clone();
        let mut permuted = DMatrix::zeros(n, n);
        for (i, &a) in case.order.iter().enumerate() {
            permuted.set_row(i, &reduced.row(a));
        }
        assert_close(
            "reduced inertia",
            &permuted,
            &rows(&case.data["H_hat"]),
            &case.order,
        );
    }
}

fn moving_state(case: &Case, workspace: &mut Workspace) -> State {
    let model = &case.model;
    let mut state = State::at_rest_with(model, &case.joint_vector("q"));
    state.qd = case.joint_vector("qd");
    let attitude = UnitQuaternion::from_rotation_matrix(&rotation(&case.data["base_R"]));
    let pose = Isometry3::from_parts(Translation3::from(vector(&case.data["base_pos"])), attitude);
    let twist = numbers(&case.data["base_twist_bodyframe_lin_ang"]);
    let linear = nalgebra::Vector3::from_row_slice(&twist[..3]);
    let angular = nalgebra::Vector3::from_row_slice(&twist[3..]);
    state.set_base(workspace, &pose, &Twist::new(angular, linear));
    state
}

#[test]
fn accelerations_agree_with_and_without_momentum() {
    let mut with_momentum = 0;
    for case in Case::all() {
        let model = &case.model;
        let mut workspace = Workspace::new(model);
        let state = moving_state(&case, &mut workspace);
        let scale = state.momentum_W.linear.norm() + state.momentum_W.angular.norm();
        with_momentum += usize::from(scale > 1.0);
        workspace.set_motion(&state);
        let mut input = Input::zero(model);
        input.efforts = case.joint_vector("tau");
        let mut qdd = DVector::zeros(model.dof());
        workspace.accelerations(&state, &input, &mut qdd);
        let theirs = case.joint_vector("ABA_qdd");
        assert!(
            (&qdd - &theirs).amax() <= RELATIVE * theirs.amax(),
            "{}",
            (&qdd - &theirs).amax()
        );

        // Base acceleration: the fixture's is spatial; as a point's acceleration it gains ω × v.
        workspace.set_accelerations(&qdd);
        let base = workspace.A_WF_B(&model.frames()[0]);
        let theirs = numbers(&case.data["ABA_base_spatial_acc_bodyframe_lin_ang"]);
        let twist = workspace.V_WB_B();
        let linear =
            nalgebra::Vector3::from_row_slice(&theirs[..3]) + twist.angular.cross(&twist.linear);
        let angular = nalgebra::Vector3::from_row_slice(&theirs[3..]);
        assert!((base.linear - linear).norm() <= RELATIVE * linear.norm().max(1.0));
        assert!((base.angular - angular).norm() <= RELATIVE * angular.norm().max(1.0));
    }
    assert!(
        with_momentum > 0,
        "the fixtures must hold a case with momentum"
    );
}

#[test]
fn tip_pose_and_momentum_agree() {
    for case in Case::all() {
        let model = &case.model;
        let mut workspace = Workspace::new(model);
        let state = moving_state(&case, &mut workspace);
        let X_WE = state.X_WB(&workspace) * workspace.X_BF(model.frame("tip").unwrap());
        let theirs = vector(&case.data["ee_pos_world"]);
        assert!((X_WE.translation.vector - theirs).norm() < 1e-14 * (1.0 + theirs.norm()) * 10.0);
        let theirs = rotation(&case.data["ee_R_world"]);
        assert!((X_WE.rotation.matrix() - theirs.matrix()).norm() < 1e-14);
        let theirs = numbers(&case.data["centroidal_momentum_world_lin_ang"]);
        let ours = &state.momentum_W;
        let scale = theirs.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        for k in 0..3 {
            assert!((ours.linear[k] - theirs[k]).abs() <= RELATIVE * scale);
            assert!((ours.angular[k] - theirs[3 + k]).abs() <= RELATIVE * scale);
        }
    }
}
