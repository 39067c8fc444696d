//! Rotation with disturbances: deviations from torque-free rotation and from the camera's calibration, as unknowns with
//! priors.
//!
//! The unknowns are a random walk of the angular acceleration in inertial axes, a constant angular acceleration in body axes,
//! errors of the camera's gyro, curvature of the centre of mass's path, and errors of the camera's intrinsics. Each has a
//! prior with a typical width; `prior_scales` selects a larger or smaller one where the images support it. All of them act
//! to first order on a torque-free motion.

use std::rc::Rc;

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::super::free_motion::{FreeMotion, PARAMETERS, SHAPE_SPREAD, Sensitivity, shape_of};
use super::super::intrinsics::{INTRINSICS, Intrinsics};
use super::disturbance_basis::{
    GYRO, Response, clohessy_wiltshire, gyro_error, legendre, responses,
};
use super::{FramePose, PoseModel};
use crate::spatial::exp_so3;

/// Number of intervals with constant angular acceleration in inertial axes.
pub const STEPS: usize = 4;

/// Number of time histories ("acceleration_histories") of the angular acceleration: for each interval, constant in inertial axes from
/// its beginning on; and one that is constant in body axes, as of outgassing.
const COURSES: usize = STEPS + 1;

/// Number of unknowns of the angular acceleration.
pub const TORQUE: usize = 3 * COURSES;

/// Unknowns of a smooth path: position and velocity, then its curvature.
pub const LINE: usize = 6;
const CURVATURE: usize = 9;

/// Index of the first unknown after those of the rotation.
const OTHERS: usize = PARAMETERS + TORQUE;

/// Number of common unknowns of a smooth path: rotation, torque, path, intrinsics.
pub const SMOOTH: usize = OTHERS + LINE + CURVATURE + INTRINSICS;

/// Number of common unknowns with independent positions: rotation, torque, gyro, intrinsics.
pub const INDEPENDENT: usize = OTHERS + GYRO + INTRINSICS;

/// Standard deviation of the prior that fixes the scale: of the depth at the first frame.
const SCALE: f64 = 1e-7;

/// Standard deviations of the disturbances where nothing else is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Widths {
    /// Angular acceleration \[rad/s²\].
    pub acceleration: f64,
    /// Correlation time of the angular acceleration \[s\].
    pub correlation_time: f64,
    /// Acceleration of the centre of mass divided by its distance \[1/s²\].
    pub path: f64,
    /// Random walk of the integrated gyro \[rad/√s\].
    pub gyro_noise: f64,
    /// Bias of the gyro \[rad/s\].
    pub gyro_bias: f64,
    /// Focal length, relative.
    pub focal: f64,
    /// Principal point, divided by the focal length.
    pub centre: f64,
    /// First radial coefficient.
    pub radial: f64,
}

impl Widths {
    /// No disturbances: torque-free rotation and exact calibration, as in a simulation.
    pub const NONE: Self = Self {
        acceleration: 0.0,
        correlation_time: 300.0,
        path: 0.0,
        gyro_noise: 0.0,
        gyro_bias: 0.0,
        focal: 0.0,
        centre: 0.0,
        radial: 0.0,
    };
}

impl Default for Widths {
    /// For a tracked body in low Earth orbit and a calibrated camera. The gravity gradient accelerates a body of
    /// moments `A < B` by at most `1.5 n² (B - A) / I`, some 1e-6 rad/s² for a body of common slenderness. The mean
    /// over 20 to 60 s is less, as the body tumbles: 2.1e-7 rad/s² (root mean square of an axis, random boxes). The
    /// rest is for drag and outgassing; larger torques are found by their evidence. The relative acceleration of the
    /// centre of mass is `3 n²` times the distance.
    fn default() -> Self {
        Self {
            acceleration: 3e-7,
            correlation_time: 300.0,
            path: 4e-6,
            gyro_noise: 1e-4,
            gyro_bias: 1e-4,
            focal: 0.005,
            centre: 0.003,
            radial: 0.01,
        }
    }
}

