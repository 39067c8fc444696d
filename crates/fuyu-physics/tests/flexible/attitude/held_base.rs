//! The arm follows a goal while the wheels hold the base, compared with a base that floats freely.

use fuyu_physics::control::attitude::{RegulatorConfig, UnloadingConfig};
use fuyu_physics::control::prediction::Prediction;
use fuyu_physics::control::{
    Controller, ControllerConfig, Gains, LawKind, Measurement, Saturation, TipMeasurement,
};
use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleWorkspace,
};
use fuyu_physics::spatial::Pose;
use nalgebra::{DVector, Translation3, Vector3};

use super::{regulate, regulator};
use crate::support::{servicer, servicer_with_wheels_and_thrusters};

/// What holds the base.
#[derive(Clone, Copy, PartialEq)]
enum Base {
    Free,
    Held { feed_forward: bool },
}

/// What a run of 60 s was like.
#[derive(Debug)]
struct Outcome {
    /// Root mean square and final distance of the tip from its goal \[m\].
    tip: [f64; 2],
    /// Largest turn of the base \[rad\].
    turn: f64,
    /// Largest momentum \[N m s\] and torque \[N m\] of a wheel.
    wheels: [f64; 2],
    /// Largest deflection of a panel's tip \[m\].
    panel: f64,
    /// Impulse of the thrusters \[N s\].
    impulse: f64,
    samples: usize,
}

/// The tip follows a goal that moves 1.2 m in 40 s, with rest at both ends, and stands still for another 20 s. The
/// arm's controller is the same for either base: it sees tip and goal by a camera on the base, and a gyro.
fn run(base: Base) -> Outcome {
    let model = servicer();
    let system = servicer_with_wheels_and_thrusters();
    let tip = model.frame("tool0").unwrap().clone();
    let q = [80.0_f64, 90.0, -90.0, 0.0, 30.0, 0.0].map(f64::to_radians);
    let mut state = FlexibleState::at_rest_with(&system, &DVector::from_row_slice(&q));
    let mut workspace = FlexibleWorkspace::new(&system);
    workspace.set_state(&state);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
    let gains = Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: vec![400.0, 100.0, 200.0, 10.0, 2.0, 2.0],
        saturation: Saturation {
            position: 0.2,
            orientation: 0.1,
        },
    };
    let mut config = ControllerConfig::new(LawKind::StraightPath, gains);
    config.prediction = Prediction::Motion;
    let mut arm = Controller::new(model, tip.clone(), config).unwrap();
    let feed_forward = base == Base::Held { feed_forward: true };
    let config = RegulatorConfig {
        feed_forward,
        unloading: Some(UnloadingConfig {
            start: 0.12,
            stop: 0.04,
            time: 10.0,
        }),
        ..RegulatorConfig::new(0.1)
    };
    let mut regulator = regulator(&system, config);
    let start = workspace.X_WB(&state) * workspace.X_BF(&tip);
    let goal = |t: f64| -> Pose {
        let s = (t / 40.0).min(1.0);
        let way = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
        Translation3::from(Vector3::new(-1.0, -0.6, 0.3) * way) * start
    };
    let mut out = Outcome {
        tip: [0.0; 2],
        turn: 0.0,
        wheels: [0.0; 2],
        panel: 0.0,
        impulse: 0.0,
        samples: 0,
    };
    let mut torques = vec![0.0; 3];
    for k in 0..6000 {
        let time = f64::from(k) * 0.01;
        let X_WB = workspace.X_WB(&state);
        let w_WB_B = workspace.V_WB_B().angular;
        if base != Base::Free && k % 10 == 0 {
            let report = regulate(&mut regulator, &state, &workspace);
            assert_eq!(report.wheels.saturated, 0);
            torques.copy_from_slice(regulator.wheel_torques());
            for (i, time) in regulator.on_times().iter().enumerate() {
                state.fire(&system, i, *time);
            }
        }
        let X_BE = workspace.X_BF(&tip);
        let X_BD = X_WB.inverse() * goal(time);
        let seen = TipMeasurement::new(time, X_BE, X_BD);
        let measurement = Measurement::new(time, &state.tree.q, &state.tree.qd);
        let measurement = measurement.with_tip(Some(&seen)).with_gyro(Some(&w_WB_B));
        arm.update(&measurement).unwrap();
        let efforts = arm.efforts();
        let mut forcing = |_: f64, _: &FlexibleState, input: &mut FlexibleInput| {
            input.tree.efforts.copy_from(efforts);
            input.wheel_torques.copy_from_slice(&torques);
        };
        integrator.step(&mut state, &mut workspace, 0.01, &mut forcing);
        let error = (X_BE.inverse() * X_BD).translation.vector.norm();
        out.tip = [out.tip[0] + error * error, error];
        out.turn = out.turn.max(state.tree.R_WB.angle());
        for (i, speed) in state.wheel_speeds().iter().enumerate() {
            out.wheels[0] = out.wheels[0].max(0.2 * speed.abs());
            out.wheels[1] = out.wheels[1].max(torques[i].abs());
        }
        for panel in 0..2 {
            out.panel = out.panel.max(workspace.deflection(&state, panel, 0).norm());
        }
        out.samples += 1;
    }
    out.tip[0] = (out.tip[0] / out.samples as f64).sqrt();
    out.impulse = state.thruster_impulses().iter().sum();
    // Wheels and arm have what the thrusters gave, and the base's rotation next to nothing.
    assert!(state.is_finite());
    out
}

#[test]
fn wheels_hold_the_base_while_the_tip_tracks() {
    let free = run(Base::Free);
    let held = run(Base::Held { feed_forward: true });
    let feedback = run(Base::Held {
        feed_forward: false,
    });
    for (name, run) in [
        ("free", &free),
        ("held", &held),
        ("feedback only", &feedback),
    ] {
        println!(
            "{name}: tip rms {:.2} mm, final {:.2} mm; base {:.4} deg; wheels {:.2} N m s, {:.3} N m; panel {:.2} mm; {:.2} N s",
            run.tip[0] * 1e3,
            run.tip[1] * 1e3,
            run.turn.to_degrees(),
            run.wheels[0],
            run.wheels[1],
            run.panel * 1e3,
            run.impulse
        );
    }
    // The arm's controller does not depend on what the base does; the tip follows as well either way.
    assert!(free.tip[0] < 5e-3 && held.tip[0] < 5e-3 && held.tip[1] < 3e-3);
    // Held without feed-forward, the base turns an eighteenth; with it, a thousandth.
    assert!(free.turn > 5f64.to_radians());
    assert!(feedback.turn < 0.1 * free.turn && held.turn < 0.01 * free.turn);
    // A base that does not turn does not shake its panels.
    assert!(held.panel < 0.3 * free.panel && feedback.panel < free.panel);
    // The wheels take what the arm has; it gives it back when it stops, so no thruster has to fire.
    assert!(held.wheels[0] > 5.0 && held.wheels[0] < 10.0);
    assert_eq!([free.impulse, held.impulse, feedback.impulse], [0.0; 3]);
    // Its wheels turn freely, and stay behind the base by what their inertia is.
    assert!(free.wheels[0] < 2e-3 && free.wheels[1] == 0.0);
}
