//! Sweeps over motions, computed once per process, since several figures show the same sweep.

use indicatif::{ProgressBar, ProgressStyle};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use crate::estimation::bundle;
use crate::estimation::free_body::FreeRotation;
use crate::estimation::{EstimationMethod, MotionModel};
use crate::experiments::masutani_ch3::{self as chapter, Condition, TumblingMotion, in_parallel};

/// Input of the estimation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Source {
    /// True angular velocities.
    TrueRates,
    /// True rotations between frames.
    TrueRotations,
    /// Images.
    Images {
        /// Pixels along each side.
        resolution: u32,
        /// Points on the body.
        points: usize,
        /// Seed of the points.
        seed: u64,
    },
}

/// Conditions of a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Study {
    pub source: Source,
    /// Largest `|w|²` \[rad²/s²\].
    pub beta: f64,
    /// Whether the sweep has the 88 motions of sec. 3.6.5 instead of the usual 294.
    pub coarse: bool,
}

/// Isotropies and momenta of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Grid {
    pub isotropies: Vec<f64>,
    pub momenta: Vec<f64>,
}

/// Result for one motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    /// The model chosen, if any.
    pub model: Option<MotionModel>,
    /// `r`, `Theta` and `Phi` \[-, rad, rad\]; NaN without an estimate.
    pub errors: [f64; 3],
}

/// Bundle adjustment is evaluated for every n-th isotropy and momentum.
const STEPS: (usize, usize) = (2, 2);

/// Seed of the points used for the figures.
pub(super) const SEED: u64 = 1;

impl Grid {
    fn new(coarse: bool) -> Self {
        let evenly = |from: i32, to: i32, of: f64| (from..=to).map(|i| f64::from(i) / of).collect();
        if !coarse {
            return Self {
                isotropies: evenly(7, 20, 20.0),
                momenta: evenly(-10, 10, 10.0),
            };
        }
        let mut isotropies: Vec<f64> = evenly(4, 10, 10.0);
        isotropies.insert(0, 1.0 / 3.0);
        Self {
            isotropies,
            momenta: evenly(-5, 5, 5.0),
        }
    }
}

/// A completed sweep and its conditions.
type Sweep = (Study, EstimationMethod, Arc<Vec<Cell>>);

impl Study {
    pub fn of(source: Source) -> Self {
        Self {
            source,
            beta: 0.8,
            coarse: false,
        }
    }

    pub fn images(resolution: u32, points: usize) -> Self {
        Self::of(Source::Images {
            resolution,
            points,
            seed: SEED,
        })
    }

    pub fn with_seed(mut self, wanted: u64) -> Self {
        if let Source::Images { seed, .. } = &mut self.source {
            *seed = wanted;
        }
        self
    }

    pub fn grid(&self) -> Grid {
        Grid::new(self.coarse)
    }

    /// The motions: all momenta of the first isotropy, then of the next.
    pub fn motions(&self) -> Vec<TumblingMotion> {
        let Grid {
            isotropies,
            momenta,
        } = self.grid();
        let cells = isotropies
            .iter()
            .flat_map(|e| momenta.iter().map(|s| (*e, *s)));
        let motion = |(e, s_alpha)| TumblingMotion {
            e,
            s: 0.0,
            s_alpha,
            beta: self.beta,
        };
        cells.map(motion).collect()
    }

    /// The grid of motions for which a method is evaluated, if not all: bundle adjustment takes seconds for some
    /// motions, so that only a subset is computed.
    pub fn part(&self, method: EstimationMethod) -> Option<Grid> {
        let Grid {
            isotropies,
            momenta,
        } = self.grid();
        let every = |values: Vec<f64>, step| values.into_iter().step_by(step).collect();
        (method == EstimationMethod::Bundle).then(|| Grid {
            isotropies: every(isotropies, STEPS.0),
            momenta: every(momenta, STEPS.1),
        })
    }

    /// Whether a method is evaluated for the motion of this index.
    pub fn is_evaluated(&self, index: usize, method: EstimationMethod) -> bool {
        let momenta = self.grid().momenta.len();
        method != EstimationMethod::Bundle
            || ((index / momenta).is_multiple_of(STEPS.0)
                && (index % momenta).is_multiple_of(STEPS.1))
    }

    /// The results by one method, computed once; bundle adjustment needs images. Motions for which the method is not
    /// evaluated ([`Study::is_evaluated`]) have no errors.
    pub fn cells(&self, method: EstimationMethod) -> Arc<Vec<Cell>> {
        static DONE: Mutex<Vec<Sweep>> = Mutex::new(Vec::new());
        let done = || DONE.lock().unwrap_or_else(PoisonError::into_inner);
        let known = |(study, by, _): &&Sweep| study == self && *by == method;
        if let Some((.., cells)) = done().iter().find(known) {
            return Arc::clone(cells);
        }
        let cells = Arc::new(self.sweep(method));
        done().push((*self, method, Arc::clone(&cells)));
        cells
    }

