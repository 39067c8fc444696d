//! Bodies of other robots that the cameras of a robot watch.

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
    poses: Vec<Pose>,
}

impl OtherBodies {
    /// The body called `name`: absolute if it is another robot's.
    ///
    /// # Errors
    /// A line that lists the targets there are, if it is an own target that is not there.
    pub(super) fn find(&mut self, world: &World, name: &str) -> Result<Watched, String> {
        if !name.starts_with('/') {
            return world.target_index(name).map(Watched::Own);
        }
        let known = self.names.iter().position(|known| known == name);
        Ok(Watched::Other(known.unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.poses.push(Pose::identity());
            self.names.len() - 1
        })))
    }

    /// Pose of a body in the world.
    pub(super) fn pose(&self, world: &World, body: Watched) -> Pose {
        match body {
            Watched::Own(index) => {
                let target = &world.targets[index].body;
                target.state().X_WB(target.workspace())
            }
            Watched::Other(index) => self.poses[index],
        }
    }

    /// Names of the bodies.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Sets the poses in the world, in the order of [`Self::names`].
    ///
    /// # Panics
    /// If there are fewer or more.
    pub fn set_poses(&mut self, poses: &[Pose]) {
        self.poses.copy_from_slice(poses);
    }
}
