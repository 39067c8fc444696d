//! Whether points move as one rigid body.
//!
//! Under weak perspective, the image coordinates of points of a rigid body over K frames, one column of 2 K rows for each
//! point, are affine combinations of four (Tomasi and Kanade 1992): they are in an affine space of three dimensions. Points that lie on a silhouette,
//! on a shadow's edge or on another body are not. The space is found by sampling columns (Fischler and Bolles 1981), then from all columns that are in it.

use nalgebra::{DMatrix, DVector};

/// Samples of four points.
const SAMPLES: usize = 30;
/// Fewest points of which something can be said: four make the space, and two others have to confirm it.
const FEWEST: usize = 6;
/// Largest distance of a point from the middle of the body over the median of these distances.
const MOST_REMOTE: f64 = 8.0;
/// Fewest points that show a new body.
const FEWEST_NEW: usize = 8;
/// How many others a trusted point counts for.
const TRUST: f64 = 5.0;
/// Dimensions.
const RANK: usize = 3;
/// Points that make the space.
const MINIMAL: usize = RANK + 1;

/// Root mean square deviation of each column from the motion that most of them share \[px\]; `None` if there is no such
/// motion. Points that are `trusted` count more, and half of them must share it: the edge of a shadow that covers most of a body is no body.
/// `columns` has the coordinates of one point in each column, `limit` is the largest deviation \[px\].
pub(crate) fn deviations(
    columns: &DMatrix<f64>,
    trusted: &[bool],
    limit: f64,
    seed: u64,
) -> Option<Vec<f64>> {
    let (rows, n) = columns.shape();
    if n < FEWEST || rows <= MINIMAL + 2 {
        return None;
    }
    let mut random = seed;
    let mut best: Option<(f64, Vec<f64>)> = None;
    let all: Vec<usize> = (0..n).collect();
    let believed: Vec<usize> = (0..n).filter(|i| trusted[*i]).collect();
    for sample in 0..SAMPLES {
        // Every other one of trusted points only: they may be few.
        let from = match believed.len() >= MINIMAL && sample % 2 == 0 {
            true => &believed,
            false => &all,
        };
        let mut picked = [0; MINIMAL];
        for k in 0..MINIMAL {
            loop {
                random = random
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                let i = from[(random >> 33) as usize % from.len()];
                if !picked[..k].contains(&i) {
                    picked[k] = i;
                    break;
                }
            }
        }
        let sample: Vec<_> = picked.iter().map(|i| columns.column(*i)).collect();
        let found = Space::fitting(&DMatrix::from_columns(&sample)).distances(columns);
        // Truncated squares: outliers count alike, and inliers by how well they fit.
        let bound = 2.0 * limit;
        let costs = found.iter().zip(trusted).map(|(d, trusted)| {
            let weight = if *trusted { TRUST } else { 1.0 };
            weight * (d / bound).min(1.0).powi(2)
        });
        let cost: f64 = costs.sum();
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, found));
        }
    }
    let (_, mut found) = best?;
    let mut bound = 2.0 * limit;
    for _ in 0..3 {
        let inliers: Vec<_> = (0..n)
            .filter(|i| found[*i] <= bound)
            .map(|i| columns.column(i))
            .collect();
        let all = trusted.iter().filter(|t| **t).count();
        let kept = (found.iter().zip(trusted)).filter(|(d, t)| **t && **d <= bound);
        let needed = match all {
            0 => FEWEST_NEW.max(n / 2),
            _ => FEWEST,
        };
        if inliers.len() < needed || 2 * kept.count() < all {
            return None;
        }
        let space = Space::fitting(&DMatrix::from_columns(&inliers));
        found = space.distances(columns);
        for (found, far) in found.iter_mut().zip(space.remoteness(columns, limit)) {
            *found = found.max(limit * far / MOST_REMOTE);
        }
        bound = limit;
    }
    Some(found)
}

/// An affine space of three dimensions.
struct Space {
    mean: DVector<f64>,
    /// Orthonormal.
    directions: Vec<DVector<f64>>,
}

impl Space {
    /// The one that fits columns best: through their mean, along their first three principal directions.
    fn fitting(basis: &DMatrix<f64>) -> Self {
        let mean = basis.column_mean();
        let mut centred = basis.clone();
        for mut column in centred.column_iter_mut() {
            column -= &mean;
        }
        let directions = if centred.ncols() <= MINIMAL {
            let q = centred.columns(0, RANK).into_owned().qr().q();
            q.column_iter().map(|c| c.clone_owned()).collect()
        } else {
            let eigen = (&centred * centred.transpose()).symmetric_eigen();
            let mut order: Vec<usize> = (0..basis.nrows()).collect();
            order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
            let first = order[..RANK].iter();
            first
                .map(|i| eigen.eigenvectors.column(*i).clone_owned())
                .collect()
        };
        Self { mean, directions }
    }

