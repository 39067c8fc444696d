//! Estimation methods, and their common entry point [`estimate`].

use nalgebra::{UnitQuaternion, Vector3};

use super::{
    EstimateError, MotionEstimate, MotionState, Tracks, TracksError,
    bundle::{self, CameraMotion},
    degenerate, fit_rates,
    masutani1995::{self, Rate},
};
use crate::vision::{Feature, FeatureFrame, Pinhole};

/// Ratio of residual to RMS angular velocity above which the estimated motion is not that of the body.
const MAX_RESIDUAL_RATIO: f64 = 0.3;

/// Estimation method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum EstimationMethod {
    /// Bundle adjustment with torque-free rotation as the model: [`bundle`].
    #[default]
    Bundle,
    /// Masutani 1995, chapter 2: [`masutani1995`].
    Masutani1995,
    /// Torque-free rotation fitted to angular velocities by maximum likelihood: [`fit_rates`].
    MaximumLikelihood,
}

impl EstimationMethod {
    /// All methods by name, the default first.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("bundle", Self::Bundle),
        ("masutani1995", Self::Masutani1995),
        ("maximum_likelihood", Self::MaximumLikelihood),
    ];

    /// The method's name.
    pub fn name(self) -> &'static str {
        let known = Self::NAMES.iter().find(|(_, method)| *method == self);
        known.map_or("", |(name, _)| name)
    }
}

/// Why there is no estimate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MethodError {
    /// Error of bundle adjustment.
    #[error(transparent)]
    Bundle(#[from] EstimateError),
    /// Error of the method of Masutani 1995.
    #[error(transparent)]
    Masutani1995(#[from] masutani1995::MasutaniError),
    /// No method can determine a motion from these tracks.
    #[error(transparent)]
    Degenerate(EstimateError),
    /// The tracks are invalid after removal of the camera's own rotation.
    #[error("with the camera's own rotation removed: {0}")]
    Derotated(#[from] TracksError),
}

/// Result of an estimation.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimated {
    /// The method.
    pub method: EstimationMethod,
    /// The motion, in inertial axes I: those of [`CameraMotion`], or the camera's if it is fixed.
    pub motion: MotionEstimate,
    /// Angular velocities over time in I \[rad/s\]: fitted ones at each frame or sample, or those measured between
    /// frames (Masutani 1995).
    pub w_IB_I: Vec<Rate>,
    /// Full result of bundle adjustment; `None` for the other methods.
    pub solution: Option<bundle::Solution>,
    /// State at the last observation with its covariance; `None` for the method of Masutani 1995.
    pub state: Option<MotionState>,
    /// Remarks for the user, one line each.
    pub diagnosis: Vec<String>,
}

/// Estimates the motion of the rigid body that `tracks` show. Of the options, the method of Masutani 1995 uses only the
/// camera's motion and the pixel noise.
///
/// # Errors
/// [`MethodError`] if the tracks do not determine a motion.
///
/// # Example
/// A camera with 1024 px observes twelve points on a tumbling body for 30 s. The motion is estimated from their image
/// points, and predicts the attitude half a minute later.
/// ```
/// use fuyu_physics::estimation::free_body::FreeRotation;
/// use fuyu_physics::estimation::{EstimationMethod, Feature, FeatureFrame, Tracks, bundle, estimate};
/// use fuyu_physics::vision::Pinhole;
/// use nalgebra::{Matrix3, UnitQuaternion, Vector3};
///
/// // The true motion: torque-free rotation of a body with three different moments of inertia.
/// let inertia = Matrix3::from_diagonal(&Vector3::new(7.0, 4.0, 3.0));
/// let rate = Vector3::new(0.1, 0.35, 0.2); // rad/s
/// let truth = FreeRotation::new(&inertia, UnitQuaternion::identity(), &rate, 0.0)?;
///
/// // Synthetic tracks, with pixels rounded to whole numbers: one frame every 0.5 s.
/// let camera = Pinhole::square(1024, 1.25);
/// let point = |id: u32| {
///     let a = f64::from(id);
///     Vector3::new((2.1 * a).sin(), (1.3 * a).cos(), (3.7 * a).sin()) * 0.3
/// };
/// let frames = (0..=60).map(|k| {
///     let time = 0.5 * f64::from(k);
///     let features = (0..12).filter_map(|id| {
///         let p_C = truth.attitude(time) * point(id) + Vector3::new(0.0, 0.0, 1.5);
///         let [u, v] = camera.project(&p_C)?;
///         Some(Feature { id: id.into(), u: u.round(), v: v.round() })
///     });
///     FeatureFrame::new(time, features.collect())
/// });
/// let tracks = Tracks::new(frames)?;
///
/// let options = bundle::Options::default();
/// let estimated = estimate(EstimationMethod::Bundle, &tracks, &camera, &options)?;
///
/// // Prediction: the rotation from the last frame (30 s) to 60 s, which does not depend on the choice of body axes.
/// let motion = &estimated.motion;
/// let predicted = motion.attitude(60.0) / motion.attitude(30.0);
/// let actual = truth.attitude(60.0) / truth.attitude(30.0);
/// assert!(predicted.angle_to(&actual) < 1f64.to_radians());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn estimate(
    method: EstimationMethod,
    tracks: &Tracks,
    camera: &Pinhole,
    options: &bundle::Options,
) -> Result<Estimated, MethodError> {
    match method {
        EstimationMethod::Bundle => {
            let solution = bundle::estimate(tracks, camera, options)?;
            let times = tracks.frames().iter().map(|s| s.time);
            Ok(Estimated {
                method,
                w_IB_I: times
                    .map(|t| (t, solution.motion.angular_velocity(t)))
                    .collect(),
                motion: solution.motion.clone(),
                diagnosis: solution.diagnosis.clone(),
                state: Some(solution.state.clone()),
                solution: Some(solution),
            })
        }
        EstimationMethod::Masutani1995 | EstimationMethod::MaximumLikelihood => {
            degenerate::check(tracks, options.pixel_noise).map_err(MethodError::Degenerate)?;
            let at_rest = options.camera_motion == CameraMotion::Fixed;
            let derotated = match at_rest {
                true => None,
                false => Some(derotated(tracks, camera, &options.camera_motion)?),
            };
            let tracks = derotated.as_ref().unwrap_or(tracks);
            let rates = masutani1995::rates_from_tracks(tracks, camera)?;
            match method {
                EstimationMethod::MaximumLikelihood => Ok(fit_rates(&rates, &options.widths)?),
                _ => from_rates(&rates),
            }
        }
    }
}

