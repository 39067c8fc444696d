//! The integrated algorithm: Masutani 1995 sec. 2.4.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, UnitVector3, Vector3};

use super::{
    InvariablePlane, MasutaniError, MeanPrecession, Options, Pulse, Rate, Spectrum, Waveform,
    moments::{self, Observed},
    rates_from_tracks,
};
use crate::estimation::free_body::{DynamicParameters, FreeRotation, frame};
use crate::estimation::{MotionEstimate, MotionModel, Tracks};
use crate::vision::Pinhole;

/// Least number of angular velocities: a waveform has four parameters.
pub(super) const MIN_RATES: usize = 8;

/// Scatter below this share of the angular velocity is rounding error.
const CONSTANT: f64 = 1e-9;

/// Largest excess of the largest moment over the sum of the others, relative to the sum, before the result is refused:
/// noise may push a flat body beyond the triangle inequality.
const TRIANGLE_SLACK: f64 = 0.1;

/// Analysis of the angular velocities before a model is fitted, and the choice of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Analysis {
    /// The invariable plane.
    pub plane: InvariablePlane,
    /// Mean angular velocity in camera axes \[rad/s\].
    pub mean: Vector3<f64>,
    /// RMS deviation from the mean, `sigma_v` \[rad/s\].
    pub scatter: f64,
    /// The spectrum of `|w|²`.
    pub spectrum: Spectrum,
    /// The model chosen, sec. 2.4.5.
    pub model: MotionModel,
}

/// Intermediate results of the model's fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fit {
    /// Asymmetric model.
    Asymmetric {
        /// The waveform of `|w|²`.
        waveform: Waveform,
        /// Mean rate of the herpolhode.
        precession: MeanPrecession,
    },
    /// Aperiodic model.
    Aperiodic(Pulse),
    /// Axisymmetric model.
    Axisymmetric(MeanPrecession),
    /// Single-axis model; no fit.
    SingleAxis,
}

/// Estimates a motion from angular velocities in the order of time.
///
/// # Errors
/// [`MasutaniError`] if the data are invalid, or are not those of a free body.
pub fn estimate(rates: &[Rate], options: &Options) -> Result<MotionEstimate, MasutaniError> {
    let (estimate, _) = Analysis::new(rates, options)?.solve(rates, options)?;
    Ok(estimate)
}

/// Estimates a motion from feature tracks, by the rates between consecutive frames.
///
/// # Errors
/// [`MasutaniError`] if no two consecutive frames determine a motion, or as for [`estimate`].
pub fn from_tracks(
    tracks: &Tracks,
    camera: &Pinhole,
    options: &Options,
) -> Result<MotionEstimate, MasutaniError> {
    estimate(&rates_from_tracks(tracks, camera)?, options)
}

impl Analysis {
    /// Analyses angular velocities in the order of time, and chooses a model.
    ///
    /// # Errors
    /// [`MasutaniError`] if they are invalid, or do not lie in a plane.
    pub fn new(rates: &[Rate], options: &Options) -> Result<Self, MasutaniError> {
        check(rates)?;
        let plane = InvariablePlane::fit(rates)?;
        let n = rates.len() as f64;
        let mean = rates.iter().map(|(_, w)| w).sum::<Vector3<f64>>() / n;
        let deviations = rates.iter().map(|(_, w)| (w - mean).norm_squared());
        let scatter = (deviations.sum::<f64>() / (n - 1.0)).sqrt();
        let duration = rates[rates.len() - 1].0 - rates[0].0;
        let spectrum = Spectrum::of(&squares(rates), options);
        let constant = scatter < CONSTANT * mean.norm();
        let model = if constant || scatter < options.single_axis * plane.scatter {
            MotionModel::SingleAxis
        } else if !spectrum.distinct {
            MotionModel::Axisymmetric
        } else if options.aperiodic && spectrum.period > duration / options.periods {
            MotionModel::Aperiodic
        } else {
            MotionModel::Asymmetric
        };
        Ok(Self {
            plane,
            mean,
            scatter,
            spectrum,
            model,
        })
    }

    /// Fits the chosen model to the same angular velocities.
    ///
    /// # Errors
    /// [`MasutaniError`] if the fit fails, or no body has its result.
    pub fn solve(
        &self,
        rates: &[Rate],
        options: &Options,
    ) -> Result<(MotionEstimate, Fit), MasutaniError> {
        let (rotation, fit) = match self.model {
            MotionModel::Asymmetric => self.asymmetric(rates, options)?,
            MotionModel::Aperiodic => self.aperiodic(rates, options)?,
            MotionModel::Axisymmetric => self.axisymmetric(rates, options)?,
            MotionModel::SingleAxis => (
                FreeRotation::single_axis(&self.mean, rates[0].0),
                Fit::SingleAxis,
            ),
        };
        let squares = rates
            .iter()
            .map(|(t, w)| (w - rotation.angular_velocity(*t)).norm_squared());
        let rms = (squares.sum::<f64>() / rates.len() as f64).sqrt();
        Ok((MotionEstimate::new(self.model, rotation, rms, None), fit))
    }

    /// Sec. 2.4.1.
    fn asymmetric(
        &self,
        rates: &[Rate],
        options: &Options,
    ) -> Result<(FreeRotation, Fit), MasutaniError> {
        let samples = squares(rates);
        let waveform = Waveform::fit(&samples, &self.spectrum, options);
        let waveform = waveform.ok_or(MasutaniError::NoFit {
            period: self.spectrum.period,
        })?;
        let precession = MeanPrecession::fit(rates, &self.plane);
        let observed = Observed {
            alpha: self.plane.alpha,
            beta: waveform.beta,
            gamma: waveform.gamma(),
            k: waveform.k,
            precession: precession.rate,
        };
        let parameters = self.body(observed.asymmetric())?;
        let start = rates[0].0;
        let time = start + waveform.last_maximum(rates[rates.len() - 1].0 - start);
        let R_CR = self.reference_frame(&self.direction_at(rates, time), &parameters);
        Ok((
            FreeRotation::from_parameters(parameters, R_CR, time),
            Fit::Asymmetric {
                waveform,
                precession,
            },
        ))
    }

