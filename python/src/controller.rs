//! `Controller`.

use std::sync::{Mutex, MutexGuard, PoisonError};

use fuyu::control::{
    ControlReport, ControllerConfig, Gains, JacobianKind, JointPdConfig, LawConfig, LawKind,
    Measurement, Saturation, TipMeasurement,
};
use fuyu::dynamics::Workspace;
use nalgebra::Vector3;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Given, array, joints, vector};
use crate::error::{choose, finite, input, run};
use crate::model::{Model, find_tip};
use crate::poses::pose;

/// A pose that a caller gives: position and quaternion x, y, z, w.
type GivenPose<'py> = (Given<'py>, Given<'py>);

/// A control law: joint efforts from joint states and from what a camera on the base measures. It does not know the base's pose.
///
/// `law` is transpose_jacobian, straight_path, joint_pd, operational_space or computed_torque; by default computed_torque, or
/// transpose_jacobian if `k_v` is given. `tip` is a link. Gains: `k_p` [N/m] and `k_o` [N m] on the deviation of the
/// tip, `k_v`, shape (n,) [N m s/rad or N s/m], on the joint rates; all three are computed from the robot's inertia and
/// `sample_period` [s] if `k_v` is not given. Errors beyond `e_p_max` [m] and `e_o_max` act as these. `joint_k_p`, shape (n,)
/// [N m/rad or N/m], is for joint_pd, `jacobian` (generalized or fixed_base) for transpose_jacobian and straight_path.
#[pyclass(module = "fuyu")]
pub struct Controller {
    model: Model,
    /// Behind a lock since laws are not shared by threads; only one thread at a time gets here.
    controller: Mutex<fuyu::control::Controller>,
    workspace: Workspace,
    report: Option<ControlReport>,
}

