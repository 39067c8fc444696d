//! Warnings where first order does not suffice, and steps that are too long.

use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    ElasticJoint, FirstOrderQuantity, FlexibleError, FlexibleInput, FlexibleIntegrator,
    FlexibleState, FlexibleSystem, FlexibleWorkspace, LinearModel, RotorModel, Wheel,
};
use fuyu_physics::model::ModelBuilder;
use fuyu_physics::spatial::{Pose, RigidInertia, Twist};
use fuyu_structures::ElasticLink;
use nalgebra::{DVector, Matrix3, Vector3};

use crate::support::{panel, servicer, servicer_with_panels, with_panels};

/// The warning at an angular velocity and a modal coordinate b1 of the first panel.
fn warning(system: &FlexibleSystem, w: f64, mu: f64) -> Option<(FirstOrderQuantity, String)> {
    let mut state = FlexibleState::at_rest(system);
    state.mu_mut()[0] = mu;
    let mut workspace = FlexibleWorkspace::new(system);
    let V = Twist::new(Vector3::y() * w, Vector3::zeros());
    state.set_base(&mut workspace, &Pose::identity(), &V);
    workspace.set_state(&state);
    let excess = workspace.first_order_excess(&state)?;
    Some((excess.quantity, excess.to_string()))
}

// The first frequency is 1.2284 rad/s, the tip 8 m from the root; b1 moves the tip by .2887 m per unit.
#[test]
fn motion_beyond_first_order_is_reported() {
    let system = servicer_with_panels(0.0);
    assert_eq!(warning(&system, 0.12, 0.8), None);
    let (quantity, text) = warning(&system, 0.13, 0.0).unwrap();
    assert_eq!(quantity, FirstOrderQuantity::Rate);
    assert_eq!(
        text,
        "solar_plus turns at 0.1300 rad/s; first-order modes suffice up to 0.1228 rad/s: set second_order"
    );
    let (quantity, text) = warning(&system, 0.0, 0.9).unwrap();
    assert_eq!(quantity, FirstOrderQuantity::Deflection);
    assert!(
        text.starts_with("solar_plus is deflected by 0.2598 m; "),
        "{text}"
    );
    let second = with_panels(&servicer(), &panel(true), 0.0).build().unwrap();
    assert_eq!(warning(&second, 0.5, 2.0), None);
}

// An arm's load lowers the frequencies of its links: those of link2 alone begin at 28 Hz. The limit is compared with
// the linear model, whose mass matrix comes from momenta. Would break if the unloaded link's frequency were used.
#[test]
fn the_limit_of_an_elastic_link_is_that_of_the_loaded_one() {
    let model = servicer();
    let link = ElasticLink {
        length: 2.5,
        mass_per_length: 20.0,
        EI: [2e5, 2e5],
        radius_of_gyration: 0.07,
        fixed_interface_modes: 1,
        elements: 8,
        damping_time: 0.0,
        second_order: false,
    };
    let body = link.appendage("link2").unwrap();
    let alone = body.frequencies().unwrap()[0];
    let system = FlexibleSystem::builder(&model)
        .elastic_link("link2", Pose::identity(), body, 0)
        .build()
        .unwrap();
    let q = DVector::from_row_slice(&[0.3, 0.8, -1.4, 0.6, 0.4, 0.0]);
    let linear = LinearModel::new(&system, &q);
    let modes = linear.base_and_modes().split_off(6);
    let loaded = linear.frequencies_hz(&modes).unwrap()[0] * std::f64::consts::TAU;
    assert!(loaded < 0.5 * alone, "{loaded} {alone}");
    let limit_at = |w: f64| {
        let mut state = FlexibleState::at_rest_with(&system, &q);
        let mut workspace = FlexibleWorkspace::new(&system);
        let V = Twist::new(Vector3::y() * w, Vector3::zeros());
        state.set_base(&mut workspace, &Pose::identity(), &V);
        workspace.set_state(&state);
        let excess = workspace.first_order_excess(&state);
        excess.map(|excess| (excess.quantity, excess.limit))
    };
    assert_eq!(limit_at(0.099 * loaded), None);
    let (quantity, limit) = limit_at(0.101 * loaded).unwrap();
    assert_eq!(quantity, FirstOrderQuantity::Rate);
    assert!(
        (limit / (0.1 * loaded) - 1.0).abs() < 1e-9,
        "{limit} {loaded}"
    );
}

