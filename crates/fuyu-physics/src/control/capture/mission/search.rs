//! The search for a rendezvous: one candidate in each step, so that no step takes long.

use std::collections::VecDeque;

use super::{AfterStop, CaptureMission, Phase, Stage};
use crate::control::capture::Objective;
use crate::control::capture::plan::{Plan, Start};

/// Time between two searches for a plan \[s\].
const SEARCH_PERIOD: f64 = 2.0;
/// Least cosine of the angle between the approach axis and the line from the robot to the target's centre of mass.
const FACING: f64 = 0.1;

/// A search over all durations of the approach and all grasp frames, shortest duration first.
#[derive(Debug, Clone)]
pub(in crate::control::capture) struct Search {
    /// Time at which it starts \[s\].
    begin: f64,
    /// Remaining candidates: duration \[s\] and index of the grasp frame; `None` before the start.
    left: Option<VecDeque<(f64, usize)>>,
    /// The best plan, with the index of its grasp frame and its duration.
    best: Option<(Plan, usize, f64)>,
    /// Why the last candidate failed.
    failure: String,
}

impl Search {
    /// A search that starts at `time` \[s\].
    pub fn at(time: f64) -> Self {
        Self {
            begin: time,
            left: None,
            best: None,
            failure: String::new(),
        }
    }
}

impl CaptureMission {
    /// Tries the next candidate, and starts the approach after the last one.
    pub(super) fn search(&mut self, time: f64, mut search: Box<Search>) -> Stage {
        self.track_reference();
        if self.is_paused || time < search.begin {
            return Stage::Plan(search);
        }
        if let Some(lost) = self.lost(time) {
            return self.search_again(time, lost);
        }
        let all = || self.candidates();
        let left = search.left.get_or_insert_with(all);
        if let Some((duration, grasp)) = left.pop_front() {
            let is_late = |(_, _, of_best): &(Plan, usize, f64)| duration > *of_best + 1e-9;
            let is_decided = self.config.objective == Objective::Time
                && search.best.as_ref().is_some_and(is_late);
            if !is_decided {
                match self.candidate(time, duration, grasp) {
                    Ok(plan) => {
                        let impact = self.config.objective == Objective::Impact;
                        let cost = |plan: &Plan| match impact {
                            true => plan.effective_mass,
                            false => plan.base_turn.abs(),
                        };
                        let is_better = |(b, ..): &(Plan, usize, f64)| cost(&plan) < cost(b);
                        if search.best.as_ref().is_none_or(is_better) {
                            search.best = Some((plan, grasp, duration));
                        }
                    }
                    Err(reason) => search.failure = reason,
                }
                return Stage::Plan(search);
            }
        }
        let Some((plan, grasp, _)) = search.best else {
            return self.search_again(time, search.failure);
        };
        self.choose(grasp);
        // Time has passed since that candidate was tried.
        match self.plan_to(&self.start(time), plan.arrival, Some(&plan)) {
            Ok(plan) => self.begin_approach(time, plan),
            Err(e) => self.search_again(time, e.to_string()),
        }
    }

    fn candidates(&self) -> VecDeque<(f64, usize)> {
        let mut times = self.config.approach_times.clone();
        times.sort_by(f64::total_cmp);
        let grasps = 0..self.config.grasps.len();
        let of = |duration: f64| grasps.clone().map(move |grasp| (duration, grasp));
        times.into_iter().flat_map(of).collect()
    }

    /// A plan with a duration \[s\] and a grasp frame, or the reason why there is none.
    fn candidate(&mut self, time: f64, duration: f64, grasp: usize) -> Result<Plan, String> {
        let arrival = time + duration;
        self.choose(grasp);
        // The limits were met at the end of observation, or were skipped.
        if let Some(reason) = self.too_uncertain(arrival) {
            return Err(reason);
        }
        if !self.is_facing(arrival) {
            return Err("no grasp frame faces the robot".to_owned());
        }
        self.plan_to(&self.start(time), arrival, None)
            .map_err(|e| format!("in {duration} s: {e}"))
    }

    fn begin_approach(&mut self, time: f64, plan: Plan) -> Stage {
        let grasp = self.grasp;
        let report = self.report();
        report.set("grasp frame", grasp as f64, "");
        report.set("duration of the approach", plan.arrival - plan.start, "s");
        report.set("planned turn of the base", plan.base_turn, "rad");
        report.set("planned effective mass", plan.effective_mass, "kg");
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

    /// Searches again later, unless the mission has waited for too long.
    fn search_again(&mut self, time: f64, reason: String) -> Stage {
        self.note.clone_from(&reason);
        if self.waited <= self.config.observe_timeout {
            return Stage::Plan(Box::new(Search::at(time + SEARCH_PERIOD)));
        }
        self.give_up_waiting(time, Some(reason))
    }

    /// Aborts because the approach has not started in time.
    pub(super) fn give_up_waiting(&mut self, time: f64, reason: Option<String>) -> Stage {
        let reason = (self.lost(time))
            .or(reason)
            .unwrap_or_else(|| "the target has not been observed for long enough".to_owned());
        self.stop(AfterStop::Abort(format!(
            "no approach after {:.0} s of waiting: {reason}",
            self.config.observe_timeout
        )))
    }

    pub(super) fn start(&self, time: f64) -> Start {
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
}
