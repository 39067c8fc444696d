//! Pictures of the robots and targets of a recorded run, from outside: `fuyu bag render`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fuyu_render::{
    Camera, Distortion, Frame, Instance, Intrinsics, Renderer, Scene, Sensor, Star, Sun, Transfer,
    encode,
};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::recorded_names::{is_of_target, title_of};
use super::recorded_runs::RunCounter;
use crate::bag::{Bag, Message};
use crate::model::Model;
use crate::msg::{nav_msgs::Odometry, sensor_msgs::JointState, std_msgs};
use crate::nodes::camera::images::{Body, Shape};

/// Samples of a pixel, so that edges are smooth.
const SAMPLES: usize = 9;

/// Light from all directions, of full sunlight: the dark sides of bodies remain visible.
const AMBIENT: f64 = 0.08;

/// Magnitude of the faintest star, gain on their brightness, and seed of the sky. Next to sunlit bodies, real stars are invisible.
const STARS: (f64, f64, u64) = (5.5, 3e4, 1);

/// Spheres around the bodies are so much larger than they are, for an edge around the picture.
const MARGIN: f64 = 1.1;

/// Number of pictures if no times are given.
const PICTURES: usize = 6;

/// Most pictures at equal distances of time.
const MOST_PICTURES: f64 = 100_000.0;

/// When pictures are made, in seconds since the start of the run.
#[derive(Debug, Clone, PartialEq)]
pub enum PictureTimes {
    /// At the start, at the end and in between, six in all.
    Overview,
    /// At these times.
    At(Vec<f64>),
    /// One in each interval of this length \[s\], from the start on.
    Every(f64),
}

/// What is drawn, and from where.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureOptions {
    /// When.
    pub times: PictureTimes,
    /// Which of the runs in the bag, from 1: a reset begins another one.
    pub run: usize,
    /// Columns and rows \[px\].
    pub size: (u32, u32),
    /// Direction from the bodies to the camera, about the world's z-axis from its x-axis \[rad\].
    pub azimuth: f64,
    /// The same, above the xy-plane of the world \[rad\].
    pub elevation: f64,
    /// Horizontal field of view \[rad\].
    pub field_of_view: f64,
    /// Part of the distance at which all bodies are in every picture: below 1 is closer.
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

/// Why there are no pictures.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The bag, an option or a description in the bag is not usable.
    #[error("{0}")]
    Input(String),
    /// A file cannot be written.
    #[error("{0}")]
    Write(String),
}

/// The files, and a line for each body or mesh that is not drawn.
#[derive(Debug, Default)]
pub struct Pictures {
    /// The pictures in the order of time.
    pub paths: Vec<PathBuf>,
    /// What is missing in them.
    pub warnings: Vec<String>,
}

/// Draws the bodies of a run into `folder`. The camera stands still in the world, so far away that all bodies are in every
/// picture.
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
        match recorded.drawn(&namespace, &mut pictures.warnings) {
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
    for (k, time) in times.iter().enumerate() {
        scene.instances.clear();
        let parts = bodies.iter().flat_map(|body| body[k].iter().cloned());
        scene.instances.extend(parts);
        let run = match options.run {
            1 => String::new(),
            run => format!("run{run}_"),
        };
        let path = folder.join(format!("{run}scene_{time:08.2}s.png"));
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
                    None => Ok(times.clone()),
                    Some(t) => Err(PictureError::Input(format!(
                        "--at {t}: the run lasts from 0 to {duration:.2} s"
                    ))),
                }
            }
            Self::Every(interval) => {
                let count = (duration / interval).floor();
                if !(*interval > 0.0 && count < MOST_PICTURES) {
                    return Err(PictureError::Input(format!(
                        "--every {interval}: in {duration:.2} s there must be 1 to {MOST_PICTURES} pictures"
                    )));
                }
                Ok((0..=count as usize).map(|k| k as f64 * interval).collect())
            }
        }
    }
}

/// A message of a body, by the last parts of its topic.
enum Part {
    Description(String),
    Joints(JointState),
    Odometry(Odometry),
}

