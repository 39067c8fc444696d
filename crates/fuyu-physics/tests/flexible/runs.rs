//! Runs of 30 s of the servicer with two panels, sampled each second.

use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    AdaptiveIntegrator, FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleSystem,
    FlexibleWorkspace, Tolerance,
};
use serde_json::Value;

use crate::support::{
    attitude_error, difference, efforts, fixture, locked_servicer, numbers, panel, sample,
    servicer_with_panels, servicer_with_wheels, vector, with_panels,
};

/// Largest differences of a run from the fixture.
#[derive(Debug, Default)]
struct Worst {
    attitude: f64,
    joints: f64,
    modes: f64,
    position: f64,
    energy: f64,
    balance: f64,
    momentum: f64,
    wheels: f64,
}

/// Follows a run and compares every sample. `advance` steps by a second.
fn follow(
    system: &FlexibleSystem,
    run: &Value,
    mut advance: impl FnMut(&mut FlexibleState, &mut FlexibleWorkspace),
) -> Worst {
    let mut state = sample(system, run, 0);
    let mut workspace = FlexibleWorkspace::new(system);
    workspace.set_state(&state);
    let energy =
        |w: &FlexibleWorkspace, s: &FlexibleState| (w.kinetic_energy(s), w.strain_energy(s));
    let (T, V) = energy(&workspace, &state);
    let start = T + V;
    let mut worst = Worst::default();
    let take = |place: &mut f64, value: f64| *place = place.max(value);
    for i in 1..run["t"].as_array().unwrap().len() {
        advance(&mut state, &mut workspace);
        let at = |name: &str| numbers(&run[name][i]);
        take(
            &mut worst.attitude,
            attitude_error(&state, &run["base_quaternion_xyzw"][i]),
        );
        if !state.tree.q.is_empty() {
            take(
                &mut worst.joints,
                difference(state.tree.q.as_slice(), &at("q")),
            );
        }
        take(&mut worst.modes, difference(state.mu(), &at("mu")));
        let p = workspace.X_WB(&state).translation.vector;
        take(
            &mut worst.position,
            (p - vector(&run["base_position"][i])).norm(),
        );
        let (T, V) = energy(&workspace, &state);
        take(
            &mut worst.energy,
            (T - run["kinetic"][i].as_f64().unwrap()).abs(),
        );
        take(
            &mut worst.energy,
            (V - run["strain"][i].as_f64().unwrap()).abs(),
        );
        let balance = T + V - start - state.tree.work + state.losses().total();
        take(&mut worst.balance, balance.abs());
        let expected = vector(&run["L_com"][i]);
        take(
            &mut worst.momentum,
            (state.tree.momentum_W.angular - expected).norm(),
        );
        let carried = workspace.carried_momentum(&state);
        let momentum = state.tree.momentum_W.expressed_in(&state.tree.R_WB);
        take(
            &mut worst.momentum,
            (carried.angular - momentum.angular).norm(),
        );
        take(
            &mut worst.momentum,
            (carried.linear - momentum.linear).norm(),
        );
        if !run["wheel_speed_relative"].is_null() {
            let speeds = at("wheel_speed_relative");
            take(&mut worst.wheels, difference(state.wheel_speeds(), &speeds));
            take(
                &mut worst.wheels,
                difference(state.wheel_angles(), &at("wheel_angle")),
            );
        }
    }
    worst
}

fn slew(t: f64, state: &FlexibleState, input: &mut FlexibleInput) {
    efforts(1.0, t, state.tree.qd.as_slice(), &mut input.tree.efforts);
}

fn damped(_: f64, state: &FlexibleState, input: &mut FlexibleInput) {
    efforts(0.0, 0.0, state.tree.qd.as_slice(), &mut input.tree.efforts);
}

// The arm excites the panels: classical Runge-Kutta at 5 ms. The fixture's error is about 1e-12. Without the coupling
// of the modes to the base's rotation the panels do not move at all.
#[test]
fn an_arm_that_moves_excites_the_panels() {
    let (system, runs) = (servicer_with_panels(0.0), fixture("flexible_panels_runs"));
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
    let worst = follow(&system, &runs["a_slew"], |state, workspace| {
        integrator.steps(state, workspace, 0.005, 200, &mut slew);
    });
    println!("{worst:?}");
    assert!(worst.attitude < 1e-10 && worst.joints < 1e-10, "{worst:?}");
    assert!(worst.modes < 1e-9 && worst.position < 1e-10, "{worst:?}");
    // Kinetic and strain energy are work less what damping took.
    assert!(worst.balance < 1e-9 && worst.energy < 1e-9, "{worst:?}");
    assert!(worst.momentum < 1e-12, "{worst:?}");
}

// Angular momentum of 400 N m s and free joints: the convective terms matter.
#[test]
fn a_tumbling_robot_with_deformed_panels() {
    let (system, runs) = (servicer_with_panels(0.6), fixture("flexible_panels_runs"));
    let run = &runs["d_tumble"];
    let mut integrator = AdaptiveIntegrator::new(&system, Tolerance::default());
    let mut steps = 0;
    let worst = follow(&system, run, |state, workspace| {
        steps += integrator
            .advance(state, workspace, 1.0, &mut damped)
            .unwrap();
    });
    println!("{steps} steps, {worst:?}");
    assert!(worst.attitude < 1e-8 && worst.joints < 1e-8, "{worst:?}");
    assert!(worst.modes < 1e-6, "{worst:?}");
    assert!(worst.momentum < 1e-11 && worst.balance < 1e-7, "{worst:?}");
    // A fixed step of the method of order 8 agrees.
    let mut fixed = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
    let worst = follow(&system, run, |state, workspace| {
        fixed.steps(state, workspace, 0.02, 50, &mut damped);
    });
    println!("fixed step: {worst:?}");
    assert!(worst.attitude < 1e-8 && worst.modes < 1e-6, "{worst:?}");
}

