//! Levenberg-Marquardt step by Schur complement, for unknowns of frames, of points, and common to all.
//!
//! Each observation depends on one frame and one point. A frame has [`FRAME`] quantities, pose and intrinsics: `L` of
//! them are unknowns of its own, the others follow from the `G` common unknowns by the derivatives `B`. The own
//! unknowns are eliminated first, in the `FRAME` quantities, where it is cheap; then `B` transforms the remainder to
//! the common unknowns. The Schur complement couples only points that appear in the same frame. With points ordered by
//! first appearance it has a narrow envelope, which the `envelope` module factors without touching zeros. The common
//! unknowns come last.

mod elimination;

use std::ops::Range;

use nalgebra::{SMatrix, SVector, Vector3};
use pulp::Arch;

use elimination::{Eliminated, Elimination};

use super::intrinsics::INTRINSICS;

/// Quantities of a frame: rotation (3), translation (3), intrinsics. The last `L` of the pose are the frame's own
/// unknowns.
pub const FRAME: usize = 6 + INTRINSICS;

/// Damping that keeps the matrix regular where scale and origin of the scene are undetermined.
const REGULAR: f64 = 1e-10;

/// Rows of `B` are padded to whole registers of this many values.
const LANES: usize = 8;

/// Normal equations of one frame.
#[derive(Debug, Clone)]
struct FrameNormal {
    H: SMatrix<f64, FRAME, FRAME>,
    g: SVector<f64, FRAME>,
    /// Index of the frame's first entry in [`System::coupling`].
    first: usize,
    /// Number of its entries.
    count: usize,
    /// Common unknowns on which rotation and translation depend, extended to whole registers.
    spans: [Range<usize>; 2],
}

/// Coupling of a frame with a point by an observation.
#[derive(Debug, Clone)]
struct Coupling {
    point: usize,
    H_fp: SMatrix<f64, FRAME, 3>,
}

/// Normal equations of the cost `½ Σ r²`.
#[derive(Debug, Clone)]
pub struct System<const L: usize, const G: usize> {
    frames: Vec<FrameNormal>,
    coupling: Vec<Coupling>,
    /// Rows of `B` of those pose quantities that are not the frame's own unknowns, `6 - L` for each frame.
    by_common: Vec<f64>,
    /// Number of intrinsics that are unknowns, the last common ones.
    camera: usize,
    H_pp: Vec<SMatrix<f64, 3, 3>>,
    g_p: Vec<Vector3<f64>>,
    /// Weights of the prior on the common unknowns.
    weights: SVector<f64, G>,
    /// Diagonal of the common unknowns' Hessian block, with the prior.
    diagonal_gg: SVector<f64, G>,
    g_g: SVector<f64, G>,
    first_coupled: Vec<usize>,
    arch: Arch,
}

/// A step in all unknowns.
#[derive(Debug, Clone)]
pub struct Step<const L: usize, const G: usize> {
    /// By frame.
    pub frames: Vec<SVector<f64, L>>,
    /// By point.
    pub points: Vec<Vector3<f64>>,
    /// Step in the common unknowns.
    pub common: SVector<f64, G>,
    /// Decrease of the cost that the linearisation predicts.
    pub predicted_decrease: f64,
}

impl<const L: usize, const G: usize> System<L, G> {
    /// Pose quantities that follow from the common unknowns.
    const POSE: usize = 6 - L;
    /// Length of a row of `B`: whole registers, and room for blocks of three.
    const STRIDE: usize = (G + 2).next_multiple_of(LANES);

    /// An empty system with `points` points; the last `camera` common unknowns are intrinsics.
    pub fn new(points: usize, camera: usize) -> Self {
        const {
            assert!(
                L.is_multiple_of(3) && L <= 6,
                "rotation and translation as wholes"
            )
        };
        Self {
            frames: Vec::new(),
            coupling: Vec::new(),
            by_common: Vec::new(),
            camera,
            H_pp: vec![SMatrix::zeros(); points],
            g_p: vec![Vector3::zeros(); points],
            weights: SVector::zeros(),
            diagonal_gg: SVector::zeros(),
            g_g: SVector::zeros(),
            first_coupled: (0..points).collect(),
            arch: Arch::new(),
        }
    }

