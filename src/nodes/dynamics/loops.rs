//! Parameters of loop closures, which URDF cannot describe, since it describes trees only.

use nalgebra::{Rotation3, Translation3};

use crate::{
    dynamics::{Direction, LoopClosure, LoopError, Loops},
    model::{Frame, Model},
    nodes::{choice, named_lists::declare_each, placement::declare_vector},
    ros::Declare,
    spatial::Pose,
};

/// Parameters of a loop closure.
#[derive(Debug, Clone)]
pub struct LoopParams {
    /// Name.
    pub name: String,
    /// First end; the constrained directions are along its axes.
    pub frame_a: EndParams,
    /// Second end.
    pub frame_b: EndParams,
    /// Constrained directions.
    pub constrained: Vec<Direction>,
}

/// One end of a loop closure.
#[derive(Debug, Clone)]
pub struct EndParams {
    /// Link that it is fixed to.
    pub link: String,
    /// Pose of the end in the link's frame.
    pub X_LE: Pose,
}

impl LoopParams {
    /// Declares `loop_closures` and the parameters of each closure, and reads them.
    ///
    /// # Errors
    /// A line that names a missing required parameter, or a closure that is declared twice.
    pub fn declare(declare: &mut Declare) -> Result<Vec<Self>, String> {
        let description = "Names of the closures that close loops in the robot's tree";
        let closures = declare_each(declare, "loop_closures", description, Self::declare_one)?;
        closures.into_iter().collect()
    }

    fn declare_one(declare: &mut Declare, name: String) -> Result<Self, String> {
        let frame_a = EndParams::declare(declare, &format!("{name}.frame_a"), "first");
        let frame_b = EndParams::declare(declare, &format!("{name}.frame_b"), "second");
        let all = Direction::NAMES.map(|(name, _)| name).join(", ");
        let constrained = declare
            .param(
                &format!("{name}.constrained"),
                Vec::<String>::new(),
                &format!("Directions in which the second end is fixed to the first, in the first's axes: {all}"),
            )
            .read_only()
            .check(&format!("each one of {all}, at most once"), |texts| {
                for (i, text) in texts.iter().enumerate() {
                    choice::find(&Direction::NAMES, text)?;
                    if texts[..i].contains(text) {
                        return Err(format!("'{text}' is given twice"));
                    }
                }
                Ok(())
            })
            .value();
        let constrained = constrained
            .iter()
            .filter_map(|text| choice::find(&Direction::NAMES, text).ok())
            .collect();
        Ok(Self {
            name,
            frame_a: frame_a?,
            frame_b: frame_b?,
            constrained,
        })
    }

    /// The closures of `model` that `params` describe.
    ///
    /// # Errors
    /// [`LoopError`], which names the closure.
    pub fn loops(params: &[Self], model: &Model) -> Result<Loops, LoopError> {
        let closures = params.iter().map(|params| {
            let (a, b) = (&params.frame_a, &params.frame_b);
            let directions = &params.constrained;
            let mut closure =
                LoopClosure::between(model, &params.name, &a.link, &b.link, directions)?;
            a.shift(&mut closure.frame_a);
            b.shift(&mut closure.frame_b);
            Ok(closure)
        });
        Loops::new(model, closures.collect::<Result<_, _>>()?)
    }
}

impl EndParams {
    fn declare(declare: &mut Declare, key: &str, which: &str) -> Result<Self, String> {
        let link = declare
            .param(key, "", &format!("Link that the {which} end is fixed to"))
            .read_only()
            .value();
        let position = format!("Position of the {which} end in its link's frame [m]");
        let xyz = declare_vector(declare, &format!("{key}_xyz"), &position);
        let attitude = format!(
            "Attitude of the {which} end in its link's frame: roll, pitch, yaw about fixed axes, as in URDF [rad]"
        );
        let rpy = declare_vector(declare, &format!("{key}_rpy"), &attitude);
        if link.is_empty() {
            return Err(format!(
                "parameter {key} is not given; it must name the link that the {which} end of the closure is fixed to"
            ));
        }
        let rotation = Rotation3::from_euler_angles(rpy.x, rpy.y, rpy.z);
        Ok(Self {
            link,
            X_LE: Pose::from_parts(Translation3::from(xyz), rotation),
        })
    }

    /// Moves a link's frame to the end of the closure.
    fn shift(&self, frame: &mut Frame) {
        frame.X_BF *= self.X_LE;
    }
}
