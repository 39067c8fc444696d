//! `Model`.

use fuyu::dynamics::{Evaluation, Formulation as _};
use fuyu::dynamics::{
    FormulationKind, Input, InverseDynamics, TreeAcceleration, TreeMotion, Workspace,
};
use fuyu::model::{Frame, Model as Robot, Repaired};
use fuyu::nodes::{resource, tip_frame};
use fuyu::spatial::Twist;
use nalgebra::{DMatrix, Matrix6xX};
use numpy::{PyArray1, PyArrayDyn};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Given, array, for_each_posture, joints, vector, write_rows};
use crate::error::{choose, input, same_robot};
use crate::poses::PoseArrays;
use crate::state::State;

/// The tip link if none is named, as in scenarios.
const TIP: &str = "tool0";

/// A robot: a tree of rigid bodies on a free-floating base. Immutable; may be used by several threads.
///
/// Arrays of joints have the order of `joint_names`. `q` may have further axes in front, `(..., n)`: results then have the same axes
/// in front, and are computed on all processors. Units are SI; base axes are those of the root link.
#[pyclass(frozen, module = "fuyu", eq)]
#[derive(Clone)]
pub struct Model {
    pub robot: Robot,
    xml: String,
    source: String,
}

impl PartialEq for Model {
    fn eq(&self, other: &Self) -> bool {
        self.robot == other.robot
    }
}

impl Model {
    /// The frame of a link.
    pub fn frame(&self, name: Option<&str>) -> PyResult<Frame> {
        find_frame(&self.robot, name)
    }
}

/// The frame of a link; the tip's if none is named.
pub fn find_frame(robot: &Robot, name: Option<&str>) -> PyResult<Frame> {
    let name = name.unwrap_or(TIP);
    robot.frame(name).cloned().ok_or_else(|| {
        let names: Vec<_> = robot.frames().iter().map(|f| f.name.as_str()).collect();
        input(format!(
            "frame '{name}' is no link of robot '{}'; it has {}",
            robot.name(),
            names.join(", ")
        ))
    })
}

/// The frame of a tip link, which joints move.
pub fn find_tip(robot: &Robot, name: Option<&str>) -> PyResult<Frame> {
    tip_frame(robot, name.unwrap_or(TIP)).map_err(input)
}

#[pymethods]
impl Model {
    /// Reads a robot description (URDF).
    ///
    /// `source` is the path of a file (`package://fuyu/urdf/servicer.urdf` or `urdf/servicer.urdf` are those that come with fuyu),
    /// or the text itself, which begins with `<`. `name` is what error messages call a text. Common mistakes of
    /// descriptions are repaired with a warning; with `strict` they are errors.
    #[staticmethod]
    #[pyo3(signature = (source, *, name = "robot description", strict = false))]
    fn from_urdf(
        py: Python<'_>,
        source: &Bound<'_, PyAny>,
        name: &str,
        strict: bool,
    ) -> PyResult<Self> {
        // Paths and text.
        let text: String = source.str()?.extract()?;
        let (xml, source) = match text.trim_start().starts_with('<') {
            true => (text, name.to_owned()),
            false => resource::Lookup::default().read(&text).map_err(input)?,
        };
        let repaired = Repaired::from_urdf(&xml, &source, strict).map_err(input)?;
        for warning in repaired.warnings() {
            let category = py.get_type::<PyUserWarning>();
            let text = std::ffi::CString::new(warning)?;
            PyErr::warn(py, &category, &text, 1)?;
        }
        Ok(Self {
            robot: repaired.model,
            xml,
            source,
        })
    }

    /// Name of the robot.
    #[getter]
    fn name(&self) -> &str {
        self.robot.name()
    }

    /// The robot description.
    #[getter]
    fn urdf(&self) -> &str {
        &self.xml
    }

    /// Number of joints `n` that move independently.
    #[getter]
    fn dof(&self) -> usize {
        self.robot.dof()
    }

