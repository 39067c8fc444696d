//! Bundle adjustment: the poses, points and common parameters with the least reprojection cost.
//!
//! Levenberg-Marquardt with a [`PixelLikelihood`] for each image point and a weak prior on depths. A [`PoseModel`]
//! gives the poses: one independent pose per frame, or attitudes from a motion model.

use std::ops::Range;

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::intrinsics::INTRINSICS;
use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::{FramePose, PoseModel};
use super::scene::{CentrePrior, Scene};
use super::schur::{Step, System};

/// Unknowns of a frame: pose and intrinsics.
const FRAME: usize = 6 + INTRINSICS;

/// Cost function and stopping criteria of an adjustment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdjustOptions {
    /// Cost of an image residual.
    pub likelihood: PixelLikelihood,
    /// Largest number of steps.
    pub steps: usize,
    /// Stop when the predicted or the actual decrease is less than this share of the cost.
    pub tolerance: f64,
}

/// Result of an adjustment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdjustOutcome {
    /// Cost of all image residuals, with the priors \[px²\].
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
    let mut system = System::<L, G>::new(scene.points);
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
    // With the prior of the points as they are now.
    let at_end = scene.centre_prior(points).map_or(0.0, |c| c.cost(points));
    Some(AdjustOutcome {
        cost: cost - of_centre(points) + at_end,
        steps,
    })
}

/// Normal equations of the common unknowns, with everything else eliminated \[px²\].
#[derive(Debug, Clone, PartialEq)]
pub struct ReducedNormal<const G: usize> {
    /// Hessian of the cost, with that of the prior.
    pub hessian: SMatrix<f64, G, G>,
    /// Gradient of the cost, with that of the prior.
    pub gradient: SVector<f64, G>,
    /// Covariance of each point in units of the residuals' variance; empty if not wanted.
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
    let mut system = System::<L, G>::new(scene.points);
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

fn linearise<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &M,
    points: &[Vector3<f64>],
    likelihood: &PixelLikelihood,
    centre: Option<&CentrePrior>,
    system: &mut System<L, G>,
) {
    system.clear();
    if let Some(CentrePrior { weight, about }) = centre {
        for (k, (p, q)) in points.iter().zip(about).enumerate() {
            system.add_point(k, &(Matrix3::identity() * *weight), &((p - q) * *weight));
        }
    }
    let lens = motion.intrinsics().lens(&scene.focal);
    // Unknowns of a frame: rotation (3), translation (3), and the model's intrinsics.
    let unknowns = 6 + M::CAMERA;
    for i in 0..scene.len() {
        let FramePose { R_CB, t_C } = motion.pose(i);
        let R = *R_CB.to_rotation_matrix().matrix();
        let pose = motion.pose_by_common(i);
        let common_by_pose = pose.transpose();
        // Most common unknowns act either on rotation or on position.
        let spans: [Range<usize>; 6] = std::array::from_fn(|k| {
            let column = &common_by_pose.as_slice()[k * G..(k + 1) * G];
            let first = column.iter().position(|x| *x != 0.0).unwrap_or(G);
            first
                ..column
                    .iter()
                    .rposition(|x| *x != 0.0)
                    .map_or(G, |last| last + 1)
        });
        let mut H = SMatrix::<f64, FRAME, FRAME>::zeros();
        let mut g = SVector::<f64, FRAME>::zeros();
        for observation in scene.frame(i).iter().filter(|s| s.inlier) {
            let p = points[observation.point];
            let x = R * p + t_C;
            let projected = lens.expand(&x);
            let expansion = likelihood.expand(&(projected.pixel - observation.pixel));
            // Scaled residuals and rows of J, so that ½ r² has the slope and curvature of the cost.
            let root = expansion.curvature.map(f64::sqrt);
            let anchor = scene.anchor(observation.point);
            let scaled = expansion.slope.component_div(&root);
            let r = Vector3::new(scaled.x, scaled.y, anchor * (x.z - 1.0));
            let mut by_x = Matrix3::zeros();
            for k in 0..3 {
                by_x[(0, k)] = root.x * projected.by_x[(0, k)];
                by_x[(1, k)] = root.y * projected.by_x[(1, k)];
            }
            by_x[(2, 2)] = anchor;
            let by_p = by_x * R;
            // x = R exp([θ×]) p + t: by θ it is -R [p×], and by_p [p×] has the rows of by_p crossed with p.
            let mut J = SMatrix::<f64, 3, FRAME>::zeros();
            for row in 0..3 {
                let a = Vector3::new(by_p[(row, 0)], by_p[(row, 1)], by_p[(row, 2)]);
                let c = p.cross(&a);
                for k in 0..3 {
                    J[(row, k)] = c[k];
                    J[(row, 3 + k)] = by_x[(row, k)];
                }
            }
            for k in 0..M::CAMERA {
                J[(0, 6 + k)] = root.x * projected.by_intrinsics[(0, k)];
                J[(1, 6 + k)] = root.y * projected.by_intrinsics[(1, k)];
            }
            for a in 0..unknowns {
                for b in 0..=a {
                    H[(a, b)] +=
                        J[(0, a)] * J[(0, b)] + J[(1, a)] * J[(1, b)] + J[(2, a)] * J[(2, b)];
                }
                g[a] += J[(0, a)] * r.x + J[(1, a)] * r.y + J[(2, a)] * r.z;
            }
            system.add_point(observation.point, &by_p.tr_mul(&by_p), &by_p.tr_mul(&r));
            let mut H_fp = SMatrix::<f64, FRAME, 3>::zeros();
            for b in 0..3 {
                for a in 0..unknowns {
                    H_fp[(a, b)] = J[(0, a)] * by_p[(0, b)]
                        + J[(1, a)] * by_p[(1, b)]
                        + J[(2, a)] * by_p[(2, b)];
                }
            }
            let H_lp = SMatrix::<f64, L, 3>::from_fn(|a, b| H_fp[(6 - L + a, b)]);
            system.couple(observation.point, H_lp);
            let H_gp = system.with_common(observation.point);
            for (b, column) in H_gp.as_mut_slice().chunks_exact_mut(G).enumerate() {
                for (k, common) in common_by_pose.as_slice().chunks_exact(G).enumerate() {
                    let span = spans[k].clone();
                    for (sum, part) in column[span.clone()].iter_mut().zip(&common[span]) {
                        *sum += part * H_fp[(k, b)];
                    }
                }
                for k in 0..M::CAMERA {
                    column[G - M::CAMERA + k] += H_fp[(6 + k, b)];
                }
            }
        }
        H.fill_upper_triangle_with_lower_triangle();
        // Derivatives of the frame's pose and intrinsics by the common unknowns.
        let mut by_common = SMatrix::<f64, FRAME, G>::zeros();
        by_common.fixed_rows_mut::<6>(0).copy_from(&pose);
        for k in 0..M::CAMERA {
            by_common[(6 + k, G - M::CAMERA + k)] += 1.0;
        }
        let nonzero: [Range<usize>; FRAME] = std::array::from_fn(|k| match k {
            0..6 => spans[k].clone(),
            _ if k < unknowns => G - M::CAMERA + (k - 6)..G - M::CAMERA + (k - 6) + 1,
            _ => 0..0,
        });
        let H_fg = product_with_sparse_rows(&H, &by_common, &nonzero);
        let floor = 1e-9 * (1.0 + H.trace());
        let mut H_ll = SMatrix::<f64, L, L>::from_fn(|a, b| H[(6 - L + a, 6 - L + b)]);
        for a in 0..L {
            H_ll[(a, a)] += floor;
        }
        let H_lg = SMatrix::<f64, L, G>::from_fn(|a, b| H_fg[(6 - L + a, b)]);
        let g_l = SVector::<f64, L>::from_fn(|a, _| g[6 - L + a]);
        add_transposed_product(&by_common, &nonzero, &H_fg, &mut system.H_gg);
        system.g_g += by_common.tr_mul(&g);
        system.add_frame(H_ll, H_lg, g_l);
    }
    let (weights, distance) = motion.prior();
    for a in 0..G {
        system.H_gg[(a, a)] += weights[a];
        system.g_g[a] += weights[a] * distance[a];
    }
}

