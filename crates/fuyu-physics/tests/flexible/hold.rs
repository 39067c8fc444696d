//! An attitude law that is sampled at 10 Hz and drives the wheels while the arm moves.

use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleWorkspace,
};
use nalgebra::{DVector, Vector3};

use crate::support::{
    POSTURES, attitude_error, difference, efforts, fixture, numbers, quaternion,
    servicer_with_wheels, vector,
};

// Proportional and rate feedback on attitude and rate; torques are held for .1 s. The base's torque is minus that of
// the wheels.
#[test]
fn wheels_hold_the_attitude_while_the_arm_moves() {
    let expected = fixture("flexible_hold_nominal");
    let reference = quaternion(&expected["reference_xyzw"]);
    let system = servicer_with_wheels(0.0);
    let q = DVector::from_row_slice(&POSTURES[1].1);
    let mut state = FlexibleState::at_rest_with(&system, &q);
    let mut workspace = FlexibleWorkspace::new(&system);
    let p_BC = state.tree.p_WC;
    workspace.set_state(&state);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
    let (mut worst, mut saturated) = ([0.0_f64; 4], [0; 3]);
    let mut held = Vector3::zeros();
    let error_of = |state: &FlexibleState| {
        let turn = reference.inverse() * state.tree.R_WB;
        2.0 * turn.w.signum() * turn.imag()
    };
    for i in 0..300 {
        let error = error_of(&state);
        if i % 10 == 0 {
            let k = i / 10;
            worst[0] = worst[0].max(attitude_error(&state, &expected["quat"][k]));
            let speeds = numbers(&expected["wheel_speed"][k]);
            worst[1] = worst[1].max(difference(state.wheel_speeds(), &speeds));
            worst[2] = worst[2].max((error - vector(&expected["error_rad"][k])).norm());
            worst[3] = worst[3].max(difference(state.mu(), &numbers(&expected["mu"][k])));
        }
        let wanted = -(error * 60.0 + workspace.V_WB_B().angular * 900.0);
        for axis in 0..3 {
            held[axis] = -wanted[axis].clamp(-4.0, 4.0);
            saturated[axis] += i32::from(wanted[axis].abs() > 4.0);
        }
        let mut forcing = |t: f64, s: &FlexibleState, input: &mut FlexibleInput| {
            efforts(0.3, t, s.tree.qd.as_slice(), &mut input.tree.efforts);
            input.wheel_torques.copy_from_slice(held.as_slice());
        };
        integrator.steps(&mut state, &mut workspace, 0.02, 5, &mut forcing);
    }
    let final_error = (error_of(&state) - vector(&expected["error_rad"][30])).norm();
    println!("attitude, wheels, error, modes: {worst:?}; at 30 s {final_error:.1e}");
    assert!(worst[0] < 1e-8 && worst[1] < 1e-6, "{worst:?}");
    assert!(worst[2] < 1e-8 && worst[3] < 1e-7, "{worst:?}");
    assert!(final_error < 1e-8, "{final_error:e}");
    assert_eq!(saturated, [0, 0, 0]);
    // Neither momentum nor the centre of mass moves.
    assert_eq!(state.tree.momentum_W.angular, Vector3::zeros());
    assert_eq!(state.tree.p_WC, p_BC);
}
