//! A tip controller as a node or an experiment runs it: one of the laws, its state, its output.

use nalgebra::DVector;

use super::bumpless_transfer::BumplessTransfer;
use super::latency_compensation::LatencyCompensation;
use super::prediction::Prediction;
use super::singularity_escape::{ConvergenceFailure, Watch};
use super::{
    ControlReport, ControllerConfig, FeedForward, GainError, Gains, Law, LawError, Manipulator,
    Measurement, workspace_radius,
};
use crate::model::{Frame, Model};

/// Joint states and base-frame measurements in, joint efforts out.
#[derive(Debug)]
pub struct Controller {
    arm: Manipulator,
    config: ControllerConfig,
    law: Box<dyn Law>,
    latency_compensation: LatencyCompensation,
    feed_forward: FeedForward,
    bumpless_transfer: BumplessTransfer,
    watch: Watch,
    /// What the tip's distance from the centre of mass cannot exceed \[m\].
    reach: Option<f64>,
    efforts: DVector<f64>,
}

/// A goal that is so much too far is within what a camera may err by \[m\].
const BEYOND: f64 = 0.01;

impl Controller {
    /// A controller for `model` with its tip at the frame `tip`.
    ///
    /// # Errors
    /// [`GainError`] when the settings do not fit the robot.
    pub fn new(model: Model, tip: Frame, config: ControllerConfig) -> Result<Self, GainError> {
        Self::with_tips(model, tip, Vec::new(), config)
    }

    /// A controller for a robot with several arms, each with its tip and its goal. All laws move the first; those that know of
    /// several ([`OperationalSpace`](super::OperationalSpace)) move the others too.
    ///
    /// # Errors
    /// [`GainError`] when the settings do not fit the robot.
    pub fn with_tips(
        model: Model,
        tip: Frame,
        more_tips: Vec<Frame>,
        config: ControllerConfig,
    ) -> Result<Self, GainError> {
        let joints = model.dof();
        config.check(joints)?;
        Ok(Self::start(model, tip, more_tips, config))
    }

    fn start(model: Model, tip: Frame, more_tips: Vec<Frame>, config: ControllerConfig) -> Self {
        let joints = model.dof();
        let arm = Manipulator {
            more_tips,
            ..Manipulator::new(model, tip)
        };
        Self {
            law: config.law.start(&config, &arm),
            latency_compensation: LatencyCompensation::new(&arm, config.goal),
            feed_forward: FeedForward::new(&arm.model, &arm.tip),
            bumpless_transfer: BumplessTransfer::new(joints, config.bumpless_transfer_time),
            watch: Watch::new(config.singularity_escape),
            reach: workspace_radius(&arm.model, &arm.tip),
            efforts: DVector::zeros(joints),
            arm,
            config,
        }
    }

    /// Forgets all but the settings in force: what follows is another run, in which time begins anew.
    pub fn restart(&mut self) {
        let Manipulator {
            model,
            tip,
            more_tips,
            ..
        } = &self.arm;
        let (model, tip, more_tips) = (model.clone(), tip.clone(), more_tips.clone());
        *self = Self::start(model, tip, more_tips, self.config.clone());
    }

    /// Settings in force.
    pub fn config(&self) -> &ControllerConfig {
        &self.config
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.arm.model
    }

    /// The tip's frame.
    pub fn tip(&self) -> &Frame {
        &self.arm.tip
    }

    /// Number of tips, at least 1.
    pub fn tip_count(&self) -> usize {
        self.arm.tips().count()
    }

    /// Changes the settings. The efforts go over to those of the new ones without a step, within a few times
    /// [`ControllerConfig::bumpless_transfer_time`]. A law that is given up forgets what it has found out, such as the joint
    /// PD its joint goal.
    ///
    /// # Errors
    /// [`GainError`] when they do not fit the robot; nothing has changed then.
    pub fn set_config(&mut self, config: ControllerConfig) -> Result<(), GainError> {
        let joints = self.arm.model.dof();
        config.check(joints)?;
        if config.law == self.config.law {
            self.law.configure(&config);
        } else {
            self.law = config.law.start(&config, &self.arm);
        }
        self.latency_compensation.set_config(config.goal);
        self.bumpless_transfer.time_constant = config.bumpless_transfer_time;
        self.bumpless_transfer.begin();
        self.watch.config = config.singularity_escape;
        self.watch.forget();
        self.config = config;
        Ok(())
    }

    /// Efforts of the last update \[N m or N\].
    pub fn efforts(&self) -> &DVector<f64> {
        &self.efforts
    }

