//! `Latches`.

use fuyu::dynamics::capture::{Captured, Grasp, JointReaction, Latch};
use fuyu::dynamics::{Floating, IntegrationMethod, State, StateRow, Workspace};
use fuyu::model::{Frame, Model as Robot};
use fuyu::spatial::{Pose, Twist};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use numpy::{BorrowError, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arrays::{Given, check_finite, vector};
use crate::batch::{Batch, RowReader, has_diverged, in_use, output, strict};
use crate::drives::Drives;
use crate::error::{choose, input, not_negative};
use crate::model::find_tip;
use crate::poses::{rotation, unit_quaternion};

/// Robots and targets, pair by pair, with a latch between each robot's tip and a grasp frame on its target's root link.
///
/// Robot `i` of the batch `robots` belongs to target `i` of `targets`. `tip` is a link of the robot. `position`, shape (3,) [m], and
/// `orientation`, shape (4,), x, y, z, w, are those of the grasp frame in the root link, by default its origin and axes.
/// `kind` is `weld` or `ball`. `joints` says what the robot's joints do in the impulse: `free`, `locked` (by brakes, as long as the
/// latch is closed) or `rate_held` (by ideal servos, in the impulse only).
///
/// `close` computes the impulse and joins the two; momentum of both together does not change, energy is lost. From then on `step`
/// moves them as one system, and writes the motion of each to its row. Nothing else may change the rows of a closed latch.
#[pyclass(module = "fuyu")]
pub struct Latches {
    robots: Py<Batch>,
    targets: Py<Batch>,
    grasp: Grasp,
    method: IntegrationMethod,
    held: Vec<Option<Box<Held>>>,
}

/// A robot and a target that are joined.
struct Held {
    captured: Captured,
    /// Both as they move in the joined system.
    robot: Floating,
    target: Floating,
}

/// A batch with its rows, which are borrowed.
struct Side<'py, Rows> {
    batch: PyRef<'py, Batch>,
    rows: Rows,
}

/// A pair with its rows.
type Joined<'a> = (
    usize,
    ((&'a mut Option<Box<Held>>, &'a mut [f64]), &'a mut [f64]),
);

impl Held {
    /// Joins the two; also the impulse on the tip, world axes, and the energy lost.
    fn new(
        mut robot: Floating,
        mut target: Floating,
        grasp: &Grasp,
        method: IntegrationMethod,
        limits: (f64, f64),
    ) -> Result<(Self, [f64; 7]), fuyu::dynamics::capture::CaptureError> {
        grasp.check_separation(&robot, &target, limits.0, limits.1)?;
        let (captured, impulses) = Captured::new(&robot, &target, grasp, method)?;
        captured.copy_robot_to(&mut robot);
        captured.copy_target_to(&mut target);
        let on_tip = &impulses.on_first[0];
        let mut found = [impulses.energy_lost; 7];
        found[..3].copy_from_slice(on_tip.force.as_slice());
        found[3..6].copy_from_slice(on_tip.torque.as_slice());
        let held = Self {
            captured,
            robot,
            target,
        };
        Ok((held, found))
    }

    fn step(&mut self, dt: f64, steps: usize, efforts: &[f64]) {
        self.captured.hold_robot_efforts(efforts);
        self.captured.step(dt, steps);
        self.show();
    }

