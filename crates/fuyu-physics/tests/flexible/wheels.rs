//! Limits and friction of reaction wheels.

use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    AdaptiveIntegrator, FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleSystem,
    FlexibleWorkspace, Tolerance, Wheel,
};
use fuyu_physics::model::ModelBuilder;
use fuyu_physics::spatial::RigidInertia;
use nalgebra::{Matrix3, Vector3};

/// A rigid body with a moment of inertia of 10 kg m² and one wheel about z.
fn satellite(change: impl FnOnce(&mut Wheel)) -> FlexibleSystem {
    let inertia = RigidInertia {
        mass: 50.0,
        com: Vector3::zeros(),
        about_com: Matrix3::identity() * 10.0,
    };
    let model = ModelBuilder::new("satellite", "base_link", inertia).build();
    let mut wheel = Wheel::new("z", Vector3::z_axis(), 0.2);
    change(&mut wheel);
    let base = model.frame("base_link").unwrap();
    FlexibleSystem::builder(&model)
        .wheel(base, wheel)
        .build()
        .unwrap()
}

fn run(system: &FlexibleSystem, torque: f64, steps: usize) -> (FlexibleState, FlexibleWorkspace) {
    let mut state = FlexibleState::at_rest(system);
    let mut workspace = FlexibleWorkspace::new(system);
    let mut integrator = FlexibleIntegrator::new(system, IntegrationMethod::Rk4);
    let mut drive = |_: f64, _: &FlexibleState, i: &mut FlexibleInput| i.wheel_torques[0] = torque;
    integrator.steps(&mut state, &mut workspace, 0.1, steps, &mut drive);
    (state, workspace)
}

// In one axis: J_w (Ω' + w') = τ and (J - J_w) w' = -τ, so that Ω = τ t (1/J_w + 1/(J - J_w)) and J w + J_w Ω = 0.
#[test]
fn a_wheel_obeys_the_closed_form_until_its_limits() {
    let (state, workspace) = run(&satellite(|_| {}), 0.5, 40);
    let speed = 0.5 * 4.0 * (1.0 / 0.2 + 1.0 / 9.8);
    assert!((state.wheel_speeds()[0] - speed).abs() < 1e-12);
    let w = workspace.V_WB_B().angular.z;
    assert!((w + 0.2 * speed / 10.0).abs() < 1e-14);
    // The torque limit.
    let (limited, _) = run(&satellite(|w| w.max_torque = 0.25), 3.0, 40);
    assert!((limited.wheel_speeds()[0] - speed / 2.0).abs() < 1e-12);
    // The momentum limit: reached, not passed, from both sides.
    for torque in [0.5, -0.5] {
        let (full, workspace) = run(&satellite(|w| w.max_momentum = 1.5), torque, 200);
        let h = 0.2 * full.wheel_speeds()[0];
        assert!(h.abs() <= 1.5 * 1.002 && h.abs() > 1.499, "{h}");
        assert!((h - 1.5 * torque.signum()).abs() < 3e-3);
        assert!(workspace.carried_momentum(&full).angular.norm() < 1e-13);
        // The motor does no more work at the limit, and energy balances.
        let balance = workspace.kinetic_energy(&full) - full.tree.work;
        assert!(balance.abs() < 1e-12, "{balance:e}");
    }
    let (full, _) = run(&satellite(|w| w.max_speed = 5.0), 0.5, 200);
    assert!((full.wheel_speeds()[0] - 5.0).abs() < 0.02);
}

// The wheel has its full torque until it is at its limit, 2.94 s after the start, and the base turns on at a constant
// rate. Would break if a step held a smaller torque for longer: the error estimate does not see that.
#[test]
fn adaptive_steps_end_where_a_wheel_meets_its_limit() {
    let system = satellite(|w| w.max_momentum = 1.5);
    let mut state = FlexibleState::at_rest(&system);
    let mut workspace = FlexibleWorkspace::new(&system);
    let mut integrator = AdaptiveIntegrator::new(&system, Tolerance::default());
    let mut drive = |_: f64, _: &FlexibleState, i: &mut FlexibleInput| i.wheel_torques[0] = 0.5;
    integrator
        .advance(&mut state, &mut workspace, 20.0, &mut drive)
        .unwrap();
    assert!((state.wheel_speeds()[0] - 7.5).abs() < 1e-7);
    let until = 7.5 / (0.5 * (1.0 / 0.2 + 1.0 / 9.8));
    let angle = -0.15 * (20.0 - 0.5 * until);
    let found = state.tree.R_WB.scaled_axis().z;
    assert!((found - angle).abs() < 1e-8, "{found} {angle}");
}

// Viscous friction alone: the wheel slows down exponentially, Ω' = -c Ω (1/J_w + 1/(J - J_w)), and what it loses is
// dissipated.
#[test]
fn friction_dissipates_and_conserves_momentum() {
    let system = satellite(|w| w.viscous_friction = 0.05);
    let mut state = FlexibleState::at_rest(&system);
    state.wheel_speeds_mut()[0] = 30.0;
    let mut workspace = FlexibleWorkspace::new(&system);
    let identity = fuyu_physics::spatial::Pose::identity();
    state.set_base(
        &mut workspace,
        &identity,
        &fuyu_physics::spatial::Twist::ZERO,
    );
    workspace.set_state(&state);
    let (before, start) = (state.tree.momentum_W, workspace.kinetic_energy(&state));
    assert!((before.angular.z - 6.0).abs() < 1e-12);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
    let mut free = |_: f64, _: &FlexibleState, _: &mut FlexibleInput| {};
    integrator.steps(&mut state, &mut workspace, 0.05, 100, &mut free);
    let expected = 30.0 * f64::exp(-0.05 * 5.0 * (1.0 / 0.2 + 1.0 / 9.8));
    assert!((state.wheel_speeds()[0] - expected).abs() < 1e-9);
    assert_eq!(state.tree.momentum_W, before);
    let lost = start - workspace.kinetic_energy(&state);
    assert!(lost > 10.0 && (lost - state.losses().wheel_friction).abs() < 1e-9);
    assert_eq!(state.tree.work, 0.0);
    // Coulomb friction stops it and leaves no vibration.
    let system = satellite(|w| w.coulomb_friction = 0.1);
    let mut state = FlexibleState::at_rest(&system);
    state.wheel_speeds_mut()[0] = 3.0;
    let mut workspace = FlexibleWorkspace::new(&system);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
    integrator.steps(&mut state, &mut workspace, 0.05, 600, &mut free);
    assert!(
        state.wheel_speeds()[0].abs() < 1e-6,
        "{:?}",
        state.wheel_speeds()
    );
}

#[test]
fn impossible_wheels_are_rejected() {
    let model = satellite(|_| {}).model().clone();
    let base = model.frame("base_link").unwrap();
    let build = |wheel: Wheel| FlexibleSystem::builder(&model).wheel(base, wheel).build();
    let error = build(Wheel::new("z", Vector3::z_axis(), 0.0)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "wheel z, inertia [kg m²] is 0; it must be positive"
    );
    // The base's inertia contains the wheel.
    let error = build(Wheel::new("z", Vector3::z_axis(), 11.0)).unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("link base_link, least moment of inertia without its wheels"),
        "{error}"
    );
    let wheel = Wheel::new("z", Vector3::z_axis(), 0.1);
    let twice = FlexibleSystem::builder(&model)
        .wheel(base, wheel.clone())
        .wheel(base, wheel);
    assert_eq!(
        twice.build().unwrap_err().to_string(),
        "z: the name is used twice"
    );
}
