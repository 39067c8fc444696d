//! Joint references, and stopping of the joints.

use super::search::Search;
use super::{AfterStop, CaptureMission, Phase, Stage};
use crate::control::capture::inertial_state;
use crate::control::commander::{JointDuty, JointPoint, JointSpline};

impl CaptureMission {
    /// Measured joint positions and rates.
    pub(super) fn measured(&self) -> Vec<JointPoint> {
        let state = self.own.state();
        let joints = state.q.iter().zip(state.qd.iter());
        let point = |(q, qd): (&f64, &f64)| JointPoint {
            position: *q,
            rate: *qd,
            acceleration: 0.0,
        };
        joints.map(point).collect()
    }

    /// Sets the reference to the present joint positions, at rest.
    pub(super) fn hold_here(&mut self) {
        self.reference = self.measured();
        for point in &mut self.reference {
            point.rate = 0.0;
        }
    }

    /// Stops the joints from their reference, or from the measured motion without a reference; `then` follows.
    pub(super) fn stop(&mut self, then: AfterStop) -> Stage {
        let time = self.own.state().time;
        let spline = JointSpline::stop(&self.model, time, &self.reference);
        Stage::Stop(Box::new(spline), then)
    }

    pub(super) fn come_to_rest(
        &mut self,
        time: f64,
        spline: Box<JointSpline>,
        then: AfterStop,
    ) -> Stage {
        for j in 0..self.reference.len() {
            self.reference[j] = spline.at(j, time);
        }
        self.track_reference();
        if time < spline.end() {
            return Stage::Stop(spline, then);
        }
        match then {
            AfterStop::Plan(reason) => {
                if self.phase() != Phase::Plan {
                    let outcome = format!("interrupted, it plans again: {reason}");
                    self.enter(time, Phase::Plan, &outcome);
                }
                Stage::Plan(Box::new(Search::at(time)))
            }
            AfterStop::Abort(reason) => {
                self.enter(time, Phase::Aborted, &reason);
                Stage::Rest
            }
        }
    }

    /// Computes efforts that make the joints follow the reference, including the held target.
    pub(super) fn track_reference(&mut self) {
        let duties = vec![JointDuty::Track; self.reference.len()];
        let own = self.own.state();
        let efforts = match &mut self.held {
            Some(held) => {
                let attitude = (own.R_WB, self.own.w_IB_B());
                let state =
                    inertial_state(&mut held.workspace, own.time, attitude, (&own.q, &own.qd));
                held.servo.efforts(&state, &duties, &self.reference)
            }
            None => self.servo.efforts(own, &duties, &self.reference),
        };
        self.efforts.copy_from(efforts);
    }

    /// Largest deviation of a joint from its reference, with the joint's index.
    pub(super) fn deviation(&self) -> (usize, f64) {
        let q = self.own.state().q.iter().zip(&self.reference);
        let off = q.map(|(q, point)| (q - point.position).abs());
        off.enumerate()
            .fold((0, 0.0), |largest, (j, off)| match off > largest.1 {
                true => (j, off),
                false => largest,
            })
    }
}