    /// Under drives, whose efforts are sampled in each step.
    fn servo(&mut self, dt: f64, steps: usize, (drives, index): (&Drives<'_>, usize)) {
        let mut efforts = vec![0.0; self.captured.robot().dof()];
        for _ in 0..steps {
            let (_, qd) = self.captured.robot_joints();
            drives.efforts(index, qd.as_slice(), &mut efforts);
            self.captured.hold_robot_efforts(&efforts);
            self.captured.step(dt, 1);
        }
        self.show();
    }

    fn show(&mut self) {
        self.captured.copy_robot_to(&mut self.robot);
        self.captured.copy_target_to(&mut self.target);
    }
}

#[pymethods]
impl Latches {
    #[new]
    #[pyo3(signature = (robots, targets, *, tip = None, position = None, orientation = None, kind = "weld", joints = "free"))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        py: Python<'_>,
        robots: Py<Batch>,
        targets: Py<Batch>,
        tip: Option<&str>,
        position: Option<Given<'_>>,
        orientation: Option<Given<'_>>,
        kind: &str,
        joints: &str,
    ) -> PyResult<Self> {
        if robots.is(&targets) {
            return Err(input(
                "robots and targets are the same Batch; make one for each".to_owned(),
            ));
        }
        let (of_robots, of_targets) = (robots.try_borrow(py)?, targets.try_borrow(py)?);
        let (count, others) = (of_robots.count(), of_targets.count());
        if count != others {
            return Err(input(format!(
                "there are {count} robots and {others} targets; each robot needs one target"
            )));
        }
        let X_TG = Isometry3::from_parts(
            Translation3::from(vector("position", position.as_ref())?),
            rotation("orientation", orientation.as_ref())?,
        );
        let root = &of_targets.robot().frames()[0];
        let grasp = Grasp {
            robot: find_tip(of_robots.robot(), tip)?,
            target: Frame {
                name: "grasp".to_owned(),
                body: root.body,
                parent: None,
                X_BF: root.X_BF * Pose::from_parts(X_TG.translation, X_TG.rotation.into()),
            },
            latch: choose("kind", &Latch::NAMES, kind)?,
            joints: choose("joints", &JointReaction::NAMES, joints)?,
        };
        let method = of_robots.kind()?;
        drop((of_robots, of_targets));
        Ok(Self {
            robots,
            targets,
            grasp,
            method,
            held: (0..count).map(|_| None).collect(),
        })
    }

    /// The robots.
    #[getter]
    fn robots(&self, py: Python<'_>) -> Py<Batch> {
        self.robots.clone_ref(py)
    }

    /// The targets.
    #[getter]
    fn targets(&self, py: Python<'_>) -> Py<Batch> {
        self.targets.clone_ref(py)
    }

