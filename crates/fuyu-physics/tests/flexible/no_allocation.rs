//! The step loop does not allocate.

use allocation_counter::measure;
use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    AdaptiveIntegrator, FlexibleInput, FlexibleIntegrator, FlexibleJacobian, FlexibleState,
    FlexibleWorkspace, Tolerance,
};
use nalgebra::Matrix6xX;

use crate::conservation::everything;
use crate::support::servicer_with_wheels;

#[test]
fn steps_do_not_allocate() {
    for system in [
        servicer_with_wheels(0.6),
        everything(false, true),
        everything(true, true),
    ] {
        let mut state = FlexibleState::at_rest(&system);
        let mut workspace = FlexibleWorkspace::new(&system);
        let mut fixed = [IntegrationMethod::Rk4, IntegrationMethod::Dop8]
            .map(|method| FlexibleIntegrator::new(&system, method));
        let mut adaptive = AdaptiveIntegrator::new(&system, Tolerance::default());
        let mut jacobian = FlexibleJacobian::new(&system);
        let tip = system.model().frame("tool0").unwrap().clone();
        let columns = state.tree.q.len() + state.mu().len();
        let columns = columns + state.motor_angles().len() + state.wheel_angles().len();
        let mut J = Matrix6xX::zeros(columns);
        let mut push = |_: f64, _: &FlexibleState, input: &mut FlexibleInput| {
            input.tree.efforts.fill(0.1);
            input.wheel_torques.fill(0.2);
        };
        let used = measure(|| {
            for _ in 0..5 {
                for integrator in &mut fixed {
                    integrator.step(&mut state, &mut workspace, 0.001, &mut push);
                }
                let advanced = adaptive.advance(&mut state, &mut workspace, 0.002, &mut push);
                assert!(advanced.is_ok());
                workspace.carried_momentum(&state);
                workspace.kinetic_energy(&state);
                workspace.strain_energy(&state);
                jacobian.compute(&state, &tip, &mut J);
            }
        });
        assert_eq!(used.count_total, 0);
        // Not part of a step; allocates for elastic links.
        assert_eq!(workspace.first_order_excess(&state), None);
        assert!(state.is_finite());
    }
}
