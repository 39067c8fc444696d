//! Plots of a recorded run: `fuyu bag plot`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::chart::{ChartError, Figure, Panel, Series};
use super::estimation_plot::{Mount, herpolhode, prediction_error, squared_rates};
use super::recorded::{RecordedRun, RecordedRuns, seconds_since};
use super::recorded_estimation::RecordedEstimation;
use super::recorded_mission::mission_figure;
use super::recorded_names::title_of;
use super::recorded_physics::{Residual, momentum_residuals};
use super::recorded_runs::RunCounter;
use crate::bag::{Bag, Message};
use crate::model::JointKind;
use crate::nodes::estimator::StaticRotations;
use crate::spatial::roll_pitch_yaw_intrinsic;

/// Residuals of exactly zero are drawn at this value on a logarithmic axis, below all rounding errors.
const RESIDUAL_FLOOR: f64 = 1e-17;

/// Draws every plot for which the bag has data into `folder`. Returns the paths; empty without data.
///
/// # Errors
/// [`ChartError`] if a file cannot be written.
pub fn plot_bag(bag: &Bag, folder: &Path) -> Result<Vec<PathBuf>, ChartError> {
    let mut runs = RecordedRuns::default();
    let mut estimations = Estimations::default();
    bag.messages().for_each(|m| {
        runs.accept(&m);
        estimations.accept(&m);
    });
    let mut paths = Vec::new();
    for (namespace, runs) in runs.robot_runs() {
        for (i, run) in runs.iter().enumerate() {
            let place = Place::new(namespace, i, runs.len());
            let pictures = [
                ("tip_error", tip_error(run)),
                ("base_attitude", base_motion(run)),
                ("momentum_residual", momentum(run)),
                ("joint_rates", joint_rates(run)),
                ("mission", mission_figure(run)),
            ];
            for (name, figure) in pictures {
                let Some(mut figure) = figure else { continue };
                let stem = place.entitle(name, &mut figure.title);
                paths.extend(figure.save(&folder.join(stem))?);
            }
        }
    }
    for (place, estimation) in estimations.places() {
        let start = estimations.start(estimation);
        let mount = estimations.mount(estimation);
        if let Some(mut figure) = squared_rates(estimation, start) {
            let stem = place.entitle("target_squared_rate", &mut figure.title);
            paths.extend(figure.save(&folder.join(stem))?);
        }
        if let Some(mut figure) = herpolhode(estimation, mount) {
            let stem = place.entitle("herpolhode", &mut figure.title);
            paths.extend(figure.save(&folder.join(stem))?);
        }
        for (target, truth) in &estimation.targets {
            let figure = prediction_error(estimation, truth, mount, start);
            let Some(mut figure) = figure else { continue };
            let stem = match estimation.targets.len() {
                1 => "prediction_error".to_owned(),
                // Names of targets may have namespaces.
                _ => format!("{}_prediction_error", target.replace('/', "_")),
            };
            let stem = place.entitle(&stem, &mut figure.title);
            paths.extend(figure.save(&folder.join(stem))?);
        }
    }
    Ok(paths)
}

/// Origin of a plot's data: namespace and, in a bag with several runs, number of the run.
struct Place {
    title: String,
    stem: String,
}

impl Place {
    fn new(namespace: &str, run: usize, runs: usize) -> Self {
        let name = title_of(namespace);
        let robot = name.replace('/', "_");
        let (mut title, mut stem) = (String::new(), String::new());
        if !robot.is_empty() {
            title = format!("{name}: ");
            stem = format!("{robot}_");
        }
        if runs > 1 {
            title += &format!("run {}: ", run + 1);
            stem += &format!("run{}_", run + 1);
        }
        Self { title, stem }
    }

    /// Returns the stem of a plot's file names, and adds namespace and run to the title.
    fn entitle(&self, name: &str, title: &mut String) -> String {
        title.insert_str(0, &self.title);
        format!("{}{name}", self.stem)
    }
}

/// Estimates by namespace and run, and the static transforms.
#[derive(Default)]
struct Estimations {
    robots: BTreeMap<String, Vec<RecordedEstimation>>,
    frames: StaticRotations,
    counter: RunCounter,
}

impl Estimations {
    fn accept(&mut self, message: &Message) {
        if message.topic.name.ends_with("/tf_static") {
            if let Ok(frames) = message.decode() {
                // A transform with an invalid rotation is ignored.
                let _ = self.frames.take(frames);
            }
            return;
        }
        let (robots, run) = (&mut self.robots, self.counter.run_of(message));
        RecordedEstimation::accept(message, |namespace| {
            let runs = robots.entry(namespace.to_owned()).or_default();
            runs.resize_with(runs.len().max(run + 1), Default::default);
            &mut runs[run]
        });
    }

    /// Namespaces and runs with estimates.
    fn places(&self) -> impl Iterator<Item = (Place, &RecordedEstimation)> {
        self.robots.iter().flat_map(|(namespace, runs)| {
            let place = |i| Place::new(namespace, i, runs.len());
            let runs = runs.iter().enumerate().filter(|(_, run)| !run.is_empty());
            runs.map(move |(i, run)| (place(i), run))
        })
    }

