//! Events of a simulation that its final state does not show: stops reached, saturated wheels, latches, contacts.

use serde::Serialize;

use crate::{
    dynamics::flexible::{FlexibleFloating, Wheel},
    model::Joint,
    nodes::dynamics::World,
};

/// Distance from a stop within which a joint counts as at the stop \[rad or m\].
const AT_STOP: f64 = 1e-9;

/// Fraction of a speed or torque limit within which a joint or wheel counts as at the limit.
const AT_LIMIT: f64 = 1e-6;

/// Maximum number of events kept.
const MOST: usize = 10_000;

/// An event.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Event {
    /// Time of the first published state that shows it \[s\].
    pub time: f64,
    /// Description.
    pub what: String,
}

/// Finds events in the states of a run: joints that reach stops or speed limits, wheels that reach speed or torque
/// limits, deformation beyond the range of first-order modes, grasps that latch or open, links that begin or end to
/// touch.
#[derive(Debug, Default)]
pub struct EventWatch {
    events: Vec<Event>,
    /// Conditions that hold now and were reported when they began.
    present: Vec<String>,
    /// Time at which deformation first exceeded the range of first-order modes, and a line on it.
    excess: Option<(f64, String)>,
    /// The joints at the previous state.
    earlier: Joints,
    /// Numbers of grasp and contact events reported so far.
    reported: [usize; 2],
}

/// Time, positions and rates of joints.
#[derive(Debug, Default)]
struct Joints {
    time: f64,
    q: Vec<f64>,
    qd: Vec<f64>,
}

impl Joints {
    /// Position that joint `j` would have after `seconds` at its rate, if it has lost at least half of this rate
    /// meanwhile: it may have hit a stop and left it again.
    fn reach(&self, j: usize, rate_now: f64, seconds: f64) -> Option<f64> {
        let (q, rate) = (self.q.get(j)?, self.qd.get(j)?);
        let is_braked = rate_now * rate.signum() < 0.5 * rate.abs();
        is_braked.then_some(q + rate * seconds)
    }
}

impl EventWatch {
    /// Adds the current state of `world`.
    pub fn see(&mut self, world: &World) {
        let mut now = Vec::new();
        let state = world.robot.state();
        let seconds = world.time() - self.earlier.time;
        for (j, joint) in world.robot.model().joints().iter().enumerate() {
            let (q, qd) = (state.q[j], state.qd[j]);
            // In case of contact, other bodies may brake joints, too.
            let reach = match world.has_contact() {
                true => None,
                false => self.earlier.reach(j, qd, seconds),
            };
            let reach = reach.unwrap_or(q);
            now.extend(of_joint(joint, q, reach, qd));
        }
        self.earlier.time = world.time();
        self.earlier.q.clear();
        self.earlier.q.extend(state.q.iter());
        self.earlier.qd.clear();
        self.earlier.qd.extend(state.qd.iter());
        if let Some(robot) = world.robot.flexible() {
            of_wheels(robot, &mut now);
            self.see_deformation(world.time(), robot, &mut now);
        }
        let sources = [world.grasp_events(), world.contact_events()];
        let new = sources.iter().zip(self.reported);
        let mut new: Vec<_> = new.flat_map(|(all, seen)| all.iter().skip(seen)).collect();
        new.sort_by(|a, b| a.time.total_cmp(&b.time));
        for event in new {
            if self.events.len() < MOST {
                self.events.push(Event {
                    time: event.time,
                    what: event.what.clone(),
                });
            }
        }
        self.reported = sources.map(<[_]>::len);
        for what in &now {
            if !self.present.contains(what) && self.events.len() < MOST {
                self.events.push(Event {
                    time: world.time(),
                    what: what.clone(),
                });
            }
        }
        self.present = now;
    }

    /// Adds a condition if deformation is beyond the range of first-order modes.
    fn see_deformation(&mut self, time: f64, robot: &FlexibleFloating, now: &mut Vec<String>) {
        let Some(excess) = robot.workspace().first_order_excess(robot.state()) else {
            return;
        };
        let (name, quantity, limit) = (excess.name, excess.quantity, excess.limit);
        now.push(format!(
            "{name} {} {limit:.4} {}, up to which first-order modes suffice",
            quantity.beyond(),
            quantity.unit()
        ));
        (self.excess).get_or_insert_with(|| (time, excess.to_string()));
    }

    /// Time at which deformation first exceeded the range of first-order modes \[s\], and a line on it.
    pub fn deformation_excess(&self) -> Option<&(f64, String)> {
        self.excess.as_ref()
    }

    /// The events so far.
    pub fn events(&self) -> &[Event] {
        &self.events
    }
}

fn of_joint(joint: &Joint, q: f64, reach: f64, qd: f64) -> Option<String> {
    let (name, limits) = (&joint.name, &joint.limits);
    let unit = match joint.kind.is_rotational() {
        true => "rad",
        false => "m",
    };
    if q.min(reach) <= limits.lower + AT_STOP {
        Some(format!(
            "joint '{name}' is at its lower stop, {} {unit}",
            limits.lower
        ))
    } else if q.max(reach) >= limits.upper - AT_STOP {
        Some(format!(
            "joint '{name}' is at its upper stop, {} {unit}",
            limits.upper
        ))
    } else if qd.abs() >= limits.velocity * (1.0 - AT_LIMIT) {
        let limit = limits.velocity;
        Some(format!(
            "joint '{name}' is at its speed limit, {limit} {unit}/s"
        ))
    } else {
        None
    }
}

fn of_wheels(robot: &FlexibleFloating, now: &mut Vec<String>) {
    let wheels = robot.system().wheels().iter();
    let speeds = robot.state().wheel_speeds().iter();
    let torques = robot.input().wheel_torques.iter();
    for (wheel, (speed, torque)) in wheels.zip(speeds.zip(torques)) {
        now.extend(of_wheel(wheel, *speed, *torque));
    }
}

fn of_wheel(wheel: &Wheel, speed: f64, torque: f64) -> Option<String> {
    let name = &wheel.name;
    let limit = wheel.speed_limit();
    if speed.abs() >= limit * (1.0 - AT_LIMIT) {
        Some(format!(
            "wheel '{name}' is at its speed limit, {limit} rad/s"
        ))
    } else if torque.abs() > wheel.max_torque {
        let most = wheel.max_torque;
        Some(format!("wheel '{name}' is at its torque limit, {most} N m"))
    } else {
        None
    }
}
