//! Thrusters change momentum by their impulse, and nothing else does.

use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    FlexibleError, FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleSystem,
    FlexibleWorkspace, Thruster,
};
use fuyu_physics::spatial::{Pose, Twist};
use nalgebra::{DVector, Unit, Vector3};

use crate::support::{POSTURES, panel, servicer, with_panels};

fn robot(min_on_time: f64) -> FlexibleSystem {
    let model = servicer();
    let base = model.frame("base_link").unwrap();
    let thruster = |name: &str, position, direction: Vector3<f64>| Thruster {
        name: name.to_owned(),
        position,
        direction: Unit::new_normalize(direction),
        thrust: 20.0,
        min_on_time,
    };
    with_panels(&model, &panel(false), 0.6)
        .thruster(
            base,
            thruster(
                "t1",
                Vector3::new(1.0, -0.5, 0.7),
                Vector3::new(0.0, 1.0, 0.2),
            ),
        )
        .thruster(
            base,
            thruster("t2", Vector3::new(-1.0, 0.5, 0.0), Vector3::x()),
        )
        .build()
        .unwrap()
}

fn free(_: f64, _: &FlexibleState, _: &mut FlexibleInput) {}

// A base that does not turn: the change is thrust times on-time, although no step ends when the valve closes. Cutting a
// pulse at a step's end instead would leave an error of up to a step, 10 %.
#[test]
fn a_pulse_changes_momentum_by_its_impulse() {
    let system = robot(0.0);
    for duration in [0.001, 0.0313, 0.1, 0.217] {
        let q = DVector::from_row_slice(&POSTURES[1].1);
        let mut state = FlexibleState::at_rest_with(&system, &q);
        let mut workspace = FlexibleWorkspace::new(&system);
        let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
        // Force and torque in inertial axes, by the trapezoidal rule of Romberg on the attitude of the run, a second
        // computation.
        let record = |step: f64| {
            let mut state = FlexibleState::at_rest_with(&system, &q);
            let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
            let mut workspace = FlexibleWorkspace::new(&system);
            state.fire(&system, 0, duration);
            workspace.set_state(&state);
            let thruster = &system.thrusters()[0];
            let mut values = Vec::new();
            let count = (duration / step).round() as usize;
            for i in 0..=count {
                let R_WB = state.tree.R_WB;
                let force = R_WB * *thruster.direction * thruster.thrust;
                let arm = R_WB * (thruster.position - workspace.p_BC());
                values.push((force, arm.cross(&force)));
                if i < count {
                    integrator.step(&mut state, &mut workspace, step, &mut free);
                }
            }
            values
        };
        // Boole's rule with 16 intervals.
        let step = duration / 16.0;
        let values = record(step);
        let (mut P, mut L) = (Vector3::zeros(), Vector3::zeros());
        for panel in 0..4 {
            for (k, weight) in [7.0, 32.0, 12.0, 32.0, 7.0].into_iter().enumerate() {
                let (force, torque) = values[4 * panel + k];
                P += force * (weight * 2.0 / 45.0 * step);
                L += torque * (weight * 2.0 / 45.0 * step);
            }
        }
        state.fire(&system, 0, duration);
        integrator.steps(&mut state, &mut workspace, 0.01, 30, &mut free);
        let momentum = state.tree.momentum_W;
        let errors = [(momentum.linear - P).norm(), (momentum.angular - L).norm()];
        println!("{duration} s: P {:.2e}, L {:.2e}", errors[0], errors[1]);
        assert!(
            errors[0] < 1e-12 && errors[1] < 1e-12,
            "{duration}: {errors:?}"
        );
        assert!((state.thruster_impulses()[0] - 20.0 * duration).abs() < 1e-13);
        assert!((momentum.linear.norm() - 20.0 * duration).abs() < 1e-3 * duration);
        assert_eq!(
            (state.thruster_impulses()[1], state.on_times()),
            (0.0, &[0.0, 0.0][..])
        );
        let carried = workspace.carried_momentum(&state);
        let expected = momentum.expressed_in(&state.tree.R_WB);
        assert!((carried.angular - expected.angular).norm() < 1e-12);
    }
}

// A valve that cannot be open for less than .2 s; two thrusters at once; a command that closes.
#[test]
fn short_commands_last_the_shortest_on_time() {
    let system = robot(0.2);
    let mut state = FlexibleState::at_rest(&system);
    let mut workspace = FlexibleWorkspace::new(&system);
    let V = Twist::new(Vector3::new(0.02, -0.01, 0.03), Vector3::zeros());
    state.set_base(&mut workspace, &Pose::identity(), &V);
    let before = state.tree.momentum_W.linear;
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
    state.fire(&system, 0, 1e-3);
    state.fire(&system, 1, 5.0);
    integrator.steps(&mut state, &mut workspace, 0.01, 30, &mut free);
    state.fire(&system, 1, 0.0);
    let after = state.tree.momentum_W;
    integrator.steps(&mut state, &mut workspace, 0.01, 30, &mut free);
    assert_eq!(state.tree.momentum_W, after);
    let impulses = state.thruster_impulses();
    assert!((impulses[0] - 4.0).abs() < 1e-12 && (impulses[1] - 6.0).abs() < 1e-12);
    // A command that closes the valve too early, or a shorter one, lets it stay open for the shortest on-time.
    for (second, expected) in [(0.0, 4.0), (0.01, 4.0), (0.3, 20.0 * 0.35)] {
        let given = state.thruster_impulses()[0];
        state.fire(&system, 0, 1.0);
        integrator.steps(&mut state, &mut workspace, 0.01, 5, &mut free);
        state.fire(&system, 0, second);
        integrator.steps(&mut state, &mut workspace, 0.01, 60, &mut free);
        let pulse = state.thruster_impulses()[0] - given;
        assert!((pulse - expected).abs() < 1e-12, "{second}: {pulse}");
    }
    let gained = (state.tree.momentum_W.linear - before).norm();
    assert!(gained > 6.0 && gained < 25.0, "{gained}");
    // The energy balance includes the thrusters' work.
    let energy = workspace.kinetic_energy(&state) + workspace.strain_energy(&state);
    let mut at_start = FlexibleState::at_rest(&system);
    at_start.set_base(&mut workspace, &Pose::identity(), &V);
    workspace.set_state(&at_start);
    let start = workspace.kinetic_energy(&at_start);
    let balance = energy - start - state.tree.work + state.losses().total();
    assert!(balance.abs() < 1e-6, "{balance:e}");
}

#[test]
fn impossible_thrusters_are_rejected() {
    let model = servicer();
    let base = model.frame("base_link").unwrap();
    let mut thruster = Thruster {
        name: "t1".to_owned(),
        position: Vector3::zeros(),
        direction: Vector3::x_axis(),
        thrust: -1.0,
        min_on_time: 0.0,
    };
    let build = |t: &Thruster| {
        FlexibleSystem::builder(&model)
            .thruster(base, t.clone())
            .build()
    };
    let error = build(&thruster).unwrap_err();
    assert_eq!(
        error.to_string(),
        "thruster t1, thrust [N] is -1; it must be positive"
    );
    thruster.thrust = 1.0;
    thruster.min_on_time = f64::NAN;
    assert!(matches!(build(&thruster), Err(FlexibleError::Value { .. })));
}
