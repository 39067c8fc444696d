//! Relative pose of two views with some wrong correspondences: RANSAC, then least squares.
//!
//! Candidates are Weng's linear solution, a pure rotation (for a body that turns about the optical axis the translation
//! is not observable), and, if these explain the views poorly, five-point solutions of random samples. The best few are
//! refined on all points with Cauchy's cost.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{
    Dyn, Matrix3, OMatrix, OVector, Owned, Rotation3, SMatrix, U5, UnitQuaternion, UnitVector3,
    Vector3,
};
use rand::{Rng, seq::index};

use super::five_point::essential_matrices;
use super::rotations::{right_jacobian, rotation_between_rays};
use crate::estimation::two_view::two_view_motion;
use crate::spatial::exp_so3;

/// Least number of correspondences; five determine the motion, the others test it.
pub const MIN_POINTS: usize = 7;

/// Number of random samples. With 20 % wrong correspondences a third of them contains none.
const SAMPLES: usize = 40;

/// Rays of a point in both views, scaled to z = 1.
pub type Pair = (Vector3<f64>, Vector3<f64>);

/// `x' = R x + T` with the length of `T` unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativePose {
    /// Rotation.
    pub R: Rotation3<f64>,
    /// Direction of translation; arbitrary if there is no translation.
    pub direction: UnitVector3<f64>,
    /// For each correspondence, whether it agrees with the motion.
    pub agreeing: Vec<bool>,
    /// Root mean square of Sampson's error over the agreeing correspondences, in the rays' units.
    pub rms: f64,
    /// Information on the rotation (in the first view's axes) with the direction marginalised out, for
    /// Sampson errors of unit variance.
    pub information: Matrix3<f64>,
}

/// The motion that most of `pairs` agree on; `noise` is the standard deviation of an image point in the rays'
/// units. `None` if too few agree.
pub fn relative_pose(pairs: &[Pair], noise: f64, rng: &mut impl Rng) -> Option<RelativePose> {
    if pairs.len() < MIN_POINTS {
        return None;
    }
    let scale = 3.0 * noise;
    let mut best = finish(best_of(starts(pairs, scale), pairs, scale)?, pairs, noise);
    let doubtful = |found: &Option<RelativePose>| {
        (found.as_ref()).is_none_or(|f| {
            let agreeing = f.agreeing.iter().filter(|a| **a).count();
            10 * agreeing < 9 * pairs.len() || f.rms > 1.5 * noise
        })
    };
    if doubtful(&best) {
        let mut drawn = Vec::new();
        for _ in 0..SAMPLES {
            let sample = index::sample(rng, pairs.len(), 5);
            let sample = std::array::from_fn(|k| pairs[sample.index(k)]);
            for E in essential_matrices(&sample) {
                drawn.extend(decompose(&E, &sample));
            }
        }
        let drawn = best_first(drawn, pairs, scale).take(5).collect();
        let sampled = best_of(drawn, pairs, scale).and_then(|m| finish(m, pairs, noise));
        let quality = |f: &RelativePose| score(&(f.R, f.direction), pairs, scale);
        best = match (best, sampled) {
            (Some(a), Some(b)) => Some(if quality(&b) < quality(&a) { b } else { a }),
            (a, b) => a.or(b),
        };
    }
    best
}

/// Standard deviation of an image point in the rays' units, from the median of Sampson's errors between two views (so
/// some correspondences may be wrong). `noise` is a lower estimate of it. `None` with fewer than ten points.
pub fn noise_between(pairs: &[Pair], noise: f64) -> Option<f64> {
    // The motion has five unknowns.
    let freedom = pairs.len().checked_sub(5).filter(|f| *f >= 5)? as f64;
    let scale = 3.0 * noise;
    let found = best_of(starts(pairs, scale), pairs, scale)?;
    let E = essential(&found);
    let mut errors: Vec<f64> = pairs.iter().map(|p| sampson(&E, p).abs()).collect();
    let middle = errors.len() / 2;
    let median = *errors.select_nth_unstable_by(middle, f64::total_cmp).1;
    // The median absolute value of a Gaussian is 0.6745 standard deviations.
    Some(median / 0.6745 * (pairs.len() as f64 / freedom).sqrt())
}

