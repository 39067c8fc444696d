//! `Integrator`.

use fuyu::dynamics::{FormulationKind, Input, IntegrationMethod, Workspace};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Given, joints};
use crate::error::{choose, finite, input, run, same_robot};
use crate::model::{Model, set_wrenches};
use crate::state::State;

/// Steps a `State` of `model` with a fixed step.
///
/// `method` is dop8 (Dormand-Prince, order 8) or rk4; `formulation` that of forward dynamics: articulated_body, reduced, kane or
/// newton_euler. Free motion conserves momentum exactly. One thread at a time may use an integrator.
#[pyclass(module = "fuyu")]
pub struct Integrator {
    model: Model,
    method: String,
    integrator: fuyu::dynamics::Integrator,
    workspace: Workspace,
}

#[pymethods]
impl Integrator {
    #[new]
    #[pyo3(signature = (model, method = "dop8", *, formulation = "articulated_body"))]
    fn new(model: &Model, method: &str, formulation: &str) -> PyResult<Self> {
        let kind = choose("method", &IntegrationMethod::NAMES, method)?;
        let formulation = choose("formulation", &FormulationKind::NAMES, formulation)?;
        let integrator = fuyu::dynamics::Integrator::new(&model.robot, kind);
        Ok(Self {
            integrator: integrator.with_formulation(formulation).map_err(input)?,
            workspace: Workspace::new(&model.robot),
            model: model.clone(),
            method: method.to_owned(),
        })
    }

    /// The robot.
    #[getter]
    fn model(&self) -> Model {
        self.model.clone()
    }

    /// Name of the method.
    #[getter]
    fn method(&self) -> &str {
        &self.method
    }

    /// Advances `state` in place by `steps` steps of `dt` [s] under held joint `efforts`, shape (n,) [N m or N], zero by default.
    ///
    /// Efforts are not limited. `wrenches` maps links to external wrenches (force, torque), shape (6,) [N, N m], about the link's
    /// origin in its axes. The interpreter's lock is released. A motion that diverges is a RunError; the state is then as before.
    #[pyo3(signature = (state, dt, efforts = None, *, steps = 1, wrenches = None))]
    fn step(
        &mut self,
        py: Python<'_>,
        state: &mut State,
        dt: f64,
        efforts: Option<Given<'_>>,
        steps: usize,
        wrenches: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        let robot = &self.model.robot;
        same_robot("the integrator", robot, "the state", &state.robot)?;
        let dt = finite("dt", dt)?;
        let mut input = Input::zero(robot);
        input.efforts = joints("efforts", efforts.as_ref(), robot)?;
        set_wrenches(robot, wrenches, &mut input)?;
        let (integrator, workspace) = (&mut self.integrator, &mut self.workspace);
        let mut next = state.state.clone();
        py.detach(|| {
            let mut held = |_: f64, _: &fuyu::dynamics::State, acting: &mut Input| {
                acting.copy_from(&input);
            };
            integrator.steps(&mut next, workspace, dt, steps, &mut held);
        });
        if !next.is_finite() {
            return Err(run(format!(
                "the motion of robot '{}' diverges with steps of {dt} s from {} s on; give smaller steps",
                robot.name(),
                state.state.time
            )));
        }
        state.state = next;
        Ok(())
    }
}
