//! `fuyu estimate`: motion of a tumbling body from a recording.

use std::{fmt::Write as _, path::PathBuf};

use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;

use super::{Failure, print};
use crate::{
    estimation::{
        Estimated, EstimationMethod, Tracks,
        bundle::{self, CameraMotion},
        estimate, from_rates,
    },
    experiments::{Observations, ObservedTracks},
    spatial::unwound,
    vision::Pinhole,
};

/// Estimate and predict the motion of a tumbling body from a recording
///
/// INPUT is a bag with `camera/features`, or a CSV table whose first line names its columns: t,id,u,v (feature
/// tracks: s, a whole number, px with pixel centres at integers) or t,wx,wy,wz (angular velocity in the camera's
/// axes: s, rad/s). All results are in the camera's axes at the last frame.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Bag (folder or .mcap file) or CSV file
    #[arg(value_name = "INPUT")]
    input: PathBuf,
    /// bundle (default for tracks) or masutani1995 (the only one for angular velocity)
    #[arg(long, value_name = "METHOD", value_parser = method)]
    method: Option<EstimationMethod>,
    /// Focal length along rows [px]; a bag has it in camera/camera_info
    #[arg(long, value_name = "PX")]
    fx: Option<f64>,
    /// Focal length along columns [px]
    #[arg(long, value_name = "PX")]
    fy: Option<f64>,
    /// Column of the optical axis [px]
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    cx: Option<f64>,
    /// Row of the optical axis [px]
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    cy: Option<f64>,
    /// Estimate the focal length as well, starting from the given one (bundle)
    #[arg(long)]
    focal_length: bool,
    /// Standard deviation of an image coordinate [px] (bundle)
    #[arg(long, value_name = "PX", default_value_t = 0.3, value_parser = super::positive)]
    pixel_noise: f64,
    /// Length of the prediction after the last frame [s]
    #[arg(long, value_name = "S", default_value_t = 30.0, value_parser = super::positive_seconds)]
    predict: f64,
    /// Attitudes per second of the prediction [Hz]
    #[arg(long, value_name = "HZ", default_value_t = 10.0, value_parser = super::positive)]
    predict_rate: f64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

fn method(name: &str) -> Result<EstimationMethod, String> {
    let found = EstimationMethod::NAMES
        .iter()
        .find(|(known, _)| *known == name);
    found.map(|(_, method)| *method).ok_or_else(|| {
        let names: Vec<_> = EstimationMethod::NAMES
            .iter()
            .map(|(name, _)| *name)
            .collect();
        format!("available methods are {}", names.join(" and "))
    })
}

/// Largest number of attitudes in a prediction.
const MAX_PREDICTED: f64 = 1e6;

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] if the input cannot be read, or is not a recording of a rotating body.
pub fn run(args: &Args) -> Result<(), Failure> {
    if args.predict * args.predict_rate > MAX_PREDICTED {
        return Err(Failure::Input(format!(
            "--predict {} with --predict-rate {} are more than {MAX_PREDICTED:.0} attitudes; lower one of them",
            args.predict, args.predict_rate
        )));
    }
    let observations = Observations::read(&args.input).map_err(Failure::Input)?;
    let found = match &observations {
        Observations::Tracks(observed) => from_tracks(args, observed)?,
        Observations::AngularVelocity(rates) => {
            if args.method == Some(EstimationMethod::Bundle) {
                return Err(input(
                    args,
                    "--method bundle needs feature tracks; for angular velocity use --method masutani1995",
                ));
            }
            let estimated = from_rates(rates).map_err(|e| input(args, e))?;
            Found {
                estimated,
                end: rates.last().map_or(0.0, |(t, _)| *t),
                R_IC: UnitQuaternion::identity(),
                input: format!("{} angular velocities", rates.len()),
                unit: "rad/s",
            }
        }
    };
    let report = Report::new(&found, args);
    if !args.json {
        return print(&found.to_text(&report));
    }
    for note in &found.estimated.diagnosis {
        eprintln!("fuyu: note: {note}");
    }
    let json = serde_json::to_string(&report);
    print(&(json.map_err(|e| Failure::Runtime(e.to_string()))? + "\n"))
}

fn input(args: &Args, problem: impl std::fmt::Display) -> Failure {
    Failure::Input(format!("{}: {problem}", args.input.display()))
}

/// An estimate, with the camera's attitude and a description of the input.
struct Found {
    estimated: Estimated,
    /// Time of the last observation \[s\].
    end: f64,
    /// Attitude of the camera at that time in the inertial axes of the estimate.
    R_IC: UnitQuaternion<f64>,
    input: String,
    /// Unit of the residual.
    unit: &'static str,
}

fn from_tracks(args: &Args, observed: &ObservedTracks) -> Result<Found, Failure> {
    let camera = camera(args, observed.camera)?;
    let method = args.method.unwrap_or_default();
    let tracks = &observed.tracks;
    let options = bundle::Options {
        pixel_noise: args.pixel_noise,
        estimate_focal_length: args.focal_length,
        camera_motion: match observed.w_WC_C.as_slice() {
            [] => CameraMotion::Fixed,
            rates => CameraMotion::Rates(rates.to_vec()),
        },
        ..bundle::Options::default()
    };
    let estimated = estimate(method, tracks, &camera, &options).map_err(|e| input(args, e))?;
    let (start, end) = tracks.span().unwrap_or_default();
    Ok(Found {
        end,
        R_IC: options.camera_motion.lookup()(end),
        input: describe(tracks, end - start, observed.w_WC_C.is_empty()),
        unit: match method {
            EstimationMethod::Bundle => "px",
            EstimationMethod::Masutani1995 => "rad/s",
        },
        estimated,
    })
}

