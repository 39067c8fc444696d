//! Momentum and energy: nothing inside changes the one, and the other balances, at any state of any robot.

use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    Accelerations, ElasticJoint, FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleSystem,
    FlexibleWorkspace, RotorModel, Wheel,
};
use fuyu_physics::spatial::{Pose, Wrench};
use fuyu_structures::{Beam, Boom, ElasticLink};
use nalgebra::{Rotation3, Translation3, Vector3};

use crate::support::{
    Random, panel, servicer, servicer_with_panels, servicer_with_wheels, with_panels,
};

/// The servicer with panels, a boom on link 3, elastic joints, wheels; optionally an elastic link 2.
pub fn everything(second_order: bool, elastic_link: bool) -> FlexibleSystem {
    let model = servicer();
    let frame = |name: &str| model.frame(name).unwrap().clone();
    let mut builder = with_panels(&model, &panel(second_order), 0.6);
    let beam = |EI| Beam::uniform(2.0, 1.5, EI, 6);
    let boom = Boom {
        along_y: beam(300.0),
        along_z: beam(200.0),
        modes: [2, 2],
        damping: 0.01,
        second_order,
    };
    let mount = Pose::from_parts(
        Translation3::new(1.0, 0.1, -0.2),
        Rotation3::from_euler_angles(0.5, -0.4, 1.2),
    );
    let on = if elastic_link { "link1" } else { "link3" };
    builder = builder.appendage(&frame(on), mount, boom.appendage("boom").unwrap());
    if elastic_link {
        for name in ["link2", "link3"] {
            let link = ElasticLink {
                length: 2.5,
                mass_per_length: 20.0,
                EI: [2e5, 1.5e5],
                radius_of_gyration: 0.07071,
                fixed_interface_modes: 1,
                elements: 8,
                damping_time: 1e-3,
                second_order,
            };
            builder =
                builder.elastic_link(name, Pose::identity(), link.appendage(name).unwrap(), 0);
        }
    }
    for (name, rotor) in [
        ("joint1", RotorModel::Full),
        ("joint2", RotorModel::Full),
        ("joint5", RotorModel::Full),
    ] {
        builder = builder.elastic_joint(ElasticJoint {
            joint: name.to_owned(),
            stiffness: 3e3,
            damping: 4.0,
            rotor_inertia: 2e-4,
            gear_ratio: 160.0,
            rotor,
        });
    }
    let axis = nalgebra::Unit::new_normalize(Vector3::new(0.3, -0.8, 0.5));
    let mut skew = Wheel::new("skew", axis, 0.2);
    skew.viscous_friction = 1e-3;
    skew.coulomb_friction = 0.02;
    builder = builder.wheel(&frame("base_link"), skew);
    builder = builder.wheel(
        &frame("link1"),
        Wheel::new("small", Vector3::y_axis(), 0.01),
    );
    builder.build().unwrap()
}

fn systems() -> Vec<(&'static str, FlexibleSystem)> {
    vec![
        ("panels", servicer_with_panels(0.6)),
        ("wheels", servicer_with_wheels(0.3)),
        ("everything", everything(false, false)),
        ("everything, second order", everything(true, false)),
        ("elastic links", everything(false, true)),
        ("elastic links, second order", everything(true, true)),
    ]
}

fn random_input(random: &mut Random, system: &FlexibleSystem) -> FlexibleInput {
    let mut input = FlexibleInput::zero(system);
    input
        .tree
        .efforts
        .iter_mut()
        .for_each(|x| *x = 5.0 * random.number());
    input
        .wheel_torques
        .iter_mut()
        .for_each(|x| *x = random.number());
    input
}

