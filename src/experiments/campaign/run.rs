//! Simulation of campaign runs.

use std::{
    fs,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use serde_json::Value;

use super::{
    Bags, Campaign, CampaignError, Verdict,
    results::value,
    row::{Cell, Row},
    series::SeriesRecorder,
};
use crate::{
    experiments::{
        Figures, Fleet, simulate_together,
        simulation::{self, Observed, Stop},
    },
    nodes::scenario::Scenario,
};

/// The reason for a run that exceeded its time limit.
pub(super) fn too_long(limit: f64) -> String {
    format!("exceeded the time limit of {limit} s")
}

/// Result of a simulation.
enum Outcome {
    Result(Value),
    Error(String),
    Timeout,
    Panic(String),
    /// Bag or series could not be written, which is not a result of the run.
    Unwritten(String),
}

impl Campaign {
    /// Simulates a run. The row records every outcome except a hang within a step and the end of the process. Time
    /// series and bags are written to `folder`, if given.
    ///
    /// # Errors
    /// [`CampaignError::Runtime`] if series or bag cannot be written.
    ///
    /// # Panics
    /// If there is no such run.
    pub fn run_one(&self, run: u64, folder: Option<&Path>) -> Result<Row, CampaignError> {
        let start = Instant::now();
        let scenario = self.scenario_of(run);
        let bags = folder.filter(|_| self.file.keep.bags == Bags::All);
        let outcome = self.attempt(run, &scenario, folder, bags);
        self.row_of(run, &scenario, outcome, folder, start)
    }

    /// Simulates several runs at the same time in this thread; their plants are integrated in SIMD lanes if possible.
    /// Gives the same rows as [`Campaign::run_one`], faster, in the order of `runs`. `add` is called with each row as
    /// soon as it is complete. The wall time of a run is its share.
    ///
    /// # Errors
    /// As [`Campaign::run_one`], and those of `add`, after which no further run starts.
    ///
    /// # Panics
    /// If there is no such run.
    pub fn run_together(
        &self,
        runs: &[u64],
        folder: Option<&Path>,
        mut add: impl FnMut(Row) -> Result<(), CampaignError>,
    ) -> Result<(), CampaignError> {
        let start = Instant::now();
        // Bags and time series are written run by run, so that memory is limited to that of one run.
        let outcomes = match runs.len() < 2 || self.runs_alone() {
            true => None,
            // Runs must not affect each other: after a panic or a timeout, each run is computed alone.
            false => catch_unwind(AssertUnwindSafe(|| self.simulate_all(runs)))
                .ok()
                .flatten(),
        };
        let Some(outcomes) = outcomes else {
            let mut rows = runs.iter().map(|run| self.run_one(*run, folder));
            return rows.try_for_each(|row| add(row?));
        };
        let share = start.elapsed() / runs.len() as u32;
        let mut ended = runs.iter().zip(outcomes);
        ended.try_for_each(|(run, (scenario, outcome))| {
            let start = Instant::now().checked_sub(share).unwrap_or(start);
            add(self.row_of(*run, &scenario, outcome, folder, start)?)
        })
    }

    /// Maximum number of simulations per run: two if bags of failed runs are kept, since a failed run is repeated for
    /// its bag.
    pub(super) fn attempts(&self) -> u32 {
        match self.file.keep.bags {
            Bags::Failed => 2,
            Bags::None | Bags::All => 1,
        }
    }

    /// Whether each run is computed alone, because it writes a bag or a time series.
    pub(super) fn runs_alone(&self) -> bool {
        let keep = &self.file.keep;
        keep.bags == Bags::All || keep.series.is_some()
    }

    /// The row of a run that began at `start`.
    fn row_of(
        &self,
        run: u64,
        scenario: &Scenario,
        outcome: Outcome,
        folder: Option<&Path>,
        start: Instant,
    ) -> Result<Row, CampaignError> {
        let parameters = self.parameters_of(run);
        let (mut verdict, mut reason, mut results) =
            (Verdict::Success, None, vec![Cell::Null; self.results.len()]);
        match outcome {
            Outcome::Result(result) => {
                let cells = self.results.iter();
                results = cells
                    .map(|column| value(&result, &column.name, column.kind))
                    .collect();
                let missed = self.criteria.iter().find(|criterion| {
                    !criterion.is_met(self.quantity(criterion, &parameters, &results))
                });
                if let Some(criterion) = missed {
                    verdict = Verdict::Failure;
                    reason = Some(criterion.text().to_owned());
                }
            }
            Outcome::Error(e) => (verdict, reason) = (Verdict::Error, Some(e)),
            Outcome::Panic(e) => (verdict, reason) = (Verdict::Panic, Some(e)),
            Outcome::Timeout => {
                (verdict, reason) = (Verdict::Timeout, Some(too_long(self.time_limit())));
            }
            Outcome::Unwritten(e) => return Err(CampaignError::Runtime(e)),
        }
        let wall_time = start.elapsed().as_secs_f64();
        let wanted = self.file.keep.bags == Bags::Failed
            && !matches!(verdict, Verdict::Success | Verdict::Timeout);
        if let Some(folder) = folder.filter(|_| wanted) {
            // Repeats the run with a bag; this does not count in its wall time.
            if let Outcome::Unwritten(e) = self.attempt(run, scenario, None, Some(folder)) {
                return Err(CampaignError::Runtime(e));
            }
        }
        Ok(Row {
            run,
            seed: self.seed_of(run),
            verdict,
            reason,
            parameters,
            results,
            wall_time,
        })
    }

    /// The row of a run whose process did not return a row.
    pub(super) fn lost(&self, run: u64, verdict: Verdict, reason: String, wall_time: f64) -> Row {
        Row {
            run,
            seed: self.seed_of(run),
            verdict,
            reason: Some(reason),
            parameters: self.parameters_of(run),
            results: vec![Cell::Null; self.results.len()],
            wall_time,
        }
    }

    fn attempt(
        &self,
        run: u64,
        scenario: &Scenario,
        series: Option<&Path>,
        bags: Option<&Path>,
    ) -> Outcome {
        let unwinding = catch_unwind(AssertUnwindSafe(|| {
            self.simulate(run, scenario, series, bags)
        }));
        unwinding.unwrap_or_else(|payload| {
            let text = payload
                .downcast_ref::<&str>()
                .map(|text| (*text).to_owned());
            let text = text.or_else(|| payload.downcast_ref::<String>().cloned());
            Outcome::Panic(one_line(&text.unwrap_or_else(|| "panic".to_owned())))
        })
    }

    fn simulate(
        &self,
        run: u64,
        scenario: &Scenario,
        series: Option<&Path>,
        bags: Option<&Path>,
    ) -> Outcome {
        let error = |e: String| Outcome::Error(one_line(&e));
        let mut fleet = match Fleet::new(scenario) {
            Ok(fleet) => fleet,
            Err(e) => return error(e),
        };
        let mut bag = None;
        if let Some(folder) = bags {
            let folder = folder.join("bags").join(name_of(run));
            // Removes the remains of a killed process.
            let _ = fs::remove_dir_all(&folder);
            match simulation::create_bag(scenario, &fleet, &folder) {
                Ok(new) => bag = Some(new),
                Err(e) => return Outcome::Unwritten(e),
            }
        }
        let limit = Duration::try_from_secs_f64(self.time_limit()).unwrap_or(Duration::MAX);
        let start = Instant::now();
        let mut recorder = match (series, &self.file.keep.series) {
            (Some(_), Some(file)) => Some(SeriesRecorder::new(file)),
            _ => None,
        };
        let mut is_late = false;
        let duration = simulation::duration_of(&fleet, None);
        let observed =
            simulation::simulate(&mut fleet, duration, bag.as_mut(), |fleet, observed| {
                if let Some(recorder) = &mut recorder {
                    recorder.see(fleet, observed);
                }
                is_late = start.elapsed() > limit;
                match is_late {
                    true => Err(Stop::Watcher(String::new())),
                    false => Ok(()),
                }
            });
        if let Some(bag) = bag
            && let Err(e) = bag.finish()
        {
            return Outcome::Unwritten(e.to_string());
        }
        let is_cut = is_late && observed.is_err();
        if let (Some(recorder), Some(folder)) = (recorder, series)
            && let Err(e) = recorder.write(&series_path(folder, run))
        {
            return Outcome::Unwritten(e);
        }
        match is_cut {
            true => Outcome::Timeout,
            false => end_of(scenario, &fleet, observed),
        }
    }

    /// Simulates several runs without bags and time series; `None` if the time limit is exceeded.
    fn simulate_all(&self, runs: &[u64]) -> Option<Vec<(Scenario, Outcome)>> {
        let scenarios: Vec<_> = runs.iter().map(|run| self.scenario_of(*run)).collect();
        let (mut fleets, mut refused) = (Vec::new(), Vec::new());
        for scenario in &scenarios {
            refused.push(match Fleet::new(scenario) {
                Ok(fleet) => {
                    let duration = simulation::duration_of(&fleet, None);
                    fleets.push((fleet, duration));
                    None
                }
                Err(e) => Some(Outcome::Error(one_line(&e))),
            });
        }
        let limit = Duration::try_from_secs_f64(self.time_limit()).unwrap_or(Duration::MAX);
        let start = Instant::now();
        let mut is_late = false;
        let needed = Figures::of_results(self.results.iter().map(|column| column.name.as_str()));
        let ends = simulate_together(&mut fleets, needed, |_, _, _| {
            is_late |= start.elapsed() > limit;
            match is_late {
                true => Err(Stop::Watcher(String::new())),
                false => Ok(()),
            }
        });
        if is_late {
            return None;
        }
        let mut ended = fleets.iter().zip(ends);
        let outcomes = scenarios
            .into_iter()
            .zip(refused)
            .map(|(scenario, refused)| {
                let outcome = match refused {
                    Some(outcome) => outcome,
                    None => {
                        let ((fleet, _), observed) = ended.next()?;
                        end_of(&scenario, fleet, observed)
                    }
                };
                Some((scenario, outcome))
            });
        outcomes.collect()
    }
}

/// The outcome of a simulation that ended with `observed`.
fn end_of(scenario: &Scenario, fleet: &Fleet, observed: Result<Vec<Observed>, Stop>) -> Outcome {
    let observed = match observed {
        Ok(observed) => observed,
        Err(Stop::Bag(e)) => return Outcome::Unwritten(e.to_string()),
        Err(stop) => return Outcome::Error(one_line(&stop.describe(scenario))),
    };
    let summaries = simulation::summaries(fleet, &observed, 0.0);
    match simulation::results(fleet, &observed, &summaries) {
        Ok(result) => Outcome::Result(result),
        Err(e) => Outcome::Error(one_line(&e.to_string())),
    }
}

/// Name of a run in the dataset.
pub(super) fn name_of(run: u64) -> String {
    format!("run-{run:09}")
}

/// File of the time series of a run.
fn series_path(folder: &Path, run: u64) -> PathBuf {
    folder.join("series").join(name_of(run) + ".parquet")
}

fn one_line(text: &str) -> String {
    text.lines().collect::<Vec<_>>().join("; ")
}
