//! The phases observe and approach.

use super::grasp::Closing;
use super::search::Search;
use super::{AfterStop, CaptureMission, Phase, Stage};
use crate::control::capture::FrameMotion;
use crate::control::capture::plan::{Plan, PlanError, Start};
use crate::control::capture::rendezvous::Rendezvous;

/// Largest deviation of a joint from its reference \[rad or m\].
const LARGEST_DEVIATION: f64 = 0.2;
/// Final fraction of the approach in which the plan is frozen.
const FROZEN: f64 = 0.15;
/// Ratio of uncertainty to limit at which an approach is given up.
const GIVEN_UP: f64 = 2.0;
/// Time after the final approach for which the arm must be able to follow the target \[s\].
const GRASPING: f64 = 6.0;
/// Number of interrupted approaches after which the mission is aborted.
const MOST_INTERRUPTIONS: u32 = 5;
/// Longest time without a feasible plan from the present position \[s\].
const PLANLESS: f64 = 5.0;

impl CaptureMission {
    /// The grasp frame's motion shifted back along the approach axis by `distance` \[m\].
    pub(super) fn standoff(&self, goal: &FrameMotion, distance: f64) -> FrameMotion {
        let back = self.config.approach_axis.normalize() * -distance;
        let zero = nalgebra::Vector3::zeros();
        goal.with_offset(&back, &zero, &zero)
    }

    /// The reason why the target is lost, if it is.
    pub(super) fn lost(&self, time: f64) -> Option<String> {
        let seen = self.track.newest()?;
        let silence = time - seen;
        (silence > self.config.lost_timeout)
            .then(|| format!("the target has not been seen for {silence:.1} s"))
    }

    /// The reason to give up an approach that arrives at `arrival` \[s\] because its prediction is too uncertain, if
    /// there is one.
    pub(super) fn too_uncertain(&mut self, arrival: f64) -> Option<String> {
        let reason = self.uncertain(arrival, GIVEN_UP);
        reason.filter(|_| !self.accepts_uncertainty)
    }

    /// The reason why the prediction for an approach that arrives at `arrival` \[s\] is not accurate enough; `None` if
    /// it is.
    fn uncertain(&mut self, arrival: f64, factor: f64) -> Option<String> {
        let until = arrival + self.config.final_time + GRASPING;
        let Some(sd) = self
            .track
            .uncertainty(until, &self.X_GK().translation.vector)
        else {
            return Some("the target's motion is not estimated yet".to_owned());
        };
        let report = self.report();
        report.set("predicted position sd", sd.position, "m");
        report.set("predicted attitude sd", sd.attitude, "rad");
        let (p, a) = (self.config.position_limit, self.config.attitude_limit);
        if sd.position > factor * p {
            return Some(format!(
                "the grasp frame's position would be known to {:.4} m only, the limit is {p} m",
                sd.position
            ));
        }
        (sd.attitude > factor * a).then(|| {
            format!(
                "the grasp frame's attitude would be known to {:.4} rad only, the limit is {a} rad",
                sd.attitude
            )
        })
    }

    pub(super) fn observe(&mut self, time: f64) -> Stage {
        self.track_reference();
        if self.is_paused {
            return Stage::Observe;
        }
        let shortest = self.config.approach_times.iter().copied();
        let shortest = shortest.fold(f64::INFINITY, f64::min);
        let reason = self.uncertain(time + shortest, 1.0);
        let is_known = self.track.at(time + shortest).is_some();
        let is_long = self.track.span() >= self.config.observe_time;
        if is_known && (self.skips || (reason.is_none() && is_long)) {
            let span = self.track.span();
            let samples = self.track.samples() as f64;
            let report = self.report();
            report.set("time of observation", span, "s");
            report.set("measured poses", samples, "");
            self.accepts_uncertainty = self.skips;
            let outcome = match self.skips {
                true => "skipped by the operator",
                false => "the prediction is good enough",
            };
            self.enter(time, Phase::Plan, outcome);
            return Stage::Plan(Box::new(Search::at(time)));
        }
        let waits = reason.clone();
        self.note =
            waits.unwrap_or_else(|| format!("{:.0} s of observation", self.config.observe_time));
        match self.waited <= self.config.observe_timeout {
            true => Stage::Observe,
            false => self.give_up_waiting(time, reason),
        }
    }

