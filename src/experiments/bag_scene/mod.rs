//! Pictures of the robots and targets of a recorded run, seen from outside: `fuyu bag render`.

mod states;
mod viewpoint;

use std::path::{Path, PathBuf};

use fuyu_render::{Camera, Frame, Instance, Renderer, Scene, Sensor, Star, Sun, Transfer, encode};
use nalgebra::Vector3;

use super::recorded_names::title_of;
use crate::bag::Bag;
use crate::model::Model;
use crate::nodes::camera::images::{Body, Shape};
use states::{RecordedBody, recorded_bodies, time_range};
use viewpoint::placed_camera;

/// Ambient light, relative to full sunlight, so that dark sides of bodies remain visible.
const AMBIENT: f64 = 0.08;

/// Magnitude of the faintest star, brightness gain, and seed of the stars. Next to sunlit bodies, real stars are
/// invisible.
const STARS: (f64, f64, u64) = (5.5, 3e4, 1);

/// Number of pictures if no times are given.
const PICTURES: usize = 6;

/// Shortest time between two pictures \[s\]: file names give milliseconds.
const SHORTEST_INTERVAL: f64 = 0.001;

/// Maximum number of pictures at equal intervals.
const MOST_PICTURES: f64 = 20_000.0;

/// When pictures are made, in seconds since the start of the run.
#[derive(Debug, Clone, PartialEq)]
pub enum PictureTimes {
    /// Six pictures, from start to end.
    Overview,
    /// At these times.
    At(Vec<f64>),
    /// At equal intervals of this length \[s\], beginning at the start.
    Every(f64),
}

/// Options of the pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureOptions {
    /// Times of the pictures.
    pub times: PictureTimes,
    /// Number of the run in the bag, from 1: a reset begins a new run.
    pub run: usize,
    /// Columns and rows \[px\].
    pub size: (u32, u32),
    /// Azimuth of the direction from the bodies to the camera: angle about the world's z axis from its x axis \[rad\].
    pub azimuth: f64,
    /// Elevation of this direction: angle above the world's xy-plane \[rad\].
    pub elevation: f64,
    /// Horizontal field of view \[rad\].
    pub field_of_view: f64,
    /// Factor of the camera's distance; 1 is the smallest distance at which all bodies are in every picture.
    pub distance: f64,
}

impl Default for PictureOptions {
    fn default() -> Self {
        Self {
            times: PictureTimes::Overview,
            run: 1,
            size: (960, 540),
            azimuth: (-60.0_f64).to_radians(),
            elevation: 25.0_f64.to_radians(),
            field_of_view: 40.0_f64.to_radians(),
            distance: 1.0,
        }
    }
}

/// Reason why no pictures can be made.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The bag, an option or a description in the bag is not usable.
    #[error("{0}")]
    Input(String),
    /// A file cannot be written.
    #[error("{0}")]
    Write(String),
}

/// The files, and warnings on bodies and meshes that are not drawn.
#[derive(Debug, Default)]
pub struct Pictures {
    /// The pictures in the order of time.
    pub paths: Vec<PathBuf>,
    /// Bodies and meshes that are not drawn, one line each.
    pub warnings: Vec<String>,
}

/// Draws the bodies of a run into `folder`. The camera is fixed in the world, at a distance at which all bodies are in
/// every picture.
///
/// # Errors
/// [`PictureError`] with a line that names the option, topic or file.
pub fn render_bag(
    bag: &Bag,
    options: &PictureOptions,
    folder: &Path,
) -> Result<Pictures, PictureError> {
    let (start, end) = time_range(bag, options.run)?;
    let times = options.times.within((end - start) as f64 * 1e-9)?;
    let stamps: Vec<i64> = times.iter().map(|t| start + (t * 1e9) as i64).collect();
    let mut pictures = Pictures::default();
    let mut bodies = Vec::new();
    for (namespace, recorded) in recorded_bodies(bag, options.run, &stamps) {
        match recorded.drawn(&namespace, times.len(), &mut pictures.warnings) {
            Ok(body) => bodies.push(body),
            Err(reason) => {
                let title = title_of(&namespace);
                let name = if title.is_empty() {
                    "the robot"
                } else {
                    &title
                };
                pictures
                    .warnings
                    .push(format!("{name} is not drawn: {reason}"));
            }
        }
    }
    if bodies.is_empty() {
        let reasons = pictures.warnings.join("; ");
        let text = format!("nothing to draw: {reasons}");
        return Err(PictureError::Input(text));
    }
    let camera = placed_camera(&bodies, options)?;
    let mut scene = lit_scene(&camera);
    let mut renderer = Renderer::default();
    let run = match options.run {
        1 => String::new(),
        run => format!("run{run}_"),
    };
    for (k, time) in times.iter().enumerate() {
        scene.instances.clear();
        let parts = bodies.iter().flat_map(|body| body[k].iter().cloned());
        scene.instances.extend(parts);
        let path = folder.join(format!("{run}scene_{time:09.3}s.png"));
        write(&renderer.render(&scene, &camera), &path)?;
        pictures.paths.push(path);
    }
    Ok(pictures)
}

