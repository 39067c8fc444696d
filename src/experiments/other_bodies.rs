//! Bases and targets of other robots that the cameras of a robot observe.

use crate::{nodes::dynamics::World, spatial::Pose};

/// A body that a camera watches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Watched {
    /// A target of the robot's own world, by its index.
    Own(usize),
    /// A body of another robot, by its index in [`OtherBodies`].
    Other(usize),
}

/// Names and poses of bodies of other robots.
#[derive(Debug, Default)]
pub struct OtherBodies {
    names: Vec<String>,
    /// `None` until a pose is set.
    poses: Vec<Option<Pose>>,
}

impl OtherBodies {
    /// Finds the body called `name`; an absolute name refers to another robot's body.
    ///
    /// # Errors
    /// A line that lists the known targets, if the name is that of an unknown target of this robot.
    pub(super) fn find(&mut self, world: &World, name: &str) -> Result<Watched, String> {
        if !name.starts_with('/') {
            return world.target_index(name).map(Watched::Own);
        }
        let known = self.names.iter().position(|known| known == name);
        Ok(Watched::Other(known.unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.poses.push(None);
            self.names.len() - 1
        })))
    }

    /// Pose of a body in the world.
    ///
    /// # Errors
    /// If the pose of another robot's body was never set.
    pub(super) fn pose(&self, world: &World, body: Watched) -> Result<Pose, String> {
        match body {
            Watched::Own(index) => {
                let target = &world.targets[index].body;
                Ok(target.state().X_WB(target.workspace()))
            }
            Watched::Other(index) => self.poses[index].ok_or_else(|| {
                let name = &self.names[index];
                format!("the pose of '{name}' is not known: it is not of this robot's simulation")
            }),
        }
    }

    /// Names of the bodies.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Sets the pose in the world of the body with this index among [`Self::names`].
    ///
    /// # Panics
    /// If there is no such body.
    pub fn set_pose(&mut self, index: usize, X_WB: Pose) {
        self.poses[index] = Some(X_WB);
    }
}