/// Estimates a motion from angular velocities in inertial axes, by the method of Masutani 1995.
///
/// # Errors
/// [`MethodError`] if they do not determine a motion.
pub fn from_rates(rates: &[Rate]) -> Result<Estimated, MethodError> {
    let motion = masutani1995::estimate(rates, &masutani1995::Options::default())?;
    let squares: f64 = rates.iter().map(|(_, w)| w.norm_squared()).sum();
    let rms_rate = (squares / rates.len().max(1) as f64).sqrt();
    let is_wrong = motion.rms() > MAX_RESIDUAL_RATIO * rms_rate;
    let note = format!(
        "the motion found leaves residuals of {:.3} rad/s, with angular velocities of {rms_rate:.3} rad/s: it is not that of \
         the body",
        motion.rms()
    );
    Ok(Estimated {
        method: EstimationMethod::Masutani1995,
        motion,
        w_IB_I: rates.to_vec(),
        solution: None,
        state: None,
        diagnosis: is_wrong.then_some(note).into_iter().collect(),
    })
}

/// The tracks with the camera's own rotation removed. This is possible without depths, since a rotation of the camera
/// moves image points independently of their depth.
fn derotated(
    tracks: &Tracks,
    camera: &Pinhole,
    motion: &CameraMotion,
) -> Result<Tracks, TracksError> {
    let R_IC = motion.lookup();
    Tracks::new(tracks.frames().iter().map(|sighting| {
        let R = R_IC(sighting.time);
        let turned = sighting.features.iter().filter_map(|f| {
            let [u, v] = camera.project(&(R * camera.ray(f.u, f.v)))?;
            Some(Feature { id: f.id, u, v })
        });
        FeatureFrame::new(sighting.time, turned.collect())
    }))
}

impl Estimated {
    /// Attitude `R_CB` and angular velocity `w_IB_C` \[rad/s\] of the body at `time` \[s\], in the axes C of a camera
    /// with attitude `R_IC`.
    pub fn seen_from(
        &self,
        R_IC: &UnitQuaternion<f64>,
        time: f64,
    ) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let R_CI = R_IC.inverse();
        let w = self.motion.angular_velocity(time);
        (R_CI * self.motion.attitude(time), R_CI * w)
    }
}
