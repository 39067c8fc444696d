//! An attitude law that is sampled at 10 Hz and drives the wheels while the arm moves.

use fuyu_physics::control::attitude::{
    AttitudeDeviation, AttitudeRegulator, AttitudeTarget, Dvdfb, RegulatorConfig, RegulatorInput,
};
use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleWorkspace,
};
use nalgebra::{DVector, UnitQuaternion, Vector3};
use serde_json::Value;

use crate::support::{
    POSTURES, attitude_error, difference, efforts, fixture, numbers, quaternion,
    servicer_with_wheels_of, vector,
};

/// What a run of 30 s ends with.
struct Held {
    error: Vector3<f64>,
    /// Samples at which each wheel was at its limit.
    saturated: [usize; 3],
    /// Largest differences from the fixture: attitude, wheel speeds, error, modes.
    worst: [f64; 4],
}

/// Direct feedback without feed-forward holds an attitude 1 deg about y away while the arm is driven by `scale` times
/// the usual efforts. Torques are held for .1 s. Compares with samples each second, if there are any.
fn hold(max_torque: f64, scale: f64, expected: &Value) -> Held {
    let target = AttitudeTarget::fixed(reference());
    let system = servicer_with_wheels_of(0.0, max_torque);
    let q = DVector::from_row_slice(&POSTURES[1].1);
    let mut state = FlexibleState::at_rest_with(&system, &q);
    let mut workspace = FlexibleWorkspace::new(&system);
    let p_BC = state.tree.p_WC;
    workspace.set_state(&state);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
    let law = Dvdfb::diagonal([60.0; 3], [900.0; 3]).unwrap();
    let config = RegulatorConfig {
        feed_forward: false,
        gyroscopic: false,
        ..RegulatorConfig::new(0.1)
    };
    let mut regulator = AttitudeRegulator::new(&system, Box::new(law), config).unwrap();
    let (mut worst, mut saturated) = ([0.0_f64; 4], [0; 3]);
    for i in 0..300 {
        let w_WB_B = workspace.V_WB_B().angular;
        let deviation = AttitudeDeviation::new(&state.tree.R_WB, &w_WB_B, &target);
        if i % 10 == 0 && !expected.is_null() {
            let k = i / 10;
            worst[0] = worst[0].max(attitude_error(&state, &expected["quat"][k]));
            let speeds = numbers(&expected["wheel_speed"][k]);
            worst[1] = worst[1].max(difference(state.wheel_speeds(), &speeds));
            let error = vector(&expected["error_rad"][k]);
            worst[2] = worst[2].max((deviation.angle - error).norm());
            worst[3] = worst[3].max(difference(state.mu(), &numbers(&expected["mu"][k])));
        }
        regulator.step(&RegulatorInput {
            deviation,
            w_WB_B,
            wheel_speeds: Some(state.wheel_speeds()),
            arm: None,
        });
        for (count, at_limit) in saturated.iter_mut().zip(regulator.wheels().at_limit()) {
            *count += usize::from(*at_limit);
        }
        let mut forcing = |t: f64, s: &FlexibleState, input: &mut FlexibleInput| {
            efforts(scale, t, s.tree.qd.as_slice(), &mut input.tree.efforts);
            input
                .wheel_torques
                .copy_from_slice(regulator.wheel_torques());
        };
        integrator.steps(&mut state, &mut workspace, 0.02, 5, &mut forcing);
    }
    // Neither momentum nor the centre of mass moves.
    assert_eq!(state.tree.momentum_W.angular, Vector3::zeros());
    assert_eq!(state.tree.p_WC, p_BC);
    let w = workspace.V_WB_B().angular;
    Held {
        error: AttitudeDeviation::new(&state.tree.R_WB, &w, &target).angle,
        saturated,
        worst,
    }
}

fn reference() -> UnitQuaternion<f64> {
    quaternion(&fixture("flexible_hold_nominal")["reference_xyzw"])
}

#[test]
fn wheels_hold_the_attitude_while_the_arm_moves() {
    let expected = fixture("flexible_hold_nominal");
    let held = hold(4.0, 0.3, &expected);
    let final_error = (held.error - vector(&expected["error_rad"][30])).norm();
    println!(
        "attitude, wheels, error, modes: {:?}; at 30 s {final_error:.1e}",
        held.worst
    );
    let [attitude, speeds, error, modes] = held.worst;
    assert!(attitude < 1e-8 && speeds < 1e-6, "{attitude:e} {speeds:e}");
    assert!(error < 1e-8 && modes < 1e-7, "{error:e} {modes:e}");
    assert!(final_error < 1e-8, "{final_error:e}");
    assert_eq!(held.saturated, [0, 0, 0]);
}

// Wheels of 1 N m and an arm that moves twice as fast: most samples are at the limit. The final error and the numbers
// of samples are of the same independent program. A limit that keeps the torque's direction, or takes other wheels
// instead, ends elsewhere.
#[test]
fn saturated_wheels_hold_as_well_as_they_can() {
    let held = hold(1.0, 0.6, &Value::Null);
    let expected = Vector3::new(0.069_191_906, 0.002_655_750, 0.019_692_645);
    println!("{:?} {:.9?}", held.saturated, held.error);
    assert!((held.error - expected).amax() < 2e-8, "{:.9}", held.error);
    for (found, expected) in held.saturated.into_iter().zip([272_usize, 188, 247]) {
        assert!(found.abs_diff(expected) <= 1, "{:?}", held.saturated);
    }
}
