//! The step loop takes no memory.

use allocation_counter::measure;
use fuyu::control::{
    Controller, ControllerConfig, Gains, JacobianKind, JointPdGains, LawKind, Measurement,
    Saturation, Sight,
};
use fuyu::dynamics::{Floating, Input, Integrator, Method, State, Workspace};
use nalgebra::Matrix6xX;

use crate::fixtures::servicer;
use crate::loops::mechanisms::{HINGE, on_branch, pantograph, pantograph_loops};

#[test]
fn steps_jacobians_and_the_control_law_do_not_allocate() {
    let model = servicer();
    let tip = model.frame("tool0").unwrap().clone();
    let mut state = State::at_rest(&model);
    let mut workspace = Workspace::new(&model);
    let gains = Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: vec![400.0, 100.0, 200.0, 10.0, 2.0, 2.0],
        saturation: Saturation {
            position: 0.2,
            orientation: 0.1,
        },
    };
    let mut controllers = LawKind::NAMES.map(|(_, law)| {
        let config = ControllerConfig {
            joint_pd: JointPdGains { k_p: vec![1.0; 6] },
            ..ControllerConfig::new(law, gains.clone())
        };
        let mut controller = Controller::new(model.clone(), tip.clone(), config.clone()).unwrap();
        // The joint PD searches its joint goal at its first step, and every law hands over in the next ones.
        let X_BE = Workspace::new(&model).X_BF(&tip);
        let sight = Sight::new(0.0, X_BE, X_BE);
        let seen = Measurement::new(0.0, &state.q, &state.qd).with_sight(Some(&sight));
        controller.update(&seen).unwrap();
        let jacobian = JacobianKind::FixedBase;
        let approximate = ControllerConfig { jacobian, ..config };
        controller.set_config(approximate).unwrap();
        controller
    });
    let mut matrix = Matrix6xX::zeros(6);
    let mut push = |_: f64, _: &State, input: &mut Input| input.efforts.fill(0.1);
    for method in [Method::Rk4, Method::Dop8] {
        let mut integrator = Integrator::new(&model, method);
        let mut floating = Floating::new(model.clone(), state.clone(), method);
        let used = measure(|| {
            for _ in 0..100 {
                integrator.step(&model, &mut state, &mut workspace, 0.01, &mut push);
                let X_BE = workspace.X_BF(&tip);
                let sight = Sight::new(state.time, X_BE, X_BE);
                let seen = Measurement::new(state.time, &state.q, &state.qd);
                for controller in &mut controllers {
                    controller.update(&seen.with_sight(Some(&sight))).unwrap();
                }
                workspace.base_map(&model, &mut matrix);
                workspace.generalized_jacobian(&tip, &mut matrix);
                workspace.reduced_inertia();
                floating.hold_efforts(controllers[0].efforts().as_slice());
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
