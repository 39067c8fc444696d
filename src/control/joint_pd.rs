//! Joint-space PD: what a fixed-base robot would do, and what misses here.

use nalgebra::DVector;

/// `τ = K_P (q_D - q) - K_V q̇` towards joint positions found once, by inverse kinematics at the start.
/// Because the base moves meanwhile, the tip ends beside the goal: Masutani 1995 Fig. 5.3(a).
#[derive(Debug, Clone, PartialEq)]
pub struct JointPd {
    /// Position gains \[N m/rad or N/m\], one per joint.
    pub k_p: Vec<f64>,
    /// Velocity gains \[N m s/rad or N s/m\], one per joint.
    pub k_v: Vec<f64>,
    /// Joint positions to reach \[rad or m\].
    pub goal: DVector<f64>,
}

impl JointPd {
    /// Writes joint efforts \[N m or N\].
    pub fn efforts(&self, q: &DVector<f64>, qd: &DVector<f64>, efforts: &mut DVector<f64>) {
        for j in 0..self.goal.len() {
            efforts[j] = self.k_p[j] * (self.goal[j] - q[j]) - self.k_v[j] * qd[j];
        }
    }
}
