//! Run time of fuyu's dynamics compared with Pinocchio's and MuJoCo's, interleaved in one run:
//!
//! ```sh
//! scripts/bench-peers.sh                                # once: installs and compiles the peers
//! cargo bench --bench peers                             # the tables of docs/performance.md
//! cargo bench --bench peers -- servicer                 # only robots with this word in their name
//! cargo bench --bench peers -- --draw docs/img/links    # and the picture
//! ```
//!
//! Without the peers only fuyu is measured. Before anything is timed, all programs must give the same results.

#[cfg(feature = "batch")]
mod many;
mod measure;
mod ours;
mod peer;
mod report;
mod robots;

use fuyu::dynamics::{InstructionSets, IntegrationMethod};
use measure::{Runner, Times, measure};
use peer::Peer;
use robots::{Moving, Robot};

/// States that every kernel cycles through.
const STATES: usize = 16;

/// Largest difference between programs, relative to the largest number of a result. Those that solve a dense system
/// lose digits with the number of links: some 1e-9 at 300, 2e-8 at 1000.
fn agreement(links: usize) -> f64 {
    if links <= 300 { 1e-9 } else { 1e-7 }
}

/// Whose program it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Maker {
    Fuyu,
    Pinocchio,
    Mujoco,
}

/// One program's cost of one kernel.
struct Measured {
    maker: Maker,
    /// Formulation, or compiler and convention.
    variant: String,
    times: Times,
    /// Largest relative error over the states.
    error: Option<f64>,
}

/// A kernel of one robot, all programs.
struct Row {
    robot: String,
    links: usize,
    kernel: Kernel,
    measured: Vec<Measured>,
}

/// What is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kernel {
    Forward,
    Jacobian,
    Rk4,
    ForwardOfMany,
    Rk4OfMany,
}

impl Kernel {
    const ALL: [Self; 5] = [
        Self::Forward,
        Self::Jacobian,
        Self::Rk4,
        Self::ForwardOfMany,
        Self::Rk4OfMany,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Forward => "forward dynamics",
            Self::Jacobian => "generalized Jacobian, momentum map",
            Self::Rk4 => "RK4 step",
            Self::ForwardOfMany => "joint accelerations, of a batch",
            Self::Rk4OfMany => "RK4 step, of a batch",
        }
    }

    /// Names of the variants in the programs of Pinocchio and MuJoCo.
    fn of_peer(self, maker: Maker) -> &'static [&'static str] {
        match (self, maker) {
            (Self::Forward | Self::ForwardOfMany, Maker::Pinocchio) => {
                &["forward_local", "forward_world"]
            }
            (Self::Jacobian, Maker::Pinocchio) => &["jacobian"],
            (Self::Rk4 | Self::Rk4OfMany, Maker::Pinocchio) => &["rk4_local", "rk4_world"],
            (Self::Forward | Self::ForwardOfMany, Maker::Mujoco) => &["forward", "forward_parts"],
            (Self::Rk4 | Self::Rk4OfMany, Maker::Mujoco) => &["rk4"],
            _ => &[],
        }
    }

    fn ours(self, robot: &Robot) -> Vec<(&'static str, Box<dyn ours::Program + '_>)> {
        match self {
            Self::Forward => ours::forward(&robot.model),
            Self::Jacobian => vec![("", ours::jacobian(robot))],
            Self::Rk4 => vec![("", ours::step(&robot.model, IntegrationMethod::Rk4, false))],
            #[cfg(feature = "batch")]
            Self::ForwardOfMany | Self::Rk4OfMany => {
                let task = match self {
                    Self::ForwardOfMany => many::Task::Accelerate,
                    _ => many::Task::Step,
                };
                vec![("", Box::new(many::Many::new(&robot.model, task)))]
            }
            #[cfg(not(feature = "batch"))]
            Self::ForwardOfMany | Self::Rk4OfMany => Vec::new(),
        }
    }
}

/// Largest difference, relative to the largest number. One result may lack the first entries of the other: the base.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len());
    assert!(n > 0, "no answer");
    let (a, b) = (&a[a.len() - n..], &b[b.len() - n..]);
    let scale = b.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs() / scale);
    // NaN counts as a difference.
    differences.fold(0.0, |m, d| if d <= m { m } else { d })
}

