//! Legends, placed next to plots so that they cover nothing.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{FAINT, FONT, TEXT};
use super::{DOT, Mark, dashes, line};

/// Sign of a curve in the legend.
#[derive(Clone, Copy)]
pub(super) enum Sign {
    /// A line with dash and gap, or a solid line.
    Line(Option<(f64, f64)>),
    Dot,
    Mark(Mark),
}

/// Draws labels of curves and limits next to a plot.
pub(super) fn draw_legend<'a, B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    scale: u32,
    curves: impl Iterator<Item = (&'a str, Sign)>,
    marks: impl Iterator<Item = &'a str>,
) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
    let style = (FONT, 15 * scale)
        .into_text_style(area)
        .color(&TEXT)
        .pos(Pos::new(HPos::Left, VPos::Center));
    let unit = scale as i32;
    let curves = curves.enumerate();
    let curves = curves.map(|(i, (name, sign))| (Some((i, sign)), name));
    let marks = marks.map(|name| (None, name));
    for (row, (curve, name)) in curves.chain(marks).enumerate() {
        let y = unit * (22 + 24 * row as i32);
        let ends = vec![(4 * unit, y), (30 * unit, y)];
        match curve {
            Some((i, Sign::Line(None))) => area.draw(&PathElement::new(ends, line(i, scale)))?,
            Some((i, Sign::Line(Some(pattern)))) => {
                let line_to = [(4.0, 0.0), (30.0, 0.0)];
                for dash in dashes::dashed(&line_to, pattern) {
                    let ends = dash.iter().map(|p| ((p.0 * f64::from(unit)) as i32, y));
                    area.draw(&PathElement::new(ends.collect::<Vec<_>>(), line(i, scale)))?;
                }
            }
            Some((i, Sign::Dot)) => {
                let style = line(i, scale).filled();
                area.draw(&Circle::new((17 * unit, y), DOT * scale, style))?;
            }
            Some((i, Sign::Mark(mark))) => {
                for stroke in mark.strokes(DOT * scale) {
                    let stroke = stroke.map(|(x, dy)| (17 * unit + x, y + dy));
                    area.draw(&PathElement::new(
                        stroke.collect::<Vec<_>>(),
                        line(i, scale),
                    ))?;
                }
            }
            None => {
                for x in [4, 14, 24] {
                    let dash = vec![(x * unit, y), ((x + 6) * unit, y)];
                    area.draw(&PathElement::new(dash, FAINT.stroke_width(scale)))?;
                }
            }
        }
        area.draw_text(name, &style, (38 * unit, y))?;
    }
    Ok(())
}
