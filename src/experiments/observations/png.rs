//! Reading of PNG files.

use std::path::Path;

use image::{DynamicImage, ImageFormat};

/// Reads a PNG file, whatever its file extension.
///
/// # Errors
/// A line that names the file.
pub(super) fn read(path: &Path) -> Result<DynamicImage, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    image::load_from_memory_with_format(&bytes, ImageFormat::Png)
        .map_err(|e| format!("{}: is not a sound PNG file: {e}", path.display()))
}
