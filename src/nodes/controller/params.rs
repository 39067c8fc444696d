//! Parameters of the controller node.

use std::sync::{
    Arc,
    atomic::{AtomicUsize, Ordering},
};

use crate::{
    control::{ControllerConfig, Gains, JacobianKind, LawKind, Saturation},
    nodes::choice,
    ros::{Declare, Param, ParameterValue, params::Parameter},
};

/// What the controller node is told at its start.
#[derive(Debug, Clone)]
pub struct ControllerParams {
    /// Link whose frame is the tip.
    pub tip_link: String,
    /// Law and gains.
    pub config: ControllerConfig,
    /// Age of the camera's measurement beyond which the joints are only damped \[s\].
    pub measurement_timeout: f64,
    /// Whether every joint state waits for the camera frame of the same time.
    pub lockstep: bool,
}

/// Law and gains, which may change while the node runs.
pub(super) struct Live {
    law: Param<String>,
    jacobian: Param<String>,
    k_p: Param<f64>,
    k_o: Param<f64>,
    k_v: Param<Vec<f64>>,
    e_p_max: Param<f64>,
    e_o_max: Param<f64>,
    joint_k_p: Param<Vec<f64>>,
    /// The robot's number of joints, which gains must fit; zero while it is not known.
    joints: Arc<AtomicUsize>,
}

const SMALLEST_GAIN: f64 = 1e-9;
const LARGEST_GAIN: f64 = 1e9;

impl Live {
    fn declare(declare: &mut Declare) -> Self {
        let law = choice::declare(declare, "law", &LawKind::NAMES, "Control law").live();
        let jacobian = choice::declare(
            declare,
            "jacobian",
            &JacobianKind::NAMES,
            "Jacobian of the law",
        )
        .live();
        let mut positive = |name: &str, default: f64, text: &str| {
            declare
                .param(name, default, text)
                .range(SMALLEST_GAIN, LARGEST_GAIN)
                .live()
        };
        let k_p = positive("k_p", 75.0, "Gain on the position error [N/m]");
        let k_o = positive("k_o", 100.0, "Gain on the orientation error [N m]");
        let e_p_max = positive(
            "e_p_max",
            0.2,
            "Position error beyond which the pull is constant [m]",
        );
        let e_o_max = positive(
            "e_o_max",
            0.1,
            "Orientation error beyond which the pull is constant",
        );
        let mut per_joint = |name: &str, text: &str| {
            let values = declare.param(name, Vec::<f64>::new(), text);
            values.range(SMALLEST_GAIN, LARGEST_GAIN).live()
        };
        let k_v = per_joint(
            "k_v",
            "Gains on the joint rates, one per joint [N m s/rad or N s/m]",
        );
        let joint_k_p = per_joint(
            "joint_k_p",
            "Gains on the joint positions for joint_pd, one per joint [N m/rad or N/m]",
        );
        let joints = Arc::new(AtomicUsize::new(0));
        let known = Arc::clone(&joints);
        declare.check_together(move |get| fit_the_robot(&known, get));
        Self {
            law,
            jacobian,
            k_p,
            k_o,
            k_v,
            e_p_max,
            e_o_max,
            joint_k_p,
            joints,
        }
    }

    /// From here on gains that do not fit a robot with so many joints are refused.
    pub(super) fn fit(&self, joints: usize) {
        self.joints.store(joints, Ordering::Relaxed);
    }

    pub(super) fn get(&self) -> ControllerConfig {
        ControllerConfig {
            // Any other text has been refused by the declaration.
            law: choice::find(&LawKind::NAMES, &self.law.get())
                .unwrap_or(LawKind::TransposeJacobian),
            jacobian: choice::find(&JacobianKind::NAMES, &self.jacobian.get())
                .unwrap_or(JacobianKind::Generalized),
            gains: Gains {
                k_p: self.k_p.get(),
                k_o: self.k_o.get(),
                k_v: self.k_v.get(),
                saturation: Saturation {
                    position: self.e_p_max.get(),
                    orientation: self.e_o_max.get(),
                },
            },
            joint_k_p: self.joint_k_p.get(),
        }
    }

    pub(super) fn changed(&self) -> bool {
        let numbers = [&self.k_p, &self.k_o, &self.e_p_max, &self.e_o_max];
        let texts = [&self.law, &self.jacobian];
        let lists = [&self.k_v, &self.joint_k_p];
        // Every handle must be asked, or it will report its change later.
        let changed = numbers.iter().filter(|p| p.changed()).count()
            + texts.iter().filter(|p| p.changed()).count()
            + lists.iter().filter(|p| p.changed()).count();
        changed > 0
    }
}

/// Refuses gains whose number is not that of the joints, where they are needed.
fn fit_the_robot(joints: &AtomicUsize, get: &dyn Fn(&str) -> ParameterValue) -> Result<(), String> {
    let joints = joints.load(Ordering::Relaxed);
    if joints == 0 {
        return Ok(());
    }
    let length = |name: &str| Vec::<f64>::from_value(&get(name)).map_or(0, |v| v.len());
    let joint_pd = String::from_value(&get("law")).is_some_and(|law| law == "joint_pd");
    let needed = if joint_pd {
        &["k_v", "joint_k_p"][..]
    } else {
        &["k_v"]
    };
    for name in needed {
        let got = length(name);
        if got != joints {
            return Err(format!(
                "{name} has {got} values; the robot has {joints} joints, so give {joints}"
            ));
        }
    }
    Ok(())
}

impl ControllerParams {
    /// Declares the parameters and reads them. `finish` of `declare` is the caller's.
    pub fn declare(declare: &mut Declare) -> Self {
        Self::declare_live(declare).0
    }

    pub(super) fn declare_live(declare: &mut Declare) -> (Self, Live) {
        let tip_link = declare
            .param("tip_link", "tool0", "Link whose frame is the tip")
            .read_only()
            .value();
        let live = Live::declare(declare);
        let measurement_timeout = declare
            .param(
                "measurement_timeout",
                1.0,
                "Age of the camera's measurement beyond which the joints are only damped [s]",
            )
            .range(1e-3, 1e6)
            .read_only()
            .value();
        let lockstep = declare
            .param(
                "lockstep",
                false,
                "Answer a joint state only once its camera frame has come",
            )
            .read_only()
            .value();
        let config = live.get();
        (
            Self {
                tip_link,
                config,
                measurement_timeout,
                lockstep,
            },
            live,
        )
    }
}
