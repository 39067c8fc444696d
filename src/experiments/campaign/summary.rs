//! Statistics of a campaign.

use std::collections::BTreeMap;

use fuyu_campaign::{mean_and_deviation, quantile, spearman, success_interval};
use serde::Serialize;

use super::{
    CampaignError, Criterion, Dataset,
    row::{Cell, Column, ColumnKind, Row, Verdict},
};

/// Number of worst runs listed per criterion.
const WORST: usize = 5;

/// Maximum number of different reasons listed.
const MOST_REASONS: usize = 20;

/// Name of the verdict as a result: 1 for success, otherwise 0.
const SUCCESS: &str = "success";

/// Statistics of the runs that are done.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the campaign.
    pub campaign: String,
    /// Number of runs.
    pub runs: u64,
    /// Runs that are done.
    pub completed: u64,
    /// Number of runs by verdict.
    pub verdicts: BTreeMap<&'static str, u64>,
    /// Share of successes; `None` if no run is done.
    pub success_rate: Option<f64>,
    /// Its confidence interval.
    pub confidence_interval: Option<ConfidenceInterval>,
    /// Reasons for other verdicts than success, the most frequent first.
    pub reasons: Vec<Reason>,
    /// Statistics of each numeric result.
    pub results: BTreeMap<String, Quantiles>,
    /// The worst runs by each criterion, the worst first; without criteria, the runs with the largest first result.
    pub worst: Vec<WorstRun>,
    /// Rank correlations of results with parameters, the strongest first.
    pub sensitivities: Vec<Sensitivity>,
    /// Wall time per run \[s\].
    pub wall_time: Option<Quantiles>,
}

/// A confidence interval of a probability.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ConfidenceInterval {
    /// Method of computation.
    pub method: &'static str,
    /// Confidence level: probability, at least, that the interval contains the true value.
    pub confidence: f64,
    /// Lower end.
    pub lower: f64,
    /// Upper end.
    pub upper: f64,
}

/// A reason for not being a success, with its frequency.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reason {
    /// Verdict of the runs.
    pub verdict: Verdict,
    /// The reason.
    pub reason: String,
    /// Number of runs.
    pub count: u64,
    /// The first of them.
    pub first_run: u64,
}

/// Statistics of a quantity over the runs that have a value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quantiles {
    /// Number of runs with a value.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation; `None` for a single run.
    pub standard_deviation: Option<f64>,
    /// Smallest.
    pub min: f64,
    /// 1 % quantile.
    pub p01: f64,
    /// 5 % quantile.
    pub p05: f64,
    /// 25 % quantile.
    pub p25: f64,
    /// Median.
    pub p50: f64,
    /// 75 % quantile.
    pub p75: f64,
    /// 95 % quantile.
    pub p95: f64,
    /// 99 % quantile.
    pub p99: f64,
    /// Largest.
    pub max: f64,
}

impl Quantiles {
    fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.filter(|x| x.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let (min, max) = (*values.first()?, *values.last()?);
        let (mean, deviation) = mean_and_deviation(&values);
        let at = |p| quantile(&values, p);
        Some(Self {
            count: values.len(),
            mean,
            standard_deviation: Some(deviation).filter(|d| d.is_finite()),
            min,
            p01: at(0.01),
            p05: at(0.05),
            p25: at(0.25),
            p50: at(0.5),
            p75: at(0.75),
            p95: at(0.95),
            p99: at(0.99),
            max,
        })
    }
}

/// One of the worst runs by a criterion or result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorstRun {
    /// The criterion, or the result.
    pub by: String,
    /// Number of the run.
    pub run: u64,
    /// The value of the quantity; `None` if the run has none.
    pub value: Option<f64>,
    /// Its verdict.
    pub verdict: Verdict,
}

/// Rank correlation of a result with a parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sensitivity {
    /// The result, or `success`.
    pub result: String,
    /// The parameter.
    pub parameter: String,
    /// Spearman's coefficient.
    pub rho: f64,
    /// Probability of a coefficient of at least this magnitude for independent quantities.
    pub p_value: f64,
    /// Number of runs with both values.
    pub count: usize,
}

impl Summary {
    /// Evaluates the runs that `dataset` has so far. `confidence` is the confidence level of the interval, in (0, 1).
    ///
    /// # Errors
    /// [`CampaignError`] if a file cannot be read.
    pub fn of(dataset: &Dataset, confidence: f64) -> Result<Self, CampaignError> {
        let rows = dataset.rows()?;
        let manifest = dataset.manifest();
        let criteria = manifest.success.iter().map(|text| Criterion::parse(text));
        let criteria = criteria.collect::<Result<Vec<_>, _>>();
        let criteria = criteria.map_err(CampaignError::Input)?;
        let table = Table {
            rows: &rows,
            parameters: &manifest.parameters,
            results: &manifest.results,
        };
        let completed = rows.len() as u64;
        let mut verdicts: BTreeMap<&'static str, u64> =
            Verdict::ALL.iter().map(|v| (v.name(), 0)).collect();
        for row in &rows {
            *verdicts.entry(row.verdict.name()).or_default() += 1;
        }
        let successes = verdicts[Verdict::Success.name()];
        let interval = (completed > 0).then(|| success_interval(successes, completed, confidence));
        Ok(Self {
            campaign: manifest.name.clone(),
            runs: manifest.runs,
            completed,
            verdicts,
            success_rate: (completed > 0).then(|| successes as f64 / completed as f64),
            confidence_interval: interval.map(|interval| ConfidenceInterval {
                method: "Clopper-Pearson",
                confidence,
                lower: interval.lower,
                upper: interval.upper,
            }),
            reasons: reasons(&rows),
            results: table.quantiles(),
            worst: table.worst(&criteria),
            sensitivities: table.sensitivities(),
            wall_time: Quantiles::of(rows.iter().map(|row| row.wall_time)),
        })
    }
}