type Candidate = (Rotation3<f64>, UnitVector3<f64>);

/// Deterministic candidates: the linear solution, and pure rotation.
fn starts(pairs: &[Pair], scale: f64) -> Vec<Candidate> {
    let linear = two_view_motion(pairs).ok().map(|m| (m.R, m.direction));
    let turned = rotation_between_rays(pairs, scale);
    let axes = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
    let turns = axes.map(|T| (turned, T));
    linear.into_iter().chain(turns).collect()
}

/// The candidate with the least cost after refinement.
fn best_of(candidates: Vec<Candidate>, pairs: &[Pair], scale: f64) -> Option<Candidate> {
    let refined = candidates.into_iter().map(|c| refine(c, pairs, scale));
    best_first(refined.collect(), pairs, scale).next()
}

/// The candidates by ascending cost.
fn best_first(
    candidates: Vec<Candidate>,
    pairs: &[Pair],
    scale: f64,
) -> impl Iterator<Item = Candidate> {
    let scored = candidates.into_iter().map(|c| (score(&c, pairs, scale), c));
    let mut scored: Vec<_> = scored.collect();
    scored.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    scored.into_iter().map(|(_, candidate)| candidate)
}

/// Cauchy's cost over all pairs.
fn score(candidate: &Candidate, pairs: &[Pair], scale: f64) -> f64 {
    let E = essential(candidate);
    let cost = |p: &Pair| (sampson(&E, p) / scale).powi(2).ln_1p();
    pairs.iter().map(cost).sum()
}

fn essential((R, T): &Candidate) -> Matrix3<f64> {
    T.cross_matrix() * R.matrix()
}

/// Distance of a correspondence from satisfying `second · E first = 0`, to first order.
fn sampson(E: &Matrix3<f64>, (first, second): &Pair) -> f64 {
    let (a, b) = (E * first, E.tr_mul(second));
    let slope = a.xy().norm_squared() + b.xy().norm_squared();
    second.dot(&a) / slope.sqrt().max(f64::MIN_POSITIVE)
}

/// The rotation and translation of `E` that put most points before the camera.
fn decompose(E: &Matrix3<f64>, pairs: &[Pair]) -> Option<Candidate> {
    let svd = E.try_svd(true, true, 1e-14, 100)?;
    let (mut U, mut Vt) = (svd.u?, svd.v_t?);
    if U.determinant() < 0.0 {
        U = -U;
    }
    if Vt.determinant() < 0.0 {
        Vt = -Vt;
    }
    let W = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let smallest = svd.singular_values.imin();
    // nalgebra sorts singular values; E has two equal ones and a zero.
    debug_assert_eq!(smallest, 2);
    let T = UnitVector3::new_normalize(U.column(2).into_owned());
    let both = [U * W * Vt, U * W.transpose() * Vt];
    let rotations = both.map(Rotation3::from_matrix_unchecked);
    let all = rotations.into_iter().flat_map(|R| [(R, T), (R, -T)]);
    let before = |(R, T): &Candidate| pairs.iter().filter(|p| in_front(R, T, p)).count();
    all.max_by_key(before)
}

fn in_front(R: &Rotation3<f64>, T: &Vector3<f64>, (first, second): &Pair) -> bool {
    let turned = R * first;
    let normal = turned.cross(second);
    // z turned + T = z' second.
    let depth = -T.cross(second).dot(&normal);
    let depth_after = -T.cross(&turned).dot(&normal);
    depth > 0.0 && depth_after > 0.0
}

/// Least squares of Cauchy-weighted Sampson errors.
fn refine(candidate: Candidate, pairs: &[Pair], scale: f64) -> Candidate {
    let mut current = candidate;
    for _ in 0..4 {
        let E = essential(&current);
        let weight = |p: &Pair| 1.0 / (1.0 + (sampson(&E, p) / scale).powi(2)).sqrt();
        let weights = pairs.iter().map(weight).collect();
        let problem = Epipolar::new(current, pairs, weights);
        let solver = LevenbergMarquardt::new().with_patience(5).with_tol(1e-6);
        let (solved, _) = solver.minimize(problem);
        let next = solved.now;
        let converged = current.0.angle_to(&next.0) < 1e-7;
        current = next;
        if converged {
            break;
        }
    }
    current
}

