//! Mesh files.

use nalgebra::Vector3;

use super::resource::Resource;

/// Largest STL file \[bytes\].
const LARGEST_MESH: u64 = 256 << 20;

/// The vertices of an STL file, without duplicates.
///
/// # Errors
/// A line that names the file and says why it cannot be read.
pub fn vertices(found: &Resource) -> Result<Vec<Vector3<f64>>, String> {
    let path = found.path();
    let mut file = std::io::Cursor::new(found.bytes(LARGEST_MESH)?);
    let mesh = stl_io::read_stl(&mut file)
        .map_err(|e| format!("{}: cannot be read as STL: {e}", path.display()))?;
    let vertices = mesh.vertices.iter();
    let vertices: Vec<_> = vertices
        .map(|v| Vector3::from(v.0.map(f64::from)))
        .collect();
    if vertices.is_empty() || vertices.iter().any(|v| !v.iter().all(|x| x.is_finite())) {
        return Err(format!(
            "{}: has no vertices, or one that is not finite",
            path.display()
        ));
    }
    Ok(vertices)
}
