//! Statistics of results.

use crate::beta::{incomplete_beta, inverse_incomplete_beta};

/// A confidence interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub lower: f64,
    /// Upper end.
    pub upper: f64,
}

/// The interval of Clopper and Pearson 1934 for a probability, from the number of successes in independent trials: it contains
/// the probability in a share of at least `confidence` of all cases, whatever the probability is.
///
/// # Panics
/// If there are more successes than trials, or `confidence` is not in (0, 1).
pub fn success_interval(successes: u64, trials: u64, confidence: f64) -> Interval {
    assert!(successes <= trials && confidence > 0.0 && confidence < 1.0);
    let tail = 0.5 * (1.0 - confidence);
    let (k, n) = (successes as f64, trials as f64);
    Interval {
        lower: match successes {
            0 => 0.0,
            _ => inverse_incomplete_beta(k, n - k + 1.0, tail),
        },
        upper: match trials - successes {
            0 => 1.0,
            _ => inverse_incomplete_beta(k + 1.0, n - k, 1.0 - tail),
        },
    }
}

/// Mean and standard deviation (divided by n - 1). The deviation is NaN for fewer than two numbers.
pub fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
    (mean, (squares / (n - 1.0)).sqrt())
}

/// The quantile `p` of sorted numbers, interpolated between two of them: type 7 of Hyndman and Fan 1996, as NumPy has it by
/// default. NaN without numbers.
pub fn quantile(sorted: &[f64], p: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return f64::NAN;
    };
    let place = p.clamp(0.0, 1.0) * last as f64;
    let below = place.floor() as usize;
    let (a, b) = (sorted[below], sorted[(below + 1).min(last)]);
    match a == b {
        true => a,
        false => a + (place - below as f64) * (b - a),
    }
}

/// Spearman's rank correlation of two quantities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RankCorrelation {
    /// The coefficient, -1 to 1.
    pub rho: f64,
    /// Probability that independent quantities have a coefficient at least as large: Student's t approximation.
    pub p_value: f64,
    /// Number of pairs.
    pub pairs: usize,
}

/// Spearman's rank correlation of the pairs in which both numbers are finite. `None` if there are fewer than three, or if one
/// quantity does not vary.
pub fn spearman(x: &[f64], y: &[f64]) -> Option<RankCorrelation> {
    let pairs = x
        .iter()
        .zip(y)
        .filter(|(x, y)| x.is_finite() && y.is_finite());
    let (x, y): (Vec<f64>, Vec<f64>) = pairs.map(|(x, y)| (*x, *y)).unzip();
    if x.len() < 3 {
        return None;
    }
    let (x, y) = (ranks(&x), ranks(&y));
    let n = x.len() as f64;
    let mean = 0.5 * (n + 1.0);
    let sum = |a: &[f64], b: &[f64]| -> f64 {
        let products = a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean));
        products.sum()
    };
    let (xx, yy, xy) = (sum(&x, &x), sum(&y, &y), sum(&x, &y));
    if xx == 0.0 || yy == 0.0 {
        return None;
    }
    let rho = (xy / (xx * yy).sqrt()).clamp(-1.0, 1.0);
    // Of Student's t with n - 2 degrees of freedom: t² = (n - 2) rho² / (1 - rho²). No value is rarer than the two in the same
    // and in the opposite order, of n! orders.
    let students = incomplete_beta(0.5 * (n - 2.0), 0.5, 1.0 - rho * rho);
    let p_value = students.max(2.0 * libm::exp(-libm::lgamma(n + 1.0)));
    Some(RankCorrelation {
        rho,
        p_value,
        pairs: x.len(),
    })
}