// The rates of the carried momentum and of the energy along the accelerations, by differences of eighth order of states
// that move with them. A Coriolis term that is missing anywhere makes these as large as the term: 1e-2 and more.
// Wrenches act on the base or on link 3, also where this is elastic: one that acted on the link's root instead of the
// section, where its frames are, would leave 1e-6.
#[test]
fn momentum_and_energy_have_the_rates_of_what_acts() {
    let mut random = Random::new(11);
    for (name, system) in systems() {
        let mut worst = [0.0_f64; 3];
        for trial in 0..12 {
            let mut state = random.state(&system, 1.0);
            slow_down(&system, &mut state);
            let mut input = random_input(&mut random, &system);
            if trial % 3 == 2 {
                let wrench = Wrench::new(random.vector(4.0), random.vector(3.0));
                input.tree.wrenches[3 * (trial % 2)] = wrench;
            }
            let mut workspace = FlexibleWorkspace::new(&system);
            let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
            let found = integrator.accelerations(&state, &mut workspace, &input);
            let [joints, modes, motors, wheels] =
                [found.joints, found.modes, found.motors, found.wheels].map(<[f64]>::to_vec);
            let A = found.base;
            workspace.set_state(&state);
            let V = *workspace.V_WB_B();
            let X_WB = workspace.X_WB(&state);
            // Total momentum about the world's origin, and energy, of states that move with the accelerations.
            let at = |t: f64| {
                let mut moved = state.clone();
                let advance = |x: &mut [f64], rate: &[f64], acceleration: &[f64]| {
                    for ((x, rate), a) in x.iter_mut().zip(rate).zip(acceleration) {
                        *x += rate * t + 0.5 * a * t * t;
                    }
                };
                advance(
                    moved.tree.q.as_mut_slice(),
                    state.tree.qd.as_slice(),
                    &joints,
                );
                advance(moved.mu_mut(), state.mu_dot(), &modes);
                advance(moved.motor_angles_mut(), state.motor_rates(), &motors);
                let accelerate = |rates: &mut [f64], accelerations: &[f64]| {
                    for (rate, a) in rates.iter_mut().zip(accelerations) {
                        *rate += a * t;
                    }
                };
                accelerate(moved.tree.qd.as_mut_slice(), &joints);
                accelerate(moved.mu_dot_mut(), &modes);
                accelerate(moved.motor_rates_mut(), &motors);
                accelerate(moved.wheel_speeds_mut(), &wheels);
                let half = (V.angular + A.angular * (0.5 * t)) * t;
                let R = X_WB.rotation * Rotation3::from_scaled_axis(half);
                let v = X_WB.rotation * V.linear;
                let a = X_WB.rotation * A.linear;
                let p = X_WB.translation.vector + v * t + a * (0.5 * t * t);
                // Body axes: the rate of a vector of inertial components v + a t.
                let w = V.angular + A.angular * t;
                let V = fuyu_physics::spatial::Twist::new(w, R.inverse() * (v + a * t));
                let X = Pose::from_parts(Translation3::from(p), R);
                let mut workspace = FlexibleWorkspace::new(&system);
                moved.set_base(&mut workspace, &X, &V);
                workspace.set_state(&moved);
                let carried = workspace.carried_momentum(&moved);
                let (P, L) = (R * carried.linear, R * carried.angular);
                let L = L + moved.tree.p_WC.cross(&P);
                let energy = workspace.kinetic_energy(&moved) + workspace.strain_energy(&moved);
                nalgebra::DVector::from_iterator(7, P.iter().chain(&L).copied().chain([energy]))
            };
            let h = 5e-4;
            let weights = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
            let mut slope = nalgebra::DVector::zeros(7);
            for (weight, t) in weights.into_iter().zip([h, 2.0 * h, 3.0 * h, 4.0 * h]) {
                slope += (at(t) - at(-t)) * (weight / h);
            }
            let size = at(0.0);
            let scale = |i: usize| size.rows(i, 3).norm().max(1.0);
            // What acts from outside, and the power of everything.
            let (force, torque, power) = outside(&system, &state, &input, &workspace);
            let rate = |i: usize| Vector3::new(slope[i], slope[i + 1], slope[i + 2]);
            worst[0] = worst[0].max((rate(0) - force).norm() / scale(0));
            worst[1] = worst[1].max((rate(3) - torque).norm() / scale(3));
            worst[2] = worst[2].max((slope[6] - power).abs() / size[6]);
        }
        println!(
            "{name}: dP {:.1e}, dL {:.1e}, dE {:.1e}",
            worst[0], worst[1], worst[2]
        );
        // Per second, relative to momentum and energy. Rounding of the differences is 1e-16 over 5e-4 s.
        assert!(worst.iter().all(|x| *x < 1e-10), "{name}: {worst:?}");
    }
}

/// Makes deflections those of forces that accelerate each mode by about 1 (`K⁻¹ M f`), and rates alike: the differences
/// do not resolve the free vibration of stiff modes.
fn slow_down(system: &FlexibleSystem, state: &mut FlexibleState) {
    for body in system.modal_bodies() {
        let stiffness = body.appendage.modal_stiffness.clone().cholesky().unwrap();
        let slow = |values: &mut [f64]| {
            let loads = &body.appendage.modal_mass * nalgebra::DVector::from_row_slice(values);
            values.copy_from_slice((stiffness.solve(&loads) * 3.0).as_slice());
        };
        slow(&mut state.mu_mut()[body.range()]);
        slow(&mut state.mu_dot_mut()[body.range()]);
    }
}

