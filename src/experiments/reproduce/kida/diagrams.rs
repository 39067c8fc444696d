//! Figures of control theory: Bode, Nyquist, singular values, poles, root loci, time responses.

use fuyu_lti::{Complex, LtiError, StateSpace};

use crate::experiments::{Figure, Mark, Marks, Panel, PlaneFigure, Series};

/// Frequencies per decade, in addition to those near lightly damped poles and zeros.
const DENSITY: usize = 60;

pub(super) const FREQUENCY: &str = "frequency [rad/s]";

pub(super) fn series(name: &str, points: Vec<(f64, f64)>) -> Series {
    Series {
        name: name.to_owned(),
        points,
    }
}

pub(super) fn decibel(gain: f64) -> f64 {
    20.0 * gain.log10()
}

/// Gain \[dB\] of the first output from the first input.
pub(super) fn gain_curve(
    name: &str,
    system: &StateSpace,
    (low, high): (f64, f64),
) -> Result<Series, LtiError> {
    let grid = system.frequency_grid(low, high, DENSITY)?;
    let points = system.nyquist(0, 0, &grid)?.into_iter();
    let points = points.map(|(w, g)| (w, decibel(g.norm())));
    Ok(series(name, points.collect()))
}

/// Gain and phase of the first output from the first input of each system. Gains are clipped at `limits` \[dB\].
pub(super) fn bode(
    title: &str,
    systems: &[(&str, &StateSpace)],
    range: (f64, f64),
    limits: (f64, f64),
) -> Result<Figure, LtiError> {
    let (mut gains, mut phases) = (Vec::new(), Vec::new());
    for (name, system) in systems {
        let grid = system.frequency_grid(range.0, range.1, DENSITY)?;
        let points = system.bode(0, 0, &grid)?;
        // The first phase is between -270 and 90 degrees.
        let first = points.first().map_or(0.0, |p| p.phase_deg);
        let shift = 360.0 * ((-90.0 - first) / 360.0).round();
        gains.push(series(
            name,
            points.iter().map(|p| (p.frequency, p.gain_db)).collect(),
        ));
        let phase = points.iter().map(|p| (p.frequency, p.phase_deg + shift));
        phases.push(series(name, phase.collect()));
    }
    Ok(Figure {
        title: title.to_owned(),
        x_label: FREQUENCY.to_owned(),
        log_x: true,
        panels: vec![
            gain_panel("gain [dB]", gains, limits),
            Panel {
                y_label: "phase [deg]".to_owned(),
                series: phases,
                degrees: true,
                ..Panel::default()
            },
        ],
    })
}

pub(super) fn gain_panel(y_label: &str, series: Vec<Series>, limits: (f64, f64)) -> Panel {
    Panel {
        y_label: y_label.to_owned(),
        series,
        limits: Some(limits),
        ..Panel::default()
    }
}

/// All singular values of a system \[dB\], one curve each.
pub(super) fn singular_values(
    system: &StateSpace,
    (low, high): (f64, f64),
) -> Result<Vec<Series>, LtiError> {
    const NAMES: [&str; 3] = ["largest", "second", "third"];
    let grid = system.frequency_grid(low, high, DENSITY)?;
    let points = system.sigma(&grid)?;
    let curve = |(i, name): (usize, &&str)| {
        let values = points
            .iter()
            .filter_map(|p| Some((p.frequency, *p.values.get(i)?)));
        let values: Vec<_> = values.map(|(w, gain)| (w, decibel(gain))).collect();
        (!values.is_empty()).then(|| series(name, values))
    };
    Ok(NAMES.iter().enumerate().filter_map(curve).collect())
}

/// Nyquist curves of loops with negative feedback, with the unit circle and the point -1.
pub(super) fn nyquist(
    title: &str,
    loops: &[(&str, &StateSpace)],
    (low, high): (f64, f64),
    half: f64,
) -> Result<PlaneFigure, LtiError> {
    let mut curves = Vec::new();
    for (name, system) in loops {
        curves.push(series(name, smooth(system, (low, high), half)?));
    }
    let circle = (0..=180).map(|i| (2.0 * f64::from(i)).to_radians());
    curves.push(series(
        "unit circle",
        circle.map(|a| (a.cos(), a.sin())).collect(),
    ));
    Ok(PlaneFigure {
        title: title.to_owned(),
        x_label: "real part".to_owned(),
        y_label: "imaginary part".to_owned(),
        series: curves,
        marks: vec![marks("-1", Mark::Plus, vec![(-1.0, 0.0)])],
        view: Some([(-half, half), (-half, half)]),
        ..PlaneFigure::default()
    })
}

