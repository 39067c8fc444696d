//! The two ways from tracks to a motion, behind one call.

use nalgebra::{UnitQuaternion, Vector3};

use super::{
    EstimateError, MotionEstimate, Tracks, TracksError,
    bundle::{self, CameraMotion},
    degenerate,
    masutani1995::{self, Rate},
};
use crate::vision::{Feature, Pinhole, Sighting};

/// A motion that leaves this share of the angular velocities is not that of the body.
const UNLIKE: f64 = 0.3;

/// How a motion is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Bundle adjustment with free rotation as the model: [`bundle`].
    #[default]
    Bundle,
    /// Masutani 1995, chapter 2: [`masutani1995`].
    Masutani1995,
}

impl Method {
    /// All methods by name, the default first.
    pub const NAMES: [(&'static str, Self); 2] = [
        ("bundle", Self::Bundle),
        ("masutani1995", Self::Masutani1995),
    ];

    /// The method's name.
    pub fn name(self) -> &'static str {
        let known = Self::NAMES.iter().find(|(_, method)| *method == self);
        known.map_or("", |(name, _)| name)
    }
}

/// Why there is no motion.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MethodError {
    /// By bundle adjustment.
    #[error(transparent)]
    Bundle(#[from] EstimateError),
    /// By the thesis's method.
    #[error(transparent)]
    Masutani1995(#[from] masutani1995::EstimateError),
    /// No method could tell one from these tracks.
    #[error(transparent)]
    Degenerate(EstimateError),
    /// Nothing is left once the camera's own rotation is taken out.
    #[error("with the camera's own rotation taken out: {0}")]
    Derotated(#[from] TracksError),
}

/// What a method found.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimated {
    /// By which method.
    pub method: Method,
    /// The motion, in inertial axes I: the camera's where its own motion begins to be known.
    pub motion: MotionEstimate,
    /// Angular velocities in I over time \[rad/s\]: as fitted by bundle adjustment at each frame; as measured
    /// between frames by the thesis's method.
    pub w_IB_I: Vec<Rate>,
    /// All that bundle adjustment found.
    pub solution: Option<bundle::Solution>,
    /// What to know about the answer, one line each.
    pub diagnosis: Vec<String>,
}

/// Estimates the motion of the one rigid body that `tracks` show. The camera turns as `options` say; the
/// thesis's method heeds only that of them.
///
/// # Errors
/// [`MethodError`] if the tracks do not tell a motion.
pub fn estimate(
    method: Method,
    tracks: &Tracks,
    camera: &Pinhole,
    options: &bundle::Options,
) -> Result<Estimated, MethodError> {
    match method {
        Method::Bundle => {
            let solution = bundle::estimate(tracks, camera, options)?;
            let times = tracks.sightings().iter().map(|s| s.time);
            Ok(Estimated {
                method,
                w_IB_I: times
                    .map(|t| (t, solution.motion.angular_velocity(t)))
                    .collect(),
                motion: solution.motion.clone(),
                diagnosis: solution.diagnosis.clone(),
                solution: Some(solution),
            })
        }
        Method::Masutani1995 => {
            degenerate::check(tracks, options.pixel_noise).map_err(MethodError::Degenerate)?;
            let at_rest = options.camera_motion == CameraMotion::Fixed;
            let derotated = match at_rest {
                true => None,
                false => Some(derotated(tracks, camera, &options.camera_motion)?),
            };
            let tracks = derotated.as_ref().unwrap_or(tracks);
            from_rates(&masutani1995::rates_from_tracks(tracks, camera)?)
        }
    }
}

/// Estimates a motion from angular velocities in inertial axes, by the thesis's method.
///
/// # Errors
/// [`MethodError`] if they do not tell a motion.
pub fn from_rates(rates: &[Rate]) -> Result<Estimated, MethodError> {
    let motion = masutani1995::estimate(rates, &masutani1995::Options::default())?;
    let squares: f64 = rates.iter().map(|(_, w)| w.norm_squared()).sum();
    let fastest = (squares / rates.len().max(1) as f64).sqrt();
    let unlike = motion.rms() > UNLIKE * fastest;
    let note = format!(
        "the motion found leaves {:.3} rad/s of angular velocities of {fastest:.3} rad/s: it is not that of the body",
        motion.rms()
    );
    Ok(Estimated {
        method: Method::Masutani1995,
        motion,
        w_IB_I: rates.to_vec(),
        solution: None,
        diagnosis: unlike.then_some(note).into_iter().collect(),
    })
}

/// The tracks as a camera at the same places would see them that does not turn: a camera's rotation moves
/// image points alike whatever their depth.
fn derotated(
    tracks: &Tracks,
    camera: &Pinhole,
    motion: &CameraMotion,
) -> Result<Tracks, TracksError> {
    let R_IC = motion.lookup();
    Tracks::new(tracks.sightings().iter().map(|sighting| {
        let R = R_IC(sighting.time);
        let turned = sighting.features.iter().filter_map(|f| {
            let [u, v] = camera.project(&(R * camera.ray(f.u, f.v)))?;
            Some(Feature { id: f.id, u, v })
        });
        Sighting::new(sighting.time, turned.collect())
    }))
}

impl Estimated {
    /// The body's attitude `R_CB` and angular velocity `w_IB_C` \[rad/s\] at `time` \[s\], in axes C that are
    /// turned by `R_IC`.
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
