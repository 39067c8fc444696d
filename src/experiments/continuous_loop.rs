//! A control law in continuous time: the closed loop of the stability theorems.

use nalgebra::DVector;

use crate::control::{
    ConfigError, Controller, ControllerConfig, LyapunovFunction, Measurement, PoseError,
    TipMeasurement,
};
use crate::dynamics::{Input, IntegrationMethod, Integrator, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::Pose;

/// A robot and its control law as one differential equation. The goal is at rest in the world; measurements are exact.
#[derive(Debug)]
pub struct ContinuousLoop {
    model: Model,
    tip: Frame,
    state: State,
    workspace: Workspace,
    integrator: Integrator,
    controller: Controller,
    /// Kinematics at the integrator's stages, for the law.
    stage: Workspace,
    X_WD: Pose,
    lyapunov: LyapunovFunction,
}

impl ContinuousLoop {
    /// Starts at rest at joint positions `q`, with the base frame at the world's origin.
    ///
    /// # Errors
    /// [`ConfigError`] if the settings do not fit the robot.
    pub fn new(
        model: Model,
        tip: &Frame,
        config: ControllerConfig,
        q: &DVector<f64>,
        X_WD: Pose,
    ) -> Result<Self, ConfigError> {
        let mut workspace = Workspace::new(&model);
        let state = State::at_rest_with(&model, q);
        workspace.set_positions(q);
        workspace.set_motion(&state);
        Ok(Self {
            integrator: Integrator::new(&model, IntegrationMethod::Dop8),
            stage: workspace.clone(),
            lyapunov: LyapunovFunction::new(config.gains.clone()),
            controller: Controller::new(model.clone(), tip.clone(), config)?,
            tip: tip.clone(),
            state,
            workspace,
            X_WD,
            model,
        })
    }

    /// Replaces the default integration method, DOP853.
    pub fn with_method(mut self, method: IntegrationMethod) -> Self {
        self.integrator = Integrator::new(&self.model, method);
        self
    }

    /// Advances by `dt` \[s\].
    ///
    /// # Panics
    /// If the law gives no efforts.
    pub fn step(&mut self, dt: f64) {
        let Self {
            tip,
            state,
            workspace,
            integrator,
            controller,
            stage,
            X_WD,
            ..
        } = self;
        let mut law = |time: f64, state: &State, input: &mut Input| {
            stage.set_positions(&state.q);
            let X_BD = state.X_WB(stage).inverse() * *X_WD;
            let sight = TipMeasurement::new(time, stage.X_BF(tip), X_BD);
            let measurement = Measurement::new(time, &state.q, &state.qd);
            let report = controller.update(&measurement.with_tip(Some(&sight)));
            report.expect("the law has efforts to give");
            input.efforts.copy_from(controller.efforts());
        };
        integrator.step(state, workspace, dt, &mut law);
    }

    /// Advances to `time` \[s\] in steps of at most `dt` \[s\].
    pub fn run_to(&mut self, time: f64, dt: f64) {
        let steps = ((time - self.state.time) / dt - 1e-9).ceil().max(1.0);
        let h = (time - self.state.time) / steps;
        for _ in 0..steps as usize {
            self.step(h);
        }
    }

    /// The state.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Kinematics and motion of the state.
    pub fn workspace(&self) -> &Workspace {
        &self.workspace
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Goal of the tip, world frame.
    pub fn X_WD(&self) -> &Pose {
        &self.X_WD
    }

    /// Pose of the base in the world.
    pub fn X_WB(&self) -> Pose {
        self.state.X_WB(&self.workspace)
    }

    /// Pose of the tip in the world.
    pub fn X_WE(&self) -> Pose {
        self.X_WB() * self.workspace.X_BF(&self.tip)
    }

    /// Deviation of the tip from the goal, in base axes.
    pub fn error(&self) -> PoseError {
        let X_BD = self.X_WB().inverse() * self.X_WD;
        PoseError::between(&self.workspace.X_BF(&self.tip), &X_BD)
    }

    /// The Lyapunov function \[J\].
    pub fn lyapunov(&mut self) -> f64 {
        let error = self.error();
        (self.lyapunov).value(&mut self.workspace, &self.state.qd, &error)
    }
}
