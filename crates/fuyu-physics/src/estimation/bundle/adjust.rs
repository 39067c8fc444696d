//! Bundle adjustment: the poses, points and common parameters with the least reprojection cost.
//!
//! Levenberg-Marquardt with a [`PixelLikelihood`] for each image point and a weak prior on depths. A [`PoseModel`]
//! gives the poses: one independent pose per frame, or attitudes from a motion model.

use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};

use super::pixel_likelihood::PixelLikelihood;
use super::pose_model::{FramePose, PoseModel};
use super::scene::{MIN_DEPTH, Scene};
use super::schur::{Step, System};

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
    let mut cost = total_cost(scene, motion, points, &adjust_options.likelihood)?;
    let (mut damping, mut growth) = (1e-7, 4.0);
    let mut steps = 0;
    let mut is_linearised = false;
    while steps < adjust_options.steps {
        if !is_linearised {
            linearise(
                scene,
                motion,
                points,
                &adjust_options.likelihood,
                &mut system,
            );
            is_linearised = true;
        }
        steps += 1;
        let tried = system.step(damping).and_then(|step| {
            let (moved, moved_points) = apply(motion, points, &step)?;
            let reached = total_cost(scene, &moved, &moved_points, &adjust_options.likelihood)?;
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
    Some(AdjustOutcome { cost, steps })
}

/// Information on the common parameters with everything else marginalised out \[per px²\].
pub fn information<const L: usize, const G: usize, M: PoseModel<L, G>>(
    scene: &Scene,
    motion: &M,
    points: &[Vector3<f64>],
    likelihood: &PixelLikelihood,
) -> Option<SMatrix<f64, G, G>> {
    let mut system = System::<L, G>::new(scene.points);
    linearise(scene, motion, points, likelihood, &mut system);
    system.marginal_information()
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
    let focal = scene.focal * motion.log_focal().exp();
    let mut cost = 0.0;
    for i in 0..scene.len() {
        let FramePose { R_CB, t_C } = motion.pose(i);
        let R = R_CB.to_rotation_matrix();
        for observation in scene.frame(i).iter().filter(|s| s.inlier) {
            let x = R * points[observation.point] + t_C;
            if x.z < MIN_DEPTH {
                return None;
            }
            let inverse = 1.0 / x.z;
            cost += likelihood.cost(&Vector2::new(
                focal.x * x.x * inverse - observation.pixel.x,
                focal.y * x.y * inverse - observation.pixel.y,
            ));
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
    system: &mut System<L, G>,
) {
    system.clear();
    let focal = scene.focal * motion.log_focal().exp();
    for i in 0..scene.len() {
        let FramePose { R_CB, t_C } = motion.pose(i);
        let R = *R_CB.to_rotation_matrix().matrix();
        let pose = motion.pose_by_common(i);
        let common_by_pose = pose.transpose();
        let mut H = SMatrix::<f64, 7, 7>::zeros();
        let mut g = SVector::<f64, 7>::zeros();
        for observation in scene.frame(i).iter().filter(|s| s.inlier) {
            let p = points[observation.point];
            let Rp = R * p;
            let x = Rp + t_C;
            let inverse = 1.0 / x.z.max(MIN_DEPTH);
            let (u, v) = (focal.x * x.x * inverse, focal.y * x.y * inverse);
            let expansion = likelihood.expand(&(Vector2::new(u, v) - observation.pixel));
            // Scaled residuals and rows of J, so that ½ r² has the slope and curvature of the cost.
            let root = expansion.curvature.map(f64::sqrt);
            let anchor = scene.anchor(observation.point);
            let scaled = expansion.slope.component_div(&root);
            let r = Vector3::new(scaled.x, scaled.y, anchor * (x.z - 1.0));
            #[rustfmt::skip]
            let by_x = Matrix3::new(
                root.x * focal.x * inverse, 0.0, -root.x * u * inverse,
                0.0, root.y * focal.y * inverse, -root.y * v * inverse,
                0.0, 0.0, anchor,
            );
            let by_p = by_x * R;
            // x = R exp([θ×]) p + t: by θ it is -R [p×], and by_p [p×] has the rows of by_p crossed with p.
            let mut J = SMatrix::<f64, 3, 7>::zeros();
            for row in 0..3 {
                let a = Vector3::new(by_p[(row, 0)], by_p[(row, 1)], by_p[(row, 2)]);
                let c = p.cross(&a);
                for k in 0..3 {
                    J[(row, k)] = c[k];
                    J[(row, 3 + k)] = by_x[(row, k)];
                }
            }
            J[(0, 6)] = root.x * u;
            J[(1, 6)] = root.y * v;
            for a in 0..7 {
                for b in 0..=a {
                    H[(a, b)] +=
                        J[(0, a)] * J[(0, b)] + J[(1, a)] * J[(1, b)] + J[(2, a)] * J[(2, b)];
                }
            }
            g += J.tr_mul(&r);
            system.add_point(observation.point, &by_p.tr_mul(&by_p), &by_p.tr_mul(&r));
            let H_7p: SMatrix<f64, 7, 3> = J.tr_mul(&by_p);
            let H_lp = SMatrix::<f64, L, 3>::from_fn(|a, b| H_7p[(6 - L + a, b)]);
            system.couple(observation.point, H_lp);
            let H_gp = system.with_common(observation.point);
            for (b, column) in H_gp.as_mut_slice().chunks_exact_mut(G).enumerate() {
                for (k, common) in common_by_pose.as_slice().chunks_exact(G).enumerate() {
                    for (sum, part) in column.iter_mut().zip(common) {
                        *sum += part * H_7p[(k, b)];
                    }
                }
                column[G - 1] += H_7p[(6, b)];
            }
        }
        H.fill_upper_triangle_with_lower_triangle();
        // Derivatives of the frame's pose and focal length (7) by the common unknowns.
        let mut by_common = SMatrix::<f64, 7, G>::zeros();
        by_common.fixed_rows_mut::<6>(0).copy_from(&pose);
        by_common[(6, G - 1)] += 1.0;
        let H_7g = H * by_common;
        let floor = 1e-9 * (1.0 + H.trace());
        let mut H_ll = SMatrix::<f64, L, L>::from_fn(|a, b| H[(6 - L + a, 6 - L + b)]);
        for a in 0..L {
            H_ll[(a, a)] += floor;
        }
        let H_lg = SMatrix::<f64, L, G>::from_fn(|a, b| H_7g[(6 - L + a, b)]);
        let g_l = SVector::<f64, L>::from_fn(|a, _| g[6 - L + a]);
        system.H_gg += by_common.tr_mul(&H_7g);
        system.g_g += by_common.tr_mul(&g);
        system.add_frame(H_ll, H_lg, g_l);
    }
    let (weights, distance) = motion.prior();
    for a in 0..G {
        system.H_gg[(a, a)] += weights[a];
        system.g_g[a] += weights[a] * distance[a];
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
        let motion = IndependentPoses::new(poses.collect(), true);
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
        let (scene, motion, points) = small();
        let mut system = System::<6, 1>::new(6);
        linearise(
            &scene,
            &motion,
            &points,
            &PixelLikelihood::Huber(1.2),
            &mut system,
        );
        let cost = |m: &IndependentPoses, p: &[Vector3<f64>]| {
            total_cost(&scene, m, p, &PixelLikelihood::Huber(1.2)).unwrap()
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
        motion = IndependentPoses::new((0..4).map(|i| motion.pose(i)).collect(), false);
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
