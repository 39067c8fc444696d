//! Charts of curves over a common axis, maps over a grid, curves in a plane and shapes of structures, as SVG and PNG.

mod axis;
mod canvas;
mod clip;
mod dashes;
mod legend;
mod map;
mod plane;
mod shapes;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::FontStyle;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;
use std::path::{Path, PathBuf};

use axis::Axis;
use canvas::{Drawing, FAINT, FONT, Pen, TEXT};
use legend::{Sign, draw_legend};

pub use canvas::ChartError;
pub use map::{MapFigure, MapPanel, MapScale};
pub use plane::{Mark, Marks, PlaneFigure};
pub use shapes::{ShapeFigure, ShapePanel};

/// A figure: panels stacked over a common horizontal axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// Quantity and unit of the horizontal axis.
    pub x_label: String,
    /// Whether the horizontal axis is logarithmic; points with non-positive x are omitted.
    pub log_x: bool,
    /// Panels, from top to bottom.
    pub panels: Vec<Panel>,
}

/// One plot of a figure.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Panel {
    /// Quantity and unit of the vertical axis.
    pub y_label: String,
    /// Curves.
    pub series: Vec<Series>,
    /// Whether the vertical axis is logarithmic; non-positive values are omitted.
    pub log: bool,
    /// Whether values are angles in degrees: ticks are then at fractions and multiples of a right angle.
    pub degrees: bool,
    /// Range of the vertical axis, outside of which curves are clipped; by default it contains all values.
    pub limits: Option<(f64, f64)>,
    /// Labelled horizontal lines, such as limits.
    pub marks: Vec<(f64, String)>,
    /// Single values without joining lines, such as published values or categories.
    pub dots: Vec<Dots>,
}

/// Single values, drawn as dots.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Dots {
    /// Name in the legend.
    pub name: String,
    /// Points; non-finite ones are omitted.
    pub points: Vec<(f64, f64)>,
    /// Standard deviations of y, drawn as error bars; empty for none.
    pub deviations: Vec<f64>,
}

/// A curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Points by ascending x; non-finite ones are omitted.
    pub points: Vec<(f64, f64)>,
}

const WIDTH: u32 = 1000;
const TITLE_HEIGHT: u32 = 48;
const PANEL_HEIGHT: u32 = 300;
const LEGEND_WIDTH: u32 = 190;
/// Radius of a dot.
const DOT: u32 = 4;
const GRID: RGBColor = RGBColor(226, 226, 226);
/// Colour of grid lines between the ticks.
const FINE_GRID: RGBColor = RGBColor(243, 243, 243);

/// Okabe and Ito's palette, which colour-blind readers can distinguish, without yellow, which is hardly visible on white.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

impl Figure {
    /// A figure over time in seconds, of the panels that have a curve; `None` if none has.
    pub fn over_time(title: &str, panels: Vec<Panel>) -> Option<Self> {
        let panels: Vec<_> = panels
            .into_iter()
            .filter(|p| p.series.iter().any(|s| s.points.len() > 1))
            .collect();
        (!panels.is_empty()).then(|| Self {
            title: title.into(),
            x_label: "time [s]".into(),
            panels,
            ..Self::default()
        })
    }

    /// Draws the figure to `stem.svg` and `stem.png`. Returns both paths.
    ///
    /// # Errors
    /// [`ChartError`] if a file cannot be written.
    pub fn save(&self, stem: &Path) -> Result<[PathBuf; 2], ChartError> {
        canvas::save(self, stem)
    }

    fn x_range(&self) -> Range<f64> {
        let lines = self.panels.iter().flat_map(|p| &p.series);
        let mut points = lines.flat_map(|s| &s.points).peekable();
        let is_lines = points.peek().is_some();
        let dots = self.panels.iter().flat_map(|p| &p.dots);
        let points = points.chain(dots.flat_map(|d| &d.points));
        let places = points.map(|p| if self.log_x { p.0.log10() } else { p.0 });
        let (low, high) = bounds(places).unwrap_or((0.0, 1.0));
        if !is_lines && low < high {
            // Room for dots at both ends.
            low - 0.35..high + 0.35
        } else if low < high {
            low..high
        } else {
            low - 0.5..high + 0.5
        }
    }
}

