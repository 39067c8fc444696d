//! `Batch`.

use fuyu::dynamics::{EffortRows, IntegrationMethod, RowError, StateRow, Workspace};
use fuyu::model::{Frame, Model as Robot};
use fuyu::spatial::{Pose, Twist};
use numpy::{
    PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PySlice};
use rayon::prelude::*;

use crate::drives::Drives;
use crate::error::{choose, finite, input, run, same_robot};
use crate::model::{Model, find_frame};
use crate::state::State;

/// Many states of one robot in a numpy array, stepped together on all processors.
///
/// `data`, shape (m, 2 n + 19), float64, has a state per row; columns are `time`, `q` (n), `qd` (n), `attitude` (4), `com` (3),
/// `linear_momentum` (3), `angular_momentum` (3), `work`, `dissipated` (4), with units and frames as in `State`. The attributes with these
/// names are views of it: writing to them changes the states, and a step changes them in place. Nothing is copied: give a
/// contiguous array as `data` to step the states in your own memory, `count` for a new one, at rest.
///
/// Every state moves to the bit as with `Integrator` and the same `method` (rk4 or dop8), for any number of states and threads.
/// The interpreter's lock is released in steps; one thread at a time may use a batch, another gets a RuntimeError.
#[pyclass(module = "fuyu")]
pub struct Batch {
    model: Model,
    method: String,
    batch: fuyu::dynamics::Batch,
    data: Py<PyArray2<f64>>,
}

impl Batch {
    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.model.robot
    }

    /// Its integration method.
    pub fn kind(&self) -> PyResult<IntegrationMethod> {
        choose("method", &IntegrationMethod::NAMES, &self.method)
    }

    /// Number of states.
    pub fn count(&self) -> usize {
        self.batch.len()
    }

    /// All states, a row each.
    pub fn rows<'py>(&self, py: Python<'py>) -> &Bound<'py, PyArray2<f64>> {
        self.data.bind(py)
    }

    /// What a row holds.
    pub fn layout(&self) -> StateRow {
        StateRow::new(self.model.robot.dof())
    }

    /// The columns of a quantity, as a view.
    fn view<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let parts = self.layout().parts();
        let found = parts.into_iter().find(|(known, _)| *known == name);
        let (_, place) = found.ok_or_else(|| input(format!("no quantity '{name}'")))?;
        let data = self.data.bind(py);
        let all = PySlice::full(py);
        if matches!(name, "time" | "work") {
            return data.get_item((all, place.start));
        }
        let (start, end) = (place.start.cast_signed(), place.end.cast_signed());
        data.get_item((all, PySlice::new(py, start, end, 1)))
    }
}

#[pymethods]
impl Batch {
    #[new]
    #[pyo3(signature = (model, count = None, *, data = None, method = "dop8"))]
    fn new(
        py: Python<'_>,
        model: &Model,
        count: Option<usize>,
        data: Option<&Bound<'_, PyAny>>,
        method: &str,
    ) -> PyResult<Self> {
        let kind = choose("method", &IntegrationMethod::NAMES, method)?;
        let layout = StateRow::new(model.robot.dof());
        let data = match (count, data) {
            (Some(count), None) => {
                let data = PyArray2::zeros(py, [count, layout.len()], false);
                let rest = fuyu::dynamics::State::at_rest(&model.robot);
                let mut writable = data.readwrite();
                for row in writable.as_slice_mut()?.chunks_exact_mut(layout.len()) {
                    layout.write(&rest, row);
                }
                drop(writable);
                data
            }
            (None, Some(data)) => own_memory(data, layout)?,
            _ => return Err(input("give either `count` or `data`")),
        };
        let count = data.shape()[0];
        Ok(Self {
            batch: fuyu::dynamics::Batch::new(&model.robot, kind, count),
            model: model.clone(),
            method: method.to_owned(),
            data: data.unbind(),
        })
    }

    /// The robot.
    #[getter]
    fn model(&self) -> Model {
        self.model.clone()
    }

    /// Name of the integration method.
    #[getter]
    fn method(&self) -> &str {
        &self.method
    }

