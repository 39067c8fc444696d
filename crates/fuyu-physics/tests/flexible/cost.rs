//! What flexible parts cost: steps of the servicer with two panels of four modes, and of the rigid servicer, in turn.

use std::hint::black_box;
use std::time::Instant;

use fuyu_physics::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleWorkspace,
};
use fuyu_physics::dynamics::{Input, IntegrationMethod, Integrator, State, Workspace};
use nalgebra::DVector;

use crate::support::{POSTURES, servicer, servicer_with_panels, servicer_with_wheels};

/// Median of the ratios of paired measurements.
fn median(mut ratios: Vec<f64>) -> f64 {
    ratios.sort_by(f64::total_cmp);
    ratios[ratios.len() / 2]
}

// `cargo test --release -p fuyu-physics --test flexible cost -- --ignored --nocapture`
#[test]
#[ignore = "a measurement, for a release build on a quiet computer"]
fn a_step_with_two_panels_costs_at_most_1_6_rigid_ones() {
    const STEPS: usize = 2000;
    let model = servicer();
    let q = DVector::from_row_slice(&POSTURES[1].1);
    for (name, system, limit) in [
        ("panels", servicer_with_panels(0.0), 1.6),
        (
            "panels and wheels",
            servicer_with_wheels(0.0),
            f64::INFINITY,
        ),
    ] {
        for (method_name, method) in IntegrationMethod::NAMES {
            let mut rigid = Integrator::new(&model, method);
            let (mut state, mut workspace) =
                (State::at_rest_with(&model, &q), Workspace::new(&model));
            let mut flexible = FlexibleIntegrator::new(&system, method);
            let mut general = FlexibleIntegrator::new(&system, method).with_general_equations();
            let start = FlexibleState::at_rest_with(&system, &q);
            let (mut bent, mut other) = (start.clone(), start);
            let mut scratch = FlexibleWorkspace::new(&system);
            let mut push = |_: f64, _: &State, input: &mut Input| input.efforts[0] = 0.1;
            let mut push_bent = |_: f64, _: &FlexibleState, input: &mut FlexibleInput| {
                input.tree.efforts[0] = 0.1;
            };
            let (mut ratios, mut general_ratios, mut times) = (Vec::new(), Vec::new(), Vec::new());
            for _ in 0..41 {
                let clock = Instant::now();
                rigid.steps(
                    black_box(&mut state),
                    &mut workspace,
                    1e-4,
                    STEPS,
                    &mut push,
                );
                let of_rigid = clock.elapsed().as_secs_f64();
                let clock = Instant::now();
                flexible.steps(
                    black_box(&mut bent),
                    &mut scratch,
                    1e-4,
                    STEPS,
                    &mut push_bent,
                );
                let of_flexible = clock.elapsed().as_secs_f64();
                let clock = Instant::now();
                general.steps(
                    black_box(&mut other),
                    &mut scratch,
                    1e-4,
                    STEPS,
                    &mut push_bent,
                );
                ratios.push(of_flexible / of_rigid);
                general_ratios.push(clock.elapsed().as_secs_f64() / of_rigid);
                times.push(of_rigid / STEPS as f64);
            }
            let (ratio, rigid_time) = (median(ratios), median(times));
            println!(
                "{name}, {method_name}: {ratio:.2} of the rigid step ({:.2} µs); general equations {:.2}",
                rigid_time * 1e6,
                median(general_ratios)
            );
            assert!(ratio <= limit, "{name}, {method_name}: {ratio}");
        }
    }
}