impl Part {
    /// The namespace of the body that a message is of: of a robot, or `ground_truth/NAME` of a target.
    fn of(message: &Message) -> Option<(String, Self)> {
        let topic = &message.topic;
        let below = |suffix: &str| topic.name.strip_suffix(suffix).map(str::to_owned);
        match topic.type_name.as_str() {
            "std_msgs/msg/String" => {
                let text: std_msgs::String = message.decode().ok()?;
                Some((below("/robot_description")?, Self::Description(text.data)))
            }
            "sensor_msgs/msg/JointState" => {
                let namespace = below("/joint_states")?;
                Some((namespace, Self::Joints(message.decode().ok()?)))
            }
            "nav_msgs/msg/Odometry" => {
                let of_robot = below("/ground_truth/odom");
                let of_target = || below("/odom").filter(|namespace| is_of_target(namespace));
                let namespace = of_robot.or_else(of_target)?;
                Some((namespace, Self::Odometry(message.decode().ok()?)))
            }
            _ => None,
        }
    }
}

/// The first and last stamp \[ns\] of poses in a run.
fn time_range(bag: &Bag, run: usize) -> Result<(i64, i64), PictureError> {
    let mut counter = RunCounter::default();
    let mut range: Option<(i64, i64)> = None;
    let mut runs = 0;
    bag.messages().for_each(|message| {
        let of = counter.run_of(&message) + 1;
        if let Some((_, Part::Odometry(odometry))) = Part::of(&message) {
            runs = runs.max(of);
            if of == run {
                let stamp = odometry.header.stamp.nanos();
                let (first, last) = range.unwrap_or((stamp, stamp));
                range = Some((first.min(stamp), last.max(stamp)));
            }
        }
    });
    range.ok_or_else(|| {
        PictureError::Input(match runs {
            0 => "nothing to draw: no ground_truth/odom, which has the poses of robots and targets"
                .to_owned(),
            runs => format!("--run {run}: the bag has the runs 1 to {runs}"),
        })
    })
}

/// The recorded data of a body at the times of the pictures.
struct RecordedBody {
    description: Option<String>,
    joints: Vec<Option<JointState>>,
    odometry: Vec<Option<Odometry>>,
}

/// The bodies by namespace, with their states at `stamps` \[ns\].
fn recorded_bodies(bag: &Bag, run: usize, stamps: &[i64]) -> BTreeMap<String, RecordedBody> {
    let mut counter = RunCounter::default();
    let mut bodies: BTreeMap<String, RecordedBody> = BTreeMap::new();
    bag.messages().for_each(|message| {
        let of = counter.run_of(&message) + 1;
        let Some((namespace, part)) = Part::of(&message) else {
            return;
        };
        let body = bodies.entry(namespace).or_insert_with(|| RecordedBody {
            description: None,
            joints: vec![None; stamps.len()],
            odometry: vec![None; stamps.len()],
        });
        match part {
            // Latched, and not repeated after a reset.
            Part::Description(text) if of <= run => body.description = Some(text),
            Part::Joints(joints) if of == run => {
                keep(
                    &mut body.joints,
                    stamps,
                    joints.header.stamp.nanos(),
                    &joints,
                );
            }
            Part::Odometry(odometry) if of == run => {
                let stamp = odometry.header.stamp.nanos();
                keep(&mut body.odometry, stamps, stamp, &odometry);
            }
            _ => {}
        }
    });
    bodies
        .retain(|_, body| body.description.is_some() || body.odometry.iter().any(Option::is_some));
    bodies
}

/// Keeps `message` where it is the latest one up to the time of a picture, or the first one at all.
fn keep<M: Clone>(kept: &mut [Option<M>], stamps: &[i64], stamp: i64, message: &M) {
    for (kept, at) in kept.iter_mut().zip(stamps) {
        // Times of pictures are rounded.
        if kept.is_none() || stamp <= at + 500_000 {
            *kept = Some(message.clone());
        }
    }
}

