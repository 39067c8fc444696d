//! Meshes of a robot description.

use std::{collections::HashMap, sync::Arc};

use fuyu_render::{Material, Mesh, load, urdf};
use nalgebra::{Isometry3, Vector3};

use crate::nodes::resource;

/// Largest file size of a mesh or texture \[bytes\].
const LARGEST_FILE: u64 = 256 << 20;

/// Meshes of a robot or target.
#[derive(Debug, Clone, Default)]
pub struct Shape {
    /// Its meshes.
    pub parts: Vec<Part>,
    /// Warnings on the meshes, one line each.
    pub notes: Vec<String>,
    /// Meshes that cannot be drawn, with the reason, one line each.
    pub problems: Vec<String>,
}

/// A mesh on a link.
#[derive(Debug, Clone)]
pub struct Part {
    /// Name of the link.
    pub link: String,
    /// Pose of the mesh in the link's frame.
    pub origin: Isometry3<f64>,
    /// The mesh.
    pub mesh: Arc<Mesh>,
}

impl Shape {
    /// The meshes of the visual elements of a robot description. `source` names the description in messages.
    pub fn of_urdf(xml: &str, source: &str) -> Self {
        let mut shape = Self::default();
        let visuals = match urdf::visuals(xml) {
            Ok(visuals) => visuals,
            Err(problem) => {
                shape.problems.push(format!("{source}: {problem}"));
                return shape;
            }
        };
        let mut known: HashMap<String, Arc<Mesh>> = HashMap::new();
        for visual in visuals {
            match shape.mesh(&visual, &mut known) {
                Ok(mesh) => shape.parts.push(Part {
                    link: visual.link,
                    origin: visual.origin,
                    mesh,
                }),
                Err(problem) => {
                    let link = &visual.link;
                    (shape.problems).push(format!("{source}: visual of link '{link}': {problem}"));
                }
            }
        }
        shape
    }

    fn mesh(
        &mut self,
        visual: &urdf::Visual,
        known: &mut HashMap<String, Arc<Mesh>>,
    ) -> Result<Arc<Mesh>, String> {
        let mut material = visual.material();
        if let Some(file) = &visual.texture {
            let texture = load::texture(&read(file)?);
            material = Material {
                texture: Some(texture.map_err(|e| format!("{file}: {e}"))?),
                // Without a colour, a texture is shown unchanged.
                diffuse: visual.colour.unwrap_or([1.0; 3]),
                ..material
            };
        }
        let urdf::Geometry::Mesh { file, scale } = &visual.geometry else {
            let mesh = visual.primitive(material);
            return mesh.map(Arc::new).ok_or_else(|| "has no shape".to_owned());
        };
        let is_painted = visual.colour.is_some() || visual.texture.is_some();
        let key = format!("{file} {scale:?} {:?} {:?}", visual.colour, visual.texture);
        if let Some(mesh) = known.get(&key) {
            return Ok(mesh.clone());
        }
        let at = |e: String| format!("{file}: {e}");
        let folder = file.rsplit_once('/').map_or("", |(folder, _)| folder);
        let mut beside = |name: &str| match folder.is_empty() || name.starts_with('/') {
            true => read(name),
            false => read(&below(folder, name)),
        };
        let mut data = load::load(file, &read(file)?, &mut beside).map_err(at)?;
        if is_painted {
            data.materials = vec![material; data.materials.len().max(1)];
        }
        let scale = match scale.iter().all(|s| *s != 0.0) {
            true => *scale,
            false => Vector3::repeat(1.0),
        };
        data.transform(&scale, &Isometry3::identity());
        let mesh = Arc::new(Mesh::new(data).map_err(|e| at(e.to_string()))?);
        if !mesh.is_closed() {
            let note =
                format!("{file}: the mesh is not closed; both sides of its triangles are drawn");
            self.notes.push(note);
        }
        known.insert(key, mesh.clone());
        Ok(mesh)
    }
}

fn read(name: &str) -> Result<Vec<u8>, String> {
    let name = name.strip_prefix("file://").unwrap_or(name);
    resource::resolve(name)?.bytes(LARGEST_FILE)
}

/// The path of `name` relative to `folder`, without `..`, which is not allowed in names of package files.
fn below(folder: &str, name: &str) -> String {
    let mut parts: Vec<&str> = folder.split('/').collect();
    for part in name.split('/') {
        match part {
            "" | "." => {}
            ".." if parts.last().is_some_and(|last| !matches!(*last, "" | "..")) => {
                parts.pop();
            }
            part => parts.push(part),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(visual: &str) -> Shape {
        let xml =
            format!("<robot name=\"r\"><link name=\"a\"><visual>{visual}</visual></link></robot>");
        Shape::of_urdf(&xml, "test.urdf")
    }

    #[test]
    fn the_robots_that_come_with_fuyu_can_be_drawn() {
        for (path, bytes) in resource::embedded_files() {
            if path.ends_with(".urdf") {
                let shape = Shape::of_urdf(&String::from_utf8_lossy(bytes), &path);
                assert_eq!(shape.problems, Vec::<String>::new());
            }
        }
    }

    #[test]
    fn meshes_that_cannot_be_drawn_are_reported_in_one_line() {
        let missing =
            shape("<geometry><mesh filename=\"package://fuyu/urdf/none.stl\"/></geometry>");
        let [problem] = &missing.problems[..] else {
            panic!("{missing:?}");
        };
        assert!(problem.contains("test.urdf: visual of link 'a'") && problem.contains("none.stl"));
        assert!(!problem.contains('\n') && missing.parts.is_empty());
    }

    #[test]
    fn an_open_mesh_is_drawn_and_noted() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("open.obj");
        std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        let name = path.display();
        let shape = shape(&format!(
            "<geometry><mesh filename=\"file://{name}\" scale=\"2 2 2\"/></geometry>
             <material name=\"m\"><color rgba=\"1 0 0 1\"/></material>"
        ));
        assert_eq!(shape.parts.len(), 1, "{shape:?}");
        assert_eq!(
            shape.parts[0].mesh.data().materials[0].diffuse,
            [1.0, 0.0, 0.0]
        );
        assert_eq!(shape.parts[0].mesh.data().positions[1], [2.0, 0.0, 0.0]);
        assert!(shape.notes[0].contains("not closed"));
    }

    // Fails if textures next to the folder of meshes, as most packages have them, are refused as names with `..`.
    #[test]
    fn files_next_to_the_folder_have_plain_names() {
        let folder = "package://robot/meshes/arm";
        assert_eq!(below(folder, "a.png"), "package://robot/meshes/arm/a.png");
        let texture = below(folder, "../../textures/./a.png");
        assert_eq!(texture, "package://robot/textures/a.png");
        assert_eq!(below("meshes", "../../a.png"), "../a.png");
        // A path that leaves the package keeps its `..`, and is refused.
        assert!(below("package://robot/meshes", "../../../a.png").contains(".."));
    }
}
