//! Estimation problems by category, and how a solution is judged.

use std::time::Instant;

use fuyu_physics::estimation::bundle::{self, CameraMotion, Options, Widths};
use fuyu_physics::estimation::{FeatureFrame, Tracks};
use fuyu_physics::vision::Pinhole;
use nalgebra::{UnitQuaternion, UnitVector3, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::world::{Eye, State, World};

/// Time after the last frame at which predictions are judged \[s\].
pub const HORIZON: f64 = 30.0;

/// What a problem is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Category {
    Gaussian,
    WholePixels,
    ShortTurn,
    Separatrix,
    Noisy,
    Occluded,
    FocalLength,
    Distortion,
    Orbit,
    Gyro,
    Torque,
    FewPoints,
}

impl Category {
    /// All categories with their names; those in which the assumptions of a free rotation before a calibrated camera
    /// hold come first.
    pub const ALL: [(Self, &'static str, bool); 12] = [
        (Self::Gaussian, "0.3 px of Gaussian noise", true),
        (Self::WholePixels, "whole pixels", true),
        (Self::ShortTurn, "0.15 to 1.8 rad, nine radii away", true),
        (Self::Separatrix, "near the separatrix, whole pixels", true),
        (Self::Noisy, "2 px of noise", true),
        (Self::Occluded, "far side hidden, 5 % outliers", true),
        (Self::FocalLength, "focal length off by 0.3 %", false),
        (Self::Distortion, "k1 0.01, centre off by 3 px", false),
        (Self::Orbit, "relative orbit", false),
        (Self::Gyro, "gyro 1e-4 rad/sqrt(s), bias", false),
        (Self::Torque, "gravity gradient, outgassing", false),
        (Self::FewPoints, "5 of 24 points at a time", false),
    ];
}

/// A problem with its solution.
pub struct Problem {
    pub tracks: Tracks,
    pub camera: Pinhole,
    pub options: Options,
    /// True rotation over [`HORIZON`] after the last frame, in the camera's axes at the last frame.
    pub turn_C: UnitQuaternion<f64>,
    /// Time of the last frame \[s\].
    pub end: f64,
}

/// Result of a problem.
pub struct Outcome {
    /// Mahalanobis error of the predicted rotation, its angle \[rad\] and the reported standard deviation \[rad\]; or
    /// the refusal.
    pub result: Result<(f64, f64, f64), String>,
    /// Processor time \[s\].
    pub seconds: f64,
}

fn direction(rng: &mut StdRng) -> Vector3<f64> {
    let v = Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal));
    UnitVector3::new_normalize(v).into_inner()
}

/// Moments of inertia of a random box.
fn moments(rng: &mut StdRng) -> Vector3<f64> {
    let s = Vector3::from_fn(|_, _| rng.random_range(0.3..1.0f64).powi(2));
    Vector3::new(s.y + s.z, s.z + s.x, s.x + s.y)
}

/// Points on the surface of a unit sphere or a box, with `spread` scale.
fn points(rng: &mut StdRng, count: usize) -> Vec<Vector3<f64>> {
    let size = Vector3::from_fn(|_, _| rng.random_range(0.5..1.0));
    let offset = Vector3::from_fn(|_, _| rng.random_range(-0.1..0.1));
    (0..count)
        .map(|_| direction(rng).component_mul(&size) + offset)
        .collect()
}

/// What problems contain besides noise and what their category adds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Disturbances {
    /// Nothing.
    None,
    /// Torques, a curved path, calibration errors and shapes drawn from the priors that [`Widths`] documents. The
    /// covariance of a Bayesian estimator is then exact on average (simulation-based calibration: Cook, Gelman and
    /// Rubin 2006).
    FromPriors,
}

