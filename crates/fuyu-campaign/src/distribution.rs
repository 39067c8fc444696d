//! Distributions of a number, by their quantile functions.

use crate::{
    SamplingError,
    normal::{normal_cdf, normal_quantile},
    refuse,
};

/// The distribution of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distribution(Kind);

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Normal {
        mean: f64,
        sigma: f64,
    },
    /// With the probabilities below both ends, for the mirror image if `mirrored`.
    TruncatedNormal {
        mean: f64,
        sigma: f64,
        min: f64,
        max: f64,
        below: [f64; 2],
        mirrored: bool,
    },
    LogNormal {
        median: f64,
        sigma: f64,
    },
    Uniform {
        min: f64,
        max: f64,
    },
    Integers {
        min: i64,
        count: u64,
    },
}

fn finite(name: &str, value: f64) -> Result<(), SamplingError> {
    match value.is_finite() {
        true => Ok(()),
        false => refuse(format!("{name} is {value}; give a finite number")),
    }
}

fn deviation(sigma: f64) -> Result<(), SamplingError> {
    finite("sigma", sigma)?;
    match sigma >= 0.0 {
        true => Ok(()),
        false => refuse(format!(
            "sigma is {sigma}; a standard deviation is not negative"
        )),
    }
}

fn ordered(min: f64, max: f64) -> Result<(), SamplingError> {
    match min < max {
        true => Ok(()),
        false => refuse(format!(
            "min is {min} and max is {max}; min must be below max"
        )),
    }
}

impl Distribution {
    /// Normal with a mean and a standard deviation.
    ///
    /// # Errors
    /// If `sigma` is negative or a number is not finite.
    pub fn normal(mean: f64, sigma: f64) -> Result<Self, SamplingError> {
        finite("mean", mean)?;
        deviation(sigma)?;
        Ok(Self(Kind::Normal { mean, sigma }))
    }

    /// A normal variable with mean and standard deviation `mean` and `sigma`, on condition that it is between `min` and
    /// `max`, of which one may be infinite.
    ///
    /// # Errors
    /// If `sigma` is not positive, `min` is not below `max`, or no double-precision number is as small as the probability of
    /// the condition.
    pub fn truncated_normal(
        mean: f64,
        sigma: f64,
        min: f64,
        max: f64,
    ) -> Result<Self, SamplingError> {
        finite("mean", mean)?;
        deviation(sigma)?;
        if sigma == 0.0 {
            return refuse("sigma is 0; a truncated normal distribution needs a positive one");
        }
        ordered(min, max)?;
        let (low, high) = ((min - mean) / sigma, (max - mean) / sigma);
        // In the upper tail, probabilities of the mirror image keep their digits.
        let mirrored = low > 0.0;
        let below = match mirrored {
            true => [normal_cdf(-high), normal_cdf(-low)],
            false => [normal_cdf(low), normal_cdf(high)],
        };
        // Subnormal probabilities have few digits.
        if below[1] - below[0] < 1e-300 {
            return refuse(format!(
                "min is {min} and max is {max}, so far from the mean {mean} with sigma {sigma} that nothing is between them"
            ));
        }
        Ok(Self(Kind::TruncatedNormal {
            mean,
            sigma,
            min,
            max,
            below,
            mirrored,
        }))
    }

    /// A positive variable whose natural logarithm is normal with standard deviation `sigma`, about that of `median`.
    ///
    /// # Errors
    /// If `median` is not positive or `sigma` is negative.
    pub fn log_normal(median: f64, sigma: f64) -> Result<Self, SamplingError> {
        finite("median", median)?;
        deviation(sigma)?;
        if median <= 0.0 {
            return refuse(format!(
                "median is {median}; a log-normal variable is positive"
            ));
        }
        Ok(Self(Kind::LogNormal { median, sigma }))
    }

    /// Uniform between `min` and `max`.
    ///
    /// # Errors
    /// If `min` is not below `max` or one is not finite.
    pub fn uniform(min: f64, max: f64) -> Result<Self, SamplingError> {
        finite("min", min)?;
        finite("max", max)?;
        finite("max - min", max - min)?;
        ordered(min, max)?;
        Ok(Self(Kind::Uniform { min, max }))
    }

