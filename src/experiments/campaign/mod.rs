//! Campaigns: many runs of a scenario, with parameters that differ from run to run.
//!
//! [`Campaign::load`] reads `config/campaigns/*.yaml`. The parameters of run `n` depend only on the campaign's seed and
//! on `n`. [`Campaign::scenario_of`] returns the scenario of a run, with which `fuyu simulate` repeats the run bit by
//! bit. [`Campaign::run_one`] simulates one run; [`run_range`] simulates a range of runs into a [`Dataset`], and
//! continues the dataset after a kill. [`Summary`] evaluates a dataset.

mod dataset;
mod dispersion;
mod engine;
mod file;
mod parameters;
mod plots;
mod range;
mod results;
mod row;
mod run;
mod series;
mod summary;
mod table;
mod target;
mod values;
mod worker;

use std::path::{Path, PathBuf};

use fuyu_campaign::{Design, seed_of};
use serde_json::Value;

use super::{check_robots, simulation};
use crate::{
    experiments::Fleet,
    input_file::LARGEST_YAML,
    nodes::{
        resource::{self, Lookup},
        scenario::Scenario,
    },
    ros::ParameterValue,
};
use dispersion::{Building, Dispersion};
use file::{Bags, CampaignFile};
use parameters::{Changes, Parameters, Place, cell, column_kind};
use values::{fit, put_whole};

pub use dataset::{Dataset, Manifest};
pub use engine::{Progress, RangeOptions, Workers, run_range};
pub use plots::plot;
pub use results::Criterion;
pub use row::{Cell, Column, ColumnKind, Row, Verdict};
pub use summary::{Quantiles, Sensitivity, Summary, WorstRun};
pub use worker::serve_worker;

/// Reason why a campaign cannot be read, run or evaluated: one line per problem.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CampaignError {
    /// A file, a folder or an argument is invalid.
    #[error("{0}")]
    Input(String),
    /// The environment failed: a full disk, a lost process.
    #[error("{0}")]
    Runtime(String),
}

/// A campaign, ready to run.
#[derive(Clone)]
pub struct Campaign {
    path: PathBuf,
    text: String,
    scenario_text: String,
    file: CampaignFile,
    runs: u64,
    /// The scenario, with the parameter values that are the same in all runs.
    scenario: Scenario,
    nominal: Parameters,
    dispersions: Vec<Dispersion>,
    design: Design,
    seeds: Vec<Place>,
    parameters: Vec<Column>,
    /// Places of the values in the parameters' columns.
    places: Vec<Place>,
    results: Vec<Column>,
    criteria: Vec<Criterion>,
}

impl Campaign {
    /// Reads the campaign `name`: a path, or `package://fuyu/config/campaigns/NAME.yaml`. `runs` replaces the file's number of
    /// runs.
    ///
    /// # Errors
    /// [`CampaignError::Input`] with file, field and the correct form.
    pub fn load(name: &str, runs: Option<u64>) -> Result<Self, CampaignError> {
        Self::read(name, runs).map_err(CampaignError::Input)
    }

    fn read(name: &str, runs: Option<u64>) -> Result<Self, String> {
        let found = resource::resolve(name)?;
        let (path, text) = (found.path(), found.text(LARGEST_YAML)?);
        let file = CampaignFile::parse(&path, &text)?;
        let lookup = Lookup {
            folder: path.parent().map(Path::to_owned),
            ..Lookup::default()
        };
        let at = |e: String| format!("{}: scenario: {e}", path.display());
        let scenario = lookup.resolve(&file.scenario).map_err(at)?;
        let scenario_text = scenario.text(LARGEST_YAML).map_err(at)?;
        Self::new(path, text, scenario.path(), scenario_text, runs)
    }

