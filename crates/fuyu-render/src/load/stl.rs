//! STL.

use std::borrow::Cow;

use crate::MeshData;

/// Reads an STL file, binary or text. It has no materials.
pub(super) fn read(bytes: &[u8]) -> Result<MeshData, String> {
    let bytes = one_solid(bytes).map_or(Cow::Borrowed(bytes), Cow::Owned);
    let mesh = stl_io::read_stl(&mut std::io::Cursor::new(bytes));
    let mesh = mesh.map_err(|e| format!("cannot be read as STL: {e}"))?;
    let faces = mesh.faces.iter();
    Ok(MeshData {
        positions: mesh.vertices.iter().map(|v| v.0).collect(),
        triangles: faces.map(|f| f.vertices.map(|i| i as u32)).collect(),
        ..MeshData::default()
    })
}

/// A text file as the text of one solid with a name, which the reader needs; `None` for a binary file.
fn one_solid(bytes: &[u8]) -> Option<Vec<u8>> {
    let text = std::str::from_utf8(bytes).ok()?;
    let text = text.trim_start_matches('\u{feff}').trim_start();
    let first_is = |line: &str, word: &str| {
        let first = line.split_whitespace().next().unwrap_or_default();
        first.eq_ignore_ascii_case(word)
    };
    if !first_is(text, "solid") || !text.lines().any(|line| first_is(line, "facet")) {
        return None;
    }
    let mut one = "solid all\n".to_owned();
    for line in text.lines() {
        if !first_is(line, "solid") && !first_is(line, "endsolid") {
            one.push_str(line);
            one.push('\n');
        }
    }
    one.push_str("endsolid all\n");
    Some(one.into_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    // Fails if only the first solid is read, or a text without the usual first line is taken for binary.
    #[test]
    fn all_solids_of_a_text_are_read() {
        let facet = |z: f32| {
            format!(
                "facet normal 0 0 1\n outer loop\n  vertex 0 0 {z}\n  vertex 1 0 {z}\n  vertex 0 1 {z}\n endloop\nendfacet\n"
            )
        };
        for (first, second) in [
            ("solid a", "solid b"),
            ("solid", "solid"),
            ("SOLID x", "Solid y"),
        ] {
            let text = format!(
                "\u{feff}{first}\n{}endsolid\n{second}\n{}endsolid\n",
                facet(0.0),
                facet(2.0)
            );
            let mesh = read(text.as_bytes()).unwrap();
            assert_eq!(mesh.triangles.len(), 2, "{first}");
        }
        assert!(read(b"solid but not a text of facets").is_err());
    }
}