/// A relative orbit whose directions are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Orbital rate \[rad/s\].
    pub rate: f64,
    /// Direction from the Earth at the first frame, and normal of the orbit, inertial axes.
    pub directions: (Vector3<f64>, Vector3<f64>),
}

/// Derivatives of the position by position and displacement of the line, and values of the curvature's polynomials.
type PathBasis = (Matrix3<f64>, Matrix3<f64>, [f64; 3]);

/// Constants of the fit.
#[derive(Debug)]
struct Fixed {
    times: Vec<f64>,
    R_WC: Vec<UnitQuaternion<f64>>,
    gyro: Vec<SMatrix<f64, 3, GYRO>>,
    /// Position by the unknowns of the path, in each frame.
    path: Vec<PathBasis>,
    /// Velocity at the last frame by the unknowns of the path.
    end_rates: PathBasis,
    widths: Widths,
    noise: f64,
}

/// Factors on the prior widths, selected by the evidence of the images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scales {
    /// Factor on the width of the angular acceleration.
    pub torque: f64,
    /// Factor on the width of the path's curvature, or of the gyro's errors.
    pub other: f64,
}

impl Default for Scales {
    fn default() -> Self {
        Self {
            torque: 1.0,
            other: 1.0,
        }
    }
}

/// A rotation with disturbances. `L` is 0 with a smooth path, and 3 with independent positions.
#[derive(Debug, Clone)]
pub struct DisturbedMotion {
    /// The rotation without disturbances.
    pub motion: FreeMotion,
    /// Angular accelerations in units of their widths.
    torque: SVector<f64, TORQUE>,
    /// Path (line, curvature) or errors of the gyro (bias, increments); curvature and gyro in units of their widths.
    others: SVector<f64, GYRO>,
    /// Positions, if independent.
    t_C: Vec<Vector3<f64>>,
    /// The camera.
    pub intrinsics: Intrinsics,
    /// Scales of the priors.
    pub scales: Scales,
    /// Effective number of unknowns that the priors determine instead of the images.
    pub held: f64,
    /// Standard deviation of the shape's prior in the fit; small for a body that is taken to be a sphere, whose
    /// covariance uses [`SHAPE_SPREAD`] nevertheless.
    pub shape_spread: f64,
    /// Mean of the shape's prior; zero is a sphere.
    shape_mean: SVector<f64, 5>,
    attitudes: Vec<(UnitQuaternion<f64>, Sensitivity)>,
    responses: Vec<Response<COURSES>>,
    fixed: Rc<Fixed>,
}

/// Angular accelerations in inertial axes at a time and an attitude, by unknowns in units of their widths.
fn acceleration_histories(
    times: &[f64],
    widths: &Widths,
) -> impl Fn(f64, &Matrix3<f64>) -> [Matrix3<f64>; COURSES] {
    let first = times.first().copied().unwrap_or_default();
    let interval = (times.last().copied().unwrap_or_default() - first) / STEPS as f64;
    let step = widths.acceleration * (2.0 * interval / widths.correlation_time).sqrt();
    let width = widths.acceleration;
    move |time, R_WB| {
        std::array::from_fn(|k| match k {
            0 => Matrix3::from_diagonal_element(width),
            STEPS => R_WB * width,
            _ if time > first + interval * k as f64 => Matrix3::from_diagonal_element(step),
            _ => Matrix3::zeros(),
        })
    }
}

