//! Correlated normal variables.

use crate::{SamplingError, normal::normal_quantile, refuse};

/// Normal variables with a covariance matrix, which may be singular.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    /// Lower triangular factor, row by row.
    rows: Vec<Vec<f64>>,
}

impl Covariance {
    /// Factors a covariance matrix, given by rows: Cholesky's method, which skips directions without variance.
    ///
    /// # Errors
    /// If the matrix is not square, symmetric and positive semidefinite, to a relative error of 1e-9.
    pub fn new(matrix: &[Vec<f64>]) -> Result<Self, SamplingError> {
        let n = matrix.len();
        if n == 0 || matrix.iter().any(|row| row.len() != n) {
            let lengths: Vec<_> = matrix.iter().map(Vec::len).collect();
            return refuse(format!(
                "covariance has {n} rows with {lengths:?} numbers; it must be square"
            ));
        }
        if matrix.iter().flatten().any(|x| !x.is_finite()) {
            return refuse("covariance has an entry that is not finite");
        }
        const TOLERANCE: f64 = 1e-9;
        for i in 0..n {
            for j in 0..i {
                let (a, b) = (matrix[i][j], matrix[j][i]);
                let scale = libm::sqrt((matrix[i][i] * matrix[j][j]).abs());
                if (a - b).abs() > TOLERANCE * scale.max(a.abs()) {
                    return refuse(format!(
                        "covariance is not symmetric: {a} in row {i}, column {j}, but {b} in row {j}, column {i}"
                    ));
                }
            }
        }
        let mut rows: Vec<Vec<f64>> = Vec::with_capacity(n);
        for i in 0..n {
            let mut row = vec![0.0; n];
            let variance = matrix[i][i];
            for j in 0..i {
                let known: f64 = (0..j).map(|k| row[k] * rows[j][k]).sum();
                let left = matrix[i][j] - known;
                let scale = libm::sqrt((variance * matrix[j][j]).abs());
                if rows[j][j] > 0.0 {
                    row[j] = left / rows[j][j];
                } else if left.abs() > TOLERANCE.sqrt() * scale {
                    return Err(indefinite(i));
                }
            }
            let known: f64 = row[..i].iter().map(|x| x * x).sum();
            let left = variance - known;
            if variance < 0.0 || left < -TOLERANCE * variance {
                return Err(indefinite(i));
            }
            if left > TOLERANCE * variance {
                row[i] = libm::sqrt(left);
            }
            rows.push(row);
        }
        Ok(Self { rows })
    }

    /// Number of variables.
    pub fn dimensions(&self) -> usize {
        self.rows.len()
    }

    /// Deviations from the mean for one number of (0, 1) per variable.
    ///
    /// # Panics
    /// If there are fewer numbers than variables.
    pub fn deviations(&self, u: &[f64]) -> Vec<f64> {
        let z: Vec<f64> = u.iter().map(|u| normal_quantile(*u)).collect();
        let row = |row: &Vec<f64>| row.iter().zip(&z).map(|(l, z)| l * z).sum();
        assert!(u.len() >= self.rows.len(), "a number per variable");
        self.rows.iter().map(row).collect()
    }
}

fn indefinite(row: usize) -> SamplingError {
    SamplingError(format!(
        "covariance is not positive semidefinite: row {row} has larger covariances than its variance allows"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Design, Sampling};

    #[test]
    fn samples_have_the_covariance() {
        let matrix = [
            vec![4.0, -1.8, 0.5],
            vec![-1.8, 1.0, 0.0],
            vec![0.5, 0.0, 2.0],
        ];
        let covariance = Covariance::new(&matrix).unwrap();
        let n = 40_000;
        let design = Design::new(Sampling::Random, 5, n, &["a", "b", "c"]).unwrap();
        let mut sums = [[0.0; 3]; 3];
        for run in 0..n {
            let u: Vec<_> = (0..3).map(|c| design.coordinate(run, c)).collect();
            let x = covariance.deviations(&u);
            for i in 0..3 {
                for j in 0..3 {
                    sums[i][j] += x[i] * x[j] / n as f64;
                }
            }
        }
        for i in 0..3 {
            for j in 0..3 {
                // Variance of a product of normal variables (Isserlis).
                let variance = matrix[i][i] * matrix[j][j] + matrix[i][j].powi(2);
                let error = 4.0 * (variance / n as f64).sqrt();
                assert!(
                    (sums[i][j] - matrix[i][j]).abs() < error,
                    "{i} {j}: {}",
                    sums[i][j]
                );
            }
        }
    }

    #[test]
    fn a_singular_covariance_is_possible() {
        // x, 2x, and something without variance.
        let matrix = [vec![1.0, 2.0, 0.0], vec![2.0, 4.0, 0.0], vec![0.0; 3]];
        let x = Covariance::new(&matrix)
            .unwrap()
            .deviations(&[0.9, 0.2, 0.3]);
        assert!((x[1] - 2.0 * x[0]).abs() < 1e-15 && x[2] == 0.0, "{x:?}");
    }

    #[test]
    fn impossible_covariances_are_refused() {
        for (matrix, expected) in [
            (
                vec![vec![1.0, 2.0], vec![2.0, 1.0]],
                "positive semidefinite",
            ),
            (vec![vec![-1.0]], "positive semidefinite"),
            (
                vec![vec![0.0, 1.0], vec![1.0, 1.0]],
                "positive semidefinite",
            ),
            (vec![vec![1.0, 0.5], vec![0.4, 1.0]], "not symmetric"),
            (vec![vec![1.0, 0.5]], "must be square"),
            (vec![vec![f64::NAN]], "not finite"),
            (vec![], "must be square"),
        ] {
            let text = Covariance::new(&matrix).unwrap_err().to_string();
            assert!(text.contains(expected), "{text}");
        }
    }
}
