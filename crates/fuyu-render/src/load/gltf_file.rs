//! glTF 2.0, as text or binary.

use base64::{Engine, prelude::BASE64_STANDARD};
use gltf::{
    Accessor, Document, Gltf, Node, Primitive, buffer::Source, image::Source as ImageSource,
    mesh::Mode,
};
use nalgebra::{Matrix4, Point3, Vector3};

use super::{Resolve, texture, texture_file};
use crate::{Material, MeshData};

/// Deepest tree of nodes.
const DEEPEST: usize = 64;
/// Most nodes, each counted as often as others repeat it.
const MOST_NODES: usize = 100_000;

/// Reads the default scene of a glTF file.
pub(super) fn read(bytes: &[u8], resolve: &mut Resolve) -> Result<MeshData, String> {
    let Gltf { document, blob } =
        Gltf::from_slice(bytes).map_err(|e| format!("cannot be read as glTF: {e}"))?;
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let data = match buffer.source() {
            Source::Bin => blob.clone().ok_or("the binary buffer is missing")?,
            Source::Uri(uri) => from_uri(uri, resolve)?,
        };
        if data.len() < buffer.length() {
            return Err(format!(
                "buffer {} has {} bytes, but must have {}",
                buffer.index(),
                data.len(),
                buffer.length()
            ));
        }
        buffers.push(data);
    }
    let materials = materials(&document, &buffers, resolve)?;
    let mut reader = Reader {
        buffers,
        materials,
        whole: MeshData::default(),
        visited: 0,
    };
    let scene = document
        .default_scene()
        .or_else(|| document.scenes().next());
    match scene {
        Some(scene) => {
            for node in scene.nodes() {
                reader.node(&node, &Matrix4::identity(), 0)?;
            }
        }
        None => {
            for mesh in document.meshes() {
                for primitive in mesh.primitives() {
                    reader.primitive(&primitive, &Matrix4::identity())?;
                }
            }
        }
    }
    Ok(reader.whole)
}

/// The contents of `data:...;base64,...` or of a file.
fn from_uri(uri: &str, resolve: &mut Resolve) -> Result<Vec<u8>, String> {
    let Some(data) = uri.strip_prefix("data:") else {
        return resolve(&uri.replace("%20", " "));
    };
    let (_, text) = (data.split_once(";base64,")).ok_or("a data URI is not base64")?;
    (BASE64_STANDARD.decode(text)).map_err(|e| format!("a data URI is not base64: {e}"))
}

fn materials(
    document: &Document,
    buffers: &[Vec<u8>],
    resolve: &mut Resolve,
) -> Result<Vec<Material>, String> {
    let mut materials = Vec::new();
    for material in document.materials() {
        let pbr = material.pbr_metallic_roughness();
        let [r, g, b, _] = pbr.base_color_factor();
        let mut surface = Material::diffuse([r, g, b].map(|x| x.clamp(0.0, 1.0)));
        let roughness = pbr.roughness_factor().clamp(0.1, 1.0);
        // Blinn-Phong exponent of a microfacet distribution of this roughness (Walter et al. 2007, Karis 2013).
        surface.shininess = (2.0 / roughness.powi(4) - 2.0).clamp(1.0, 1000.0);
        surface.specular = 0.04 + 0.3 * pbr.metallic_factor().clamp(0.0, 1.0) * (1.0 - roughness);
        if let Some(info) = pbr.base_color_texture() {
            surface.texture = Some(match info.texture().source().source() {
                ImageSource::Uri { uri, .. } if uri.starts_with("data:") => {
                    texture(&from_uri(uri, resolve)?)?
                }
                ImageSource::Uri { uri, .. } => texture_file(uri, resolve)?,
                ImageSource::View { view, .. } => {
                    let end = view.offset().checked_add(view.length());
                    let buffer = buffers.get(view.buffer().index());
                    let bytes = end.and_then(|end| buffer?.get(view.offset()..end));
                    texture(bytes.ok_or("a texture lies outside of its buffer")?)?
                }
            });
        }
        materials.push(surface);
    }
    Ok(materials)
}

struct Reader {
    buffers: Vec<Vec<u8>>,
    materials: Vec<Material>,
    whole: MeshData,
    /// Number of nodes so far; one may be repeated by several others.
    visited: usize,
}

