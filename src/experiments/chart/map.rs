//! Colour maps: a coloured cell for each point of a grid; several maps side by side with a common scale.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::path::{Path, PathBuf};

use super::canvas::{self, Drawing, FAINT, FONT, Pen, TEXT};
use super::{Axis, COLOURS, ChartError, TITLE_HEIGHT, bounds, draw_title};

/// A picture of maps over the same axes, up to three side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct MapFigure {
    /// Title.
    pub title: String,
    /// Quantity and unit of the horizontal axis.
    pub x_label: String,
    /// Quantity and unit of the vertical axis.
    pub y_label: String,
    /// Coordinates of the columns, from left to right.
    pub x: Vec<f64>,
    /// Coordinates of the rows, from the bottom up.
    pub y: Vec<f64>,
    /// Meaning of the colours.
    pub scale: MapScale,
    /// The maps, from left to right and from top to bottom.
    pub panels: Vec<MapPanel>,
}

/// One map.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapPanel {
    /// Title.
    pub title: String,
    /// Values column by column, each column from the bottom up. Cells without a value (non-finite, or non-positive on a
    /// logarithmic scale) are grey with a stroke. For classes, their numbers.
    pub values: Vec<f64>,
    /// Cells marked with a cross: indices in `values`.
    pub crosses: Vec<usize>,
    /// Coordinates of columns and rows, if they differ from the figure's: a coarser grid over the same area.
    pub grid: Option<(Vec<f64>, Vec<f64>)>,
}

/// Meaning of the colours.
#[derive(Debug, Clone, PartialEq)]
pub enum MapScale {
    /// A quantity with its unit, on a linear colour bar.
    Linear(String),
    /// A quantity with its unit, on a logarithmic colour bar. It spans the powers of ten that contain nine tenths of
    /// the values of each map, so that a few outliers do not compress the colours of the rest; outliers get the colour
    /// of the bar's end, which is then marked.
    Logarithms(String),
    /// Names of the classes 0, 1, ...
    Classes(Vec<String>),
}

const PANEL_WIDTH: i32 = 430;
const BAR_WIDTH: i32 = 140;
const LEFT: i32 = 66;
const TOP: i32 = 28;
const MAP_WIDTH: i32 = 350;
const MAP_HEIGHT: i32 = 420;
const BOTTOM: i32 = 62;
const PANEL_HEIGHT: i32 = TOP + MAP_HEIGHT + BOTTOM;
/// Number of maps side by side.
const COLUMNS: usize = 3;
const EMPTY: RGBColor = RGBColor(222, 222, 222);
/// Largest number of powers of ten on a colour bar.
const DECADES: f64 = 8.0;
/// The fraction of a map's values that may lie beyond either end of a logarithmic colour bar.
const ASTRAY: f64 = 0.05;
/// Largest number of labels on an axis.
const LABELS: usize = 11;

impl MapFigure {
    /// Draws the figure to `stem.svg` and `stem.png`; returns both paths.
    ///
    /// # Errors
    /// [`ChartError`] if a file cannot be written.
    pub fn save(&self, stem: &Path) -> Result<[PathBuf; 2], ChartError> {
        canvas::save(self, stem)
    }

    /// Position of a value on the colour bar; not finite if there is no value.
    fn level(&self, value: f64) -> f64 {
        match self.scale {
            MapScale::Logarithms(_) if value > 0.0 => value.log10(),
            MapScale::Logarithms(_) => f64::NAN,
            _ => value,
        }
    }

    /// Lowest and highest level of all panels.
    fn extremes(&self) -> Option<(f64, f64)> {
        let values = self.panels.iter().flat_map(|p| &p.values);
        bounds(values.map(|v| self.level(*v)))
    }

