//! `fuyu bag render`: pictures of robots and targets from outside.

use std::path::PathBuf;

use crate::bag::Bag;
use crate::cli::{Failure, print};
use crate::experiments::{PictureError, PictureOptions, PictureTimes, render_bag};

/// Draws robots and targets from outside, as PNG files
///
/// The camera stands still, so far away that all bodies are in every picture. The shapes are the visual elements of
/// the descriptions in the bag, the poses the true ones. The files are called scene_SECONDSs.png.
#[derive(Debug, clap::Args)]
pub struct RenderArgs {
    /// Folder or .mcap file
    bag: PathBuf,
    /// Folder for the pictures, created if needed; default: the bag's folder
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Times since the start [s], separated by commas; default: six from start to end
    #[arg(
        long,
        value_name = "S",
        value_delimiter = ',',
        conflicts_with = "every"
    )]
    at: Vec<f64>,
    /// A picture each so many seconds, for a film
    #[arg(long, value_name = "S")]
    every: Option<f64>,
    /// Direction from which the camera looks, about the world's z-axis from its x-axis [deg]
    #[arg(long, value_name = "DEG", default_value_t = -60.0, allow_negative_numbers = true)]
    azimuth: f64,
    /// The same, above the world's xy-plane [deg]
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 25.0,
        allow_negative_numbers = true
    )]
    elevation: f64,
    /// Part of the distance at which all bodies are in view: 0.5 is twice as close
    #[arg(long, value_name = "RATIO", default_value_t = 1.0)]
    distance: f64,
    /// Columns and rows [px]
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "960x540", value_parser = size)]
    size: (u32, u32),
    /// Which of the runs in the bag: a reset begins another one
    #[arg(long, value_name = "N", default_value_t = 1)]
    run: usize,
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once('x');
    let numbers = parts.and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match numbers {
        Some((width, height)) if width > 0 && height > 0 => Ok((width, height)),
        _ => Err("it must be like 960x540".to_owned()),
    }
}

/// Runs `fuyu bag render`.
///
/// # Errors
/// [`Failure::Input`] if BAG has no bodies or an option is impossible, [`Failure::Runtime`] if a picture cannot be written.
pub fn run(args: &RenderArgs) -> Result<(), Failure> {
    let options = PictureOptions {
        times: match args.every {
            Some(interval) => PictureTimes::Every(interval),
            None if args.at.is_empty() => PictureTimes::Overview,
            None => PictureTimes::At(args.at.clone()),
        },
        run: args.run,
        size: args.size,
        azimuth: angle("--azimuth", args.azimuth, 360.0)?,
        elevation: angle("--elevation", args.elevation, 90.0)?,
        distance: super::positive("--distance", args.distance)?,
        ..PictureOptions::default()
    };
    let bag = Bag::open(&args.bag).map_err(super::failure)?;
    let folder = super::picture_folder(&args.bag, args.output.as_deref())?;
    let pictures = render_bag(&bag, &options, &folder).map_err(|e| match e {
        PictureError::Input(text) => Failure::Input(format!("bag {}: {text}", args.bag.display())),
        PictureError::Write(text) => Failure::Runtime(text),
    })?;
    for warning in pictures.warnings {
        eprintln!("warning: {warning}");
    }
    print(&super::list_of(&pictures.paths))
}

/// An angle in radians; its magnitude in degrees may be at most `most`.
fn angle(option: &str, degrees: f64, most: f64) -> Result<f64, Failure> {
    if degrees.abs() <= most {
        return Ok(degrees.to_radians());
    }
    Err(Failure::Input(format!(
        "{option} {degrees}: an angle must be from -{most} to {most} degrees"
    )))
}