// Joints locked, released with deformed panels and without momentum.
#[test]
fn panels_that_are_released_shake_a_robot_with_locked_joints() {
    let runs = fixture("flexible_panels_runs");
    let run = &runs["c_free"];
    let model = locked_servicer(&numbers(&run["q"][0]));
    let system = with_panels(&model, &panel(false), 0.0).build().unwrap();
    let mut integrator = AdaptiveIntegrator::new(&system, Tolerance::default());
    let worst = follow(&system, run, |state, workspace| {
        integrator
            .advance(state, workspace, 1.0, &mut damped)
            .unwrap();
    });
    println!("{worst:?}");
    assert!(worst.attitude < 1e-8 && worst.modes < 1e-6, "{worst:?}");
    assert!(worst.position < 1e-8 && worst.balance < 1e-9, "{worst:?}");
}

// Torques on wheels and joints: 19 N m s in the wheels, and none outside.
#[test]
fn wheels_that_are_driven_turn_the_base() {
    let (system, run) = (servicer_with_wheels(0.0), fixture("flexible_wheel_run"));
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
    let mut drive = |t: f64, state: &FlexibleState, input: &mut FlexibleInput| {
        efforts(0.3, t, state.tree.qd.as_slice(), &mut input.tree.efforts);
        let wave = |period: f64| (std::f64::consts::TAU * t / period).sin();
        input.wheel_torques[0] = -0.8 * wave(30.0);
        input.wheel_torques[1] = 0.5 * wave(20.0);
        input.wheel_torques[2] = -2.0 * wave(30.0);
    };
    let mut state = sample(&system, &run, 0);
    let worst = follow(&system, &run, |s, workspace| {
        integrator.steps(s, workspace, 0.02, 50, &mut drive);
        state.copy_from(s);
    });
    let mut workspace = FlexibleWorkspace::new(&system);
    workspace.set_state(&state);
    let h = workspace.wheel_momentum(&state);
    println!("{worst:?}, {h:?}");
    assert!(worst.attitude < 1e-8 && worst.wheels < 1e-6, "{worst:?}");
    assert!(worst.modes < 1e-8 && worst.joints < 1e-8, "{worst:?}");
    assert!(worst.momentum < 1e-12 && worst.balance < 1e-9, "{worst:?}");
    let last = run["t"].as_array().unwrap().len() - 1;
    let expected = vector(&run["h_relative_base_axes"][last]);
    assert!((h - expected).norm() < 1e-7, "{h:?} {expected:?}");
}

// Backwards under the same efforts and wheel torques: the state of a second before, up to the error of the method.
#[test]
fn steps_back_in_time_undo_steps() {
    let system = servicer_with_wheels(0.6);
    let mut random = crate::support::Random::new(41);
    let start = random.state(&system, 0.2);
    let mut state = start.clone();
    let mut workspace = FlexibleWorkspace::new(&system);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
    let mut push = |t: f64, _: &FlexibleState, input: &mut FlexibleInput| {
        input.tree.efforts[0] = 0.5 * t.cos();
        input.wheel_torques[1] = (0.5 * t).sin();
    };
    integrator.steps(&mut state, &mut workspace, 0.01, 100, &mut push);
    let turned = state.tree.R_WB.angle_to(&start.tree.R_WB);
    assert!(turned > 0.05, "{turned}");
    integrator.steps(&mut state, &mut workspace, -0.01, 100, &mut push);
    let error = difference(state.tree.q.as_slice(), start.tree.q.as_slice())
        .max(difference(state.mu(), start.mu()))
        .max(difference(state.wheel_speeds(), start.wheel_speeds()))
        .max(state.tree.R_WB.angle_to(&start.tree.R_WB));
    println!("{error:e}");
    assert!(error < 1e-9 && state.tree.time.abs() < 1e-12, "{error:e}");
}

// Each state of a batch moves as it does alone, to the bit.
#[cfg(feature = "batch")]
#[test]
fn a_batch_moves_as_its_states_do() {
    use fuyu_physics::dynamics::flexible::FlexibleBatch;
    let system = servicer_with_wheels(0.6);
    let mut random = crate::support::Random::new(31);
    let states: Vec<_> = (0..5).map(|_| random.state(&system, 0.2)).collect();
    let push = |i: usize, t: f64, input: &mut FlexibleInput| {
        input.tree.efforts[0] = t * i as f64;
        input.wheel_torques[1] = 0.1 * i as f64;
    };
    let mut batch = FlexibleBatch::new(&system, states.clone(), IntegrationMethod::Rk4);
    batch.step(
        0.01,
        20,
        &|i, t, _: &FlexibleState, input: &mut FlexibleInput| push(i, t, input),
    );
    assert_eq!(batch.len(), 5);
    for (i, mut state) in states.into_iter().enumerate() {
        let mut workspace = FlexibleWorkspace::new(&system);
        let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
        let mut alone = |t: f64, _: &FlexibleState, input: &mut FlexibleInput| push(i, t, input);
        integrator.steps(&mut state, &mut workspace, 0.01, 20, &mut alone);
        assert_eq!(*batch.state(i), state);
        assert_eq!(batch.workspace(i).V_WB_B(), workspace.V_WB_B());
    }
}
