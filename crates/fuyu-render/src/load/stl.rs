//! STL.

use crate::MeshData;

/// Reads an STL file, binary or text. It has no materials.
pub(super) fn read(bytes: &[u8]) -> Result<MeshData, String> {
    let mesh = stl_io::read_stl(&mut std::io::Cursor::new(bytes));
    let mesh = mesh.map_err(|e| format!("cannot be read as STL: {e}"))?;
    let faces = mesh.faces.iter();
    Ok(MeshData {
        positions: mesh.vertices.iter().map(|v| v.0).collect(),
        triangles: faces.map(|f| f.vertices.map(|i| i as u32)).collect(),
        ..MeshData::default()
    })
}