    pub(super) fn plan_to(
        &mut self,
        start: &Start,
        arrival: f64,
        earlier: Option<&Plan>,
    ) -> Result<Plan, PlanError> {
        let goal = self.goal(arrival).ok_or(PlanError::Unknown(arrival))?;
        let goal = self.standoff(&goal, self.config.standoff);
        let centers = (
            self.track.center(start.state.time),
            self.track.center(arrival),
        );
        let task = Rendezvous {
            start,
            arrival,
            goal: &goal,
            center: centers.0.zip(centers.1),
        };
        match earlier {
            Some(earlier) => self.planner.replan(&task, earlier),
            None => {
                let plan = self.planner.plan(&task)?;
                let later = self.later_goals(arrival)?;
                self.planner.check_following(&plan, &later)?;
                Ok(plan)
            }
        }
    }

    /// Goals of the tip after the arrival, one per second: on the final approach, and during the grasp.
    fn later_goals(&self, arrival: f64) -> Result<Vec<(f64, FrameMotion)>, PlanError> {
        let (final_time, standoff) = (self.config.final_time, self.config.standoff);
        let count = (final_time + GRASPING).ceil() as u32;
        let at = |k: u32| {
            let after = f64::from(k);
            let time = arrival + after;
            let goal = self.goal(time).ok_or(PlanError::Unknown(time))?;
            let left = standoff * (1.0 - after / final_time).max(0.0);
            Ok((time, self.standoff(&goal, left)))
        };
        (1..=count).map(at).collect()
    }

    /// Interrupts an approach that cannot continue, and plans again; aborts after too many interruptions.
    fn interrupt(&mut self, reason: String) -> Stage {
        self.interruptions += 1;
        self.stop(match self.interruptions < MOST_INTERRUPTIONS {
            true => AfterStop::Plan(reason),
            false => AfterStop::Abort(format!(
                "the approach was interrupted {MOST_INTERRUPTIONS} times: {reason}"
            )),
        })
    }

    pub(super) fn approach(&mut self, time: f64, plan: Box<Plan>, planned: f64) -> Stage {
        let mut plan = plan;
        let mut planned = planned;
        for j in 0..self.reference.len() {
            self.reference[j] = plan.at(j, time);
        }
        self.track_reference();
        let (joint, off) = self.deviation();
        self.report().raise("largest joint deviation", off, "rad");
        if off > LARGEST_DEVIATION {
            let name = &self.model.joints()[joint].name;
            let reason = format!("joint '{name}' is {off:.3} off its reference");
            self.hold_here();
            return self.stop(AfterStop::Abort(reason));
        }
        if self.is_paused {
            self.waited = 0.0;
            return self.stop(AfterStop::Plan("paused by the operator".to_owned()));
        }
        if let Some(reason) = self.lost(time) {
            return self.stop(AfterStop::Abort(reason));
        }
        if let Some(reason) = self.too_uncertain(plan.arrival) {
            return self.interrupt(reason);
        }
        if time >= plan.arrival - 1e-9 {
            let turn = self.own.state().R_WB.angle_to(&plan.R_IB);
            self.report().set("base attitude off the plan", turn, "rad");
            self.enter(
                time,
                Phase::Grasp,
                "the tip is at its distance and moves with the target",
            );
            self.attempt = 1;
            return Stage::Close(Closing::begin(&self.config, time, self.config.standoff));
        }
        let left = (plan.arrival - time) / (plan.arrival - plan.start);
        let is_due = time >= planned + self.config.replan_period;
        let way = plan.arrival - time;
        if is_due && left > FROZEN && way > 2.0 {
            let start = self.start(time);
            match self.plan_to(&start, plan.arrival, Some(&plan)) {
                Ok(next) => {
                    *plan = next;
                    planned = time;
                    let count = self.report().figure("plans").unwrap_or(1.0) + 1.0;
                    self.report().set("plans", count, "");
                }
                Err(e) if time > planned + PLANLESS => return self.interrupt(e.to_string()),
                // Continue with the last plan; the final approach corrects a small error.
                Err(_) => {}
            }
        }
        Stage::Approach { plan, planned }
    }
}
