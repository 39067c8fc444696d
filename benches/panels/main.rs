//! Two solar panels on a free base: modes in fuyu compared with chains of rigid segments in fuyu and in MuJoCo.
//!
//! ```sh
//! python=$(scripts/test-venv.sh peers pin==4.1.0 mujoco==4.0.0 cmeel-eigen==3.4.1)
//! cargo bench --bench panels -- --python "$python"      # without --python: fuyu alone
//! ```
//!
//! MuJoCo has no modal bodies; its flexible ones are chains or meshes of bodies with springs, as here. Both programs
//! simulate the same chains, so their results must agree before anything is printed. All runs use the classical
//! Runge-Kutta method, each with the longest step of 1/k s with `ω h` below 2 for its fastest vibration. The error is
//! that of the base's attitude after five seconds of a tumbling motion, against chains extrapolated to segments of no
//! length.

#[path = "../../crates/fuyu-physics/tests/flexible/segments.rs"]
mod segments;

use std::f64::consts::{PI, TAU};
use std::process::Command;
use std::time::Instant;

use fuyu::dynamics::flexible::{
    FlexibleInput, FlexibleIntegrator, FlexibleState, FlexibleSystem, FlexibleWorkspace,
    LinearModel,
};
use fuyu::dynamics::{Input, IntegrationMethod, Integrator, State, Workspace};
use fuyu::model::{Model, ModelBuilder};
use fuyu::spatial::{Pose, RigidInertia, Twist};
use fuyu::structures::PlateStrip;
use nalgebra::{
    DVector, Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3,
};

/// Simulated time \[s\].
const END: f64 = 5.0;
/// Angular velocity at the start, base axes \[rad/s\].
const SPIN: [f64; 3] = [0.02, -0.05, 0.03];
/// Rounds of which the fastest counts.
const ROUNDS: usize = 3;
/// `ω h` of the fastest vibration.
const LARGEST_ANGLE: f64 = 2.0;

/// One model's figures.
struct Row {
    name: String,
    coordinates: usize,
    /// Of the six lowest frequencies, relative to the modal ones \[-\].
    frequency_error: Option<f64>,
    dt: f64,
    /// \[s\].
    per_step: f64,
    attitude: UnitQuaternion<f64>,
}

fn base() -> RigidInertia {
    RigidInertia {
        mass: 1000.0,
        com: Vector3::zeros(),
        about_com: Matrix3::from_diagonal(&Vector3::new(1200.0, 800.0, 1500.0)),
    }
}