impl Drawing for Figure {
    fn size(&self) -> (u32, u32) {
        (
            WIDTH,
            TITLE_HEIGHT + PANEL_HEIGHT * self.panels.len() as u32,
        )
    }

    fn draw<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        pen: Pen,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let body = draw_title(area, pen, &self.title)?;
        let x = self.x_range();
        let last = self.panels.len().saturating_sub(1);
        for (i, (panel, area)) in self
            .panels
            .iter()
            .zip(body.split_evenly((self.panels.len().max(1), 1)))
            .enumerate()
        {
            let x_label = if i == last { self.x_label.as_str() } else { "" };
            panel.draw(&area, pen, (x.clone(), self.log_x), x_label)?;
        }
        Ok(())
    }
}

/// Draws a figure's title. Returns the remaining area.
fn draw_title<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    pen: Pen,
    text: &str,
) -> Result<DrawingArea<B, Shift>, DrawingAreaErrorKind<B::ErrorType>> {
    let scale = pen.scale;
    let (title, body) = area.split_vertically(TITLE_HEIGHT * scale);
    let style = (FONT, 22 * scale, FontStyle::Bold, &TEXT)
        .into_text_style(&title)
        .pos(Pos::new(HPos::Left, VPos::Center));
    let at = (20 * scale as i32, (TITLE_HEIGHT * scale / 2) as i32);
    title.draw_text(text, &style, at)?;
    Ok(body)
}

impl Panel {
    /// Position of a value on the axis: its logarithm on a logarithmic axis.
    fn height(&self, value: f64) -> f64 {
        if self.log { value.log10() } else { value }
    }

    fn y_range(&self) -> Range<f64> {
        let values = self.series.iter().flat_map(|s| &s.points).map(|p| p.1);
        let marks = self.marks.iter().map(|m| m.0);
        let dots = self.dots.iter().flat_map(Dots::extent);
        if let Some((low, high)) = self.limits {
            return self.height(low)..self.height(high);
        }
        let heights = values.chain(marks).chain(dots).map(|v| self.height(v));
        let (low, high) = bounds(heights).unwrap_or((-1.0, 1.0));
        if self.log {
            let (low, high) = (low.floor(), high.ceil());
            return if low < high {
                low..high
            } else {
                low - 1.0..high + 1.0
            };
        }
        let margin = match high - low {
            0.0 if high == 0.0 => 1.0,
            0.0 => 0.1 * high.abs(),
            span => 0.06 * span,
        };
        low - margin..high + margin
    }

