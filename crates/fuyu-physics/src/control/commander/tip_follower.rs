//! Joint motion that makes the tip follow a desired motion.

use nalgebra::{DVector, UnitQuaternion};

use super::joint_spline::JointPoint;
use super::pose_path::PathFrame;
use super::tip_resolver::{FreeMotion, TipResolver};
use crate::dynamics::{Momentum, State, Workspace};
use crate::model::Model;
use crate::spatial::{Pose, Twist};

/// Rate at which deviations of the tip decay \[1/s\].
const GAIN: f64 = 10.0;
/// Time constant with which redundant joint motion decays \[s\]: it does not stop at once when another motion starts.
const FADING: f64 = 0.5;

/// The fraction of redundant joint motion that remains after `dt` \[s\].
pub(super) fn faded(dt: f64) -> f64 {
    (-dt / FADING).exp()
}

/// State of the robot's base, as the follower needs it.
#[derive(Debug, Clone, Copy)]
pub struct BaseState {
    /// Pose in the world.
    pub X_WB: Pose,
    /// Momentum of the robot in base axes.
    pub momentum_B: Momentum,
}

impl BaseState {
    /// The base at `state`, whose positions `workspace` must hold.
    pub fn of(state: &State, workspace: &Workspace) -> Self {
        Self {
            X_WB: state.X_WB(workspace),
            momentum_B: state.momentum_W.expressed_in(&state.R_WB),
        }
    }
}

/// Integrates joint rates with which the tip follows a pose and a twist: closed-loop inverse kinematics, `V = V_D + k
/// e` with the pose error `e` (B. Siciliano et al., Robotics, section 3.7). It uses the base's actual pose and
/// momentum, so that the tip stays on a path in the world while the base drifts.
#[derive(Debug, Clone)]
pub struct TipFollower {
    resolver: TipResolver,
    q: DVector<f64>,
    rates: DVector<f64>,
    before: DVector<f64>,
    fading: DVector<f64>,
    limits: DVector<f64>,
}

impl TipFollower {
    /// Starts with the joints' motion `present`.
    ///
    /// # Panics
    /// If `present` does not have one element per joint.
    pub fn new(model: &Model, resolver: TipResolver, present: &[JointPoint]) -> Self {
        assert_eq!(
            present.len(),
            model.dof(),
            "present has one element per joint"
        );
        let n = model.dof();
        Self {
            resolver,
            q: DVector::from_iterator(n, present.iter().map(|p| p.position)),
            rates: DVector::from_iterator(n, present.iter().map(|p| p.rate)),
            before: DVector::zeros(n),
            fading: DVector::zeros(n),
            limits: DVector::from_iterator(n, model.joints().iter().map(|j| j.limits.velocity)),
        }
    }

    /// Pose and twist of the tip in `frame`, in its axes.
    pub fn tip(&mut self, base: &BaseState, frame: PathFrame) -> (Pose, Twist) {
        let X_BE = self.resolver.X_BE(&self.q);
        let V_B = (self.resolver).twist(&self.q, &self.rates, frame, &base.momentum_B);
        match frame {
            PathFrame::Base => (X_BE, V_B),
            PathFrame::World => {
                let R_WB = base.X_WB.rotation;
                let V_W = Twist::new(R_WB * V_B.angular, R_WB * V_B.linear);
                (base.X_WB * X_BE, V_W)
            }
        }
    }

    /// Advances by `dt` \[s\] towards the desired present pose `X_FD` of the tip, with its desired twist `V_F`, both in
    /// `frame` and its axes. Redundant joint motion follows the joint rates `preferred`; without them it comes to rest.
    /// Writes the joints' motion of the step.
    pub fn follow(
        &mut self,
        base: &BaseState,
        frame: PathFrame,
        (X_FD, V_F): (&Pose, &Twist),
        preferred: Option<&DVector<f64>>,
        dt: f64,
        out: &mut [JointPoint],
    ) {
        let (X_FE, _) = self.tip(base, frame);
        let off = X_FD.translation.vector - X_FE.translation.vector;
        let turn = UnitQuaternion::from(X_FD.rotation * X_FE.rotation.inverse()).scaled_axis();
        let gain = GAIN.min(0.5 / dt);
        let V = Twist::new(V_F.angular + turn * gain, V_F.linear + off * gain);
        let V_B = match frame {
            PathFrame::Base => V,
            PathFrame::World => {
                let R_BW = base.X_WB.rotation.inverse();
                Twist::new(R_BW * V.angular, R_BW * V.linear)
            }
        };
        self.before.copy_from(&self.rates);
        self.fading.copy_from(&self.rates);
        self.fading *= faded(dt);
        (self.resolver).rates(
            &self.q,
            frame,
            &base.momentum_B,
            &V_B,
            FreeMotion {
                preferred: preferred.unwrap_or(&self.fading),
                before: &self.before,
                faded: faded(dt),
            },
            &mut self.rates,
        );
        self.limit();
        self.advance(dt, out);
    }

    /// Slows all joints down by the same factor so that none exceeds its rate limit.
    fn limit(&mut self) {
        let parts = self.rates.iter().zip(&self.limits);
        let most = parts
            .map(|(rate, limit)| rate.abs() / limit)
            .fold(1.0, f64::max);
        self.rates /= most;
    }

    /// Advances the positions with the mean of the previous and the present rates.
    fn advance(&mut self, dt: f64, out: &mut [JointPoint]) {
        for (j, point) in out.iter_mut().enumerate() {
            let (before, now) = (self.before[j], self.rates[j]);
            *point = JointPoint {
                position: self.q[j],
                rate: before,
                acceleration: (now - before) / dt,
            };
            self.q[j] += 0.5 * (before + now) * dt;
        }
    }

    /// Advances by `dt` \[s\] with the joint rates that `resolve` writes for the present positions and rates.
    pub(super) fn drive(
        &mut self,
        dt: f64,
        out: &mut [JointPoint],
        resolve: impl FnOnce(&mut TipResolver, &DVector<f64>, &DVector<f64>, &mut DVector<f64>),
    ) {
        self.before.copy_from(&self.rates);
        resolve(&mut self.resolver, &self.q, &self.before, &mut self.rates);
        self.advance(dt, out);
    }

    /// Sets each joint's position and rate to those of `motion`.
    pub(super) fn place(&mut self, motion: impl Fn(usize) -> JointPoint) {
        for j in 0..self.q.len() {
            let point = motion(j);
            (self.q[j], self.rates[j]) = (point.position, point.rate);
        }
    }

    /// Joint positions of the reference \[rad or m\].
    pub fn positions(&self) -> &DVector<f64> {
        &self.q
    }
}
