//! SVG and PNG output; independent of the machine, since the font is compiled in.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::path::{Path, PathBuf};
use std::sync::Once;

/// Pixels of a PNG per unit of length ...
const PNG_SCALE: u32 = 2;
/// ... each the mean of a square of this many subpixels, since plotters does not anti-alias wide lines.
const OVERSAMPLING: u32 = 2;

pub(super) const FONT: &str = "sans-serif";
pub(super) const TEXT: RGBColor = RGBColor(38, 38, 38);
pub(super) const FAINT: RGBColor = RGBColor(110, 110, 110);

/// Drawing parameters of lines.
#[derive(Clone, Copy)]
pub(super) struct Pen {
    /// Pixels per unit of length.
    pub scale: u32,
    /// Whether joints of wide lines are drawn as discs, because the backend draws unbounded spikes.
    pub discs: bool,
}

impl Pen {
    const SVG: Self = Self {
        scale: 1,
        discs: false,
    };
    const PNG: Self = Self {
        scale: PNG_SCALE * OVERSAMPLING,
        discs: true,
    };
}

/// A drawing that works with any backend.
pub(super) trait Drawing {
    /// Width and height in units of length.
    fn size(&self) -> (u32, u32);

    /// Draws on a white area of its size times the pen's scale.
    fn draw<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        pen: Pen,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>>;
}

/// A picture could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct ChartError {
    path: PathBuf,
    problem: String,
}

impl ChartError {
    fn new(path: &Path, problem: impl std::fmt::Display) -> Self {
        Self {
            path: path.to_owned(),
            problem: problem.to_string(),
        }
    }
}

/// Draws to `stem.svg` and `stem.png`.
pub(super) fn save(drawing: &impl Drawing, stem: &Path) -> Result<[PathBuf; 2], ChartError> {
    use_own_font();
    let (svg, png) = (stem.with_extension("svg"), stem.with_extension("png"));
    save_svg(drawing, &svg).map_err(|e| ChartError::new(&svg, e))?;
    save_png(drawing, &png).map_err(|e| ChartError::new(&png, e))?;
    Ok([svg, png])
}

fn save_svg(drawing: &impl Drawing, path: &Path) -> Result<(), String> {
    let area = SVGBackend::new(path, drawing.size()).into_drawing_area();
    area.fill(&WHITE)
        .and_then(|()| drawing.draw(&area, Pen::SVG))
        .and_then(|()| area.present())
        .map_err(|e| e.to_string())
}

fn save_png(drawing: &impl Drawing, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let (width, height) = drawing.size();
    let scale = Pen::PNG.scale;
    let size = (width * scale, height * scale);
    let mut pixels = vec![0; (size.0 * size.1 * 3) as usize];
    {
        let area = BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area();
        // The error borrows the pixels, so only its text is kept.
        area.fill(&WHITE)
            .and_then(|()| drawing.draw(&area, Pen::PNG))
            .and_then(|()| area.present())
            .map_err(|e| e.to_string())?;
    }
    let (width, height) = (width * PNG_SCALE, height * PNG_SCALE);
    let smooth = image::RgbImage::from_fn(width, height, |x, y| {
        let mut sum = [0; 3];
        for i in 0..OVERSAMPLING * OVERSAMPLING {
            let (x, y) = (
                x * OVERSAMPLING + i % OVERSAMPLING,
                y * OVERSAMPLING + i / OVERSAMPLING,
            );
            let at = ((y * size.0 + x) * 3) as usize;
            for (s, p) in sum.iter_mut().zip(&pixels[at..at + 3]) {
                *s += u32::from(*p);
            }
        }
        image::Rgb(sum.map(|s| (s / (OVERSAMPLING * OVERSAMPLING)) as u8))
    });
    Ok(smooth.save(path)?)
}

fn use_own_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        for (style, bytes) in [
            (FontStyle::Normal, notosans::REGULAR_TTF),
            (FontStyle::Bold, notosans::BOLD_TTF),
        ] {
            // The bytes are a font, as a test of this module shows.
            let _ = register_font(FONT, style, bytes);
        }
    });
}
