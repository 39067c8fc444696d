//! Work and precision of integration methods in free motion, for `docs/integrators.md`:
//! `cargo bench --bench integrators` prints the tables; a path after `--` also draws them there
//! (`-- docs/integrators` makes the picture of the document).
//!
//! The methods that the library does not have are tableaux too, so that all methods use the same stepper:
//! coordinates, momentum and cost of an evaluation are the same.

use std::time::Instant;

use fuyu::dynamics::{Input, IntegrationMethod, Integrator, Momentum, State, Tableau, Workspace};
use fuyu::experiments::{Figure, Panel, Series};
use fuyu::model::Model;
use nalgebra::{DVector, UnitQuaternion, Vector3};

const SECONDS: usize = 1000;
const STEPS: [f64; 5] = [0.1, 0.05, 0.02, 0.01, 0.005];

struct Motion {
    name: &'static str,
    rates: [f64; 6],
    angular_momentum: [f64; 3],
    /// When the attitude is compared with the converged one \[s\]. Errors grow exponentially (an arm that
    /// coasts is chaotic), so no method follows the motion to the end.
    compared_at: usize,
}

const MOTIONS: [Motion; 2] = [
    Motion {
        name: "slow",
        rates: [0.02, -0.03, 0.04, 0.05, -0.06, 0.08],
        angular_momentum: [20.0, -35.0, 12.0],
        compared_at: 100,
    },
    Motion {
        name: "fast",
        rates: [0.5, -0.3, 0.4, 0.9, -0.6, 0.8],
        angular_momentum: [200.0, -350.0, 120.0],
        compared_at: 10,
    },
];

struct Run {
    /// Largest relative change of energy.
    drift: f64,
    attitude: UnitQuaternion<f64>,
    /// Time taken for one second simulated, median \[s\].
    cost: f64,
}

fn run(model: &Model, motion: &Motion, tableau: &'static Tableau, dt: f64, seconds: usize) -> Run {
    let degrees: [f64; 6] = [65.0, 99.0, -95.0, -22.0, 3.0, -42.0];
    let q = DVector::from_iterator(6, degrees.iter().map(|x| x.to_radians()));
    let mut state = State::at_rest_with(model, &q);
    state.qd = DVector::from_row_slice(&motion.rates);
    state.momentum_W = Momentum {
        linear: Vector3::new(3.0, -5.0, 2.0),
        angular: Vector3::from(motion.angular_momentum),
    };
    let mut workspace = Workspace::new(model);
    let mut integrator = Integrator::with_tableau(model, tableau);
    let mut coast = |_: f64, _: &State, _: &mut Input| {};
    workspace.set_positions(&state.q);
    workspace.set_motion(&state);
    let energy = workspace.kinetic_energy();
    let mut result = Run {
        drift: 0.0,
        attitude: state.R_WB,
        cost: 0.0,
    };
    let per_second = (1.0 / dt).round() as usize;
    let mut times = Vec::with_capacity(seconds);
    for second in 1..=seconds {
        let start = Instant::now();
        for _ in 0..per_second {
            integrator.step(&mut state, &mut workspace, dt, &mut coast);
        }
        times.push(start.elapsed().as_secs_f64());
        let change = (workspace.kinetic_energy() / energy - 1.0).abs();
        // Whatever is not a number is no small drift.
        result.drift = if change <= result.drift {
            result.drift
        } else {
            change
        };
        if second == motion.compared_at {
            result.attitude = state.R_WB;
        }
    }
    times.sort_by(f64::total_cmp);
    result.cost = times[times.len() / 2];
    result
}

fn keep(a: Vec<Vec<f64>>, b: Vec<f64>, c: Vec<f64>) -> &'static Tableau {
    let rows: Vec<&'static [f64]> = a.into_iter().map(|row| &*row.leak()).collect();
    Box::leak(Box::new(Tableau {
        a: rows.leak(),
        b: b.leak(),
        c: c.leak(),
    }))
}

/// The method of order 6 with 7 stages of H. A. Luther, An explicit sixth-order Runge-Kutta formula,
/// Mathematics of Computation 22 (1968).
fn luther() -> &'static Tableau {
    let r = 21f64.sqrt();
    let row = |values: &[f64], over: f64| values.iter().map(|x| x / over).collect::<Vec<_>>();
    keep(
        vec![
            vec![],
            vec![1.0],
            row(&[3.0, 1.0], 8.0),
            row(&[8.0, 2.0, 8.0], 27.0),
            row(
                &[
                    3.0 * (3.0 * r - 7.0),
                    -8.0 * (7.0 - r),
                    48.0 * (7.0 - r),
                    -3.0 * (21.0 - r),
                ],
                392.0,
            ),
            row(
                &[
                    -5.0 * (231.0 + 51.0 * r),
                    -40.0 * (7.0 + r),
                    -320.0 * r,
                    3.0 * (21.0 + 121.0 * r),
                    392.0 * (6.0 + r),
                ],
                1960.0,
            ),
            row(
                &[
                    15.0 * (22.0 + 7.0 * r),
                    120.0,
                    40.0 * (7.0 * r - 5.0),
                    -63.0 * (3.0 * r - 2.0),
                    -14.0 * (49.0 + 9.0 * r),
                    70.0 * (7.0 - r),
                ],
                180.0,
            ),
        ],
        row(&[9.0, 0.0, 64.0, 0.0, 49.0, 49.0, 9.0], 180.0),
        vec![
            0.0,
            1.0,
            0.5,
            2.0 / 3.0,
            (7.0 - r) / 14.0,
            (7.0 + r) / 14.0,
            1.0,
        ],
    )
}