    /// Clears the system and keeps its memory.
    pub fn clear(&mut self) {
        self.frames.clear();
        self.coupling.clear();
        self.by_common.clear();
        self.H_pp.fill(SMatrix::zeros());
        self.g_p.fill(Vector3::zeros());
        self.weights.fill(0.0);
        self.diagonal_gg.fill(0.0);
        self.g_g.fill(0.0);
    }

    /// Makes room for so many frames and observations.
    pub fn reserve(&mut self, frames: usize, observations: usize) {
        self.frames.reserve(frames);
        self.coupling.reserve(observations);
        self.by_common.reserve(frames * Self::POSE * Self::STRIDE);
    }

    /// Adds to a point's own normal equations.
    #[inline]
    pub fn add_point(&mut self, point: usize, H: &SMatrix<f64, 3, 3>, g: &Vector3<f64>) {
        self.H_pp[point] += H;
        self.g_p[point] += g;
    }

    /// Adds the coupling of a point with the frame that the next [`System::add_frame`] adds; at most one per point and
    /// frame.
    #[inline]
    pub fn couple(&mut self, point: usize, H_fp: SMatrix<f64, FRAME, 3>) {
        self.coupling.push(Coupling { point, H_fp });
    }

    /// Adds a prior on the common unknowns: weights, and gradient.
    pub fn add_common(&mut self, weights: &SVector<f64, G>, gradient: &SVector<f64, G>) {
        self.weights += weights;
        self.diagonal_gg += weights;
        self.g_g += gradient;
    }

    /// Adds a frame with the couplings added since the previous frame. `pose_by_common` are the derivatives of the pose
    /// by the common unknowns; rows of the frame's own unknowns and columns of intrinsics are zero.
    pub fn add_frame(
        &mut self,
        H: SMatrix<f64, FRAME, FRAME>,
        g: SVector<f64, FRAME>,
        pose_by_common: &SMatrix<f64, 6, G>,
    ) {
        let first = self.frames.last().map_or(0, |f| f.first + f.count);
        let count = self.coupling.len() - first;
        let own = &mut self.coupling[first..];
        own.sort_unstable_by_key(|c| c.point);
        // Without own unknowns of the frames, points are coupled through the common ones only.
        if let Some(least) = own.first().map(|c| c.point).filter(|_| L > 0) {
            for c in own {
                let coupled = &mut self.first_coupled[c.point];
                *coupled = (*coupled).min(least);
            }
        }
        let begin = self.by_common.len();
        self.by_common
            .resize(begin + Self::POSE * Self::STRIDE, 0.0);
        let rows = &mut self.by_common[begin..];
        let mut spans = [0..0, 0..0];
        for (k, row) in rows.chunks_exact_mut(Self::STRIDE).enumerate() {
            for (column, into) in row[..G].iter_mut().enumerate() {
                *into = pose_by_common[(k, column)];
            }
            let span = &mut spans[k / 3];
            if let Some(from) = row.iter().position(|x| *x != 0.0) {
                let last = row.iter().rposition(|x| *x != 0.0).unwrap_or(from);
                let (from, to) = (from / LANES * LANES, (last + 1).next_multiple_of(LANES));
                *span = match span.end {
                    0 => from..to,
                    end => span.start.min(from)..end.max(to),
                };
            }
        }
        let rows = &self.by_common[begin..];
        let row = |k: usize| &rows[k * Self::STRIDE..][..G];
        for k in 0..Self::POSE {
            let span = spans[k / 3].start..spans[k / 3].end.min(G);
            for (sum, b) in
                (self.g_g.as_mut_slice()[span.clone()].iter_mut()).zip(&row(k)[span.clone()])
            {
                *sum += g[k] * b;
            }
            for j in 0..Self::POSE {
                let both = self.diagonal_gg.as_mut_slice()[span.clone()].iter_mut();
                for (sum, (a, b)) in
                    both.zip(row(k)[span.clone()].iter().zip(&row(j)[span.clone()]))
                {
                    *sum += H[(k, j)] * a * b;
                }
            }
        }
        for k in 0..self.camera {
            let at = G - self.camera + k;
            self.g_g[at] += g[6 + k];
            self.diagonal_gg[at] += H[(6 + k, 6 + k)];
        }
        self.frames.push(FrameNormal {
            H,
            g,
            first,
            count,
            spans,
        });
    }