    /// All states, shape (m, 2 n + 19); always the same array.
    #[getter]
    fn data<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.data.bind(py).clone()
    }

    /// Times, a view of shape (m,) [s].
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.view(py, "time")
    }

    /// Joint positions, a view of shape (m, n) [rad or m].
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.view(py, "q")
    }

    /// Joint rates, a view of shape (m, n) [rad/s or m/s].
    #[getter]
    fn qd<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.view(py, "qd")
    }

    /// Attitudes of the base in the world, a view of shape (m, 4): x, y, z, w.
    #[getter]
    fn attitude<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.view(py, "attitude")
    }

    /// Centres of mass in the world, a view of shape (m, 3) [m].
    #[getter]
    fn com<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.view(py, "com")
    }

    /// Linear momenta in world axes, a view of shape (m, 3) [N s].
    #[getter]
    fn linear_momentum<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.view(py, "linear_momentum")
    }

    /// Angular momenta about the centres of mass in world axes, a view of shape (m, 3) [N m s].
    #[getter]
    fn angular_momentum<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.view(py, "angular_momentum")
    }

    /// Work done since the start, a view of shape (m,) [J].
    #[getter]
    fn work<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.view(py, "work")
    }

    /// What the joints have dissipated by damping, friction, stops and speed limits, a view of shape (m, 4) [J].
    #[getter]
    fn dissipated<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.view(py, "dissipated")
    }

    /// Advances all states in place by `steps` steps of `dt` [s] under joint `efforts` [N m or N]: shape (m, n), or (n,) for all
    /// states. Each is clamped to its joint's effort limit and held; without `efforts` those of the last call are held.
    ///
    /// `efforts` must be a contiguous array of float64, which is read where it is. The interpreter's lock is released. If a state is
    /// not finite before the step, or a motion diverges in it, an error names the first; in the first case nothing has changed.
    #[pyo3(signature = (dt, efforts = None, *, steps = 1))]
    pub fn step(
        &mut self,
        py: Python<'_>,
        dt: f64,
        efforts: Option<&Bound<'_, PyAny>>,
        steps: usize,
    ) -> PyResult<()> {
        let given = efforts.map(|given| strict("efforts", given)).transpose()?;
        let efforts = effort_rows(given.as_ref(), &self.model, self.batch.len())?;
        self.advance(py, dt, steps, |batch, rows, dt| {
            batch.step_rows(rows, efforts, dt, steps)
        })
    }

    /// Advances all states in place by `steps` steps of `dt` [s] under drives that damp the joints to `rates` [rad/s or m/s], shape (m, n):
    /// in each step the efforts are `gains * (rates - qd)` of its first state, held as by `step`. `gains` [N m s or N s/m] has the shape
    /// (m, n), or (m, n, n): a matrix for each state. Both are read where they are. The result is that of as many calls of
    /// `step`, in less time.
    #[pyo3(signature = (dt, rates, gains, *, steps = 1))]
    pub fn servo(
        &mut self,
        py: Python<'_>,
        dt: f64,
        rates: &Bound<'_, PyAny>,
        gains: &Bound<'_, PyAny>,
        steps: usize,
    ) -> PyResult<()> {
        let (rates, gains) = (strict("rates", rates)?, strict("gains", gains)?);
        let drives = Drives::new(&rates, &gains, self.batch.len(), self.model.robot.dof())?;
        self.advance(py, dt, steps, |batch, rows, dt| {
            batch.step_rows_with(rows, dt, steps, |index, qd, efforts| {
                drives.efforts(index, qd, efforts);
            })
        })
    }

    /// Joint accelerations, shape (m, n) [rad/s2 or m/s2], under `efforts` as in `step`. `out` receives them if given.
    #[pyo3(signature = (efforts = None, *, out = None))]
    fn accelerations<'py>(
        &mut self,
        py: Python<'py>,
        efforts: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let data = self.data.bind(py);
        let readable = data.try_readonly().map_err(in_use)?;
        let rows = readable.as_slice()?;
        let given = efforts.map(|given| strict("efforts", given)).transpose()?;
        let efforts = effort_rows(given.as_ref(), &self.model, self.batch.len())?;
        let out = output(py, out, &[self.batch.len(), self.model.robot.dof()])?;
        {
            let mut writable = out.try_readwrite().map_err(in_use)?;
            let qdd = writable.as_slice_mut()?;
            let batch = &mut self.batch;
            let done = py.detach(|| batch.accelerate_rows(rows, efforts, qdd));
            done.map_err(input)?;
        }
        Ok(out)
    }

    /// Poses and velocities of a frame in the world, shape (m, 13): position [m], quaternion x, y, z, w, velocity of its origin [m/s]
    /// and angular velocity [rad/s], world axes. `frame` is a link, by default `tool0`. `out` receives them if given.
    #[pyo3(signature = (frame = None, *, out = None))]
    fn frame_states<'py>(
        &self,
        py: Python<'py>,
        frame: Option<&str>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let frame = find_frame(&self.model.robot, frame)?;
        self.write_frame_states(py, &frame, out)
    }

    /// State `index`, as a copy.
    fn state(&self, py: Python<'_>, index: usize) -> PyResult<State> {
        let layout = self.layout();
        let data = self.data.bind(py);
        let readable = data.try_readonly().map_err(in_use)?;
        self.check_index(index)?;
        let row = &readable.as_slice()?[index * layout.len()..][..layout.len()];
        layout.check(row, index).map_err(input)?;
        let mut state = fuyu::dynamics::State::at_rest(&self.model.robot);
        layout.read(row, &mut state);
        Ok(State::of_model(&self.model, state))
    }

    /// Replaces state `index`.
    fn set_state(&mut self, py: Python<'_>, index: usize, state: &State) -> PyResult<()> {
        same_robot("the batch", &self.model.robot, "the state", &state.robot)?;
        self.check_index(index)?;
        let layout = self.layout();
        let data = self.data.bind(py);
        let mut writable = data.try_readwrite().map_err(in_use)?;
        let row = &mut writable.as_slice_mut()?[index * layout.len()..][..layout.len()];
        layout.write(&state.state, row);
        Ok(())
    }

    /// The columns of `data` by quantity, as slices.
    #[getter]
    fn columns<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let columns = PyDict::new(py);
        for (name, place) in self.layout().parts() {
            let (start, end) = (place.start.cast_signed(), place.end.cast_signed());
            columns.set_item(name, PySlice::new(py, start, end, 1))?;
        }
        Ok(columns)
    }

    fn __len__(&self) -> usize {
        self.batch.len()
    }

    fn __repr__(&self) -> String {
        format!(
            "<fuyu.Batch of {} states of '{}', {}>",
            self.batch.len(),
            self.model.robot.name(),
            self.method
        )
    }
}