impl Reader {
    fn node(&mut self, node: &Node, parent: &Matrix4<f32>, depth: usize) -> Result<(), String> {
        if depth > DEEPEST {
            return Err(format!("nodes are nested more than {DEEPEST} deep"));
        }
        self.visited += 1;
        if self.visited > MOST_NODES {
            return Err(format!(
                "has more than {MOST_NODES} nodes, repeated ones included"
            ));
        }
        let transform = parent * Matrix4::from(node.transform().matrix());
        if let Some(mesh) = node.mesh() {
            for primitive in mesh.primitives() {
                self.primitive(&primitive, &transform)?;
            }
        }
        for child in node.children() {
            self.node(&child, &transform, depth + 1)?;
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &Primitive, X: &Matrix4<f32>) -> Result<(), String> {
        let mode = primitive.mode();
        if !matches!(
            mode,
            Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan
        ) {
            return Ok(());
        }
        let attributes = primitive.attributes().map(|(_, accessor)| accessor);
        for accessor in attributes.chain(primitive.indices()) {
            self.check(&accessor)?;
        }
        let buffers = &self.buffers;
        let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
        let positions = reader.read_positions().ok_or("a mesh has no positions")?;
        let moved = |p: [f32; 3]| X.transform_point(&Point3::from(p)).into();
        let positions: Vec<[f32; 3]> = positions.map(moved).collect();
        let linear = X.fixed_view::<3, 3>(0, 0).into_owned();
        // Normals transform with the inverse transpose.
        let of_normals = linear.try_inverse().map(|inverse| inverse.transpose());
        let normals: Vec<[f32; 3]> = match (reader.read_normals(), of_normals) {
            (Some(normals), Some(R)) => normals.map(|n| (R * Vector3::from(n)).into()).collect(),
            _ => Vec::new(),
        };
        let texture = (primitive.material().pbr_metallic_roughness()).base_color_texture();
        let set = texture.map_or(0, |texture| texture.tex_coord());
        let uvs: Vec<[f32; 2]> = match reader.read_tex_coords(set) {
            // The origin of glTF is the upper left corner.
            Some(uvs) => uvs.into_f32().map(|[u, v]| [u, 1.0 - v]).collect(),
            None => Vec::new(),
        };
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..positions.len() as u32).collect(),
        };
        let mut triangles: Vec<[u32; 3]> = match mode {
            Mode::TriangleStrip => (indices.windows(3).enumerate())
                .map(|(k, t)| match k % 2 {
                    0 => [t[0], t[1], t[2]],
                    _ => [t[1], t[0], t[2]],
                })
                .collect(),
            Mode::TriangleFan => super::fan(&indices).collect(),
            _ => indices.as_chunks().0.to_vec(),
        };
        if linear.determinant() < 0.0 {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let material = primitive
            .material()
            .index()
            .map(|i| self.materials[i].clone());
        self.whole.append(MeshData {
            positions,
            normals,
            uvs,
            triangles,
            materials: vec![material.unwrap_or_else(|| Material::grey(0.6))],
            triangle_materials: Vec::new(),
        });
        Ok(())
    }

    /// Whether the data of an accessor are in its buffer, which the reader does not check.
    fn check(&self, accessor: &Accessor) -> Result<(), String> {
        let index = accessor.index();
        if accessor.sparse().is_some() {
            return Err(format!("accessor {index} is sparse, which cannot be read"));
        }
        let Some(view) = accessor.view() else {
            return Err(format!("accessor {index} has no data"));
        };
        let size = accessor.size();
        let stride = view.stride().unwrap_or(size);
        if stride < size {
            return Err(format!(
                "accessor {index} has elements of {size} bytes every {stride} bytes"
            ));
        }
        let end = (accessor.count().checked_sub(1))
            .and_then(|last| last.checked_mul(stride))
            .and_then(|last| last.checked_add(accessor.offset()))
            .and_then(|last| last.checked_add(size))
            .filter(|end| *end <= view.length())
            .and_then(|_| view.offset().checked_add(view.length()));
        let length = self.buffers.get(view.buffer().index()).map_or(0, Vec::len);
        match end {
            Some(end) if end <= length => Ok(()),
            _ => Err(format!(
                "accessor {index} lies outside of its buffer, or is empty"
            )),
        }
    }
}
