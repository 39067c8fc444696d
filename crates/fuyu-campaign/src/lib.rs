//! Sampling and statistics of Monte Carlo campaigns.
//!
//! Every drawn number is a pure function of the campaign's seed, the name of the quantity and the number of the run, and
//! has the same bits on every machine: only IEEE 754 arithmetic, square roots and the functions of `libm` are used, not
//! those of the platform.
//!
//! ```
//! use fuyu_campaign::{Design, Distribution, Sampling, success_interval};
//!
//! let design = Design::new(Sampling::Sobol, 7, 10_000, &["mass", "friction"])?;
//! let mass = Distribution::normal(900.0, 15.0)?;
//! let of_run_4711: f64 = mass.quantile(design.coordinate(4711, 0));
//! assert!((of_run_4711 - 900.0).abs() < 100.0);
//!
//! let interval = success_interval(972, 1000, 0.95);
//! assert!((interval.lower - 0.9598).abs() < 1e-4 && (interval.upper - 0.9813).abs() < 1e-4);
//! # Ok::<(), fuyu_campaign::SamplingError>(())
//! ```

mod beta;
mod covariance;
mod design;
mod distribution;
mod normal;
mod random;
mod rotation;
mod sobol;
mod statistics;

pub use covariance::Covariance;
pub use design::{Design, Sampling};
pub use distribution::Distribution;
pub use normal::{normal_cdf, normal_quantile};
pub use random::{mix, seed_of, text_hash};
pub use rotation::{compose, on_sphere, rotation_from_vector, rotation_within, uniform_rotation};
pub use sobol::MOST_DIMENSIONS;
pub use statistics::{
    Interval, RankCorrelation, mean_and_deviation, quantile, spearman, success_interval,
};

/// Why something cannot be sampled. The text says what would be right.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct SamplingError(pub String);

fn refuse<T>(text: impl Into<String>) -> Result<T, SamplingError> {
    Err(SamplingError(text.into()))
}
