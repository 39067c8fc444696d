//! Stability of sampled joint damping.

use nalgebra::{DMatrix, DVector, linalg::Cholesky};

use crate::dynamics::Workspace;

/// Rate at which the joint damping `-K_V q̇` of a control law slows the joints down, in the fastest direction: the
/// largest eigenvalue of `Ĥ⁻¹ K_V`, with the reduced inertia `Ĥ`.
///
/// A control loop is sampled: the effort for one state is held for a period `T`. Along the eigenvector of `λ` a rate
/// `v` becomes `v - λ T v` in a period, which grows from one period to the next if `λ T > 2`. If the effort acts a
/// fraction `δ` of a period after its state, `z² - (1 - (1 - δ) λ T) z + δ λ T = 0` must have no root outside the unit
/// circle: `λ T < 1` is sufficient for any delay up to a period, and necessary for a whole period. The integration step
/// does not matter.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledDamping {
    /// `L` with `Ĥ = L Lᵀ`.
    factor: DMatrix<f64>,
    k_v: Vec<f64>,
    /// `λ` \[1/s\].
    pub rate: f64,
    /// The joint with the largest part in this motion: its damping takes most of the power.
    pub joint: usize,
}

impl SampledDamping {
    /// Period, in units of 1/λ, above which the loop is unstable if efforts act at once.
    pub const UNSTABLE: f64 = 2.0;
    /// Period, in units of 1/λ, above which the loop is unstable if efforts act a period late.
    pub const UNSTABLE_IF_LATE: f64 = 1.0;

    /// Period, in units of 1/λ, above which the loop is unstable if efforts act `periods` whole periods late: `2 sin(π
    /// / (4 m + 2))`, where a root of `z^(m+1) - z^m + λ T = 0` leaves the unit circle (Levin and May, A note on
    /// difference-delay equations, Theoretical Population Biology 9 (1976) 178).
    pub fn limit_if_late(periods: u32) -> f64 {
        2.0 * (std::f64::consts::PI / (4.0 * f64::from(periods) + 2.0)).sin()
    }

    /// The damping with the gains `k_v` \[N m s/rad or N s/m\] in the posture of `workspace`. `None` for a robot without
    /// joints, or with a reduced inertia that is not positive.
    ///
    /// # Panics
    /// If `k_v` does not have one gain per joint.
    pub fn at(workspace: &mut Workspace, k_v: &[f64]) -> Option<Self> {
        assert_eq!(k_v.len(), workspace.model().dof(), "one gain per joint");
        let factor = Cholesky::new(workspace.reduced_inertia().clone())?.l();
        let (rate, joint) = largest(&factor, k_v)?;
        Some(Self {
            factor,
            k_v: k_v.to_vec(),
            rate,
            joint,
        })
    }

    /// The largest gain of [`Self::joint`] for which `λ` is at most `rate` \[1/s\] with the other gains unchanged.
    /// `None` if these are too large already.
    pub fn largest_gain(&self, rate: f64) -> Option<f64> {
        let with = |gain: f64| {
            let mut k_v = self.k_v.clone();
            k_v[self.joint] = gain;
            largest(&self.factor, &k_v).map_or(f64::INFINITY, |(rate, _)| rate)
        };
        if with(0.0) > rate {
            return None;
        }
        // The eigenvalue grows with the gain.
        let gain = largest_below(self.k_v[self.joint], |gain| with(gain) <= rate);
        (gain > 0.0).then_some(gain)
    }
}

/// The largest value from 0 to `high` for which `holds` is true, by bisection; it must be true for all smaller values
/// and false at `high`.
pub(super) fn largest_below(mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    let mut low = 0.0;
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        match holds(middle) {
            true => low = middle,
            false => high = middle,
        }
    }
    low
}

/// The largest eigenvalue of `Ĥ⁻¹ K_V`, and the largest component of its eigenvector in the metric of `K_V`.
fn largest(factor: &DMatrix<f64>, k_v: &[f64]) -> Option<(f64, usize)> {
    // √K Ĥ⁻¹ √K = Bᵀ B with B = L⁻¹ √K has the same eigenvalues, and is symmetric.
    let roots = DVector::from_iterator(k_v.len(), k_v.iter().map(|k| k.sqrt()));
    let scaled = factor.solve_lower_triangular(&DMatrix::from_diagonal(&roots))?;
    let eigen = scaled.tr_mul(&scaled).symmetric_eigen();
    let (i, rate) = largest_of(eigen.eigenvalues.iter().copied())?;
    let (joint, _) = largest_of(eigen.eigenvectors.column(i).iter().map(|x| x.abs()))?;
    Some((rate, joint))
}

