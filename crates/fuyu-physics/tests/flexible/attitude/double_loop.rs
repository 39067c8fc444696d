//! The H-infinity double loop, designed from the robot's own model and run on the robot.

use fuyu_physics::control::attitude::{
    AttitudeDeviation, AttitudeLaw, AttitudePlant, AttitudeTarget, DoubleLoopConfig, DoubleLoopLaw,
    spread_postures,
};
use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleWorkspace,
};
use nalgebra::{UnitQuaternion, Vector3};

use super::{locked_with_wheels, lti_fixture, plant, plant_at};
use crate::support::{POSTURES, Random, numbers, servicer_with_wheels};

/// The design of the reference: posture B is the nominal one, A and C are covered.
fn design(period: f64) -> DoubleLoopLaw {
    let plants = ["B", "A", "C"].map(plant);
    DoubleLoopLaw::new(&plants, &DoubleLoopConfig::new(900.0, 0.2), period).unwrap()
}

#[test]
fn the_design_is_the_independent_one() {
    let all = lti_fixture("flexible_hinf");
    let number = |name: &str| all[name].as_f64().unwrap();
    let inertia = plant("B").axis_inertia()[1];
    assert!((inertia / number("J") - 1.0).abs() < 1e-9, "{inertia}");
    let law = design(0.1);
    let k = law.cover()[1];
    assert!((k / number("k_with_dvfb") - 1.0).abs() < 1e-5, "{k}");
    let expected = all["DVFB+Hinf"]["gamma_max"].as_f64().unwrap();
    let found = law.design(1).gamma_max;
    println!("k {k:.6}, gamma_max {found:.6}");
    assert!((found - expected).abs() < 1e-4 * expected, "{found}");
    // Two methods for each axis: the Hamiltonian, and a sweep over frequencies.
    for axis in 0..3 {
        let norm = law.design(axis).hinf.norm;
        assert!(norm.norm < 1.0 && norm.swept < 1.0, "{norm:?}");
        assert!((norm.norm - norm.swept).abs() < 1e-6, "{norm:?}");
    }
    // Three axes at once, with every posture, and sampled at 10 Hz with one sample of delay.
    for (posture, _) in POSTURES {
        let plant = plant(posture);
        let poles = plant.poles(&law).unwrap();
        let largest = poles.iter().fold(f64::MIN, |most, p| most.max(p.re));
        let radius = plant.sampled_radius(&law, 0.1, 0.1).unwrap();
        println!("{posture}: largest real part {largest:.6}, spectral radius {radius:.6}");
        assert!(largest < -0.006 && radius < 0.9995, "{posture}");
    }
    // Without the panels' inner damping there is no such controller: the weight would have to cover resonances.
    let weak = DoubleLoopConfig::new(1e-3, 0.2);
    let plants = ["B", "A", "C"].map(plant);
    let error = DoubleLoopLaw::new(&plants, &weak, 0.1)
        .unwrap_err()
        .to_string();
    assert!(
        error.starts_with("hinf about the x axis: no stabilising controller"),
        "{error}"
    );
}

