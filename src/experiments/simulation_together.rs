//! Simultaneous simulation of several runs in one thread: the integration steps of their plants are computed in SIMD
//! lanes.

use super::{
    Figures, Fleet,
    simulation::{Observed, Stop, answer, is_over},
};
use crate::{dynamics::SimdGroup, nodes::dynamics::EffortTick, vision::PoseFrame};

/// One of the runs.
struct Run<'a> {
    fleet: &'a mut Fleet,
    duration: f64,
    observed: Vec<Observed>,
    /// Its outcome, once it has ended.
    end: Option<Result<(), Stop>>,
    /// The effort tick in progress, whose steps are computed together with others.
    tick: Option<EffortTick>,
    /// Whether its robot can be stepped together with others.
    fits: bool,
}

impl Run<'_> {
    fn is_running(&self) -> bool {
        self.end.is_none()
    }

    /// Answers the current state, and ends the run if it is the last one.
    fn answer(
        &mut self,
        frames: &mut Vec<PoseFrame>,
        watch: impl FnOnce(&Fleet, &[Observed]) -> Result<(), Stop>,
    ) {
        let answered = answer(self.fleet, &mut self.observed, frames, None);
        let seen = answered.and_then(|()| watch(self.fleet, &self.observed));
        match seen {
            Ok(()) if !is_over(self.fleet, self.duration) => {}
            end => self.end = Some(end),
        }
    }

    /// Begins a held tick, or computes the next tick at once.
    fn begin_tick(&mut self) {
        let robot = self.fleet.only_robot().filter(|_| self.fits);
        self.tick = robot.and_then(|robot| robot.world.begin_effort_tick());
        if self.tick.is_none()
            && let Err(problem) = self.fleet.advance()
        {
            self.end = Some(Err(problem.into()));
        }
    }

    /// Ends a held tick.
    fn finish_tick(&mut self) {
        if self.tick.take().is_none() {
            return;
        }
        if let Some(robot) = self.fleet.only_robot() {
            robot.world.finish_effort_tick();
            if let Err(problem) = robot.check() {
                self.end = Some(Err(problem.into()));
            }
        }
    }
}

/// Simulates each fleet up to and including its duration \[s\], with the same results as
/// [`simulate`](super::simulation::simulate), bit by bit. Of the expensive figures, only `figures` are computed.
/// `watch` is called with the number of a run and each of its states.
pub fn simulate_together(
    fleets: &mut [(Fleet, f64)],
    figures: Figures,
    mut watch: impl FnMut(usize, &Fleet, &[Observed]) -> Result<(), Stop>,
) -> Vec<Result<Vec<Observed>, Stop>> {
    let mut lanes = None;
    let runs = fleets.iter_mut().map(|(fleet, duration)| Run {
        observed: Observed::all(fleet, figures),
        duration: *duration,
        end: None,
        tick: None,
        fits: fits(&mut lanes, fleet),
        fleet,
    });
    let mut runs: Vec<_> = runs.collect();
    let mut frames = Vec::new();
    while runs.iter().any(Run::is_running) {
        for (i, run) in runs.iter_mut().enumerate().filter(|(_, r)| r.is_running()) {
            run.answer(&mut frames, |fleet, observed| watch(i, fleet, observed));
        }
        for run in runs.iter_mut().filter(|run| run.is_running()) {
            run.begin_tick();
        }
        step_together(&mut lanes, &mut runs);
        runs.iter_mut().for_each(Run::finish_tick);
    }
    let ends = runs.into_iter().map(|run| {
        let end = run.end.unwrap_or(Ok(()));
        end.map(|()| run.observed)
    });
    ends.collect()
}

/// Whether the robot of `fleet` can be stepped in `lanes`, which are created for the first suitable robot.
fn fits(lanes: &mut Option<SimdGroup>, fleet: &mut Fleet) -> bool {
    let Some(robot) = fleet.only_robot() else {
        return false;
    };
    let Some(robot) = robot.world.effort_tick_robot() else {
        return false;
    };
    if lanes.is_none() {
        *lanes = SimdGroup::new(robot);
    }
    (lanes.as_ref()).is_some_and(|lanes| lanes.fits(robot))
}

/// Computes the steps of all held ticks in progress.
fn step_together(lanes: &mut Option<SimdGroup>, runs: &mut [Run]) {
    let Some(lanes) = lanes else { return };
    let mut rest: Vec<_> = runs
        .iter_mut()
        .filter_map(|run| {
            let tick = run.tick?;
            Some((tick, run.fleet.only_robot()?.world.effort_tick_robot()?))
        })
        .collect();
    // Almost always all runs have the same steps.
    while let Some((first, _)) = rest.first() {
        let first = *first;
        let (same, others): (Vec<_>, Vec<_>) =
            (rest.into_iter()).partition(|(tick, _)| *tick == first);
        let mut robots: Vec<_> = same.into_iter().map(|(_, robot)| robot).collect();
        lanes.step(&mut robots, first.dt, first.steps);
        rest = others;
    }
}
