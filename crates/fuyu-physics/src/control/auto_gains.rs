//! Gains from the inertia of the robot and the sampling period.

use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector, Matrix6xX};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::{Gains, SampledDamping, Saturation};
use crate::dynamics::Workspace;
use crate::model::{Frame, Joint, Model};

/// Number of sampled postures.
const POSTURES: usize = 200;

/// Product of the joints' largest decay rate and the sampling period. The loop is stable up to 2 if efforts act at once
/// and up to 1 if they act a period late; it does not overshoot up to 1 and 1/4, respectively ([`SampledDamping`]).
const DECAY_PER_PERIOD: f64 = 0.25;

/// Gains computed for one robot and one sampling period.
#[derive(Debug, Clone, PartialEq)]
pub struct AutoGains {
    /// Gains on the deviation of the tip and on the joint rates.
    pub gains: Gains,
    /// Gains on the joint positions for [`JointPd`](super::JointPd) \[N m/rad or N/m\].
    pub joint_k_p: Vec<f64>,
}

impl AutoGains {
    /// Gains for the tip `tip` of `model`, sampled with `period` \[s\]. They depend on nothing else: the postures are
    /// the same in every call. `None` for a robot without joints, with a reduced inertia that is not positive definite,
    /// or of which no joint moves the tip's position.
    ///
    /// - `k_v` is proportional to the inertia that each joint moves while the others are free, `1 / (Ĥ⁻¹)_jj`, in the posture where it is
    ///   least. The largest eigenvalue of `Ĥ⁻¹ K_V` times the period is 1/4 in the worst posture: within the stability
    ///   limit of the sampled loop, also if efforts act a period late, and without overshoot.
    /// - `k_p` and `k_o` are the largest for which no motion of the arm, in any of the postures, is less than critically damped:
    ///   `λ(K_V⁻¹ (k_p Ĵ_Lᵀ Ĵ_L + k_o Ĵ_Aᵀ Ĵ_A)) <= ¼ λ_min(Ĥ⁻¹ K_V)`, half of it for each.
    /// - `joint_k_p` damps each joint critically with the largest inertia that it moves: `k_v² / 4 Ĥ_jj`.
    ///
    /// # Panics
    /// If `tip` is not a frame of `model`.
    pub fn new(model: &Model, tip: &Frame, period: f64) -> Option<Self> {
        let n = model.dof();
        let mut workspace = Workspace::new(model);
        let mut random = StdRng::seed_from_u64(1);
        let postures: Vec<DVector<f64>> = (0..POSTURES)
            .map(|k| DVector::from_fn(n, |j, _| position(&model.joints()[j], k, &mut random)))
            .collect();
        let mut k_v = vec![f64::INFINITY; n];
        let mut heaviest = vec![0.0_f64; n];
        for q in &postures {
            workspace.set_positions(q);
            let inertia = workspace.reduced_inertia().clone();
            let inverse = inertia.clone().cholesky()?.inverse();
            for j in 0..n {
                k_v[j] = k_v[j].min(1.0 / inverse[(j, j)]);
                heaviest[j] = heaviest[j].max(inertia[(j, j)]);
            }
        }
        let mut fastest = 0.0_f64;
        for q in &postures {
            workspace.set_positions(q);
            fastest = fastest.max(SampledDamping::at(&mut workspace, &k_v)?.rate);
        }
        let scale = DECAY_PER_PERIOD / (period * fastest);
        k_v.iter_mut().for_each(|k| *k *= scale);
        let roots = DVector::from_iterator(n, k_v.iter().map(|k| k.sqrt()));
        let mut jacobian = Matrix6xX::zeros(n);
        let (mut slowest, mut linear, mut angular) = (f64::INFINITY, 0.0_f64, 0.0_f64);
        for q in &postures {
            workspace.set_positions(q);
            // K^-½ Ĥ K^-½ has the inverses of the eigenvalues of Ĥ⁻¹ K_V.
            let inertia = workspace.reduced_inertia();
            let scaled = DMatrix::from_fn(n, n, |i, j| inertia[(i, j)] / (roots[i] * roots[j]));
            slowest = slowest.min(1.0 / scaled.symmetric_eigenvalues().max());
            workspace.generalized_jacobian(tip, &mut jacobian);
            for (j, mut column) in jacobian.column_iter_mut().enumerate() {
                column /= roots[j];
            }
            let largest = |first: usize| {
                let rows = jacobian.rows(first, 3);
                (rows * rows.transpose()).symmetric_eigenvalues().max()
            };
            (linear, angular) = (linear.max(largest(0)), angular.max(largest(3)));
        }
        let share = 0.125 * slowest;
        let joint_k_p = k_v.iter().zip(&heaviest);
        let joint_k_p = joint_k_p
            .map(|(k, inertia)| k * k / (4.0 * inertia))
            .collect();
        let gain = |size: f64| if size > 0.0 { share / size } else { 0.0 };
        let (k_p, k_o) = (gain(linear), gain(angular));
        (k_p > 0.0).then_some(Self {
            joint_k_p,
            gains: Gains {
                k_p,
                k_o,
                k_v,
                saturation: Saturation {
                    position: 0.2,
                    orientation: 0.1,
                },
            },
        })
    }
}