    /// A campaign from the texts of its file and its scenario; errors refer to them by their paths.
    ///
    /// # Errors
    /// A line with file, field and the correct form.
    pub(crate) fn new(
        path: PathBuf,
        text: String,
        scenario_path: PathBuf,
        scenario_text: String,
        runs: Option<u64>,
    ) -> Result<Self, String> {
        let file = CampaignFile::parse(&path, &text)?;
        let at = |e: String| {
            let lines = e.lines().map(|line| format!("{}: {line}", path.display()));
            lines.collect::<Vec<_>>().join("\n")
        };
        let scenario = Scenario::parse(scenario_path, &scenario_text)?;
        let (scenario, nominal) = with_fixed(scenario, &file).map_err(at)?;
        scenario.check()?;

        let mut building = Building::default();
        let mut dispersions = Vec::new();
        for (name, dispersion) in &file.dispersions.0 {
            let index = dispersions.len();
            let new = Dispersion::new(name, dispersion, &nominal, &mut building, index);
            dispersions.push(new.map_err(at)?);
        }
        for correlated in &file.correlated {
            let new = Dispersion::correlated(correlated, &nominal, &mut building);
            dispersions.push(new.map_err(at)?);
        }
        refuse_overlaps(&dispersions, &nominal).map_err(at)?;
        let total = building.finish(&mut dispersions).map_err(at)?;
        let runs = runs
            .or(file.runs)
            .or(total)
            .ok_or_else(|| at("runs is not given; say how many".to_owned()))?;
        let design = Design::new(file.sampling.into(), file.seed, runs, &building.coordinates);
        let design = design.map_err(|e| at(format!("sampling: {e}")))?;

        let places = dispersions.iter().flat_map(|dispersion| {
            match (dispersion.places.as_slice(), dispersion.length(&nominal)) {
                ([whole], Some(length)) => (0..length).map(|i| whole.element(i)).collect(),
                (places, _) => places.to_vec(),
            }
        });
        let places: Vec<Place> = places.collect();
        let parameters = places.iter().map(|place| Column {
            name: nominal.name(place),
            kind: column_kind(nominal.nominal(place)),
        });
        let parameters: Vec<_> = parameters.collect();
        let dispersed = |seed: &Place| {
            places
                .iter()
                .any(|p| p.node == seed.node && p.parameter == seed.parameter)
        };
        let fixed: Vec<Place> = (file.parameters.0.iter())
            .filter_map(|(name, _)| nominal.find(name).ok())
            .collect();
        let seeds = nominal
            .seeds()
            .into_iter()
            .filter(|s| !dispersed(s) && !fixed.contains(s));

        let first = first_result(&scenario)?;
        let mut results = results::columns(file.keep.results.as_deref(), &first).map_err(at)?;
        let mut criteria = Vec::new();
        for text in &file.success {
            let criterion = Criterion::parse(text).map_err(at)?;
            let name = criterion.name();
            let is_known = parameters.iter().chain(&results).any(|c| c.name == name);
            if !is_known {
                let leaves = results::leaves(&first);
                let Some(kind) = leaves.get(name) else {
                    let known = leaves.keys().chain(parameters.iter().map(|c| &c.name));
                    let known: Vec<_> = known.map(String::as_str).collect();
                    let problem = results::unknown(name, known.iter().copied());
                    return Err(at(format!("success: '{text}': {problem}")));
                };
                results.push(Column {
                    name: name.to_owned(),
                    kind: *kind,
                });
            }
            criteria.push(criterion);
        }
        if let Some(column) = parameters.iter().chain(&results).find(|c| {
            criteria.iter().any(|criterion| criterion.name() == c.name)
                && c.kind == ColumnKind::Text
        }) {
            return Err(at(format!(
                "success: {} is a text, which has no order",
                column.name
            )));
        }
        if let Some(series) = &file.keep.series {
            series::check(series, &scenario).map_err(at)?;
        }
        Ok(Self {
            seeds: seeds.collect(),
            path,
            text,
            scenario_text,
            runs,
            scenario,
            nominal,
            dispersions,
            design,
            parameters,
            places,
            results,
            criteria,
            file,
        })
    }

    /// The file; `package://fuyu/PATH` if it is embedded in the executable.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Name of the campaign: the file name without extension.
    pub fn name(&self) -> String {
        let stem = self.path.file_stem();
        stem.map_or_else(String::new, |s| s.to_string_lossy().into_owned())
    }

    /// Number of runs.
    pub fn runs(&self) -> u64 {
        self.runs
    }

    /// The campaign's seed.
    pub fn seed(&self) -> u64 {
        self.file.seed
    }

    /// The dispersed parameters: a column for each, or for each element of a list.
    pub fn parameters(&self) -> &[Column] {
        &self.parameters
    }

    /// The kept results.
    pub fn results(&self) -> &[Column] {
        &self.results
    }

    /// The criteria of success.
    pub fn criteria(&self) -> &[Criterion] {
        &self.criteria
    }

    /// Wall time after which a run is aborted \[s\].
    pub fn time_limit(&self) -> f64 {
        self.file.time_limit
    }

    /// Whether the values of runs depend on the number of runs.
    pub fn depends_on_runs(&self) -> bool {
        matches!(self.file.sampling, file::SamplingName::LatinHypercube)
    }

    /// Seed of a run.
    pub fn seed_of(&self, run: u64) -> u64 {
        seed_of(self.file.seed, run, "run")
    }