    /// One control step. Without [`Measurement::tip`] the joints are only damped, unless the law has all
    /// that it needs: the joint PD looks at the camera when it starts and never again.
    ///
    /// # Errors
    /// [`LawError`] when the law has no efforts to give; the joints are then damped.
    pub fn update(&mut self, seen: &Measurement<'_>) -> Result<ControlReport, LawError> {
        let ControllerConfig {
            gains, prediction, ..
        } = &self.config;
        let k_v = &gains.k_v;
        self.latency_compensation
            .look(&mut self.arm, seen, *prediction);
        let seen = &self.latency_compensation.at_present(seen);
        let follows = *prediction == Prediction::Motion && self.law.feeds_forward();
        let goal = follows
            .then(|| self.latency_compensation.moving_goal(seen))
            .flatten();
        if let Some(goal) = &goal {
            let Manipulator {
                model, workspace, ..
            } = &self.arm;
            self.feed_forward.lead(model, workspace, goal);
        }
        let mut report = {
            let lead = goal.is_some().then(|| self.feed_forward.rates());
            let seen = &Measurement { lead, ..*seen };
            self.law.efforts(&mut self.arm, seen, &mut self.efforts)
        };
        if let Ok(report) = &mut report {
            report.second_error = self.latency_compensation.second_error();
            report.convergence_failure = if self.law.seeks_the_goal() {
                let (watch, arm) = (&mut self.watch, &self.arm);
                trouble(watch, self.reach, arm, gains, &self.efforts, seen, report)
            } else {
                self.watch.forget();
                None
            };
        }
        if report.as_ref().is_ok_and(|report| report.active) {
            let part = self.law.joint_damping();
            if let Some(goal) = &goal {
                let workspace = &self.arm.workspace;
                (self.feed_forward).add(workspace, goal, k_v, part, &mut self.efforts);
            }
            (self.bumpless_transfer).blend(seen.time, &mut self.efforts, k_v, part);
        } else {
            self.efforts.fill(0.0);
            self.bumpless_transfer.release(seen.time, k_v);
        }
        for (j, effort) in self.efforts.iter_mut().enumerate() {
            *effort -= self.bumpless_transfer.k_v(j) * seen.qd[j];
            *effort += self.watch.kick(seen.time, j, k_v[j]);
        }
        report
    }
}

