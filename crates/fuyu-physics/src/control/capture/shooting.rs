//! Shooting: integrates the base's motion along a joint path, and finds the end of the path that brings the tip to the
//! goal.

use nalgebra::{DMatrix, DVector, Translation3, UnitQuaternion, Vector3, Vector6};

use super::plan::{PlanError, point, quintic};
use super::rendezvous::{Rendezvous, RendezvousPlanner};
use super::tip_impedance::stacked;
use crate::control::commander::JointPoint;
use crate::control::damped_descent::shortened;
use crate::dynamics::{Momentum, State};
use crate::spatial::{Pose, Twist, exp_so3};

/// Number of pieces of the path for the integration of the base's rotation by Magnus's method of fourth order.
pub(super) const PIECES: usize = 48;
/// Largest deviation of the tip from its goal at the arrival, of position \[m\] and rotation vector \[rad\].
const TOLERANCE: f64 = 1e-9;
const ITERATIONS: usize = 25;
/// Longest step of the joints in an iteration \[rad or m\].
pub(super) const LONGEST_STEP: f64 = 0.4;

/// Joint motion at the arrival.
#[derive(Debug, Clone)]
pub(super) struct End {
    pub q: DVector<f64>,
    pub qd: DVector<f64>,
    pub qdd: DVector<f64>,
}

/// A joint path, and the resulting motion of base and tip.
pub(super) struct Shot {
    pub polynomials: Vec<[f64; 6]>,
    pub R_IB: UnitQuaternion<f64>,
    pub error: Vector6<f64>,
    /// Difference of rates and accelerations at the end of the path from those of `end`.
    pub rates_off: f64,
    pub end: End,
}

impl RendezvousPlanner {
    pub(super) fn X_IB(&self, R_IB: &UnitQuaternion<f64>) -> Pose {
        let R = R_IB.to_rotation_matrix();
        Pose::from_parts(Translation3::from(-(R * self.workspace.p_BC())), R)
    }

    pub(super) fn X_IE(&self, R_IB: &UnitQuaternion<f64>) -> Pose {
        self.X_IB(R_IB) * self.workspace.X_BF(&self.tip)
    }

    /// Joint rates for a twist of the tip (linear first, axes of I) at zero momentum, by damped least squares.
    pub(super) fn resolved(
        &mut self,
        R_IB: &UnitQuaternion<f64>,
        twist_I: &Vector6<f64>,
        damping: f64,
    ) -> Option<DVector<f64>> {
        self.workspace
            .generalized_jacobian(&self.tip, &mut self.jacobian);
        let [linear, angular] = [0, 3]
            .map(|k| R_IB.inverse_transform_vector(&Vector3::from(twist_I.fixed_rows::<3>(k))));
        let twist = DVector::from_iterator(6, linear.iter().chain(angular.iter()).copied());
        let J = DMatrix::from_fn(6, self.jacobian.ncols(), |r, c| self.jacobian[(r, c)]);
        let normal = &J * J.transpose() + DMatrix::identity(6, 6) * (damping * damping);
        Some(J.tr_mul(&normal.cholesky()?.solve(&twist)))
    }

    /// State of the robot in I, from joint positions, joint rates and attitude of the base.
    pub(super) fn state(&self, task: &Rendezvous, R_IB: UnitQuaternion<f64>, end: &End) -> State {
        let mut state = task.start.state.clone();
        state.R_WB = R_IB;
        state.q.copy_from(&end.q);
        state.qd.copy_from(&end.qd);
        state.p_WC = Vector3::zeros();
        state.momentum_W.linear = Vector3::zeros();
        state
    }

    /// Sets the rates and accelerations for which the tip has the goal's twist and acceleration, at the positions of
    /// `end`.
    fn match_motion(
        &mut self,
        task: &Rendezvous,
        R_IB: UnitQuaternion<f64>,
        end: &mut End,
    ) -> Option<()> {
        let in_I = |twist_B: Twist| Twist::new(R_IB * twist_B.angular, R_IB * twist_B.linear);
        end.qd.fill(0.0);
        let at_rest = self.state(task, R_IB, end);
        self.workspace.set_positions(&end.q);
        self.workspace.set_motion(&at_rest);
        let drift = in_I(self.workspace.V_WF_B(&self.tip));
        let wanted = stacked(&task.goal.V) - stacked(&drift);
        end.qd = self.resolved(&R_IB, &wanted, 1e-6)?;
        let moving = self.state(task, R_IB, end);
        self.workspace.set_motion(&moving);
        // Accelerations with zero joint accelerations.
        (self.workspace).accelerations(&moving, &self.no_input, &mut self.free);
        self.workspace
            .set_accelerations(&DVector::zeros(self.free.len()));
        let bias = in_I(self.workspace.A_WF_B(&self.tip));
        let wanted = stacked(&task.goal.A) - stacked(&bias);
        end.qdd = self.resolved(&R_IB, &wanted, 1e-6)?;
        Some(())
    }

