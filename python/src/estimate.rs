//! Estimation of a tumbling body's motion from arrays.

use fuyu::estimation::bundle::{CameraMotion, Options, Widths};
use fuyu::estimation::{Estimated, EstimationMethod, Feature, FeatureFrame, Tracks};
use fuyu::spatial::unwound;
use fuyu::vision::Pinhole;
use nalgebra::{UnitQuaternion, Vector3};
use numpy::{
    AllowTypeChange, PyArray1, PyArray2, PyArrayDyn, PyArrayLike1, PyArrayMethods,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::arrays::{Given, array, check_finite, shaped};
use crate::error::{choose, finite, input, not_negative, positive};

/// One element and one row of numbers for each of several things.
type Rows<'py, T> = (Bound<'py, PyArray1<T>>, Bound<'py, PyArray2<f64>>);

/// The estimated motion of a body: a torque-free rotation in closed form.
///
/// Attitudes and angular velocities are in the inertial axes I of the estimate: the camera's at the first of the `camera_rates`, or
/// the camera's axes if none were given.
#[pyclass(frozen, module = "fuyu")]
pub struct MotionEstimate {
    estimated: Estimated,
}

/// Estimates the motion of a tumbling body from feature tracks.
///
/// `t` [s], `id`, `u`, `v` [px, pixel centres at integers] have one element per image point, shape (k,); points with the same time are
/// a frame, frames are in the order of time. `fx`, `fy`, `cx`, `cy` [px] are the camera's; `fy` is `fx` by default. `method` is
/// bundle, maximum_likelihood or masutani1995. `pixel_noise` [px] is the standard deviation of an image coordinate.
/// `camera_rates` is (times, shape (j,) [s], angular velocities of the camera in its own axes, shape (j, 3) [rad/s]) of a gyro;
/// without it the camera does not rotate.
///
/// The other numbers are standard deviations of what is estimated too, by the method bundle: `focal_deviation`, relative to the focal
/// length; `centre_deviation` of the principal point, over the focal length; `radial_deviation` of the first radial coefficient of
/// distortion; `disturbance` [rad/s2], the body's angular acceleration by torques; `gyro_noise` [rad/sqrt(s)] and `gyro_bias`
/// [rad/s]. With 0 it is known exactly; the defaults are those of `fuyu estimate`. The interpreter's lock is released.
#[pyfunction]
#[pyo3(signature = (
    t, id, u, v, *, fx, fy = None, cx, cy, method = "bundle", pixel_noise = 0.3, camera_rates = None, focal_deviation = None,
    centre_deviation = None, radial_deviation = None, disturbance = None, gyro_noise = None, gyro_bias = None
))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub fn estimate<'py>(
    py: Python<'py>,
    t: Given<'py>,
    id: PyArrayLike1<'py, i64, AllowTypeChange>,
    u: Given<'py>,
    v: Given<'py>,
    fx: f64,
    fy: Option<f64>,
    cx: f64,
    cy: f64,
    method: &str,
    pixel_noise: f64,
    camera_rates: Option<(Given<'py>, Given<'py>)>,
    focal_deviation: Option<f64>,
    centre_deviation: Option<f64>,
    radial_deviation: Option<f64>,
    disturbance: Option<f64>,
    gyro_noise: Option<f64>,
    gyro_bias: Option<f64>,
) -> PyResult<MotionEstimate> {
    let [t, u, v] = [("t", &t), ("u", &u), ("v", &v)].map(|(name, given)| column(name, given));
    let (t, u, v) = (t?, u?, v?);
    let id: Vec<i64> = id.as_array().iter().copied().collect();
    for (name, length) in [("id", id.len()), ("u", u.len()), ("v", v.len())] {
        if length != t.len() {
            return Err(input(format!(
                "`{name}` has {length} elements, but `t` has {}",
                t.len()
            )));
        }
    }
    let tracks = Tracks::new(frames(&t, &id, &u, &v)?).map_err(input)?;
    let camera = Pinhole {
        fx,
        fy: fy.unwrap_or(fx),
        cx,
        cy,
    };
    camera.check().map_err(input)?;
    let mut widths = Widths::default();
    for (name, given, width) in [
        ("focal_deviation", focal_deviation, &mut widths.focal),
        ("centre_deviation", centre_deviation, &mut widths.centre),
        ("radial_deviation", radial_deviation, &mut widths.radial),
        ("disturbance", disturbance, &mut widths.acceleration),
        ("gyro_noise", gyro_noise, &mut widths.gyro_noise),
        ("gyro_bias", gyro_bias, &mut widths.gyro_bias),
    ] {
        if let Some(given) = given {
            *width = not_negative(name, given)?;
        }
    }
    let options = Options {
        pixel_noise: positive("pixel_noise", pixel_noise)?,
        widths,
        camera_motion: match &camera_rates {
            None => CameraMotion::Fixed,
            Some((times, rates)) => CameraMotion::Rates(timed_rates("camera_rates", times, rates)?),
        },
        ..Options::default()
    };
    let method = choose("method", &EstimationMethod::NAMES, method)?;
    let found = py.detach(|| fuyu::estimation::estimate(method, &tracks, &camera, &options));
    Ok(MotionEstimate {
        estimated: found.map_err(input)?,
    })
}