/// Measures one kernel of a robot that the peers have loaded.
fn row(robot: &Robot, states: &[Moving], kernel: Kernel, peers: &[Peer], exact: &[Peer]) -> Row {
    let (mut names, mut runners) = (Vec::new(), Vec::new());
    for (variant, program) in kernel.ours(robot) {
        names.push((Maker::Fuyu, variant.to_owned()));
        runners.push(Runner::Ours(program));
    }
    for peer in peers {
        let name = peer.name();
        let (maker, compiler) = match name.strip_prefix("pinocchio-") {
            Some(compiler) => (Maker::Pinocchio, compiler),
            None => (Maker::Mujoco, ""),
        };
        for &kernel in kernel.of_peer(maker) {
            let variant = format!("{compiler} {}", kernel.replace('_', " "));
            names.push((maker, variant.trim().to_owned()));
            runners.push(Runner::Peer { peer, kernel });
        }
    }
    let mut errors = vec![None; runners.len()];
    for index in 0..states.len() {
        let first = runners[0].answer(states, index);
        let reference = exact.first().map(|p| p.ask("forward_local", index));
        for ((runner, name), error) in runners.iter_mut().zip(&names).zip(&mut errors) {
            let answer = runner.answer(states, index);
            let apart = difference(&answer, &first);
            assert!(
                apart <= agreement(robot.model.dof()),
                "{}, {}, state {index}: {name:?} is {apart:.1e} apart from fuyu",
                robot.name,
                kernel.name()
            );
            if let (Kernel::Forward, Some(reference)) = (kernel, &reference) {
                let worst = error.unwrap_or(0.0);
                *error = Some(difference(&answer, reference).max(worst));
            }
        }
    }
    let times = measure(&mut runners, states);
    let measured = names.into_iter().zip(times).zip(errors);
    Row {
        robot: robot.name.clone(),
        links: robot.model.dof(),
        kernel,
        measured: measured
            .map(|(((maker, variant), times), error)| Measured {
                maker,
                variant,
                times,
                error,
            })
            .collect(),
    }
}

/// Kernels that only fuyu has.
fn alone(robot: &Robot, states: &[Moving]) -> Vec<(&'static str, f64)> {
    let programs = [
        ("reduced inertia", ours::reduced_inertia(&robot.model)),
        ("transpose-Jacobian control law", ours::control_law(robot)),
        (
            "RK4 step, the workspace read after each",
            ours::step(&robot.model, IntegrationMethod::Rk4, true),
        ),
        (
            "order-8 step (`dop8`)",
            ours::step(&robot.model, IntegrationMethod::Dop8, false),
        ),
    ];
    let mut runners = Vec::new();
    let mut names = Vec::new();
    for (name, program) in programs {
        names.push(name);
        runners.push(Runner::Ours(program));
    }
    let times = measure(&mut runners, states);
    let medians = times.iter().map(Times::median);
    names.into_iter().zip(medians).collect()
}

fn main() {
    let mut words = Vec::new();
    let mut picture = None;
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--draw" => picture = arguments.next(),
            option if option.starts_with('-') => {}
            _ => words.push(argument),
        }
    }
    let peers = Peer::installed(&["pinocchio-clang", "pinocchio-gcc", "mujoco"]);
    let exact = Peer::installed(&["pinocchio-long-double"]);
    if peers.is_empty() || exact.is_empty() {
        eprintln!("scripts/bench-peers.sh installs what to compare with; this is fuyu alone");
    }
    println!(
        "fuyu's instruction sets: {}\n",
        InstructionSets::of_this_processor()
    );
    let (mut rows, mut alone_rows) = (Vec::new(), Vec::new());
    for robot in robots::robots() {
        if !words.is_empty() && !words.iter().any(|w| robot.name.contains(w.as_str())) {
            continue;
        }
        eprintln!("{}", robot.name);
        let states = robots::states(&robot.model, STATES);
        for peer in peers.iter().chain(&exact) {
            peer.load(&robot, &states);
        }
        for kernel in Kernel::ALL {
            if kernel.ours(&robot).is_empty() {
                continue;
            }
            rows.push(row(&robot, &states, kernel, &peers, &exact));
        }
        if robot.model.dof() <= 30 {
            alone_rows.push((robot.name.clone(), alone(&robot, &states)));
        }
    }
    report::comparison(&rows);
    report::formulations(&rows);
    report::growth(&rows);
    report::alone(&alone_rows);
    if let Some(stem) = picture {
        report::draw(&rows, &stem);
    }
}
