//! The step loop takes no memory.

use allocation_counter::measure;
use fuyu::control::{
    Controller, ControllerConfig, Gains, JacobianKind, LawKind, Measurement, Saturation,
    TransposeJacobian,
};
use fuyu::dynamics::{Floating, Input, Integrator, Method, State, Workspace};
use nalgebra::{DVector, Matrix6xX};

use crate::fixtures::servicer;
use crate::loops::mechanisms::{HINGE, on_branch, pantograph, pantograph_loops};

#[test]
fn steps_jacobians_and_the_control_law_do_not_allocate() {
    let model = servicer();
    let tip = model.frame("tool0").unwrap().clone();
    let mut state = State::at_rest(&model);
    let mut workspace = Workspace::new(&model);
    let mut efforts = DVector::zeros(6);
    let gains = Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: vec![400.0, 100.0, 200.0, 10.0, 2.0, 2.0],
        saturation: Saturation {
            position: 0.2,
            orientation: 0.1,
        },
    };
    let mut controller = Controller::new(
        model.clone(),
        tip.clone(),
        ControllerConfig {
            law: LawKind::TransposeJacobian,
            jacobian: JacobianKind::Generalized,
            gains: gains.clone(),
            joint_k_p: Vec::new(),
        },
    )
    .unwrap();
    let mut matrix = Matrix6xX::zeros(6);
    let mut law = TransposeJacobian::new(&model, &tip, gains, JacobianKind::Generalized).unwrap();
    let mut push = |_: f64, _: &State, input: &mut Input| input.efforts.fill(0.1);
    for method in [Method::Rk4, Method::Dop8] {
        let mut integrator = Integrator::new(&model, method);
        let mut floating = Floating::new(model.clone(), state.clone(), method);
        let used = measure(|| {
            for _ in 0..100 {
                integrator.step(&model, &mut state, &mut workspace, 0.01, &mut push);
                let X_BE = workspace.X_BF(&tip);
                let seen = Measurement {
                    q: &state.q,
                    qd: &state.qd,
                    X_BE: &X_BE,
                    X_BD: &X_BE,
                };
                law.efforts(&model, &mut workspace, &seen, &mut efforts);
                controller
                    .update(&state.q, &state.qd, Some((&X_BE, &X_BE)))
                    .unwrap();
                workspace.base_map(&model, &mut matrix);
                workspace.generalized_jacobian(&tip, &mut matrix);
                workspace.reduced_inertia();
                floating.hold_efforts(efforts.as_slice());
                floating.step(0.01, 1);
                floating.accelerations();
            }
        });
        assert_eq!(used.count_total, 0, "{method:?}: {used:?}");
    }
}

/// Closed loops neither, from a singular state on.
#[test]
fn steps_of_closed_loops_do_not_allocate() {
    let model = pantograph(1.0);
    let mut state = on_branch(&model, 0.3, 0.0, 0.0, 0.3);
    let mut loops = pantograph_loops(&model, HINGE);
    loops.assemble(&model, &mut state, 1e-9).unwrap();
    let mut floating = Floating::with_loops(model, state, Method::Dop8, loops);
    let used = measure(|| floating.step(0.01, 20));
    assert_eq!(used.count_total, 0, "{used:?}");
    assert!(floating.state().q[1] > 0.01);
}
