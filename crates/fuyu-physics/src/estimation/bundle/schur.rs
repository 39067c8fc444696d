//! Levenberg-Marquardt step by Schur complement, for unknowns of frames, of points, and common to all.
//!
//! Each observation couples one frame with one point, so frames are coupled only through points and common unknowns.
//! The frames are eliminated (there are many, with `L` unknowns each). The Schur complement couples only points that
//! appear in the same frame. With points ordered by first appearance it has a narrow envelope, which [`Envelope`]
//! factors without touching zeros. The `G` common unknowns come last.

use nalgebra::{Cholesky, Const, SMatrix, SVector, Vector3};

use super::envelope::{Envelope, row_length};

/// Damping that keeps the matrix regular where scale and origin of the scene are undetermined.
const REGULAR: f64 = 1e-10;

/// Normal equations of one frame: its own unknowns, the common ones and the points that it shows.
#[derive(Debug, Clone)]
pub struct FrameNormal<const L: usize, const G: usize> {
    /// Hessian block of the frame's unknowns.
    pub H_ll: SMatrix<f64, L, L>,
    /// Hessian block of the frame's with the common unknowns.
    pub H_lg: SMatrix<f64, L, G>,
    /// Gradient by the frame's unknowns.
    pub g_l: SVector<f64, L>,
    /// Index of the frame's first entry in [`System::coupling`].
    first: usize,
    /// Number of its entries.
    count: usize,
}

/// Coupling of a frame with a point by an observation.
#[derive(Debug, Clone)]
struct Coupling<const L: usize> {
    point: usize,
    H_lp: SMatrix<f64, L, 3>,
}

/// Normal equations of the cost `½ Σ r²`.
#[derive(Debug, Clone)]
pub struct System<const L: usize, const G: usize> {
    frames: Vec<FrameNormal<L, G>>,
    coupling: Vec<Coupling<L>>,
    H_pp: Vec<SMatrix<f64, 3, 3>>,
    /// Hessian blocks of the common unknowns with each point.
    H_gp: Vec<SMatrix<f64, G, 3>>,
    g_p: Vec<Vector3<f64>>,
    /// Hessian block of the common unknowns.
    pub H_gg: SMatrix<f64, G, G>,
    /// Gradient by the common unknowns.
    pub g_g: SVector<f64, G>,
    first_coupled: Vec<usize>,
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
    /// An empty system with `points` points.
    pub fn new(points: usize) -> Self {
        Self {
            frames: Vec::new(),
            coupling: Vec::new(),
            H_pp: vec![SMatrix::zeros(); points],
            H_gp: vec![SMatrix::zeros(); points],
            g_p: vec![Vector3::zeros(); points],
            H_gg: SMatrix::zeros(),
            g_g: SVector::zeros(),
            first_coupled: (0..points).collect(),
        }
    }