/// Looks whether the law's pull, in `efforts`, brings the tip nearer.
fn trouble(
    watch: &mut Watch,
    reach: Option<f64>,
    arm: &Manipulator,
    gains: &Gains,
    efforts: &DVector<f64>,
    seen: &Measurement<'_>,
    report: &ControlReport,
) -> Option<ConvergenceFailure> {
    let (Some(sight), Some(error), true) = (seen.tip, &report.error, report.active) else {
        watch.forget();
        return None;
    };
    let distance = (sight.X_BD.translation.vector - arm.workspace.p_BC()).norm();
    let short = reach.map(|reach| distance - reach);
    let short = short.filter(|short| *short > BEYOND);
    watch.look(seen, gains, error, efforts, short)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Gains, IkError, JointPdGains, LawKind, Saturation, TipMeasurement};
    use crate::dynamics::Workspace;
    use crate::spatial::Pose;
    use nalgebra::Translation3;

    fn planar(law: LawKind) -> Controller {
        let xml = include_str!("../../../../urdf/planar_two_link.urdf");
        let model = Model::from_urdf(xml, "planar_two_link.urdf").unwrap();
        let tip = model.frame("tool0").unwrap().clone();
        Controller::new(model, tip, config(law)).unwrap()
    }

    fn config(law: LawKind) -> ControllerConfig {
        let gains = Gains {
            k_p: 100.0,
            k_o: 1.0,
            k_v: vec![200.0, 1000.0],
            saturation: Saturation::NONE,
        };
        ControllerConfig {
            joint_pd: JointPdGains {
                k_p: vec![40.0, 200.0],
            },
            ..ControllerConfig::new(law, gains)
        }
    }

    fn poses(
        controller: &Controller,
        q: [f64; 2],
        goal: [f64; 2],
    ) -> (DVector<f64>, TipMeasurement) {
        let mut workspace = Workspace::new(controller.model());
        let mut pose = |q: &DVector<f64>| {
            workspace.set_positions(controller.model(), q);
            workspace.X_BF(controller.tip())
        };
        let q = DVector::from_row_slice(&q);
        let tip = pose(&q);
        let goal = pose(&DVector::from_row_slice(&goal));
        (q, TipMeasurement::new(0.0, tip, goal))
    }

    fn update(
        controller: &mut Controller,
        time: f64,
        q: &DVector<f64>,
        qd: &DVector<f64>,
        sight: &TipMeasurement,
    ) -> Result<ControlReport, LawError> {
        controller.update(&Measurement::new(time, q, qd).with_tip(Some(sight)))
    }

    #[test]
    fn without_a_measurement_the_joints_are_damped() {
        let mut controller = planar(LawKind::TransposeJacobian);
        let (q, sight) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
        let qd = DVector::from_row_slice(&[0.1, -0.2]);
        controller.update(&Measurement::new(0.0, &q, &qd)).unwrap();
        assert_eq!(controller.efforts().as_slice(), [-20.0, 200.0]);
        let report = update(&mut controller, 0.01, &q, &qd, &sight).unwrap();
        assert!(report.error.is_some());
        assert_ne!(controller.efforts().as_slice(), [-20.0, 200.0]);
    }

    #[test]
    fn joint_pd_pulls_to_the_joint_goal_of_its_start_and_needs_no_camera_after() {
        let mut controller = planar(LawKind::JointPd);
        let (q, sight) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
        let rest = DVector::zeros(2);
        update(&mut controller, 0.0, &q, &rest, &sight).unwrap();
        let pulled = controller.efforts().clone();
        assert!((pulled[0] - 40.0 * 0.2).abs() < 1e-6 && (pulled[1] + 200.0 * 0.2).abs() < 1e-6);
        controller
            .update(&Measurement::new(0.01, &q, &rest))
            .unwrap();
        assert_eq!(controller.efforts(), &pulled);
    }

    // Would break if anything of the run before were left: a joint goal, a difference that decays, a pending kick.
    #[test]
    fn a_restarted_controller_does_what_a_new_one_does() {
        for (_, law) in LawKind::NAMES {
            let mut used = planar(law);
            let (q, sight) = poses(&used, [0.3, 1.0], [0.5, 0.8]);
            let (_, other) = poses(&used, [0.3, 1.0], [1.5, -0.8]);
            let qd = DVector::from_row_slice(&[0.1, -0.2]);
            for k in 0..500 {
                update(&mut used, 0.01 * f64::from(k), &q, &qd, &other).ok();
            }
            used.set_config(config(law)).unwrap();
            update(&mut used, 5.0, &q, &qd, &other).ok();
            used.restart();
            let mut fresh = planar(law);
            for k in 0..100 {
                let time = 0.01 * f64::from(k);
                update(&mut used, time, &q, &qd, &sight).ok();
                update(&mut fresh, time, &q, &qd, &sight).ok();
                assert_eq!(used.efforts(), fresh.efforts(), "{law:?} at {time} s");
            }
        }
    }

    #[test]
    fn a_goal_out_of_reach_is_an_error_and_leaves_damping() {
        let mut controller = planar(LawKind::JointPd);
        let (q, mut sight) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
        sight.X_BD = Pose::from_parts(Translation3::new(20.0, 0.0, 0.0), sight.X_BE.rotation);
        let qd = DVector::from_row_slice(&[0.1, 0.0]);
        for _ in 0..2 {
            let refused = update(&mut controller, 0.0, &q, &qd, &sight);
            let LawError::Unreachable(IkError::NotFound { position, .. }) = refused.unwrap_err();
            assert!(position > 10.0);
            assert_eq!(controller.efforts().as_slice(), [-20.0, 0.0]);
        }
    }

    /// Efforts that step at a switch, a difference that never decays, or damping that jumps break this.
    #[test]
    fn changed_settings_take_over_without_a_jump() {
        let mut controller = planar(LawKind::TransposeJacobian);
        let (q, sight) = poses(&controller, [0.3, 1.0], [0.5, 0.8]);
        let qd = DVector::from_row_slice(&[0.1, -0.2]);
        let mut time = 0.0;
        let mut step = |controller: &mut Controller, dt: f64| {
            time += dt;
            update(controller, time, &q, &qd, &sight).unwrap();
            controller.efforts().clone()
        };
        let law = config(LawKind::TransposeJacobian);
        let stronger = ControllerConfig {
            gains: Gains {
                k_p: 300.0,
                k_v: vec![20.0, 3000.0],
                ..law.gains.clone()
            },
            ..law.clone()
        };
        let approximate = ControllerConfig {
            jacobian: crate::control::JacobianKind::FixedBase,
            ..law
        };
        for settings in [config(LawKind::JointPd), stronger, approximate] {
            let before = step(&mut controller, 0.01);
            let mut fresh = planar(settings.law);
            fresh.set_config(settings.clone()).unwrap();
            let after = step(&mut fresh, 0.0);
            let jump = (&after - &before).norm();
            assert!(jump > 5.0, "{jump}: nothing to hand over");
            controller.set_config(settings).unwrap();
            let mut last = before;
            for _ in 0..500 {
                let now = step(&mut controller, 0.01);
                assert!((&now - &last).norm() < 0.021 * jump.max(700.0), "{now}");
                last = now;
            }
            assert!((last - after).norm() < 1e-3 * jump.max(700.0));
        }
    }

    #[test]
    fn settings_that_do_not_fit_change_nothing() {
        let mut controller = planar(LawKind::TransposeJacobian);
        let before = controller.config().clone();
        for broken in [
            ControllerConfig {
                gains: Gains {
                    k_p: -1.0,
                    ..before.gains.clone()
                },
                ..before.clone()
            },
            ControllerConfig {
                gains: Gains {
                    k_v: vec![1.0],
                    ..before.gains.clone()
                },
                ..before.clone()
            },
            ControllerConfig {
                gains: Gains {
                    saturation: Saturation {
                        position: f64::NAN,
                        orientation: 1.0,
                    },
                    ..before.gains.clone()
                },
                ..before.clone()
            },
            ControllerConfig {
                law: LawKind::JointPd,
                joint_pd: JointPdGains::default(),
                ..before.clone()
            },
        ] {
            assert!(controller.set_config(broken).is_err());
            assert_eq!(controller.config(), &before);
        }
    }
}
