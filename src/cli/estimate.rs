//! `fuyu estimate`: motion of a tumbling body from a recording.

mod report;

use std::path::PathBuf;

use nalgebra::{UnitQuaternion, Vector3};

use self::report::Report;
use super::{Failure, print};
use crate::{
    estimation::{
        Estimated, EstimationMethod, Tracks,
        bundle::{self, CameraMotion, KnownLength, MeasuredRange, Orbit, Widths},
        estimate, fit_rates, from_rates,
    },
    experiments::{Observations, ObservedTracks, Tracking},
    nodes::tracker::TrackerParams,
    vision::{Distortion, Pinhole},
};

/// Estimate and predict the motion of a tumbling body from a recording
///
/// INPUT is a bag with `camera/features`, or a CSV table whose first line names its columns: t,id,u,v (feature
/// tracks: s, a whole number, px with pixel centres at integers) or t,wx,wy,wz (angular velocity in the camera's
/// axes: s, rad/s). All results are in the camera's axes at the last frame. What disturbs a free rotation before a
/// calibrated camera (torques, errors of gyro and calibration) is estimated as well, with the prior widths that the
/// options give. Clouds of points on `camera/points` of a bag give the scale of lengths.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Bag (folder or .mcap file), CSV file, or with --track a folder of PNG files
    #[arg(value_name = "INPUT")]
    input: PathBuf,
    /// Track points in images: those on camera/image_raw (or its compressed ones) of a bag, or the PNG files of a folder
    #[arg(long)]
    track: bool,
    /// Images per second of a folder of PNG files in order of their names; without it, names are times in seconds, or in
    /// nanoseconds of 16 digits or more
    #[arg(long, value_name = "HZ", requires = "track", value_parser = super::positive)]
    frame_rate: Option<f64>,
    /// Where the target is in the images: a PNG file for all of them, or for a folder of images a folder of PNG files with the same
    /// names; what is not 0 is the target
    #[arg(long, value_name = "PNG", requires = "track")]
    mask: Option<PathBuf>,
    /// Value of the target in --mask, or without --mask in camera/segmentation of a bag
    #[arg(long, value_name = "ID", requires = "track", value_parser = clap::value_parser!(u16).range(1..))]
    mask_id: Option<u16>,
    /// Write the tracked points to a table t,id,u,v, which `fuyu estimate` reads
    #[arg(long, value_name = "CSV", requires = "track")]
    tracks: Option<PathBuf>,
    /// bundle (default for tracks), maximum_likelihood (default for angular velocity) or masutani1995
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
    /// The given focal length is only a start, known to 10 % (the same as --focal-deviation 0.1)
    #[arg(long, conflicts_with = "focal_deviation")]
    focal_length: bool,
    /// Standard deviation of the given focal length, relative to it; 0 if it is exact (bundle)
    #[arg(long, value_name = "SHARE", default_value_t = Widths::default().focal, value_parser = super::not_negative)]
    focal_deviation: f64,
    /// Standard deviation of the given principal point, over the focal length; 0 if it is exact (bundle)
    #[arg(long, value_name = "SHARE", default_value_t = Widths::default().centre, value_parser = super::not_negative)]
    centre_deviation: f64,
    /// Standard deviation of the first radial coefficient of distortion that remains; 0 for none (bundle)
    #[arg(long, value_name = "K1", default_value_t = Widths::default().radial, value_parser = super::not_negative)]
    radial_deviation: f64,
    /// Lens distortion of a table's tracks: plumb_bob or equidistant; a bag has it in camera/camera_info
    #[arg(long, value_name = "MODEL", requires = "distortion")]
    distortion_model: Option<String>,
    /// Its coefficients: k1,k2,p1,p2,k3 or k1,k2,k3,k4
    #[arg(
        long,
        value_name = "D",
        value_delimiter = ',',
        allow_negative_numbers = true,
        requires = "distortion_model"
    )]
    distortion: Vec<f64>,
    /// The camera's own angular velocity from a gyro: a table t,wx,wy,wz in the camera's axes [s, rad/s]
    #[arg(long, value_name = "CSV")]
    gyro: Option<PathBuf>,
    /// Random walk of the integrated gyro [rad/sqrt(s)]
    #[arg(long, value_name = "N", default_value_t = Widths::default().gyro_noise, value_parser = super::not_negative)]
    gyro_noise: f64,
    /// Standard deviation of the gyro's bias [rad/s]
    #[arg(long, value_name = "B", default_value_t = Widths::default().gyro_bias, value_parser = super::not_negative)]
    gyro_bias: f64,
    /// Standard deviation of the body's angular acceleration by torques [rad/s2]; the default is for low Earth orbit
    #[arg(long, value_name = "A", default_value_t = Widths::default().acceleration, value_parser = super::not_negative)]
    disturbance: f64,
    /// Orbital rate [rad/s]: the body's centre moves as Clohessy and Wiltshire describe, instead of on a straight line
    #[arg(long, value_name = "N", value_parser = super::positive)]
    orbital_rate: Option<f64>,
    /// Direction from the Earth at the first frame, camera axes: x,y,z; needs --orbital-rate and --orbit-normal
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_delimiter = ',',
        allow_negative_numbers = true,
        requires_all = ["orbital_rate", "orbit_normal"]
    )]
    radial: Vec<f64>,
    /// Normal of the orbit, camera axes: x,y,z
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_delimiter = ',',
        allow_negative_numbers = true,
        requires_all = ["orbital_rate", "radial"]
    )]
    orbit_normal: Vec<f64>,
    /// Distance between two points [m], which gives the scale: ID,ID,M
    #[arg(long, value_name = "ID,ID,M", value_parser = KnownLength::distance, conflicts_with = "range")]
    distance: Option<KnownLength>,
    /// Range of a point from the camera in the last frame [m], which gives the scale: ID,M
    #[arg(long, value_name = "ID,M", value_parser = KnownLength::range)]
    range: Option<KnownLength>,
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
    let observations = match args.track {
        true => Observations::track(&args.input, &tracking(args)),
        false => Observations::read(&args.input),
    };
    let observations = observations.map_err(Failure::Input)?;
    if let (Some(path), Observations::Tracks(observed)) = (&args.tracks, &observations) {
        (observed.write_csv(path)).map_err(|e| Failure::Input(format!("--tracks: {e}")))?;
    }
    let found = match &observations {
        Observations::Tracks(observed) => from_tracks(args, observed)?,
        Observations::AngularVelocity(rates) => from_angular_velocities(args, rates)?,
    };
    let report = Report::new(&found, args)?;
    if !args.json {
        return print(&report::to_text(&found, &report));
    }
    for note in &report.notes {
        eprintln!("fuyu: note: {note}");
    }
    let json = serde_json::to_string(&report);
    print(&(json.map_err(|e| Failure::Runtime(e.to_string()))? + "\n"))
}