    fn sweep(&self, method: EstimationMethod) -> Vec<Cell> {
        let motions = self.motions();
        let asked: Vec<_> = (0..motions.len())
            .filter(|index| self.is_evaluated(*index, method))
            .collect();
        let points = match self.source {
            Source::Images { points, seed, .. } => chapter::points(points, seed),
            _ => Vec::new(),
        };
        let condition = match self.source {
            Source::TrueRates => Condition::TrueRates,
            Source::TrueRotations => Condition::TrueRotations,
            Source::Images { resolution, .. } => Condition::Images {
                resolution,
                points: &points,
            },
        };
        let start = Instant::now();
        let bar = progress(asked.len(), &self.describe(method));
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let answers = in_parallel(&asked, threads, |index| {
            let cell = match motions[*index].rotation() {
                Err(_) => Cell::NONE,
                Ok(truth) => match method {
                    EstimationMethod::Masutani1995 => by_thesis(&truth, condition),
                    EstimationMethod::Bundle => by_bundle(&truth, condition),
                    EstimationMethod::MaximumLikelihood => Cell::NONE,
                },
            };
            bar.inc(1);
            cell
        });
        bar.finish_and_clear();
        let mut cells = vec![Cell::NONE; motions.len()];
        for (index, answer) in asked.iter().zip(answers) {
            cells[*index] = answer;
        }
        let took = start.elapsed().as_secs_f64();
        if took > 1.0 {
            eprintln!("fuyu: {}: {took:.1} s", self.describe(method));
        }
        cells
    }

    /// Short description of the conditions.
    pub fn condition(&self) -> String {
        match self.source {
            Source::TrueRates => "true w".to_owned(),
            Source::TrueRotations => "true R".to_owned(),
            Source::Images {
                resolution, points, ..
            } => format!("{resolution} px, {points} points, beta {}", self.beta),
        }
    }

    fn describe(&self, method: EstimationMethod) -> String {
        let source = match self.source {
            Source::TrueRates => "true angular velocities".to_owned(),
            Source::TrueRotations => "true rotations".to_owned(),
            Source::Images {
                resolution,
                points,
                seed,
            } => format!("images of {resolution} px, {points} points (set {seed})"),
        };
        let motions = 0..self.motions().len();
        let motions = motions.filter(|k| self.is_evaluated(*k, method)).count();
        format!(
            "{motions} motions, beta = {}, from {source}, {}",
            self.beta,
            method.name()
        )
    }
}

impl Cell {
    const NONE: Self = Self {
        model: None,
        errors: [f64::NAN; 3],
    };

    pub fn estimated(&self) -> bool {
        self.errors[0].is_finite()
    }
}

fn errors(errors: &chapter::CellErrors) -> [f64; 3] {
    let prediction = &errors.prediction;
    [errors.parameters, prediction.attitude, prediction.axis]
}

fn by_thesis(truth: &FreeRotation, condition: Condition<'_>) -> Cell {
    let cell = chapter::cell(truth, condition);
    Cell {
        model: cell.model,
        errors: cell.result.map_or([f64::NAN; 3], |e| errors(&e)),
    }
}

fn by_bundle(truth: &FreeRotation, condition: Condition<'_>) -> Cell {
    let Condition::Images { resolution, points } = condition else {
        return Cell::NONE;
    };
    let tracks = chapter::tracks(truth, resolution, points);
    let camera = chapter::camera(resolution);
    match bundle::estimate(&tracks, &camera, &bundle::Options::undisturbed()) {
        Err(_) => Cell::NONE,
        Ok(solution) => Cell {
            model: Some(solution.motion.model()),
            errors: errors(&chapter::judge(&solution.motion, truth)),
        },
    }
}

/// A progress bar on a terminal, otherwise nothing.
fn progress(length: usize, what: &str) -> ProgressBar {
    let bar = ProgressBar::new(length as u64).with_message(what.to_owned());
    match ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grids_are_those_of_the_text() {
        let fine = Study::of(Source::TrueRates);
        assert_eq!(fine.motions(), chapter::grid(0.8));
        let coarse = Study {
            coarse: true,
            ..fine
        };
        assert_eq!((fine.motions().len(), coarse.motions().len()), (294, 88));
        for motion in coarse.motions() {
            assert!(motion.rotation().is_ok(), "{motion:?}");
        }
    }
}