/// Force and torque about the world's origin from outside, and the power of efforts, wheels and wrenches less losses.
fn outside(
    system: &FlexibleSystem,
    state: &FlexibleState,
    input: &FlexibleInput,
    workspace: &FlexibleWorkspace,
) -> (Vector3<f64>, Vector3<f64>, f64) {
    let X_WB = workspace.X_WB(state);
    let (mut force, mut torque, mut power) = (Vector3::zeros(), Vector3::zeros(), 0.0);
    for (body, wrench) in system.model().bodies().iter().zip(&input.tree.wrenches) {
        let frame = system.model().frame(&body.name).unwrap();
        let X_WF = X_WB * workspace.X_BF(frame);
        let f = X_WF.rotation * wrench.force;
        force += f;
        torque += X_WF.rotation * wrench.torque + X_WF.translation.vector.cross(&f);
        let V = workspace.V_WF_B(frame);
        let turned = |v: &Vector3<f64>| X_WB.rotation.inverse() * X_WF.rotation * v;
        power += V.angular.dot(&turned(&wrench.torque)) + V.linear.dot(&turned(&wrench.force));
    }
    for (j, effort) in input.tree.efforts.iter().enumerate() {
        let name = &system.model().joints()[j].name;
        let motor = system
            .elastic_joints()
            .iter()
            .position(|e| e.joint == *name);
        power += effort * motor.map_or(state.tree.qd[j], |e| state.motor_rates()[e]);
        if let Some(e) = motor {
            let rate = state.motor_rates()[e] - state.tree.qd[j];
            power -= system.elastic_joints()[e].damping * rate * rate;
        }
    }
    for (i, wheel) in system.wheels().iter().enumerate() {
        let speed = state.wheel_speeds()[i];
        power += (input.wheel_torques[i] + wheel.friction(speed)) * speed;
    }
    for body in system.modal_bodies() {
        let rates = nalgebra::DVector::from_column_slice(&state.mu_dot()[body.range()]);
        power -= rates.dot(&(&body.appendage.modal_damping * &rates));
    }
    (force, torque, power)
}

/// The longest step that is stable for small vibrations.
fn longest_step(system: &FlexibleSystem, state: &FlexibleState) -> f64 {
    let (mut low, mut high) = (1e-6_f64, 1.0_f64);
    for _ in 0..30 {
        let step = (low * high).sqrt();
        match system.check_step(&state.tree.q, IntegrationMethod::Rk4, step) {
            Ok(()) => low = step,
            Err(_) => high = step,
        }
    }
    low
}

// At any step size the state's momentum does not change by a bit, and the sum over bodies, modes, rotors and wheels
// agrees with it.
#[test]
fn momentum_is_conserved_at_any_step() {
    let mut random = Random::new(12);
    for (name, system) in systems() {
        for part in [0.1, 0.7] {
            let mut state = random.state(&system, 0.1);
            slow_down(&system, &mut state);
            let dt = part * longest_step(&system, &state);
            let input = random_input(&mut random, &system);
            let before = state.tree.momentum_W;
            let mut workspace = FlexibleWorkspace::new(&system);
            let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
            let mut hold = |_: f64, _: &FlexibleState, i: &mut FlexibleInput| i.copy_from(&input);
            let mut worst = 0.0_f64;
            for _ in 0..100 {
                integrator.step(&mut state, &mut workspace, dt, &mut hold);
                assert_eq!(state.tree.momentum_W, before, "{name}");
                let carried = workspace.carried_momentum(&state);
                let momentum = before.expressed_in(&state.tree.R_WB);
                let scale = momentum.angular.norm().max(1.0);
                worst = worst.max((carried.angular - momentum.angular).norm() / scale);
                let scale = momentum.linear.norm().max(1.0);
                worst = worst.max((carried.linear - momentum.linear).norm() / scale);
            }
            println!("{name}, {dt:.1e} s: {worst:.1e}");
            assert!(state.is_finite() && worst < 1e-12, "{name}: {worst:e}");
        }
    }
}

// The equations on the rigid robot's kernels, for a robot whose parts are all on the base, against the general ones.
#[test]
fn equations_for_parts_on_the_base_are_the_general_ones() {
    let mut random = Random::new(13);
    for (name, system) in [
        ("panels", servicer_with_panels(0.6)),
        ("wheels", servicer_with_wheels(0.0)),
        ("joint", {
            let model = servicer();
            let joint = |name: &str, rotor| ElasticJoint {
                joint: name.to_owned(),
                stiffness: 5e3,
                damping: 4.0,
                rotor_inertia: 2e-4,
                gear_ratio: 160.0,
                rotor,
            };
            let builder = with_panels(&model, &panel(false), 0.2);
            let builder = builder.elastic_joint(joint("joint1", RotorModel::Full));
            let builder = builder.elastic_joint(joint("joint4", RotorModel::Reduced));
            builder.build().unwrap()
        }),
    ] {
        let mut fast = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
        let mut general =
            FlexibleIntegrator::new(&system, IntegrationMethod::Rk4).with_general_equations();
        let mut workspace = FlexibleWorkspace::new(&system);
        let mut worst = 0.0_f64;
        for _ in 0..50 {
            let state = random.state(&system, 2.0);
            let input = random_input(&mut random, &system);
            let lists = |a: &Accelerations| {
                let base = [a.base.linear, a.base.angular].map(|v| v.as_slice().to_vec());
                let parts = [a.joints, a.modes, a.motors, a.wheels].map(<[f64]>::to_vec);
                [base.concat(), parts.concat()]
            };
            let a = lists(&fast.accelerations(&state, &mut workspace, &input));
            let b = lists(&general.accelerations(&state, &mut workspace, &input));
            for (a, b) in a.iter().zip(&b) {
                let scale = b.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
                worst = worst.max(crate::support::difference(a, b) / scale);
            }
        }
        println!("{name}: {worst:.1e}");
        assert!(worst < 1e-11, "{name}: {worst:e}");
    }
}