impl Batch {
    /// Lets `step` advance the rows by `steps` steps of `dt` \[s\] without the interpreter's lock, and checks them.
    fn advance(
        &mut self,
        py: Python<'_>,
        dt: f64,
        steps: usize,
        step: impl FnOnce(&mut fuyu::dynamics::Batch, &mut [f64], f64) -> Result<(), RowError> + Send,
    ) -> PyResult<()> {
        let dt = finite("dt", dt)?;
        let layout = self.layout();
        let mut writable = self.data.bind(py).try_readwrite().map_err(in_use)?;
        let rows = writable.as_slice_mut()?;
        let batch = &mut self.batch;
        let stepped = py.detach(|| {
            step(batch, rows, dt)?;
            Ok(check_rows(layout, rows))
        });
        let checked = stepped.map_err(|e: RowError| input(e))?;
        checked.map_err(|problem| has_diverged(dt, steps, problem))
    }

    /// Poses and velocities of `frame` as `frame_states` gives them.
    pub fn write_frame_states<'py>(
        &self,
        py: Python<'py>,
        frame: &Frame,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let robot = &self.model.robot;
        let layout = self.layout();
        let out = output(py, out, &[self.batch.len(), 13])?;
        {
            let data = self.data.bind(py);
            let readable = data.try_readonly().map_err(in_use)?;
            let rows = readable.as_slice()?;
            let mut writable = out.try_readwrite().map_err(in_use)?;
            let results = writable.as_slice_mut()?;
            let checked = py.detach(|| {
                layout.check(rows, 0)?;
                let rows = rows.par_chunks(layout.len()).with_min_len(64);
                let pairs = results.par_chunks_mut(13).zip(rows);
                let start = || RowReader::new(robot);
                pairs.for_each_init(start, |reader, (out, row)| {
                    let (X_WF, V_WF) = reader.frame_state(row, frame);
                    let turn = nalgebra::UnitQuaternion::from_rotation_matrix(&X_WF.rotation);
                    out[..3].copy_from_slice(X_WF.translation.vector.as_slice());
                    out[3..7].copy_from_slice(turn.coords.as_slice());
                    out[7..10].copy_from_slice(V_WF.linear.as_slice());
                    out[10..].copy_from_slice(V_WF.angular.as_slice());
                });
                Ok(())
            });
            checked.map_err(|e: RowError| input(e))?;
        }
        Ok(out)
    }

    fn check_index(&self, index: usize) -> PyResult<()> {
        match index < self.batch.len() {
            true => Ok(()),
            false => Err(input(format!(
                "there is no state {index} in a batch of {}",
                self.batch.len()
            ))),
        }
    }
}

/// Checks rows on all processors; the error is that of the first.
fn check_rows(layout: StateRow, rows: &[f64]) -> Result<(), RowError> {
    const ROWS: usize = 256;
    let parts = rows.par_chunks(ROWS * layout.len()).enumerate();
    let wrong = parts.find_map_first(|(k, rows)| layout.check(rows, k * ROWS).err());
    wrong.map_or(Ok(()), Err)
}

/// The error of a motion that is not finite any more.
pub fn has_diverged(dt: f64, steps: usize, problem: RowError) -> PyErr {
    run(format!(
        "after {steps} steps of {dt} s the motion has diverged: {problem}"
    ))
}