/// Estimates the motion of a tumbling body from its angular velocity `w`, shape (k, 3) [rad/s], in inertial axes at times `t`, shape (k,)
/// [s]. `method` is maximum_likelihood, which has a covariance, or masutani1995 (chapter 2 of the thesis). `disturbance` [rad/s2] is the
/// standard deviation of the body's angular acceleration by torques (maximum_likelihood).
#[pyfunction]
#[pyo3(signature = (t, w, *, method = "maximum_likelihood", disturbance = None))]
pub fn estimate_rates<'py>(
    py: Python<'py>,
    t: Given<'py>,
    w: Given<'py>,
    method: &str,
    disturbance: Option<f64>,
) -> PyResult<MotionEstimate> {
    let rates = timed_rates("w", &t, &w)?;
    let mut widths = Widths::default();
    if let Some(disturbance) = disturbance {
        widths.acceleration = not_negative("disturbance", disturbance)?;
    }
    let for_rates: Vec<_> = EstimationMethod::NAMES
        .into_iter()
        .filter(|(_, method)| *method != EstimationMethod::Bundle)
        .collect();
    let found = match choose("method", &for_rates, method)? {
        EstimationMethod::Masutani1995 => py
            .detach(|| fuyu::estimation::from_rates(&rates))
            .map_err(input)?,
        _ => py
            .detach(|| fuyu::estimation::fit_rates(&rates, &widths))
            .map_err(input)?,
    };
    Ok(MotionEstimate { estimated: found })
}

/// One number per image point.
fn column(name: &str, given: &Given<'_>) -> PyResult<Vec<f64>> {
    if given.shape().len() != 1 {
        let shape = given.shape();
        return Err(input(format!(
            "`{name}` has the shape {shape:?}; it must have one axis"
        )));
    }
    Ok(given.as_array().iter().copied().collect())
}

/// Image points of the same time are a frame.
fn frames(t: &[f64], id: &[i64], u: &[f64], v: &[f64]) -> PyResult<Vec<FeatureFrame>> {
    let mut frames: Vec<FeatureFrame> = Vec::new();
    for (k, &time) in t.iter().enumerate() {
        let id = u64::try_from(id[k])
            .map_err(|_| input(format!("`id[{k}]` is {}; it must not be negative", id[k])))?;
        let feature = Feature {
            id,
            u: u[k],
            v: v[k],
        };
        match frames.last_mut() {
            Some(frame) if frame.time == time => frame.features.push(feature),
            _ => frames.push(FeatureFrame::new(time, vec![feature])),
        }
    }
    Ok(frames)
}

/// Angular velocities with their times, which increase.
fn timed_rates(
    name: &str,
    times: &Given<'_>,
    rates: &Given<'_>,
) -> PyResult<Vec<(f64, Vector3<f64>)>> {
    let times = column("times", times)?;
    if rates.shape() != [times.len(), 3] {
        let (shape, count) = (rates.shape(), times.len());
        return Err(input(format!(
            "`{name}` has the shape {shape:?}; it must be ({count}, 3), a row per time"
        )));
    }
    let rates: Vec<f64> = rates.as_array().iter().copied().collect();
    check_finite("times", &times)?;
    check_finite(name, &rates)?;
    if let Some(k) = (1..times.len()).find(|k| times[*k] <= times[k - 1]) {
        return Err(input(format!(
            "`times[{k}]` is {} s, but the time before is {} s; times must increase",
            times[k],
            times[k - 1]
        )));
    }
    let rows = rates.chunks_exact(3).map(Vector3::from_column_slice);
    Ok(times.into_iter().zip(rows).collect())
}