impl DisturbedMotion {
    /// A model without disturbances yet, for frames at `times` (ascending) of a camera with attitudes `R_WC`. With a
    /// `line` (position at the first frame, displacement to the last) the path is smooth; otherwise `t_C` are the
    /// positions.
    #[expect(clippy::too_many_arguments, reason = "all of them are different")]
    pub fn new(
        motion: FreeMotion,
        t_C: Vec<Vector3<f64>>,
        line: Option<(Vector3<f64>, Vector3<f64>)>,
        times: &[f64],
        R_WC: &[UnitQuaternion<f64>],
        noise: f64,
        widths: Widths,
        orbit: Option<Orbit>,
    ) -> Self {
        let first = times.first().copied().unwrap_or_default();
        let whole = (times.last().copied().unwrap_or_default() - first).max(f64::MIN_POSITIVE);
        // Amplitude of the polynomial of degree 2 for a constant acceleration; degrees 3 and 4 are for its changes.
        let bend = widths.path * whole * whole / 12.0;
        let bends = |values: [f64; 3]| {
            [
                bend * values[0],
                0.25 * bend * values[1],
                0.06 * bend * values[2],
            ]
        };
        let basis = |t: f64| -> PathBasis {
            let share = (t - first) / whole;
            let (by_position, by_displacement) = match orbit {
                Some(Orbit { rate, directions }) if rate > 0.0 => {
                    let (radial, normal) = directions;
                    let (A, B) = clohessy_wiltshire(rate, &radial, &normal, t - first);
                    (A, B / whole)
                }
                _ => (Matrix3::identity(), Matrix3::identity() * share),
            };
            (by_position, by_displacement, bends(legendre(share)))
        };
        let path = times.iter().map(|t| basis(*t));
        // Central differences; an orbit is smooth over seconds.
        let h = 1e-3 * whole;
        let (before, after) = (basis(first + whole - h), basis(first + whole + h));
        let end_rates = (
            (after.0 - before.0) / (2.0 * h),
            (after.1 - before.1) / (2.0 * h),
            // The slopes of Legendre polynomials at the end are n (n + 1).
            bends([6.0, 12.0, 20.0]).map(|b| b / whole),
        );
        let is_turning = R_WC.iter().any(|R| *R != UnitQuaternion::identity());
        let gyro = match is_turning {
            true => gyro_error(times, R_WC, widths.gyro_noise, widths.gyro_bias),
            false => vec![SMatrix::zeros(); times.len()],
        };
        let fixed = Fixed {
            path: path.collect(),
            end_rates,
            times: times.to_vec(),
            R_WC: R_WC.to_vec(),
            gyro,
            widths,
            noise,
        };
        let mut others = SVector::<f64, GYRO>::zeros();
        let mut t_C = t_C;
        // Number of unknowns that a zero width fixes, until the covariance of the fit gives the effective number.
        let camera = [widths.focal, widths.centre, widths.centre, widths.radial];
        let is_smooth = line.is_some();
        let counts = [
            (widths.acceleration == 0.0, TORQUE),
            (is_smooth && widths.path == 0.0, CURVATURE),
            (!is_smooth && !is_turning, GYRO),
            (true, camera.iter().filter(|width| **width == 0.0).count()),
        ];
        let without = counts.iter().filter(|(is_without, _)| *is_without);
        let held = without.map(|(_, count)| *count as f64).sum();
        if let Some((start, displacement)) = line {
            others.fixed_rows_mut::<3>(0).copy_from(&start);
            others.fixed_rows_mut::<3>(3).copy_from(&displacement);
            t_C.clear();
        }
        let mut model = Self {
            motion,
            torque: SVector::zeros(),
            others,
            t_C,
            intrinsics: Intrinsics::default(),
            scales: Scales::default(),
            held,
            shape_spread: SHAPE_SPREAD,
            shape_mean: SVector::zeros(),
            attitudes: Vec::new(),
            responses: Vec::new(),
            fixed: Rc::new(fixed),
        };
        model.propagate();
        model
    }

    /// The same angular velocity with a body of another `shape`, which also becomes the mean of the shape's prior.
    /// `None` if no body can have this shape.
    pub fn with_shape(&self, shape: &SVector<f64, 5>) -> Option<Self> {
        let FreeMotion {
            momentum,
            time,
            R_WB,
            ..
        } = self.motion;
        let w_B = self.motion.w_WB_B(&self.motion.R_WB);
        let motion = FreeMotion::new(shape, momentum, time, R_WB)?;
        let mut other = Self {
            motion: FreeMotion {
                momentum: R_WB * (motion.inertia * w_B),
                ..motion
            },
            ..self.with_expected_shape(shape)
        };
        other.propagate();
        Some(other)
    }