// The law on the robot in posture B, sampled at 50 Hz, about y while the other attitudes follow freely: the step
// response of the continuous loop in the fixture. The overshoot is right within .05 points.
#[test]
fn the_step_response_on_the_robot_is_the_independent_one() {
    let want = &lti_fixture("flexible_hinf")["DVFB+Hinf"];
    let system = locked_with_wheels(&POSTURES[1].1);
    let mut law = design(0.02);
    let mut state = FlexibleState::at_rest(&system);
    let mut workspace = FlexibleWorkspace::new(&system);
    workspace.set_state(&state);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
    let degree = 1f64.to_radians();
    let target = AttitudeTarget::fixed(UnitQuaternion::from_scaled_axis(Vector3::y() * degree));
    let mut angles = Vec::new();
    for i in 0..=10_000 {
        if i % 25 == 0 {
            angles.push(state.tree.R_WB.scaled_axis().y / degree);
        }
        let w = workspace.V_WB_B().angular;
        let mut deviation = AttitudeDeviation::new(&state.tree.R_WB, &w, &target);
        for i in [0, 2] {
            (deviation.angle[i], deviation.rate[i]) = (0.0, 0.0);
        }
        let torque = -law.torque(&deviation);
        let mut forcing = |_: f64, _: &FlexibleState, input: &mut FlexibleInput| {
            input.wheel_torques.copy_from_slice(torque.as_slice());
        };
        integrator.step(&mut state, &mut workspace, 0.02, &mut forcing);
    }
    let expected = numbers(&want["step_deg"]);
    let difference = |(i, e): (usize, &f64)| (angles[10 * i] - e).abs();
    let worst = expected
        .iter()
        .enumerate()
        .map(difference)
        .fold(0.0, f64::max);
    let figures = fuyu_lti::step_figures(&angles, 0.5, 1.0, 0.05);
    println!("{figures:?}; differs by {worst:.1e} deg of 1");
    assert!(worst < 1e-3, "{worst}");
    let overshoot = want["overshoot_pct"].as_f64().unwrap();
    assert!(
        (figures.overshoot_percent - overshoot).abs() < 0.05,
        "{figures:?}"
    );
    let settling = want["settle5_s"].as_f64().unwrap();
    assert!((figures.settling - settling).abs() <= 0.5, "{figures:?}");
}

// The weight of a design for the start alone (posture B) is smaller than the model error of other postures, so there the
// theory promises nothing. Sixteen spread postures give a weight that covers nine of ten postures that the design has not
// seen, at the price of gain; hundreds of them are stable with it, sampled and one sample late.
#[test]
fn a_design_for_spread_postures_is_valid_in_others() {
    let system = servicer_with_wheels(0.0);
    let config = DoubleLoopConfig::new(900.0, 0.2);
    let start = plant_at(&system, &POSTURES[1].1);
    let mut plants = vec![start.clone()];
    for q in spread_postures(system.model(), 16) {
        plants.push(AttitudePlant::new(&system, &q).unwrap());
    }
    let law = DoubleLoopLaw::new(&plants, &config, 0.1).unwrap();
    let alone = DoubleLoopLaw::new(&plants[..1], &config, 0.1).unwrap();
    let mut random = Random::new(18);
    let mut posture = || -> Vec<f64> {
        let pi = std::f64::consts::PI;
        (0..6).map(|_| pi * random.number()).collect()
    };
    let (mut worst, mut worst_alone) = (0.0_f64, 0.0_f64);
    let (mut covered, mut covered_alone) = (0, 0);
    for k in 0..300 {
        let plant = plant_at(&system, &posture());
        for delay in [0.0, 0.1] {
            worst = worst.max(plant.sampled_radius(&law, 0.1, delay).unwrap());
            worst_alone = worst_alone.max(plant.sampled_radius(&alone, 0.1, delay).unwrap());
        }
        if k < 40 {
            // 1.1 times what this posture needs, with the inertia of the start.
            let needed = DoubleLoopLaw::new(&[start.clone(), plant], &config, 0.1).unwrap();
            let covers = |law: &DoubleLoopLaw| {
                let pairs = law.cover().into_iter().zip(needed.cover());
                pairs.fold(true, |all, (has, needs)| all && has >= needs / 1.1)
            };
            covered += usize::from(covers(&law));
            covered_alone += usize::from(covers(&alone));
        }
    }
    let gamma = |law: &DoubleLoopLaw| [0, 1, 2].map(|i| law.design(i).gamma_max);
    println!(
        "largest spectral radius {worst:.5}, of the start alone {worst_alone:.5}; k {:.1?} covers {covered} of 40, k {:.1?} of the start alone {covered_alone}; gamma_max {:.3?} and {:.3?}",
        law.cover(),
        alone.cover(),
        gamma(&law),
        gamma(&alone)
    );
    assert!(worst < 1.0, "{worst}");
    assert!(covered >= 36, "{covered}");
    assert!(covered_alone < covered, "{covered_alone}");
}
