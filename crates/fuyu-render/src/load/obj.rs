//! Wavefront OBJ.

use std::{cell::RefCell, io::Cursor};

use super::{Resolve, texture_file};
use crate::{Material, MeshData};

/// Reads an OBJ file with its material libraries.
pub(super) fn read(bytes: &[u8], resolve: &mut Resolve) -> Result<MeshData, String> {
    let options = tobj::LoadOptions {
        triangulate: true,
        single_index: true,
        ignore_points: true,
        ignore_lines: true,
    };
    let resolve = RefCell::new(resolve);
    let missing = RefCell::new(None);
    let library = |path: &std::path::Path| {
        let name = path.to_string_lossy();
        let bytes = (*resolve.borrow_mut())(&name);
        match bytes {
            Ok(bytes) => tobj::load_mtl_buf(&mut Cursor::new(bytes)),
            Err(problem) => {
                *missing.borrow_mut() = Some(format!("material library {problem}"));
                Err(tobj::LoadError::OpenFileFailed)
            }
        }
    };
    let (models, materials) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, library)
        .map_err(|e| format!("cannot be read as OBJ: {e}"))?;
    if let Some(problem) = missing.into_inner() {
        return Err(problem);
    }
    let materials = materials.map_err(|e| format!("materials cannot be read: {e}"))?;
    let mut resolve = resolve.borrow_mut();
    let surfaces: Vec<Material> = (materials.iter())
        .map(|material| surface(material, *resolve))
        .collect::<Result<_, _>>()?;
    let mut whole = MeshData::default();
    for tobj::Model { mesh, .. } in models {
        let material = mesh.material_id.and_then(|i| surfaces.get(i)).cloned();
        whole.append(MeshData {
            positions: mesh.positions.as_chunks().0.to_vec(),
            normals: mesh.normals.as_chunks().0.to_vec(),
            uvs: mesh.texcoords.as_chunks().0.to_vec(),
            triangles: mesh.indices.as_chunks().0.to_vec(),
            materials: vec![material.unwrap_or_else(|| Material::grey(0.6))],
            triangle_materials: Vec::new(),
        });
    }
    Ok(whole)
}

fn surface(material: &tobj::Material, resolve: &mut Resolve) -> Result<Material, String> {
    let grey = if material.diffuse_texture.is_some() {
        1.0
    } else {
        0.6
    };
    let mut surface = Material::from_srgb_colour(material.diffuse.unwrap_or([grey; 3]));
    if let Some(specular) = material.specular {
        surface.specular = (specular.iter().sum::<f32>() / 3.0).clamp(0.0, 1.0) * 0.2;
    }
    if let Some(shininess) = material.shininess {
        surface.shininess = shininess.clamp(1.0, 1000.0);
    }
    if let Some(file) = &material.diffuse_texture {
        surface.texture = Some(texture_file(file, resolve)?);
    }
    Ok(surface)
}
