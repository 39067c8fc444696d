//! Conversion of image messages to grey values.

use fuyu_track::{Image as View, LARGEST_IMAGE, SMALLEST_IMAGE};

use crate::msg::sensor_msgs::Image;

/// Supported encodings, and the number of bytes per pixel.
const ENCODINGS: [(&str, usize); 17] = [
    ("mono8", 1),
    ("8UC1", 1),
    ("rgb8", 3),
    ("bgr8", 3),
    ("rgba8", 4),
    ("bgra8", 4),
    ("mono16", 2),
    ("16UC1", 2),
    ("bayer_rggb8", 1),
    ("bayer_bggr8", 1),
    ("bayer_gbrg8", 1),
    ("bayer_grbg8", 1),
    ("bayer_rggb16", 2),
    ("bayer_bggr16", 2),
    ("bayer_gbrg16", 2),
    ("bayer_grbg16", 2),
    // Gazebo's name for rgb8.
    ("R8G8B8", 3),
];

/// An image with one byte per pixel, without padding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grey {
    width: usize,
    height: usize,
    data: Vec<u8>,
}

impl Grey {
    /// The luminance of an image (Rec. ITU-R BT.601, as in OpenCV); for a Bayer mosaic, `r/4 + g/2 + b/4`. `white` is
    /// the 16-bit value that becomes 255.
    ///
    /// # Errors
    /// Names the invalid field.
    pub fn new(image: &Image, white: u16) -> Result<Self, String> {
        let luminance = |r: u8, g: u8, b: u8| {
            ((77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b) + 128) >> 8) as u8
        };
        let white = u32::from(white.max(1));
        let encoding = image.encoding.as_str();
        let big_endian = image.is_bigendian != 0;
        let is_mosaic = encoding.starts_with("bayer_");
        let values = pixels(image, |p| match encoding {
            "rgb8" | "rgba8" | "R8G8B8" => luminance(p[0], p[1], p[2]),
            "bgr8" | "bgra8" => luminance(p[2], p[1], p[0]),
            _ if p.len() == 2 => {
                let value = u32::from(two(p, big_endian));
                ((value * 255 + white / 2) / white).min(255) as u8
            }
            _ => p[0],
        })?;
        Ok(match is_mosaic {
            true => values.smoothed(),
            false => values,
        })
    }

    /// Weighted mean over 3 x 3 pixels, with the weights 1, 2, 1 in both directions. At every pixel of a Bayer mosaic
    /// it has red and blue once and green twice, without a shift of the image. The image is mirrored at its edges.
    fn smoothed(&self) -> Self {
        let (width, height) = (self.width, self.height);
        let mirrored = |i: usize, n: usize| match i {
            0 => (1, 1),
            i if i + 1 == n => (n - 2, n - 2),
            i => (i - 1, i + 1),
        };
        let mut sums = vec![0_u16; width];
        let mut data = Vec::with_capacity(width * height);
        for v in 0..height {
            let (above, below) = mirrored(v, height);
            let row = |v: usize| &self.data[v * width..(v + 1) * width];
            let rows = row(above).iter().zip(row(v)).zip(row(below));
            for (sum, ((a, b), c)) in sums.iter_mut().zip(rows) {
                *sum = u16::from(*a) + 2 * u16::from(*b) + u16::from(*c);
            }
            data.extend((0..width).map(|u| {
                let (left, right) = mirrored(u, width);
                ((sums[left] + 2 * sums[u] + sums[right] + 8) >> 4) as u8
            }));
        }
        Self {
            width,
            height,
            data,
        }
    }

    /// An image from grey values, row by row.
    ///
    /// # Errors
    /// If the number of values does not match the size, or the image is too small or too large.
    pub fn from_values(width: usize, height: usize, data: Vec<u8>) -> Result<Self, String> {
        View::new(width, height, width, &data).map_err(|e| e.to_string())?;
        Ok(Self {
            width,
            height,
            data,
        })
    }

    /// The image as input of the tracker.
    ///
    /// # Errors
    /// If the image is invalid, which its constructors exclude.
    pub fn view(&self) -> Result<View<'_>, String> {
        View::new(self.width, self.height, self.width, &self.data).map_err(|e| e.to_string())
    }
}

/// Mask of the pixels at which a segmentation image shows the body `id`.
///
/// # Errors
/// Names the invalid field.
pub fn mask_of(segmentation: &Image, id: u16) -> Result<Grey, String> {
    let big_endian = segmentation.is_bigendian != 0;
    match segmentation.encoding.as_str() {
        "mono16" | "16UC1" => pixels(segmentation, |p| u8::from(two(p, big_endian) == id)),
        "mono8" | "8UC1" => pixels(segmentation, |p| u8::from(u16::from(p[0]) == id)),
        other => Err(format!(
            "encoding is '{other}'; that of a mask must be 16UC1, mono16, 8UC1 or mono8"
        )),
    }
}

fn two(pixel: &[u8], big_endian: bool) -> u16 {
    let bytes = [pixel[0], pixel[1]];
    match big_endian {
        true => u16::from_be_bytes(bytes),
        false => u16::from_le_bytes(bytes),
    }
}