/// Scratch memory to look at rows of one robot.
pub struct RowReader {
    layout: StateRow,
    workspace: Workspace,
    state: fuyu::dynamics::State,
}

impl RowReader {
    pub fn new(robot: &Robot) -> Self {
        Self {
            layout: StateRow::new(robot.dof()),
            workspace: Workspace::new(robot),
            state: fuyu::dynamics::State::at_rest(robot),
        }
    }

    /// Pose of a frame in the world, and its twist, about its origin in world axes, in the state of a checked row.
    pub fn frame_state(&mut self, row: &[f64], frame: &Frame) -> (Pose, Twist) {
        let Self {
            layout,
            workspace,
            state,
        } = self;
        layout.read(row, state);
        workspace.set_positions(&state.q);
        workspace.set_motion(state);
        let X_WF = state.X_WB(workspace) * workspace.X_BF(frame);
        let V_WF_B = workspace.V_WF_B(frame);
        let in_world = |v: nalgebra::Vector3<f64>| state.R_WB * v;
        (
            X_WF,
            Twist::new(in_world(V_WF_B.angular), in_world(V_WF_B.linear)),
        )
    }
}

/// The error of an array that another thread uses.
pub fn in_use(problem: impl std::fmt::Display) -> PyErr {
    pyo3::exceptions::PyRuntimeError::new_err(format!(
        "the array is in use by another thread: {problem}"
    ))
}

/// The caller's array as the states.
fn own_memory<'py>(
    data: &Bound<'py, PyAny>,
    layout: StateRow,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let array = untyped("data", data)?;
    let shape = array.shape();
    if shape.len() != 2 || shape[1] != layout.len() {
        return Err(input(format!(
            "`data` has the shape {shape:?}; it must be (m, {})",
            layout.len()
        )));
    }
    let array = data
        .cast::<PyArray2<f64>>()
        .map_err(|_| wrong_type("data", array))?;
    if !array.is_c_contiguous() {
        return Err(not_contiguous("data"));
    }
    let writable = array.try_readwrite();
    writable.map_err(|e| input(format!("`data`: {e}")))?;
    Ok(array.clone())
}

/// An array of float64 that is read where it is.
pub fn strict<'py>(
    name: &str,
    given: &Bound<'py, PyAny>,
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let array = untyped(name, given)?;
    let array = given
        .cast::<PyArrayDyn<f64>>()
        .map_err(|_| wrong_type(name, array))?;
    array.try_readonly().map_err(in_use)
}

fn untyped<'a, 'py>(
    name: &str,
    given: &'a Bound<'py, PyAny>,
) -> PyResult<&'a Bound<'py, PyUntypedArray>> {
    given.cast::<PyUntypedArray>().map_err(|_| {
        let kind = given.get_type();
        input(format!(
            "`{name}` is a {kind}; it must be a numpy array of float64"
        ))
    })
}

fn wrong_type(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyErr {
    let kind = array.dtype();
    input(format!(
        "`{name}` is an array of {kind}; it must be of float64"
    ))
}

/// The error of an array that is not read where it is.
pub fn not_contiguous(name: &str) -> PyErr {
    input(format!(
        "`{name}` is not contiguous; give a C-contiguous array, such as numpy.ascontiguousarray({name})"
    ))
}

fn effort_rows<'a>(
    given: Option<&'a PyReadonlyArrayDyn<'_, f64>>,
    model: &Model,
    count: usize,
) -> PyResult<EffortRows<'a>> {
    let Some(given) = given else {
        return Ok(EffortRows::Held);
    };
    let dof = model.robot.dof();
    if !given.is_c_contiguous() {
        return Err(not_contiguous("efforts"));
    }
    let values = given.as_slice()?;
    match given.shape() {
        [n] if *n == dof => Ok(EffortRows::Common(values)),
        [m, n] if *m == count && *n == dof => Ok(EffortRows::Each(values)),
        shape => Err(input(format!(
            "`efforts` has the shape {shape:?}; it must be ({count}, {dof}) or ({dof},)"
        ))),
    }
}

/// The caller's array, or a new one.
pub fn output<'py>(
    py: Python<'py>,
    given: Option<&Bound<'py, PyAny>>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let Some(given) = given else {
        return Ok(PyArrayDyn::zeros(py, shape, false));
    };
    let array = untyped("out", given)?;
    if array.shape() != shape {
        return Err(input(format!(
            "`out` has the shape {:?}; it must be {shape:?}",
            array.shape()
        )));
    }
    let out = given
        .cast::<PyArrayDyn<f64>>()
        .map_err(|_| wrong_type("out", array))?;
    match out.is_c_contiguous() {
        true => Ok(out.clone()),
        false => Err(not_contiguous("out")),
    }
}
