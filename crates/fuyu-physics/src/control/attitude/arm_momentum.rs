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
    /// Joint accelerations until the next sample \[rad/s² or m/s²\], if they are known, as those of a commanded motion
    /// are.
    pub qdd: Option<&'a [f64]>,
}

/// Angular momentum of the arm relative to a base that does not turn, and the torque on the base that balances its
/// change. No call but the constructor allocates memory.
///
/// About the centre of mass of everything, angular momentum is constant without external torques. While the base does
/// not turn, the arm's share of it is `h(q, q')`, linear in the rates, however the base moves otherwise; what the arm
/// gains, the wheels must lose. So the mean torque on the base that keeps it still for a period T is
/// `d = (h(t + T) - h(t)) / T`.
///
/// If only past rates are known, `h'` of the last period is at hand. It is d for joints that servos hold. Free joints
/// follow the base, so that a feed-forward torque that errs by e makes `h' = d - R e`, where R compares the inertia
/// that the arm adds to the locked robot with the rest: a torque of h' alone would feed back on itself, and grow for
/// `R > 1`. So the torque is a mean of h' and of itself a period ago, with the weight β on h'. Its error is then multiplied
/// by `1 - β (1 + R)` in a period: with β = 1/2 it decays for all R < 3. Whatever R is, the law meets the inertia of
/// the locked robot.
#[derive(Debug, Clone)]
pub struct ArmMomentum {
    state: FlexibleState,
    workspace: FlexibleWorkspace,
    /// Angular momentum at the last sample.
    last: Option<Vector3<f64>>,
    /// The last result.
    torque: Vector3<f64>,
}

/// β.
const TRUST: f64 = 0.5;

impl ArmMomentum {
    /// For `system`. Its wheels and deformations do not count.
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

    /// Angular momentum about the centre of mass of everything while the base does not turn, base axes \[N m s\].
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
    /// accelerations it follows from the calls before, the last of them a `period` ago; the first gives zero then.
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
        // The state holds the present; on to the end of the period.
        let tree = &mut self.state.tree;
        for (j, acceleration) in qdd.iter().enumerate() {
            tree.q[j] += (motion.qd[j] + 0.5 * period * acceleration) * period;
            tree.qd[j] += acceleration * period;
        }
        self.torque = (self.momentum_of_state() - now) / period;
        self.torque
    }
}