    /// The ends of the colour bar.
    fn range(&self) -> (f64, f64) {
        let (low, high) = match self.scale {
            MapScale::Logarithms(_) => {
                let ends = self.panels.iter().filter_map(|p| self.bulk(p));
                let (low, high) = bounds(ends.flat_map(|(a, b)| [a, b])).unwrap_or((0.0, 1.0));
                (low.floor().max(high.ceil() - DECADES), high.ceil())
            }
            _ => self.extremes().unwrap_or((0.0, 1.0)),
        };
        if low < high {
            (low, high)
        } else {
            (low, low + 1.0)
        }
    }

    /// Range of levels that contains most values of a map.
    fn bulk(&self, panel: &MapPanel) -> Option<(f64, f64)> {
        let levels = panel.values.iter().map(|v| self.level(*v));
        let mut levels: Vec<_> = levels.filter(|l| l.is_finite()).collect();
        levels.sort_by(f64::total_cmp);
        let skipped = (ASTRAY * levels.len() as f64) as usize;
        let low = levels.get(skipped)?;
        Some((*low, levels[levels.len() - 1 - skipped]))
    }

    fn colour(&self, value: f64, (low, high): (f64, f64)) -> Option<RGBColor> {
        let level = self.level(value);
        if !level.is_finite() {
            return None;
        }
        Some(match self.scale {
            MapScale::Classes(_) => COLOURS[level as usize % COLOURS.len()],
            _ => ViridisRGB.get_color(((level - low) / (high - low)).clamp(0.0, 1.0) as f32),
        })
    }
}

/// A drawing area addressed in units of length.
struct Sheet<'a, B: DrawingBackend> {
    area: &'a DrawingArea<B, Shift>,
    scale: i32,
    /// Position of the origin.
    at: (i32, i32),
}

type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

impl<B: DrawingBackend> Sheet<'_, B> {
    fn place(&self, (x, y): (f64, f64)) -> (i32, i32) {
        let scaled =
            |v: f64, origin: i32| ((v + f64::from(origin)) * f64::from(self.scale)).round();
        (scaled(x, self.at.0) as i32, scaled(y, self.at.1) as i32)
    }

    fn fill(&self, a: (f64, f64), b: (f64, f64), colour: RGBColor) -> Drawn<B> {
        let corners = [self.place(a), self.place(b)];
        self.area.draw(&Rectangle::new(corners, colour.filled()))
    }

    fn line(&self, a: (f64, f64), b: (f64, f64), colour: RGBColor, width: u32) -> Drawn<B> {
        let style = colour.stroke_width(width * self.scale as u32);
        let ends = vec![self.place(a), self.place(b)];
        self.area.draw(&PathElement::new(ends, style))
    }

    fn text(&self, text: &str, at: (f64, f64), size: u32, anchor: Pos, turned: bool) -> Drawn<B> {
        let font = (FONT, size * self.scale as u32).into_font();
        let font = match turned {
            true => font.transform(FontTransform::Rotate270),
            false => font,
        };
        let style = font.color(&TEXT).pos(anchor);
        self.area.draw_text(text, &style, self.place(at))
    }
}

impl Drawing for MapFigure {
    fn size(&self) -> (u32, u32) {
        let panels = self.panels.len().max(1);
        let (columns, rows) = (panels.min(COLUMNS) as i32, panels.div_ceil(COLUMNS) as i32);
        (
            (columns * PANEL_WIDTH + BAR_WIDTH) as u32,
            TITLE_HEIGHT + (rows * PANEL_HEIGHT) as u32,
        )
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, pen: Pen) -> Drawn<B> {
        let body = draw_title(area, pen, &self.title)?;
        let mut sheet = Sheet {
            area: &body,
            scale: pen.scale as i32,
            at: (0, 0),
        };
        let range = self.range();
        for (i, panel) in self.panels.iter().enumerate() {
            let (column, row) = ((i % COLUMNS) as i32, (i / COLUMNS) as i32);
            sheet.at = (column * PANEL_WIDTH, row * PANEL_HEIGHT);
            self.draw_panel(&sheet, panel, range)?;
        }
        sheet.at = (self.panels.len().min(COLUMNS) as i32 * PANEL_WIDTH, 0);
        match &self.scale {
            MapScale::Classes(names) => self.draw_classes(&sheet, names),
            MapScale::Linear(label) => draw_bar(&sheet, label, range, None),
            MapScale::Logarithms(label) => {
                let extremes = self.extremes().unwrap_or(range);
                draw_bar(&sheet, label, range, Some(extremes))
            }
        }
    }
}

