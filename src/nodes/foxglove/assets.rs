//! Mesh files for clients: only those that robot descriptions in the graph name.

use std::{
    collections::BTreeSet,
    sync::{Mutex, PoisonError},
};

use crate::{
    msg::{cdr, std_msgs},
    nodes::resource,
};

/// Largest mesh \[bytes\].
const LARGEST: u64 = 64 << 20;
/// Maximum number of mesh names that are stored.
const MOST: usize = 10_000;

/// Names of the meshes that clients may fetch.
#[derive(Default)]
pub struct Assets(Mutex<BTreeSet<String>>);

impl Assets {
    /// Adds the meshes of a robot description (std_msgs/String in CDR).
    pub fn add(&self, description: &[u8]) {
        let Ok(std_msgs::String { data }) = cdr::decode(description) else {
            return;
        };
        // Users of an invalid description report it.
        let Ok(document) = roxmltree::Document::parse(&data) else {
            return;
        };
        let meshes = document.descendants().filter(|n| n.has_tag_name("mesh"));
        let names = meshes.filter_map(|mesh| mesh.attribute("filename"));
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for name in names {
            if known.len() < MOST {
                known.insert(name.to_owned());
            }
        }
    }

    /// The content of a mesh.
    ///
    /// # Errors
    /// A line that says why it cannot be fetched.
    pub fn fetch(&self, name: &str) -> Result<Vec<u8>, String> {
        let known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !known.contains(name) {
            return Err(format!("{name}: no robot description names this mesh"));
        }
        drop(known);
        let name = name.strip_prefix("file://").unwrap_or(name);
        resource::resolve(name)?.bytes(LARGEST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_meshes_that_a_description_names_can_be_fetched() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = folder.path().join("a.stl");
        std::fs::write(&mesh, "solid").unwrap();
        let mesh = mesh.display();
        let assets = Assets::default();
        assert!(
            assets
                .fetch(&mesh.to_string())
                .unwrap_err()
                .contains("no robot description")
        );
        let urdf = format!(
            "<robot><link><visual><geometry><mesh filename='{mesh}'/></geometry></visual></link></robot>"
        );
        assets.add(&cdr::encode(&std_msgs::String { data: urdf }));
        assert_eq!(assets.fetch(&mesh.to_string()).unwrap(), b"solid");
        assert!(assets.fetch(&format!("{mesh}/../b")).is_err());
        assets.add(b"\0\x01\0\0garbage");
    }
}