    /// Which latches are closed, a new array of shape (m,), bool.
    #[getter]
    fn closed<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        let closed: Vec<bool> = self.held.iter().map(Option::is_some).collect();
        PyArray1::from_vec(py, closed)
    }

    /// Where the grasp frames are, seen from the tips, in world axes, shape (m, 12): vector from tip to grasp frame [m], rotation
    /// vector that turns the tip's axes to those of the grasp frame [rad], velocity [m/s] and angular velocity [rad/s] of the grasp frame less those
    /// of the tip. `out` receives them if given.
    #[pyo3(signature = (*, out = None))]
    fn separations<'py>(
        &self,
        py: Python<'py>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let out = output(py, out, &[self.held.len(), 12])?;
        {
            let [robots, targets] = self.sides(py, |rows| rows.try_readonly())?;
            let (robot, target) = (robots.batch.robot(), targets.batch.robot());
            let (layout, target_layout) = (robots.batch.layout(), targets.batch.layout());
            let (rows, target_rows) = (robots.rows.as_slice()?, targets.rows.as_slice()?);
            let mut writable = out.try_readwrite().map_err(in_use)?;
            let results = writable.as_slice_mut()?;
            let grasp = &self.grasp;
            let checked = py.detach(|| {
                layout.check(rows, 0)?;
                target_layout.check(target_rows, 0)?;
                let pairs = rows.par_chunks(layout.len()).with_min_len(64);
                let pairs = pairs.zip(target_rows.par_chunks(target_layout.len()));
                let start = || (RowReader::new(robot), RowReader::new(target));
                let pairs = results.par_chunks_mut(12).zip(pairs);
                pairs.for_each_init(start, |(own, other), (out, (row, target_row))| {
                    let (X_WE, V_WE) = own.frame_state(row, &grasp.robot);
                    let (X_WG, V_WG) = other.frame_state(target_row, &grasp.target);
                    let R_EG = X_WE.rotation.inverse() * X_WG.rotation;
                    let turn = UnitQuaternion::from_rotation_matrix(&R_EG).scaled_axis();
                    let parts = [
                        X_WG.translation.vector - X_WE.translation.vector,
                        X_WE.rotation * turn,
                        V_WG.linear - V_WE.linear,
                        V_WG.angular - V_WE.angular,
                    ];
                    for (out, part) in out.chunks_exact_mut(3).zip(&parts) {
                        out.copy_from_slice(part.as_slice());
                    }
                });
                Ok(())
            });
            checked.map_err(|e: fuyu::dynamics::RowError| input(e))?;
        }
        Ok(out)
    }

    /// Poses and velocities of the grasp frames in the world, shape (m, 13), as `Batch.frame_states` gives those of links.
    #[pyo3(signature = (*, out = None))]
    fn grasp_states<'py>(
        &self,
        py: Python<'py>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let targets = self.targets.try_borrow(py)?;
        targets.write_frame_states(py, &self.grasp.target, out)
    }

    /// Opens the latches of `pairs`, k indices, and puts their targets where the grasp frames have these `poses` in the world, shape
    /// (k, 7): position [m], then quaternion x, y, z, w. The targets move with `velocities` of their centres of mass in world axes [m/s] and
    /// `angular_velocities` of their root links in their own axes [rad/s], each of shape (k, 3); their joints are at zero and rest.
    fn place_targets(
        &mut self,
        py: Python<'_>,
        pairs: Vec<usize>,
        poses: Given<'_>,
        velocities: Given<'_>,
        angular_velocities: Given<'_>,
    ) -> PyResult<()> {
        self.check_pairs(&pairs)?;
        let count = pairs.len();
        let poses = table("poses", &poses, [count, 7])?;
        let velocities = table("velocities", &velocities, [count, 3])?;
        let angular = table("angular_velocities", &angular_velocities, [count, 3])?;
        let X_WG = |(k, pose): (usize, &[f64])| {
            let R_WG = unit_quaternion(
                &format!("the quaternion of poses[{k}]"),
                [pose[3], pose[4], pose[5], pose[6]],
            )?;
            let p_WG = Translation3::new(pose[0], pose[1], pose[2]);
            Ok(Pose::from_parts(p_WG, R_WG.to_rotation_matrix()))
        };
        let poses: PyResult<Vec<Pose>> = poses.chunks_exact(7).enumerate().map(X_WG).collect();
        let poses = poses?;
        let targets = self.targets.try_borrow(py)?;
        let (target, layout) = (targets.robot(), targets.layout());
        let mut writable = targets.rows(py).try_readwrite().map_err(in_use)?;
        let rows = writable.as_slice_mut()?;
        let mut workspace = Workspace::new(target);
        let mut state = State::at_rest(target);
        let three = |values: &[f64]| Vector3::new(values[0], values[1], values[2]);
        for (k, index) in pairs.iter().enumerate() {
            let X_WT = poses[k] * self.grasp.target.X_BF.inverse();
            let R_WT = UnitQuaternion::from_rotation_matrix(&X_WT.rotation);
            let X_WT = Isometry3::from_parts(X_WT.translation, R_WT);
            let spin = Twist::new(three(&angular[3 * k..]), Vector3::zeros());
            state.set_base(&mut workspace, &X_WT, &spin);
            state.momentum_W.linear = three(&velocities[3 * k..]) * target.total_mass();
            layout.write(&state, &mut rows[index * layout.len()..][..layout.len()]);
        }
        for index in pairs {
            self.held[index] = None;
        }
        Ok(())
    }

    /// Closes the latches of `pairs`, k indices of open ones. Returns, per latch, the impulse on the robot about the tip's origin, world axes
    /// [N s, N m s], and the kinetic energy lost [J]: shape (k, 7). The rows of both are those after the impulse.
    ///
    /// Frames that are further apart than `distance` [m] or, for a weld, `angle` [rad] are an error; nothing has changed then.
    #[pyo3(signature = (pairs, *, distance = 0.01, angle = 0.05))]
    fn close<'py>(
        &mut self,
        py: Python<'py>,
        pairs: Vec<usize>,
        distance: f64,
        angle: f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let limits = (
            not_negative("distance", distance)?,
            not_negative("angle", angle)?,
        );
        self.check_pairs(&pairs)?;
        if let Some(index) = pairs.iter().find(|index| self.held[**index].is_some()) {
            return Err(input(format!(
                "the latch of pair {index} is closed already"
            )));
        }
        let [mut robots, mut targets] = self.sides(py, |rows| rows.try_readwrite())?;
        let (rows, target_rows) = (robots.rows.as_slice_mut()?, targets.rows.as_slice_mut()?);
        let (robot, target) = (robots.batch.robot(), targets.batch.robot());
        let (layout, target_layout) = (robots.batch.layout(), targets.batch.layout());
        let (grasp, method) = (&self.grasp, self.method);
        let (before, target_before) = (&*rows, &*target_rows);
        let found: Result<Vec<_>, String> = py.detach(|| {
            let one = |index: &usize| {
                let robot = floating(robot, layout, before, *index, method)?;
                let target = floating(target, target_layout, target_before, *index, method)?;
                let joined = Held::new(robot, target, grasp, method, limits);
                joined.map_err(|e| format!("pair {index}: {e}"))
            };
            pairs.par_iter().map(one).collect()
        });
        let impulses = PyArray2::zeros(py, [pairs.len(), 7], false);
        let mut writable = impulses.readwrite();
        let out = writable.as_slice_mut()?.chunks_exact_mut(7);
        for ((index, (held, impulse)), out) in pairs.iter().zip(found.map_err(input)?).zip(out) {
            out.copy_from_slice(&impulse);
            let row = &mut rows[index * layout.len()..][..layout.len()];
            layout.write(held.robot.state(), row);
            let row = &mut target_rows[index * target_layout.len()..][..target_layout.len()];
            target_layout.write(held.target.state(), row);
            self.held[*index] = Some(Box::new(held));
        }
        drop(writable);
        Ok(impulses)
    }

    /// Opens the latches of `pairs`, indices; open ones stay open. Robot and target go on with the motion that they have.
    fn open(&mut self, pairs: Vec<usize>) -> PyResult<()> {
        self.check_pairs(&pairs)?;
        for index in pairs {
            self.held[index] = None;
        }
        Ok(())
    }

    /// Advances robots and targets in place by `steps` steps of `dt` [s] under the robots' joint `efforts` [N m or N], as
    /// `Batch.step` takes them. Robot and target of a closed latch move as one system.
    #[pyo3(signature = (dt, efforts, *, steps = 1))]
    fn step(
        &mut self,
        py: Python<'_>,
        dt: f64,
        efforts: &Bound<'_, PyAny>,
        steps: usize,
    ) -> PyResult<()> {
        (self.robots.try_borrow_mut(py)?).step(py, dt, Some(efforts), steps)?;
        (self.targets.try_borrow_mut(py)?).step(py, dt, None, steps)?;
        let efforts = strict("efforts", efforts)?;
        let (dof, efforts) = (self.dof(py)?, efforts.as_slice()?);
        self.step_held(py, dt, steps, |index, held| {
            let start = if efforts.len() == dof { 0 } else { index * dof };
            held.step(dt, steps, &efforts[start..start + dof]);
        })
    }

    /// Advances robots and targets in place by `steps` steps of `dt` [s] under the robots' drives, as `Batch.servo` does. Robot and
    /// target of a closed latch move as one system.
    #[pyo3(signature = (dt, rates, gains, *, steps = 1))]
    fn servo(
        &mut self,
        py: Python<'_>,
        dt: f64,
        rates: &Bound<'_, PyAny>,
        gains: &Bound<'_, PyAny>,
        steps: usize,
    ) -> PyResult<()> {
        (self.robots.try_borrow_mut(py)?).servo(py, dt, rates, gains, steps)?;
        (self.targets.try_borrow_mut(py)?).step(py, dt, None, steps)?;
        let (rates, gains) = (strict("rates", rates)?, strict("gains", gains)?);
        let drives = Drives::new(&rates, &gains, self.held.len(), self.dof(py)?)?;
        self.step_held(py, dt, steps, |index, held| {
            held.servo(dt, steps, (&drives, index));
        })
    }

    fn __len__(&self) -> usize {
        self.held.len()
    }

    fn __repr__(&self) -> String {
        let closed = self.held.iter().filter(|held| held.is_some()).count();
        format!("<fuyu.Latches: {closed} of {} are closed>", self.held.len())
    }
}

