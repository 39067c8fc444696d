//! Controller: one law, and the parts that all laws share (latency compensation, feed-forward, damping, bumpless transfer).

#[cfg(test)]
mod tests;

use nalgebra::DVector;

use super::bumpless_transfer::BumplessTransfer;
use super::camera_latency_compensation::LatencyCompensation;
use super::prediction::Prediction;
use super::singularity_escape::{ConvergenceMonitor, Progress};
use super::{
    ConfigError, ControlError, ControlReport, ControllerConfig, FeedForward, Law, LawConfig,
    LawInput, LawStatus, Manipulator, Measurement, PoseError, SampledDamping, workspace_radius,
};
use crate::model::{Frame, Model};

/// Computes joint efforts from joint states and measurements in the base frame.
///
/// A step compensates the latency of the camera, calls the law, adds joint damping, and blends the efforts after a change of
/// settings ([`ControllerConfig::bumpless_transfer_time`]).
///
/// # Example
/// An arm moves its tip to a goal. The controller receives the joint state, and tip and goal in the base frame.
///
/// ```
/// #![allow(non_snake_case)]
/// use fuyu_physics::control::{
///     Controller, ControllerConfig, Gains, LawKind, Measurement, Saturation, TipMeasurement,
/// };
/// use fuyu_physics::dynamics::Workspace;
/// use fuyu_physics::model::Model;
/// use nalgebra::{DVector, Translation3};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let urdf = include_str!("../../../../urdf/planar_two_link.urdf");
/// let model = Model::from_urdf(urdf, "planar_two_link.urdf")?;
/// let tip = model.frame("tool0").ok_or("no tool0")?.clone();
/// let gains = Gains {
///     k_p: 100.0,
///     k_o: 0.0, // the attitude of the tip is free
///     k_v: vec![200.0, 1000.0],
///     saturation: Saturation::NONE,
/// };
/// let config = ControllerConfig::new(LawKind::TransposeJacobian, gains);
/// let mut controller = Controller::new(model.clone(), tip.clone(), config)?;
///
/// // One step at 0 s: the arm is at rest, and the goal is 0.1 m from its tip.
/// let (q, qd) = (DVector::from_vec(vec![0.3, 1.0]), DVector::zeros(2));
/// let mut workspace = Workspace::new(&model);
/// workspace.set_positions(&q);
/// let X_BE = workspace.X_BF(&tip);
/// let X_BD = Translation3::new(-0.1, 0.0, 0.0) * X_BE;
/// let seen = TipMeasurement::new(0.0, X_BE, X_BD);
/// let report = controller.update(&Measurement::new(0.0, &q, &qd).with_tip(Some(&seen)))?;
/// assert!(report.active && controller.efforts().amax() > 0.1);
///
/// // Without a camera measurement the joints are only damped: here, at rest, without effort.
/// let report = controller.update(&Measurement::new(0.01, &q, &qd))?;
/// assert!(!report.active && controller.efforts().amax() == 0.0);
///
/// // Wrong input is refused with its name, and gives no effort.
/// let lost = DVector::from_vec(vec![f64::NAN, 1.0]);
/// let error = controller.update(&Measurement::new(0.02, &lost, &qd)).unwrap_err();
/// assert_eq!(
///     error.to_string(),
///     "the position of joint 'joint1' is NaN in the measurement; it must be finite"
/// );
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Controller {
    manipulator: Manipulator,
    config: ControllerConfig,
    law: Box<dyn Law>,
    latency_compensation: LatencyCompensation,
    feed_forward: FeedForward,
    bumpless_transfer: BumplessTransfer,
    convergence: ConvergenceMonitor,
    workspace_radius: Option<f64>,
    efforts: DVector<f64>,
}

impl Controller {
    /// A controller for `model` with its tip at the frame `tip`.
    ///
    /// # Errors
    /// [`ConfigError`] when the settings do not fit the robot.
    pub fn new(model: Model, tip: Frame, config: ControllerConfig) -> Result<Self, ConfigError> {
        Self::with_tips(model, tip, Vec::new(), config)
    }

    /// A controller for a robot with several arms, each with a tip and a goal. All laws move the first tip; laws for
    /// several tips ([`OperationalSpace`](super::OperationalSpace)) also move the others.
    ///
    /// # Errors
    /// [`ConfigError`] when the settings do not fit the robot.
    pub fn with_tips(
        model: Model,
        tip: Frame,
        more_tips: Vec<Frame>,
        config: ControllerConfig,
    ) -> Result<Self, ConfigError> {
        let config = with_fallback_gains(config, &model, &tip)?;
        config.check(model.dof())?;
        let manipulator = Manipulator::new(model, tip).with_more_tips(more_tips);
        let law = config.law.build(&manipulator);
        let law = law.ok_or(ConfigError::NoCustomLaw)?;
        Ok(Self::assemble(manipulator, law, config))
    }

