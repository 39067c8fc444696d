//! Parser of campaign files, `config/campaigns/*.yaml`.

use std::{fmt, marker::PhantomData, path::Path};

use fuyu_campaign::Sampling;
use serde::{
    Deserialize, Deserializer,
    de::{MapAccess, Visitor},
};
use serde_json::Value;

/// Content of a campaign file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CampaignFile {
    /// Scenario: a path relative to the file, or `package://PACKAGE/PATH`.
    pub scenario: String,
    pub runs: Option<u64>,
    #[serde(default = "one")]
    pub seed: u64,
    #[serde(default)]
    pub sampling: SamplingName,
    /// Simulated time \[s\].
    pub duration: Option<f64>,
    /// Wall time after which a run is aborted \[s\].
    #[serde(default = "ten_minutes")]
    pub time_limit: f64,
    /// Parameter values that are the same in all runs.
    #[serde(default)]
    pub parameters: InOrder<Value>,
    #[serde(default)]
    pub dispersions: InOrder<DispersionFile>,
    #[serde(default)]
    pub correlated: Vec<CorrelatedFile>,
    #[serde(default)]
    pub keep: KeepFile,
    #[serde(default)]
    pub success: Vec<String>,
}

fn one() -> u64 {
    1
}

fn ten_minutes() -> f64 {
    600.0
}

/// Name of a [`Sampling`].
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum SamplingName {
    #[default]
    Random,
    LatinHypercube,
    Sobol,
}

impl From<SamplingName> for Sampling {
    fn from(name: SamplingName) -> Self {
        match name {
            SamplingName::Random => Self::Random,
            SamplingName::LatinHypercube => Self::LatinHypercube,
            SamplingName::Sobol => Self::Sobol,
        }
    }
}

/// How a drawn number is combined with the scenario's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Apply {
    /// Replaces the value.
    #[default]
    Set,
    /// Adds to the value; rotations are composed.
    Add,
    /// Multiplies the value.
    Scale,
}

/// Dispersion of one parameter; exactly one of the kinds must be given.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DispersionFile {
    #[serde(default)]
    pub apply: Apply,
    pub list: Option<Vec<Value>>,
    pub grid: Option<GridFile>,
    pub choice: Option<Vec<Value>>,
    pub uniform: Option<RangeFile>,
    pub normal: Option<NormalFile>,
    pub truncated_normal: Option<TruncatedFile>,
    pub log_normal: Option<LogNormalFile>,
    pub integers: Option<IntegersFile>,
    pub sphere: Option<SphereFile>,
    pub rotation: Option<RotationFile>,
}

/// One number for all elements, or one for each element.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub(super) enum Numbers {
    One(f64),
    Each(Vec<f64>),
}

impl Numbers {
    /// The number for an element.
    pub fn get(&self, element: usize) -> f64 {
        match self {
            Self::One(x) => *x,
            Self::Each(all) => all[element],
        }
    }

    /// Number of values, if there is one for each element.
    pub fn count(&self) -> Option<usize> {
        match self {
            Self::One(_) => None,
            Self::Each(all) => Some(all.len()),
        }
    }
}

#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub(super) enum GridFile {
    Values(Vec<Value>),
    Range(GridRange),
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GridRange {
    pub min: f64,
    pub max: f64,
    pub count: u64,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RangeFile {
    pub min: Numbers,
    pub max: Numbers,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NormalFile {
    pub mean: Option<Numbers>,
    pub sigma: Option<Numbers>,
    pub covariance: Option<Vec<Vec<f64>>>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TruncatedFile {
    pub mean: Option<Numbers>,
    pub sigma: Numbers,
    pub min: Option<Numbers>,
    pub max: Option<Numbers>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LogNormalFile {
    pub median: Numbers,
    pub sigma: Numbers,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct IntegersFile {
    pub min: i64,
    pub max: i64,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SphereFile {
    pub radius: f64,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RotationFile {
    /// Largest angle \[rad\].
    pub max_angle: Option<f64>,
    /// Standard deviation of each component of the rotation vector \[rad\].
    pub sigma: Option<f64>,
}

/// Several numbers with a covariance.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CorrelatedFile {
    pub parameters: Vec<String>,
    #[serde(default)]
    pub apply: Apply,
    pub mean: Option<Vec<f64>>,
    pub covariance: Vec<Vec<f64>>,
}

/// Data that are kept for each run.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct KeepFile {
    pub results: Option<Vec<String>>,
    pub series: Option<SeriesFile>,
    #[serde(default)]
    pub bags: Bags,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SeriesFile {
    /// Time between two samples \[s\].
    pub period: f64,
    pub values: Vec<String>,
}

/// The runs whose bags are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Bags {
    #[default]
    None,
    All,
    Failed,
}

/// A mapping in the order of the file; repeated keys are errors.
#[derive(Debug, Clone)]
pub(super) struct InOrder<T>(pub Vec<(String, T)>);

impl<T> Default for InOrder<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for InOrder<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Entries<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Entries<T> {
            type Value = InOrder<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a mapping from dotted names of parameters")
            }

            fn visit_unit<E>(self) -> Result<InOrder<T>, E> {
                Ok(InOrder::default())
            }

            fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<InOrder<T>, M::Error> {
                let mut entries: Vec<(String, T)> = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(InOrder(entries))
            }
        }
        deserializer.deserialize_map(Entries(PhantomData))
    }
}

impl CampaignFile {
    /// Parses a text; errors refer to it as `path`.
    ///
    /// # Errors
    /// A line with file, line and mistake.
    pub fn parse(path: &Path, text: &str) -> Result<Self, String> {
        let options = serde_saphyr::options! {
            alias_limits: serde_saphyr::alias_limits! {
                max_total_replayed_events: 100_000,
            },
        };
        let file: Self = serde_saphyr::from_str_with_options(text, options).map_err(|e| {
            let plain = e.without_snippet();
            let line = plain.location().map(|at| format!(":{}", at.line()));
            let problem = plain.to_string();
            let problem = problem.lines().next().unwrap_or_default();
            let problem = problem.split(" at line ").next().unwrap_or_default();
            format!("{}{}: {problem}", path.display(), line.unwrap_or_default())
        })?;
        file.check()
            .map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(file)
    }

    fn check(&self) -> Result<(), String> {
        let positive = |name: &str, value: f64| match value > 0.0 && value.is_finite() {
            true => Ok(()),
            false => Err(format!(
                "{name} is {value}; give a positive number of seconds"
            )),
        };
        if let Some(duration) = self.duration {
            positive("duration", duration)?;
        }
        if let Some(series) = &self.keep.series {
            positive("keep.series.period", series.period)?;
        }
        // JSON and other readers represent integers exactly only up to 2^53.
        if self.seed >= 1 << 53 {
            return Err(format!("seed is {}; give less than 2^53", self.seed));
        }
        positive("time_limit", self.time_limit)
    }
}