    /// Clears the system and keeps its memory.
    pub fn clear(&mut self) {
        self.frames.clear();
        self.coupling.clear();
        self.H_pp.fill(SMatrix::zeros());
        self.H_gp.fill(SMatrix::zeros());
        self.g_p.fill(Vector3::zeros());
        self.H_gg.fill(0.0);
        self.g_g.fill(0.0);
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
    pub fn couple(&mut self, point: usize, H_lp: SMatrix<f64, L, 3>) {
        if L > 0 {
            self.coupling.push(Coupling { point, H_lp });
        }
    }

    /// Hessian block of the common unknowns with a point, to add to.
    #[inline]
    pub fn with_common(&mut self, point: usize) -> &mut SMatrix<f64, G, 3> {
        &mut self.H_gp[point]
    }

    /// Adds a frame with the couplings added since the frame before.
    pub fn add_frame(
        &mut self,
        H_ll: SMatrix<f64, L, L>,
        H_lg: SMatrix<f64, L, G>,
        g_l: SVector<f64, L>,
    ) {
        let first = self.frames.last().map_or(0, |f| f.first + f.count);
        let count = self.coupling.len() - first;
        let own = &mut self.coupling[first..];
        own.sort_unstable_by_key(|c| c.point);
        if let Some(least) = own.first().map(|c| c.point) {
            for c in own {
                let coupled = &mut self.first_coupled[c.point];
                *coupled = (*coupled).min(least);
            }
        }
        self.frames.push(FrameNormal {
            H_ll,
            H_lg,
            g_l,
            first,
            count,
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
        for (frame, chol) in self.frames.iter().zip(&eliminated.frames) {
            let mut right = frame.g_l + frame.H_lg * common;
            for c in &self.coupling[frame.first..frame.first + frame.count] {
                right += c.H_lp * points[c.point];
            }
            let step = -chol.solve(&right);
            predicted_decrease -= step.dot(&frame.g_l);
            predicted_decrease += damping * diagonal(&frame.H_ll).component_mul(&step).dot(&step);
            frames.push(step);
        }
        for ((H, g), step) in self.H_pp.iter().zip(&self.g_p).zip(&points) {
            predicted_decrease -= step.dot(g);
            predicted_decrease += damping * diagonal(H).component_mul(step).dot(step);
        }
        predicted_decrease -= common.dot(&self.g_g);
        predicted_decrease += damping * diagonal(&self.H_gg).component_mul(&common).dot(&common);
        Some(Step {
            frames,
            points,
            common,
            predicted_decrease: 0.5 * predicted_decrease,
        })
    }

    /// Hessian and gradient of the common unknowns with frames and points eliminated: information, in units of the
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
        // The damping of the common unknowns is no information; subtract it.
        let own = SMatrix::from_diagonal(&(diagonal(&self.H_gg) * REGULAR));
        Some((hessian - own, gradient))
    }

    /// Covariance of each point with all else marginalised out, in units of the residuals' variance.
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
        self.frames[i].g_l
    }

    /// Gradient by point `j`.
    #[cfg(test)]
    pub fn point_gradient(&self, j: usize) -> Vector3<f64> {
        self.g_p[j]
    }

    /// Factors of the frames' blocks and of the reduced matrix, with the reduced gradient.
    fn eliminate(&self, damping: f64) -> Option<Eliminated<L>> {
        let points = self.H_pp.len();
        // The rows of a point begin at the first point with which it shares a frame. Common unknowns fill whole blocks.
        let mut firsts = self.first_coupled.clone();
        firsts.extend(std::iter::repeat_n(0, G.div_ceil(3)));
        let mut reduced = Envelope::new(firsts);
        let mut rhs = vec![0.0; reduced.rows()];
        for (j, (H, g)) in self.H_pp.iter().zip(&self.g_p).enumerate() {
            for a in 0..3 {
                for b in 0..=a {
                    *reduced.at(3 * j + a, 3 * j + b) = H[(a, b)];
                }
                *reduced.at(3 * j + a, 3 * j + a) += damping * H[(a, a)] + f64::MIN_POSITIVE;
                rhs[3 * j + a] = g[a];
            }
        }
        let mut common = self.H_gg;
        for a in 0..G {
            common[(a, a)] += damping * self.H_gg[(a, a)];
        }
        let mut with_points = self.H_gp.clone();
        let mut gradient = self.g_g;
        let mut frames = Vec::with_capacity(self.frames.len());
        let mut scratch = Scratch::default();
        for frame in self.frames.iter().filter(|_| L > 0) {
            let own = &self.coupling[frame.first..frame.first + frame.count];
            let mut H = frame.H_ll;
            for i in 0..L {
                H[(i, i)] += damping * frame.H_ll[(i, i)];
            }
            let chol = Cholesky::new(H)?;
            let factor = chol.l_dirty();
            let g = forward::<L, 1>(factor, frame.g_l);
            let wg = forward::<L, G>(factor, frame.H_lg);
            // As columns, so that sums over them are vectorised.
            let rows: [SVector<f64, G>; L] = std::array::from_fn(|l| wg.row(l).transpose());
            let stride = row_length(own.len());
            scratch.w.clear();
            scratch.w.resize(L * stride, 0.0);
            scratch.points.clear();
            for (k, c) in own.iter().enumerate() {
                let w = forward::<L, 3>(factor, c.H_lp);
                for l in 0..L {
                    for b in 0..3 {
                        scratch.w[l * stride + 3 * k + b] = w[(l, b)];
                    }
                }
                scratch.points.push(c.point);
                for (l, row) in rows.iter().enumerate() {
                    for b in 0..3 {
                        let mut column = with_points[c.point].column_mut(b);
                        column.axpy(-w[(l, b)], row, 1.0);
                    }
                }
                let r = w.tr_mul(&g);
                for b in 0..3 {
                    rhs[3 * c.point + b] -= r[b];
                }
            }
            reduced.subtract_product(&scratch.points, &scratch.w, &mut scratch.line);
            for row in &rows {
                for b in 0..G {
                    common.column_mut(b).axpy(-row[b], row, 1.0);
                }
            }
            gradient -= wg.tr_mul(&g);
            frames.push(chol);
        }
        let c = 3 * points;
        for a in 0..G {
            let (_, row) = reduced.row_mut(c + a);
            for (into, from) in row.chunks_exact_mut(3).zip(&with_points) {
                for b in 0..3 {
                    into[b] = from[(a, b)];
                }
            }
            for b in 0..=a {
                row[c + b] = common[(a, b)];
            }
            rhs[c + a] = gradient[a];
        }
        // Padding to whole blocks: identity rows.
        for a in c + G..reduced.rows() {
            *reduced.at(a, a) = 1.0;
        }
        reduced.factor().then_some(Eliminated {
            frames,
            reduced,
            rhs,
        })
    }
}

/// Scratch for the elimination of a frame.
#[derive(Default)]
struct Scratch {
    points: Vec<usize>,
    /// `L⁻¹ H_lp`: the factor of the frame's block applied to its couplings, by rows.
    w: Vec<f64>,
    line: Vec<f64>,
}

struct Eliminated<const L: usize> {
    frames: Vec<Cholesky<f64, Const<L>>>,
    reduced: Envelope,
    rhs: Vec<f64>,
}

fn diagonal<const N: usize>(H: &SMatrix<f64, N, N>) -> SVector<f64, N> {
    SVector::from_fn(|i, _| H[(i, i)])
}

/// `factor⁻¹ right` for a lower-triangular factor of fixed size.
#[inline]
fn forward<const L: usize, const C: usize>(
    factor: &SMatrix<f64, L, L>,
    mut right: SMatrix<f64, L, C>,
) -> SMatrix<f64, L, C> {
    for i in 0..L {
        let inverse = 1.0 / factor[(i, i)];
        for c in 0..C {
            let mut sum = right[(i, c)];
            for j in 0..i {
                sum -= factor[(i, j)] * right[(j, c)];
            }
            right[(i, c)] = sum * inverse;
        }
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2};

    /// Random normal equations as a system and as a dense matrix: frames, points, common.
    fn random(seed: u64) -> (System<2, 2>, DMatrix<f64>, DVector<f64>) {
        use rand::{RngExt, SeedableRng, rngs::StdRng};
        let mut rng = StdRng::seed_from_u64(seed);
        let (frames, points) = (5, 4);
        let n = 2 * frames + 3 * points + 2;
        let (mut H, mut g) = (DMatrix::zeros(n, n), DVector::zeros(n));
        let mut system = System::<2, 2>::new(points);
        for i in 0..frames {
            let (mut H_ll, mut H_lg) = (Matrix2::zeros(), Matrix2::zeros());
            let mut g_l = Vector2::zeros();
            for j in i.saturating_sub(2)..(i + 2).min(points) {
                let mut H_lp = SMatrix::zeros();
                for _ in 0..4 {
                    let mut random = || rng.random_range(-1.0..1.0);
                    let (jl, jg) = (
                        Vector2::from_fn(|_, _| random()),
                        Vector2::from_fn(|_, _| random()),
                    );
                    let jp = Vector3::from_fn(|_, _| random());
                    let r = random();
                    let mut row = DVector::zeros(n);
                    row.rows_mut(2 * i, 2).copy_from(&jl);
                    row.rows_mut(2 * frames + 3 * j, 3).copy_from(&jp);
                    row.rows_mut(n - 2, 2).copy_from(&jg);
                    H += &row * row.transpose();
                    g += row * r;
                    H_ll += jl * jl.transpose();
                    H_lg += jl * jg.transpose();
                    g_l += jl * r;
                    let H_pp: Matrix3<f64> = jp * jp.transpose();
                    system.add_point(j, &H_pp, &(jp * r));
                    H_lp += jl * jp.transpose();
                    *system.with_common(j) += jg * jp.transpose();
                    system.H_gg += jg * jg.transpose();
                    system.g_g += jg * r;
                }
                system.couple(j, H_lp);
            }
            system.add_frame(H_ll, H_lg, g_l);
        }
        (system, H, g)
    }

    #[test]
    fn the_step_equals_that_of_the_dense_system() {
        for damping in [1e-3, 0.5] {
            let (system, H, g) = random(7);
            let mut damped = H.clone();
            for i in 0..H.nrows() {
                damped[(i, i)] *= 1.0 + damping;
            }
            let dense = -damped.cholesky().unwrap().solve(&g);
            let step = system.step(damping).unwrap();
            let mut ours: Vec<f64> = step.frames.iter().flat_map(|s| [s.x, s.y]).collect();
            ours.extend(step.points.iter().flat_map(|p| [p.x, p.y, p.z]));
            ours.extend([step.common.x, step.common.y]);
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
    fn the_marginal_information_equals_that_of_the_dense_inverse() {
        let (system, H, g) = random(11);
        let n = H.nrows();
        let covariance = H.try_inverse().unwrap();
        let expected = covariance.view((n - 2, n - 2), (2, 2)).into_owned();
        let (ours, slope) = system.marginal().unwrap();
        let ours = ours.try_inverse().unwrap();
        assert!((ours - expected.fixed_view::<2, 2>(0, 0)).norm() < 1e-6 * expected.norm());
        // The step of the common unknowns alone is that of the whole system.
        let step = -(&covariance * g);
        let difference = -ours * slope - step.rows(n - 2, 2);
        assert!(difference.norm() < 1e-6 * step.norm(), "{difference}");
        for (j, point) in system.point_covariances().unwrap().iter().enumerate() {
            let dense = covariance
                .view((10 + 3 * j, 10 + 3 * j), (3, 3))
                .into_owned();
            assert!((dense - point).norm() < 1e-6 * point.norm(), "{j}");
        }
    }
}
