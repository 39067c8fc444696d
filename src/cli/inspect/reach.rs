//! `--reach`: search for a motion of the free-floating robot to a goal in the world.

use std::fmt::Write;

use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;

use super::PoseReport;
use crate::cli::Numbers;
use crate::cli::table::{number, shown};
use crate::control::{ReachGoal, free_floating_reach};
use crate::dynamics::State;
use crate::model::{Frame, Model};

/// The goal, given as `X,Y,Z` or `X,Y,Z,R,P,Y`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Goal(ReachGoal);

impl std::str::FromStr for Goal {
    type Err = String;

    fn from_str(list: &str) -> Result<Self, String> {
        let Numbers(values) = list.parse()?;
        let (position, attitude) = match values[..] {
            [x, y, z] => (Vector3::new(x, y, z), None),
            [x, y, z, roll, pitch, yaw] => {
                let attitude = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
                (Vector3::new(x, y, z), Some(attitude))
            }
            _ => {
                let given = values.len();
                return Err(format!(
                    "has {given} values; give X,Y,Z, or X,Y,Z and roll, pitch, yaw"
                ));
            }
        };
        Ok(Self(ReachGoal { position, attitude }))
    }
}

/// Whether a goal is reachable.
#[derive(Serialize)]
pub(super) struct ReachReport {
    reachable: bool,
    /// Why no motion was found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) problem: Option<String>,
    /// Joint positions at the end of the motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    q: Option<Vec<f64>>,
    /// Pose of the base in the world at the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    base_pose: Option<PoseReport>,
    /// Pose of the tip in the world at the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    tip_pose: Option<PoseReport>,
    /// Joint positions along the motion.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    path: Vec<Vec<f64>>,
}

impl ReachReport {
    pub(super) fn new(model: &Model, tip: &Frame, start: &State, Goal(goal): &Goal) -> Self {
        let values = |q: &nalgebra::DVector<f64>| q.as_slice().to_vec();
        match free_floating_reach(model, tip, start, goal) {
            Ok(reached) => Self {
                reachable: true,
                problem: None,
                q: Some(values(reached.q())),
                base_pose: Some(PoseReport::from(&reached.X_WB)),
                tip_pose: Some(PoseReport::from(&reached.X_WE)),
                path: reached.path.iter().map(values).collect(),
            },
            Err(problem) => Self {
                reachable: false,
                problem: Some(problem.to_string()),
                q: None,
                base_pose: None,
                tip_pose: None,
                path: Vec::new(),
            },
        }
    }

    pub(super) fn for_people(&self, out: &mut String, model: &Model) {
        let (Some(q), Some(base)) = (&self.q, &self.base_pose) else {
            out.push_str("goal            no motion found\n");
            return;
        };
        let joints = model.joints().iter().zip(q);
        let joints: Vec<_> = joints
            .map(|(joint, q)| format!("{}={}", shown(&joint.name), number(*q)))
            .collect();
        let list = |values: &[f64]| {
            values
                .iter()
                .map(|x| number(*x))
                .collect::<Vec<_>>()
                .join(", ")
        };
        let _ = writeln!(out, "goal            reached with {}", joints.join(","));
        let _ = writeln!(
            out,
            "base then       {} m in the world, orientation {} (x, y, z, w)",
            list(base.position.as_slice()),
            list(&base.orientation)
        );
    }
}