/// Draws what [`Disturbances::FromPriors`] names.
fn draw_from_priors(
    world: &mut World,
    eye: &mut Eye,
    draws_shape: bool,
    distance: f64,
    seconds: f64,
    rng: &mut StdRng,
) {
    let widths = Widths::default();
    let mut normal = |width: f64| width * rng.sample::<f64, _>(StandardNormal);
    let mut vector = |width: f64| Vector3::from_fn(|_, _| normal(width));
    // Gauss-Markov process, and a part that turns with the body.
    let keep = (-1.0 / widths.correlation_time).exp();
    let mut acceleration = vector(widths.acceleration);
    for _ in 0..=seconds.ceil() as usize {
        world.inertial_acceleration.push(acceleration);
        acceleration =
            acceleration * keep + vector(widths.acceleration * (1.0 - keep * keep).sqrt());
    }
    world.body_acceleration += vector(widths.acceleration);
    if world.orbital_rate == 0.0 {
        world.centre_acceleration = vector(widths.path * distance);
    }
    let errors = vector(1.0);
    eye.focal *= 1.0 + widths.focal * errors.x;
    eye.centre += errors.yz() * (widths.centre * eye.focal);
    eye.radial += normal(widths.radial);
    if draws_shape {
        // A box whose shortest side may be a fiftieth of the longest.
        let s = Vector3::from_fn(|_, _| rng.random_range(0.02..1.0f64).powi(2));
        world.I = Vector3::new(s.y + s.z, s.z + s.x, s.x + s.y);
    }
}

impl Problem {
    /// The problem with this seed, without disturbances.
    pub fn new(category: Category, seed: u64) -> Self {
        Self::with_disturbances(category, seed, Disturbances::None)
    }