    /// The same model with another mean of the shape's prior; zero is a sphere.
    pub fn with_expected_shape(&self, mean: &SVector<f64, 5>) -> Self {
        Self {
            shape_spread: SHAPE_SPREAD,
            shape_mean: *mean,
            ..self.clone()
        }
    }

    fn propagate(&mut self) {
        let Fixed { times, widths, .. } = &*self.fixed;
        self.attitudes = self.motion.attitudes_and_sensitivities(times);
        self.responses = responses(
            &self.motion,
            times,
            &self.attitudes,
            acceleration_histories(times, widths),
        );
    }

    /// The frames' times \[s\].
    pub fn times(&self) -> &[f64] {
        &self.fixed.times
    }

    /// Angle that the body turns over all frames \[rad\].
    pub fn turn(&self) -> f64 {
        let times = self.times();
        let rate = self.motion.w_WB_B(&self.motion.R_WB).norm();
        rate * (times[times.len() - 1] - times[0])
    }

    /// Prior widths.
    pub fn widths(&self) -> &Widths {
        &self.fixed.widths
    }

    fn by_torque(&self, i: usize) -> SMatrix<f64, 3, TORQUE> {
        let mut out = SMatrix::<f64, 3, TORQUE>::zeros();
        for (k, turn) in self.responses[i].turn.iter().enumerate() {
            out.fixed_columns_mut::<3>(3 * k).copy_from(turn);
        }
        out
    }

