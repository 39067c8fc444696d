//! `State`.

use fuyu::dynamics::{StateRow, Workspace};
use fuyu::model::Model as Robot;
use fuyu::spatial::Twist;
use nalgebra::{Isometry3, Translation3, Vector3};
use numpy::PyArray1;
use pyo3::prelude::*;

use crate::arrays::{Given, array, joints, vector};
use crate::error::{finite, input};
use crate::model::{Model, find_frame};
use crate::poses::{PoseArrays, pose_arrays, rotation};

/// State of a free-floating robot: time, joints, attitude of the base, centre of mass and momentum.
///
/// Momentum is part of the state; the base's twist follows from it. At rest at the world's origin unless arguments say otherwise: joint
/// positions `q` and rates `qd`, shape (n,); `position` of the base frame in the world, shape (3,) [m]; `orientation`, shape (4,),
/// x, y, z, w; `velocity` of its origin in world axes, shape (3,) [m/s]; `angular_velocity` in its own axes, shape (3,)
/// [rad/s]; `time` [s].
#[pyclass(module = "fuyu", eq)]
#[derive(Clone)]
pub struct State {
    pub robot: Robot,
    pub state: fuyu::dynamics::State,
    model: Model,
}

impl PartialEq for State {
    fn eq(&self, other: &Self) -> bool {
        self.robot == other.robot && self.state == other.state
    }
}

impl State {
    pub fn of_model(model: &Model, state: fuyu::dynamics::State) -> Self {
        Self {
            robot: model.robot.clone(),
            state,
            model: model.clone(),
        }
    }

    fn workspace(&self) -> Workspace {
        let mut workspace = Workspace::new(&self.robot);
        workspace.set_positions(&self.state.q);
        workspace.set_motion(&self.state);
        workspace
    }
}