    /// The problem with this seed.
    pub fn with_disturbances(category: Category, seed: u64, disturbances: Disturbances) -> Self {
        let mut rng = StdRng::seed_from_u64(1000 * category as u64 + seed);
        let rng = &mut rng;
        let mut world = World {
            I: moments(rng),
            ..World::default()
        };
        let mut duration: f64 = [20.0, 30.0, 60.0][rng.random_range(0..3usize)];
        let mut interval = [0.1, 0.2, 0.5][rng.random_range(0..3usize)];
        let mut rate = rng.random_range(0.05..0.4f64).max(2.0 / duration);
        let mut distance = rng.random_range(2.0..6.0);
        let mut eye = Eye::new(1.0, 0.3, false);
        let count = rng.random_range(12..40usize);
        let mut axis = direction(rng);
        let mut points = points(rng, count);
        let mut options = Options::default();
        match category {
            Category::Gaussian => {}
            Category::WholePixels => (eye.noise, eye.rounded) = (0.0, true),
            Category::ShortTurn => {
                duration = rng.random_range(2.0..6.0);
                interval = 0.1;
                distance = 9.0;
                rate = rng.random_range(0.15..1.8f64) / duration;
                (eye.noise, eye.rounded) = ([0.0, 0.2][rng.random_range(0..2usize)], true);
            }
            Category::Separatrix => {
                (eye.noise, eye.rounded) = (0.0, true);
                let e = rng.random_range(0.4..0.9);
                world.I = Vector3::new(1.0, 0.5 * (1.0 + e), e);
                // Rotation about the middle axis, disturbed a little.
                let off = 10f64.powf(rng.random_range(-4.0..-1.0));
                axis = (Vector3::y() + direction(rng) * off).normalize();
                duration = 60.0;
                rate = rng.random_range(0.15..0.5);
            }
            Category::Noisy => eye.noise = 2.0,
            Category::Occluded => {
                points = self::points(rng, 40);
                (eye.occlusion, eye.outliers) = (true, 0.05);
            }
            Category::FocalLength => {
                let sign = if seed.is_multiple_of(2) { 1.0 } else { -1.0 };
                eye.focal *= 1.0 + 0.003 * sign;
            }
            Category::Distortion => {
                eye.radial = 0.01 * if seed.is_multiple_of(2) { 1.0 } else { -1.0 };
                eye.centre.x += 3.0;
                eye.centre.y -= 3.0;
            }
            Category::Orbit => {
                world.orbital_rate = 1.1e-3;
                duration = 60.0;
            }
            Category::Gyro => {
                world.camera_rate = direction(rng) * rng.random_range(1e-3..1e-2);
                world.camera_pace = rng.random_range(0.05..0.3);
            }
            Category::Torque => {
                world.orbital_rate = 1.1e-3;
                world.gravity_gradient = true;
                world.body_acceleration = direction(rng) * 10f64.powf(rng.random_range(-7.0..-5.5));
            }
            Category::FewPoints => {
                points = self::points(rng, 24);
                eye.visible = Some(5);
                interval = 0.1;
                duration = 30.0;
            }
        }
        // No more than half a radian between frames.
        rate = rate.min(0.5 / interval);
        let orbit = direction(rng);
        world.orbit = (orbit, orbit.cross(&direction(rng)).normalize());
        let drift = match category {
            Category::Orbit => 0.02,
            _ => 1e-3,
        };
        if disturbances == Disturbances::FromPriors {
            let draws_shape = category != Category::Separatrix;
            let seconds = duration + HORIZON;
            draw_from_priors(&mut world, &mut eye, draws_shape, distance, seconds, rng);
        }
        let start = State {
            R_WB: UnitQuaternion::from_scaled_axis(direction(rng) * rng.random_range(0.0..3.0)),
            w_B: axis * rate,
            r_W: Vector3::new(0.0, 0.0, distance),
            v_W: direction(rng) * (drift * rng.random_range(0.0..1.0)),
            R_WC: UnitQuaternion::identity(),
        };
        let frames = (duration / interval).round() as usize;
        let mut times: Vec<f64> = (0..=frames).map(|k| interval * k as f64).collect();
        let end = times[frames];
        times.push(end + HORIZON);
        let states = world.run(start, &times);
        let shown: Vec<FeatureFrame> = (times[..=frames].iter().zip(&states))
            .map(|(t, s)| eye.frame(*t, s, &points, rng))
            .collect();
        if category == Category::Gyro {
            let h: f64 = 0.05;
            let bias = direction(rng) * 3e-5;
            let rates = (0..=(end / h).ceil() as usize).map(|k| {
                let t = h * k as f64;
                let noise = Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal));
                (t, world.camera_rate(t) + bias + noise * (1e-4 / h.sqrt()))
            });
            options.camera_motion = CameraMotion::Rates(rates.collect());
        }
        let (last, then) = (&states[frames], &states[frames + 1]);
        let turn_W = then.R_WB * last.R_WB.inverse();
        Self {
            tracks: Tracks::new(shown).unwrap(),
            camera: Pinhole::square(1024, 1.0),
            options,
            turn_C: last.R_WC.inverse() * turn_W * last.R_WC,
            end,
        }
    }

    /// The same for an estimator that knows that no torque acts.
    pub fn without_torque(mut self) -> Self {
        self.options.widths.acceleration = 0.0;
        self
    }

    /// Solves it and compares.
    pub fn solve(&self) -> Outcome {
        let start = Instant::now();
        let solved = bundle::estimate(&self.tracks, &self.camera, &self.options);
        let seconds = start.elapsed().as_secs_f64();
        let result = solved.map_err(|e| e.to_string()).map(|solution| {
            let R_CI = self.options.camera_motion.lookup()(self.end).inverse();
            let motion = &solution.motion;
            let (from, to) = (
                motion.attitude(self.end),
                motion.attitude(self.end + HORIZON),
            );
            let turn_C = R_CI * (to / from) * R_CI.inverse();
            // turn = exp(error) * true turn.
            let error = (turn_C / self.turn_C).scaled_axis();
            let R = R_CI.to_rotation_matrix();
            let spread = solution.turn_covariance(self.end, self.end + HORIZON);
            let covariance = R * spread * R.inverse();
            let off = match covariance.try_inverse() {
                Some(inverse) => error.dot(&(inverse * error)).max(0.0).sqrt(),
                None => f64::INFINITY,
            };
            (off, error.norm(), covariance.trace().max(0.0).sqrt())
        });
        Outcome { result, seconds }
    }
}
