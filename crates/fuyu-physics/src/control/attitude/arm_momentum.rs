//! Feed-forward: the torque that keeps the base still while the arm moves.

use nalgebra::Vector3;

use crate::dynamics::flexible::{FlexibleState, FlexibleSystem, FlexibleWorkspace};
use crate::spatial::{Pose, Twist};

/// Motion of the arm at a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmMotion<'a> {
    /// Joint positions \[rad or m\].
    pub q: &'a [f64],
    /// Joint rates \[rad/s or m/s\].
    pub qd: &'a [f64],
    /// Joint accelerations until the next sample \[rad/s² or m/s²\], if they are known, such as those of a commanded
    /// motion.
    pub qdd: Option<&'a [f64]>,
}

/// Angular momentum of the arm relative to a base that does not turn, and the torque on the base that balances its
/// change. Only the constructor allocates memory.
///
/// About the system's centre of mass, angular momentum is constant without external torques. While the base does
/// not turn, the arm's part is `h(q, q')`, linear in the rates, for any translation of the base; the wheels must lose the
/// momentum that the arm gains. So the mean torque on the base that keeps it still for a period T is
/// `d = (h(t + T) - h(t)) / T`.
///
/// If only past rates are known, the law uses `h'` of the last period. It equals d for joints that servos hold. Free joints
/// follow the base, so that a feed-forward torque with error e makes `h' = d - R e`, where R is the ratio of the inertia
/// that the arm adds to the locked robot to the rest of the robot's inertia: a torque of h' alone would feed back on itself,
/// and grow for `R > 1`. So the torque is a weighted mean of h' (weight β) and of itself a period ago. Its error is then
/// multiplied by `1 - β (1 + R)` in a period: with β = 1/2 it decays for all R < 3. For any R, the attitude law acts on the
/// inertia of the locked robot.
#[derive(Debug, Clone)]
pub struct ArmMomentum {
    state: FlexibleState,
    workspace: FlexibleWorkspace,
    /// Angular momentum at the last sample.
    last: Option<Vector3<f64>>,
    /// The last result.
    torque: Vector3<f64>,
}

/// Weight β.
const TRUST: f64 = 0.5;

impl ArmMomentum {
    /// Computes the arm's momentum for `system`, without its wheels and deformations.
    pub fn new(system: &FlexibleSystem) -> Self {
        let state = FlexibleState::at_rest(system);
        let mut workspace = FlexibleWorkspace::new(system);
        workspace.set_state(&state);
        Self {
            state,
            workspace,
            last: None,
            torque: Vector3::zeros(),
        }
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.state.tree.q.len()
    }

    /// Forgets the last sample.
    pub fn reset(&mut self) {
        self.last = None;
        self.torque = Vector3::zeros();
    }

    /// Angular momentum about the system's centre of mass while the base does not turn, base axes \[N m s\].
    ///
    /// # Panics
    /// If there is not one position and rate per joint.
    pub fn angular_momentum(&mut self, q: &[f64], qd: &[f64]) -> Vector3<f64> {
        self.state.tree.q.copy_from_slice(q);
        self.state.tree.qd.copy_from_slice(qd);
        self.momentum_of_state()
    }

    fn momentum_of_state(&mut self) -> Vector3<f64> {
        self.state.unwind_joints(self.workspace.system());
        // Momentum for which the base is at rest in the world's axes.
        self.state
            .set_base(&mut self.workspace, &Pose::identity(), &Twist::ZERO);
        self.state.tree.momentum_W.angular
    }

    /// The system's centre of mass in the base frame at the positions of the last call \[m\].
    pub fn p_BC(&self) -> &Vector3<f64> {
        self.workspace.p_BC()
    }

    /// Mean torque on the base, base axes \[N m\], that balances the arm for the next `period` \[s\]. Without known
    /// accelerations it is computed from the previous calls, the last of which must be a `period` ago; the first call
    /// then gives zero.
    ///
    /// # Panics
    /// If there is not one value per joint.
    pub fn torque(&mut self, motion: &ArmMotion<'_>, period: f64) -> Vector3<f64> {
        let now = self.angular_momentum(motion.q, motion.qd);
        let last = self.last.replace(now);
        let Some(qdd) = motion.qdd else {
            let rate = last.map_or_else(Vector3::zeros, |last| (now - last) / period);
            self.torque += (rate - self.torque) * TRUST;
            return self.torque;
        };
        // The state holds the present motion; advance it to the end of the period.
        let tree = &mut self.state.tree;
        for (j, acceleration) in qdd.iter().enumerate() {
            tree.q[j] += (motion.qd[j] + 0.5 * period * acceleration) * period;
            tree.qd[j] += acceleration * period;
        }
        self.torque = (self.momentum_of_state() - now) / period;
        self.torque
    }
}
