//! Panels as chains of rigid segments with springs in rigid multibody dynamics, which know nothing of modes.

use fuyu_physics::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleWorkspace, LinearModel,
};
use fuyu_physics::dynamics::{Input, IntegrationMethod, Integrator, State, Workspace};
use fuyu_physics::model::Model;
use fuyu_physics::spatial::Wrench;
use fuyu_structures::PlateStrip;
use nalgebra::{DVector, Vector3};

use crate::segments;
use crate::support::{POSTURES, fixture_lumped, locked_servicer, mounts, strip, with_panels};

/// The locked servicer with two panels of `n` hinges each.
fn chain(n: usize, alpha: f64) -> Model {
    let base = locked_servicer(&POSTURES[1].1).bodies()[0].inertia;
    segments::chain(&base, &mounts(alpha), n)
}

/// The locked servicer with modal panels.
fn modal(
    bending_modes: usize,
    torsion_modes: usize,
    second_order: bool,
    alpha: f64,
) -> fuyu_physics::dynamics::flexible::FlexibleSystem {
    let panel = PlateStrip {
        bending_modes,
        torsion_modes,
        damping: 0.0,
        ..strip(second_order)
    };
    let model = locked_servicer(&POSTURES[1].1);
    let panel = panel.appendage("panel").unwrap();
    with_panels(&model, &panel, alpha).build().unwrap()
}

// Base free: bending, torsion and mixed modes. The error of the chain falls with the square of the segments' length.
#[test]
fn frequencies_of_chains_converge_to_the_modal_ones() {
    let system = modal(9, 4, false, 0.0);
    let linear = LinearModel::new(&system, &DVector::zeros(0));
    let exact = linear.frequencies_hz(&linear.base_and_modes()).unwrap();
    let published = fixture_lumped();
    println!(
        "modal {:.9?}, published with 14 + 7 modes {:.9?}",
        &exact[..6],
        published
    );
    assert!(crate::support::relative(&exact[..6], &published[..6]) < 1e-6);
    let mut errors = Vec::new();
    for n in [10, 20, 40] {
        let found = segments::frequencies_hz(&chain(n, 0.0)).into_iter();
        let error: Vec<f64> = found
            .zip(&exact)
            .map(|(f, e)| f / e - 1.0)
            .take(6)
            .collect();
        println!("{n} segments: {error:?}");
        errors.push(error);
    }
    for k in 0..6 {
        for pair in errors.windows(2) {
            let ratio = pair[0][k] / pair[1][k];
            assert!((ratio - 4.0).abs() < 0.1, "mode {k}: {ratio}");
        }
    }
}

/// Torque and force on the base \[N m, N\]: for 2 s, smooth, so that modes that the chains do not resolve stay at rest.
fn kick(t: f64, size: f64) -> Wrench {
    let wave = if t < 2.0 {
        size * (0.5 * std::f64::consts::PI * t).sin().powi(4)
    } else {
        0.0
    };
    Wrench::new(
        Vector3::new(60.0, 120.0, 80.0) * wave,
        Vector3::new(20.0, -30.0, 60.0) * wave,
    )
}

const END: f64 = 2.5;

/// Rotation vector of the base at the end, of a chain.
fn chain_attitude(n: usize, size: f64) -> Vector3<f64> {
    let model = chain(n, 0.6);
    let mut state = State::at_rest(&model);
    let mut workspace = Workspace::new(&model);
    let mut integrator = Integrator::new(&model, IntegrationMethod::Rk4);
    // The fastest vibration of the chain is 4 sqrt(EI/m) / h².
    let h = 8.0 / n as f64;
    let dt = END / (END * 4.0 * 22.4 / (h * h) / 1.1).ceil().max(500.0);
    let mut push = |t: f64, _: &State, input: &mut Input| input.wrenches[0] = kick(t, size);
    let steps = (END / dt).round() as usize;
    integrator.steps(&mut state, &mut workspace, dt, steps, &mut push);
    state.R_WB.scaled_axis()
}

fn modal_attitude(second_order: bool, size: f64) -> (Vector3<f64>, f64) {
    let system = modal(5, 3, second_order, 0.6);
    let mut state = FlexibleState::at_rest(&system);
    let mut workspace = FlexibleWorkspace::new(&system);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Dop8);
    let mut push = |t: f64, _: &FlexibleState, input: &mut FlexibleInput| {
        input.tree.wrenches[0] = kick(t, size);
    };
    let mut largest = 0.0_f64;
    for _ in 0..250 {
        integrator.step(&mut state, &mut workspace, END / 250.0, &mut push);
        largest = largest.max(workspace.deflection(&state, 0, 0).norm());
    }
    (state.tree.R_WB.scaled_axis(), largest)
}

// Runs instead of frequencies, and large motion. The chains converge with the square of the segments' length;
// extrapolated, they differ from second-order modes by a term that is cubic in the kick, and from first-order modes by
// a quadratic one, so second order is better for small kicks: up to a tip deflection of .06 m here. With foreshortening
// alone its remainder would be quadratic, too.
#[test]
fn motion_of_chains_converges_and_second_order_is_cubic() {
    let (mut second, mut first) = (Vec::new(), Vec::new());
    for size in [0.125, 0.25, 0.5] {
        let runs = [10, 20, 40].map(|n| chain_attitude(n, size));
        let ratio = (runs[0] - runs[1]).norm() / (runs[1] - runs[2]).norm();
        // Terms in h² and h⁴ removed.
        let once = [
            (runs[1] * 4.0 - runs[0]) / 3.0,
            (runs[2] * 4.0 - runs[1]) / 3.0,
        ];
        let limit = (once[1] * 16.0 - once[0]) / 15.0;
        let (of_second, tip) = modal_attitude(true, size);
        let (of_first, _) = modal_attitude(false, size);
        second.push((of_second - limit).norm());
        first.push((of_first - limit).norm());
        println!(
            "kick {size}: base turns {:.4} rad, tip {tip:.3} m, ratio {ratio:.3}, second order {:.2e}, first order {:.2e}, extrapolation {:.1e}",
            limit.norm(),
            second[second.len() - 1],
            first[first.len() - 1],
            (once[1] - limit).norm()
        );
        assert!((ratio - 4.0).abs() < 0.1, "{ratio}");
    }
    for k in 0..2 {
        let [cubic, quadratic] = [&second, &first].map(|e| e[k + 1] / e[k]);
        assert!((7.5..8.5).contains(&cubic), "{second:?}");
        assert!((3.5..4.5).contains(&quadratic), "{first:?}");
    }
    assert!(second[0] < 0.6 * first[0], "{second:?} {first:?}");
}