    /// The dispersed parameters of a run, in the order of [`Self::parameters`].
    ///
    /// # Panics
    /// If there is no such run.
    pub fn parameters_of(&self, run: u64) -> Vec<Cell> {
        let changes = self.changes(run);
        let cells = self.places.iter().map(|place| {
            let key = (place.node, place.parameter.clone());
            let value = changes
                .get(&key)
                .unwrap_or_else(|| self.nominal.nominal(place));
            cell(value, place.element)
        });
        cells.collect()
    }

    /// The scenario of a run.
    ///
    /// # Panics
    /// If there is no such run.
    pub fn scenario_of(&self, run: u64) -> Scenario {
        let mut scenario = self.scenario.clone();
        for ((node, parameter), value) in self.changes(run) {
            scenario.set(&self.nominal.nodes[node].full(), &parameter, value);
        }
        scenario
    }

    /// The scenario of a run as a parameter file, with which `fuyu simulate` repeats the run bit by bit.
    ///
    /// # Errors
    /// None in practice; [`CampaignError::Input`] if the scenario's arguments cannot be read.
    ///
    /// # Panics
    /// If there is no such run.
    pub fn scenario_text_of(&self, run: u64) -> Result<String, CampaignError> {
        let scenario = self.scenario_of(run);
        let text = scenario.to_text(&self.nominal.declared);
        text.map_err(CampaignError::Input)
    }

    fn changes(&self, run: u64) -> Changes {
        let mut changes = Changes::new();
        let seed = self.seed_of(run);
        for place in &self.seeds {
            let own = seed_of(seed, 0, &self.nominal.name(place));
            // Seeds are below 2^53.
            let value = ParameterValue::Integer(own as i64);
            changes.insert((place.node, place.parameter.clone()), value);
        }
        for dispersion in &self.dispersions {
            dispersion.change(run, &self.design, &self.nominal, &mut changes);
        }
        changes
    }

    /// The value in a run of the quantity that a criterion judges.
    fn quantity(
        &self,
        criterion: &Criterion,
        parameters: &[Cell],
        results: &[Cell],
    ) -> Option<f64> {
        let named = |(column, _): &(&Column, &Cell)| column.name == criterion.name();
        let mut cells =
            (self.parameters.iter().zip(parameters)).chain(self.results.iter().zip(results));
        cells.find(named).and_then(|(_, cell)| cell.number())
    }
}

/// The scenario with the campaign's fixed values, and all its parameters.
fn with_fixed(
    mut scenario: Scenario,
    file: &CampaignFile,
) -> Result<(Scenario, Parameters), String> {
    let own = Parameters::of(&scenario)?;
    let mut changes = Changes::new();
    for (name, value) in &file.parameters.0 {
        let place = own.find(name)?;
        let value = fit(value, own.nominal(&place), place.element.is_some());
        let value = value.map_err(|e| format!("parameters: {name}: {e}"))?;
        put_whole(&place, &value, &own, &mut changes);
    }
    if let Some(duration) = file.duration {
        let names = own.nodes.iter().map(|node| node.name());
        for (node, _) in names.enumerate().filter(|(_, name)| *name == "dynamics") {
            let value = ParameterValue::Double(duration);
            changes.insert((node, "duration".to_owned()), value);
        }
    }
    for ((node, parameter), value) in changes {
        scenario.set(&own.nodes[node].full(), &parameter, value);
    }
    let all = Parameters::of(&scenario)?;
    Ok((scenario, all))
}

/// Refuses numbers that are dispersed twice.
fn refuse_overlaps(dispersions: &[Dispersion], nominal: &Parameters) -> Result<(), String> {
    let places: Vec<&Place> = dispersions.iter().flat_map(|d| &d.places).collect();
    for (i, a) in places.iter().enumerate() {
        let same = |b: &&&Place| {
            let is_whole = a.element.is_none() || b.element.is_none();
            a.node == b.node && a.parameter == b.parameter && (is_whole || a.element == b.element)
        };
        if places[..i].iter().any(|b| same(&b)) {
            return Err(format!("{} is dispersed twice", nominal.name(a)));
        }
    }
    Ok(())
}

/// The result of a run that ends at its first state; it shows which values results have.
fn first_result(scenario: &Scenario) -> Result<Value, String> {
    check_robots(scenario)?;
    let mut fleet = Fleet::new(scenario)?;
    let observed = simulation::simulate(&mut fleet, 0.0, None, |_, _| Ok(()));
    let observed = observed.map_err(|stop| stop.describe(scenario))?;
    let summaries = simulation::summaries(&fleet, &observed, 0.0);
    simulation::results(&fleet, &observed, &summaries).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests;
