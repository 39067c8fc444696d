//! Figs. 3.18 to 3.26 and 3.31 to 3.52: error maps over all kinds of motion, by both methods.

use super::claims::Quantity::{Attitude, Axis, Parameters};
use super::claims::{
    BETAS, POINTS, Quantity, RESOLUTIONS, asymmetric, at_speed, points, preprocessing, resolution,
    speed, typical,
};
use super::model_tables::SEEDS;
use super::statistics::{largest, list_errors, median};
use super::study::{Source, Study};
use super::{Report, map, number};
use crate::estimation::EstimationMethod;
use crate::experiments::{MapPanel, MapScale};

/// The quantity and the case of a figure.
fn case(figure: usize) -> (Quantity, Study, usize) {
    match figure {
        18..=26 => {
            let study = match (figure - 18) % 3 {
                0 => Study::of(Source::TrueRates),
                1 => Study::of(Source::TrueRotations),
                _ => Study::images(1024, 20),
            };
            let quantity = [Parameters, Attitude, Axis][(figure - 18) / 3];
            (quantity, study, (figure - 18) % 3)
        }
        31..=36 => {
            let i = (figure - 31) % 3;
            let quantity = [Parameters, Axis][(figure - 31) / 3];
            (quantity, Study::images(RESOLUTIONS[i], 20), i)
        }
        37..=42 => {
            let i = (figure - 37) % 3;
            let quantity = [Parameters, Axis][(figure - 37) / 3];
            (quantity, Study::images(1024, POINTS[i]), i)
        }
        _ => {
            let i = (figure - 43) % 5;
            let quantity = [Parameters, Axis][(figure - 43) / 5];
            (quantity, at_speed(BETAS[i]), i)
        }
    }
}

pub(super) fn error_map(mut report: Report) -> Report {
    let number = number(&report).to_owned();
    let figure = number.strip_prefix("3.").and_then(|n| n.parse().ok());
    let (quantity, study, i) = case(figure.unwrap_or_default());
    let methods: &[EstimationMethod] = match study.source {
        Source::Images { .. } => &[EstimationMethod::Masutani1995, EstimationMethod::Bundle],
        _ => &[EstimationMethod::Masutani1995],
    };
    match figure.unwrap_or_default() {
        18..=26 => preprocessing(&mut report, quantity, i),
        31..=36 => resolution(&mut report, quantity, i),
        37..=42 => points(&mut report, quantity, i),
        _ => speed(&mut report, quantity, i),
    }
    reference(&mut report, quantity, &study);
    if methods.len() > 1 {
        past_the_thesis(&mut report, &study);
    }
    list_errors(&mut report, &study, methods);
    report.note(
        "Where the axisymmetric model answers for a body that is nearly a sphere, (2.52) may give moments that are \
         far off; the text does not mention it.",
    );
    report.note(
        "The figure is a picture of a surface without readable values: the rows hold the computed map to what the \
         text says of it. Grey: no estimate.",
    );
    let panel = |method: &EstimationMethod| {
        let cells = study.cells(*method);
        let asked = (0..cells.len()).filter(|k| study.is_evaluated(*k, *method));
        MapPanel {
            title: format!("{}: {}", method.name(), study.condition()),
            values: asked.map(|k| quantity.of(&cells[k])).collect(),
            crosses: Vec::new(),
            grid: study.part(*method).map(|g| (g.isotropies, g.momenta)),
        }
    };
    let picture = map(
        format!("Masutani 1995 Fig. {number}: {}", quantity.label()),
        &study.grid(),
        MapScale::Logarithms(quantity.label().to_owned()),
        methods.iter().map(panel).collect(),
    );
    report.maps.push((report.name.clone(), picture));
    report
}

/// Medians of an independent implementation over asymmetric cells.
fn reference(report: &mut Report, quantity: Quantity, study: &Study) {
    let known = match study.source {
        _ if study.coarse => None,
        // Known to one digit; for two of its motions there are more digits, which agree.
        Source::TrueRates => Some((5.5e-5, 0.45)),
        Source::TrueRotations => Some((0.0052, 2.5)),
        Source::Images {
            points: 20,
            resolution,
            ..
        } => match resolution {
            1024 => Some((0.0072, 3.7)),
            512 => Some((0.0085, 4.3)),
            _ => Some((0.0105, 4.8)),
        },
        Source::Images { .. } => None,
    };
    let expected: f64 = match (known, quantity) {
        (Some((r, _)), Parameters) => r,
        (Some((_, phi)), Axis) => phi,
        _ => return,
    };
    let from_images = matches!(study.source, Source::Images { .. });
    let seeds = if from_images { SEEDS } else { 1..=1 };
    let medians = seeds.map(|seed| typical(&study.with_seed(seed), quantity, |_, c| asymmetric(c)));
    let computed = median(medians);
    let quantity = format!(
        "median {} of an independent implementation",
        quantity.label()
    );
    // The implementation used other points, which matter more for coarser images.
    let share = match study.source {
        Source::Images { resolution, .. } if resolution < 1024 => 0.25,
        _ => 0.1,
    };
    // Rounded to two digits.
    let unit = 0.01 * 10f64.powf(expected.log10().floor());
    let tolerance = (share * expected / unit).round() * unit;
    report.near(&quantity, expected, computed, tolerance);
}

/// Compares bundle adjustment on the same images.
fn past_the_thesis(report: &mut Report, study: &Study) {
    let Source::Images {
        resolution, points, ..
    } = study.source
    else {
        return;
    };
    if study.beta != 0.8 || points != 20 {
        return;
    }
    // Accuracy that whole pixels permit.
    let limit = 0.02 * 1024.0 / f64::from(resolution);
    let cells = study.cells(EstimationMethod::Bundle);
    let asked = cells.iter().enumerate();
    let asked: Vec<_> = asked
        .filter(|(k, _)| study.is_evaluated(*k, EstimationMethod::Bundle))
        .map(|(_, cell)| cell)
        .collect();
    let answered = asked.iter().all(|cell| cell.estimated());
    let most = largest(asked.iter().map(|cell| Axis.of(cell)));
    let quantity = format!(
        "bundle adjustment, same images, {} of the motions: all answered, Phi at most {limit:.2} deg [deg]",
        asked.len()
    );
    report.holds(&quantity, most, answered && most <= limit);
}