/// `H B`, where row `k` of `B` is zero outside of the columns `nonzero[k]`.
fn product_with_sparse_rows<const G: usize>(
    H: &SMatrix<f64, FRAME, FRAME>,
    B: &SMatrix<f64, FRAME, G>,
    nonzero: &[Range<usize>; FRAME],
) -> SMatrix<f64, FRAME, G> {
    let mut product = SMatrix::<f64, FRAME, G>::zeros();
    for (k, span) in nonzero.iter().enumerate() {
        for column in span.clone() {
            product
                .column_mut(column)
                .axpy(B[(k, column)], &H.column(k), 1.0);
        }
    }
    product
}

/// Adds `Bᵀ C` to the symmetric `sum`, where row `k` of `B` is zero outside of the columns `nonzero[k]`.
fn add_transposed_product<const G: usize>(
    B: &SMatrix<f64, FRAME, G>,
    nonzero: &[Range<usize>; FRAME],
    C: &SMatrix<f64, FRAME, G>,
    sum: &mut SMatrix<f64, G, G>,
) {
    for (k, span) in nonzero.iter().enumerate() {
        let row: SVector<f64, G> = SVector::from_fn(|b, _| C[(k, b)]);
        for column in span.clone() {
            // The sum is symmetric: its columns are its rows.
            sum.column_mut(column).axpy(B[(k, column)], &row, 1.0);
        }
    }
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
        let mut system = System::<6, 1>::new(6);
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
        close(system.g_g[0], step(h), step(-h));
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
