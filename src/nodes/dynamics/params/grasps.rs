//! Parameters of grasps: the frames of robot and target that latch, and the conditions.

use nalgebra::{Isometry3, Vector3};

use super::numbers::{not_negative, scheduled_time};
use crate::{
    dynamics::capture::{JointReaction, Latch, ReleaseSpring},
    nodes::{
        choice,
        named_lists::declare_each,
        placement::{declare_orientation, declare_vector, finite},
    },
    ros::Declare,
};

/// Parameters of a grasp.
#[derive(Debug, Clone)]
pub struct GraspParams {
    /// Its name.
    pub name: String,
    /// Link of the robot whose frame is the grasping frame.
    pub frame: String,
    /// The target that is grasped.
    pub target: String,
    /// Pose of the grasp frame in the frame of the target's root link.
    pub X_TG: Isometry3<f64>,
    /// The degrees of freedom that the grasp holds.
    pub latch: Latch,
    /// Behaviour of the robot's joints during the impulse.
    pub joints: JointReaction,
    /// Time at which it latches \[s\]; `None` if it latches on command only.
    pub at: Option<f64>,
    /// Whether it latches automatically when the frames are close enough.
    pub automatic: bool,
    /// Largest distance between the frames at which it latches \[m\].
    pub distance: f64,
    /// Largest angle between the frames at which a weld latches \[rad\].
    pub angle: f64,
    /// Time at which it opens \[s\]; `None` if it opens on command only.
    pub release_at: Option<f64>,
    /// Spring that pushes robot and target apart when the grasp opens.
    pub spring: Option<ReleaseSpring>,
}

/// Declares `grasps` and the parameters of each, and reads them.
///
/// # Errors
/// A line that names a parameter, its value, and the allowed values.
pub(super) fn declare_grasps(declare: &mut Declare) -> Result<Vec<GraspParams>, String> {
    let description = "Names of the grasps by which the robot can hold targets";
    let all = declare_each(declare, "grasps", description, GraspParams::declare)?;
    all.into_iter().collect()
}

impl GraspParams {
    fn declare(declare: &mut Declare, name: String) -> Result<Self, String> {
        let key = |parameter: &str| format!("{name}.{parameter}");
        let frame = declare
            .required(&key("frame"), "Link of the robot whose frame grasps")
            .read_only()
            .value();
        let target = declare
            .required(&key("target"), "Target that is grasped, one of targets")
            .read_only()
            .value();
        let position = declare_vector(
            declare,
            &key("target_position"),
            "Position of the grasp frame in the target's root link [m]",
        );
        let rotation = declare_orientation(
            declare,
            &key("target_orientation"),
            "Attitude of the grasp frame in the target's root link (x, y, z, w)",
        );
        let latch = choice::declare(declare, &key("kind"), &Latch::NAMES, "What the grasp holds")
            .read_only()
            .value();
        let joints = choice::declare(
            declare,
            &key("joints"),
            &JointReaction::NAMES,
            "What the robot's joints do when the grasp latches; locked joints stay locked while it holds",
        )
        .read_only()
        .value();
        let at = scheduled_time(declare, &key("at"), "Time at which the grasp latches");
        let automatic = declare
            .param(
                &key("automatic"),
                false,
                "Latch at the first state in which the frames are within distance and angle",
            )
            .read_only()
            .value();
        let distance = not_negative(
            declare,
            &key("distance"),
            0.01,
            "Largest distance of the two frames at which the grasp latches [m]",
        );
        let angle = not_negative(
            declare,
            &key("angle"),
            0.05,
            "Largest angle between the two frames at which a weld latches [rad]",
        );
        let release_at =
            scheduled_time(declare, &key("release_at"), "Time at which the grasp opens");
        let energy = not_negative(
            declare,
            &key("release_energy"),
            0.0,
            "Energy of the spring that pushes robot and target apart when the grasp opens [J]",
        );
        let direction = declare
            .param(
                &key("release_direction"),
                [1.0, 0.0, 0.0],
                "Direction in which the spring pushes the target, in the robot's grasp frame",
            )
            .read_only()
            .check("3 finite numbers, not all zero", |v| {
                finite(v, 3)?;
                match v.iter().any(|x| x.abs() > 1e-9) {
                    true => Ok(()),
                    false => Err(format!("{v:?} has no direction")),
                }
            })
            .value();
        let spring = match direction.as_slice() {
            &[x, y, z] if energy > 0.0 => Some(ReleaseSpring {
                direction: Vector3::new(x, y, z),
                energy,
            }),
            _ => None,
        };
        Ok(Self {
            frame,
            target,
            X_TG: Isometry3::from_parts(position.into(), rotation?),
            // Any other text has been refused by the declaration.
            latch: choice::find(&Latch::NAMES, &latch).unwrap_or_default(),
            joints: choice::find(&JointReaction::NAMES, &joints).unwrap_or_default(),
            at,
            automatic,
            distance,
            angle,
            release_at,
            spring,
            name,
        })
    }
}