    /// Levenberg-Marquardt step with damping `damping` (relative to each diagonal entry).
    /// `None` if the damped matrix is not positive definite.
    pub fn step(&self, damping: f64) -> Option<Step<L, G>> {
        let eliminated = self.eliminate(damping)?;
        let points = self.H_pp.len();
        let mut rhs = eliminated.rhs.clone();
        eliminated.reduced.solve(&mut rhs);
        let common = SVector::<f64, G>::from_fn(|i, _| -rhs[3 * points + i]);
        let points: Vec<_> = (0..points)
            .map(|j| -Vector3::new(rhs[3 * j], rhs[3 * j + 1], rhs[3 * j + 2]))
            .collect();
        let mut frames = Vec::with_capacity(self.frames.len());
        let mut predicted_decrease = 0.0;
        for (i, (frame, chol)) in self.frames.iter().zip(&eliminated.frames).enumerate() {
            // First the step of the frame due to the common unknowns, then that due to the points.
            let mut moved = SVector::<f64, FRAME>::zeros();
            for (k, row) in self.pose_rows(i).chunks_exact(Self::STRIDE).enumerate() {
                let span = frame.spans[k / 3].start..frame.spans[k / 3].end.min(G);
                moved[k] = (row[span.clone()].iter().zip(&common.as_slice()[span]))
                    .map(|(b, c)| b * c)
                    .sum();
            }
            for k in 0..self.camera {
                moved[6 + k] = common[G - self.camera + k];
            }
            let mut right = own_rows::<L, 1>(&(frame.g + frame.H * moved));
            for c in &self.coupling[frame.first..frame.first + frame.count] {
                right += own_rows::<L, 3>(&c.H_fp) * points[c.point];
            }
            let step = -chol.solve(&right);
            let own = SVector::<f64, L>::from_fn(|a, _| frame.H[(Self::POSE + a, Self::POSE + a)]);
            predicted_decrease -= step.dot(&own_rows::<L, 1>(&frame.g));
            predicted_decrease += damping * own.component_mul(&step).dot(&step);
            frames.push(step);
        }
        for ((H, g), step) in self.H_pp.iter().zip(&self.g_p).zip(&points) {
            predicted_decrease -= step.dot(g);
            predicted_decrease += damping * H.diagonal().component_mul(step).dot(step);
        }
        predicted_decrease -= common.dot(&self.g_g);
        predicted_decrease += damping * self.diagonal_gg.component_mul(&common).dot(&common);
        Some(Step {
            frames,
            points,
            common,
            predicted_decrease: 0.5 * predicted_decrease,
        })
    }

    /// Rows of `B` of the pose quantities in frame `i` that are not its own unknowns, one after another.
    #[inline]
    fn pose_rows(&self, i: usize) -> &[f64] {
        let length = Self::POSE * Self::STRIDE;
        &self.by_common[i * length..][..length]
    }