fn finish(candidate: Candidate, pairs: &[Pair], noise: f64) -> Option<RelativePose> {
    let E = essential(&candidate);
    let errors: Vec<f64> = pairs.iter().map(|p| sampson(&E, p)).collect();
    let agreeing: Vec<bool> = errors.iter().map(|e| e.abs() < 6.0 * noise).collect();
    let count = agreeing.iter().filter(|a| **a).count();
    if count < MIN_POINTS {
        return None;
    }
    let inliers = errors.iter().zip(&agreeing).filter(|(_, a)| **a);
    let rms = (inliers.map(|(e, _)| e * e).sum::<f64>() / count as f64).sqrt();
    let weights = agreeing.iter().map(|a| f64::from(u8::from(*a))).collect();
    let J = Epipolar::new(candidate, pairs, weights).jacobian()?;
    let H = SMatrix::<f64, 5, 5>::from_fn(|i, j| J.column(i).dot(&J.column(j)));
    let (rr, rt) = (H.fixed_view::<3, 3>(0, 0), H.fixed_view::<3, 2>(0, 3));
    // Without translation its direction is undetermined; the term keeps the matrix regular.
    let tt = H.fixed_view::<2, 2>(3, 3) + nalgebra::Matrix2::identity() * (1e-9 * H.trace());
    let information = rr - rt * tt.try_inverse()? * rt.transpose();
    Some(RelativePose {
        R: candidate.0,
        direction: candidate.1,
        agreeing,
        rms,
        information,
    })
}

/// Sampson errors as functions of a rotation of R (3) and a shift of T in two directions across it (2).
struct Epipolar<'a> {
    pairs: &'a [Pair],
    weights: Vec<f64>,
    start: Candidate,
    across: SMatrix<f64, 3, 2>,
    parameters: OVector<f64, U5>,
    now: Candidate,
}

impl<'a> Epipolar<'a> {
    fn new(start: Candidate, pairs: &'a [Pair], weights: Vec<f64>) -> Self {
        let T = start.1.into_inner();
        let a = T.cross(&Vector3::ith(T.iamin(), 1.0)).normalize();
        Self {
            pairs,
            weights,
            start,
            across: SMatrix::from_columns(&[a, T.cross(&a)]),
            parameters: OVector::<f64, U5>::zeros(),
            now: start,
        }
    }

    fn turn(&self) -> Vector3<f64> {
        self.parameters.fixed_rows::<3>(0).into_owned()
    }
}