fn describe(tracks: &Tracks, duration: f64, at_rest: bool) -> String {
    let frames = tracks.frames();
    let features: usize = frames.iter().map(|s| s.features.len()).sum();
    let camera = match at_rest {
        true => "assumed not to rotate",
        false => "rotation removed with the gyro",
    };
    format!(
        "{} frames over {duration:.1} s, {:.1} features each; camera {camera}",
        frames.len(),
        features as f64 / frames.len().max(1) as f64
    )
}

/// The recording's calibration, with the values given as arguments instead of its own.
fn camera(args: &Args, recorded: Option<Pinhole>) -> Result<Pinhole, Failure> {
    let missing = |name: &str| {
        input(
            args,
            format!(
                "contains no camera calibration: give --{name} [px], and all four of --fx --fy --cx --cy"
            ),
        )
    };
    let one = |given: Option<f64>, of: fn(&Pinhole) -> f64, name: &str| {
        (given.or_else(|| recorded.as_ref().map(of))).ok_or_else(|| missing(name))
    };
    let camera = Pinhole {
        fx: one(args.fx, |c| c.fx, "fx")?,
        fy: one(args.fy, |c| c.fy, "fy")?,
        cx: one(args.cx, |c| c.cx, "cx")?,
        cy: one(args.cy, |c| c.cy, "cy")?,
    };
    camera.check().map_err(|e| Failure::Input(e.to_string()))?;
    Ok(camera)
}

/// Output of `--json`.
#[derive(Serialize)]
#[allow(non_snake_case)]
struct Report {
    method: &'static str,
    model: &'static str,
    J: Option<[f64; 3]>,
    alpha: f64,
    angular_velocity: Vec<RateOutput>,
    prediction: Vec<AttitudeOutput>,
    rms: f64,
    covariance: Option<[[f64; 4]; 4]>,
    focal_length: Option<f64>,
    axes_time: f64,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct RateOutput {
    t: f64,
    w: [f64; 3],
}

#[derive(Serialize)]
struct AttitudeOutput {
    t: f64,
    /// x, y, z, w.
    q: [f64; 4],
}

impl Report {
    fn new(found: &Found, args: &Args) -> Self {
        let (estimated, R_CI) = (&found.estimated, found.R_IC.inverse());
        let motion = &estimated.motion;
        let steps = (args.predict * args.predict_rate + 1e-9).floor() as u32;
        let time = |k: u32| found.end + f64::from(k) / args.predict_rate;
        let attitudes = (0..=steps).map(|k| estimated.seen_from(&found.R_IC, time(k)).0);
        let prediction = (0..).zip(unwound(attitudes)).map(|(k, q)| AttitudeOutput {
            t: time(k),
            q: [q.i, q.j, q.k, q.w],
        });
        let rates = estimated.w_IB_I.iter();
        Self {
            method: estimated.method.name(),
            model: motion.model().name(),
            J: motion.J().map(Into::into),
            alpha: motion.alpha(),
            angular_velocity: rates
                .map(|(t, w)| RateOutput {
                    t: *t,
                    w: (R_CI * w).into(),
                })
                .collect(),
            prediction: prediction.collect(),
            rms: motion.rms(),
            covariance: motion.covariance().map(|c| c.transpose().into()),
            focal_length: (args.focal_length)
                .then(|| estimated.solution.as_ref().map(|s| s.camera.fx))
                .flatten(),
            axes_time: found.end,
            notes: estimated.diagnosis.clone(),
        }
    }
}

impl Found {
    fn to_text(&self, report: &Report) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let mut row = |label: &str, value: String| {
            let _ = writeln!(out, "{label:<28}{value}");
        };
        row("input", self.input.clone());
        row("method", report.method.to_owned());
        row("model", report.model.replace('_', " "));
        let triple = |v: &[f64; 3]| format!("{:.6}  {:.6}  {:.6}", v[0], v[1], v[2]);
        let deviations = report
            .covariance
            .map(|c| [0, 1, 2, 3].map(|i| c[i][i].sqrt()));
        let spread = |d: &[f64]| {
            let d: Vec<_> = d.iter().map(|d| format!("{d:.1e}")).collect();
            format!("  +- {}", d.join("  "))
        };
        let J = (report.J.as_ref()).map_or("not determined by this motion".to_owned(), triple);
        let uncertainty = deviations.map_or_else(String::new, |d| spread(&d[..3]));
        row("J [s2]", J + &uncertainty);
        let uncertainty = deviations.map_or_else(String::new, |d| spread(&d[3..]));
        row("alpha [s2]", format!("{:.6}{uncertainty}", report.alpha));
        let w: Vector3<f64> = self.estimated.seen_from(&self.R_IC, self.end).1;
        row(
            "angular velocity [rad/s]",
            format!("{} at {:.3} s", triple(&w.into()), self.end),
        );
        let n = self.R_IC.inverse() * self.estimated.motion.momentum_direction();
        row("momentum direction", triple(&n.into_inner().into()));
        row("residual", format!("{:.4} {} rms", report.rms, self.unit));
        if let Some(focal) = report.focal_length {
            row("focal length [px]", format!("{focal:.2}"));
        }
        if let (Some(first), Some(last)) = (report.prediction.first(), report.prediction.last()) {
            row(
                "predicted",
                format!(
                    "{:.1} s to {:.1} s; --json has the attitudes",
                    first.t, last.t
                ),
            );
        }
        for note in &report.notes {
            row("note", note.clone());
        }
        out
    }
}
