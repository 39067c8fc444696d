//! Plots of a campaign.

use std::path::{Path, PathBuf};

use fuyu_campaign::success_interval;

use super::{
    CampaignError, Dataset, Summary,
    row::{ColumnKind, Row, Verdict},
    summary::Table,
};
use crate::experiments::{Figure, Mark, Marks, Panel, PlaneFigure, Series};

/// Maximum number of points of a curve or of a scatter plot.
const MOST_POINTS: usize = 2000;

/// Number of scatter plots, which show the strongest rank correlations.
const SCATTER_PLOTS: usize = 8;

/// Weakest rank correlation for which a scatter plot is drawn.
const WEAKEST: f64 = 0.1;

/// Draws success rate over number of runs, the distribution of each numeric result, and the strongest dependences of
/// results on parameters into `folder`, as SVG and PNG. Returns the SVG files.
///
/// # Errors
/// [`CampaignError`] if the dataset cannot be read or a picture not be written.
pub fn plot(
    dataset: &Dataset,
    summary: &Summary,
    folder: &Path,
) -> Result<Vec<PathBuf>, CampaignError> {
    let rows = dataset.rows()?;
    let runtime = |e: String| CampaignError::Runtime(e);
    std::fs::create_dir_all(folder)
        .map_err(|e| runtime(format!("{}: cannot be created: {e}", folder.display())))?;
    let manifest = dataset.manifest();
    let table = Table {
        rows: &rows,
        parameters: &manifest.parameters,
        results: &manifest.results,
    };
    let title = |what: &str| format!("{}: {what}", manifest.name);
    let mut files = Vec::new();
    let mut keep = |saved: Result<[PathBuf; 2], crate::experiments::ChartError>| {
        let [svg, _] = saved.map_err(|e| runtime(e.to_string()))?;
        files.push(svg);
        Ok::<(), CampaignError>(())
    };
    if !rows.is_empty() {
        let confidence = summary.confidence_interval.map_or(0.95, |i| i.confidence);
        let figure = success_rate(&rows, confidence, title("success rate"));
        keep(figure.save(&folder.join("success_rate")))?;
    }
    for column in manifest
        .results
        .iter()
        .filter(|c| c.kind != ColumnKind::Text)
    {
        let numbers = table.numbers(&column.name).unwrap_or_default();
        if let Some(figure) = distribution(&column.name, numbers, title("distribution")) {
            keep(figure.save(&folder.join(file_name(&["distribution", &column.name]))))?;
        }
    }
    let strong = summary.sensitivities.iter();
    let strong = strong.filter(|s| s.result != "success" && s.rho.abs() >= WEAKEST);
    for sensitivity in strong.take(SCATTER_PLOTS) {
        let (parameter, result) = (&sensitivity.parameter, &sensitivity.result);
        let pair = (table.numbers(parameter), table.numbers(result));
        let (Some(x), Some(y)) = pair else { continue };
        let figure = PlaneFigure {
            title: title(&format!("rank correlation {:.2}", sensitivity.rho)),
            x_label: parameter.clone(),
            y_label: result.clone(),
            marks: marks(&rows, &x, &y),
            stretched: true,
            ..PlaneFigure::default()
        };
        keep(figure.save(&folder.join(file_name(&["scatter", result, parameter]))))?;
    }
    Ok(files)
}

/// A file name from the names of columns.
fn file_name(parts: &[&str]) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let parts = parts
        .iter()
        .map(|part| part.chars().map(plain).collect::<String>());
    let name = parts.collect::<Vec<_>>().join("-");
    name.replace("_-", "-").trim_end_matches('_').to_owned()
}

/// At most [`MOST_POINTS`] indices below `count`, including the last one.
fn thinned(count: usize) -> impl Iterator<Item = usize> {
    let step = count.div_ceil(MOST_POINTS).max(1);
    (0..count).filter(move |i| i % step == 0 || i + 1 == count)
}

fn success_rate(rows: &[Row], confidence: f64, title: String) -> Figure {
    let mut curves = [Vec::new(), Vec::new(), Vec::new()];
    let mut successes = Vec::with_capacity(rows.len());
    let mut sum = 0;
    for row in rows {
        sum += u64::from(row.verdict == Verdict::Success);
        successes.push(sum);
    }
    for i in thinned(rows.len()) {
        let n = i as u64 + 1;
        let interval = success_interval(successes[i], n, confidence);
        let values = [
            successes[i] as f64 / n as f64,
            interval.lower,
            interval.upper,
        ];
        for (curve, value) in curves.iter_mut().zip(values) {
            curve.push((n as f64, value));
        }
    }
    let percent = 100.0 * confidence;
    let names = [
        "success rate".to_owned(),
        format!("{percent} % interval: lower"),
        format!("{percent} % interval: upper"),
    ];
    let series = names
        .into_iter()
        .zip(curves)
        .map(|(name, points)| Series { name, points });
    Figure {
        title,
        x_label: "number of runs".to_owned(),
        panels: vec![Panel {
            y_label: "share".to_owned(),
            series: series.collect(),
            ..Panel::default()
        }],
        ..Figure::default()
    }
}

/// Empirical distribution: the share of runs up to each value.
fn distribution(name: &str, mut numbers: Vec<f64>, title: String) -> Option<Figure> {
    numbers.retain(|x| x.is_finite());
    numbers.sort_by(f64::total_cmp);
    if numbers.first()? == numbers.last()? {
        return None;
    }
    let count = numbers.len();
    let points = thinned(count).map(|i| (numbers[i], (i as f64 + 0.5) / count as f64));
    Some(Figure {
        title,
        x_label: name.to_owned(),
        panels: vec![Panel {
            y_label: "share of runs below".to_owned(),
            series: vec![Series {
                name: format!("{count} runs"),
                points: points.collect(),
            }],
            ..Panel::default()
        }],
        ..Figure::default()
    })
}

/// Scatter points: successes and other runs with different signs.
fn marks(rows: &[Row], x: &[f64], y: &[f64]) -> Vec<Marks> {
    let of = |is_success: bool| {
        let points =
            thinned(rows.len()).filter(|i| (rows[*i].verdict == Verdict::Success) == is_success);
        points.map(|i| (x[i], y[i])).collect::<Vec<_>>()
    };
    let kinds = [
        ("success", Mark::Plus, of(true)),
        ("no success", Mark::Cross, of(false)),
    ];
    let kinds = kinds
        .into_iter()
        .filter(|(_, _, points)| !points.is_empty());
    kinds
        .map(|(name, mark, points)| Marks {
            name: name.to_owned(),
            mark,
            points,
        })
        .collect()
}