impl RecordedBody {
    /// The meshes of the body at each time. Adds a line for each mesh that cannot be drawn.
    fn drawn(
        self,
        namespace: &str,
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
        let has_joints = body.model().dof() > 0;
        let mut all = Vec::new();
        for (joints, odometry) in self.joints.iter().zip(&self.odometry) {
            let Some(odometry) = odometry else {
                return Err("the bag has no pose of it".to_owned());
            };
            if has_joints && joints.is_none() {
                return Err(format!("the bag has no {namespace}/joint_states"));
            }
            let state = body.state(joints.as_ref(), odometry)?;
            let motions = body.part_motions(&state, 0.0);
            let parts = body.parts().zip(motions);
            all.push(
                parts
                    .map(|(part, motion)| Instance::new(part.mesh.clone(), 1, motion))
                    .collect(),
            );
        }
        Ok(all)
    }
}

/// The nearest camera of the given direction that has all bodies in view at all times.
fn placed_camera(
    bodies: &[Vec<Vec<Instance>>],
    options: &PictureOptions,
) -> Result<Camera, PictureError> {
    let (width, height) = options.size;
    let half = 0.5 * options.field_of_view;
    let focal_length = 0.5 * f64::from(width) / half.tan();
    let camera = Camera::new(
        Intrinsics::centred(width, height, focal_length),
        Distortion::None,
        SAMPLES,
    );
    let camera = camera.map_err(|e| PictureError::Input(format!("--size: {e}")))?;
    // Spheres around the meshes, in the axes of the camera.
    let R_WC = optical_axes(options.azimuth, options.elevation);
    let spheres: Vec<(Vector3<f64>, f64)> = (bodies.iter().flatten().flatten())
        .map(|instance| {
            let (centre, radius) = instance.mesh.bounding_sphere();
            let p_W = instance.motion.open * nalgebra::Point3::from(centre);
            (R_WC.inverse() * p_W.coords, radius)
        })
        .collect();
    if spheres.is_empty() {
        let text = "nothing to draw: no description has a visual element that can be drawn";
        return Err(PictureError::Input(text.to_owned()));
    }
    let vertical = (f64::from(height) / f64::from(width) * half.tan()).atan();
    let (_, from_sides) = between_sides(&spheres, 0, half);
    let (_, from_top) = between_sides(&spheres, 1, vertical);
    let z = from_sides.min(from_top);
    let (x, y) = (
        in_the_middle(&spheres, 0, half, z),
        in_the_middle(&spheres, 1, vertical, z),
    );
    let depths = spheres.iter().map(|(c, _)| c.z);
    let (near, far) = depths.fold((f64::MAX, f64::MIN), |(near, far), z| {
        (near.min(z), far.max(z))
    });
    let middle = 0.5 * (near + far);
    let z = middle - (middle - z) * options.distance;
    let p_WC = R_WC * Vector3::new(x, y, z);
    let rotation = UnitQuaternion::from_rotation_matrix(&R_WC);
    Ok(
        camera.at(fuyu_render::Motion::at_rest(Isometry3::from_parts(
            p_WC.into(),
            rotation,
        ))),
    )
}

/// Where a camera that looks along z must be for all spheres to be in its view along one of the axes across, x (0) or y (1),
/// whose sides are `half` \[rad\] from the middle: the coordinate on that axis, and the largest z.
///
/// A sphere touches a side if its centre is its radius away from that plane. Each of the two sides is a bound on the
/// position, and their corner is the point farthest ahead.
fn between_sides(spheres: &[(Vector3<f64>, f64)], axis: usize, half: f64) -> (f64, f64) {
    let (sin, cos) = half.sin_cos();
    let most = |sign: f64| {
        let each = spheres.iter();
        each.map(|(c, r)| sign * c[axis] * cos + r * MARGIN - c.z * sin)
            .fold(f64::MIN, f64::max)
    };
    let (one, other) = (most(1.0), most(-1.0));
    ((one - other) / (2.0 * cos), -(one + other) / (2.0 * sin))
}

/// Coordinate on an axis across of a camera at `z` with the spheres in the middle of its view: as near to one side as to the
/// other, by the narrowest view that has all of them.
fn in_the_middle(spheres: &[(Vector3<f64>, f64)], axis: usize, half: f64, z: f64) -> f64 {
    let (mut narrow, mut wide) = (0.0, half);
    for _ in 0..50 {
        let tried = 0.5 * (narrow + wide);
        match between_sides(spheres, axis, tried).1 >= z {
            true => wide = tried,
            false => narrow = tried,
        }
    }
    between_sides(spheres, axis, wide).0
}

