//! Compressed images.

use image::{ColorType, ImageEncoder, codecs};

/// Compresses an 8-bit image without loss. `channels` is 1 or 3.
///
/// # Errors
/// A line that says what is wrong with size or channels.
pub fn png(pixels: &[u8], width: u32, height: u32, channels: u32) -> Result<Vec<u8>, String> {
    let colour = colour(pixels, width, height, channels)?;
    let mut bytes = Vec::new();
    codecs::png::PngEncoder::new(&mut bytes)
        .write_image(pixels, width, height, colour)
        .map_err(|e| format!("png: {e}"))?;
    Ok(bytes)
}

/// Compresses an 8-bit image with loss. `quality` is from 1 to 100; `channels` is 1 or 3.
///
/// # Errors
/// A line that says what is wrong with size or channels.
pub fn jpeg(
    pixels: &[u8],
    width: u32,
    height: u32,
    channels: u32,
    quality: u8,
) -> Result<Vec<u8>, String> {
    let colour = colour(pixels, width, height, channels)?;
    let mut bytes = Vec::new();
    codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100))
        .write_image(pixels, width, height, colour)
        .map_err(|e| format!("jpeg: {e}"))?;
    Ok(bytes)
}

fn colour(pixels: &[u8], width: u32, height: u32, channels: u32) -> Result<ColorType, String> {
    let expected = u64::from(width) * u64::from(height) * u64::from(channels);
    if pixels.len() as u64 != expected {
        return Err(format!(
            "an image of {width} x {height} px and {channels} channels has {expected} bytes, not {}",
            pixels.len()
        ));
    }
    match channels {
        1 => Ok(ColorType::L8),
        3 => Ok(ColorType::Rgb8),
        other => Err(format!("{other} channels; it must be 1 or 3")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compressed_images_decode_to_the_same_pixels() {
        let pixels: Vec<u8> = (0..48 * 32 * 3).map(|i| (i / 48) as u8).collect();
        let bytes = png(&pixels, 48, 32, 3).unwrap();
        assert_eq!(
            image::load_from_memory(&bytes)
                .unwrap()
                .to_rgb8()
                .into_raw(),
            pixels
        );
        let bytes = jpeg(&pixels[..48 * 32], 48, 32, 1, 95).unwrap();
        let back = image::load_from_memory(&bytes)
            .unwrap()
            .to_luma8()
            .into_raw();
        assert!(back.iter().zip(&pixels).all(|(a, b)| a.abs_diff(*b) < 8));
        assert!(
            png(&pixels, 48, 31, 3)
                .unwrap_err()
                .contains("4464 bytes, not 4608")
        );
    }
}
