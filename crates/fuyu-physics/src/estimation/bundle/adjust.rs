//! Bundle adjustment: the poses, points and common parameters with the least reprojection cost.
//!
//! Levenberg-Marquardt with a [`PixelLikelihood`] for each image point and a weak prior on depths. A [`PoseModel`]
//! gives the poses: one independent pose per frame, or attitudes from a motion model.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use pulp::{Arch, Simd, WithSimd};

use super::envelope::{mul_add, products};
use super::intrinsics::Lens;
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::{FramePose, PoseModel};
use super::scene::{CentrePrior, Scene};
use super::schur::{FRAME, Step, System};

/// Cost function and stopping criteria of an adjustment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdjustOptions {
    /// Cost of an image residual.
    pub likelihood: PixelLikelihood,
    /// Largest number of steps.
    pub steps: usize,
    /// Stops when the predicted or the actual decrease is less than this fraction of the cost.
    pub tolerance: f64,
}

/// Result of an adjustment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdjustOutcome {
    /// Cost of all image residuals and of the priors \[px²\].
    pub cost: f64,
    /// Steps taken.
    pub steps: usize,
}

/// Moves `motion` and `points` to the least cost. `None` if an inlier lies behind the camera at the start, or the
/// normal equations cannot be solved.
pub fn adjust<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &mut M,
    points: &mut Vec<Vector3<f64>>,
    adjust_options: &AdjustOptions,
) -> Option<AdjustOutcome> {
    let mut system = System::<L, G>::new(scene.points, M::CAMERA);
    let centre = scene.centre_prior(points);
    let of_centre = |points: &[Vector3<f64>]| centre.as_ref().map_or(0.0, |c| c.cost(points));
    let likelihood = &adjust_options.likelihood;
    let mut cost = total_cost(scene, motion, points, likelihood)? + of_centre(points);
    let (mut damping, mut growth) = (1e-7, 4.0);
    let mut steps = 0;
    let mut is_linearised = false;
    while steps < adjust_options.steps {
        if !is_linearised {
            linearise(
                scene,
                motion,
                points,
                likelihood,
                centre.as_ref(),
                &mut system,
            );
            is_linearised = true;
        }
        steps += 1;
        let tried = system.step(damping).and_then(|step| {
            let (moved, moved_points) = apply(motion, points, &step)?;
            let reached = total_cost(scene, &moved, &moved_points, likelihood)?;
            let reached = reached + of_centre(&moved_points);
            Some((step.predicted_decrease, moved, moved_points, reached))
        });
        match tried {
            Some((predicted_decrease, moved, moved_points, reached)) if reached < cost => {
                let ratio = (cost - reached) / predicted_decrease.max(f64::MIN_POSITIVE);
                let done = cost - reached < adjust_options.tolerance * cost;
                (*motion, *points, cost) = (moved, moved_points, reached);
                damping = (damping * (1.0 - (2.0 * ratio - 1.0).powi(3)).max(0.1)).max(1e-12);
                growth = 4.0;
                is_linearised = false;
                if done {
                    break;
                }
            }
            Some((predicted_decrease, ..))
                if predicted_decrease < adjust_options.tolerance * cost =>
            {
                break;
            }
            _ => {
                damping *= growth;
                growth *= 2.0;
                if damping > 1e8 {
                    break;
                }
            }
        }
    }
    // The prior on the centre of mass, evaluated at the final points.
    let at_end = scene.centre_prior(points).map_or(0.0, |c| c.cost(points));
    Some(AdjustOutcome {
        cost: cost - of_centre(points) + at_end,
        steps,
    })
}

/// Normal equations of the common unknowns after elimination of all others \[px²\].
#[derive(Debug, Clone, PartialEq)]
pub struct ReducedNormal<const G: usize> {
    /// Hessian of the cost, including the prior.
    pub hessian: SMatrix<f64, G, G>,
    /// Gradient of the cost, including the prior.
    pub gradient: SVector<f64, G>,
    /// Covariance of each point in units of the residuals' variance; empty if not requested.
    pub points: Vec<Matrix3<f64>>,
}