/// The frequency response in the complex plane, with points dense enough for a smooth curve within `half` of the
/// origin.
fn smooth(
    system: &StateSpace,
    (low, high): (f64, f64),
    half: f64,
) -> Result<Vec<(f64, f64)>, LtiError> {
    const ROUNDS: usize = 8;
    let grid = system.frequency_grid(low, high, 2 * DENSITY)?;
    let mut points = system.nyquist(0, 0, &grid)?;
    let visible = |g: &Complex| g.re.abs().max(g.im.abs()) < 1.5 * half;
    for _ in 0..ROUNDS {
        let far = |pair: &&[(f64, Complex)]| {
            let [(_, a), (_, b)] = [pair[0], pair[1]];
            (a - b).norm() > 0.02 * half && (visible(&a) || visible(&b))
        };
        let between: Vec<f64> = (points.windows(2).filter(far))
            .map(|pair| (pair[0].0 * pair[1].0).sqrt())
            .collect();
        if between.is_empty() {
            break;
        }
        points.extend(system.nyquist(0, 0, &between)?);
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    Ok(points.into_iter().map(|(_, g)| (g.re, g.im)).collect())
}

pub(super) fn marks(name: &str, mark: Mark, points: Vec<(f64, f64)>) -> Marks {
    Marks {
        name: name.to_owned(),
        mark,
        points,
    }
}

/// Roots in the upper half of the complex plane, as points.
pub(super) fn upper(roots: &[Complex]) -> Vec<(f64, f64)> {
    let upper = roots.iter().filter(|s| s.im >= 0.0);
    upper.map(|s| (s.re, s.im)).collect()
}

/// Poles and zeros in the upper half-plane; the axes have different scales.
pub(super) fn pole_map(
    title: &str,
    marks: Vec<Marks>,
    view: Option<[(f64, f64); 2]>,
) -> PlaneFigure {
    let ends = marks.iter().flat_map(|m| &m.points).map(|p| p.1);
    let top = view.map_or_else(|| ends.fold(1.0, f64::max), |[_, y]| y.1);
    PlaneFigure {
        title: title.to_owned(),
        x_label: "real part [rad/s]".to_owned(),
        y_label: "imaginary part [rad/s]".to_owned(),
        series: vec![series("stability limit", vec![(0.0, 0.0), (0.0, top)])],
        marks,
        stretched: true,
        view,
    }
}

/// Root locus: paths of the poles in the upper half-plane as a parameter grows, with interruptions between them. Each
/// pole continues at the nearest pole for the next parameter value.
pub(super) fn branches(locus: &[(f64, Vec<Complex>)]) -> Vec<(f64, f64)> {
    let mut paths: Vec<Vec<Complex>> = Vec::new();
    for (_, poles) in locus {
        let mut left = poles.clone();
        if paths.is_empty() {
            paths = left.into_iter().map(|p| vec![p]).collect();
            continue;
        }
        // Pair the closest poles first.
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (i, path) in paths.iter().enumerate() {
            let end = path[path.len() - 1];
            let distances = left.iter().enumerate();
            pairs.extend(distances.map(|(j, p)| ((p - end).norm(), i, j)));
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut next: Vec<Option<Complex>> = vec![None; paths.len()];
        let mut taken = vec![false; left.len()];
        for (_, i, j) in pairs {
            if next[i].is_none() && !taken[j] {
                (next[i], taken[j]) = (Some(left[j]), true);
            }
        }
        for (path, next) in paths.iter_mut().zip(next) {
            path.extend(next);
        }
        left.clear();
    }
    let in_plane = |p: Complex| match p.im >= -1e-9 {
        true => (p.re, p.im.max(0.0)),
        false => (f64::NAN, f64::NAN),
    };
    let end = [(f64::NAN, f64::NAN)];
    (paths.into_iter())
        .flat_map(|path| path.into_iter().map(in_plane).chain(end))
        .collect()
}

/// A panel of curves over time.
pub(super) fn over_time(y_label: &str, series: Vec<Series>) -> Panel {
    Panel {
        y_label: y_label.to_owned(),
        series,
        ..Panel::default()
    }
}

pub(super) fn time_figure(title: &str, panels: Vec<Panel>) -> Figure {
    Figure {
        title: title.to_owned(),
        x_label: "time [s]".to_owned(),
        panels,
        ..Figure::default()
    }
}

/// Samples at intervals of `step` s.
pub(super) fn sampled(name: &str, step: f64, values: impl IntoIterator<Item = f64>) -> Series {
    let points = values.into_iter().enumerate();
    series(name, points.map(|(i, v)| (step * i as f64, v)).collect())
}

/// The largest gain \[dB\] of the first output from the first input between two frequencies \[rad/s\].
pub(super) fn peak(system: &StateSpace, range: (f64, f64)) -> Result<f64, LtiError> {
    let gains = gain_curve("", system, range)?.points.into_iter();
    Ok(gains.map(|p| p.1).fold(f64::NEG_INFINITY, f64::max))
}

/// The largest real part.
pub(super) fn abscissa(poles: &[Complex]) -> f64 {
    poles.iter().map(|p| p.re).fold(f64::NEG_INFINITY, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Two poles that pass each other far apart keep their paths, regardless of the order in which an eigenvalue routine
    // returns them.
    #[test]
    fn branches_follow_each_pole() {
        let pole = |i: i32, up: f64| Complex::new(-0.1 * f64::from(i), up);
        let locus: Vec<_> = (0..5)
            .map(|i| {
                let mut poles = vec![pole(i, 1.0), pole(i, -1.0), pole(i, 2.0), pole(i, -2.0)];
                if i % 2 == 1 {
                    poles.reverse();
                }
                (f64::from(i), poles)
            })
            .collect();
        let points = branches(&locus);
        let pieces: Vec<_> = points
            .split(|p| p.0.is_nan())
            .filter(|p| !p.is_empty())
            .collect();
        assert_eq!(pieces.len(), 2);
        for piece in pieces {
            assert_eq!(piece.len(), 5);
            assert!(piece.iter().all(|p| p.1 == piece[0].1), "{piece:?}");
        }
    }
}