    /// Names of the joints, in the order of every array of joints.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        let joints = self.robot.joints().iter();
        joints.map(|joint| joint.name.clone()).collect()
    }

    /// Names of the links, each of which is a frame.
    #[getter]
    fn frame_names(&self) -> Vec<String> {
        let frames = self.robot.frames().iter();
        frames.map(|frame| frame.name.clone()).collect()
    }

    /// Mass of all bodies [kg].
    #[getter]
    fn mass(&self) -> f64 {
        self.robot.total_mass()
    }

    /// Lowest joint positions, shape (n,) [rad or m]; -inf without a limit.
    #[getter]
    fn lower_limits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.limits(py, |j| j.lower)
    }

    /// Highest joint positions, shape (n,) [rad or m]; inf without a limit.
    #[getter]
    fn upper_limits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.limits(py, |j| j.upper)
    }

    /// Largest joint efforts, shape (n,) [N m or N]; inf without a limit.
    #[getter]
    fn effort_limits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.limits(py, |j| j.effort)
    }

    /// Largest joint speeds, shape (n,) [rad/s or m/s]; inf without a limit.
    #[getter]
    fn velocity_limits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.limits(py, |j| j.velocity)
    }

    /// Fixed-base Jacobian of a frame's origin, shape (..., 6, n): linear rows [m/s per rad/s] first, then angular ones, base axes
    /// (Masutani 1995 eqs. (4.32), (4.33)). `frame` is a link, by default `tool0`.
    #[pyo3(signature = (q, frame = None))]
    fn fixed_base_jacobian<'py>(
        &self,
        py: Python<'py>,
        q: Given<'py>,
        frame: Option<&str>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let frame = self.frame(frame)?;
        self.six_rows(py, &q, |workspace, out| {
            workspace.fixed_base_jacobian(&frame, out);
        })
    }

    /// Generalized Jacobian of a frame's origin, shape (..., 6, n): inertial velocity in base axes per unit joint rate at zero
    /// momentum, base reaction included; linear rows first (Masutani 1995 eqs. (4.36), (4.37)). `frame` is a link, by
    /// default `tool0`.
    #[pyo3(signature = (q, frame = None))]
    fn generalized_jacobian<'py>(
        &self,
        py: Python<'py>,
        q: Given<'py>,
        frame: Option<&str>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let frame = self.frame(frame)?;
        self.six_rows(py, &q, |workspace, out| {
            workspace.generalized_jacobian(&frame, out);
        })
    }

    /// Base map, shape (..., 6, n): velocity of the base body's centre of mass and angular velocity of the base per unit joint rate at
    /// zero momentum, base axes, linear rows first (Masutani 1995 eqs. (4.23), (4.24)).
    fn base_map<'py>(
        &self,
        py: Python<'py>,
        q: Given<'py>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.six_rows(py, &q, |workspace, out| workspace.base_map(out))
    }

    /// Reduced inertia, shape (..., n, n) [kg m2 for rotations]: inertia of the joints while the base reacts freely (Masutani
    /// 1995 eq. (4.48)).
    fn reduced_inertia<'py>(
        &self,
        py: Python<'py>,
        q: Given<'py>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let n = self.robot.dof();
        for_each_posture(py, &self.robot, &q, &[n, n], |workspace, out| {
            let inertia = workspace.reduced_inertia();
            for (row, out) in out.chunks_exact_mut(n).enumerate() {
                for (column, value) in out.iter_mut().enumerate() {
                    // The upper triangle is the one that is computed.
                    *value = inertia[(row.min(column), row.max(column))];
                }
            }
        })
    }

    /// Centre of mass of the whole robot in the base frame, shape (..., 3) [m].
    fn center_of_mass<'py>(
        &self,
        py: Python<'py>,
        q: Given<'py>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        for_each_posture(py, &self.robot, &q, &[3], |workspace, out| {
            out.copy_from_slice(workspace.p_BC().as_slice());
        })
    }

    /// Pose of a frame in the base frame, shape (..., 7): position [m], then quaternion x, y, z, w. `frame` is a link, by default
    /// `tool0`.
    #[pyo3(signature = (q, frame = None))]
    fn frame_pose<'py>(
        &self,
        py: Python<'py>,
        q: Given<'py>,
        frame: Option<&str>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let frame = self.frame(frame)?;
        for_each_posture(py, &self.robot, &q, &[7], |workspace, out| {
            let pose = workspace.X_BF(&frame);
            let turn = nalgebra::UnitQuaternion::from_rotation_matrix(&pose.rotation);
            out[..3].copy_from_slice(pose.translation.vector.as_slice());
            out[3..].copy_from_slice(turn.coords.as_slice());
        })
    }

    /// Linear momentum [N s] and angular momentum about the centre of mass [N m s], each of shape (3,), base axes, of the robot whose
    /// base frame moves with `velocity` (of its origin, shape (3,) [m/s]) and `angular_velocity` (shape (3,) [rad/s]), base axes,
    /// zero by default, while the joints move with `qd`, shape (n,) (Masutani 1995 eq. (4.13)).
    #[pyo3(signature = (q, qd, velocity = None, angular_velocity = None))]
    fn momentum<'py>(
        &self,
        py: Python<'py>,
        q: Given<'py>,
        qd: Given<'py>,
        velocity: Option<Given<'py>>,
        angular_velocity: Option<Given<'py>>,
    ) -> PyResult<PoseArrays<'py>> {
        let (q, qd) = (
            joints("q", Some(&q), &self.robot)?,
            joints("qd", Some(&qd), &self.robot)?,
        );
        let twist = Twist::new(
            vector("angular_velocity", angular_velocity.as_ref())?,
            vector("velocity", velocity.as_ref())?,
        );
        let mut workspace = Workspace::new(&self.robot);
        workspace.set_positions(&q);
        let momentum = workspace.momentum_of(&twist, &qd);
        Ok((
            array(py, momentum.linear.as_slice()),
            array(py, momentum.angular.as_slice()),
        ))
    }

    /// Joint accelerations, shape (n,) [rad/s2 or m/s2], of `state` under joint `efforts`, shape (n,) [N m or N], zero by default;
    /// springs and dampers act as well. `formulation` is articulated_body, reduced, kane or newton_euler: independent derivations
    /// with the same result. `wrenches` maps links to external wrenches (force, torque), shape (6,) [N, N m], about the link's origin in its axes.
    #[pyo3(signature = (state, efforts = None, *, wrenches = None, formulation = "articulated_body"))]
    fn forward_dynamics<'py>(
        &self,
        py: Python<'py>,
        state: &State,
        efforts: Option<Given<'py>>,
        wrenches: Option<&Bound<'py, PyDict>>,
        formulation: &str,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        same_robot("the model", &self.robot, "the state", &state.robot)?;
        let kind = choose("formulation", &FormulationKind::NAMES, formulation)?;
        let mut dynamics = kind.prepare(&self.robot).map_err(input)?;
        let mut acting = Input::zero(&self.robot);
        acting.efforts = joints("efforts", efforts.as_ref(), &self.robot)?;
        set_wrenches(&self.robot, wrenches, &mut acting)?;
        let mut out = Evaluation::zero(&self.robot);
        let mut workspace = Workspace::new(&self.robot);
        dynamics.evaluate(&state.state, &mut workspace, &acting, &mut out);
        Ok(array(py, out.acceleration.qdd.as_slice()))
    }

    /// Joint efforts, shape (n,) [N m or N], that give `state` the joint accelerations `qdd`, shape (n,) [rad/s2 or m/s2], while the
    /// base floats freely.
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        state: &State,
        qdd: Given<'py>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        same_robot("the model", &self.robot, "the state", &state.robot)?;
        let qdd = joints("qdd", Some(&qdd), &self.robot)?;
        let mut workspace = Workspace::new(&self.robot);
        workspace.set_positions(&state.state.q);
        workspace.set_motion(&state.state);
        let motion = TreeMotion {
            R_WB: state.state.R_WB,
            V_WB_B: *workspace.V_WB_B(),
            q: state.state.q.as_slice(),
            qd: state.state.qd.as_slice(),
        };
        let mut acceleration = TreeAcceleration::zero(&self.robot);
        let efforts = acceleration.qdd.as_mut_slice();
        InverseDynamics::new(&self.robot).free_floating_efforts(
            &motion,
            qdd.as_slice(),
            &[],
            efforts,
        );
        Ok(array(py, efforts))
    }

    fn __repr__(&self) -> String {
        format!(
            "<fuyu.Model '{}': {} joints, {} kg>",
            self.robot.name(),
            self.robot.dof(),
            self.robot.total_mass()
        )
    }

    /// Models go to other processes as their description.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let restore = py.import("fuyu")?.getattr("_restore_model")?;
        let args = (self.xml.as_str(), self.source.as_str());
        (restore, args).into_pyobject(py).map(Bound::into_any)
    }

    fn __hash__(&self) -> u64 {
        use std::hash::{DefaultHasher, Hash as _, Hasher as _};
        let mut hasher = DefaultHasher::new();
        (self.robot.name(), self.robot.dof()).hash(&mut hasher);
        hasher.finish()
    }
}