/// Reduced normal equations at a fit; with the points' covariances if `with_points`.
pub fn reduced_normal<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &M,
    points: &[Vector3<f64>],
    likelihood: &PixelLikelihood,
    with_points: bool,
) -> Option<ReducedNormal<G>> {
    let mut system = System::<L, G>::new(scene.points, M::CAMERA);
    let centre = scene.centre_prior(points);
    linearise(
        scene,
        motion,
        points,
        likelihood,
        centre.as_ref(),
        &mut system,
    );
    let (hessian, gradient) = system.marginal()?;
    Some(ReducedNormal {
        hessian,
        gradient,
        points: match with_points {
            true => system.point_covariances()?,
            false => Vec::new(),
        },
    })
}

fn apply<const L: usize, const G: usize, M: PoseModel<L, G>>(
    motion: &M,
    points: &[Vector3<f64>],
    step: &Step<L, G>,
) -> Option<(M, Vec<Vector3<f64>>)> {
    let moved = motion.moved(&step.frames, &step.common)?;
    let moved_points = points.iter().zip(&step.points).map(|(p, d)| p + d);
    Some((moved, moved_points.collect()))
}

/// `None` if an inlier lies behind the camera or the cost is not finite.
fn total_cost<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &M,
    points: &[Vector3<f64>],
    likelihood: &PixelLikelihood,
) -> Option<f64> {
    let lens = motion.intrinsics().lens(&scene.focal);
    let mut cost = 0.0;
    for i in 0..scene.len() {
        let FramePose { R_CB, t_C } = motion.pose(i);
        let R = R_CB.to_rotation_matrix();
        for observation in scene.frame(i).iter().filter(|s| s.inlier) {
            let x = R * points[observation.point] + t_C;
            cost += likelihood.cost(&(lens.project(&x)? - observation.pixel));
            let depth = scene.anchor(observation.point) * (x.z - 1.0);
            cost += 0.5 * depth * depth;
        }
    }
    let (weights, distance) = motion.prior();
    cost += 0.5 * weights.component_mul(&distance).dot(&distance);
    cost.is_finite().then_some(cost)
}

/// Fills `system` with the normal equations at `motion` and `points`.
fn linearise<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &M,
    points: &[Vector3<f64>],
    likelihood: &PixelLikelihood,
    centre: Option<&CentrePrior>,
    system: &mut System<L, G>,
) {
    system.clear();
    system.reserve(scene.len(), scene.observations().len());
    if let Some(CentrePrior { weight, about }) = centre {
        for (k, (p, q)) in points.iter().zip(about).enumerate() {
            system.add_point(k, &(Matrix3::identity() * *weight), &((p - q) * *weight));
        }
    }
    let lens = motion.intrinsics().lens(&scene.focal);
    let arch = Arch::new();
    let mut columns = Vec::new();
    for i in 0..scene.len() {
        let (mut H, g) = arch.dispatch(FrameLinearisation::<L, G> {
            scene,
            frame: i,
            pose: motion.pose(i),
            lens: &lens,
            camera: M::CAMERA,
            points,
            likelihood,
            system,
            columns: &mut columns,
        });
        let floor = 1e-9 * (1.0 + H.trace());
        for a in 6 - L..6 {
            H[(a, a)] += floor;
        }
        system.add_frame(H, g, &motion.pose_by_common(i));
    }
    let (weights, distance) = motion.prior();
    system.add_common(&weights, &weights.component_mul(&distance));
}

/// The normal equations of one frame, as a SIMD kernel: adds the blocks of points and couplings to `system` and returns
/// the block of pose and intrinsics.
struct FrameLinearisation<'a, const L: usize, const G: usize> {
    scene: &'a Scene,
    frame: usize,
    pose: FramePose,
    lens: &'a Lens,
    /// Number of intrinsics that are unknowns.
    camera: usize,
    points: &'a [Vector3<f64>],
    likelihood: &'a PixelLikelihood,
    system: &'a mut System<L, G>,
    /// Scratch.
    columns: &'a mut Vec<f64>,
}

/// Columns of J and r, padded to a multiple of three.
const COLUMNS: usize = (FRAME + 1).next_multiple_of(3);

