//! Curves in a plane, with equal scales on both axes.

use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::canvas::{self, Drawing, FAINT, FONT, Pen, TEXT};
use super::{
    Axis, ChartError, GRID, LEGEND_WIDTH, Series, Sign, TITLE_HEIGHT, bounds, dashes, draw_legend,
    draw_title, line,
};

/// A figure of curves in a plane. Points are joined in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneFigure {
    /// Title.
    pub title: String,
    /// Quantity and unit of the horizontal axis.
    pub x_label: String,
    /// Quantity and unit of the vertical axis.
    pub y_label: String,
    /// Curves; a non-finite point interrupts its curve.
    pub series: Vec<Series>,
}

/// Side of the square plot with its labels.
const SIDE: u32 = 640;

impl PlaneFigure {
    /// Draws the figure to `stem.svg` and `stem.png`; returns both paths.
    ///
    /// # Errors
    /// [`ChartError`] if a file cannot be written.
    pub fn save(&self, stem: &Path) -> Result<[PathBuf; 2], ChartError> {
        canvas::save(self, stem)
    }

    /// Ranges of both axes, of equal lengths.
    fn ranges(&self) -> [Range<f64>; 2] {
        let points = || self.series.iter().flat_map(|s| &s.points);
        let x = bounds(points().map(|p| p.0)).unwrap_or((-1.0, 1.0));
        let y = bounds(points().map(|p| p.1)).unwrap_or((-1.0, 1.0));
        let span = (x.1 - x.0).max(y.1 - y.0);
        let half = if span > 0.0 { 0.54 * span } else { 1.0 };
        [x, y].map(|(low, high)| {
            let middle = 0.5 * (low + high);
            middle - half..middle + half
        })
    }
}

impl Drawing for PlaneFigure {
    fn size(&self) -> (u32, u32) {
        // The labels next to the plot are 26 wider than those below.
        (SIDE + 26 + LEGEND_WIDTH, TITLE_HEIGHT + SIDE)
    }

    fn draw<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        pen: Pen,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let scale = pen.scale;
        let body = draw_title(area, pen, &self.title)?;
        let (plot, legend) = body.split_horizontally((SIDE + 26) * scale);
        let [x, y] = self.ranges();
        let mut chart = ChartBuilder::on(&plot)
            .margin_top(12 * scale)
            .margin_right(12 * scale)
            .margin_left(16 * scale)
            .margin_bottom(16 * scale)
            .x_label_area_size(46 * scale)
            .y_label_area_size(72 * scale)
            .build_cartesian_2d(Axis::linear(x, 6), Axis::linear(y, 6))?;
        chart
            .configure_mesh()
            .bold_line_style(GRID.stroke_width(scale))
            .light_line_style(TRANSPARENT)
            .axis_style(FAINT.stroke_width(scale))
            .set_all_tick_mark_size(5 * scale)
            .label_style((FONT, 15 * scale).into_font().color(&TEXT))
            .axis_desc_style((FONT, 16 * scale).into_font().color(&TEXT))
            .x_desc(&self.x_label)
            .y_desc(&self.y_label)
            .draw()?;
        // Units of length per unit of the axes.
        let [across, _] = self.ranges();
        let (columns, _) = chart.plotting_area().dim_in_pixel();
        let unit = f64::from(columns) / (across.end - across.start) / f64::from(scale);
        let drawn: Vec<Vec<_>> = (self.series.iter())
            .map(|s| s.points.iter().map(|p| (p.0 * unit, p.1 * unit)).collect())
            .collect();
        let patterns = dashes::patterns(&drawn);
        for (i, (series, drawn)) in self.series.iter().zip(drawn).enumerate() {
            let style = line(i, scale);
            let pieces = match patterns[i] {
                None => vec![series.points.clone()],
                Some(pattern) => (dashes::dashed(&drawn, pattern).into_iter())
                    .map(|piece| piece.iter().map(|p| (p.0 / unit, p.1 / unit)).collect())
                    .collect(),
            };
            for points in pieces {
                let finite = |p: &&(f64, f64)| p.0.is_finite() && p.1.is_finite();
                let pairs = points.windows(2);
                let pairs = pairs.filter(|pair| pair.iter().all(|p| finite(&p)));
                chart.draw_series(pairs.map(|p| PathElement::new(p.to_vec(), style)))?;
                if pen.discs {
                    let discs = points.iter().filter(finite);
                    chart.draw_series(discs.map(|&p| Circle::new(p, scale, style.filled())))?;
                }
            }
        }
        let lines = self.series.iter().zip(&patterns);
        let lines = lines.map(|(s, pattern)| (s.name.as_str(), Sign::Line(*pattern)));
        draw_legend(&legend, scale, lines, [].into_iter())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_is_round() {
        let points = (0..100).map(|i| {
            let a = 0.1 * f64::from(i);
            (3.0 + a.cos(), a.sin())
        });
        let figure = PlaneFigure {
            title: "Circle".into(),
            x_label: "x [m]".into(),
            y_label: "y [m]".into(),
            series: vec![Series {
                name: "c".into(),
                points: points.chain([(f64::NAN, 0.0)]).collect(),
            }],
        };
        let [x, y] = figure.ranges();
        assert!(((x.end - x.start) - (y.end - y.start)).abs() < 1e-12);
        let dir = tempfile::tempdir().unwrap();
        let [svg, _] = figure.save(&dir.path().join("circle")).unwrap();
        let svg = std::fs::read_to_string(svg).unwrap();
        for text in ["Circle", "x [m]", "y [m]"] {
            assert!(svg.contains(text), "no {text:?}");
        }
    }
}