    /// Whole numbers from `min` to `max`, both included, with equal probabilities.
    ///
    /// # Errors
    /// If `min` is above `max`, or a number is beyond 2^53.
    pub fn integers(min: i64, max: i64) -> Result<Self, SamplingError> {
        const LARGEST: i64 = 1 << 53;
        if min > max {
            return refuse(format!(
                "min is {min} and max is {max}; min must not be above max"
            ));
        }
        for (name, value) in [("min", min), ("max", max)] {
            if !(-LARGEST..=LARGEST).contains(&value) {
                return refuse(format!("{name} is {value}; give at most 2^53"));
            }
        }
        Ok(Self(Kind::Integers {
            min,
            count: max.abs_diff(min) + 1,
        }))
    }

    /// Whether it gives whole numbers only.
    pub fn is_integer(&self) -> bool {
        matches!(self.0, Kind::Integers { .. })
    }

    /// The value below which the variable lies with probability `u`, of (0, 1).
    pub fn quantile(&self, u: f64) -> f64 {
        match self.0 {
            Kind::Normal { mean, sigma } => mean + sigma * normal_quantile(u),
            Kind::TruncatedNormal {
                mean,
                sigma,
                min,
                max,
                below: [low, high],
                mirrored,
            } => {
                let x = match mirrored {
                    true => -normal_quantile(high - u * (high - low)),
                    false => normal_quantile(low + u * (high - low)),
                };
                (mean + sigma * x).clamp(min, max)
            }
            Kind::LogNormal { median, sigma } => median * libm::exp(sigma * normal_quantile(u)),
            Kind::Uniform { min, max } => (min + u * (max - min)).min(max),
            Kind::Integers { min, count } => {
                let place = (u * count as f64) as u64;
                min as f64 + place.min(count - 1) as f64
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Design, Sampling};

    const N: u64 = 40_000;

    fn sample(distribution: Distribution) -> Vec<f64> {
        let design = Design::new(Sampling::Random, 11, N, &["x"]).unwrap();
        (0..N)
            .map(|run| distribution.quantile(design.coordinate(run, 0)))
            .collect()
    }

    /// Kolmogorov and Smirnov's distance times sqrt(n): above 1.95 with probability 0.001.
    fn distance(mut sample: Vec<f64>, cdf: impl Fn(f64) -> f64) -> f64 {
        sample.sort_by(f64::total_cmp);
        let n = sample.len() as f64;
        let gaps = sample.iter().enumerate().map(|(i, x)| {
            let p = cdf(*x);
            (p - i as f64 / n).abs().max((p - (i + 1) as f64 / n).abs())
        });
        gaps.fold(0.0, f64::max) * n.sqrt()
    }

    /// Mean and variance are within four standard errors of those given; `kurtosis` is the fourth central moment over the
    /// square of the variance.
    fn moments(sample: &[f64], mean: f64, variance: f64, kurtosis: f64) {
        let n = sample.len() as f64;
        let m = sample.iter().sum::<f64>() / n;
        let v = sample.iter().map(|x| (x - m).powi(2)).sum::<f64>() / (n - 1.0);
        assert!((m - mean).abs() < 4.0 * (variance / n).sqrt(), "{m} {mean}");
        let error = 4.0 * variance * ((kurtosis - 1.0) / n).sqrt();
        assert!((v - variance).abs() < error, "{v} {variance}");
    }

    /// Abramowitz and Stegun 26.2.17, |error| < 7.5e-8: shares no code with `normal_cdf`.
    fn phi(x: f64) -> f64 {
        let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
        let c = [
            0.319_381_530,
            -0.356_563_782,
            1.781_477_937,
            -1.821_255_978,
            1.330_274_429,
        ];
        let sum = c.iter().rev().fold(0.0, |sum, c| (sum + c) * t);
        let tail = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt() * sum;
        if x < 0.0 { tail } else { 1.0 - tail }
    }

    #[test]
    fn normal() {
        let sample = sample(Distribution::normal(3.0, 2.0).unwrap());
        moments(&sample, 3.0, 4.0, 3.0);
        assert!(distance(sample, |x| phi((x - 3.0) / 2.0)) < 1.95);
    }

    #[test]
    fn truncated_normal() {
        let (mean, sigma, min, max) = (1.0, 2.0, 0.0, 4.0);
        let sample = sample(Distribution::truncated_normal(mean, sigma, min, max).unwrap());
        assert!(sample.iter().all(|x| (min..=max).contains(x)));
        // Johnson, Kotz and Balakrishnan 1994, Continuous univariate distributions, section 13.10.1.
        let (a, b) = ((min - mean) / sigma, (max - mean) / sigma);
        let density = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
        let z = phi(b) - phi(a);
        let shift = (density(a) - density(b)) / z;
        let variance =
            sigma.powi(2) * (1.0 + (a * density(a) - b * density(b)) / z - shift * shift);
        moments(&sample, mean + sigma * shift, variance, 2.2);
        assert!(distance(sample, |x| (phi((x - mean) / sigma) - phi(a)) / z) < 1.95);
    }

    // Far in a tail it is nearly exponential with the rate a / sigma: the mean is a + 1/a - 2/a³ + 10/a⁵ (Mills ratio).
    #[test]
    fn truncated_normal_in_the_tails() {
        let a = 20.0;
        for sign in [1.0, -1.0] {
            let ends = [sign * a, sign * f64::INFINITY];
            let (min, max) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
            let tail = Distribution::truncated_normal(0.0, 1.0, min, max).unwrap();
            let sample: Vec<_> = sample(tail).into_iter().map(|x| sign * x).collect();
            let mean = a + 1.0 / a - 2.0 / a.powi(3) + 10.0 / a.powi(5);
            moments(&sample, mean, 1.0 / (a * a) - 6.0 / a.powi(4), 9.0);
        }
    }

    #[test]
    fn log_normal() {
        let (median, sigma) = (2.0f64, 0.5f64);
        let sample = sample(Distribution::log_normal(median, sigma).unwrap());
        let w = (sigma * sigma).exp();
        let kurtosis = w.powi(4) + 2.0 * w.powi(3) + 3.0 * w.powi(2) - 3.0;
        moments(
            &sample,
            median * w.sqrt(),
            median.powi(2) * w * (w - 1.0),
            kurtosis,
        );
        assert!(distance(sample, |x| phi((x / median).ln() / sigma)) < 1.95);
    }

    #[test]
    fn uniform() {
        let sample = sample(Distribution::uniform(-1.0, 3.0).unwrap());
        moments(&sample, 1.0, 16.0 / 12.0, 1.8);
        assert!(distance(sample, |x| (x + 1.0) / 4.0) < 1.95);
    }

    #[test]
    fn integers_are_equally_likely() {
        let sample = sample(Distribution::integers(-2, 3).unwrap());
        let mut counts = [0u32; 6];
        for x in sample {
            assert_eq!(x, x.trunc());
            counts[(x + 2.0) as usize] += 1;
        }
        // Chi-square with 5 degrees of freedom: 99.9 % quantile.
        let expected = N as f64 / 6.0;
        let terms = counts
            .iter()
            .map(|&n| (f64::from(n) - expected).powi(2) / expected);
        assert!(terms.sum::<f64>() < 20.5, "{counts:?}");
    }

    #[test]
    fn impossible_distributions_are_refused_by_name_and_value() {
        let nan = f64::NAN;
        for (wrong, expected) in [
            (Distribution::normal(0.0, -1.0), "sigma is -1"),
            (Distribution::normal(nan, 1.0), "mean is NaN"),
            (Distribution::uniform(2.0, 1.0), "min is 2 and max is 1"),
            (Distribution::uniform(1.0, 1.0), "min must be below max"),
            (Distribution::uniform(0.0, f64::INFINITY), "max is inf"),
            (Distribution::log_normal(0.0, 1.0), "median is 0"),
            (
                Distribution::truncated_normal(0.0, 0.0, -1.0, 1.0),
                "sigma is 0",
            ),
            (
                Distribution::truncated_normal(0.0, 1.0, 1.0, -1.0),
                "min must be below max",
            ),
            (
                Distribution::truncated_normal(0.0, 1.0, 50.0, 60.0),
                "nothing is between",
            ),
            (Distribution::integers(3, 2), "min is 3"),
        ] {
            let text = wrong.unwrap_err().to_string();
            assert!(text.contains(expected), "{text}");
        }
    }

    #[test]
    fn quantiles_stay_in_range_at_the_ends() {
        let ends = [0.5 / (1u64 << 52) as f64, 1.0 - 0.5 / (1u64 << 52) as f64];
        for u in ends {
            assert!(
                (0.0..=4.0).contains(
                    &Distribution::truncated_normal(1.0, 2.0, 0.0, 4.0)
                        .unwrap()
                        .quantile(u)
                )
            );
            assert!((1.0..=6.0).contains(&Distribution::integers(1, 6).unwrap().quantile(u)));
            assert!((-0.1..=0.2).contains(&Distribution::uniform(-0.1, 0.2).unwrap().quantile(u)));
            assert!(
                Distribution::normal(0.0, 1.0)
                    .unwrap()
                    .quantile(u)
                    .is_finite()
            );
        }
    }
}
