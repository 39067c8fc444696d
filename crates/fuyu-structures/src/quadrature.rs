//! Gauss-Legendre quadrature, also with a variable upper limit.

/// Points of each interval: polynomials up to degree 15 are integrated exactly.
pub(crate) const POINTS: usize = 8;

/// Gauss-Legendre points on the interval from 0 to 1.
pub(crate) struct Gauss {
    /// The points, ascending.
    pub(crate) points: [f64; POINTS],
    /// Their weights, with sum 1.
    pub(crate) weights: [f64; POINTS],
    /// `to_point[i][j]`: weight of point j in the integral from 0 to point i of the interpolating polynomial.
    pub(crate) to_point: [[f64; POINTS]; POINTS],
}

impl Gauss {
    pub(crate) fn new() -> Self {
        let (points, weights) = points_and_weights();
        let mut to_point = [[0.0; POINTS]; POINTS];
        for (row, end) in to_point.iter_mut().zip(points) {
            for (j, weight) in row.iter_mut().enumerate() {
                // Lagrange polynomial j has degree POINTS - 1, so the rule on [0, end] is exact.
                let values = points.map(|p| lagrange(&points, j, p * end));
                *weight = end * values.iter().zip(weights).map(|(v, w)| v * w).sum::<f64>();
            }
        }
        Self {
            points,
            weights,
            to_point,
        }
    }
}

fn lagrange(points: &[f64; POINTS], j: usize, x: f64) -> f64 {
    let others = (0..POINTS).filter(|i| *i != j);
    others
        .map(|i| (x - points[i]) / (points[j] - points[i]))
        .product()
}

/// Newton's method on the Legendre polynomial (Abramowitz and Stegun 1964, 25.4.29).
fn points_and_weights() -> ([f64; POINTS], [f64; POINTS]) {
    let n = POINTS as f64;
    let (mut points, mut weights) = ([0.0; POINTS], [0.0; POINTS]);
    for k in 0..POINTS {
        let mut x = -(std::f64::consts::PI * (k as f64 + 0.75) / (n + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..20 {
            let (mut p, mut last) = (x, 1.0);
            for i in 2..=POINTS {
                let i = i as f64;
                (p, last) = (((2.0 * i - 1.0) * x * p - (i - 1.0) * last) / i, p);
            }
            slope = n * (x * p - last) / (x * x - 1.0);
            x -= p / slope;
        }
        points[k] = (1.0 + x) / 2.0;
        weights[k] = 1.0 / ((1.0 - x * x) * slope * slope);
    }
    (points, weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Degree 15 is exact for 8 points; a wrong weight or table entry fails the first power that it touches.
    #[test]
    fn integrates_polynomials_up_to_degree_15_and_to_each_point() {
        let gauss = Gauss::new();
        for power in 0..16 {
            let value: f64 = gauss
                .points
                .iter()
                .zip(gauss.weights)
                .map(|(x, w)| w * x.powi(power))
                .sum();
            assert!(
                (value - 1.0 / f64::from(power + 1)).abs() < 2e-16 * 8.0,
                "{power}: {value}"
            );
        }
        for power in 0..8 {
            for (i, end) in gauss.points.iter().enumerate() {
                let terms = gauss.points.iter().zip(gauss.to_point[i]);
                let value: f64 = terms.map(|(x, w)| w * x.powi(power)).sum();
                let exact = end.powi(power + 1) / f64::from(power + 1);
                assert!(
                    (value - exact).abs() < 1e-14,
                    "{power} {i}: {value} {exact}"
                );
            }
        }
    }
}