    /// Sec. 2.4.2.
    fn aperiodic(
        &self,
        rates: &[Rate],
        options: &Options,
    ) -> Result<(FreeRotation, Fit), MasutaniError> {
        let pulse = Pulse::fit(&squares(rates), self.plane.alpha, options);
        let pulse = pulse.ok_or(MasutaniError::NoFit {
            period: self.spectrum.period,
        })?;
        let time = rates[0].0 + pulse.delta / pulse.lambda;
        // The fastest moment may lie outside the observation, so the herpolhode's angle is taken where its radius is
        // largest, and extrapolated at its constant rate (2.46).
        let n = self.plane.normal;
        let radius = |w: &Vector3<f64>| in_plane(&n, w).norm_squared();
        let widest = rates
            .iter()
            .max_by(|a, b| radius(&a.1).total_cmp(&radius(&b.1)));
        let (stamp, w) = widest.copied().unwrap_or(rates[0]);
        let angle = (time - stamp) / self.plane.alpha.sqrt();
        let R_CR = frame(&n, Some(&w)) * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        Ok((
            FreeRotation::aperiodic(self.plane.alpha, pulse.lambda, R_CR, time),
            Fit::Aperiodic(pulse),
        ))
    }

    /// Sec. 2.4.3.
    fn axisymmetric(
        &self,
        rates: &[Rate],
        options: &Options,
    ) -> Result<(FreeRotation, Fit), MasutaniError> {
        let precession = match options.unwrap_to_line {
            true => MeanPrecession::unwrapped_to_line(rates, &self.plane),
            false => MeanPrecession::fit(rates, &self.plane),
        };
        let J = moments::axisymmetric(self.plane.alpha, self.spectrum.mean, precession.rate);
        let parameters = self.body(J)?;
        let towards = precession.direction(precession.phase);
        let R_CR = self.reference_frame(&towards, &parameters);
        Ok((
            FreeRotation::from_parameters(parameters, R_CR, rates[0].0),
            Fit::Axisymmetric(precession),
        ))
    }

    /// Direction of the angular velocity in the invariable plane at `time`: interpolated between samples by angle, since
    /// interpolation of components would shorten the vector.
    fn direction_at(&self, rates: &[Rate], time: f64) -> Vector3<f64> {
        let n = &self.plane.normal;
        let after = rates.partition_point(|(t, _)| *t < time);
        let after = after.clamp(1, rates.len() - 1);
        let [(t0, p0), (t1, p1)] =
            [rates[after - 1], rates[after]].map(|(t, w)| (t, in_plane(n, &w)));
        let angle = n.dot(&p0.cross(&p1)).atan2(p0.dot(&p1));
        UnitQuaternion::from_axis_angle(n, angle * (time - t0) / (t1 - t0)) * p0
    }

    /// The reference frame whose y-z plane contains `w`, with the sign that makes the nutation positive
    /// (Fig. 2.11).
    fn reference_frame(
        &self,
        w: &Vector3<f64>,
        parameters: &DynamicParameters,
    ) -> UnitQuaternion<f64> {
        let J = parameters.J();
        let z = self.plane.normal.into_inner();
        let y = (in_plane(&self.plane.normal, w) * (J.z - J.x).signum()).normalize();
        let axes = Matrix3::from_columns(&[y.cross(&z), y, z]);
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
    }

    /// The parameters, if a body can have them.
    fn body(&self, J: Vector3<f64>) -> Result<DynamicParameters, MasutaniError> {
        let alpha = self.plane.alpha;
        let impossible = MasutaniError::Impossible {
            model: self.model.name(),
            J,
            alpha,
        };
        let parameters = DynamicParameters::new(J, alpha).map_err(|_| impossible.clone())?;
        if 2.0 * J.max() > J.sum() + TRIANGLE_SLACK * J.max() {
            return Err(impossible);
        }
        Ok(parameters)
    }
}

fn check(rates: &[Rate]) -> Result<(), MasutaniError> {
    let bad = |(t, w): &Rate| !(t.is_finite() && w.iter().all(|x| x.is_finite()));
    if let Some(at) = rates.iter().position(bad) {
        return Err(MasutaniError::NotFinite(at));
    }
    if let Some(at) = rates.windows(2).position(|p| p[1].0 <= p[0].0) {
        return Err(MasutaniError::Order {
            sample: at + 1,
            time: rates[at + 1].0,
            before: rates[at].0,
        });
    }
    if rates.len() < MIN_RATES {
        return Err(MasutaniError::TooFew(rates.len()));
    }
    if rates.iter().all(|(_, w)| *w == Vector3::zeros()) {
        return Err(MasutaniError::AtRest);
    }
    Ok(())
}

/// `|w|²` \[rad²/s²\] over the time since the first sample \[s\].
fn squares(rates: &[Rate]) -> Vec<(f64, f64)> {
    let start = rates[0].0;
    let square = |(t, w): &Rate| (t - start, w.norm_squared());
    rates.iter().map(square).collect()
}

/// The component of `w` perpendicular to the normal `n`.
fn in_plane(n: &UnitVector3<f64>, w: &Vector3<f64>) -> Vector3<f64> {
    w - n.into_inner() * n.dot(w)
}