impl<const L: usize, const G: usize> WithSimd for FrameLinearisation<'_, L, G> {
    type Output = (SMatrix<f64, FRAME, FRAME>, SVector<f64, FRAME>);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let R = *self.pose.R_CB.to_rotation_matrix().matrix();
        let observations = self.scene.frame(self.frame);
        // Columns of J, and r as one more column: their dot products are H and g.
        let rows = 3 * observations.len();
        let columns = self.columns;
        columns.clear();
        columns.resize(COLUMNS * rows, 0.0);
        for (i, observation) in observations.iter().enumerate().filter(|(_, s)| s.inlier) {
            let p = self.points[observation.point];
            let x = R * p + self.pose.t_C;
            let projected = self.lens.expand(&x);
            let expansion = self
                .likelihood
                .expand(&(projected.pixel - observation.pixel));
            // Scaled residuals and rows of J, so that ½ r² has the slope and curvature of the cost.
            let root = expansion.curvature.map(f64::sqrt);
            let anchor = self.scene.anchor(observation.point);
            let scaled = expansion.slope.component_div(&root);
            let r = [scaled.x, scaled.y, anchor * (x.z - 1.0)];
            let mut by_x = Matrix3::zeros();
            for k in 0..3 {
                by_x[(0, k)] = root.x * projected.by_x[(0, k)];
                by_x[(1, k)] = root.y * projected.by_x[(1, k)];
            }
            by_x[(2, 2)] = anchor;
            let by_p = by_x * R;
            // x = R exp([θ×]) p + t, so the derivative by θ is -R [p×]; the rows of by_p [p×] are the rows of by_p
            // crossed with p.
            let mut J = [[0.0; FRAME]; 3];
            for (row, J) in J.iter_mut().enumerate() {
                let a = Vector3::new(by_p[(row, 0)], by_p[(row, 1)], by_p[(row, 2)]);
                let c = p.cross(&a);
                for k in 0..3 {
                    J[k] = c[k];
                    J[3 + k] = by_x[(row, k)];
                }
            }
            for k in 0..self.camera {
                J[0][6 + k] = root.x * projected.by_intrinsics[(0, k)];
                J[1][6 + k] = root.y * projected.by_intrinsics[(1, k)];
            }
            for (row, J) in J.iter().enumerate() {
                for (a, entry) in J.iter().chain([&r[row]]).enumerate() {
                    columns[a * rows + 3 * i + row] = *entry;
                }
            }
            let mut H_fp = SMatrix::<f64, FRAME, 3>::zeros();
            for (b, column) in H_fp.as_mut_slice().chunks_exact_mut(FRAME).enumerate() {
                for (row, J) in J.iter().enumerate() {
                    for a in 0..FRAME {
                        column[a] = mul_add::<S>(J[a], by_p[(row, b)], column[a]);
                    }
                }
            }
            let g_p = by_p.tr_mul(&Vector3::from(r));
            self.system
                .add_point(observation.point, &by_p.tr_mul(&by_p), &g_p);
            self.system.couple(observation.point, H_fp);
        }
        let mut H = SMatrix::<f64, FRAME, FRAME>::zeros();
        let mut g = SVector::<f64, FRAME>::zeros();
        for a in (0..COLUMNS).step_by(3) {
            for b in (0..=a).step_by(3) {
                let sums = products(
                    simd,
                    three_columns(columns, rows, a),
                    three_columns(columns, rows, b),
                );
                for (a, sums) in (a..).zip(sums) {
                    for (b, sum) in (b..).zip(sums) {
                        match a {
                            0..FRAME if b < FRAME => {
                                H[(a, b)] = sum;
                                H[(b, a)] = sum;
                            }
                            FRAME if b < FRAME => g[b] = sum,
                            _ => {}
                        }
                    }
                }
            }
        }
        (H, g)
    }
}

/// Three columns of `rows` entries, from the one with index `first` on.
#[inline(always)]
fn three_columns(columns: &[f64], rows: usize, first: usize) -> [&[f64]; 3] {
    [
        &columns[first * rows..][..rows],
        &columns[(first + 1) * rows..][..rows],
        &columns[(first + 2) * rows..][..rows],
    ]
}

#[cfg(test)]
mod tests {
    use super::super::pose_model::independent_poses::IndependentPoses;
    use super::*;
    use crate::estimation::bundle::scene::SceneObservation;
    use nalgebra::{UnitQuaternion, Vector2};

