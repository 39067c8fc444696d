//! `fuyu modes`: vibration of a scenario's robot, and zeros of its attitude control.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;

use super::joint_values::{self, JointValues};
use super::{Failure, print};
use crate::dynamics::flexible::{FlexibleSystem, LinearModel};
use crate::nodes::{attitude::AttitudeLoop, dynamics::World, scenario::Scenario};
use crate::structures::{Appendage, StructureError, frequencies_hz};

/// Vibration of the robot of a scenario: frequencies, damping, participation, transmission zeros
///
/// Prints the modes of each appendage with its root held, the frequencies of the robot with its base free and its
/// joints and wheels locked, the transmission zeros from three torques on the base to its attitude, and the poles with
/// the attitude law, if the scenario has one. Participation is the force and torque that a mode exerts on its root for
/// a unit acceleration of its coordinate, about the attachment in the appendage's axes.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scenario: a ROS 2 parameter file
    #[arg(value_name = "SCENARIO")]
    scenario: String,
    /// Joint positions [rad or m]: 0.5,-1,0 for all joints, or elbow=0.5,wrist=-1 for some and zero for the others;
    /// default: those of the scenario
    #[arg(long, value_name = "A,B,.. or NAME=A,..", allow_hyphen_values = true)]
    q: Option<JointValues>,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// Output of `--json`.
#[derive(Debug, Serialize)]
struct Report {
    /// Modes of the appendages by name.
    appendages: BTreeMap<String, AppendageModes>,
    /// Frequencies with the base free and joints and wheels locked, undamped, ascending \[Hz\].
    frequencies: Vec<f64>,
    /// Transmission zeros from three torques on the base to its attitude \[Hz\], ascending.
    zeros: Vec<f64>,
    /// Poles of the attitude loop with the scenario's law, in continuous time with joints locked: real and imaginary
    /// part \[rad/s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    poles: Option<Vec<[f64; 2]>>,
}

/// Modes of an appendage with its attachment held, each value in the order of `modes`.
#[derive(Debug, Serialize)]
struct AppendageModes {
    /// Names of the modes.
    modes: Vec<String>,
    /// Frequencies \[Hz\].
    frequencies: Vec<f64>,
    /// Damping ratios.
    damping: Vec<f64>,
    /// Force x, y, z and torque x, y, z for each mode.
    participation: Vec<[f64; 6]>,
}

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] for an invalid scenario, a robot without appendages, or invalid joint positions.
pub fn run(args: &Args) -> Result<(), Failure> {
    let scenario = Scenario::read(&args.scenario).map_err(Failure::Input)?;
    let at = |e: String| Failure::Input(format!("{}: {e}", scenario.path().display()));
    let params = scenario.dynamics().map_err(Failure::Input)?;
    let world = World::new(&params).map_err(at)?;
    let robot = world
        .robot
        .flexible()
        .filter(|robot| robot.system().modes() > 0);
    let Some(robot) = robot else {
        return Err(at(
            "the robot has no appendage with modes; give the dynamics node the parameter appendages"
                .to_owned(),
        ));
    };
    let system = robot.system();
    let q = match &args.q {
        Some(_) => joint_values::vector("--q", args.q.as_ref(), system.model())?,
        None => robot.state().tree.q.clone(),
    };
    let report = Report::new(system, &LinearModel::new(system, &q));
    let mut report = report.map_err(|e| at(e.to_string()))?;
    if scenario.has("attitude") {
        let params = scenario.attitude().map_err(Failure::Input)?;
        let mut attitude = AttitudeLoop::new(&params, system.model()).map_err(at)?;
        let poles = attitude.poles(q.as_slice()).map_err(at)?;
        report.poles = Some(poles.iter().map(|p| [p.re, p.im]).collect());
    }
    if args.json {
        let json = serde_json::to_string(&report);
        return print(&(json.map_err(|e| Failure::Runtime(e.to_string()))? + "\n"));
    }
    print(&report.for_people())
}

impl Report {
    fn new(system: &FlexibleSystem, linear: &LinearModel) -> Result<Self, StructureError> {
        let appendages = system.modal_bodies().iter().map(|body| {
            let modes = AppendageModes::new(&body.appendage)?;
            Ok((body.name().to_owned(), modes))
        });
        let hybrid = linear.hybrid()?;
        let mut zeros = frequencies_hz(&hybrid.held(&[3, 4, 5])?.poles()?);
        zeros.sort_by(f64::total_cmp);
        Ok(Self {
            appendages: appendages.collect::<Result<_, _>>()?,
            frequencies: linear.frequencies_hz(&linear.base_and_modes())?,
            zeros,
            poles: None,
        })
    }

    fn for_people(&self) -> String {
        let mut out = String::new();
        for (name, body) in &self.appendages {
            let head = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"].map(|axis| format!("{axis:>9}"));
            // Writing to a string cannot fail.
            let _ = writeln!(
                out,
                "{name:<16}{:>12}{:>9}  {}",
                "Hz, root held",
                "damping",
                head.concat()
            );
            for (k, mode) in body.modes.iter().enumerate() {
                let row = body.participation[k].map(|p| format!("{p:>9.3}"));
                let _ = writeln!(
                    out,
                    "  {mode:<14}{:>13.6}{:>9.4}  {}",
                    body.frequencies[k],
                    body.damping[k],
                    row.concat()
                );
            }
        }
        for (label, values) in [
            ("base free, joints locked [Hz]", &self.frequencies),
            ("zeros, base torques to attitude", &self.zeros),
        ] {
            let values: Vec<_> = values.iter().map(|f| format!("{f:.6}")).collect();
            let _ = writeln!(out, "{label:<32}{}", values.join("  "));
        }
        for [re, im] in self.poles.iter().flatten().filter(|[_, im]| *im >= 0.0) {
            let pole = match *im > 0.0 {
                true => format!("{re:.6} ± {im:.6}i"),
                false => format!("{re:.6}"),
            };
            let _ = writeln!(out, "{:<32}{pole}", "pole of the attitude loop [rad/s]");
        }
        out
    }
}

impl AppendageModes {
    fn new(appendage: &Appendage) -> Result<Self, StructureError> {
        let is_diagonal = [&appendage.modal_mass, &appendage.modal_stiffness]
            .iter()
            .all(|m| m.iter().filter(|x| **x != 0.0).count() == m.nrows());
        let body = match is_diagonal {
            true => appendage.clone(),
            false => appendage.diagonalised()?,
        };
        let (P, n) = (body.coupling(), body.modes());
        let of_mode = |k: usize| {
            let (m, c, stiffness) = (
                body.modal_mass[(k, k)],
                body.modal_damping[(k, k)],
                body.modal_stiffness[(k, k)],
            );
            let w = (stiffness / m).sqrt();
            let participation: [f64; 6] = std::array::from_fn(|j| P[(k, j)] / m.sqrt());
            (w / std::f64::consts::TAU, c / (2.0 * m * w), participation)
        };
        let modes: Vec<_> = (0..n).map(of_mode).collect();
        Ok(Self {
            modes: body.mode_names.clone(),
            frequencies: modes.iter().map(|mode| mode.0).collect(),
            damping: modes.iter().map(|mode| mode.1).collect(),
            participation: modes.iter().map(|mode| mode.2).collect(),
        })
    }
}
