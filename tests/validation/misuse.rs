//! Mistakes in a program that uses the library: each panics with a message that names it.

use std::panic::{AssertUnwindSafe, catch_unwind};

use fuyu::dynamics::{
    Batch, Floating, Formulation, FormulationKind, Input, IntegrationMethod, Integrator,
    InverseDynamics, State, TreeAcceleration, TreeMotion, Workspace,
};
use fuyu::model::Model;
use fuyu::spatial::Twist;
use nalgebra::{DVector, Matrix6xX, UnitQuaternion};

use crate::fixtures::servicer;

/// Another robot with the same number of joints, so that only the identity of the model distinguishes them.
fn heavier_servicer() -> Model {
    let xml = include_str!("../../urdf/servicer.urdf").replace("<mass value=\"", "<mass value=\"1");
    Model::from_urdf(&xml, "heavier_servicer.urdf").unwrap()
}

#[track_caller]
fn assert_panics(expected: &[&str], misuse: impl FnOnce()) {
    let result = catch_unwind(AssertUnwindSafe(misuse));
    let payload = result.expect_err("misuse goes unnoticed");
    let message = payload.downcast_ref::<String>().expect("a formatted text");
    for part in expected {
        assert!(message.contains(part), "{part} is not in: {message}");
    }
}

fn nothing(_: f64, _: &State, _: &mut Input) {}

#[test]
fn the_integrator_of_one_robot_refuses_the_workspace_of_another() {
    let (model, other) = (servicer(), heavier_servicer());
    let mut integrator = Integrator::new(&model, IntegrationMethod::Rk4);
    let mut workspace = Workspace::new(&other);
    let mut state = State::at_rest(&other);
    assert_panics(
        &[
            "the integrator was made for",
            "the workspace for",
            "the same model",
        ],
        || integrator.step(&mut state, &mut workspace, 0.01, &mut nothing),
    );
}

/// Two models from the same description count as the same robot.
#[test]
fn equal_models_may_be_mixed() {
    let (model, again) = (servicer(), servicer());
    let mut integrator = Integrator::new(&model, IntegrationMethod::Rk4);
    let mut workspace = Workspace::new(&again);
    let mut state = State::at_rest(&again);
    integrator.step(&mut state, &mut workspace, 0.01, &mut nothing);
}

#[test]
fn vectors_of_the_wrong_length_are_named() {
    let model = servicer();
    let short = DVector::zeros(5);
    let mut workspace = Workspace::new(&model);
    let has_5 = |name: &str| format!("`{name}` has 5 elements, but robot");
    assert_panics(&[&has_5("q"), "6 joints"], || {
        workspace.set_positions(&short)
    });
    assert_panics(&[&has_5("q")], || {
        State::at_rest_with(&model, &short);
    });
    let mut state = State::at_rest(&model);
    state.qd = short.clone();
    assert_panics(&[&has_5("state.qd")], || workspace.set_motion(&state));
    let mut integrator = Integrator::new(&model, IntegrationMethod::Dop8);
    assert_panics(&[&has_5("state.qd")], || {
        integrator.step(&mut state, &mut workspace, 0.01, &mut nothing);
    });
    assert_panics(&[&has_5("state.qd")], || {
        Floating::new(model.clone(), state.clone(), IntegrationMethod::Rk4);
    });
    let mut matrix = Matrix6xX::zeros(5);
    let tip = model.frame("tool0").unwrap();
    assert_panics(&[&has_5("out")], || {
        workspace.generalized_jacobian(tip, &mut matrix);
    });
    let mut replaces = |_: f64, _: &State, input: &mut Input| input.efforts = DVector::zeros(5);
    let mut state = State::at_rest(&model);
    assert_panics(&[&has_5("input.efforts")], || {
        integrator.step(&mut state, &mut workspace, 0.01, &mut replaces);
    });
    let mut robot = Floating::new(model.clone(), state, IntegrationMethod::Rk4);
    assert_panics(&[&has_5("efforts")], || {
        robot.hold_efforts(&[0.0; 5]);
    });
}

#[test]
fn every_formulation_names_a_wrong_length() {
    let model = servicer();
    let mut input = Input::zero(&model);
    input.wrenches.pop();
    let motion = TreeMotion {
        R_WB: UnitQuaternion::identity(),
        V_WB_B: Twist::ZERO,
        q: &[0.0; 6],
        qd: &[0.0; 6],
    };
    for (_, kind) in FormulationKind::NAMES {
        let mut formulation = kind.prepare(&model).unwrap();
        let mut out = TreeAcceleration::zero(&model);
        assert_panics(&["`input.wrenches` has 6 elements", "7 bodies"], || {
            formulation.accelerations(&motion, &input, &mut out);
        });
    }
    let mut inverse = InverseDynamics::new(&model);
    let wrenches = Input::zero(&model).wrenches;
    assert_panics(&["`efforts` has 7 elements", "6 joints"], || {
        inverse.free_floating_efforts(&motion, &[0.0; 6], &wrenches, &mut [0.0; 7]);
    });
}

#[test]
fn a_batch_names_what_does_not_fit() {
    let model = servicer();
    let mut batch = Batch::new(&model, IntegrationMethod::Rk4, 10);
    let target = Model::from_urdf(include_str!("../../urdf/target.urdf"), "target.urdf").unwrap();
    assert_panics(&["`state.q` has 0 elements", "6 joints"], || {
        batch.set_state(0, &State::at_rest(&target));
    });
    assert_panics(&["no state 10 in a batch of 10"], || {
        batch.set_state(10, &State::at_rest(&model));
    });
    assert_panics(&["`efforts` has 5 elements"], || {
        batch.hold_efforts(0, &[0.0; 5])
    });
    assert_panics(&["`controllers` has 9 elements", "10 states"], || {
        batch.control(&mut [(); 9], |(), _, _| {});
    });
    assert_panics(&["`data` has 11 elements", "10 states"], || {
        batch.step_with(0.01, 1, &mut [(); 11], |(), _, _| {});
    });
}

#[test]
fn a_frame_of_a_larger_robot_is_named() {
    let tip = servicer().frame("tool0").unwrap().clone();
    let small = include_str!("../../urdf/planar_two_link.urdf");
    let workspace = Workspace::new(&Model::from_urdf(small, "planar_two_link.urdf").unwrap());
    assert_panics(&["frame `tool0` is on body 6", "3 bodies"], || {
        workspace.X_BF(&tip);
    });
}