    /// Hessian and gradient of the common unknowns after elimination of frames and points: information, in units of the
    /// inverse of the residuals' variance.
    pub fn marginal(&self) -> Option<(SMatrix<f64, G, G>, SVector<f64, G>)> {
        // Scale and origin of the scene may be undetermined; a little damping keeps the matrix regular.
        let eliminated = self.eliminate(REGULAR)?;
        // The rows after those of the points are the factor of the marginal information.
        let first = 3 * self.H_pp.len();
        let factor = SMatrix::<f64, G, G>::from_fn(|i, j| {
            if j > i {
                0.0
            } else {
                eliminated.reduced.entry(first + i, first + j)
            }
        });
        let hessian = factor * factor.transpose();
        let mut solution = eliminated.rhs.clone();
        eliminated.reduced.solve(&mut solution);
        let solution = SVector::<f64, G>::from_fn(|i, _| solution[first + i]);
        let gradient = hessian * solution;
        // The damping of the common unknowns is not information; subtract it.
        let own = SMatrix::from_diagonal(&(self.diagonal_gg * REGULAR));
        Some((hessian - own, gradient))
    }

    /// Covariance of each point with all other unknowns marginalised out, in units of the residuals' variance.
    pub fn point_covariances(&self) -> Option<Vec<SMatrix<f64, 3, 3>>> {
        let eliminated = self.eliminate(REGULAR)?;
        let mut column = vec![0.0; eliminated.reduced.rows()];
        let covariances = (0..self.H_pp.len()).map(|j| {
            let mut block = SMatrix::<f64, 3, 3>::zeros();
            for b in 0..3 {
                column.fill(0.0);
                column[3 * j + b] = 1.0;
                eliminated.reduced.solve(&mut column);
                for a in 0..3 {
                    block[(a, b)] = column[3 * j + a];
                }
            }
            block
        });
        Some(covariances.collect())
    }

    /// Gradient by the unknowns of frame `i`.
    #[cfg(test)]
    pub fn frame_gradient(&self, i: usize) -> SVector<f64, L> {
        own_rows::<L, 1>(&self.frames[i].g)
    }

    /// Gradient by the common unknowns.
    #[cfg(test)]
    pub fn common_gradient(&self) -> SVector<f64, G> {
        self.g_g
    }

    /// Gradient by point `j`.
    #[cfg(test)]
    pub fn point_gradient(&self, j: usize) -> Vector3<f64> {
        self.g_p[j]
    }

    /// Factors of the frames' blocks and of the reduced matrix, with the reduced gradient.
    fn eliminate(&self, damping: f64) -> Option<Eliminated<L>> {
        self.arch.dispatch(Elimination {
            system: self,
            damping,
        })
    }
}

