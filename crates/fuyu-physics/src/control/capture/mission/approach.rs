//! Observe, plan, approach.

use super::grasp::Closing;
use super::{AfterStop, CaptureMission, Phase, Stage};
use crate::control::capture::plan::{Plan, PlanError, Start};
use crate::control::capture::rendezvous::Rendezvous;
use crate::control::capture::{FrameMotion, Objective};

/// Largest deviation of a joint from its reference \[rad or m\].
const LARGEST_DEVIATION: f64 = 0.2;
/// Time between two searches for a plan \[s\].
const SEARCH_PERIOD: f64 = 2.0;
/// Share of the way, from its end, in which the plan is not changed any more.
const FROZEN: f64 = 0.15;
/// Ratio of uncertainty and limit at which an approach is given up.
const GIVEN_UP: f64 = 2.0;
/// Time after the final approach for which the arm must be able to follow the target \[s\].
const GRASPING: f64 = 6.0;
/// Interrupted approaches after which the mission is aborted.
const MOST_INTERRUPTIONS: u32 = 5;
/// Longest time without a plan from where the arm is \[s\].
const PLANLESS: f64 = 5.0;
/// Least cosine of the angle between the approach axis and the line from the robot to the target's centre of mass.
const FACING: f64 = 0.1;

impl CaptureMission {
    /// The grasp frame's motion shifted back along the approach axis by `distance` \[m\].
    pub(super) fn standoff(&self, goal: &FrameMotion, distance: f64) -> FrameMotion {
        let back = self.config.approach_axis.normalize() * -distance;
        let zero = nalgebra::Vector3::zeros();
        goal.with_offset(&back, &zero, &zero)
    }

    /// Why the target counts as lost, if it does.
    pub(super) fn lost(&self, time: f64) -> Option<String> {
        let seen = self.track.newest()?;
        let silence = time - seen;
        (silence > self.config.lost_timeout)
            .then(|| format!("the target has not been seen for {silence:.1} s"))
    }

    /// Why an approach that arrives at `arrival` \[s\] is to be given up because of its prediction, if it is.
    fn too_uncertain(&mut self, arrival: f64) -> Option<String> {
        let reason = self.uncertain(arrival, GIVEN_UP);
        reason.filter(|_| !self.accepts_uncertainty)
    }

    /// Why the prediction for an approach that arrives at `arrival` \[s\] is not good enough; `None` if it is.
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
            return Stage::Plan { next: time };
        }
        let waits = reason.clone();
        self.note =
            waits.unwrap_or_else(|| format!("{:.0} s of observation", self.config.observe_time));
        self.give_up_waiting(time, reason).unwrap_or(Stage::Observe)
    }

    /// Aborts if the approach has not begun in time.
    fn give_up_waiting(&mut self, time: f64, reason: Option<String>) -> Option<Stage> {
        if self.waited <= self.config.observe_timeout {
            return None;
        }
        let reason = (self.lost(time))
            .or(reason)
            .unwrap_or_else(|| "the target has not been observed for long enough".to_owned());
        Some(self.stop(AfterStop::Abort(format!(
            "no approach after {:.0} s of waiting: {reason}",
            self.config.observe_timeout
        ))))
    }

    /// Searches for a plan.
    pub(super) fn search(&mut self, time: f64, next: f64) -> Stage {
        self.track_reference();
        if self.is_paused || time < next {
            return Stage::Plan { next };
        }
        let waited = match self.lost(time) {
            Some(lost) => Err(lost),
            None => self.best_plan(time),
        };
        match waited {
            Ok(plan) => {
                let report = self.report();
                report.set("duration of the approach", plan.arrival - plan.start, "s");
                report.set("planned turn of the base", plan.base_turn, "rad");
                report.set(
                    "planned clearance of the target",
                    plan.distances.keep_out,
                    "m",
                );
                self.enter(time, Phase::Approach, "a rendezvous is planned");
                Stage::Approach {
                    plan: Box::new(plan),
                    planned: time,
                }
            }
            Err(reason) => {
                let next = time + SEARCH_PERIOD;
                self.note.clone_from(&reason);
                self.give_up_waiting(time, Some(reason))
                    .unwrap_or(Stage::Plan { next })
            }
        }
    }

    fn start(&self, time: f64) -> Start {
        let mut state = self.own.state().clone();
        state.time = time;
        Start {
            state,
            joints: self.reference.clone(),
        }
    }

    /// Whether the chosen grasp frame is approached from the side of the robot at `time` \[s\].
    fn is_facing(&self, time: f64) -> bool {
        let (Some(goal), Some(center)) = (self.goal(time), self.track.center(time)) else {
            return true;
        };
        let axis = goal.X.rotation * self.config.approach_axis.normalize();
        axis.dot(&center.normalize()) > FACING
    }

    /// The best of the plans with the configured durations and grasp frames.
    fn best_plan(&mut self, time: f64) -> Result<Plan, String> {
        let start = self.start(time);
        let mut best: Option<(Plan, usize)> = None;
        let mut failure = String::new();
        let mut times = self.config.approach_times.clone();
        times.sort_by(f64::total_cmp);
        for duration in times {
            let arrival = time + duration;
            for grasp in 0..self.config.grasps.len() {
                self.choose(grasp);
                // The limits held when observation ended, or were skipped.
                if let Some(reason) = self.too_uncertain(arrival) {
                    failure = reason;
                    continue;
                }
                if !self.is_facing(arrival) {
                    if failure.is_empty() {
                        failure = "no grasp frame faces the robot".to_owned();
                    }
                    continue;
                }
                match self.plan_to(&start, arrival, None) {
                    Ok(plan) => {
                        let is_better =
                            |(b, _): &(Plan, usize)| plan.base_turn.abs() < b.base_turn.abs();
                        if best.as_ref().is_none_or(is_better) {
                            best = Some((plan, grasp));
                        }
                    }
                    Err(e) => failure = format!("in {duration} s: {e}"),
                }
            }
            if best.is_some() && self.config.objective == Objective::Time {
                break;
            }
        }
        let (plan, grasp) = best.ok_or(failure)?;
        self.choose(grasp);
        self.report().set("grasp frame", grasp as f64, "");
        Ok(plan)
    }

    fn plan_to(
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

    /// Where the tip is to be after the arrival, second by second: on the final approach, and while it grasps.
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

    /// Stops an approach that cannot go on, and plans again; not too often.
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
                // It goes on by the last plan; the final approach makes up for a small error.
                Err(_) => {}
            }
        }
        Stage::Approach { plan, planned }
    }
}