impl MapFigure {
    fn draw_panel<B: DrawingBackend>(
        &self,
        sheet: &Sheet<'_, B>,
        panel: &MapPanel,
        range: (f64, f64),
    ) -> Drawn<B> {
        let own = panel.grid.as_ref();
        let (x, y) = own.map_or((&self.x, &self.y), |(x, y)| (x, y));
        let (columns, rows) = (x.len().max(1), y.len().max(1));
        let width = f64::from(MAP_WIDTH) / columns as f64;
        let height = f64::from(MAP_HEIGHT) / rows as f64;
        let (left, bottom) = (f64::from(LEFT), f64::from(TOP + MAP_HEIGHT));
        for (i, value) in panel.values.iter().take(columns * rows).enumerate() {
            let (column, row) = ((i / rows) as f64, (i % rows) as f64);
            let low = (left + column * width, bottom - row * height);
            let high = (low.0 + width, low.1 - height);
            match self.colour(*value, range) {
                Some(colour) => sheet.fill((low.0, high.1), (high.0, low.1), colour)?,
                None => {
                    sheet.fill((low.0, high.1), (high.0, low.1), EMPTY)?;
                    sheet.line(low, high, FAINT, 1)?;
                }
            }
        }
        for &i in &panel.crosses {
            let (column, row) = ((i / rows) as f64, (i % rows) as f64);
            let middle = (left + (column + 0.5) * width, bottom - (row + 0.5) * height);
            let arm = 0.3 * width.min(height);
            for side in [arm, -arm] {
                let (a, b) = (
                    (middle.0 - arm, middle.1 - side),
                    (middle.0 + arm, middle.1 + side),
                );
                sheet.line(a, b, BLACK, 2)?;
            }
        }
        let middle = left + 0.5 * f64::from(MAP_WIDTH);
        let above = Pos::new(HPos::Center, VPos::Center);
        sheet.text(
            &panel.title,
            (middle, 0.5 * f64::from(TOP)),
            16,
            above,
            false,
        )?;
        let below = Pos::new(HPos::Center, VPos::Top);
        for (i, label) in labels(x) {
            let x = left + (i + 0.5) * width;
            sheet.line((x, bottom), (x, bottom + 4.0), FAINT, 1)?;
            sheet.text(&label, (x, bottom + 7.0), 14, below, false)?;
        }
        sheet.text(&self.x_label, (middle, bottom + 32.0), 16, below, false)?;
        let alignment = Pos::new(HPos::Right, VPos::Center);
        for (i, label) in labels(y) {
            let y = bottom - (i + 0.5) * height;
            sheet.line((left - 4.0, y), (left, y), FAINT, 1)?;
            sheet.text(&label, (left - 8.0, y), 14, alignment, false)?;
        }
        let centre = Pos::new(HPos::Center, VPos::Center);
        let half = bottom - 0.5 * f64::from(MAP_HEIGHT);
        sheet.text(&self.y_label, (14.0, half), 16, centre, true)
    }

    fn draw_classes<B: DrawingBackend>(&self, sheet: &Sheet<'_, B>, names: &[String]) -> Drawn<B> {
        let alignment = Pos::new(HPos::Left, VPos::Center);
        for (i, name) in names.iter().enumerate() {
            let y = f64::from(TOP) + 26.0 * i as f64;
            sheet.fill((0.0, y), (18.0, y + 18.0), COLOURS[i % COLOURS.len()])?;
            sheet.text(name, (26.0, y + 9.0), 14, alignment, false)?;
        }
        Ok(())
    }
}

