//! Desaturation of the wheels by thrusters.

use fuyu_physics::control::attitude::{RegulatorConfig, UnloadingConfig};
use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleWorkspace,
};
use fuyu_physics::spatial::{Pose, Twist};
use nalgebra::{DVector, Vector3};

use super::{regulate, regulator};
use crate::support::{POSTURES, servicer_with_wheels_and_thrusters};

// The wheels start with 80, -60 and 40 N m s of 100. Unloading starts at once, takes the momentum out of the robot, and
// ends when every wheel has less than a tenth of its limit; the wheels' torques keep the base where it is.
#[test]
fn thrusters_take_the_momentum_of_the_wheels() {
    let system = servicer_with_wheels_and_thrusters();
    let q = DVector::from_row_slice(&POSTURES[1].1);
    let mut state = FlexibleState::at_rest_with(&system, &q);
    let mut workspace = FlexibleWorkspace::new(&system);
    state
        .wheel_speeds_mut()
        .copy_from_slice(&[400.0, -300.0, 200.0]);
    state.set_base(&mut workspace, &Pose::identity(), &Twist::ZERO);
    workspace.set_state(&state);
    let before = state.tree.momentum_W;
    let h = Vector3::new(80.0, -60.0, 40.0);
    assert!((before.angular - h).norm() < 1e-12);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
    let config = RegulatorConfig {
        unloading: Some(UnloadingConfig {
            start: 0.7,
            stop: 0.1,
            time: 30.0,
        }),
        ..RegulatorConfig::new(0.1)
    };
    let mut regulator = regulator(&system, config);
    let (mut largest, mut expected, mut ended) = (0.0_f64, Vector3::zeros(), None);
    let mut loads = Vec::new();
    for k in 0..1500 {
        let report = regulate(&mut regulator, &state, &workspace);
        loads.push(report.wheel_load.unwrap());
        assert_eq!(
            report.is_unloading,
            ended.is_none() && report.wheel_load >= Some(0.1)
        );
        if !report.is_unloading && ended.is_none() {
            ended = Some(k);
        }
        if let Some(given) = report.thrusters {
            expected += state.tree.R_WB * given.torque * 0.1;
        }
        for (i, time) in regulator.on_times().iter().enumerate() {
            state.fire(&system, i, *time);
        }
        let torques = regulator.wheel_torques();
        // The joints are held by strong damping.
        let mut forcing = |_: f64, s: &FlexibleState, input: &mut FlexibleInput| {
            input.tree.efforts.copy_from(&(&s.tree.qd * -300.0));
            input.tree.efforts[5] = -2.0 * s.tree.qd[5];
            input.tree.efforts[4] = -20.0 * s.tree.qd[4];
            input.tree.efforts[3] = -50.0 * s.tree.qd[3];
            input.wheel_torques.copy_from_slice(torques);
        };
        integrator.steps(&mut state, &mut workspace, 0.01, 10, &mut forcing);
        largest = largest.max(state.tree.R_WB.angle());
    }
    let ended = ended.expect("unloading ends");
    let impulse: f64 = state.thruster_impulses().iter().sum();
    println!(
        "unloaded after {} s; largest turn {:.4} deg; wheels {:?} N m s; thrusters {impulse:.2} N s",
        ended as f64 * 0.1,
        largest.to_degrees(),
        workspace.wheel_momentum(&state)
    );
    assert!(
        loads[ended] < 0.1 && loads[1499] < 0.15,
        "{:?}",
        loads[1499]
    );
    assert!(largest < 0.1f64.to_radians(), "{largest}");
    // Momentum has changed by what the report says, but for what the base turned within a period.
    let change = state.tree.momentum_W.angular - before.angular;
    assert!(
        (change - expected).norm() < 2e-3 * expected.norm(),
        "{change} {expected}"
    );
    // About 130 N m s at a lever of some 1 m in couples of two.
    assert!(impulse > 100.0 && impulse < 400.0, "{impulse}");
}
