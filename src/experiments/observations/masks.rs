//! Masks of the target in PNG files.

use std::path::{Path, PathBuf};

use image::DynamicImage;

use super::png;
use crate::nodes::tracker::Grey;

/// Masks of a sequence of images.
pub(super) enum Masks {
    /// No masks: the tracker finds the target by itself.
    None,
    /// One mask for all images.
    Same(Grey),
    /// A folder of mask files with the names of the images, and the value of the target.
    Files(PathBuf, Option<u16>),
}

impl Masks {
    /// Masks from a PNG file or a folder of them. Pixels with the value `id`, or without `id` all non-zero pixels, are
    /// the target.
    ///
    /// # Errors
    /// A line that names the file.
    pub(super) fn new(path: Option<&Path>, id: Option<u16>) -> Result<Self, String> {
        Ok(match path {
            None => Self::None,
            Some(path) if path.is_dir() => Self::Files(path.to_owned(), id),
            Some(path) => Self::Same(read(path, id)?),
        })
    }

    /// The mask of an image file.
    ///
    /// # Errors
    /// A line that names the file.
    pub(super) fn of(&self, image: &Path) -> Result<Option<Grey>, String> {
        match (self, image.file_name()) {
            (Self::Files(folder, id), Some(name)) => read(&folder.join(name), *id).map(Some),
            (Self::Same(mask), _) => Ok(Some(mask.clone())),
            (Self::None | Self::Files(..), _) => Ok(None),
        }
    }
}

fn read(path: &Path, id: Option<u16>) -> Result<Grey, String> {
    let at = |e: String| format!("{}: {e}", path.display());
    let decoded = png::read(path)?;
    let is_target = |value: u16| u8::from(id.map_or(value != 0, |id| value == id));
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let values: Vec<u8> = match decoded {
        DynamicImage::ImageLuma8(grey) => grey.iter().map(|x| is_target((*x).into())).collect(),
        DynamicImage::ImageLuma16(grey) => grey.iter().map(|x| is_target(*x)).collect(),
        other => {
            return Err(at(format!(
                "is a PNG file of colour type {:?}; a mask must be grey, of 8 or 16 bits",
                other.color()
            )));
        }
    };
    Grey::from_values(width, height, values).map_err(at)
}