    /// A controller with a user-defined law. `config.law` becomes [`LawConfig::Custom`].
    ///
    /// # Errors
    /// [`ConfigError`] when the settings do not fit the robot.
    ///
    /// # Example
    /// A law that pulls the tip towards its goal with a constant force, which the joint damping turns into a constant speed.
    ///
    /// ```
    /// use fuyu_physics::control::{
    ///     Controller, ControllerConfig, Gains, Law, LawConfig, LawError, LawInput, LawStatus,
    ///     Manipulator, Saturation,
    /// };
    /// # use fuyu_physics::control::{Measurement, TipMeasurement};
    /// # use fuyu_physics::dynamics::Workspace;
    /// use fuyu_physics::model::Model;
    /// use nalgebra::{DVector, Matrix6xX};
    ///
    /// #[derive(Debug)]
    /// struct ConstantForce {
    ///     force: f64, // [N]
    ///     jacobian: Matrix6xX<f64>,
    /// }
    ///
    /// impl Law for ConstantForce {
    ///     fn efforts(
    ///         &mut self,
    ///         input: &LawInput<'_>,
    ///         manipulator: &mut Manipulator,
    ///         efforts: &mut DVector<f64>,
    ///     ) -> Result<LawStatus, LawError> {
    ///         let Some(error) = &input.error else {
    ///             return Ok(LawStatus::Inactive); // no camera measurement
    ///         };
    ///         let force = error.position.normalize() * self.force;
    ///         let Manipulator { workspace, tip, .. } = manipulator;
    ///         workspace.generalized_jacobian(tip, &mut self.jacobian);
    ///         efforts.copy_from(&self.jacobian.rows(0, 3).tr_mul(&force));
    ///         Ok(LawStatus::TipFeedback)
    ///     }
    /// }
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let urdf = include_str!("../../../../urdf/planar_two_link.urdf");
    /// let model = Model::from_urdf(urdf, "planar_two_link.urdf")?;
    /// let tip = model.frame("tool0").ok_or("no tool0")?.clone();
    /// let gains = Gains { k_p: 1.0, k_o: 0.0, k_v: vec![200.0, 1000.0], saturation: Saturation::NONE };
    /// let config = ControllerConfig::new(LawConfig::Custom, gains);
    /// let law = ConstantForce { force: 20.0, jacobian: Matrix6xX::zeros(model.dof()) };
    /// let manipulator = Manipulator::new(model, tip);
    /// let mut controller = Controller::with_law(manipulator, Box::new(law), config)?;
    /// # let (q, qd) = (DVector::from_vec(vec![0.3, 1.0]), DVector::zeros(2));
    /// # let mut workspace = Workspace::new(controller.model());
    /// # workspace.set_positions(&q);
    /// # let pose = workspace.X_BF(controller.tip());
    /// # let goal = nalgebra::Translation3::new(-0.1, 0.0, 0.0) * pose;
    /// # let tip = TipMeasurement::new(0.0, pose, goal);
    /// # let measurement = Measurement::new(0.0, &q, &qd).with_tip(Some(&tip));
    /// let report = controller.update(&measurement)?;
    /// assert!(report.active && controller.efforts().amax() > 0.1);
    ///
    /// // A law that divides by zero, here at the goal, is refused by name.
    /// # let tip = TipMeasurement::new(0.0, pose, pose);
    /// # let at_goal = Measurement::new(0.01, &q, &qd).with_tip(Some(&tip));
    /// let error = controller.update(&at_goal).unwrap_err();
    /// assert!(error.to_string().contains("law custom computed for joint 'joint1' is NaN"));
    /// # Ok(())
    /// # }
    /// ```
    pub fn with_law(
        manipulator: Manipulator,
        law: Box<dyn Law>,
        config: ControllerConfig,
    ) -> Result<Self, ConfigError> {
        let config = ControllerConfig {
            law: LawConfig::Custom,
            ..config
        };
        config.check(manipulator.model.dof())?;
        Ok(Self::assemble(manipulator, law, config))
    }

    fn assemble(manipulator: Manipulator, law: Box<dyn Law>, config: ControllerConfig) -> Self {
        let Manipulator { model, tip, .. } = &manipulator;
        let joints = model.dof();
        Self {
            law,
            latency_compensation: LatencyCompensation::new(&manipulator, config.goal),
            feed_forward: FeedForward::new(model, tip),
            bumpless_transfer: BumplessTransfer::new(joints, config.bumpless_transfer_time),
            convergence: ConvergenceMonitor::new(config.singularity_escape),
            workspace_radius: workspace_radius(model, tip),
            efforts: DVector::zeros(joints),
            manipulator,
            config,
        }
    }