// Just below the limit the run stays bounded, just above it diverges: the limit is that of the method.
#[test]
fn steps_above_the_stability_limit_are_found() {
    let model = servicer();
    let joint = ElasticJoint {
        joint: "joint5".to_owned(),
        stiffness: 3e4,
        damping: 0.0,
        rotor_inertia: 5e-5,
        gear_ratio: 160.0,
        rotor: RotorModel::Full,
    };
    let system = FlexibleSystem::builder(&model)
        .elastic_joint(joint)
        .build()
        .unwrap();
    let q = DVector::zeros(6);
    for method in [IntegrationMethod::Rk4, IntegrationMethod::Dop8] {
        let error = system.check_step(&q, method, 10.0).unwrap_err();
        let FlexibleError::Unstable {
            limit,
            part,
            frequency_hz,
            ..
        } = &error
        else {
            panic!("{error}")
        };
        assert_eq!(part, "joint5");
        println!("{method:?}: {frequency_hz} Hz, limit {limit} s; {error}");
        system.check_step(&q, method, 0.99 * limit).unwrap();
        for step in [f64::NAN, 0.0, -0.01, f64::INFINITY] {
            let refused = system.check_step(&q, method, step).unwrap_err().to_string();
            assert_eq!(refused, format!("step [s] is {step}; it must be positive"));
        }
        let run = |step: f64| {
            let mut state = FlexibleState::at_rest(&system);
            state.motor_angles_mut()[0] = 1e-3;
            let mut workspace = FlexibleWorkspace::new(&system);
            let mut integrator = FlexibleIntegrator::new(&system, method);
            let mut free = |_: f64, _: &FlexibleState, _: &mut FlexibleInput| {};
            let mut largest = 0.0_f64;
            for _ in 0..1000 {
                integrator.step(&mut state, &mut workspace, step, &mut free);
                let wind_up = (state.motor_angles()[0] - state.tree.q[4]).abs();
                largest = if wind_up.is_finite() {
                    largest.max(wind_up)
                } else {
                    f64::INFINITY
                };
            }
            largest
        };
        let (below, above) = (run(0.99 * limit), run(1.06 * limit));
        assert!(
            below < 2e-3 && above > 1.0,
            "{method:?}: {below:e} {above:e}"
        );
    }
}

#[test]
fn impossible_parts_are_rejected_with_the_reason() {
    let model = servicer();
    let joint = |name: &str, stiffness: f64| ElasticJoint {
        joint: name.to_owned(),
        stiffness,
        damping: 0.0,
        rotor_inertia: 1e-4,
        gear_ratio: 100.0,
        rotor: RotorModel::Full,
    };
    let build = |joint: ElasticJoint| FlexibleSystem::builder(&model).elastic_joint(joint).build();
    let message = |joint| build(joint).unwrap_err().to_string();
    assert_eq!(
        message(joint("joint2", -5.0)),
        "joint joint2, stiffness [N m/rad] is -5; it must be positive"
    );
    assert!(
        message(joint("elbow", 5.0))
            .starts_with("joint elbow: is not a joint of the robot; it must be one of joint1")
    );
    let link = ElasticLink {
        length: 2.5,
        mass_per_length: 20.0,
        EI: [2e5, 2e5],
        radius_of_gyration: 0.07,
        fixed_interface_modes: 0,
        elements: 8,
        damping_time: 0.0,
        second_order: false,
    };
    let body = link.appendage("arm").unwrap();
    let builder = FlexibleSystem::builder(&model);
    let on = |link: &str, section| {
        let builder = builder.clone();
        builder.elastic_link(link, Pose::identity(), body.clone(), section)
    };
    let message = |builder: fuyu_physics::dynamics::flexible::FlexibleBuilder| {
        builder.build().unwrap_err().to_string()
    };
    assert_eq!(
        message(on("link2", 7)),
        "arm: output point 7 does not exist; it has 1"
    );
    assert!(message(on("hand", 0)).starts_with("arm: link hand is not moved by a joint"));
    let full = on("link2", 0).elastic_joint(joint("joint3", 5.0));
    assert!(message(full).ends_with("use the reduced one"));
    let heavier = panel(false);
    let mass = heavier.invariants.mass();
    let other = FlexibleSystem::builder(&model).elastic_link("link2", Pose::identity(), heavier, 0);
    let said = message(other);
    assert!(
        said.contains(&format!("has {mass:.3} kg, but link link2 has ")),
        "{said}"
    );
    let mut foreign = model.frame("tool0").unwrap().clone();
    foreign.body = 3;
    let wheel = Wheel::new("x", Vector3::x_axis(), 0.1);
    assert_eq!(
        message(builder.clone().wheel(&foreign, wheel)),
        "wheel x: is on link tool0, which is a link of another robot than servicer"
    );
    // With half the modal mass the panels' first modes move 123 % of their mass: a light base does not have the rest.
    let mut half = panel(false);
    half.modal_mass *= 0.5;
    let on_base = |mass: f64| {
        let inertia = RigidInertia {
            mass,
            com: Vector3::zeros(),
            about_com: Matrix3::identity() * mass,
        };
        let base = ModelBuilder::new("base", "base_link", inertia).build();
        with_panels(&base, &half, 0.0)
    };
    assert!(
        message(on_base(5.0))
            .contains("the modes move more mass than the body and what carries it have")
    );
    on_base(5000.0).build().unwrap();
    let mut broken = panel(false);
    broken.modal_stiffness[(0, 0)] = -1.0;
    assert!(message(with_panels(&model, &broken, 0.0)).contains("positive definite"));
}

