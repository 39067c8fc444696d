//! Curves in a plane, with equal scales on both axes.

use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::canvas::{self, Drawing, FAINT, FONT, Pen, TEXT};
use super::{
    Axis, ChartError, DOT, GRID, LEGEND_WIDTH, Series, Sign, TITLE_HEIGHT, bounds, clip, dashes,
    draw_legend, draw_title, line,
};

/// A figure of curves and single points in a plane; both axes have the same scale unless `stretched`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlaneFigure {
    /// Title.
    pub title: String,
    /// Quantity and unit of the horizontal axis.
    pub x_label: String,
    /// Quantity and unit of the vertical axis.
    pub y_label: String,
    /// Curves; points are joined in their order, and a non-finite point interrupts the curve.
    pub series: Vec<Series>,
    /// Single points.
    pub marks: Vec<Marks>,
    /// Whether each axis has its own scale.
    pub stretched: bool,
    /// Ranges of both axes, outside of which nothing is drawn; by default they contain everything.
    pub view: Option<[(f64, f64); 2]>,
}

/// Single points with the same sign.
#[derive(Debug, Clone, PartialEq)]
pub struct Marks {
    /// Name in the legend.
    pub name: String,
    /// The sign.
    pub mark: Mark,
    /// The points; non-finite ones are omitted.
    pub points: Vec<(f64, f64)>,
}

/// How a single point is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A diagonal cross, the sign of poles.
    Cross,
    /// A ring, the sign of zeros.
    Ring,
    /// An upright cross.
    Plus,
}

impl Mark {
    /// Lines of the sign about its point, up to `size` pixels long.
    pub(super) fn strokes(self, size: u32) -> Vec<std::vec::IntoIter<(i32, i32)>> {
        let r = size as i32;
        let strokes = match self {
            Self::Cross => vec![vec![(-r, -r), (r, r)], vec![(-r, r), (r, -r)]],
            Self::Plus => vec![vec![(-r, 0), (r, 0)], vec![(0, -r), (0, r)]],
            Self::Ring => {
                let at = |i: i32| {
                    let angle = f64::from(i) * std::f64::consts::TAU / 24.0;
                    let along = |v: f64| (f64::from(r) * v).round() as i32;
                    (along(angle.cos()), along(angle.sin()))
                };
                vec![(0..=24).map(at).collect()]
            }
        };
        strokes.into_iter().map(Vec::into_iter).collect()
    }
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

    /// Ranges of both axes, of equal lengths unless stretched.
    fn ranges(&self) -> [Range<f64>; 2] {
        if let Some(view) = self.view {
            return view.map(|(low, high)| low..high);
        }
        let points = || {
            let curves = self.series.iter().flat_map(|s| &s.points);
            curves.chain(self.marks.iter().flat_map(|m| &m.points))
        };
        let x = bounds(points().map(|p| p.0)).unwrap_or((-1.0, 1.0));
        let y = bounds(points().map(|p| p.1)).unwrap_or((-1.0, 1.0));
        if self.stretched {
            return [x, y].map(|(low, high)| {
                let margin = 0.04 * (high - low);
                let margin = if margin > 0.0 { margin } else { 1.0 };
                low - margin..high + margin
            });
        }
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
        // The labels next to the plot need 26 more than those below it.
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
            .build_cartesian_2d(Axis::linear(x.clone(), 6), Axis::linear(y.clone(), 6))?;
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
        let (columns, rows) = chart.plotting_area().dim_in_pixel();
        let unit = |pixels: u32, range: &Range<f64>| {
            f64::from(pixels) / (range.end - range.start) / f64::from(scale)
        };
        let (per_x, per_y) = (unit(columns, &x), unit(rows, &y));
        let on_paper = |p: &(f64, f64)| (p.0 * per_x, p.1 * per_y);
        let curves: Vec<Vec<_>> = (self.series.iter())
            .map(|series| match self.view {
                None => series.points.clone(),
                // Clipped parts, separated by interruptions.
                Some(_) => (clip::clipped(&series.points, &x, &y).into_iter())
                    .flat_map(|piece| piece.into_iter().chain([(f64::NAN, f64::NAN)]))
                    .collect(),
            })
            .collect();
        let drawn: Vec<Vec<_>> = (curves.iter())
            .map(|points| points.iter().map(on_paper).collect())
            .collect();
        let patterns = dashes::patterns(&drawn);
        for (i, (curve, drawn)) in curves.into_iter().zip(drawn).enumerate() {
            let style = line(i, scale);
            let pieces = match patterns[i] {
                None => vec![curve],
                Some(pattern) => (dashes::dashed(&drawn, pattern).into_iter())
                    .map(|piece| piece.iter().map(|p| (p.0 / per_x, p.1 / per_y)).collect())
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
        for (i, marks) in self.marks.iter().enumerate() {
            let style = line(self.series.len() + i, scale);
            let visible = |p: &&(f64, f64)| x.contains(&p.0) && y.contains(&p.1);
            for point in marks.points.iter().filter(visible) {
                for stroke in marks.mark.strokes(DOT * scale) {
                    let sign = EmptyElement::at(*point)
                        + PathElement::new(stroke.collect::<Vec<_>>(), style);
                    chart.draw_series([sign])?;
                }
            }
        }
        let lines = self.series.iter().zip(&patterns);
        let lines = lines.map(|(s, pattern)| (s.name.as_str(), Sign::Line(*pattern)));
        let marks = (self.marks.iter()).map(|m| (m.name.as_str(), Sign::Mark(m.mark)));
        draw_legend(&legend, scale, lines.chain(marks), [].into_iter())
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
            ..PlaneFigure::default()
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

    #[test]
    fn poles_and_zeros_have_signs_and_the_rest_is_cut() {
        let marks = |name: &str, mark, points: &[(f64, f64)]| Marks {
            name: name.into(),
            mark,
            points: points.to_vec(),
        };
        let figure = PlaneFigure {
            title: "Map".into(),
            series: vec![Series {
                name: "locus".into(),
                points: vec![(0.0, 0.0), (-1e9, 0.0)],
            }],
            marks: vec![
                marks(
                    "poles",
                    Mark::Cross,
                    &[(-1.0, 1.0), (-1e9, 0.0), (f64::NAN, 0.0)],
                ),
                marks("zeros", Mark::Ring, &[(0.0, 20.0)]),
                marks("chosen", Mark::Plus, &[(-0.5, 3.0)]),
            ],
            view: Some([(-2.0, 0.5), (0.0, 25.0)]),
            ..PlaneFigure::default()
        };
        assert_eq!(figure.ranges(), [-2.0..0.5, 0.0..25.0]);
        let dir = tempfile::tempdir().unwrap();
        let [svg, _] = figure.save(&dir.path().join("map")).unwrap();
        let svg = std::fs::read_to_string(svg).unwrap();
        for text in ["poles", "zeros", "chosen", "locus"] {
            assert!(svg.contains(text), "no {text:?}");
        }
        let all = PlaneFigure {
            view: None,
            stretched: true,
            ..figure
        };
        let [x, y] = all.ranges();
        assert!(
            x.start < -1e9 && y.end > 20.0 && y.end < 21.0,
            "{x:?} {y:?}"
        );
    }
}
