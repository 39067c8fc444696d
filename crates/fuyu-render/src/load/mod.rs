//! Reads meshes: STL, OBJ, COLLADA, glTF. Files that a mesh refers to (materials, buffers, textures) are requested from the
//! caller by name.

mod collada;
mod gltf_file;
mod obj;
mod stl;

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
};

use image::io::{Limits, Reader};

use crate::{MeshData, Texture};

/// Gives the contents of a file that a mesh refers to by a relative name.
///
/// Its error is a line that says why the file cannot be read.
pub type Resolve<'a> = dyn FnMut(&str) -> Result<Vec<u8>, String> + 'a;

/// Reads a mesh from the contents `bytes` of a file; the ending of `name` says which format: `stl`, `obj`, `dae`, `gltf` or
/// `glb`. Lengths are in metres. Axes are those of the file: `up_axis` of COLLADA files is ignored, as in RViz, and
/// glTF files are not turned.
///
/// # Errors
/// A line, without the name, that says why the file cannot be used. Textures that cannot be read are an error, too.
pub fn load(name: &str, bytes: &[u8], resolve: &mut Resolve) -> Result<MeshData, String> {
    let ending = name.rsplit('.').next().unwrap_or_default().to_lowercase();
    // The readers of some formats panic on invalid files.
    let read = AssertUnwindSafe(|| match ending.as_str() {
        "stl" => stl::read(bytes),
        "obj" => obj::read(bytes, resolve),
        "dae" => collada::read(bytes, resolve),
        "gltf" | "glb" => gltf_file::read(bytes, resolve),
        _ => {
            Err("is no mesh that can be read: expected .stl, .obj, .dae, .gltf or .glb".to_owned())
        }
    });
    catch_unwind(read).unwrap_or_else(|_| Err("cannot be read: the file is malformed".to_owned()))
}

/// Most columns or rows of a texture.
const LARGEST_TEXTURE: u32 = 8192;

/// Decodes a texture, PNG or JPEG.
///
/// # Errors
/// A line that says why it cannot be used.
pub fn texture(bytes: &[u8]) -> Result<Arc<Texture>, String> {
    let mut reader = Reader::new(std::io::Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| e.to_string())?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST_TEXTURE);
    limits.max_image_height = Some(LARGEST_TEXTURE);
    reader.limits(limits);
    let decoded = reader.decode();
    let decoded = decoded.map_err(|e| format!("cannot be read as PNG or JPEG: {e}"))?;
    let image = decoded.to_rgb8();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let texels = image.pixels().map(|p| p.0).collect();
    let texture = Texture::new(width, height, texels).map_err(|e| e.to_string())?;
    Ok(Arc::new(texture))
}

/// The texture in the file called `name`.
fn texture_file(name: &str, resolve: &mut Resolve) -> Result<Arc<Texture>, String> {
    let name = name.strip_prefix("file://").unwrap_or(name);
    let name = name.replace("%20", " ").replace('\\', "/");
    let bytes = resolve(&name)?;
    texture(&bytes).map_err(|e| format!("texture {name}: {e}"))
}

/// Triangles of a polygon, given the indices of its corners.
fn fan(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    (2..corners.len()).map(|i| [corners[0], corners[i - 1], corners[i]])
}