    /// Root mean square distance of the points of each column from the space \[px\].
    fn distances(&self, columns: &DMatrix<f64>) -> Vec<f64> {
        let points = (columns.nrows() / 2) as f64;
        let mut rest = vec![0.0; columns.nrows()];
        // Small vectors as slices: nalgebra's operations on dynamic ones take longer than these sums.
        let distances = columns
            .as_slice()
            .chunks_exact(columns.nrows())
            .map(|column| {
                for ((rest, x), mean) in rest.iter_mut().zip(column).zip(self.mean.as_slice()) {
                    *rest = x - mean;
                }
                for direction in &self.directions {
                    let direction = direction.as_slice();
                    let along: f64 = rest.iter().zip(direction).map(|(x, d)| x * d).sum();
                    for (x, d) in rest.iter_mut().zip(direction) {
                        *x -= along * d;
                    }
                }
                (rest.iter().map(|x| x * x).sum::<f64>() / points).sqrt()
            });
        distances.collect()
    }

    /// Distance of each column from the middle one along that direction in which it is largest, over the median of these distances, or over
    /// `least` \[px\] if that is more. What slides over a body in the direction in which its other points move has the motion of a point far in
    /// front of it or behind it.
    fn remoteness(&self, columns: &DMatrix<f64>, least: f64) -> Vec<f64> {
        let mut most = vec![0.0_f64; columns.ncols()];
        let floor = least * ((columns.nrows() / 2) as f64).sqrt();
        for direction in &self.directions {
            let along = columns.column_iter().map(|column| direction.dot(&column));
            let mut along: Vec<f64> = along.collect();
            let middle = median(along.clone());
            for x in &mut along {
                *x = (*x - middle).abs();
            }
            let usual = median(along.clone()).max(floor);
            for (most, x) in most.iter_mut().zip(along) {
                *most = most.max(x / usual);
            }
        }
        most
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};

    /// Points of a body of 1 m radius that tumbles 10 m in front of a camera of 640 px focal length, with a deterministic noise of
    /// 0.1 px; the last `wrong` of them drift by `slip` px a frame, across
    /// the direction in which points of other depths move. Along it, no such test can tell.
    fn columns(n: usize, wrong: usize, slip: f64) -> DMatrix<f64> {
        let frames = 8;
        DMatrix::from_fn(2 * frames, n, |row, i| {
            let (k, axis) = (row / 2, row % 2);
            let a = i as f64;
            let direction = Vector3::new((2.1 * a).sin(), (1.3 * a).cos(), (0.7 * a + 1.0).sin());
            let rotation = Rotation3::new(Vector3::new(0.1, 0.3, 1.0) * 0.03 * k as f64);
            let p = rotation * direction.normalize() + Vector3::new(0.0, 0.0, 10.0);
            let pixel = 320.0 + 640.0 * p[axis] / p.z;
            let noise = 0.1 * ((row * 7919 + i * 104_729) as f64).sin();
            let drift = if i + wrong >= n { slip * k as f64 } else { 0.0 };
            pixel + noise + if axis == 0 { 0.4 * drift } else { drift }
        })
    }

    #[test]
    fn points_that_slide_on_the_body_are_found() {
        let found = deviations(&columns(30, 8, 0.6), &[false; 30], 0.5, 1).unwrap();
        assert!(found[..22].iter().all(|d| *d < 0.5), "{found:?}");
        assert!(found[22..].iter().all(|d| *d > 0.5), "{found:?}");
    }

    #[test]
    fn points_that_slide_where_depth_would_move_them_are_found() {
        let mut columns = columns(30, 0, 0.0);
        for mut column in columns.column_iter_mut().skip(26) {
            for k in 0..8 {
                // Across the axis of rotation, as other depths do.
                column[2 * k] += 0.3 * 10.0 * k as f64;
                column[2 * k + 1] -= 0.1 * 10.0 * k as f64;
            }
        }
        let found = deviations(&columns, &[false; 30], 0.5, 1).unwrap();
        assert!(found[..26].iter().all(|d| *d < 0.5), "{found:?}");
        assert!(found[26..].iter().all(|d| *d > 0.5), "{found:?}");
    }

    #[test]
    fn a_rigid_body_has_no_outliers() {
        let found = deviations(&columns(30, 0, 0.0), &[false; 30], 0.5, 1).unwrap();
        assert!(found.iter().all(|d| *d < 0.3), "{found:?}");
    }

    #[test]
    fn what_most_points_do_is_not_believed_against_trusted_ones() {
        // Twenty-three points that slide alike are rigid among themselves.
        let mut columns = columns(30, 0, 0.0);
        for mut column in columns.column_iter_mut().skip(7) {
            for k in 0..8 {
                column[2 * k + 1] += (k * k) as f64;
            }
        }
        let mut trusted = [false; 30];
        assert!(deviations(&columns, &trusted, 0.5, 1).unwrap()[20] < 0.5);
        trusted[..7].fill(true);
        let found = deviations(&columns, &trusted, 0.5, 1).unwrap();
        assert!(found[..7].iter().all(|d| *d < 0.5), "{found:?}");
        assert!(found[7..].iter().all(|d| *d > 0.5), "{found:?}");
    }

    #[test]
    fn few_points_tell_nothing() {
        assert_eq!(deviations(&columns(5, 0, 0.0), &[false; 5], 0.5, 1), None);
    }
}