/// Index and value of the largest element.
fn largest_of(values: impl Iterator<Item = f64>) -> Option<(usize, f64)> {
    values.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Model;

    const K_V: [f64; 6] = [400.0, 100.0, 200.0, 10.0, 2.0, 2.0];

    fn servicer() -> Workspace {
        let xml = include_str!("../../../../urdf/servicer.urdf");
        let mut workspace = Workspace::new(&Model::from_urdf(xml, "servicer").unwrap());
        let q = DVector::from_vec(vec![1.134, 1.728, -1.658, -0.384, 0.0524, -0.733]);
        workspace.set_positions(&q);
        workspace
    }

    /// Growth of the joint rates over 200 periods under sampled damping alone, in one posture.
    fn growth(workspace: &mut Workspace, k_v: &[f64], period: f64, late: bool) -> f64 {
        let inverse = workspace.reduced_inertia().clone().try_inverse().unwrap();
        let gains = DMatrix::from_diagonal(&DVector::from_column_slice(k_v));
        let decay = inverse * gains * period;
        let mut rates = DVector::from_element(6, 1.0);
        let mut before = rates.clone();
        for _ in 0..200 {
            let next = &rates - &decay * if late { &before } else { &rates };
            before = std::mem::replace(&mut rates, next);
        }
        rates.amax()
    }

    // Fails if the eigenvalue or the limits are wrong: just below a limit rates decay, just above it they grow.
    #[test]
    fn rates_grow_beyond_the_limits_only() {
        let mut workspace = servicer();
        let damping = SampledDamping::at(&mut workspace, &K_V).unwrap();
        for (limit, late) in [
            (SampledDamping::UNSTABLE, false),
            (SampledDamping::UNSTABLE_IF_LATE, true),
        ] {
            let period = limit / damping.rate;
            assert!(growth(&mut workspace, &K_V, 0.95 * period, late) < 1.0);
            assert!(growth(&mut workspace, &K_V, 1.05 * period, late) > 10.0);
        }
    }

    // Fails if the limit of long delays is wrong: the recursion itself decays just below it and grows just above it.
    #[test]
    fn rates_that_are_damped_many_periods_late_grow_beyond_the_limit_only() {
        assert!((SampledDamping::limit_if_late(0) - SampledDamping::UNSTABLE).abs() < 1e-15);
        let one = SampledDamping::limit_if_late(1);
        assert!((one - SampledDamping::UNSTABLE_IF_LATE).abs() < 1e-15);
        for periods in [0, 1, 2, 3, 5, 10] {
            let last = |part: f64| {
                let damping = part * SampledDamping::limit_if_late(periods);
                let mut rates = vec![1.0; periods as usize + 1];
                for i in 0..20_000 {
                    rates.push(rates[rates.len() - 1] - damping * rates[i]);
                }
                let end = rates.len() - 100;
                (rates[end..].iter()).fold(0.0, |most: f64, rate| match rate.is_finite() {
                    true => most.max(rate.abs()),
                    false => f64::INFINITY,
                })
            };
            assert!(last(0.98) < 1e-3, "{periods} periods: {}", last(0.98));
            assert!(last(1.02) > 10.0, "{periods} periods: {}", last(1.02));
        }
    }

    #[test]
    fn the_joint_and_a_gain_that_works_are_named() {
        let mut workspace = servicer();
        let mut k_v = K_V;
        k_v[4] = 1e4;
        let damping = SampledDamping::at(&mut workspace, &k_v).unwrap();
        assert_eq!(damping.joint, 4);
        k_v[4] = damping.largest_gain(100.0).unwrap();
        let lower = SampledDamping::at(&mut workspace, &k_v).unwrap();
        assert!((lower.rate - 100.0).abs() < 1e-6, "{}", lower.rate);
        assert!(k_v[4] > 2.0);
        // No gain of this joint makes up for the others.
        assert_eq!(damping.largest_gain(1.0), None);
    }
}