/// Ranks from 1; equal numbers have the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    let mut start = 0;
    while start < order.len() {
        let value = values[order[start]];
        let equal = order[start..]
            .iter()
            .take_while(|i| values[**i] == value)
            .count();
        let rank = start as f64 + 0.5 * (equal as f64 + 1.0);
        for i in &order[start..start + equal] {
            ranks[*i] = rank;
        }
        start += equal;
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Design, Sampling};

    /// Probability of at most `k` successes, by summing binomial probabilities.
    fn at_most(k: u64, n: u64, p: f64) -> f64 {
        // The first term of a likely success is too small for a number.
        if p > 0.5 && k < n {
            return 1.0 - at_most(n - k - 1, n, 1.0 - p);
        }
        let mut term = (1.0 - p).powi(n as i32);
        let mut sum = term;
        for i in 0..k {
            term *= (n - i) as f64 / (i + 1) as f64 * p / (1.0 - p);
            sum += term;
        }
        sum
    }

    // The definition: at the ends of the interval, what was seen or more extreme has the probability of a tail.
    #[test]
    fn the_interval_is_that_of_the_binomial_tails() {
        for (k, n) in [(1, 10), (5, 10), (9, 10), (95, 100), (3, 200), (499, 500)] {
            let Interval { lower, upper } = success_interval(k, n, 0.95);
            assert!(
                (1.0 - at_most(k - 1, n, lower) - 0.025).abs() < 1e-9,
                "{k} of {n}"
            );
            assert!((at_most(k, n, upper) - 0.025).abs() < 1e-9, "{k} of {n}");
        }
        // The rule of three, exactly: 1 - 0.025^(1/n).
        let all = success_interval(100, 100, 0.95);
        assert!((all.lower - 0.025f64.powf(0.01)).abs() < 1e-12 && all.upper == 1.0);
        let none = success_interval(0, 100, 0.95);
        assert!(none.lower == 0.0 && (none.upper - (1.0 - 0.025f64.powf(0.01))).abs() < 1e-12);
    }

    // 200 campaigns of 100 runs. The number of intervals that contain the probability is binomial with at least 0.95: fewer than
    // 180 has probability 0.001.
    #[test]
    fn the_interval_contains_the_probability_as_often_as_it_says() {
        for probability in [0.1, 0.5, 0.9, 0.97] {
            let mut contained = 0;
            for campaign in 0..200 {
                let design = Design::new(Sampling::Random, campaign, 100, &["x"]).unwrap();
                let successes = (0..100).filter(|run| design.coordinate(*run, 0) < probability);
                let Interval { lower, upper } =
                    success_interval(successes.count() as u64, 100, 0.95);
                contained += u32::from((lower..=upper).contains(&probability));
            }
            assert!(contained >= 180, "{probability}: {contained} of 200");
        }
    }

    #[test]
    fn quantiles_are_interpolated() {
        let sorted = [1.0, 2.0, 4.0, 8.0];
        // numpy.quantile([1, 2, 4, 8], [0, 0.1, 0.5, 0.9, 1])
        for (p, expected) in [(0.0, 1.0), (0.1, 1.3), (0.5, 3.0), (0.9, 6.8), (1.0, 8.0)] {
            assert!((quantile(&sorted, p) - expected).abs() < 1e-12, "{p}");
        }
        assert!(quantile(&[], 0.5).is_nan());
        assert_eq!(quantile(&[3.0], 0.5), 3.0);
    }

    // Without ties: 1 - 6 sum d² / (n (n² - 1)). With ties and p-value: scipy.stats.spearmanr, SciPy 1.14.
    #[test]
    fn rank_correlation() {
        let x = [
            106.0, 100.0, 86.0, 101.0, 99.0, 103.0, 97.0, 113.0, 112.0, 110.0,
        ];
        let y = [7.0, 27.0, 2.0, 50.0, 28.0, 29.0, 20.0, 12.0, 6.0, 17.0];
        let found = spearman(&x, &y).unwrap();
        assert!(
            (found.rho - (1.0 - 6.0 * 194.0 / 990.0)).abs() < 1e-12,
            "{found:?}"
        );
        assert!(
            (found.p_value - 0.627_188_344_781_084_2).abs() < 1e-8,
            "{found:?}"
        );
        let tied = spearman(&[1.0, 2.0, 2.0, 3.0], &[1.0, 3.0, 2.0, 4.0]).unwrap();
        assert!(
            (tied.rho - 0.948_683_298_050_513_8).abs() < 1e-12,
            "{tied:?}"
        );
        let monotonic: Vec<f64> = x.iter().map(|x| x.powi(3)).collect();
        assert_eq!(spearman(&x, &monotonic).unwrap().rho, 1.0);
        // Of 24 orders of four values, two are monotonic.
        let four = spearman(&x[..4], &monotonic[..4]).unwrap();
        assert!((four.p_value - 2.0 / 24.0).abs() < 1e-12, "{four:?}");
        assert_eq!(spearman(&x, &[1.0; 10]), None);
        assert_eq!(spearman(&[1.0, f64::NAN, 2.0], &[1.0, 2.0, 3.0]), None);
    }

    #[test]
    fn mean_and_deviation_of_numbers() {
        let (mean, deviation) = mean_and_deviation(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]);
        assert_eq!(mean, 5.0);
        assert!((deviation - (32.0f64 / 7.0).sqrt()).abs() < 1e-15);
    }
}