fn mounts() -> [(&'static str, Pose); 2] {
    let back = Rotation3::from_axis_angle(&Vector3::z_axis(), PI);
    let at = |x: f64, R| Pose::from_parts(Translation3::new(x, 0.0, 0.0), R);
    [
        ("plus", at(1.2, Rotation3::identity())),
        ("minus", at(-1.2, back)),
    ]
}

/// The longest step of 1/k s for a highest frequency \[Hz\].
fn step_for(highest_hz: f64) -> f64 {
    1.0 / (TAU * highest_hz / LARGEST_ANGLE).ceil()
}

fn steps_of(dt: f64) -> usize {
    (END / dt).round() as usize
}

/// Seconds of the fastest of several calls.
fn fastest(mut call: impl FnMut()) -> f64 {
    let times = (0..ROUNDS).map(|_| {
        let start = Instant::now();
        call();
        start.elapsed().as_secs_f64()
    });
    times.fold(f64::INFINITY, f64::min)
}

fn chain_row(n: usize, exact: &[f64]) -> Row {
    let model: Model = segments::chain(&base(), &mounts(), n);
    let frequencies = segments::frequencies_hz(&model);
    let dt = step_for(frequencies[frequencies.len() - 1]);
    let mut workspace = Workspace::new(&model);
    let mut integrator = Integrator::new(&model, IntegrationMethod::Rk4);
    let mut start = State::at_rest(&model);
    let V = Twist::new(Vector3::from(SPIN), Vector3::zeros());
    start.set_base(&mut workspace, &Isometry3::identity(), &V);
    let mut state = start.clone();
    let mut free = |_: f64, _: &State, _: &mut Input| {};
    let seconds = fastest(|| {
        state = start.clone();
        integrator.steps(&mut state, &mut workspace, dt, steps_of(dt), &mut free);
    });
    Row {
        name: format!("fuyu, {n} segments a panel"),
        coordinates: model.dof(),
        frequency_error: Some(error(&frequencies, exact)),
        dt,
        per_step: seconds / steps_of(dt) as f64,
        attitude: state.R_WB,
    }
}

fn modal(bending_modes: usize, torsion_modes: usize, second_order: bool) -> FlexibleSystem {
    let [length, width, areal_mass, EI, GJ] = segments::PANEL;
    let panel = PlateStrip {
        length,
        width,
        areal_mass,
        EI,
        GJ,
        bending_modes,
        torsion_modes,
        damping: 0.0,
        second_order,
    };
    let model = ModelBuilder::new("bus", "base_link", base()).build();
    let frame = model.frames()[0].clone();
    let mut builder = FlexibleSystem::builder(&model);
    for (name, X_BA) in mounts() {
        let body = panel.appendage(name).expect("a panel");
        builder = builder.appendage(&frame, X_BA, body);
    }
    builder.build().expect("a robot with panels")
}

fn modal_frequencies(system: &FlexibleSystem) -> Vec<f64> {
    let linear = LinearModel::new(system, &DVector::zeros(0));
    let found = linear.frequencies_hz(&linear.base_and_modes());
    found.expect("a vibrating robot")
}

fn modal_row(modes: (usize, usize), second_order: bool, exact: &[f64]) -> Row {
    let system = modal(modes.0, modes.1, second_order);
    let frequencies = modal_frequencies(&system);
    let dt = step_for(frequencies[frequencies.len() - 1]);
    let mut workspace = FlexibleWorkspace::new(&system);
    let mut integrator = FlexibleIntegrator::new(&system, IntegrationMethod::Rk4);
    let mut start = FlexibleState::at_rest(&system);
    let V = Twist::new(Vector3::from(SPIN), Vector3::zeros());
    start.set_base(&mut workspace, &Pose::identity(), &V);
    let mut state = start.clone();
    let mut free = |_: f64, _: &FlexibleState, _: &mut FlexibleInput| {};
    let seconds = fastest(|| {
        state = start.clone();
        integrator.steps(&mut state, &mut workspace, dt, steps_of(dt), &mut free);
    });
    let order = if second_order { ", second order" } else { "" };
    Row {
        name: format!("fuyu, {} + {} modes a panel{order}", modes.0, modes.1),
        coordinates: system.modes(),
        frequency_error: Some(error(&frequencies, exact)),
        dt,
        per_step: seconds / steps_of(dt) as f64,
        attitude: state.tree.R_WB,
    }
}

/// The chain of `n` segments in MuJoCo, at the step of fuyu's.
fn mujoco_row(python: &str, n: usize, dt: f64) -> Row {
    let script = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/benches/panels/mujoco_chain.py"
    );
    let numbers = segments::PANEL.iter().chain(&SPIN).map(f64::to_string);
    let output = Command::new(python)
        .args([
            script,
            &n.to_string(),
            &format!("{dt:?}"),
            &steps_of(dt).to_string(),
        ])
        .arg(ROUNDS.to_string())
        .args(numbers)
        .output()
        .expect("python starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let found: Vec<f64> = text
        .split_whitespace()
        .filter_map(|x| x.parse().ok())
        .collect();
    let [coordinates, per_step, w, x, y, z] = found[..] else {
        panic!("{text}{}", String::from_utf8_lossy(&output.stderr))
    };
    Row {
        name: format!("MuJoCo, {n} segments a panel"),
        coordinates: coordinates as usize,
        frequency_error: None,
        dt,
        per_step,
        attitude: UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
    }
}

/// Largest relative error of the six lowest frequencies.
fn error(found: &[f64], exact: &[f64]) -> f64 {
    let errors = found
        .iter()
        .zip(exact)
        .take(6)
        .map(|(f, e)| (f / e - 1.0).abs());
    errors.fold(0.0, f64::max)
}

fn main() {
    let mut arguments = std::env::args().skip_while(|argument| argument != "--python");
    let python = arguments.nth(1);
    let exact = modal_frequencies(&modal(12, 6, false));
    let chains = [10, 20, 40].map(|n| (n, chain_row(n, &exact)));
    // Terms in h² and h⁴ of the segments' length removed.
    let [a, b, c] = [0, 1, 2].map(|i| chains[i].1.attitude.scaled_axis());
    let once = [(b * 4.0 - a) / 3.0, (c * 4.0 - b) / 3.0];
    let limit = UnitQuaternion::from_scaled_axis((once[1] * 16.0 - once[0]) / 15.0);
    let mut rows = vec![
        modal_row((3, 1), false, &exact),
        modal_row((3, 1), true, &exact),
        modal_row((5, 2), true, &exact),
    ];
    for (n, ours) in chains {
        if let Some(python) = &python {
            let theirs = mujoco_row(python, n, ours.dt);
            let apart = theirs.attitude.angle_to(&ours.attitude);
            assert!(
                apart < 1e-6,
                "{n} segments: the programs are {apart:.1e} rad apart"
            );
            rows.push(theirs);
        }
        rows.push(ours);
    }
    println!(
        "| model | coordinates | frequencies | step | time a step | time a simulated second | attitude |"
    );
    println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: |");
    for row in rows {
        let frequencies = row
            .frequency_error
            .map_or(String::new(), |e| format!("{e:.1e}"));
        println!(
            "| {} | {} | {frequencies} | {:.2} ms | {:.2} µs | {:.3} ms | {:.1e} rad |",
            row.name,
            row.coordinates,
            row.dt * 1e3,
            row.per_step * 1e6,
            row.per_step / row.dt * 1e3,
            row.attitude.angle_to(&limit)
        );
    }
}