    /// Attitude `R_WB` in frame `i`, and the part of its rotation that torques cause (body axes).
    fn attitude(&self, i: usize) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let turn = self.by_torque(i) * self.torque;
        (self.attitudes[i].0 * exp_so3(&turn), turn)
    }

    fn position(&self, i: usize) -> Vector3<f64> {
        match self.t_C.get(i) {
            Some(t_C) => *t_C,
            None => {
                let (by_position, by_displacement, curvature) = &self.fixed.path[i];
                let vector = |k: usize| self.others.fixed_rows::<3>(3 * k).into_owned();
                let bent = curvature.iter().zip(2..).map(|(c, k)| vector(k) * *c);
                by_position * vector(0) + by_displacement * vector(1) + bent.sum::<Vector3<f64>>()
            }
        }
    }

    /// Position and velocity \[1/s\] of the centre of mass at the last frame of a smooth path, in units of its depth
    /// at the first frame, and their derivatives by the common unknowns. `None` if positions are independent.
    pub fn last_centre<const G: usize>(
        &self,
    ) -> Option<(Vector3<f64>, Vector3<f64>, SMatrix<f64, 6, G>)> {
        if !self.t_C.is_empty() {
            return None;
        }
        let last = self.times().len() - 1;
        let mut by_common = SMatrix::<f64, 6, G>::zeros();
        let (by_position, by_displacement, curvature) = &self.fixed.path[last];
        let (speed_by_position, speed_by_displacement, bends) = &self.fixed.end_rates;
        let blocks = [
            (0, by_position, by_displacement, curvature),
            (3, speed_by_position, speed_by_displacement, bends),
        ];
        for (row, first, second, others) in blocks {
            by_common
                .fixed_view_mut::<3, 3>(row, OTHERS)
                .copy_from(first);
            by_common
                .fixed_view_mut::<3, 3>(row, OTHERS + 3)
                .copy_from(second);
            for (c, k) in others.iter().zip(2..) {
                by_common
                    .fixed_view_mut::<3, 3>(row, OTHERS + 3 * k)
                    .fill_diagonal(*c);
            }
        }
        let mut unknowns = SVector::<f64, G>::zeros();
        for k in 0..LINE + CURVATURE {
            unknowns[OTHERS + k] = self.others[k];
        }
        let found = by_common * unknowns;
        Some((
            found.fixed_rows::<3>(0).into_owned(),
            found.fixed_rows::<3>(3).into_owned(),
            by_common,
        ))
    }

    /// The free motion that continues this one after the last frame, with its reference there; the angular acceleration
    /// (inertial axes, \[rad/s²\]) at that time; and the derivatives of rotation (body axes), shape, momentum and
    /// acceleration at the last frame by the common unknowns.
    pub fn last_state<const G: usize>(&self) -> (FreeMotion, Vector3<f64>, SMatrix<f64, 14, G>) {
        let last = self.times().len() - 1;
        let time = self.times()[last];
        let impulse = self.responses[last].impulse;
        let each = |weights: &[Matrix3<f64>; COURSES]| {
            let mut sum = Vector3::zeros();
            for (k, weight) in weights.iter().enumerate() {
                sum += weight * self.torque.fixed_rows::<3>(3 * k);
            }
            sum
        };
        let (R_WB, turn) = self.attitude(last);
        let motion = FreeMotion {
            momentum: self.motion.momentum + each(&impulse),
            time,
            R_WB,
            ..self.motion
        };
        let R = *R_WB.to_rotation_matrix().matrix();
        let mut heights = acceleration_histories(self.times(), &self.fixed.widths)(time, &R);
        // An acceleration in body axes turns with the body: only its part along the momentum persists.
        let along = motion.momentum.normalize();
        heights[STEPS] = along * along.tr_mul(&heights[STEPS]);
        let mut by_common = SMatrix::<f64, 14, G>::zeros();
        let back = exp_so3(&-turn).to_rotation_matrix();
        let by_motion = back.matrix() * self.attitudes[last].1;
        by_common
            .fixed_view_mut::<3, PARAMETERS>(0, 0)
            .copy_from(&by_motion);
        by_common
            .fixed_view_mut::<3, TORQUE>(0, PARAMETERS)
            .copy_from(&self.by_torque(last));
        for k in 0..PARAMETERS {
            by_common[(3 + k, k)] = 1.0;
        }
        for (k, (impulse, height)) in impulse.iter().zip(&heights).enumerate() {
            let at = PARAMETERS + 3 * k;
            by_common.fixed_view_mut::<3, 3>(8, at).copy_from(impulse);
            by_common.fixed_view_mut::<3, 3>(11, at).copy_from(height);
        }
        (motion, each(&heights), by_common)
    }

    /// Values of the common unknowns whose prior is not flat, zero for the others.
    pub fn distances<const L: usize, const G: usize>(&self) -> SVector<f64, G> {
        let mut out = SVector::<f64, G>::zeros();
        out.fixed_rows_mut::<5>(0)
            .copy_from(&shape_of(&self.motion.inertia));
        out.fixed_rows_mut::<TORQUE>(PARAMETERS)
            .copy_from(&self.torque);
        let from = if L == 0 { LINE } else { 0 };
        for k in from..G - OTHERS - INTRINSICS {
            out[OTHERS + k] = self.others[k];
        }
        let camera = self.intrinsics;
        let values = [
            camera.log_focal,
            camera.centre.x,
            camera.centre.y,
            camera.radial,
        ];
        for (k, value) in values.into_iter().enumerate() {
            out[G - INTRINSICS + k] = value;
        }
        out
    }

    /// Standard deviations of the priors on the common unknowns with `scales`; infinite where the prior is flat.
    pub fn deviations<const L: usize, const G: usize>(&self, scales: Scales) -> SVector<f64, G> {
        let widths = self.fixed.widths;
        let curved = OTHERS + if L == 0 { LINE } else { 0 };
        let camera = [widths.focal, widths.centre, widths.centre, widths.radial];
        SVector::from_fn(|k, _| match k {
            0..5 => SHAPE_SPREAD,
            _ if k < PARAMETERS => f64::INFINITY,
            _ if k < OTHERS => scales.torque,
            // The images do not determine the scale: the depth of the centre in the first frame is the unit.
            _ if L == 0 && k == OTHERS + 2 => SCALE,
            _ if k < curved => f64::INFINITY,
            _ if k < G - INTRINSICS => scales.other,
            _ => camera[k + INTRINSICS - G],
        })
    }
}

