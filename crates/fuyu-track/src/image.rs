//! Grey images that somebody else owns.

/// Fewest columns and rows of an image.
pub const SMALLEST_IMAGE: usize = 32;
/// Most columns and rows of an image.
pub const LARGEST_IMAGE: usize = 16_384;

/// Why bytes are not an image.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    /// The image is too small or too large.
    #[error(
        "the image is {0} x {1} px; it must be {SMALLEST_IMAGE} to {LARGEST_IMAGE} px wide and high"
    )]
    Size(usize, usize),
    /// Rows overlap.
    #[error("a row of {width} px begins every {stride} bytes; it must be at least {width}")]
    Stride {
        /// Columns.
        width: usize,
        /// Bytes from row to row.
        stride: usize,
    },
    /// There are fewer bytes than pixels.
    #[error("the image has {actual} bytes; {needed} are needed")]
    Short {
        /// Bytes that the size and the stride need.
        needed: usize,
        /// Bytes that there are.
        actual: usize,
    },
}

/// An image of 8 bits a pixel; pixel centres are at integers, the first is (0, 0).
#[derive(Debug, Clone, Copy)]
pub struct Image<'a> {
    width: usize,
    height: usize,
    stride: usize,
    data: &'a [u8],
}

impl<'a> Image<'a> {
    /// A view of `data`, in which a row of `width` pixels begins every `stride` bytes. Bytes after a row and after the last row are
    /// ignored.
    ///
    /// # Errors
    /// [`ImageError`] if the bytes are no such image.
    pub fn new(
        width: usize,
        height: usize,
        stride: usize,
        data: &'a [u8],
    ) -> Result<Self, ImageError> {
        let sizes = SMALLEST_IMAGE..=LARGEST_IMAGE;
        if !(sizes.contains(&width) && sizes.contains(&height)) {
            return Err(ImageError::Size(width, height));
        }
        if stride < width {
            return Err(ImageError::Stride { width, stride });
        }
        // The last row needs no padding.
        let needed = stride.saturating_mul(height - 1).saturating_add(width);
        if data.len() < needed {
            let actual = data.len();
            return Err(ImageError::Short { needed, actual });
        }
        Ok(Self {
            width,
            height,
            stride,
            data,
        })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The pixels of a row.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(&self, v: usize) -> &'a [u8] {
        assert!(v < self.height, "row {v} of {}", self.height);
        &self.data[v * self.stride..][..self.width]
    }
}

/// Value at (u, v) between pixels of an image without padding, bilinear; `None` outside of it.
pub(crate) fn sample(pixels: &[u8], width: usize, height: usize, u: f64, v: f64) -> Option<f32> {
    // Also false if a coordinate is not a number.
    if !(u >= 0.0 && v >= 0.0 && u < (width - 1) as f64 && v < (height - 1) as f64) {
        return None;
    }
    let (column, row) = (u as usize, v as usize);
    let (a, b) = ((u - column as f64) as f32, (v - row as f64) as f32);
    let upper = &pixels[row * width + column..][..2];
    let lower = &pixels[(row + 1) * width + column..][..2];
    let [p, q] = [upper, lower].map(|r| (1.0 - a) * f32::from(r[0]) + a * f32::from(r[1]));
    Some((1.0 - b) * p + b * q)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_that_do_not_fit_are_refused() {
        let data = vec![0; 40 * 40];
        assert!(Image::new(33, 40, 40, &data).is_ok());
        // The padding of the last row may be missing.
        assert!(Image::new(33, 40, 40, &data[..39 * 40 + 33]).is_ok());
        let refused = |w, h, stride| Image::new(w, h, stride, &data).unwrap_err();
        assert_eq!(refused(0, 40, 40), ImageError::Size(0, 40));
        assert_eq!(refused(40, 20_000, 40), ImageError::Size(40, 20_000));
        let (width, stride) = (40, 39);
        assert_eq!(refused(40, 40, 39), ImageError::Stride { width, stride });
        let (needed, actual) = (40 * 40 + 40, 1600);
        assert_eq!(refused(40, 41, 40), ImageError::Short { needed, actual });
        assert!(matches!(
            refused(40, 40, usize::MAX),
            ImageError::Short { .. }
        ));
    }

    #[test]
    fn values_between_pixels_are_those_of_a_plane() {
        let (width, height) = (40, 34);
        let pixels: Vec<u8> = (0..width * height)
            .map(|i| (2 * (i % width) + 3 * (i / width)) as u8)
            .collect();
        let at = |u, v| sample(&pixels, width, height, u, v);
        assert!((at(10.25, 20.5).unwrap() - 82.0).abs() < 1e-4);
        assert_eq!(at(39.0, 3.0), None);
        assert_eq!(at(f64::NAN, 3.0), None);
    }
}