fn tracking(args: &Args) -> Tracking {
    Tracking {
        params: TrackerParams {
            mask_id: args.mask_id,
            ..TrackerParams::default()
        },
        frame_rate: args.frame_rate,
        mask: args.mask.clone(),
    }
}

fn from_angular_velocities(args: &Args, rates: &[(f64, Vector3<f64>)]) -> Result<Found, Failure> {
    let estimated = match args.method {
        None | Some(EstimationMethod::MaximumLikelihood) => {
            fit_rates(rates, &widths(args)).map_err(|e| input(args, e))?
        }
        Some(EstimationMethod::Masutani1995) => from_rates(rates).map_err(|e| input(args, e))?,
        Some(EstimationMethod::Bundle) => {
            return Err(input(
                args,
                "--method bundle needs feature tracks; for angular velocity use maximum_likelihood or masutani1995",
            ));
        }
    };
    Ok(Found {
        estimated,
        end: rates.last().map_or(0.0, |(t, _)| *t),
        R_IC: UnitQuaternion::identity(),
        input: format!("{} angular velocities", rates.len()),
        unit: "rad/s",
        ranges: Vec::new(),
        ignored_clouds: None,
    })
}

/// Prior standard deviations from the options.
fn widths(args: &Args) -> Widths {
    Widths {
        acceleration: args.disturbance,
        gyro_noise: args.gyro_noise,
        gyro_bias: args.gyro_bias,
        focal: if args.focal_length {
            0.1
        } else {
            args.focal_deviation
        },
        centre: args.centre_deviation,
        radial: args.radial_deviation,
        path: args
            .orbital_rate
            .map_or(Widths::default().path, |n| match args.radial.is_empty() {
                // The gravity gradient is at most 2 n² times the distance.
                true => 2.0 * n * n,
                // The orbit is known: only other forces remain.
                false => 0.1 * n * n,
            }),
        ..Widths::default()
    }
}