impl Model {
    fn limits<'py>(
        &self,
        py: Python<'py>,
        limit: impl Fn(&fuyu::model::JointLimits) -> f64,
    ) -> Bound<'py, PyArray1<f64>> {
        let joints = self.robot.joints().iter();
        let limits: Vec<f64> = joints.map(|joint| limit(&joint.limits)).collect();
        array(py, &limits)
    }

    /// A matrix of six rows for each posture.
    fn six_rows<'py>(
        &self,
        py: Python<'py>,
        q: &Given<'py>,
        compute: impl Fn(&mut Workspace, &mut Matrix6xX<f64>) + Sync,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let n = self.robot.dof();
        for_each_posture(py, &self.robot, q, &[6, n], |workspace, out| {
            let mut matrix = Matrix6xX::zeros(n);
            compute(workspace, &mut matrix);
            let matrix = DMatrix::from_column_slice(6, n, matrix.as_slice());
            write_rows(&matrix, out);
        })
    }
}

/// External wrenches by link into the input, where each body has one.
pub fn set_wrenches(
    robot: &Robot,
    wrenches: Option<&Bound<'_, PyDict>>,
    acting: &mut Input,
) -> PyResult<()> {
    let Some(wrenches) = wrenches else {
        return Ok(());
    };
    for (link, wrench) in wrenches {
        let link: String = link.extract()?;
        let frame = find_frame(robot, Some(&link))?;
        let given: Given<'_> = wrench.extract()?;
        let [fx, fy, fz, tx, ty, tz] =
            crate::arrays::numbers(&format!("wrenches['{link}']"), Some(&given), [0.0; 6])?;
        let wrench = fuyu::spatial::Wrench::new([tx, ty, tz].into(), [fx, fy, fz].into());
        let at_body = wrench.shifted_to_parent(&frame.X_BF);
        let sum = &mut acting.wrenches[frame.body];
        *sum += at_body;
    }
    Ok(())
}
