//! Parameters of the controller node: common ones here, and one file for each law.

mod computed_torque;
mod joint_pd;
mod operational;
mod prediction;
mod shared;
mod singularity_escape;
mod straight_path;

use std::sync::{
    Arc,
    atomic::{AtomicUsize, Ordering},
};

use crate::{
    control::{ControllerConfig, LawKind},
    model::{Frame, Model},
    nodes::{
        choice,
        tip::{declare_second_tip_link, declare_tip_link},
    },
    ros::{Declare, Lifecycle, ParameterValue, params::Parameter},
};

/// Parameters of the controller node.
#[derive(Debug, Clone)]
pub struct ControllerParams {
    /// Link whose frame is the tip.
    pub tip_link: String,
    /// Link whose frame is the tip of a second arm; empty if there is none.
    pub second_tip_link: String,
    /// Law and gains. Without `k_v`, or without `joint_k_p` under joint PD control, these gains are computed by
    /// [`ControllerParams::complete`].
    pub config: ControllerConfig,
    /// Period of joint states for which gains are computed \[s\].
    pub sample_period: f64,
    /// Age above which a measurement of camera, gyro or estimator is ignored \[s\].
    pub measurement_timeout: f64,
    /// Whether every joint state waits for the camera frame of the same stamp.
    pub lockstep: bool,
    /// Whether the delay between a state and its efforts is measured and compensated.
    pub delay_compensation: bool,
    /// Whether the node configures and activates itself.
    pub autostart: bool,
}

/// Parameters of one law; they may change while the node runs.
trait Group: std::fmt::Debug {
    /// Writes the current values to `config`.
    fn write(&self, config: &mut ControllerConfig);
}

/// A parameter with one value for each joint.
struct PerJoint {
    name: &'static str,
    /// The law that needs it; `None` for all.
    law: Option<LawKind>,
}

/// Law and gains as live parameters, which may change while the node runs.
#[derive(Debug)]
pub(super) struct Live {
    shared: shared::Shared,
    groups: Vec<Box<dyn Group>>,
    /// The configuration as last read.
    known: ControllerConfig,
    /// Revision of the parameters when they were last read.
    revision: u64,
    /// Number of joints of the robot, for which gains must have values; zero while unknown.
    joints: Arc<AtomicUsize>,
}

const SMALLEST_GAIN: f64 = 1e-9;
const LARGEST_GAIN: f64 = 1e9;

impl Live {
    fn declare(declare: &mut Declare) -> Self {
        let shared = shared::Shared::declare(declare);
        let groups: Vec<Box<dyn Group>> = vec![
            Box::new(computed_torque::ComputedTorque::declare(declare)),
            Box::new(joint_pd::JointPd::declare(declare)),
            Box::new(prediction::Predictions::declare(declare)),
            Box::new(operational::Operational::declare(declare)),
            Box::new(straight_path::StraightPath::declare(declare)),
            Box::new(singularity_escape::SingularityEscape::declare(declare)),
        ];
        let joints = Arc::new(AtomicUsize::new(0));
        let robot = Arc::clone(&joints);
        declare.check_together(move |get| fit_the_robot(&robot, get));
        let mut live = Self {
            known: shared.config(),
            revision: shared.revision(),
            shared,
            groups,
            joints,
        };
        live.known = live.get();
        live
    }

    /// Sets the robot's number of joints: gains with another number of values are refused from now on.
    pub(super) fn fit(&self, joints: usize) {
        self.joints.store(joints, Ordering::Relaxed);
    }

    pub(super) fn get(&self) -> ControllerConfig {
        let mut config = self.shared.config();
        for group in &self.groups {
            group.write(&mut config);
        }
        config
    }

    /// The configuration, if it has changed since it was last read.
    pub(super) fn changed(&mut self) -> Option<ControllerConfig> {
        let revision = self.shared.revision();
        if std::mem::replace(&mut self.revision, revision) == revision {
            return None;
        }
        let now = self.get();
        let changed = now != self.known;
        changed.then(|| {
            self.known = now.clone();
            now
        })
    }
}

/// Checks that gains needed by the law have one value for each joint.
fn fit_the_robot(joints: &AtomicUsize, get: &dyn Fn(&str) -> ParameterValue) -> Result<(), String> {
    let joints = joints.load(Ordering::Relaxed);
    if joints == 0 {
        return Ok(());
    }
    let law = String::from_value(&get("law"));
    let law = law.and_then(|law| choice::find(&LawKind::NAMES, &law).ok());
    let lists = [shared::PER_JOINT, joint_pd::PER_JOINT];
    for PerJoint { name, law: needs } in lists.into_iter().flatten() {
        let got = Vec::<f64>::from_value(&get(name)).map_or(0, |v| v.len());
        // Empty gains are computed.
        if (needs.is_none() || *needs == law) && got != joints && got != 0 {
            return Err(format!(
                "{name} has {got} values; the robot has {joints} joints, so give {joints}"
            ));
        }
    }
    Ok(())
}

impl ControllerParams {
    /// `config` with empty gains replaced by computed ones, for the tip `tip` of `model`.
    ///
    /// # Errors
    /// A line that says why the gains cannot be computed.
    pub fn complete(
        &self,
        config: ControllerConfig,
        model: &Model,
        tip: &Frame,
    ) -> Result<ControllerConfig, String> {
        let completed = config.with_auto_gains(model, tip, self.sample_period);
        completed.map_err(|e| format!("k_v is empty: {e}; give k_v"))
    }

    /// Declares and reads the parameters. The caller must call `declare.finish`.
    pub fn declare(declare: &mut Declare) -> Self {
        Self::declare_live(declare).0
    }

    pub(super) fn declare_live(declare: &mut Declare) -> (Self, Live) {
        let tip_link = declare_tip_link(declare);
        let second_tip_link = declare_second_tip_link(declare);
        let live = Live::declare(declare);
        let measurement_timeout = declare
            .param(
                "measurement_timeout",
                1.0,
                "Age beyond which a measurement is not used [s]: without the camera's the joints are only damped, without the gyro's angular momentum is taken as zero",
            )
            .range(1e-3, 1e6)
            .read_only()
            .value();
        let sample_period = declare
            .param(
                "sample_period",
                0.01,
                "Time from one joint state to the next, for which gains are computed that are not given [s]",
            )
            .range(1e-4, 10.0)
            .read_only()
            .value();
        let lockstep = declare
            .param(
                "lockstep",
                false,
                "Answer a joint state only when its camera frame has arrived, and ignore the estimator",
            )
            .read_only()
            .value();
        let delay_compensation = declare
            .param(
                "delay_compensation",
                false,
                "Measure how late efforts act and predict the joint state by that delay, where time does not wait for answers (answer_timeout of dynamics is 0); efforts are zero until it is measured, and beyond the stability limit",
            )
            .read_only()
            .value();
        let config = live.get();
        (
            Self {
                tip_link,
                second_tip_link,
                config,
                sample_period,
                measurement_timeout,
                lockstep,
                delay_compensation,
                autostart: Lifecycle::declare_autostart(declare),
            },
            live,
        )
    }
}
