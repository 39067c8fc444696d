//! Axes with ticks at round numbers.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// A linear axis with round ticks, or a logarithmic axis with powers of ten.
pub(super) struct Axis {
    range: Range<f64>,
    ticks: Vec<f64>,
    /// Decimals needed to distinguish the ticks; `None` on a logarithmic axis.
    decimals: Option<usize>,
}

impl Axis {
    /// About `wanted` ticks, at round numbers.
    pub fn linear(range: Range<f64>, wanted: usize) -> Self {
        let rough = (range.end - range.start) / wanted as f64;
        let power = 10f64.powf(rough.log10().floor());
        let step = power
            * match rough / power {
                r if r <= 1.0 => 1.0,
                r if r <= 2.0 => 2.0,
                r if r <= 5.0 => 5.0,
                _ => 10.0,
            };
        let first = (range.start / step).ceil() as i64;
        let last = (range.end / step).floor() as i64;
        Self {
            range,
            // Adding zero turns -0 into 0.
            ticks: (first..=last).map(|i| i as f64 * step + 0.0).collect(),
            decimals: Some((-step.log10().floor()).clamp(0.0, 12.0) as usize),
        }
    }

    /// At most about eight ticks, at powers of ten.
    pub fn logarithms(range: Range<f64>) -> Self {
        let (first, last) = (range.start.ceil() as i64, range.end.floor() as i64);
        let step = ((last - first) / 8 + 1) as usize;
        Self {
            range,
            ticks: (first..=last).step_by(step).map(|i| i as f64).collect(),
            decimals: None,
        }
    }
}

impl Axis {
    /// The ticks with their labels.
    pub fn labels(&self) -> impl Iterator<Item = (f64, String)> {
        self.ticks.iter().map(|v| (*v, self.format_ext(v)))
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let part = (value - self.range.start) / (self.range.end - self.range.start);
        limit.0 + (part * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

impl ValueFormatter<f64> for Axis {
    fn format(value: &f64) -> String {
        value.to_string()
    }

    fn format_ext(&self, value: &f64) -> String {
        match self.decimals {
            Some(decimals) => format!("{value:.decimals$}"),
            None => format!("1e{value:.0}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        let labels =
            |axis: Axis| -> Vec<String> { axis.ticks.iter().map(|v| axis.format_ext(v)).collect() };
        assert_eq!(labels(Axis::linear(-0.31..1.07, 6)), ["0.0", "0.5", "1.0"]);
        assert_eq!(
            labels(Axis::linear(0.0..60.0, 8)),
            ["0", "10", "20", "30", "40", "50", "60"]
        );
        assert_eq!(
            labels(Axis::logarithms(-3.0..0.0)),
            ["1e-3", "1e-2", "1e-1", "1e0"]
        );
        assert!(labels(Axis::logarithms(-30.0..0.0)).len() <= 9);
    }
}
