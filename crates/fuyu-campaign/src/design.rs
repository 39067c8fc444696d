//! Designs: which point of the unit cube belongs to a run.

use crate::{
    SamplingError,
    random::{at, permute, stream, text_hash, unit},
    refuse, sobol,
};

/// How the points of the runs are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sampling {
    /// Independent random points.
    #[default]
    Random,
    /// Each coordinate has one point in each of as many equal parts as there are runs (McKay, Beckman and Conover 1979).
    LatinHypercube,
    /// Sobol points with Owen's scrambling. Best with a power of two as number of runs.
    Sobol,
}

impl Sampling {
    /// Names and values, as files write them.
    pub const NAMES: [(&str, Self); 3] = [
        ("random", Self::Random),
        ("latin_hypercube", Self::LatinHypercube),
        ("sobol", Self::Sobol),
    ];
}

/// A point of the unit cube for each run, as a pure function of the run's number.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    sampling: Sampling,
    runs: u64,
    /// Seed of each coordinate.
    seeds: Vec<u64>,
}

impl Design {
    /// A design for `runs` runs with one coordinate for each name. A coordinate depends on its own name, but not on the other
    /// coordinates, except that Sobol points depend on their order.
    ///
    /// # Errors
    /// If there are too many runs or coordinates for Sobol points, or no runs.
    pub fn new(
        sampling: Sampling,
        seed: u64,
        runs: u64,
        names: &[impl AsRef<str>],
    ) -> Result<Self, SamplingError> {
        if runs == 0 {
            return refuse("a campaign needs at least one run");
        }
        if sampling == Sampling::Sobol {
            sobol::check(names.len())?;
            if runs > sobol::POINTS {
                return refuse(format!(
                    "there are {} Sobol points, fewer than {runs} runs",
                    sobol::POINTS
                ));
            }
        }
        let seeds = names
            .iter()
            .map(|name| stream(seed, text_hash(name.as_ref())));
        Ok(Self {
            sampling,
            runs,
            seeds: seeds.collect(),
        })
    }

    /// Number of coordinates.
    pub fn dimensions(&self) -> usize {
        self.seeds.len()
    }

    /// One coordinate of the point of a run, in (0, 1).
    ///
    /// # Panics
    /// If there is no such run or coordinate.
    pub fn coordinate(&self, run: u64, coordinate: usize) -> f64 {
        assert!(run < self.runs, "run {run} of {}", self.runs);
        let seed = self.seeds[coordinate];
        match self.sampling {
            Sampling::Random => unit(at(seed, run)),
            Sampling::LatinHypercube => {
                let part = permute(run, self.runs, seed);
                // Below 1 also after rounding in the last part.
                let x = (part as f64 + unit(at(!seed, run))) / self.runs as f64;
                x.min(1.0 - f64::EPSILON / 2.0)
            }
            Sampling::Sobol => unit(sobol::scramble(sobol::point(run, coordinate), seed)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(sampling: Sampling, runs: u64, coordinate: usize) -> Vec<f64> {
        let design = Design::new(sampling, 3, runs, &["a", "b", "c"]).unwrap();
        (0..runs)
            .map(|run| design.coordinate(run, coordinate))
            .collect()
    }

    #[test]
    fn a_latin_hypercube_has_one_point_in_every_part() {
        for runs in [1, 7, 100, 1000] {
            for coordinate in 0..3 {
                let points = numbers(Sampling::LatinHypercube, runs, coordinate);
                let mut parts: Vec<u64> = points.iter().map(|x| (x * runs as f64) as u64).collect();
                parts.sort_unstable();
                assert_eq!(parts, (0..runs).collect::<Vec<_>>());
            }
        }
    }

    // Kolmogorov and Smirnov: D sqrt(n) is above 1.95 with probability 0.001.
    #[test]
    fn random_points_are_uniform_and_independent() {
        let n = 20_000;
        let columns: Vec<_> = (0..3).map(|c| numbers(Sampling::Random, n, c)).collect();
        for column in &columns {
            let mut sorted = column.clone();
            sorted.sort_by(f64::total_cmp);
            let distance = sorted.iter().enumerate().map(|(i, x)| {
                (x - i as f64 / n as f64)
                    .abs()
                    .max((x - (i + 1) as f64 / n as f64).abs())
            });
            assert!(distance.fold(0.0, f64::max) * (n as f64).sqrt() < 1.95);
        }
        let correlation = |a: &[f64], b: &[f64]| {
            let products = a.iter().zip(b).map(|(a, b)| (a - 0.5) * (b - 0.5));
            12.0 * products.sum::<f64>() / n as f64
        };
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            assert!(correlation(&columns[a], &columns[b]).abs() * (n as f64).sqrt() < 3.3);
        }
        // Successive runs.
        assert!(
            correlation(&columns[0][1..], &columns[0][..n as usize - 1]).abs() * (n as f64).sqrt()
                < 3.3
        );
    }

    // The mean of a smooth function converges faster than with random points: with 1024 points the error of random ones would be
    // about 0.01.
    #[test]
    fn sobol_points_integrate_better() {
        let design = Design::new(Sampling::Sobol, 3, 1024, &["a", "b", "c"]).unwrap();
        let f = |run| {
            (0..3)
                .map(|c| 2.0 * design.coordinate(run, c))
                .product::<f64>()
        };
        let mean = (0..1024).map(f).sum::<f64>() / 1024.0;
        assert!((mean - 1.0).abs() < 1e-3, "{mean}");
    }

    #[test]
    fn other_seeds_and_names_give_other_numbers_and_other_names_do_not_matter() {
        let first = |seed, names: &[&str]| {
            Design::new(Sampling::Random, seed, 10, names)
                .unwrap()
                .coordinate(4, 0)
        };
        assert_eq!(first(1, &["a"]), first(1, &["a", "b"]));
        assert_ne!(first(1, &["a"]), first(2, &["a"]));
        assert_ne!(first(1, &["a"]), first(1, &["b"]));
    }

    #[test]
    fn impossible_designs_are_refused() {
        let names: Vec<String> = (0..101).map(|i| i.to_string()).collect();
        let error = Design::new(Sampling::Sobol, 1, 10, &names)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("at most 100 dimensions") && error.contains("101"),
            "{error}"
        );
        assert!(Design::new(Sampling::Random, 1, 0, &["a"]).is_err());
    }
}