    /// Restarts the controller with its present settings: the next step belongs to another run, whose time may start
    /// again.
    pub fn restart(&mut self) {
        let joints = self.manipulator.model.dof();
        let config = &self.config;
        self.law.reset();
        self.latency_compensation = LatencyCompensation::new(&self.manipulator, config.goal);
        self.bumpless_transfer = BumplessTransfer::new(joints, config.bumpless_transfer_time);
        self.convergence.reset();
        self.efforts.fill(0.0);
    }

    /// The present settings.
    pub fn config(&self) -> &ControllerConfig {
        &self.config
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.manipulator.model
    }

    /// The first tip's frame.
    pub fn tip(&self) -> &Frame {
        &self.manipulator.tip
    }

    /// Gains of the joint damping `-K_V q̇` that the controller adds while the law acts \[N m s/rad or N s/m\].
    pub fn joint_damping(&self) -> Vec<f64> {
        let fraction = self.law.joint_damping_fraction();
        self.config.gains.k_v.iter().map(|k| k * fraction).collect()
    }

    /// Rate at which the law damps the joints, or the tip, in the posture `q`, in the direction with the fastest
    /// damping \[1/s\]; `None` for a robot without joints.
    ///
    /// # Panics
    /// If `q` does not have one element per joint.
    pub fn damping_rate(&mut self, q: &DVector<f64>) -> Option<f64> {
        match &self.config.law {
            LawConfig::OperationalSpace(law) => Some(law.damping()),
            // Critically damped: 2 ω.
            LawConfig::ComputedTorque(law) => Some(2.0 * law.frequency),
            _ => {
                let gains = self.joint_damping();
                let workspace = &mut self.manipulator.workspace;
                workspace.set_positions(q);
                SampledDamping::at(workspace, &gains).map(|damping| damping.rate)
            }
        }
    }

    /// Number of tips, at least 1.
    pub fn tip_count(&self) -> usize {
        self.manipulator.tips().count()
    }

    /// Changes the settings without a step in the efforts: they approach those of the new settings within a few times
    /// [`ControllerConfig::bumpless_transfer_time`]. A law that is replaced loses its state, such as the joint positions of
    /// the goal under joint PD control. [`LawConfig::Custom`] keeps the user-defined law.
    ///
    /// # Errors
    /// [`ConfigError`] if they do not fit the robot; nothing has then changed.
    pub fn set_config(&mut self, config: ControllerConfig) -> Result<(), ConfigError> {
        let Manipulator { model, tip, .. } = &self.manipulator;
        let config = with_fallback_gains(config, model, tip)?;
        config.check(self.manipulator.model.dof())?;
        if config.law == LawConfig::Custom && self.config.law != LawConfig::Custom {
            return Err(ConfigError::NoCustomLaw);
        }
        if !self.law.configure(&config.law)
            && let Some(law) = config.law.build(&self.manipulator)
        {
            self.law = law;
        }
        self.latency_compensation.set_config(config.goal);
        self.bumpless_transfer.time_constant = config.bumpless_transfer_time;
        self.bumpless_transfer.start();
        self.convergence.config = config.singularity_escape;
        self.convergence.reset();
        self.config = config;
        Ok(())
    }

    /// Changes how tip and goal are predicted, at once.
    pub(super) fn set_prediction(&mut self, prediction: Prediction) {
        self.config.prediction = prediction;
    }

    /// Replaces the law by a user-defined one, without a step in the efforts as in [`set_config`](Self::set_config).
    pub fn set_law(&mut self, law: Box<dyn Law>) {
        self.law = law;
        self.config.law = LawConfig::Custom;
        self.bumpless_transfer.start();
        self.convergence.reset();
    }

    /// Efforts of the last step \[N m or N\], one per joint.
    pub fn efforts(&self) -> &DVector<f64> {
        &self.efforts
    }