impl Latches {
    /// Number of the robots' joints.
    fn dof(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.robots.try_borrow(py)?.robot().dof())
    }

    /// Robots and targets, whose rows are borrowed by `borrow`.
    fn sides<'py, Rows>(
        &self,
        py: Python<'py>,
        borrow: impl Fn(&Bound<'py, PyArray2<f64>>) -> Result<Rows, BorrowError>,
    ) -> PyResult<[Side<'py, Rows>; 2]> {
        let side = |batch: &Py<Batch>| {
            let batch = batch.bind(py).try_borrow()?;
            let rows = borrow(batch.rows(py)).map_err(in_use)?;
            Ok::<_, PyErr>(Side { batch, rows })
        };
        Ok([side(&self.robots)?, side(&self.targets)?])
    }

    /// Steps the pairs that are joined by `advance`, and writes their rows.
    fn step_held(
        &mut self,
        py: Python<'_>,
        dt: f64,
        steps: usize,
        advance: impl Fn(usize, &mut Held) + Send + Sync,
    ) -> PyResult<()> {
        if self.held.iter().all(Option::is_none) {
            return Ok(());
        }
        let [mut robots, mut targets] = self.sides(py, |rows| rows.try_readwrite())?;
        let (rows, target_rows) = (robots.rows.as_slice_mut()?, targets.rows.as_slice_mut()?);
        let (layout, target_layout) = (robots.batch.layout(), targets.batch.layout());
        let held = &mut self.held;
        let diverged = py.detach(|| {
            let pairs = held.par_iter_mut().zip(rows.par_chunks_mut(layout.len()));
            let pairs = pairs.zip(target_rows.par_chunks_mut(target_layout.len()));
            let one = |(index, ((held, row), target_row)): Joined<'_>| {
                let Some(held) = held else { return Ok(()) };
                advance(index, held);
                layout.write(held.robot.state(), row);
                target_layout.write(held.target.state(), target_row);
                layout.check(row, index)?;
                target_layout.check(target_row, index)
            };
            pairs.enumerate().try_for_each(one)
        });
        diverged.map_err(|problem| has_diverged(dt, steps, problem))
    }

    /// Refuses indices that are no pairs, and those given twice.
    fn check_pairs(&self, pairs: &[usize]) -> PyResult<()> {
        let mut seen = vec![false; self.held.len()];
        for index in pairs {
            match seen.get_mut(*index) {
                None => {
                    let count = self.held.len();
                    return Err(input(format!("there is no pair {index} among {count}")));
                }
                Some(true) => return Err(input(format!("pair {index} is given twice"))),
                Some(seen) => *seen = true,
            }
        }
        Ok(())
    }
}

/// The system of row `index`.
fn floating(
    robot: &Robot,
    layout: StateRow,
    rows: &[f64],
    index: usize,
    method: IntegrationMethod,
) -> Result<Floating, String> {
    let row = &rows[index * layout.len()..][..layout.len()];
    layout.check(row, index).map_err(|e| e.to_string())?;
    let mut state = State::at_rest(robot);
    layout.read(row, &mut state);
    Ok(Floating::new(robot.clone(), state, method))
}

/// A table of finite numbers, row by row.
fn table(name: &str, given: &Given<'_>, shape: [usize; 2]) -> PyResult<Vec<f64>> {
    if given.shape() != shape {
        let [rows, columns] = shape;
        return Err(input(format!(
            "`{name}` has the shape {:?}; it must be ({rows}, {columns})",
            given.shape()
        )));
    }
    let values: Vec<f64> = given.as_array().iter().copied().collect();
    check_finite(name, &values)?;
    Ok(values)
}
