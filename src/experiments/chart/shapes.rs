//! Shapes of structures: undeformed and deformed, with a small drawing for each mode.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::path::{Path, PathBuf};

use super::canvas::{self, Drawing, FONT, Pen, TEXT};
use super::{COLOURS, ChartError, TITLE_HEIGHT, bounds, draw_title};

/// Drawings of shapes side by side, with a common scale.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ShapeFigure {
    /// Title.
    pub title: String,
    /// Number of drawings per row.
    pub columns: usize,
    /// The drawings, from left to right and from top to bottom.
    pub panels: Vec<ShapePanel>,
}

/// One drawing.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ShapePanel {
    /// Title above the drawing.
    pub title: String,
    /// The undeformed structure: lines.
    pub reference: Vec<Vec<(f64, f64)>>,
    /// The deformed one: lines.
    pub shape: Vec<Vec<(f64, f64)>>,
    /// Points with dots.
    pub nodes: Vec<(f64, f64)>,
    /// Arrows: position and direction, a vector of length 1.
    pub arrows: Vec<[(f64, f64); 2]>,
}

const WIDTH: u32 = 1000;
const CAPTION: u32 = 30;
/// Margin around the shapes in a drawing.
const MARGIN: f64 = 12.0;
/// Length of an arrow.
const ARROW: f64 = 26.0;
const LIGHT: RGBColor = RGBColor(190, 190, 190);

impl ShapeFigure {
    /// Draws the figure to `stem.svg` and `stem.png`; returns both paths.
    ///
    /// # Errors
    /// [`ChartError`] if a file cannot be written.
    pub fn save(&self, stem: &Path) -> Result<[PathBuf; 2], ChartError> {
        canvas::save(self, stem)
    }

    /// Lowest and highest x and y of all drawings.
    fn extent(&self) -> [(f64, f64); 2] {
        let points = || {
            let panels = self.panels.iter();
            panels.flat_map(|p| p.reference.iter().chain(&p.shape).flatten().chain(&p.nodes))
        };
        [
            bounds(points().map(|p| p.0)).unwrap_or((0.0, 1.0)),
            bounds(points().map(|p| p.1)).unwrap_or((0.0, 1.0)),
        ]
    }

    fn columns(&self) -> u32 {
        self.columns.clamp(1, 12) as u32
    }

    /// Units of length per unit of the shapes, and the height of a drawing.
    fn scale(&self) -> (f64, u32) {
        let [x, y] = self.extent();
        let width = f64::from(WIDTH / self.columns()) - 2.0 * MARGIN;
        let span = |(low, high): (f64, f64)| (high - low).max(1e-300);
        // A drawing is at most as high as it is wide.
        let unit = (width / span(x)).min(width / span(y));
        let height = (y.1 - y.0) * unit + 2.0 * MARGIN;
        (unit, height.ceil().clamp(60.0, 500.0) as u32 + CAPTION)
    }
}

impl Drawing for ShapeFigure {
    fn size(&self) -> (u32, u32) {
        let rows = (self.panels.len() as u32).div_ceil(self.columns()).max(1);
        (WIDTH, TITLE_HEIGHT + rows * self.scale().1 + 10)
    }

    fn draw<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        pen: Pen,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let body = draw_title(area, pen, &self.title)?;
        let (unit, height) = self.scale();
        let width = WIDTH / self.columns();
        let [x, y] = self.extent();
        let pixels = f64::from(pen.scale);
        let style = (FONT, 15 * pen.scale)
            .into_text_style(&body)
            .color(&TEXT)
            .pos(Pos::new(HPos::Center, VPos::Center));
        for (i, panel) in self.panels.iter().enumerate() {
            let i = i as u32;
            let left = f64::from(i % self.columns() * width) + 0.5 * f64::from(width);
            let top = f64::from(i / self.columns() * height);
            let middle = (0.5 * (x.0 + x.1), 0.5 * (y.0 + y.1));
            let centre = top + f64::from(CAPTION) + 0.5 * f64::from(height - CAPTION);
            let length = |v: f64| (v * pixels).round() as i32;
            let place = |p: &(f64, f64)| {
                (
                    length(left + (p.0 - middle.0) * unit),
                    length(centre - (p.1 - middle.1) * unit),
                )
            };
            let caption = (length(left), length(top + 0.5 * f64::from(CAPTION)));
            body.draw_text(&panel.title, &style, caption)?;
            let lines = |lines: &[Vec<(f64, f64)>], style: ShapeStyle| {
                for line in lines {
                    let finite = line.iter().filter(|p| (p.0 + p.1).is_finite());
                    body.draw(&PathElement::new(
                        finite.map(place).collect::<Vec<_>>(),
                        style,
                    ))?;
                }
                Ok(())
            };
            lines(&panel.reference, LIGHT.stroke_width(pen.scale))?;
            lines(&panel.shape, COLOURS[0].stroke_width(2 * pen.scale))?;
            for node in panel.nodes.iter().filter(|p| (p.0 + p.1).is_finite()) {
                body.draw(&Circle::new(
                    place(node),
                    3 * pen.scale,
                    COLOURS[0].filled(),
                ))?;
            }
            for [from, direction] in &panel.arrows {
                let style = COLOURS[1].stroke_width(2 * pen.scale);
                let (u, v) = *direction;
                let to = (from.0 + u * ARROW / unit, from.1 + v * ARROW / unit);
                body.draw(&PathElement::new(vec![place(from), place(&to)], style))?;
                // The head: two strokes back at an angle.
                for side in [-1.0, 1.0] {
                    let back = (-u * 0.8 - side * v * 0.5, -v * 0.8 + side * u * 0.5);
                    let end = (to.0 + back.0 * 9.0 / unit, to.1 + back.1 * 9.0 / unit);
                    body.draw(&PathElement::new(vec![place(&to), place(&end)], style))?;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shape_has_its_proportions_and_anything_is_drawn() {
        let square = vec![(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0), (0.0, 0.0)];
        let panel = ShapePanel {
            title: "1.5 Hz".into(),
            reference: vec![square.clone()],
            shape: vec![square.clone(), vec![(f64::NAN, 0.0), (1.0, 1.0)], vec![]],
            nodes: square,
            arrows: vec![[(2.0, 1.0), (0.0, 1.0)]],
        };
        let figure = ShapeFigure {
            title: "Modes".into(),
            columns: 4,
            panels: vec![panel; 5],
        };
        // Twice as wide as high, in two rows.
        let (unit, height) = figure.scale();
        assert!((unit - 113.0).abs() < 1e-9, "{unit}");
        assert_eq!(height, 113 + 24 + CAPTION);
        assert_eq!(figure.size().1, TITLE_HEIGHT + 2 * height + 10);
        let dir = tempfile::tempdir().unwrap();
        let [svg, png] = figure.save(&dir.path().join("modes")).unwrap();
        let svg = std::fs::read_to_string(svg).unwrap();
        assert!(svg.contains("1.5 Hz") && svg.contains("Modes"));
        assert!(std::fs::read(png).unwrap().starts_with(b"\x89PNG"));
        ShapeFigure::default()
            .save(&dir.path().join("none"))
            .unwrap();
    }
}
