//! Axes with ticks at round numbers.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// A linear axis with round ticks, or a logarithmic axis with powers of ten.
pub(super) struct Axis {
    range: Range<f64>,
    ticks: Vec<f64>,
    /// Positions of unlabelled grid lines between the ticks.
    minor: Vec<f64>,
    labels: Labels,
}

/// Format of the tick labels.
enum Labels {
    /// As decimals, with as many digits as distinguish the ticks.
    Decimals(usize),
    /// As powers of ten; positions are logarithms.
    Powers,
    /// As decimal numbers; positions are logarithms.
    Numbers,
}

impl Axis {
    /// A linear axis with about `wanted` ticks, at round numbers.
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
        Self::with_step(range, step)
    }

    /// An axis for angles in degrees, with about `wanted` ticks at fractions and multiples of a right angle.
    pub fn degrees(range: Range<f64>, wanted: usize) -> Self {
        const STEPS: [f64; 5] = [15.0, 30.0, 45.0, 90.0, 180.0];
        let rough = (range.end - range.start) / wanted as f64;
        if rough < STEPS[0] {
            return Self::linear(range, wanted);
        }
        let step = STEPS.into_iter().find(|step| *step >= rough);
        Self::with_step(range, step.unwrap_or(360.0 * (rough / 360.0).ceil()))
    }

    fn with_step(range: Range<f64>, step: f64) -> Self {
        let first = (range.start / step).ceil() as i64;
        let last = (range.end / step).floor() as i64;
        Self {
            range,
            // Adding zero turns -0 into 0.
            ticks: (first..=last).map(|i| i as f64 * step + 0.0).collect(),
            minor: Vec::new(),
            labels: Labels::Decimals((-step.log10().floor()).clamp(0.0, 12.0) as usize),
        }
    }

    /// A logarithmic axis with at most about eight ticks, at powers of ten.
    pub fn logarithms(range: Range<f64>) -> Self {
        let (first, last) = (range.start.ceil() as i64, range.end.floor() as i64);
        let step = ((last - first) / 8 + 1) as usize;
        Self {
            range,
            ticks: (first..=last).step_by(step).map(|i| i as f64).collect(),
            minor: Vec::new(),
            labels: Labels::Powers,
        }
    }

    /// A logarithmic axis with ticks at powers of ten, labelled as numbers, and grid lines at their multiples. Below
    /// two powers of ten there are also ticks at 2 and 5 times the powers.
    pub fn decades(range: Range<f64>) -> Self {
        let inside = |v: &f64| (range.start - 1e-9..=range.end + 1e-9).contains(v);
        let decades = (range.start.floor() as i64..=range.end.ceil() as i64).map(|i| i as f64);
        let multiples = |factors: &[f64]| -> Vec<f64> {
            let all = (decades.clone()).flat_map(|d| factors.iter().map(move |f| d + f.log10()));
            all.filter(inside).collect()
        };
        let powers = multiples(&[1.0]);
        let ticks = match powers.len() {
            0..=2 => multiples(&[1.0, 2.0, 5.0]),
            count => powers.into_iter().step_by(count / 9 + 1).collect(),
        };
        let minor = match range.end - range.start {
            span if span < 7.0 => multiples(&[2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]),
            _ => Vec::new(),
        };
        Self {
            ticks,
            minor,
            labels: Labels::Numbers,
            range,
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

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        match hint.weight().allow_light_points() {
            true => self.minor.clone(),
            false => self.ticks.clone(),
        }
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
        match self.labels {
            Labels::Decimals(decimals) => format!("{value:.decimals$}"),
            Labels::Powers => format!("1e{value:.0}"),
            Labels::Numbers if (-4.01..6.01).contains(value) => {
                let decimals = (-value.floor()).max(0.0) as usize;
                format!("{:.decimals$}", 10f64.powf(*value))
            }
            Labels::Numbers => format!("{:.0e}", 10f64.powf(*value)),
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
        assert_eq!(labels(Axis::decades(-2.0..1.2)), ["0.01", "0.1", "1", "10"]);
        assert_eq!(labels(Axis::decades(-0.1..1.1)), ["1", "2", "5", "10"]);
        assert_eq!(labels(Axis::decades(-0.8..-0.6)), ["0.2"]);
        assert!(labels(Axis::decades(-30.0..0.0)).len() <= 9);
        assert_eq!(
            labels(Axis::degrees(-400.0..10.0, 5)),
            ["-360", "-270", "-180", "-90", "0"]
        );
        assert_eq!(labels(Axis::degrees(-3600.0..0.0, 5)).len(), 6);
    }
}