#[pymethods]
impl Controller {
    #[new]
    #[pyo3(signature = (model, law = None, *, tip = None, k_p = 75.0, k_o = 100.0, k_v = None, e_p_max = 0.2, e_o_max = 0.1, joint_k_p = None, jacobian = "generalized", sample_period = 0.01, bumpless_transfer_time = 0.5))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        model: &Model,
        law: Option<&str>,
        tip: Option<&str>,
        k_p: f64,
        k_o: f64,
        k_v: Option<Given<'_>>,
        e_p_max: f64,
        e_o_max: f64,
        joint_k_p: Option<Given<'_>>,
        jacobian: &str,
        sample_period: f64,
        bumpless_transfer_time: f64,
    ) -> PyResult<Self> {
        let robot = &model.robot;
        let tip = find_tip(robot, tip)?;
        let kind = match (law, &k_v) {
            (Some(law), _) => choose("law", &LawKind::NAMES, law)?,
            (None, None) => LawKind::ComputedTorque,
            (None, Some(_)) => LawKind::TransposeJacobian,
        };
        let list = |given: Option<Given<'_>>| -> Vec<f64> {
            given.map_or_else(Vec::new, |given| given.as_array().iter().copied().collect())
        };
        let jacobian = choose("jacobian", &JacobianKind::NAMES, jacobian)?;
        let mut law = LawConfig::from(kind);
        match &mut law {
            LawConfig::TransposeJacobian(law) => law.jacobian = jacobian,
            LawConfig::StraightPath(law) => law.jacobian = jacobian,
            LawConfig::JointPd(law) => {
                *law = JointPdConfig {
                    k_p: list(joint_k_p),
                }
            }
            LawConfig::OperationalSpace(_) | LawConfig::ComputedTorque(_) | LawConfig::Custom => {}
        }
        let gains = Gains {
            k_p,
            k_o,
            k_v: list(k_v),
            saturation: Saturation {
                position: e_p_max,
                orientation: e_o_max,
            },
        };
        let period = crate::error::positive("sample_period", sample_period)?;
        let config = ControllerConfig {
            bumpless_transfer_time,
            ..ControllerConfig::new(law, gains)
        };
        let config = config.with_auto_gains(robot, &tip, period).map_err(input)?;
        let controller = fuyu::control::Controller::new(robot.clone(), tip, config);
        Ok(Self {
            controller: Mutex::new(controller.map_err(input)?),
            workspace: Workspace::new(robot),
            model: model.clone(),
            report: None,
        })
    }

    /// The robot.
    #[getter]
    fn model(&self) -> Model {
        self.model.clone()
    }

    /// Name of the law.
    #[getter]
    fn law(&self) -> &'static str {
        self.locked().config().law.name()
    }

    /// Gains in force: a dict of k_p [N/m], k_o [N m] and k_v, shape (n,) [N m s/rad or N s/m].
    #[getter]
    fn gains<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let controller = self.locked();
        let gains = &controller.config().gains;
        let all = PyDict::new(py);
        all.set_item("k_p", gains.k_p)?;
        all.set_item("k_o", gains.k_o)?;
        all.set_item("k_v", array(py, &gains.k_v))?;
        Ok(all)
    }

    /// Joint efforts, shape (n,) [N m or N], for the joint state `q`, `qd`, each of shape (n,), at `time` [s].
    ///
    /// `goal` is the pose of the goal in the base frame as the camera measures it: (position, shape (3,) [m], quaternion x, y, z, w,
    /// shape (4,)). Without it the joints are only damped. `tip` is the measured pose of the tip, by default the one of the arm's kinematics at
    /// `q`; `exposed_at` [s] the time of the camera's exposure, by default `time`. `base_angular_velocity`, shape (3,) [rad/s], is that of a
    /// gyro, base axes; without it the angular momentum is taken as zero.
    #[pyo3(signature = (time, q, qd, goal = None, *, tip = None, exposed_at = None, base_angular_velocity = None))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn update<'py>(
        &mut self,
        py: Python<'py>,
        time: f64,
        q: Given<'py>,
        qd: Given<'py>,
        goal: Option<GivenPose<'py>>,
        tip: Option<GivenPose<'py>>,
        exposed_at: Option<f64>,
        base_angular_velocity: Option<Given<'py>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let robot = &self.model.robot;
        let (q, qd) = (
            joints("q", Some(&q), robot)?,
            joints("qd", Some(&qd), robot)?,
        );
        let time = finite("time", time)?;
        let exposed_at = finite("exposed_at", exposed_at.unwrap_or(time))?;
        let gyro: Option<Vector3<f64>> = base_angular_velocity
            .map(|w| vector("base_angular_velocity", Some(&w)))
            .transpose()?;
        let seen = match (goal, tip) {
            (None, None) => None,
            (None, Some(_)) => return Err(input("`tip` is given without `goal`; give both")),
            (Some((p, orientation)), tip) => {
                let X_BD = pose("goal", &p, &orientation)?;
                let X_BE = match tip {
                    Some((p, orientation)) => pose("tip", &p, &orientation)?,
                    None => {
                        self.workspace.set_positions(&q);
                        self.workspace.X_BF(self.locked().tip())
                    }
                };
                Some(TipMeasurement::new(exposed_at, X_BE, X_BD))
            }
        };
        let measurement = Measurement::new(time, &q, &qd)
            .with_tip(seen.as_ref())
            .with_gyro(gyro.as_ref());
        self.report = None;
        let mut controller = self.locked();
        let report = controller.update(&measurement);
        let efforts = array(py, controller.efforts().as_slice());
        drop(controller);
        self.report = Some(report.map_err(run)?);
        Ok(efforts)
    }

    /// What the last `update` did, a dict: `active` (whether the law acted), `position_error`, shape (3,) [m], and `angle` [rad] of the
    /// tip from the goal (None without a goal), `position_saturated`, `orientation_saturated`, and `convergence_failure`, a
    /// line if the tip does not converge, or None. None before the first update.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(report) = &self.report else {
            return Ok(None);
        };
        let all = PyDict::new(py);
        all.set_item("active", report.active)?;
        let error = report.error.as_ref();
        all.set_item(
            "position_error",
            error.map(|e| array(py, e.position.as_slice())),
        )?;
        all.set_item("angle", error.map(|e| e.angle))?;
        all.set_item("position_saturated", report.position_saturated)?;
        all.set_item("orientation_saturated", report.orientation_saturated)?;
        let failure = report.convergence_failure.map(|f| f.to_string());
        all.set_item("convergence_failure", failure)?;
        Ok(Some(all))
    }

    /// Forgets everything but the settings: the next update belongs to another run.
    fn restart(&mut self) {
        self.locked().restart();
        self.report = None;
    }
}

impl Controller {
    fn locked(&self) -> MutexGuard<'_, fuyu::control::Controller> {
        self.controller
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}