#[pymethods]
impl State {
    #[new]
    #[pyo3(signature = (model, q = None, qd = None, *, position = None, orientation = None, velocity = None, angular_velocity = None, time = 0.0))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        model: &Model,
        q: Option<Given<'_>>,
        qd: Option<Given<'_>>,
        position: Option<Given<'_>>,
        orientation: Option<Given<'_>>,
        velocity: Option<Given<'_>>,
        angular_velocity: Option<Given<'_>>,
        time: f64,
    ) -> PyResult<Self> {
        let robot = &model.robot;
        let q = joints("q", q.as_ref(), robot)?;
        let mut state = fuyu::dynamics::State::at_rest_with(robot, &q);
        state.time = finite("time", time)?;
        state.qd = joints("qd", qd.as_ref(), robot)?;
        let R_WB = rotation("orientation", orientation.as_ref())?;
        let X_WB = Isometry3::from_parts(
            Translation3::from(vector("position", position.as_ref())?),
            R_WB,
        );
        let v_WB = vector("velocity", velocity.as_ref())?;
        let V_WB_B = Twist::new(
            vector("angular_velocity", angular_velocity.as_ref())?,
            R_WB.inverse_transform_vector(&v_WB),
        );
        state.set_base(&mut Workspace::new(robot), &X_WB, &V_WB_B);
        Ok(Self::of_model(model, state))
    }

    /// The robot.
    #[getter]
    fn model(&self) -> Model {
        self.model.clone()
    }

    /// Time [s].
    #[getter]
    fn time(&self) -> f64 {
        self.state.time
    }

    #[setter]
    fn set_time(&mut self, time: f64) -> PyResult<()> {
        self.state.time = finite("time", time)?;
        Ok(())
    }

    /// Joint positions, shape (n,) [rad or m]: a copy. Setting them keeps centre of mass and momentum.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.state.q.as_slice())
    }

    #[setter]
    fn set_q(&mut self, q: Given<'_>) -> PyResult<()> {
        self.state.q = joints("q", Some(&q), &self.robot)?;
        Ok(())
    }

    /// Joint rates, shape (n,) [rad/s or m/s]: a copy. Setting them keeps the momentum.
    #[getter]
    fn qd<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.state.qd.as_slice())
    }

    #[setter]
    fn set_qd(&mut self, qd: Given<'_>) -> PyResult<()> {
        self.state.qd = joints("qd", Some(&qd), &self.robot)?;
        Ok(())
    }

    /// Attitude of the base in the world, shape (4,): x, y, z, w.
    #[getter]
    fn attitude<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.state.R_WB.coords.as_slice())
    }

    #[setter]
    fn set_attitude(&mut self, attitude: Given<'_>) -> PyResult<()> {
        self.state.R_WB = rotation("attitude", Some(&attitude))?;
        Ok(())
    }

    /// Centre of mass of the whole robot in the world, shape (3,) [m].
    #[getter]
    fn com<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.state.p_WC.as_slice())
    }

    #[setter]
    fn set_com(&mut self, com: Given<'_>) -> PyResult<()> {
        self.state.p_WC = vector("com", Some(&com))?;
        Ok(())
    }

    /// Linear momentum in world axes, shape (3,) [N s].
    #[getter]
    fn linear_momentum<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.state.momentum_W.linear.as_slice())
    }

    #[setter]
    fn set_linear_momentum(&mut self, momentum: Given<'_>) -> PyResult<()> {
        self.state.momentum_W.linear = vector("linear_momentum", Some(&momentum))?;
        Ok(())
    }

    /// Angular momentum about the centre of mass in world axes, shape (3,) [N m s].
    #[getter]
    fn angular_momentum<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.state.momentum_W.angular.as_slice())
    }

    #[setter]
    fn set_angular_momentum(&mut self, momentum: Given<'_>) -> PyResult<()> {
        self.state.momentum_W.angular = vector("angular_momentum", Some(&momentum))?;
        Ok(())
    }

    /// Work done on the robot since the start [J]; kinetic energy minus work is constant.
    #[getter]
    fn work(&self) -> f64 {
        self.state.work
    }

    /// Position of the base frame's origin in the world, shape (3,) [m].
    #[getter]
    fn base_position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let X_WB = self.state.X_WB(&self.workspace());
        array(py, X_WB.translation.vector.as_slice())
    }

    /// Velocity of the base frame's origin in world axes, shape (3,) [m/s].
    #[getter]
    fn base_velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let v = self.state.R_WB * self.workspace().V_WB_B().linear;
        array(py, v.as_slice())
    }

    /// Angular velocity of the base in its own axes, shape (3,) [rad/s].
    #[getter]
    fn base_angular_velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.workspace().V_WB_B().angular.as_slice())
    }

    /// Kinetic energy [J].
    #[getter]
    fn kinetic_energy(&self) -> f64 {
        self.workspace().kinetic_energy()
    }

    /// Pose of a frame in the world: position, shape (3,) [m], and quaternion x, y, z, w, shape (4,). `frame` is a link, by default
    /// `tool0`.
    #[pyo3(signature = (frame = None))]
    fn frame_pose<'py>(&self, py: Python<'py>, frame: Option<&str>) -> PyResult<PoseArrays<'py>> {
        let frame = find_frame(&self.robot, frame)?;
        let workspace = self.workspace();
        let pose = self.state.X_WB(&workspace) * workspace.X_BF(&frame);
        Ok(pose_arrays(py, &pose))
    }

    /// Velocity of a frame's origin [m/s] and its angular velocity [rad/s] in the world, world axes, each of shape (3,). `frame` is a
    /// link, by default `tool0`.
    #[pyo3(signature = (frame = None))]
    fn frame_velocity<'py>(
        &self,
        py: Python<'py>,
        frame: Option<&str>,
    ) -> PyResult<PoseArrays<'py>> {
        let frame = find_frame(&self.robot, frame)?;
        let twist = self.workspace().V_WF_B(&frame);
        let [v, w] = [twist.linear, twist.angular].map(|v: Vector3<f64>| self.state.R_WB * v);
        Ok((array(py, v.as_slice()), array(py, w.as_slice())))
    }

    /// All numbers, shape (2 n + 19,): a row of `Batch.data`.
    fn to_row<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let layout = StateRow::new(self.robot.dof());
        let mut row = vec![0.0; layout.len()];
        layout.write(&self.state, &mut row);
        array(py, &row)
    }

    /// The state with the numbers `row`, shape (2 n + 19,), such as a row of `Batch.data`.
    #[staticmethod]
    fn from_row(model: &Model, row: Given<'_>) -> PyResult<Self> {
        let layout = StateRow::new(model.robot.dof());
        let array = row.as_array();
        let values: Vec<f64> = array.iter().copied().collect();
        if array.ndim() != 1 || values.len() != layout.len() {
            return Err(input(format!(
                "`row` has the shape {:?}; it must be ({},)",
                array.shape(),
                layout.len()
            )));
        }
        layout.check(&values, 0).map_err(input)?;
        let mut state = fuyu::dynamics::State::at_rest(&model.robot);
        layout.read(&values, &mut state);
        Ok(Self::of_model(model, state))
    }

    /// An independent copy.
    fn copy(&self) -> Self {
        self.clone()
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let restore = py.get_type::<Self>().getattr("from_row")?;
        let args = (self.model.clone(), self.to_row(py));
        (restore, args).into_pyobject(py).map(Bound::into_any)
    }

    fn __repr__(&self) -> String {
        format!(
            "<fuyu.State of '{}' at {} s: q = {:?}>",
            self.robot.name(),
            self.state.time,
            self.state.q.as_slice()
        )
    }
}