    /// One control step; [`efforts`](Self::efforts) has its result. Without [`Measurement::tip`] the joints are only damped,
    /// except under a law that does not need it: joint PD control uses only the first camera measurement.
    ///
    /// # Errors
    /// [`ControlError`] when a measured value or an effort of the law is not finite, or when the law fails. The joints are
    /// then only damped; where the joint state itself is wrong, the efforts are zero.
    pub fn update(&mut self, measurement: &Measurement<'_>) -> Result<ControlReport, ControlError> {
        self.efforts.fill(0.0);
        measurement.check_joint_state(&self.manipulator.model)?;
        let report = match measurement.check_sensors() {
            Ok(()) => self.law_efforts(measurement),
            Err(error) => Err(error),
        };
        let k_v = &self.config.gains.k_v;
        if report.as_ref().is_ok_and(|report| report.active) {
            let fraction = self.law.joint_damping_fraction();
            (self.bumpless_transfer).apply(measurement.time, &mut self.efforts, k_v, fraction);
        } else {
            self.efforts.fill(0.0);
            self.bumpless_transfer.cancel(measurement.time, k_v);
            self.convergence.reset();
        }
        for (j, effort) in self.efforts.iter_mut().enumerate() {
            *effort -= self.bumpless_transfer.k_v(j) * measurement.qd[j];
            *effort += (self.convergence).escape_effort(measurement.time, j, k_v[j]);
        }
        report
    }

    /// Writes the efforts of the law and of the feed-forward.
    fn law_efforts(
        &mut self,
        measurement: &Measurement<'_>,
    ) -> Result<ControlReport, ControlError> {
        let ControllerConfig {
            gains, prediction, ..
        } = &self.config;
        let latency_compensation = &mut self.latency_compensation;
        latency_compensation.update(&mut self.manipulator, measurement, *prediction);
        let follows = *prediction == Prediction::Motion && self.law.feeds_forward();
        let goal = follows.then(|| latency_compensation.moving_goal(measurement));
        let goal = goal.flatten();
        if let Some(goal) = &goal {
            self.feed_forward.update(&self.manipulator.workspace, goal);
        }
        let tips = latency_compensation.tips();
        let error = tips[0].map(|tip| PoseError::between(&tip.X_BE, &tip.X_BD));
        let input = LawInput {
            time: measurement.time,
            q: measurement.q,
            qd: measurement.qd,
            gains,
            tips,
            error: error.map(|error| gains.saturation.saturate(&error)),
            w_IB_B: latency_compensation.w_IB_B(),
            R_IB: latency_compensation.R_IB(),
            reference_rates: goal.is_some().then(|| self.feed_forward.rates()),
        };
        let status = self
            .law
            .efforts(&input, &mut self.manipulator, &mut self.efforts)?;
        let (got, joints) = (self.efforts.len(), self.manipulator.model.dof());
        if got != joints {
            self.efforts = DVector::zeros(joints);
            let law = self.config.law.name();
            return Err(ControlError::EffortCount { law, got, joints });
        }
        let mut report = ControlReport {
            error,
            second_error: latency_compensation.second_error(),
            active: status != LawStatus::Inactive,
            ..ControlReport::default()
        };
        if let (Some(error), LawStatus::TipFeedback) = (&input.error, status) {
            report.position_saturated = error.position_saturated;
            report.orientation_saturated = error.orientation_saturated;
        }
        if !report.active {
            return Ok(report);
        }
        if let (Some(tip), Some(error), true) =
            (input.tip(), &error, self.law.monitors_convergence())
        {
            let p_BC = self.manipulator.workspace.p_BC();
            let distance = (tip.X_BD.translation.vector - p_BC).norm();
            report.convergence_failure = self.convergence.update(&Progress {
                time: measurement.time,
                qd: measurement.qd,
                gains,
                error,
                efforts: &self.efforts,
                excess: self.workspace_radius.map(|radius| distance - radius),
            });
        } else {
            self.convergence.reset();
        }
        if let Some(goal) = &goal {
            let workspace = &self.manipulator.workspace;
            let fraction = self.law.joint_damping_fraction();
            (self.feed_forward).add(workspace, goal, &gains.k_v, fraction, &mut self.efforts);
        }
        let mut joints = self.manipulator.model.joints().iter().zip(&self.efforts);
        match joints.find(|(_, effort)| !effort.is_finite()) {
            None => Ok(report),
            Some((joint, effort)) => Err(ControlError::Effort {
                law: self.config.law.name(),
                joint: joint.name.clone(),
                value: *effort,
            }),
        }
    }
}

/// Period of the joint damping that acts while a law that does not need it has no measurement \[s\].
const DAMPING_PERIOD: f64 = 0.01;

/// The same settings; with computed gains, for the times without measurements, if the law needs none and none are given.
fn with_fallback_gains(
    config: ControllerConfig,
    model: &Model,
    tip: &Frame,
) -> Result<ControllerConfig, ConfigError> {
    match config.law.needs_joint_damping() {
        true => Ok(config),
        false => config.with_auto_gains(model, tip, DAMPING_PERIOD),
    }
}