impl PictureTimes {
    /// The times \[s\] in a run of `duration` seconds.
    fn within(&self, duration: f64) -> Result<Vec<f64>, PictureError> {
        match self {
            Self::Overview => {
                let last = (PICTURES - 1) as f64;
                Ok((0..PICTURES).map(|k| duration * k as f64 / last).collect())
            }
            Self::At(times) => {
                let outside = times.iter().find(|t| !(0.0..=duration + 0.01).contains(*t));
                match outside {
                    None => {
                        let mut ascending = times.clone();
                        ascending.sort_by(f64::total_cmp);
                        Ok(ascending)
                    }
                    Some(t) => Err(PictureError::Input(format!(
                        "--at {t}: the run lasts from 0 to {duration:.2} s"
                    ))),
                }
            }
            Self::Every(interval) => {
                let count = (duration / interval).floor();
                if !(*interval >= SHORTEST_INTERVAL && count < MOST_PICTURES) {
                    return Err(PictureError::Input(format!(
                        "--every {interval}: an interval must be at least {SHORTEST_INTERVAL} s, and give at most {MOST_PICTURES} pictures in {duration:.2} s"
                    )));
                }
                Ok((0..=count as usize).map(|k| k as f64 * interval).collect())
            }
        }
    }
}

impl RecordedBody {
    /// The meshes of the body at each of `count` times. Adds a warning for each mesh that cannot be drawn.
    fn drawn(
        self,
        namespace: &str,
        count: usize,
        warnings: &mut Vec<String>,
    ) -> Result<Vec<Vec<Instance>>, String> {
        let source = format!("{namespace}/robot_description");
        let Some(xml) = self.description else {
            return Err(format!("the bag has no {source}"));
        };
        let repaired = Model::repaired_from_urdf(&xml, &source).map_err(|e| e.to_string())?;
        let shape = Shape::of_urdf(&xml, &source);
        warnings.extend(shape.problems.iter().cloned());
        let mut body = Body::new(repaired.model, &shape);
        let (joints, odometry) = (self.joints.finish(count), self.odometry.finish(count));
        if odometry.is_empty() {
            return Err("the bag has no pose of it".to_owned());
        }
        if body.model().dof() > 0 && joints.is_empty() {
            return Err(format!("the bag has no {namespace}/joint_states"));
        }
        let mut instances = |k: usize| -> Result<Vec<Instance>, String> {
            let state = body.state(joints.get(k), &odometry[k])?;
            let motions = body.part_motions(&state, 0.0);
            let parts = body.parts().zip(motions);
            let drawn = parts.map(|(part, motion)| Instance::new(part.mesh.clone(), 1, motion));
            Ok(drawn.collect())
        };
        (0..count).map(&mut instances).collect()
    }
}

/// A scene lit by the Sun from behind the camera, with stars.
fn lit_scene(camera: &Camera) -> Scene {
    let R_WC = camera.pose.open.rotation;
    let (faintest, gain, seed) = STARS;
    let mut scene = Scene::new();
    scene.sun = Sun {
        direction: R_WC * Vector3::new(-0.7, -0.8, -1.0),
        intensity: 1.0,
    };
    scene.ambient = AMBIENT;
    scene.stars = Star::random_sky(faintest, seed);
    scene.star_gain = gain;
    scene.shadow_resolution = 4096;
    scene
}

/// Writes a picture for human viewers: without noise, in sRGB.
fn write(frame: &Frame, path: &Path) -> Result<(), PictureError> {
    let sensor = Sensor {
        // Exposure at which a white surface facing the Sun is white.
        exposure: 1.0,
        sensitivity: 1.0,
        full_well: 0.9,
        shot_noise: false,
        read_noise: 0.0,
        transfer: Transfer::Srgb,
        seed: 0,
    };
    let (width, height) = (frame.width as u32, frame.height as u32);
    let png = encode::png(&sensor.rgb8(frame, 0), width, height, 3).map_err(PictureError::Write)?;
    let problem = |e| PictureError::Write(format!("{}: cannot be written: {e}", path.display()));
    std::fs::write(path, png).map_err(problem)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_within_the_run() {
        let at = |times: &[f64]| PictureTimes::At(times.to_vec()).within(10.0);
        assert_eq!(at(&[10.0, 0.0]).unwrap(), [0.0, 10.0]);
        let error = at(&[3.0, 12.0]).unwrap_err().to_string();
        assert_eq!(error, "--at 12: the run lasts from 0 to 10.00 s");
        assert!(at(&[f64::NAN]).is_err());
        let every = |s: f64| PictureTimes::Every(s).within(10.0);
        assert_eq!(every(4.0).unwrap(), [0.0, 4.0, 8.0]);
        assert!(every(0.0).is_err() && every(-1.0).is_err() && every(1e-9).is_err());
        assert!(every(f64::NAN).is_err());
        let overview = PictureTimes::Overview.within(10.0).unwrap();
        assert_eq!(overview, [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
    }
}