#[pymethods]
#[expect(non_snake_case, reason = "the thesis's symbol")]
impl MotionEstimate {
    /// Name of the method.
    #[getter]
    fn method(&self) -> &'static str {
        self.estimated.method.name()
    }

    /// Kind of motion: asymmetric, aperiodic, axisymmetric or single_axis.
    #[getter]
    fn model(&self) -> &'static str {
        self.estimated.motion.model().name()
    }

    /// Moments of inertia over twice the energy, shape (3,) [s2]; None if the motion does not determine them.
    #[getter]
    fn J<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let J = self.estimated.motion.J()?;
        Some(array(py, J.as_slice()))
    }

    /// L2/4E2 [s2], with the angular momentum L and the energy E.
    #[getter]
    fn alpha(&self) -> f64 {
        self.estimated.motion.alpha()
    }

    /// Covariance of (J, alpha), shape (4, 4) [s4]; None if the method has none.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArrayDyn<f64>>>> {
        let covariance = self.estimated.motion.covariance();
        // Symmetric, so the order of the axes does not matter.
        let array = covariance.map(|c| shaped(py, c.as_slice().to_vec(), vec![4, 4]));
        array.transpose()
    }

    /// RMS residual of image points [px] or angular velocities [rad/s].
    #[getter]
    fn rms(&self) -> f64 {
        self.estimated.motion.rms()
    }

    /// Direction of the angular momentum in I, shape (3,).
    #[getter]
    fn momentum_direction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.estimated.motion.momentum_direction().as_slice())
    }

    /// Remarks, one line each.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.estimated.diagnosis.clone()
    }

    /// The estimated focal length [px], or that of the camera; None for other methods than bundle.
    #[getter]
    fn focal_length(&self) -> Option<f64> {
        self.estimated.solution.as_ref().map(|s| s.camera.fx)
    }

    /// Ids, shape (k,), and positions in body axes, shape (k, 3) [mean depth of the points], of the body's feature points; None for
    /// other methods than bundle.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Option<Rows<'py, u64>>> {
        let Some(solution) = &self.estimated.solution else {
            return Ok(None);
        };
        let ids: Vec<u64> = solution.points.iter().map(|p| p.id).collect();
        let points = solution.points.iter();
        let values: Vec<f64> = points.flat_map(|p| [p.p_B.x, p.p_B.y, p.p_B.z]).collect();
        let positions = PyArray1::from_vec(py, values).reshape([ids.len(), 3])?;
        Ok(Some((PyArray1::from_vec(py, ids), positions)))
    }

    /// Angular velocities over time in I: times, shape (k,) [s], and values, shape (k, 3) [rad/s].
    #[getter]
    fn angular_velocities<'py>(&self, py: Python<'py>) -> PyResult<Rows<'py, f64>> {
        let rates = &self.estimated.w_IB_I;
        let times: Vec<f64> = rates.iter().map(|(t, _)| *t).collect();
        let values: Vec<f64> = rates.iter().flat_map(|(_, w)| [w.x, w.y, w.z]).collect();
        let values = PyArray1::from_vec(py, values).reshape([times.len(), 3])?;
        Ok((PyArray1::from_vec(py, times), values))
    }

    /// Attitude of the body in I at `t`, shape (...) [s], past or future: shape (..., 4), x, y, z, w, without jumps of the sign
    /// along the array. The body's axes are arbitrary, but the same at all times.
    fn attitude<'py>(
        &self,
        py: Python<'py>,
        t: Given<'py>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let times = times(&t)?;
        let attitudes = unwound(times.iter().map(|t| self.estimated.motion.attitude(*t)));
        let values = attitudes.into_iter();
        let values = values.flat_map(|q: UnitQuaternion<f64>| [q.i, q.j, q.k, q.w]);
        let shape = t.shape().iter().copied().chain([4]).collect();
        shaped(py, values.collect(), shape)
    }

    /// Angular velocity of the body in I at `t`, shape (...) [s]: shape (..., 3) [rad/s].
    fn angular_velocity<'py>(
        &self,
        py: Python<'py>,
        t: Given<'py>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let times = times(&t)?;
        let rates = times
            .iter()
            .map(|t| self.estimated.motion.angular_velocity(*t));
        let values = rates.flat_map(|w| [w.x, w.y, w.z]).collect();
        let shape = t.shape().iter().copied().chain([3]).collect();
        shaped(py, values, shape)
    }

    /// Covariance of the rotation from the time `start` to the time `end` [s], shape (3, 3) [rad2]: of the rotation vector of its error
    /// in I, where estimate = exp(error) truth. None for masutani1995.
    fn turn_covariance<'py>(
        &self,
        py: Python<'py>,
        start: f64,
        end: f64,
    ) -> PyResult<Option<Bound<'py, PyArrayDyn<f64>>>> {
        let (start, end) = (finite("start", start)?, finite("end", end)?);
        let Some(state) = &self.estimated.state else {
            return Ok(None);
        };
        let covariance = state.covariance_between(start, end);
        let rows = covariance.transpose().as_slice().to_vec();
        shaped(py, rows, vec![3, 3]).map(Some)
    }

    fn __repr__(&self) -> String {
        let motion = &self.estimated.motion;
        format!(
            "<fuyu.MotionEstimate: {} by {}, rms {}>",
            motion.model().name(),
            self.estimated.method.name(),
            motion.rms()
        )
    }
}

fn times(t: &Given<'_>) -> PyResult<Vec<f64>> {
    let times: Vec<f64> = t.as_array().iter().copied().collect();
    check_finite("t", &times)?;
    Ok(times)
}