impl LeastSquaresProblem<f64, Dyn, U5> for Epipolar<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, U5>;
    type ParameterStorage = Owned<f64, U5>;

    fn set_params(&mut self, x: &OVector<f64, U5>) {
        self.parameters = *x;
        let turn: UnitQuaternion<f64> = exp_so3(&self.turn());
        let shift = self.across * x.fixed_rows::<2>(3);
        self.now = (
            self.start.0 * turn.to_rotation_matrix(),
            UnitVector3::new_normalize(self.start.1.into_inner() + shift),
        );
    }

    fn params(&self) -> OVector<f64, U5> {
        self.parameters
    }

    fn residuals(&self) -> Option<OVector<f64, Dyn>> {
        let E = essential(&self.now);
        let weighted = self.pairs.iter().zip(&self.weights);
        let errors = weighted.map(|(p, w)| w * sampson(&E, p));
        Some(OVector::<f64, Dyn>::from_iterator(self.pairs.len(), errors))
    }

    fn jacobian(&self) -> Option<OMatrix<f64, Dyn, U5>> {
        let (R, T) = &self.now;
        let by_turn = right_jacobian(&self.turn());
        let shifted = self.start.1.into_inner() + self.across * self.parameters.fixed_rows::<2>(3);
        let E = essential(&self.now);
        let mut slopes = [Matrix3::zeros(); 5];
        for (k, slope) in slopes.iter_mut().enumerate() {
            *slope = if k < 3 {
                let axis: Vector3<f64> = by_turn.column(k).into();
                E * axis.cross_matrix()
            } else {
                let along: Vector3<f64> = self.across.column(k - 3).into();
                let unit = (along - T.into_inner() * T.dot(&along)) / shifted.norm();
                unit.cross_matrix() * R.matrix()
            };
        }
        let mut J = OMatrix::<f64, Dyn, U5>::zeros(self.pairs.len());
        for (i, ((first, second), weight)) in self.pairs.iter().zip(&self.weights).enumerate() {
            let (a, b) = (E * first, E.tr_mul(second));
            let slope = (a.xy().norm_squared() + b.xy().norm_squared()).sqrt();
            let inverse = 1.0 / slope.max(f64::MIN_POSITIVE);
            let value = second.dot(&a);
            for (k, dE) in slopes.iter().enumerate() {
                let (da, db) = (dE * first, dE.tr_mul(second));
                let by_slope = a.xy().dot(&da.xy()) + b.xy().dot(&db.xy());
                let change = second.dot(&da) * inverse - value * by_slope * inverse.powi(3);
                J[(i, k)] = weight * change;
            }
        }
        Some(J)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    fn pairs(T: Vector3<f64>, wrong: usize, noise: f64, seed: u64) -> (Vec<Pair>, Rotation3<f64>) {
        let mut rng = StdRng::seed_from_u64(seed);
        let R = Rotation3::from_scaled_axis(Vector3::new(0.1, -0.15, 0.4));
        let mut off = |size: f64| rng.random_range(-size..size);
        let all = (0..20).map(|i| {
            let x = Vector3::new(off(0.5), off(0.5), 1.0 + off(0.5));
            let y = R * x + T;
            let (mut x, mut y) = (x / x.z, y / y.z);
            for v in [&mut x, &mut y] {
                *v += Vector3::new(off(noise), off(noise), 0.0);
            }
            if i < wrong {
                y = Vector3::new(off(0.6), off(0.6), 1.0);
            }
            (x, y)
        });
        (all.collect(), R)
    }

    #[test]
    fn wrong_correspondences_are_rejected() {
        for seed in 0..10 {
            let (pairs, R) = pairs(Vector3::new(0.15, 0.05, 0.1), 4, 6e-4, seed);
            let mut rng = StdRng::seed_from_u64(1);
            let found = relative_pose(&pairs, 3.5e-4, &mut rng).unwrap();
            assert!(
                found.R.angle_to(&R) < 0.02,
                "{seed}: {}",
                found.R.angle_to(&R)
            );
            let inliers = found.agreeing[4..].iter().filter(|a| **a).count();
            assert!(inliers >= 15, "{seed}: {inliers}");
        }
    }

    #[test]
    fn a_rotation_without_translation_is_found() {
        let (pairs, R) = pairs(Vector3::zeros(), 2, 6e-4, 3);
        let mut rng = StdRng::seed_from_u64(1);
        let found = relative_pose(&pairs, 3.5e-4, &mut rng).unwrap();
        assert!(found.R.angle_to(&R) < 5e-3, "{}", found.R.angle_to(&R));
    }

    #[test]
    fn the_jacobian_matches_finite_differences() {
        let (pairs, R) = pairs(Vector3::new(0.15, 0.05, 0.1), 0, 6e-3, 5);
        let T = UnitVector3::new_normalize(Vector3::new(0.2, 0.0, 0.1));
        let mut problem = Epipolar::new((R, T), &pairs, vec![1.0; pairs.len()]);
        problem.set_params(&OVector::<f64, U5>::new(0.1, -0.05, 0.2, 0.3, -0.1));
        let analytic = problem.jacobian().unwrap();
        let numeric = levenberg_marquardt::differentiate_numerically(&mut problem).unwrap();
        assert!((analytic - numeric).norm() < 1e-6);
    }
}