    fn draw<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        pen: Pen,
        (x, log_x): (Range<f64>, bool),
        x_label: &str,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let scale = pen.scale;
        let width = area.dim_in_pixel().0 - LEGEND_WIDTH * scale;
        let (plot, legend) = area.split_horizontally(width);
        let y = self.y_range();
        let y_axis = match (self.log, self.degrees) {
            (true, _) => Axis::logarithms(y.clone()),
            (_, true) => Axis::degrees(y.clone(), 5),
            _ => Axis::linear(y.clone(), 6),
        };
        let (x_axis, fine) = match log_x {
            true => (Axis::decades(x.clone()), FINE_GRID.stroke_width(scale)),
            false => (Axis::linear(x.clone(), 9), TRANSPARENT.into()),
        };
        let place = |x: f64| if log_x { x.log10() } else { x };
        let mut chart = ChartBuilder::on(&plot)
            .margin_top(8 * scale)
            .margin_right(12 * scale)
            .margin_left(16 * scale)
            .x_label_area_size(if x_label.is_empty() { 30 } else { 46 } * scale)
            .y_label_area_size(72 * scale)
            .build_cartesian_2d(x_axis, y_axis)?;
        let small = (FONT, 15 * scale).into_font().color(&TEXT);
        chart
            .configure_mesh()
            .bold_line_style(GRID.stroke_width(scale))
            .light_line_style(fine)
            .axis_style(FAINT.stroke_width(scale))
            .set_all_tick_mark_size(5 * scale)
            .label_style(small.clone())
            .axis_desc_style((FONT, 16 * scale).into_font().color(&TEXT))
            .x_desc(x_label)
            .y_desc(&self.y_label)
            .draw()?;
        for (value, _) in &self.marks {
            let h = self.height(*value);
            let dash = 6 * scale;
            let ends = [(x.start, h), (x.end, h)];
            let style = FAINT.stroke_width(scale);
            chart.draw_series(DashedLineSeries::new(ends, dash, dash, style))?;
        }
        let curves: Vec<Vec<_>> = (self.series.iter())
            .map(|series| {
                let points = (series.points.iter()).map(|&(x, y)| (place(x), self.height(y)));
                thinned(
                    points
                        .filter(|p| p.0.is_finite() && p.1.is_finite())
                        .collect(),
                )
            })
            .collect();
        // Units of length per unit of each axis.
        let (columns, rows) = chart.plotting_area().dim_in_pixel();
        let unit = f64::from(scale);
        let per_x = f64::from(columns) / (x.end - x.start) / unit;
        let per_y = f64::from(rows) / (y.end - y.start) / unit;
        let on_paper = |p: &(f64, f64)| (p.0 * per_x, p.1 * per_y);
        let off_paper = |p: (f64, f64)| (p.0 / per_x, p.1 / per_y);
        let drawn: Vec<Vec<_>> = (curves.iter())
            .map(|curve| curve.iter().map(on_paper).collect())
            .collect();
        let patterns = dashes::patterns(&drawn);
        for (i, (curve, drawn)) in curves.into_iter().zip(drawn).enumerate() {
            let style = line(i, scale);
            let pieces = match patterns[i] {
                None => vec![curve],
                Some(pattern) => (dashes::dashed(&drawn, pattern).into_iter())
                    .map(|piece| piece.into_iter().map(off_paper).collect())
                    .collect(),
            };
            let cut = |piece: Vec<_>| match self.limits {
                Some(_) => clip::clipped(&piece, &x, &y),
                None => vec![piece],
            };
            for points in pieces.into_iter().flat_map(cut) {
                if pen.discs {
                    let pairs = points
                        .windows(2)
                        .map(|p| PathElement::new(p.to_vec(), style));
                    chart.draw_series(pairs)?;
                    let discs = points
                        .iter()
                        .map(|&p| Circle::new(p, scale, style.filled()));
                    chart.draw_series(discs)?;
                } else {
                    chart.draw_series(LineSeries::new(points, style))?;
                }
            }
        }
        for (i, dots) in self.dots.iter().enumerate() {
            let style = line(self.series.len() + i, scale);
            for (k, &(x, y)) in dots.points.iter().enumerate() {
                let bar = dots
                    .deviations
                    .get(k)
                    .map(|d| [y - d, y + d].map(|y| (place(x), self.height(y))));
                if let Some(bar) = bar.filter(|bar| bar.iter().all(|p| p.1.is_finite())) {
                    chart.draw_series([PathElement::new(bar.to_vec(), style)])?;
                }
                let at = (place(x), self.height(y));
                if at.0.is_finite() && at.1.is_finite() {
                    chart.draw_series([Circle::new(at, DOT * scale, style.filled())])?;
                }
            }
        }
        let lines = self.series.iter().zip(&patterns);
        let lines = lines.map(|(s, pattern)| (s.name.as_str(), Sign::Line(*pattern)));
        let dots = self.dots.iter().map(|d| (d.name.as_str(), Sign::Dot));
        let marks = self.marks.iter().map(|(_, name)| name.as_str());
        draw_legend(&legend, scale, lines.chain(dots), marks)
    }
}

impl Dots {
    /// All values, including the ends of the error bars.
    fn extent(&self) -> impl Iterator<Item = f64> {
        let deviation = |k: usize| self.deviations.get(k).copied().unwrap_or(0.0);
        let points = self.points.iter().enumerate();
        points.flat_map(move |(k, p)| [p.1 - deviation(k), p.1 + deviation(k)])
    }
}

fn line(i: usize, scale: u32) -> ShapeStyle {
    COLOURS[i % COLOURS.len()].stroke_width(2 * scale)
}