    /// Rotation of the camera relative to the base.
    fn mount(&self, estimation: &RecordedEstimation) -> Mount {
        let (base, camera) = (&estimation.base_frame, &estimation.camera_frame);
        self.frames.rotation(base, camera)
    }

    /// The earliest stamp \[ns\].
    fn start(&self, estimation: &RecordedEstimation) -> i64 {
        let truth = estimation.targets.values().filter_map(|t| t.first());
        let times = truth.map(|t| t.time);
        let times = times.chain(estimation.base.first().map(|t| t.time));
        let times = times.chain(estimation.rates.first().map(|r| r.0));
        let times = times.chain(estimation.predictions.first().map(|p| p.time));
        times
            .chain(estimation.motions.first().map(|m| m.time))
            .min()
            .unwrap_or(0)
    }
}

fn curve<T>(name: impl Into<String>, samples: &[T], point: impl Fn(&T) -> (f64, f64)) -> Series {
    Series {
        name: name.into(),
        points: samples.iter().map(point).collect(),
    }
}

fn tip_error(run: &RecordedRun) -> Option<Figure> {
    let start = run.start();
    let samples = &run.controller;
    let time = |s: &super::ControllerSample| seconds_since(start, s.time);
    Figure::over_time(
        "Tip error",
        vec![
            Panel {
                y_label: "position error [m]".into(),
                series: vec![curve("position", samples, |s| (time(s), s.position_error))],
                log: true,
                marks: vec![(0.01, "1 cm".into())],
                ..Panel::default()
            },
            Panel {
                y_label: "attitude error [deg]".into(),
                series: vec![curve("attitude", samples, |s| {
                    (time(s), s.attitude_error.to_degrees())
                })],
                log: true,
                marks: vec![(2.0, "2 deg".into())],
                ..Panel::default()
            },
        ],
    )
}

fn base_motion(run: &RecordedRun) -> Option<Figure> {
    let start = run.start();
    let time = |b: &super::BaseSample| seconds_since(start, b.time);
    let first = run.base_com(run.base.first()?);
    let angle = |name: &str, k: usize| {
        curve(name, &run.base, |b| {
            let angles = roll_pitch_yaw_intrinsic(&b.X_WB.rotation.to_rotation_matrix());
            (time(b), angles[k].to_degrees())
        })
    };
    let shift = |name: &str, k: usize| {
        curve(name, &run.base, |b| {
            (time(b), run.base_com(b)[k] - first[k])
        })
    };
    Figure::over_time(
        "Base drift",
        vec![
            Panel {
                y_label: "attitude [deg]".into(),
                series: vec![angle("roll", 0), angle("pitch", 1), angle("yaw", 2)],
                ..Panel::default()
            },
            Panel {
                y_label: "displacement [m]".into(),
                series: vec![shift("x", 0), shift("y", 1), shift("z", 2)],
                ..Panel::default()
            },
        ],
    )
}

fn momentum(run: &RecordedRun) -> Option<Figure> {
    let start = run.start();
    let residuals = momentum_residuals(run)?;
    let panel = |name: &str, r: &Residual, unit: &str| Panel {
        y_label: format!("change of {name} [-]"),
        series: vec![curve(
            format!("relative to {:.1} {unit}", r.scale),
            &r.values,
            |(t, v)| (seconds_since(start, *t), v.max(RESIDUAL_FLOOR)),
        )],
        log: true,
        ..Panel::default()
    };
    Figure::over_time(
        "Momentum residual",
        vec![
            panel("linear momentum", &residuals[0], "N s"),
            panel("angular momentum", &residuals[1], "N m s"),
        ],
    )
}

fn joint_rates(run: &RecordedRun) -> Option<Figure> {
    let start = run.start();
    let slides = |name: &str| match &run.model {
        Some(Ok(model)) => model
            .joint_index(name)
            .is_some_and(|j| model.joints()[j].kind == JointKind::Prismatic),
        _ => false,
    };
    let panel = |label: &str, sliding: bool, value: fn(&super::JointSample) -> &[f64]| Panel {
        y_label: label.into(),
        series: run
            .joint_names
            .iter()
            .enumerate()
            .filter(|(_, name)| slides(name) == sliding)
            .map(|(j, name)| {
                curve(name, &run.joints, |s| {
                    let v = value(s).get(j).copied().unwrap_or(f64::NAN);
                    (seconds_since(start, s.time), v)
                })
            })
            .collect(),
        ..Panel::default()
    };
    let efforts = run.joints.iter().any(|s| !s.effort.is_empty());
    let mut panels = vec![
        panel("rate [rad/s]", false, |s| &s.qd),
        panel("rate [m/s]", true, |s| &s.qd),
    ];
    if efforts {
        panels.push(panel("effort [N m]", false, |s| &s.effort));
        panels.push(panel("effort [N]", true, |s| &s.effort));
    }
    Figure::over_time("Joint rates and efforts", panels)
}
