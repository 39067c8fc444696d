//! Postures of the arm at the rendezvous, from which shooting starts.

use nalgebra::{DVector, UnitQuaternion, Vector6};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::frame_motion::FrameMotion;
use super::rendezvous::{Rendezvous, RendezvousPlanner};
use super::shooting::{End, LONGEST_STEP};
use crate::control::damped_descent::shortened;

/// Postures from which the search starts, in addition to the present one.
const POSTURES: usize = 24;
/// Iterations of the search for a posture.
const DESCENT: usize = 150;

impl RendezvousPlanner {
    /// Postures of the arm at the arrival, with the base at its pose at the start: initial guesses for shooting.
    pub(super) fn postures(&mut self, task: &Rendezvous) -> Vec<End> {
        let n = self.model.dof();
        let now = DVector::from_fn(n, |j, _| task.start.joints[j].position);
        let mut random = StdRng::seed_from_u64(1);
        let mut found: Vec<DVector<f64>> = Vec::new();
        for attempt in 0..=POSTURES {
            let mut q = now.clone();
            if attempt > 0 {
                for (j, joint) in self.model.joints().iter().enumerate() {
                    let around = if attempt % 2 == 0 { 1.0 } else { 2.5 };
                    let lower = joint.limits.lower.max(now[j] - around);
                    let upper = joint.limits.upper.min(now[j] + around);
                    q[j] = lower + (upper - lower) * random.random_range(0.0..1.0);
                }
            }
            if self.descend(&task.start.state.R_WB, task.goal, &mut q) {
                self.unwind(&now, &mut q);
                let is_new = |other: &DVector<f64>| (other - &q).amax() > 0.05;
                if found.iter().all(is_new) {
                    found.push(q);
                }
            }
        }
        let nearest = |q: &DVector<f64>| (q - &now).norm();
        found.sort_by(|a, b| nearest(a).total_cmp(&nearest(b)));
        found.truncate(4);
        let end = |q| End {
            q,
            qd: DVector::zeros(n),
            qdd: DVector::zeros(n),
        };
        found.into_iter().map(end).collect()
    }

    /// Moves joints without limits to the nearer equivalent angle.
    fn unwind(&self, now: &DVector<f64>, q: &mut DVector<f64>) {
        use std::f64::consts::TAU;
        for (j, joint) in self.model.joints().iter().enumerate() {
            let limits = &joint.limits;
            let is_free = limits.lower.is_infinite() && limits.upper.is_infinite();
            if is_free && joint.kind.is_rotational() {
                q[j] -= TAU * ((q[j] - now[j]) / TAU).round();
            }
        }
    }

    /// Damped least squares on the tip's pose, from joint positions `q`.
    pub(super) fn descend(
        &mut self,
        R_IB: &UnitQuaternion<f64>,
        goal: &FrameMotion,
        q: &mut DVector<f64>,
    ) -> bool {
        for _ in 0..DESCENT {
            self.workspace.set_positions(q);
            let error = self.pose_error(R_IB, goal);
            let size = error.norm();
            if size < 1e-3 {
                return true;
            }
            // On a nearly straight path; strongly damped far from the goal.
            let error = error * (LONGEST_STEP / size).min(1.0);
            let Some(step) = self.resolved(R_IB, &error, 0.1 * size.min(1.0)) else {
                return false;
            };
            *q += shortened(step, LONGEST_STEP);
            for (j, joint) in self.model.joints().iter().enumerate() {
                q[j] = q[j].clamp(joint.limits.lower, joint.limits.upper);
            }
        }
        false
    }

    /// Position error and rotation vector from the tip to the goal, axes of I, at the positions of the workspace.
    pub(super) fn pose_error(
        &self,
        R_IB: &UnitQuaternion<f64>,
        goal: &FrameMotion,
    ) -> Vector6<f64> {
        let X_IE = self.X_IE(R_IB);
        let p = goal.X.translation.vector - X_IE.translation.vector;
        let turn = UnitQuaternion::from(goal.X.rotation * X_IE.rotation.inverse()).scaled_axis();
        Vector6::new(p.x, p.y, p.z, turn.x, turn.y, turn.z)
    }
}