/// Number and first run of each reason.
fn reasons(rows: &[Row]) -> Vec<Reason> {
    let mut found: BTreeMap<(Verdict, &str), (u64, u64)> = BTreeMap::new();
    for row in rows {
        if let Some(reason) = &row.reason {
            let entry = found.entry((row.verdict, reason)).or_insert((0, row.run));
            entry.0 += 1;
        }
    }
    let reasons = found
        .into_iter()
        .map(|((verdict, reason), (count, first_run))| Reason {
            verdict,
            reason: reason.to_owned(),
            count,
            first_run,
        });
    let mut reasons: Vec<_> = reasons.collect();
    reasons.sort_by_key(|reason| (std::cmp::Reverse(reason.count), reason.first_run));
    reasons.truncate(MOST_REASONS);
    reasons
}

/// Rows with the names of their columns.
pub(super) struct Table<'a> {
    pub rows: &'a [Row],
    pub parameters: &'a [Column],
    pub results: &'a [Column],
}

impl Table<'_> {
    /// The numbers in a parameter's or result's column, NaN for missing ones; `None` without such a column.
    pub fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        let in_results = self.results.iter().position(|c| c.name == name);
        let in_parameters = self.parameters.iter().position(|c| c.name == name);
        let cell = |row: &Row| match (in_parameters, in_results) {
            (Some(i), _) => row.parameters.get(i).and_then(Cell::number),
            (None, Some(i)) => row.results.get(i).and_then(Cell::number),
            (None, None) => None,
        };
        in_parameters.or(in_results)?;
        Some(
            self.rows
                .iter()
                .map(|row| cell(row).unwrap_or(f64::NAN))
                .collect(),
        )
    }

    fn quantiles(&self) -> BTreeMap<String, Quantiles> {
        let numeric = self.results.iter().filter(|c| c.kind != ColumnKind::Text);
        let all = numeric.filter_map(|column| {
            let numbers = self.numbers(&column.name)?;
            Some((column.name.clone(), Quantiles::of(numbers.into_iter())?))
        });
        all.collect()
    }

    fn worst(&self, criteria: &[Criterion]) -> Vec<WorstRun> {
        let mut worst = Vec::new();
        for criterion in criteria {
            let numbers = self.numbers(criterion.name()).unwrap_or_default();
            let excess = |x: f64| criterion.excess(Some(x).filter(|x| x.is_finite()));
            self.rank(criterion.text(), &numbers, excess, &mut worst);
        }
        if criteria.is_empty()
            && let Some(first) = self.results.iter().find(|c| c.kind != ColumnKind::Text)
        {
            let numbers = self.numbers(&first.name).unwrap_or_default();
            self.rank(&first.name, &numbers, |x| x, &mut worst);
        }
        worst
    }

    /// Adds the runs with the largest excess. Runs without a completed simulation are left out.
    fn rank(
        &self,
        by: &str,
        numbers: &[f64],
        excess: impl Fn(f64) -> f64,
        worst: &mut Vec<WorstRun>,
    ) {
        let simulated = |row: &Row| matches!(row.verdict, Verdict::Success | Verdict::Failure);
        let ranked = self
            .rows
            .iter()
            .zip(numbers)
            .filter(|(row, _)| simulated(row));
        let mut ranked: Vec<_> = ranked.map(|(row, x)| (excess(*x), row, *x)).collect();
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.run.cmp(&b.1.run)));
        worst.extend(ranked.into_iter().take(WORST).map(|(_, row, x)| WorstRun {
            by: by.to_owned(),
            run: row.run,
            value: Some(x).filter(|x| x.is_finite()),
            verdict: row.verdict,
        }));
    }

    fn sensitivities(&self) -> Vec<Sensitivity> {
        let verdicts = self
            .rows
            .iter()
            .map(|row| f64::from(u8::from(row.verdict == Verdict::Success)));
        let mut results = vec![(SUCCESS.to_owned(), verdicts.collect::<Vec<_>>())];
        for column in self.results.iter().filter(|c| c.kind != ColumnKind::Text) {
            if let Some(numbers) = self.numbers(&column.name) {
                results.push((column.name.clone(), numbers));
            }
        }
        let mut found = Vec::new();
        for parameter in self
            .parameters
            .iter()
            .filter(|c| c.kind != ColumnKind::Text)
        {
            let Some(inputs) = self.numbers(&parameter.name) else {
                continue;
            };
            for (result, numbers) in &results {
                if let Some(correlation) = spearman(&inputs, numbers) {
                    found.push(Sensitivity {
                        result: result.clone(),
                        parameter: parameter.name.clone(),
                        rho: correlation.rho,
                        p_value: correlation.p_value,
                        count: correlation.pairs,
                    });
                }
            }
        }
        found.sort_by(|a, b| b.rho.abs().total_cmp(&a.rho.abs()));
        found
    }
}