/// Axes of an optical frame that looks opposite to a direction, with the world's z upward in the picture.
fn optical_axes(azimuth: f64, elevation: f64) -> Rotation3<f64> {
    let (sin, cos) = azimuth.sin_cos();
    let toward = Vector3::new(
        cos * elevation.cos(),
        sin * elevation.cos(),
        elevation.sin(),
    );
    let right = Vector3::new(-sin, cos, 0.0);
    let z = -toward;
    Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, z.cross(&right), z]))
}

/// Sunlight over the shoulder of the camera, and stars.
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

/// Writes a picture for people: without noise, coded as sRGB.
fn write(frame: &Frame, path: &Path) -> Result<(), PictureError> {
    let sensor = Sensor {
        // A white surface that faces the Sun is white.
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
    fn the_camera_looks_at_the_bodies_with_z_upward() {
        let R_WC = optical_axes(0.0, 0.0);
        // From +x it sees +y on the right and +z up.
        assert!((R_WC * Vector3::z() + Vector3::x()).norm() < 1e-15);
        assert!((R_WC * Vector3::x() - Vector3::y()).norm() < 1e-15);
        assert!((R_WC * Vector3::y() + Vector3::z()).norm() < 1e-15);
        let R_WC = optical_axes(-2.1, 0.4);
        assert!((R_WC.matrix().determinant() - 1.0).abs() < 1e-14);
        assert!((R_WC * Vector3::y()).z < -0.9);
    }

    // Fails if a body is cut off at a side of the picture, or the camera is farther away than it must be.
    #[test]
    fn the_camera_is_as_far_away_as_all_bodies_need() {
        use fuyu_render::{Material, Motion, primitives};
        let ball = std::sync::Arc::new(primitives::sphere(1.0, Material::grey(0.5)));
        let at = |x, y, z| {
            let motion = Motion::at_rest(Isometry3::translation(x, y, z));
            Instance::new(ball.clone(), 1, motion)
        };
        let bodies = [vec![vec![at(5.0, 1.0, 2.0)], vec![at(-3.0, 4.0, 0.0)]]];
        for (azimuth, elevation) in [(0.0, 0.0), (1.0, 0.3), (-2.5, -1.2)] {
            let options = PictureOptions {
                azimuth,
                elevation,
                ..PictureOptions::default()
            };
            let camera = placed_camera(&bodies, &options).unwrap();
            let mut scene = Scene::new();
            scene.instances = bodies[0].concat();
            let frame = fuyu_render::render(&scene, &camera);
            let (w, h) = (frame.width, frame.height);
            let seen = |u: usize, v: usize| frame.ids[v * w + u] != 0;
            let drawn: Vec<(usize, usize)> = (0..h)
                .flat_map(|v| (0..w).map(move |u| (u, v)))
                .filter(|(u, v)| seen(*u, *v))
                .collect();
            let left = drawn.iter().map(|p| p.0).min().unwrap();
            let right = w - 1 - drawn.iter().map(|p| p.0).max().unwrap();
            let top = drawn.iter().map(|p| p.1).min().unwrap();
            let bottom = h - 1 - drawn.iter().map(|p| p.1).max().unwrap();
            // In the tighter direction both sides are at the edge, in the other one the bodies are in the middle.
            let edges = [left.max(right), top.max(bottom)];
            assert!((1..60).contains(edges.iter().min().unwrap()), "{edges:?}");
            assert!(left.min(right) > 0 && top.min(bottom) > 0, "{edges:?}");
            assert!(left.abs_diff(right) < 60, "{left} {right}");
            assert!(top.abs_diff(bottom) < 60, "{top} {bottom}");
        }
    }

    #[test]
    fn times_are_within_the_run() {
        let at = |times: &[f64]| PictureTimes::At(times.to_vec()).within(10.0);
        assert_eq!(at(&[0.0, 10.0]).unwrap(), [0.0, 10.0]);
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