impl<const L: usize, const G: usize> PoseModel<L, G> for DisturbedMotion {
    const CAMERA: usize = INTRINSICS;

    fn pose(&self, i: usize) -> FramePose {
        let mut R_WB = self.attitude(i).0;
        if L == 3 {
            R_WB = exp_so3(&-(self.fixed.gyro[i] * self.others)) * R_WB;
        }
        FramePose {
            R_CB: self.fixed.R_WC[i].inverse() * R_WB,
            t_C: self.position(i),
        }
    }

    fn pose_by_common(&self, i: usize) -> SMatrix<f64, 6, G> {
        let mut pose = SMatrix::<f64, 6, G>::zeros();
        let (R_WB, turn) = self.attitude(i);
        let back = exp_so3(&-turn).to_rotation_matrix();
        pose.fixed_view_mut::<3, PARAMETERS>(0, 0)
            .copy_from(&(back.matrix() * self.attitudes[i].1));
        pose.fixed_view_mut::<3, TORQUE>(0, PARAMETERS)
            .copy_from(&self.by_torque(i));
        if L == 0 {
            let (by_position, by_displacement, curvature) = &self.fixed.path[i];
            pose.fixed_view_mut::<3, 3>(3, OTHERS)
                .copy_from(by_position);
            pose.fixed_view_mut::<3, 3>(3, OTHERS + 3)
                .copy_from(by_displacement);
            for (c, k) in curvature.iter().zip(2..) {
                pose.fixed_view_mut::<3, 3>(3, OTHERS + 3 * k)
                    .fill_diagonal(*c);
            }
        } else {
            let R_BW = R_WB.inverse().to_rotation_matrix();
            pose.fixed_view_mut::<3, GYRO>(0, OTHERS)
                .copy_from(&(-R_BW.matrix() * self.fixed.gyro[i]));
        }
        pose
    }

    fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    fn held(&self) -> f64 {
        self.held
    }

    fn moved(&self, frames: &[SVector<f64, L>], common: &SVector<f64, G>) -> Option<Self> {
        let motion = self
            .motion
            .moved(&common.fixed_rows::<PARAMETERS>(0).into_owned())?;
        let mut others = self.others;
        for k in 0..G - OTHERS - INTRINSICS {
            others[k] += common[OTHERS + k];
        }
        let camera = |k: usize| common[G - INTRINSICS + k];
        let mut moved = Self {
            motion,
            torque: self.torque + common.fixed_rows::<TORQUE>(PARAMETERS),
            others,
            t_C: (self.t_C.iter().zip(frames))
                .map(|(t, d)| t + Vector3::from_fn(|k, _| d[k]))
                .collect(),
            intrinsics: Intrinsics {
                log_focal: self.intrinsics.log_focal + camera(0),
                centre: self.intrinsics.centre + Vector2::new(camera(1), camera(2)),
                radial: self.intrinsics.radial + camera(3),
            },
            attitudes: Vec::new(),
            responses: Vec::new(),
            scales: self.scales,
            held: self.held,
            shape_spread: self.shape_spread,
            shape_mean: self.shape_mean,
            fixed: Rc::clone(&self.fixed),
        };
        moved.propagate();
        Some(moved)
    }

    fn prior(&self) -> (SVector<f64, G>, SVector<f64, G>) {
        let noise = self.fixed.noise;
        let mut deviations = self.deviations::<L, G>(self.scales);
        deviations.rows_mut(0, 5).fill(self.shape_spread);
        let mut distances = self.distances::<L, G>();
        for k in 0..5 {
            distances[k] -= self.shape_mean[k];
        }
        (deviations.map(|d| (noise / d.max(1e-9)).powi(2)), distances)
    }
}