/// A position of `joint` in posture `k`: zero (or the nearest position) in the first posture, otherwise random within
/// its limits, cut to a turn, or 2 m for a slider without limits, as near to zero as possible.
fn position(joint: &Joint, k: usize, random: &mut StdRng) -> f64 {
    let (lower, upper) = (joint.limits.lower, joint.limits.upper);
    // A full turn contains all postures; a slider without limits has no farthest posture.
    let (half, is_long) = match joint.kind.is_rotational() {
        true => (PI, upper - lower > 2.0 * PI),
        false => (1.0, !(upper - lower).is_finite()),
    };
    let (lower, upper) = match is_long {
        true => {
            let lower = (-half).clamp(lower, upper - 2.0 * half);
            (lower, lower + 2.0 * half)
        }
        false => (lower, upper),
    };
    match lower < upper {
        true if k > 0 => random.random_range(lower..upper),
        true => 0.0_f64.clamp(lower, upper),
        false => lower,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::fixtures::servicer;
    use crate::control::{JacobianKind, LinearisedLoop};

    // On postures that were not sampled. Fails with gains that ignore the coupling between the joints.
    #[test]
    fn the_sampled_loop_is_stable_and_critically_damped_everywhere() {
        let (model, tip) = servicer();
        let mut workspace = Workspace::new(&model);
        for period in [0.002, 0.01, 0.1] {
            let auto = AutoGains::new(&model, &tip, period).unwrap();
            for k in 0..100 {
                let q = DVector::from_fn(6, |j, _| (1.7 * (k * 6 + j) as f64).sin() * 3.0);
                workspace.set_positions(&q);
                let damping = SampledDamping::at(&mut workspace, &auto.gains.k_v).unwrap();
                assert!(damping.rate * period < SampledDamping::UNSTABLE_IF_LATE);
                assert!(damping.rate * period > 0.01);
                let generalized = JacobianKind::Generalized;
                let near =
                    LinearisedLoop::at(&model, &mut workspace, &tip, &q, &auto.gains, generalized);
                for root in near.eigenvalues().unwrap() {
                    assert!(
                        root.im.abs() <= 1e-4 * root.norm() + 1e-6,
                        "{period} {k}: {root}"
                    );
                    assert!(root.re < 1e-9);
                }
            }
        }
    }

    #[test]
    fn gains_scale_with_period_and_inertia() {
        let (model, tip) = servicer();
        let slow = AutoGains::new(&model, &tip, 0.02).unwrap();
        let fast = AutoGains::new(&model, &tip, 0.01).unwrap();
        for j in 0..6 {
            assert!((fast.gains.k_v[j] / slow.gains.k_v[j] - 2.0).abs() < 1e-12);
            assert!((fast.joint_k_p[j] / slow.joint_k_p[j] - 4.0).abs() < 1e-12);
        }
        assert!((fast.gains.k_p / slow.gains.k_p - 4.0).abs() < 1e-9);
    }

    // Fails if limits far from zero are cut to +-1 m and +-pi: most of their range then has no posture.
    #[test]
    fn postures_fill_the_limits() {
        let range = |kind: &str, limits: &str| {
            let xml = include_str!("../../../../urdf/planar_two_link.urdf");
            let joint2 = "<joint name=\"joint2\" type=\"continuous\">";
            assert!(xml.contains(joint2));
            let limited = format!("<joint name=\"joint2\" type=\"{kind}\">{limits}");
            let model = Model::from_urdf(&xml.replace(joint2, &limited), "planar").unwrap();
            let mut random = StdRng::seed_from_u64(1);
            let all = (0..500).map(|k| position(&model.joints()[1], k, &mut random));
            all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| {
                (low.min(q), high.max(q))
            })
        };
        let limit = |lower: f64, upper: f64| {
            format!("<limit lower=\"{lower}\" upper=\"{upper}\" velocity=\"1\" effort=\"9\"/>")
        };
        for (kind, limits, expected) in [
            ("prismatic", limit(0.0, 5.0), (0.0, 5.0)),
            ("prismatic", limit(2.0, 5.0), (2.0, 5.0)),
            ("revolute", limit(3.5, 5.0), (3.5, 5.0)),
            ("revolute", limit(-2.0, 3.0), (-2.0, 3.0)),
            ("revolute", limit(-7.0, 7.0), (-PI, PI)),
            ("revolute", limit(1.0, 9.0), (1.0, 1.0 + 2.0 * PI)),
            ("continuous", String::new(), (-PI, PI)),
        ] {
            let (low, high) = range(kind, &limits);
            let near = 0.05 * (expected.1 - expected.0);
            assert!(low >= expected.0 && low < expected.0 + near, "{kind} {low}");
            assert!(
                high <= expected.1 && high > expected.1 - near,
                "{kind} {high}"
            );
        }
    }
}