/// Draws the colour bar: logarithmic if `extremes` are given, the range of the values, which may exceed that of the
/// bar.
fn draw_bar<B: DrawingBackend>(
    sheet: &Sheet<'_, B>,
    label: &str,
    (low, high): (f64, f64),
    extremes: Option<(f64, f64)>,
) -> Drawn<B> {
    const STEPS: i32 = 140;
    let (top, height) = (f64::from(TOP), f64::from(MAP_HEIGHT));
    for i in 0..STEPS {
        let part = f64::from(i) / f64::from(STEPS);
        let y = top + height * (1.0 - part);
        let next = y - height / f64::from(STEPS);
        let colour = ViridisRGB.get_color((part + 0.5 / f64::from(STEPS)) as f32);
        sheet.fill((0.0, next), (20.0, y), colour)?;
    }
    let axis = match extremes {
        Some(_) => super::Axis::logarithms(low..high),
        None => super::Axis::linear(low..high, 8),
    };
    let (least, most) = extremes.unwrap_or((low, high));
    let alignment = Pos::new(HPos::Left, VPos::Center);
    for (value, name) in axis.labels() {
        let y = top + height * (1.0 - (value - low) / (high - low));
        sheet.line((20.0, y), (25.0, y), FAINT, 1)?;
        let name = match value {
            _ if value >= high && most > high => format!("≥ {name}"),
            _ if value <= low && least < low => format!("≤ {name}"),
            _ => name,
        };
        sheet.text(&name, (29.0, y), 14, alignment, false)?;
    }
    let centre = Pos::new(HPos::Center, VPos::Center);
    sheet.text(label, (88.0, top + 0.5 * height), 16, centre, true)
}

