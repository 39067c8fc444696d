//! Feed-forward: the torque that keeps the base still while the arm moves.

use nalgebra::{DVector, Vector3};

use crate::dynamics::flexible::{FlexibleState, FlexibleSystem, FlexibleWorkspace};
use crate::spatial::{Pose, Twist};

/// Motion of the arm at a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmMotion<'a> {
    /// Joint positions \[rad or m\].
    pub q: &'a [f64],
    /// Joint rates \[rad/s or m/s\].
    pub qd: &'a [f64],
    /// Joint accelerations until the next sample \[rad/s² or m/s²\], if they are known, as those of a commanded motion
    /// are; otherwise those since the last sample are taken.
    pub qdd: Option<&'a [f64]>,
}

/// Angular momentum of the arm relative to a base that does not turn, and the torque on the base that balances its
/// change. No call but the constructor allocates memory.
///
/// About the centre of mass of everything, angular momentum is constant without external torques. While the base does
/// not turn, the arm's share of it is `h(q, q')`, linear in the rates, however the base moves otherwise; what the arm
/// gains, the wheels must lose. So the mean torque on the base that keeps it still for a period T is
/// `(h(t + T) - h(t)) / T`.
#[derive(Debug, Clone)]
pub struct ArmMomentum {
    state: FlexibleState,
    workspace: FlexibleWorkspace,
    /// Rates of the last sample, if there was one.
    last_qd: DVector<f64>,
    has_last: bool,
    qdd: DVector<f64>,
}

impl ArmMomentum {
    /// For `system`. Its wheels and deformations do not count.
    pub fn new(system: &FlexibleSystem) -> Self {
        let dof = system.model().dof();
        let state = FlexibleState::at_rest(system);
        let mut workspace = FlexibleWorkspace::new(system);
        workspace.set_state(&state);
        Self {
            state,
            workspace,
            last_qd: DVector::zeros(dof),
            has_last: false,
            qdd: DVector::zeros(dof),
        }
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.last_qd.len()
    }

    /// Forgets the last sample.
    pub fn reset(&mut self) {
        self.has_last = false;
    }

    /// Angular momentum about the centre of mass of everything while the base does not turn, base axes \[N m s\].
    ///
    /// # Panics
    /// If there is not one position and rate per joint.
    pub fn angular_momentum(&mut self, q: &[f64], qd: &[f64]) -> Vector3<f64> {
        self.state.tree.q.copy_from_slice(q);
        self.state.tree.qd.copy_from_slice(qd);
        self.state.unwind_joints(self.workspace.system());
        // The momentum that a base at rest in the world's axes leaves.
        self.state
            .set_base(&mut self.workspace, &Pose::identity(), &Twist::ZERO);
        self.state.tree.momentum_W.angular
    }

    /// Centre of mass of everything in the base frame at the positions of the last call \[m\].
    pub fn p_BC(&self) -> &Vector3<f64> {
        self.workspace.p_BC()
    }

    /// Mean torque on the base, base axes \[N m\], that balances the arm for the next `period` \[s\]. Without known
    /// accelerations those since the call before, a `period` ago, are continued; the first call gives zero then.
    ///
    /// # Panics
    /// If there is not one value per joint.
    pub fn torque(&mut self, motion: &ArmMotion<'_>, period: f64) -> Vector3<f64> {
        let now = self.angular_momentum(motion.q, motion.qd);
        let known = match motion.qdd {
            Some(qdd) => {
                self.qdd.copy_from_slice(qdd);
                true
            }
            None if self.has_last => {
                for (j, qdd) in self.qdd.iter_mut().enumerate() {
                    *qdd = (motion.qd[j] - self.last_qd[j]) / period;
                }
                true
            }
            None => false,
        };
        self.last_qd.copy_from_slice(motion.qd);
        self.has_last = true;
        if !known {
            return Vector3::zeros();
        }
        // The state holds now; on to the end of the period.
        let tree = &mut self.state.tree;
        for j in 0..motion.q.len() {
            tree.q[j] += (motion.qd[j] + 0.5 * period * self.qdd[j]) * period;
            tree.qd[j] += self.qdd[j] * period;
        }
        self.state.unwind_joints(self.workspace.system());
        self.state
            .set_base(&mut self.workspace, &Pose::identity(), &Twist::ZERO);
        (self.state.tree.momentum_W.angular - now) / period
    }
}