fn pixels(image: &Image, value: impl Fn(&[u8]) -> u8) -> Result<Grey, String> {
    let known = ENCODINGS.iter().find(|(name, _)| *name == image.encoding);
    let Some((_, bytes)) = known else {
        let names: Vec<_> = ENCODINGS.iter().map(|(name, _)| *name).collect();
        return Err(format!(
            "encoding is '{}'; it must be one of {}",
            image.encoding.escape_debug(),
            names.join(", ")
        ));
    };
    let (width, height) = (image.width as usize, image.height as usize);
    let sizes = SMALLEST_IMAGE..=LARGEST_IMAGE;
    if !(sizes.contains(&width) && sizes.contains(&height)) {
        return Err(format!(
            "width and height are {width} and {height}; both must be {SMALLEST_IMAGE} to {LARGEST_IMAGE}"
        ));
    }
    let (row, step) = (width * bytes, image.step as usize);
    if step < row {
        return Err(format!(
            "step is {step}; it must be at least {row} for {width} pixels of {}",
            image.encoding
        ));
    }
    let needed = step * (height - 1) + row;
    if image.data.len() < needed {
        return Err(format!(
            "data has {} bytes; {height} rows of step {step} need {needed}",
            image.data.len()
        ));
    }
    let rows = image.data.chunks(step).take(height);
    let values = rows.flat_map(|line| line[..row].chunks_exact(*bytes).map(&value));
    Ok(Grey {
        width,
        height,
        data: values.collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 33;
    const HEIGHT: usize = 32;

    /// An image in which every pixel is `pixel`, and each row is followed by `padding` bytes of 0xee.
    fn image(encoding: &str, pixel: &[u8], padding: usize) -> Image {
        let mut row = pixel.repeat(WIDTH);
        row.extend(vec![0xee; padding]);
        Image {
            width: WIDTH as u32,
            height: HEIGHT as u32,
            encoding: encoding.to_owned(),
            step: row.len() as u32,
            data: row.repeat(HEIGHT),
            ..Image::default()
        }
    }

    #[test]
    fn every_encoding_has_its_grey_value_whatever_the_step() {
        // 0.299 x 200 + 0.587 x 100 + 0.114 x 50 = 124.2 (Rec. ITU-R BT.601).
        for (encoding, pixel, expected) in [
            ("mono8", &[7][..], 7),
            ("8UC1", &[7], 7),
            ("rgb8", &[200, 100, 50], 124),
            ("bgr8", &[50, 100, 200], 124),
            ("rgba8", &[200, 100, 50, 9], 124),
            ("bgra8", &[50, 100, 200, 9], 124),
            ("mono16", &[0x34, 0x80], 128),
        ] {
            for padding in [0, 5, 64] {
                let grey = Grey::new(&image(encoding, pixel, padding), u16::MAX).unwrap();
                assert_eq!((grey.width, grey.height), (WIDTH, HEIGHT));
                assert_eq!(grey.data, vec![expected; WIDTH * HEIGHT], "{encoding}");
            }
        }
        let mut big = image("mono16", &[0x0f, 0xff], 0);
        big.is_bigendian = 1;
        // 12-bit values.
        assert_eq!(Grey::new(&big, 4095).unwrap().data[0], 255);
        assert_eq!(Grey::new(&big, u16::MAX).unwrap().data[0], 16);
    }

    #[test]
    fn errors_name_the_field_and_what_would_be_right() {
        let good = image("rgb8", &[1, 2, 3], 0);
        let refused = |change: fn(&mut Image)| {
            let mut image = good.clone();
            change(&mut image);
            let problem = Grey::new(&image, u16::MAX).unwrap_err();
            assert_eq!(problem.lines().count(), 1);
            problem
        };
        let encoding = refused(|i| i.encoding = "yuv422".to_owned());
        assert!(encoding.starts_with("encoding is 'yuv422'; it must be one of mono8"));
        assert!(refused(|i| i.encoding = "a\nb".to_owned()).contains("a\\nb"));
        assert!(refused(|i| i.step = 98).starts_with("step is 98; it must be at least 99"));
        assert!(refused(|i| i.width = 0).starts_with("width and height are 0 and 32"));
        assert!(refused(|i| i.height = u32::MAX).contains("4294967295"));
        let short = refused(|i| i.data.truncate(99 * 31 + 98));
        assert!(short.starts_with("data has 3167 bytes"), "{short}");
        // Padding of the last row is not needed.
        let mut padded = image("rgb8", &[1, 2, 3], 7);
        padded.data.truncate(106 * 31 + 99);
        assert!(Grey::new(&padded, u16::MAX).is_ok());
    }

    // Constant planes of each colour give r/4 + g/2 + b/4 in every pixel, including the edges, for every order of the
    // colours.
    #[test]
    fn a_mosaic_has_the_same_grey_value_in_every_pixel() {
        for (encoding, upper, lower) in [
            ("bayer_rggb8", [200, 100], [100, 48]),
            ("bayer_bggr8", [48, 100], [100, 200]),
            ("bayer_gbrg8", [100, 48], [200, 100]),
            ("bayer_grbg8", [100, 200], [48, 100]),
        ] {
            let mut mosaic = image(encoding, &[0], 3);
            for (i, value) in mosaic.data.iter_mut().enumerate() {
                let (v, u) = (i / (WIDTH + 3), i % (WIDTH + 3));
                let row = if v.is_multiple_of(2) { upper } else { lower };
                *value = row[u % 2];
            }
            let grey = Grey::new(&mosaic, u16::MAX).unwrap();
            assert_eq!(grey.data, vec![112; WIDTH * HEIGHT], "{encoding}");
        }
        let wide = image("bayer_rggb16", &[0x34, 0x80], 4);
        assert_eq!(Grey::new(&wide, u16::MAX).unwrap().data[40], 128);
    }

    #[test]
    fn masks_are_the_pixels_of_one_body() {
        let mask = mask_of(&image("16UC1", &[2, 1], 3), 258).unwrap();
        assert!(mask.data.iter().all(|x| *x == 1));
        let other = mask_of(&image("mono8", &[3], 0), 2).unwrap();
        assert!(other.data.iter().all(|x| *x == 0));
        assert!(mask_of(&image("rgb8", &[1, 2, 3], 0), 2).is_err());
    }
}
