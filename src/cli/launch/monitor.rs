//! The node `launch_monitor`: observes a run on its topics, for progress line and summary.

use std::{
    collections::BTreeMap,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use crate::{
    experiments::{recorded_mission, simulation::AFTER_MISSIONS},
    msg::{
        fuyu_msgs::{ControllerState, MissionState},
        rosgraph_msgs::Clock,
    },
    nodes::{controller::measured_errors, topics},
    ros::{Node, NodeError, Qos, Subscription, Time},
};

/// Period at which the topics are checked.
const PERIOD: Duration = Duration::from_millis(50);

/// State of the run, shared with the launch.
#[derive(Debug, Default)]
pub struct Progress {
    over: AtomicBool,
    seen: Mutex<Seen>,
}

/// State of the run as observed on its topics.
#[derive(Debug, Default, Clone)]
pub struct Seen {
    /// First simulated time observed, and the wall time at that moment.
    pub start: Option<(f64, Instant)>,
    /// Last simulated time observed, and the wall time at that moment.
    pub last: Option<(f64, Instant)>,
    /// Last position and attitude error of each tip \[m, rad\], by the namespace that the scenario gives its controller.
    pub errors: BTreeMap<String, (f64, f64)>,
}

impl Progress {
    fn see(&self, change: impl FnOnce(&mut Seen)) {
        change(&mut self.seen.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Whether the run's duration is over.
    pub fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }

    /// The observations so far.
    pub fn seen(&self) -> Seen {
        self.seen
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }
}

/// Namespace of a node that the monitor observes.
#[derive(Debug, Clone)]
pub struct Observed {
    /// The namespace given by the scenario.
    pub planned: String,
    /// The namespace after remapping (`__ns:=/NAMESPACE`).
    pub actual: String,
}

impl Observed {
    fn topic(&self, name: &str) -> String {
        format!("{}/{name}", self.actual.trim_end_matches('/'))
    }
}

/// The node's program. Subscribes to `/clock`, to `controller/state` of the `controllers`, to `mission/state` of the
/// `missions`, and to the odometry of `robots`, the dynamics nodes of several robots. Ends when the duration is over
/// for all robots, or [`AFTER_MISSIONS`] after the end of all missions.
///
/// # Errors
/// When DDS fails.
pub fn program(
    node: &Node,
    duration: f64,
    robots: &[Observed],
    (controllers, missions): (&[Observed], &[Observed]),
    progress: &Progress,
) -> Result<(), NodeError> {
    let is_end = |time: f64| duration > 0.0 && time >= duration - 1e-9;
    let robots = robots.iter().map(|robot| {
        let base = robot.topic(topics::BASE);
        Ok((topics::TARGET_ODOMETRY.subscribe(node, &base)?, 0.0))
    });
    let mut robots: Vec<_> = robots.collect::<Result<_, NodeError>>()?;
    let clock = node.subscribe::<Clock>(topics::CLOCK.name, Qos::CLOCK_SUBSCRIPTION)?;
    let states = controllers.iter().map(|controller| {
        let state = topics::CONTROLLER_STATE;
        let topic = controller.topic(state.name);
        Ok((&controller.planned, node.subscribe(&topic, state.qos)?))
    });
    let states: Vec<(_, Subscription<ControllerState>)> =
        states.collect::<Result<_, NodeError>>()?;
    let missions = missions.iter().map(|mission| {
        let state = topics::MISSION_STATE;
        let topic = mission.topic(state.name);
        Ok((node.subscribe(&topic, state.qos)?, None))
    });
    let mut missions: Vec<(Subscription<MissionState>, Option<f64>)> =
        missions.collect::<Result<_, NodeError>>()?;
    let mut now = 0.0;
    while node.ok() {
        for (odometry, time) in &mut robots {
            if let Some(received) = odometry.latest() {
                *time = Time::from(&received.message.header.stamp).as_secs_f64();
            }
        }
        for (namespace, state) in &states {
            if let Some(received) = state.latest()
                && let Some(errors) = measured_errors(&received.message)
            {
                progress.see(|seen| {
                    seen.errors.insert((*namespace).clone(), errors);
                });
            }
        }
        for (state, end) in &mut missions {
            if let Some(received) = state.latest() {
                let start = received.message.phase_start.last().copied();
                *end = start.filter(|_| recorded_mission::is_over(&received.message));
            }
        }
        if let Some(received) = clock.latest() {
            let time = Time::from(received.message.clock).as_secs_f64();
            // Age since arrival, bounded: the wall clock may be set meanwhile.
            let age = Time::wall().since(received.received_time).min(PERIOD);
            let at = Instant::now().checked_sub(age).unwrap_or_else(Instant::now);
            progress.see(|seen| {
                // Time held at the start does not count.
                if time > 0.0 && seen.last.is_none_or(|(last, _)| time > last) {
                    seen.start.get_or_insert((time, at));
                    seen.last = Some((time, at));
                }
            });
            now = time;
        }
        let is_after =
            |(_, end): &(_, Option<f64>)| end.is_some_and(|end| now >= end + AFTER_MISSIONS);
        let has_captured = !missions.is_empty() && missions.iter().all(is_after);
        if has_captured || is_end(now) && robots.iter().all(|(_, time)| is_end(*time)) {
            progress.over.store(true, Ordering::Release);
            return Ok(());
        }
        // Waiting for messages would wake this thread for each of them.
        std::thread::sleep(PERIOD);
    }
    Ok(())
}