/// The orbit, if its directions are given.
fn orbit(args: &Args) -> Result<Option<Orbit>, Failure> {
    let vector = |name: &str, values: &[f64]| match values {
        [x, y, z]
            if (f64::MIN_POSITIVE..f64::INFINITY).contains(&Vector3::new(*x, *y, *z).norm()) =>
        {
            Ok(Vector3::new(*x, *y, *z).normalize())
        }
        _ => Err(Failure::Input(format!(
            "--{name} is '{values:?}'; it must be a direction of three numbers, as 0,0,1"
        ))),
    };
    let (Some(rate), false) = (args.orbital_rate, args.radial.is_empty()) else {
        return Ok(None);
    };
    let radial = vector("radial", &args.radial)?;
    let normal = vector("orbit-normal", &args.orbit_normal)?;
    let across = normal - radial * radial.dot(&normal);
    if across.norm() < 0.1 {
        return Err(Failure::Input(
            "--orbit-normal is along --radial; it must be across it".to_owned(),
        ));
    }
    Ok(Some(Orbit {
        rate,
        directions: (radial, across.normalize()),
    }))
}

fn input(args: &Args, problem: impl std::fmt::Display) -> Failure {
    Failure::Input(format!("{}: {problem}", args.input.display()))
}

/// An estimate with the camera's attitude and information on the input.
struct Found {
    estimated: Estimated,
    /// Time of the last observation \[s\].
    end: f64,
    /// Attitude of the camera at that time in the inertial axes of the estimate.
    R_IC: UnitQuaternion<f64>,
    input: String,
    /// Unit of the residual.
    unit: &'static str,
    /// Distances of points from the camera, measured in the recording.
    ranges: Vec<MeasuredRange>,
    /// Why point clouds in the recording were ignored, if any were.
    ignored_clouds: Option<String>,
}

fn from_tracks(args: &Args, observed: &ObservedTracks) -> Result<Found, Failure> {
    let camera = camera(args, observed.camera)?;
    let method = args.method.unwrap_or_default();
    let distortion = match &args.distortion_model {
        Some(model) => Distortion::new(model, &args.distortion)
            .map_err(|e| Failure::Input(format!("--distortion: {e}")))?,
        None => observed.distortion,
    };
    let rectified = match distortion {
        Some(lens) => Some(
            observed
                .tracks
                .rectified(&lens, &camera)
                .map_err(|e| input(args, e))?,
        ),
        None => None,
    };
    let tracks = rectified.as_ref().unwrap_or(&observed.tracks);
    let measured = match &args.gyro {
        Some(path) => match Observations::read(path).map_err(Failure::Input)? {
            Observations::AngularVelocity(rates) => rates,
            Observations::Tracks(_) => {
                return Err(Failure::Input(format!(
                    "{}: --gyro needs a table with the columns t,wx,wy,wz",
                    path.display()
                )));
            }
        },
        None => observed.w_WC_C.clone(),
    };
    let mut widths = widths(args);
    if let Some(noise) = observed.gyro_noise
        && args.gyro.is_none()
    {
        widths.gyro_noise = noise;
    }
    let is_at_rest = measured.is_empty();
    let options = bundle::Options {
        pixel_noise: args.pixel_noise,
        widths,
        orbit: orbit(args)?,
        with_points: true,
        camera_motion: match is_at_rest {
            true => CameraMotion::Fixed,
            false => CameraMotion::Rates(measured),
        },
        ..bundle::Options::default()
    };
    let estimated = estimate(method, tracks, &camera, &options).map_err(|e| input(args, e))?;
    let (start, end) = tracks.span().unwrap_or_default();
    Ok(Found {
        end,
        R_IC: options.camera_motion.lookup()(end),
        input: describe(tracks, end - start, is_at_rest),
        unit: match method {
            EstimationMethod::Bundle => "px",
            EstimationMethod::Masutani1995 | EstimationMethod::MaximumLikelihood => "rad/s",
        },
        estimated,
        ranges: observed.ranges.clone(),
        ignored_clouds: observed.ignored_clouds.clone(),
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

/// The camera model: given arguments replace the values of the recording's calibration.
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
