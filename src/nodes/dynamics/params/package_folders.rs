//! The parameter `package_folders`.

use std::path::PathBuf;

use crate::{nodes::resource::Lookup, ros::Declare};

/// Folders with ROS packages, searched before those given by the environment.
pub(super) struct PackageFolders(pub(super) Vec<PathBuf>);

impl PackageFolders {
    /// Declares the parameter and reads it.
    pub(super) fn declare(declare: &mut Declare) -> Self {
        let folders = declare
            .param(
                "package_folders",
                Vec::<String>::new(),
                "Folders with ROS packages, searched for package://PACKAGE/PATH before those of the environment",
            )
            .read_only()
            .value();
        Self(folders.iter().map(PathBuf::from).collect())
    }

    /// Search of files relative to the file of the parameter `name`.
    pub(super) fn lookup(&self, declare: &Declare, name: &str) -> Lookup {
        Lookup {
            folder: declare.folder_of(name),
            packages: self.0.clone(),
        }
    }
}