fn bounds(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.filter(|v| v.is_finite()).fold(None, |b, v| match b {
        None => Some((v, v)),
        Some((low, high)) => Some((low.min(v), high.max(v))),
    })
}

/// Reduces a curve to a few thousand points: the extremes in each of many narrow columns, so that peaks are kept.
fn thinned(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    const COLUMNS: usize = 1500;
    if points.len() <= 4 * COLUMNS {
        return points;
    }
    let size = points.len().div_ceil(COLUMNS);
    points
        .chunks(size)
        .flat_map(|column| {
            let by_y = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
            let mut pair: Vec<_> = [column.iter().min_by(by_y), column.iter().max_by(by_y)]
                .into_iter()
                .flatten()
                .copied()
                .collect();
            pair.sort_by(|a, b| a.0.total_cmp(&b.0));
            pair
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_peaks() {
        let mut points: Vec<_> = (0..100_000).map(|i| (i as f64, (i % 7) as f64)).collect();
        points[54_321].1 = 1000.0;
        let thin = thinned(points);
        assert!(thin.len() <= 3000);
        assert!(thin.contains(&(54_321.0, 1000.0)));
        assert!(thin.windows(2).all(|w| w[0].0 <= w[1].0));
    }

    #[test]
    fn pictures_are_drawn_whatever_the_numbers() {
        let dir = tempfile::tempdir().unwrap();
        let panel = |points: Vec<(f64, f64)>, log| Panel {
            y_label: "value [m]".into(),
            series: vec![Series {
                name: "curve".into(),
                points,
            }],
            log,
            degrees: false,
            limits: None,
            marks: vec![(0.01, "1 cm".into())],
            dots: vec![Dots {
                name: "printed".into(),
                points: vec![(1.0, 2.0), (2.0, f64::NAN)],
                deviations: vec![3.0],
            }],
        };
        let figure = Figure {
            title: "All kinds".into(),
            x_label: "time [s]".into(),
            log_x: false,
            panels: vec![
                panel(
                    (0..100)
                        .map(|i| (i as f64, (-0.1 * i as f64).exp()))
                        .collect(),
                    true,
                ),
                panel(
                    vec![(0.0, f64::NAN), (1.0, 2.0), (2.0, f64::INFINITY)],
                    false,
                ),
                panel(vec![], true),
                panel(vec![(3.0, 0.0), (4.0, 0.0)], true),
            ],
        };
        let [svg, png] = figure.save(&dir.path().join("picture")).unwrap();
        let svg = std::fs::read_to_string(svg).unwrap();
        // Letters and ticks are drawn, which means that the font was found.
        for text in [
            "All kinds",
            "time [s]",
            "value [m]",
            "curve",
            "printed",
            "1e-3",
        ] {
            assert!(svg.contains(text), "no {text:?}");
        }
        let png = std::fs::read(png).unwrap();
        assert!(png.starts_with(b"\x89PNG") && png.len() > 10_000);
        assert!(figure.save(Path::new("/nowhere/picture")).is_err());
    }

    #[test]
    fn frequency_responses_have_decades_and_right_angles() {
        let dir = tempfile::tempdir().unwrap();
        let points = (-20..=20).map(|i| {
            let w = 10f64.powf(0.1 * f64::from(i));
            (w, -w.atan2(1.0).to_degrees() * 4.0)
        });
        let panel = Panel {
            y_label: "phase [deg]".into(),
            series: vec![Series {
                name: "phase".into(),
                points: points.chain([(0.0, 1.0), (-1.0, 1.0)]).collect(),
            }],
            degrees: true,
            limits: Some((-270.0, 0.0)),
            ..Panel::default()
        };
        let figure = Figure {
            title: "Bode".into(),
            x_label: "frequency [rad/s]".into(),
            log_x: true,
            panels: vec![panel],
        };
        let [svg, _] = figure.save(&dir.path().join("bode")).unwrap();
        let svg = std::fs::read_to_string(svg).unwrap();
        for text in ["\n0.01\n", "\n1\n", "\n100\n", "\n-180\n", "\n-90\n"] {
            assert!(svg.contains(text), "no {text:?}");
        }
    }
}