// Coulomb friction is smoothed below .1 rad/s: there a bearing of 1 N m damps a wheel of 1e-3 kg m² by 1e4 1/s.
#[test]
fn steep_friction_of_wheels_is_found() {
    let model = servicer();
    let base = model.frame("base_link").unwrap();
    let mut wheel = Wheel::new("x", Vector3::x_axis(), 1e-3);
    wheel.coulomb_friction = 1.0;
    let builder = FlexibleSystem::builder(&model).wheel(base, wheel);
    let system = builder.build().unwrap();
    let check = |step: f64| system.check_step(&DVector::zeros(6), IntegrationMethod::Rk4, step);
    check(2.7e-4).unwrap();
    let error = check(1e-3).unwrap_err();
    assert!(
        matches!(&error, FlexibleError::StiffDamping { part, rate, .. }
            if part == "wheel x" && (rate / 1e4 - 1.0).abs() < 1e-2),
        "{error}"
    );
}

// A damper of 1e5 N m s/rad on a light wrist decays far faster than a step of 5 ms can follow. Without the check the
// run diverges within a few steps.
#[test]
fn dampers_above_the_stability_limit_are_found() {
    let model = servicer();
    let with = |damping: f64| {
        let joint = ElasticJoint {
            joint: "joint6".to_owned(),
            stiffness: 50.0,
            damping,
            rotor_inertia: 1e-4,
            gear_ratio: 100.0,
            rotor: RotorModel::Reduced,
        };
        let builder = FlexibleSystem::builder(&model).elastic_joint(joint);
        builder.build().unwrap()
    };
    let q = DVector::zeros(6);
    with(0.01)
        .check_step(&q, IntegrationMethod::Rk4, 0.002)
        .unwrap();
    let system = with(1e5);
    let error = system
        .check_step(&q, IntegrationMethod::Rk4, 0.002)
        .unwrap_err();
    let FlexibleError::StiffDamping { part, limit, .. } = &error else {
        panic!("{error}")
    };
    assert_eq!(part, "joint6");
    assert!(error.to_string().contains("for the damping of joint6"));
    // The limit is the true one: free motion decays below it and grows above.
    let grows = |step: f64| {
        let mut state = FlexibleState::at_rest_with(&system, &q);
        state.motor_rates_mut()[0] = 1e-6;
        let mut workspace = FlexibleWorkspace::new(&system);
        let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
        let mut free = |_: f64, _: &FlexibleState, _: &mut FlexibleInput| {};
        integrator.steps(&mut state, &mut workspace, step, 200, &mut free);
        let rate = state.motor_rates()[0].abs();
        rate.is_nan() || rate >= 1e-6
    };
    assert!(!grows(0.97 * limit) && grows(1.05 * limit), "{error}");
}