    /// The joint path to `end`.
    fn polynomials(&self, task: &Rendezvous, end: &End) -> Vec<[f64; 6]> {
        let joints = task.start.joints.iter().enumerate();
        let to = |j: usize| JointPoint {
            position: end.q[j],
            rate: end.qd[j],
            acceleration: end.qdd[j],
        };
        joints
            .map(|(j, from)| quintic(from, &to(j), task.duration()))
            .collect()
    }

    /// Angular velocity of the base on the path at `s`, base axes, for the attitude there.
    fn base_rate(
        &mut self,
        task: &Rendezvous,
        (polynomials, bumps): (&[[f64; 6]], &DVector<f64>),
        R_IB: &UnitQuaternion<f64>,
        s: f64,
    ) -> Vector3<f64> {
        let (n, T) = (polynomials.len(), task.duration());
        let (mut q, mut qd) = (DVector::zeros(n), DVector::zeros(n));
        for j in 0..n {
            let at = point(&polynomials[j], bumps[j], s, T);
            (q[j], qd[j]) = (at.position, at.rate);
        }
        self.workspace.set_positions(&q);
        let momentum = &task.start.state.momentum_W;
        let momentum_B = Momentum {
            linear: Vector3::zeros(),
            angular: R_IB.inverse_transform_vector(&momentum.angular),
        };
        self.workspace.base_twist(&momentum_B, &qd).angular
    }

    /// Attitude of the base at the end of a piece of the path.
    pub(super) fn turned(
        &mut self,
        task: &Rendezvous,
        way: (&[[f64; 6]], &DVector<f64>),
        R_IB: &UnitQuaternion<f64>,
        piece: usize,
    ) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let h = task.duration() / PIECES as f64;
        let at = |c: f64| (piece as f64 + c) / PIECES as f64;
        let gauss = 3.0_f64.sqrt() / 6.0;
        // The momentum in base axes needs the attitude within the piece. One evaluation suffices: momentum is a small
        // part of the base's motion, and the piece is short.
        let begin = self.base_rate(task, way, R_IB, at(0.0));
        let within = |c: f64| R_IB * exp_so3(&(begin * (c * h)));
        let a = self.base_rate(task, way, &within(0.5 - gauss), at(0.5 - gauss));
        let b = self.base_rate(task, way, &within(0.5 + gauss), at(0.5 + gauss));
        let turn = (a + b) * (0.5 * h) + a.cross(&b) * (3.0_f64.sqrt() / 12.0 * h * h);
        (R_IB * exp_so3(&turn), (a + b) * 0.5)
    }

    /// Integrates along the path to `end`; the result has rates and accelerations that match the goal at the end of the
    /// path.
    fn follow(&mut self, task: &Rendezvous, mut end: End, bumps: &DVector<f64>) -> Option<Shot> {
        let polynomials = self.polynomials(task, &end);
        let mut R_IB = task.start.state.R_WB;
        for piece in 0..PIECES {
            R_IB = self.turned(task, (&polynomials, bumps), &R_IB, piece).0;
        }
        self.workspace.set_positions(&end.q);
        let error = self.pose_error(&R_IB, task.goal);
        let used = end.clone();
        self.match_motion(task, R_IB, &mut end)?;
        let off = (&end.qd - used.qd).amax() + (&end.qdd - used.qdd).amax();
        Some(Shot {
            polynomials,
            R_IB,
            error,
            rates_off: off,
            end,
        })
    }

    /// Newton's method on the joint positions at the end of the path.
    pub(super) fn shoot(
        &mut self,
        task: &Rendezvous,
        end: End,
        bumps: &DVector<f64>,
    ) -> Result<Shot, PlanError> {
        let not_reached = |error: &Vector6<f64>| PlanError::NotReached {
            arrival: task.arrival,
            position: error.fixed_rows::<3>(0).norm(),
            angle: error.fixed_rows::<3>(3).norm(),
        };
        let far = Vector6::repeat(f64::INFINITY);
        let mut end = end;
        let mut best = far;
        for _ in 0..ITERATIONS {
            let shot = self.follow(task, end.clone(), bumps);
            let shot = shot.ok_or_else(|| not_reached(&best))?;
            if !shot.error.iter().all(|x| x.is_finite()) {
                return Err(not_reached(&best));
            }
            if shot.error.norm() < best.norm() {
                best = shot.error;
            }
            if shot.error.norm() + shot.rates_off < TOLERANCE {
                return Ok(shot);
            }
            // At the end, the tip follows the joints by the generalized Jacobian there, and the rest of the path turns
            // the base little, so that the iteration converges.
            self.workspace.set_positions(&shot.end.q);
            let step = self.resolved(&shot.R_IB, &shot.error, 1e-4);
            let step = step.ok_or_else(|| not_reached(&best))?;
            end = shot.end;
            end.q += shortened(step, LONGEST_STEP);
        }
        Err(not_reached(&best))
    }
}