/// Gragg, Bulirsch and Stoer: modified midpoint rules of 2, 4, 6, ... substeps, extrapolated to substep
/// zero; the order is twice their number. With the order fixed it is an explicit Runge-Kutta method.
fn extrapolation(rules: usize) -> &'static Tableau {
    let (mut a, mut c) = (vec![vec![]], vec![0.0]);
    let mut b = vec![0.0; 1 + rules * rules];
    for k in 1..=rules {
        let n = 2 * k;
        let h = 1.0 / n as f64;
        let first = a.len();
        // Stages y_1 .. y_(n-1); y_i = y_(i-2) + 2 h f(y_(i-1)) reaches y_n, the rule's result.
        let mut points: Vec<Vec<f64>> = vec![vec![], vec![h]];
        for i in 2..=n {
            let mut point = points[i - 2].clone();
            point.resize(first + i - 1, 0.0);
            point[first + i - 2] += 2.0 * h;
            points.push(point);
        }
        for (i, point) in points[1..n].iter().enumerate() {
            let mut row = point.clone();
            row.resize(first + i, 0.0);
            a.push(row);
            c.push((i + 1) as f64 * h);
        }
        let square = |k: usize| (2 * k * 2 * k) as f64;
        let others = (1..=rules).filter(|other| *other != k);
        let weight: f64 = others
            .map(|other| square(k) / (square(k) - square(other)))
            .product();
        for (b, share) in b.iter_mut().zip(&points[n]) {
            *b += weight * share;
        }
    }
    keep(a, b, c)
}

/// One method's results on one motion.
struct Curve {
    name: &'static str,
    stages: usize,
    /// Step \[s\] and what it gave.
    runs: Vec<(f64, Run, f64)>,
}

fn measure(model: &Model, motion: &Motion, methods: &[(&'static str, &'static Tableau)]) {
    let finest = |tableau, dt| run(model, motion, tableau, dt, motion.compared_at).attitude;
    let converged = finest(&Tableau::DOP8, 1e-3);
    let doubt = converged.angle_to(&finest(extrapolation(4), 1e-3));
    println!(
        "\n{} motion: attitude compared at {} s with DOP8 at 1 ms, which is known to {doubt:.0e} rad\n",
        motion.name, motion.compared_at
    );
    println!(
        "| method | step [ms] | evaluations / s | time / s [us] | energy drift | attitude error [rad] |"
    );
    println!("| --- | ---: | ---: | ---: | ---: | ---: |");
    let mut curves = Vec::new();
    for &(name, tableau) in methods {
        let stages = tableau.c.len();
        let mut runs = Vec::new();
        for dt in STEPS {
            let run = run(model, motion, tableau, dt, SECONDS);
            let error = run.attitude.angle_to(&converged);
            println!(
                "| {name} | {} | {:.0} | {:.0} | {:.1e} | {error:.1e} |",
                dt * 1e3,
                stages as f64 / dt,
                run.cost * 1e6,
                run.drift
            );
            runs.push((dt, run, error));
        }
        curves.push(Curve { name, stages, runs });
    }
    draw(motion, &curves);
}

fn draw(motion: &Motion, curves: &[Curve]) {
    let Some(stem) = std::env::args().skip(1).find(|a| !a.starts_with('-')) else {
        return;
    };
    let panel = |y_label: &str, value: fn(&Run, f64) -> f64| Panel {
        y_label: y_label.to_owned(),
        series: (curves.iter())
            .map(|curve| Series {
                name: curve.name.to_owned(),
                points: (curve.runs.iter().rev())
                    .map(|(dt, run, error)| {
                        ((curve.stages as f64 / dt).log10(), value(run, *error))
                    })
                    .collect(),
            })
            .collect(),
        log: true,
        ..Panel::default()
    };
    let figure = Figure {
        title: format!("{SECONDS} s of {} free motion", motion.name),
        x_label: "log10 of evaluations per simulated second".to_owned(),
        panels: vec![
            panel("energy drift |dE/E|", |run, _| run.drift),
            panel("attitude error [rad]", |_, error| error),
        ],
        ..Figure::default()
    };
    let stem = format!("{stem}-{}", motion.name);
    match figure.save(std::path::Path::new(&stem)) {
        Ok(_) => eprintln!("drew {stem}.svg"),
        Err(e) => eprintln!("{e}"),
    }
}

fn main() {
    let xml = include_str!("../urdf/servicer.urdf");
    let model = Model::from_urdf(xml, "urdf/servicer.urdf").expect("a robot of the repository");
    let methods = [
        ("RK4", IntegrationMethod::Rk4.tableau()),
        ("Luther, order 6", luther()),
        ("DOP8", IntegrationMethod::Dop8.tableau()),
        ("extrapolation, order 8", extrapolation(4)),
        ("extrapolation, order 10", extrapolation(5)),
    ];
    for (name, tableau) in methods {
        for (row, c) in tableau.a.iter().zip(tableau.c) {
            let sum: f64 = row.iter().sum();
            assert!((sum - c).abs() < 1e-13, "{name}: {sum} is not {c}");
        }
        assert!(
            (tableau.b.iter().sum::<f64>() - 1.0).abs() < 1e-13,
            "{name}"
        );
    }
    for motion in &MOTIONS {
        measure(&model, motion, &methods);
    }
}