    fn small() -> (Scene, IndependentPoses, Vec<Vector3<f64>>) {
        let points: Vec<_> = (0..6)
            .map(|j| {
                let a = f64::from(j);
                Vector3::new(a.sin(), (1.7 * a).cos(), (2.3 * a).sin()) * 0.4
            })
            .collect();
        let focal = Vector2::new(800.0, 780.0);
        let poses = (0..4).map(|i| FramePose {
            R_CB: UnitQuaternion::from_scaled_axis(Vector3::new(0.1, 0.3, -0.2) * f64::from(i)),
            t_C: Vector3::new(0.02 * f64::from(i), -0.1, 1.1),
        });
        let motion = IndependentPoses::new(poses.collect(), 0.1);
        let frames = (0..4).map(|i| {
            let pose = motion.pose(i);
            let observations = points.iter().enumerate().map(|(j, p)| {
                let x = pose.R_CB * p + pose.t_C;
                let pixel = Vector2::new(focal.x * x.x, focal.y * x.y) / x.z;
                // Errors, some beyond Huber's threshold.
                let off = Vector2::new((j as f64).cos(), (i as f64 + j as f64).sin()) * 1.5;
                SceneObservation {
                    point: j,
                    pixel: pixel + off,
                    inlier: true,
                }
            });
            observations.collect()
        });
        let scene = Scene::new(focal, frames.collect(), 6, 0.3);
        (scene, motion, points)
    }

    #[test]
    fn gradients_match_finite_differences() {
        let (mut scene, motion, points) = small();
        scene.expect_centre(30.0);
        let centre = scene.centre_prior(&points);
        let mut system = System::<6, 1>::new(6, 1);
        linearise(
            &scene,
            &motion,
            &points,
            &PixelLikelihood::Huber(1.2),
            centre.as_ref(),
            &mut system,
        );
        let cost = |m: &IndependentPoses, p: &[Vector3<f64>]| {
            let of_images = total_cost(&scene, m, p, &PixelLikelihood::Huber(1.2)).unwrap();
            of_images + centre.as_ref().unwrap().cost(p)
        };
        let h = 1e-6;
        let close = |analytic: f64, up: f64, down: f64| {
            let numeric = (up - down) / (2.0 * h);
            assert!(
                (analytic - numeric).abs() < 1e-4 * (1.0 + numeric.abs()),
                "{analytic} {numeric}"
            );
        };
        let zero = SVector::<f64, 1>::zeros();
        for i in 0..4 {
            for k in 0..6 {
                let step = |h: f64| {
                    let mut frames = vec![SVector::<f64, 6>::zeros(); 4];
                    frames[i][k] = h;
                    cost(&motion.moved(&frames, &zero).unwrap(), &points)
                };
                close(system.frame_gradient(i)[k], step(h), step(-h));
            }
        }
        for j in 0..6 {
            for k in 0..3 {
                let step = |h: f64| {
                    let mut points = points.clone();
                    points[j][k] += h;
                    cost(&motion, &points)
                };
                close(system.point_gradient(j)[k], step(h), step(-h));
            }
        }
        let still = vec![SVector::<f64, 6>::zeros(); 4];
        let step = |h: f64| {
            let m = motion.moved(&still, &SVector::<f64, 1>::new(h)).unwrap();
            cost(&m, &points)
        };
        close(system.common_gradient()[0], step(h), step(-h));
    }

    #[test]
    fn a_disturbed_scene_converges_to_its_images() {
        let (mut scene, mut motion, mut points) = small();
        for i in 0..scene.len() {
            let pose = motion.pose(i);
            let focal = scene.focal;
            for observation in scene.frame_mut(i) {
                let x = pose.R_CB * points[observation.point] + pose.t_C;
                observation.pixel = Vector2::new(focal.x * x.x, focal.y * x.y) / x.z;
            }
        }
        motion = IndependentPoses::new((0..4).map(|i| motion.pose(i)).collect(), 0.0);
        for (j, p) in points.iter_mut().enumerate() {
            *p += Vector3::new(0.02, -0.03, 0.025) * (j as f64).cos();
        }
        let adjust_options = AdjustOptions {
            likelihood: PixelLikelihood::Huber(1.2),
            steps: 60,
            tolerance: 1e-12,
        };
        adjust(&scene, &mut motion, &mut points, &adjust_options).unwrap();
        for i in 0..scene.len() {
            let pose = motion.pose(i);
            for observation in scene.frame(i) {
                let x = pose.R_CB * points[observation.point] + pose.t_C;
                let r =
                    super::super::scene::residual(&scene.focal, &x, &observation.pixel).unwrap();
                // The depth prior shifts the solution a little.
                assert!(r.norm() < 0.02, "{r}");
            }
        }
    }
}
