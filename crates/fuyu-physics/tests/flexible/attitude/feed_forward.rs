//! The arm's momentum, and the base that stays still.

use fuyu_physics::control::attitude::{ArmMomentum, RegulatorConfig};
use fuyu_physics::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleWorkspace,
};
use fuyu_physics::dynamics::{IntegrationMethod, Workspace};
use nalgebra::{DVector, Vector3};

use super::{regulate, regulator};
use crate::support::{
    POSTURES, Random, efforts, mounts, servicer, servicer_with_wheels, servicer_with_wheels_of,
};

// A second formulation: positions and rotations of all bodies a short time apart, from kinematics alone.
#[test]
fn the_arm_momentum_is_that_of_its_bodies() {
    let (model, system) = (servicer(), servicer_with_wheels(0.4));
    let mut arm = ArmMomentum::new(&system);
    let mut random = Random::new(5);
    for _ in 0..10 {
        let q = DVector::from_fn(6, |_, _| 2.0 * random.number());
        let qd = DVector::from_fn(6, |_, _| random.number());
        let found = arm.angular_momentum(q.as_slice(), qd.as_slice());
        let poses = |t: f64| {
            let mut workspace = Workspace::new(&model);
            workspace.set_positions(&(&q + &qd * t));
            let bodies = model.bodies().iter();
            let frames = bodies.map(|b| workspace.X_BF(model.frame(&b.name).unwrap()));
            frames.collect::<Vec<_>>()
        };
        let h = 1e-5;
        let (before, now, after) = (poses(-h), poses(0.0), poses(h));
        // Panels of 48 kg, whose centres are 4 m from their mounts, do not move.
        let (mut mass, mut first) = (96.0, Vector3::zeros());
        for (_, X) in mounts(0.4) {
            first += (X * nalgebra::Point3::new(4.0, 0.0, 0.0)).coords * 48.0;
        }
        let mut about_base = Vector3::zeros();
        let mut momentum = Vector3::zeros();
        for (i, body) in model.bodies().iter().enumerate() {
            let com = |X: &fuyu_physics::spatial::Pose| {
                (X * nalgebra::Point3::from(body.inertia.com)).coords
            };
            let (r, m) = (com(&now[i]), body.inertia.mass);
            let v = (com(&after[i]) - com(&before[i])) / (2.0 * h);
            let turn = after[i].rotation.matrix() * before[i].rotation.matrix().transpose();
            let skew = (turn - turn.transpose()) / (4.0 * h);
            let w = Vector3::new(skew[(2, 1)], skew[(0, 2)], skew[(1, 0)]);
            let R = now[i].rotation.matrix();
            let I = R * body.inertia.about_com * R.transpose();
            about_base += r.cross(&v) * m + I * w;
            momentum += v * m;
            first += r * m;
            mass += m;
        }
        let expected = about_base - (first / mass).cross(&momentum);
        let error = (found - expected).norm() / expected.norm();
        assert!(error < 1e-8, "{error:e}");
        assert!((arm.p_BC() - first / mass).norm() < 1e-12);
    }
}

/// Largest turn of the base \[rad\] within 30 s while the arm is driven as in the fixture of the hold, and at the end
/// the momentum of the wheels, that of the arm and that of everything.
fn turn_while_the_arm_moves(feed_forward: bool) -> (f64, Vector3<f64>, Vector3<f64>) {
    let system = servicer_with_wheels_of(0.0, 20.0);
    let mut state = FlexibleState::at_rest_with(&system, &DVector::from_row_slice(&POSTURES[1].1));
    let mut workspace = FlexibleWorkspace::new(&system);
    workspace.set_state(&state);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
    let config = RegulatorConfig {
        feed_forward,
        gyroscopic: false,
        ..RegulatorConfig::new(0.1)
    };
    let mut regulator = regulator(&system, config);
    let mut largest = 0.0_f64;
    for _ in 0..300 {
        let report = regulate(&mut regulator, &state, &workspace);
        assert_eq!(report.wheels.saturated, 0);
        let torques = regulator.wheel_torques();
        let mut forcing = |t: f64, s: &FlexibleState, input: &mut FlexibleInput| {
            efforts(0.3, t, s.tree.qd.as_slice(), &mut input.tree.efforts);
            input.wheel_torques.copy_from_slice(torques);
        };
        integrator.steps(&mut state, &mut workspace, 0.02, 5, &mut forcing);
        largest = largest.max(state.tree.R_WB.angle());
    }
    let arm = ArmMomentum::new(&system)
        .angular_momentum(state.tree.q.as_slice(), state.tree.qd.as_slice());
    (largest, workspace.wheel_momentum(&state), arm)
}

// The law alone lets the base turn until its feedback balances the arm. With feed-forward little is left: what the
// arm's accelerations change within a period, and the panels. At the end the wheels have what the arm has, with the
// opposite sign, up to the momentum of the base's slow rotation.
#[test]
fn feed_forward_keeps_the_base_still() {
    let (alone, _, _) = turn_while_the_arm_moves(false);
    let (with, wheels, arm) = turn_while_the_arm_moves(true);
    println!(
        "largest turn {:.4} deg without, {:.4} with feed-forward",
        alone.to_degrees(),
        with.to_degrees()
    );
    println!(
        "wheels {:?}, arm {:?} N m s",
        wheels.as_slice(),
        arm.as_slice()
    );
    assert!(with < 0.06 * alone, "{with} {alone}");
    assert!((wheels + arm).norm() < 0.05 * arm.norm(), "{wheels} {arm}");
}