/// Rows of the frame's own unknowns.
#[inline(always)]
fn own_rows<const L: usize, const C: usize>(of: &SMatrix<f64, FRAME, C>) -> SMatrix<f64, L, C> {
    SMatrix::from_fn(|a, b| of[(6 - L + a, b)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    const CAMERA: usize = 2;

    /// Random normal equations as a system and as a dense matrix: frames, points, common.
    fn random<const L: usize, const G: usize>(
        seed: u64,
    ) -> (System<L, G>, DMatrix<f64>, DVector<f64>) {
        use rand::{RngExt, SeedableRng, rngs::StdRng};
        let mut rng = StdRng::seed_from_u64(seed);
        let mut random = || rng.random_range(-1.0..1.0);
        let (frames, points) = (5, 4);
        let n = L * frames + 3 * points + G;
        let (mut H_dense, mut g_dense) = (DMatrix::zeros(n, n), DVector::zeros(n));
        let mut system = System::<L, G>::new(points, CAMERA);
        for i in 0..frames {
            let (mut H, mut g) = (SMatrix::zeros(), SVector::zeros());
            // Rotation and translation depend on half of the common unknowns each.
            let B = SMatrix::<f64, 6, G>::from_fn(|k, column| {
                let half = (G - CAMERA) / 2;
                let depends = column < G - CAMERA && (column < half) == (k < 3) && k < 6 - L;
                random() * f64::from(u8::from(depends))
            });
            for j in usize::saturating_sub(i, 2)..usize::min(i + 2, points) {
                let mut H_fp = SMatrix::zeros();
                for _ in 0..6 {
                    let mut j_f = SVector::<f64, FRAME>::from_fn(|_, _| random());
                    j_f.rows_mut(6 + CAMERA, INTRINSICS - CAMERA).fill(0.0);
                    let j_p = Vector3::from_fn(|_, _| random());
                    let r = random();
                    let mut row = DVector::zeros(n);
                    row.rows_mut(L * i, L).copy_from(&own_rows::<L, 1>(&j_f));
                    row.rows_mut(L * frames + 3 * j, 3).copy_from(&j_p);
                    let mut common = B.tr_mul(&j_f.fixed_rows::<6>(0));
                    for k in 0..CAMERA {
                        common[G - CAMERA + k] += j_f[6 + k];
                    }
                    row.rows_mut(n - G, G).copy_from(&common);
                    H_dense += &row * row.transpose();
                    g_dense += row * r;
                    H += j_f * j_f.transpose();
                    g += j_f * r;
                    system.add_point(j, &(j_p * j_p.transpose()), &(j_p * r));
                    H_fp += j_f * j_p.transpose();
                }
                system.couple(j, H_fp);
            }
            system.add_frame(H, g, &B);
        }
        let weights = SVector::<f64, G>::from_fn(|_, _| 1.0 + random());
        let gradient = SVector::<f64, G>::from_fn(|_, _| random());
        system.add_common(&weights, &gradient);
        for k in 0..G {
            H_dense[(n - G + k, n - G + k)] += weights[k];
            g_dense[n - G + k] += gradient[k];
        }
        (system, H_dense, g_dense)
    }

    fn the_step_is_that_of_the_dense_system<const L: usize, const G: usize>() {
        for damping in [1e-3, 0.5] {
            let (system, H, g) = random::<L, G>(7);
            let mut damped = H.clone();
            for i in 0..H.nrows() {
                damped[(i, i)] *= 1.0 + damping;
            }
            let dense = -damped.cholesky().unwrap().solve(&g);
            let step = system.step(damping).unwrap();
            let mut ours: Vec<f64> = step.frames.iter().flat_map(|s| s.iter().copied()).collect();
            ours.extend(step.points.iter().flat_map(|p| [p.x, p.y, p.z]));
            ours.extend(step.common.iter());
            let difference = (DVector::from_vec(ours) - &dense).norm();
            assert!(difference < 1e-9 * dense.norm(), "{difference}");
            let predicted_decrease = -g.dot(&dense) - 0.5 * dense.dot(&(&H * &dense));
            assert!(
                (step.predicted_decrease - predicted_decrease).abs()
                    < 1e-9 * predicted_decrease.abs()
            );
        }
    }

    #[test]
    fn the_step_equals_that_of_the_dense_system() {
        the_step_is_that_of_the_dense_system::<0, 9>();
        the_step_is_that_of_the_dense_system::<0, 20>();
        the_step_is_that_of_the_dense_system::<3, 20>();
        the_step_is_that_of_the_dense_system::<6, 2>();
    }

    #[test]
    fn the_marginal_information_equals_that_of_the_dense_inverse() {
        const G: usize = 20;
        let (system, H, g) = random::<3, G>(11);
        let n = H.nrows();
        let covariance = H.try_inverse().unwrap();
        let expected = covariance.view((n - G, n - G), (G, G)).into_owned();
        let (ours, slope) = system.marginal().unwrap();
        let ours = ours.try_inverse().unwrap();
        assert!((ours - expected.fixed_view::<G, G>(0, 0)).norm() < 1e-6 * expected.norm());
        // The step of the common unknowns alone is that of the whole system.
        let step = -(&covariance * g);
        let difference = -ours * slope - step.rows(n - G, G);
        assert!(difference.norm() < 1e-6 * step.norm(), "{difference}");
        for (j, point) in system.point_covariances().unwrap().iter().enumerate() {
            let dense = covariance
                .view((15 + 3 * j, 15 + 3 * j), (3, 3))
                .into_owned();
            assert!((dense - point).norm() < 1e-6 * point.norm(), "{j}");
        }
    }
}