/// Labels and their positions in units of cells: all values if there are few; round numbers for many equally spaced
/// values.
fn labels(values: &[f64]) -> Vec<(f64, String)> {
    let step = values.len().div_ceil(LABELS).max(1);
    let plain = |(i, v): (usize, &f64)| {
        // Adding zero turns -0 into 0.
        let text = format!("{:.2}", v + 0.0);
        let short = text.trim_end_matches('0').trim_end_matches('.').to_owned();
        (i as f64, short)
    };
    if let (true, [first, second, .., last]) = (step > 1, values) {
        let width = second - first;
        let is_even = |w: &[f64]| (w[1] - w[0] - width).abs() < 1e-6 * width.abs();
        if width > 0.0 && values.windows(2).all(is_even) {
            let axis = Axis::linear(*first..*last, 6);
            let place = |(v, text): (f64, String)| ((v - first) / width, text);
            return axis.labels().map(place).collect();
        }
    }
    values.iter().enumerate().step_by(step).map(plain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(scale: MapScale, values: [f64; 6]) -> MapFigure {
        MapFigure {
            title: "A map".into(),
            x_label: "e".into(),
            y_label: "s".into(),
            x: vec![0.25, 0.5],
            y: vec![-1.0, 0.0, 1.0],
            scale,
            panels: vec![MapPanel {
                title: "left".into(),
                values: values.to_vec(),
                crosses: vec![1],
                grid: None,
            }],
        }
    }

    fn svg(figure: &MapFigure) -> String {
        let dir = tempfile::tempdir().unwrap();
        let [svg, png] = figure.save(&dir.path().join("map")).unwrap();
        assert!(std::fs::read(png).unwrap().starts_with(b"\x89PNG"));
        std::fs::read_to_string(svg).unwrap()
    }

    /// The ends of the colour scale are the smallest and largest value; values without a logarithm are grey.
    #[test]
    fn colours_follow_the_values() {
        let values = [1e-3, 1e-2, 1e-1, 0.0, f64::NAN, 1.0];
        let map = figure(MapScale::Logarithms("r [-]".into()), values);
        let range = map.range();
        assert_eq!(range, (-3.0, 0.0));
        let ends = [ViridisRGB.get_color(0.0f32), ViridisRGB.get_color(1.0f32)];
        assert_eq!(
            [map.colour(1e-3, range), map.colour(1.0, range)],
            ends.map(Some)
        );
        assert_eq!(
            [0.0, -1.0, f64::NAN].map(|v| map.colour(v, range)),
            [None; 3]
        );
        let svg = svg(&map);
        let drawn = |text: &str| svg.matches(text).count();
        assert_eq!(drawn("#DEDEDE"), 2, "two cells without a value");
        // Rounding errors do not compress the colours.
        let label = || MapScale::Logarithms("r [-]".into());
        let map = figure(label(), [1e-15, 1e-3, 1.0, 1.0, 0.1, 0.1]);
        assert_eq!(map.range(), (-8.0, 0.0));
        for text in ["A map", "left", "r [-]", "1e-3", "1e0", "0.25", "-1\n"] {
            assert!(drawn(text) > 0, "no {text:?}");
        }
    }

    /// An outlier has the colour of the end, which is marked.
    #[test]
    fn a_few_values_do_not_set_the_colours_of_the_rest() {
        let mut map = figure(MapScale::Logarithms("r [-]".into()), [0.0; 6]);
        map.x = (0..7).map(f64::from).collect();
        map.panels[0].values = (0..21).map(|i| 2e-3 * f64::from(i + 1)).collect();
        assert_eq!(map.range(), (-3.0, -1.0));
        assert!(!svg(&map).contains('≥'));
        map.panels[0].values[4] = 1e7;
        assert_eq!(map.range(), (-3.0, -1.0));
        assert_eq!(map.colour(1e7, map.range()), map.colour(0.1, map.range()));
        let drawn = svg(&map);
        assert!(drawn.contains("≥ 1e-1") && !drawn.contains('≤'), "{drawn}");
    }

    /// A coarser map covers the same area with larger cells.
    #[test]
    fn a_map_may_have_a_coarser_grid() {
        let mut map = figure(MapScale::Linear("T [s]".into()), [1.0; 6]);
        map.panels.push(MapPanel {
            values: vec![2.0],
            grid: Some((vec![7.5], vec![8.5])),
            ..MapPanel::default()
        });
        let drawn = svg(&map);
        assert!(
            drawn.contains("7.5\n") && drawn.contains("8.5\n"),
            "{drawn}"
        );
    }

    #[test]
    fn classes_have_a_legend_and_maps_may_be_empty() {
        let names = ["one", "two", "three"].map(String::from).to_vec();
        let map = figure(MapScale::Classes(names), [0.0, 1.0, 2.0, 0.0, 1.0, 1.0]);
        let svg_text = svg(&map);
        for text in ["one", "two", "three"] {
            assert!(svg_text.contains(text), "no {text:?}");
        }
        svg(&figure(MapScale::Linear("T [s]".into()), [7.0; 6]));
        svg(&figure(MapScale::Linear("T [s]".into()), [f64::NAN; 6]));
        assert!(map.save(Path::new("/nowhere/map")).is_err());
    }

    #[test]
    fn ticks_are_round_and_six_maps_fit_a_page() {
        let grid: Vec<f64> = (0..75).map(|k| -4.2 + 0.15 * f64::from(k)).collect();
        let texts: Vec<_> = labels(&grid).into_iter().map(|l| l.1).collect();
        assert_eq!(texts, ["-4", "-2", "0", "2", "4", "6"]);
        let at = labels(&grid)[2].0;
        assert!(
            (at - 28.0).abs() < 1e-9,
            "zero is the 28th cell, not at {at}"
        );
        let few: Vec<_> = labels(&[0.35, 0.5, 1.0]).into_iter().map(|l| l.1).collect();
        assert_eq!(few, ["0.35", "0.5", "1"]);
        let mut six = figure(MapScale::Linear("w".into()), [0.0; 6]);
        six.panels = vec![six.panels[0].clone(); 6];
        assert!(six.size().0 < 1500, "{:?}", six.size());
    }
}
