//! Inputs of wheel and thruster commands: the topics `wheel_commands` and `thruster_commands`.
//!
//! A wheel torque is held until the next command; after `command_timeout` without a command it becomes zero, as joint
//! efforts do. A thruster stays on for the time in its command, which replaces the remaining time of an earlier
//! command. In lockstep, if `lockstep_on` contains `wheel_commands`, every state waits for the wheel command that
//! carries its stamp.

use super::{
    motions::Refusals, params::DynamicsParams, simulation::Simulation, step_status::StepStatus,
    world::World,
};
use crate::{
    dynamics::flexible::FlexibleSystem,
    msg::{fuyu_msgs::ThrusterCommands, sensor_msgs::JointState},
    nodes::topics,
    ros::{Node, NodeError, Subscription, Time},
};

/// Longest time for which a command opens a valve \[s\].
const LONGEST: f64 = 1e6;

/// Largest wheel torque in a command \[N m\].
const LARGEST: f64 = 1e6;

/// Maximum number of messages per topic that one call of [`take`] handles, so that a flood cannot stall simulated time.
const MAX_MESSAGES: usize = 64;

/// Endpoints of wheel and thruster commands.
pub struct ActuatorInputs {
    /// `None` for a robot without wheels.
    wheels: Option<Subscription<JointState>>,
    /// `None` for a robot without thrusters.
    thrusters: Option<Subscription<ThrusterCommands>>,
    refusals: Refusals,
    status: StepStatus,
    /// Age of the last wheel command above which wheel torques become zero \[s\]; infinite in lockstep.
    timeout: f64,
    /// Simulated time at which the last wheel command was applied \[s\].
    last: Option<f64>,
    /// Lockstep: whether every state waits for a wheel command.
    is_awaited: bool,
    /// Whether a wheel command has answered the current state.
    is_answered: bool,
}

impl ActuatorInputs {
    /// Subscribes to the commands; `None` for a robot without wheels and thrusters.
    ///
    /// # Errors
    /// When the node cannot subscribe.
    pub fn new(
        node: &Node,
        params: &DynamicsParams,
        world: &World,
    ) -> Result<Option<Self>, NodeError> {
        let Some(robot) = world.robot.flexible() else {
            return Ok(None);
        };
        let system = robot.system();
        let wheels = match system.wheels() {
            [] => None,
            _ => Some(topics::WHEEL_COMMANDS.subscribe(node)?),
        };
        let thrusters = match system.thrusters() {
            [] => None,
            _ => Some(topics::THRUSTER_COMMANDS.subscribe(node)?),
        };
        if wheels.is_none() && thrusters.is_none() {
            return Ok(None);
        }
        let mut status = StepStatus::new(node.diagnostics().status("wheels and thrusters"));
        status.ok("no command has arrived yet");
        Ok(Some(Self {
            is_awaited: params.lockstep && params.lockstep_on.wheels && wheels.is_some(),
            timeout: match params.lockstep {
                true => f64::INFINITY,
                false => params.command_timeout,
            },
            wheels,
            thrusters,
            refusals: Refusals::default(),
            status,
            last: None,
            is_answered: false,
        }))
    }

    /// Whether time may advance in lockstep.
    pub fn may_advance(&self) -> bool {
        !self.is_awaited || self.is_answered
    }

    /// Why an awaited wheel command is missing; `None` if no command is awaited.
    pub fn missing_command_reason(&self) -> Option<String> {
        let topic = self.wheels.as_ref()?.topic();
        (!self.may_advance()).then(|| format!("no command with its stamp has arrived on {topic}"))
    }

    /// A new state was published: it has no wheel command yet.
    pub fn expect(&mut self) {
        self.is_answered = false;
    }

    /// Drops waiting messages.
    pub fn discard(&mut self) {
        while self
            .wheels
            .as_ref()
            .is_some_and(|topic| topic.take().is_some())
        {}
        while (self.thrusters.as_ref()).is_some_and(|topic| topic.take().is_some()) {}
    }

    /// Resets after time or state was reset: drops pending messages and forgets the last command.
    pub fn restart(&mut self) {
        self.discard();
        self.last = None;
        self.is_answered = false;
    }

    /// Sets the wheels' torques to zero if the last command is too old.
    pub fn check_age(&mut self, world: &mut World) {
        let Some(last) = self.last else { return };
        let age = world.time() - last;
        if age > self.timeout {
            world.release_wheels();
            if !self.refusals.is_shown() {
                self.status.warn(format!(
                    "no command on wheel_commands for {age:.1} s (command_timeout is {} s): wheel torques are zero",
                    self.timeout
                ));
            }
        }
    }

    fn report<T>(&mut self, topic: &str, result: &Result<T, String>) {
        match result {
            Ok(_) if !self.refusals.is_shown() => self.status.ok("obeying commands"),
            Ok(_) => {}
            Err(problem) => self.refusals.report(&mut self.status, topic, problem),
        }
    }
}

/// Applies pending commands. Outside lockstep the world is first stepped to the simulated time `now` \[s\].
pub fn take(simulation: &mut Simulation, now: f64) {
    for _ in 0..MAX_MESSAGES {
        let Some(inputs) = &simulation.actuator_inputs else {
            return;
        };
        let wheels = inputs.wheels.as_ref().and_then(Subscription::take);
        let thrusters = inputs.thrusters.as_ref().and_then(Subscription::take);
        if wheels.is_none() && thrusters.is_none() {
            return;
        }
        simulation.step_to_command(now);
        let Simulation {
            actuator_inputs: Some(inputs),
            world,
            ..
        } = simulation
        else {
            return;
        };
        if let Some(received) = wheels {
            let torques = of_names(world, |system| wheel_torques(&received.message, system));
            inputs.report("wheel_commands", &torques);
            if let Ok(torques) = torques {
                world.hold_wheel_torques(torques);
                inputs.last = Some(world.time());
                let stamp = Time::from(&received.message.header.stamp);
                inputs.is_answered |= stamp == Time::from_secs_f64(world.time());
                simulation.clock.release();
            }
        }
        let Simulation {
            actuator_inputs: Some(inputs),
            world,
            ..
        } = simulation
        else {
            return;
        };
        if let Some(received) = thrusters {
            let on_times = of_names(world, |system| on_times(&received.message, system));
            inputs.report("thruster_commands", &on_times);
            if let Ok(on_times) = on_times {
                world.fire(on_times);
            }
        }
    }
}

/// Values that `read` finds for wheels or thrusters of the robot.
fn of_names<T>(
    world: &World,
    read: impl FnOnce(&FlexibleSystem) -> Result<T, String>,
) -> Result<T, String> {
    match world.robot.flexible() {
        Some(robot) => read(robot.system()),
        None => Err("the robot has neither wheels nor thrusters".to_owned()),
    }
}

/// Torques of a command: wheel index and torque \[N m\].
fn wheel_torques(
    command: &JointState,
    system: &FlexibleSystem,
) -> Result<Vec<(usize, f64)>, String> {
    if !command.position.is_empty() || !command.velocity.is_empty() {
        return Err("it has positions or velocities; wheels take effort".to_owned());
    }
    let names: Vec<_> = system.wheels().iter().map(|w| w.name.as_str()).collect();
    values(
        &command.name,
        &command.effort,
        "effort",
        &names,
        -LARGEST..=LARGEST,
    )
}

/// On-times of a command: thruster index and time \[s\].
fn on_times(
    command: &ThrusterCommands,
    system: &FlexibleSystem,
) -> Result<Vec<(usize, f64)>, String> {
    let names: Vec<_> = system.thrusters().iter().map(|t| t.name.as_str()).collect();
    values(
        &command.name,
        &command.on_time,
        "on_time",
        &names,
        0.0..=LONGEST,
    )
}

/// Values by name as pairs of index and value.
fn values(
    given: &[String],
    values: &[f64],
    field: &str,
    names: &[&str],
    range: std::ops::RangeInclusive<f64>,
) -> Result<Vec<(usize, f64)>, String> {
    if given.len() != values.len() {
        return Err(format!(
            "it has {} names and {} values in {field}; give one for each name",
            given.len(),
            values.len()
        ));
    }
    let mut pairs: Vec<(usize, f64)> = Vec::with_capacity(given.len());
    for (name, value) in given.iter().zip(values) {
        let Some(i) = names.iter().position(|known| known == name) else {
            return Err(format!("'{name}' is not one of {}", names.join(", ")));
        };
        if pairs.iter().any(|(j, _)| *j == i) {
            return Err(format!("'{name}' is given twice"));
        }
        if !range.contains(value) {
            return Err(format!(
                "{field} of '{name}' is {value}, expected {} to {}",
                range.start(),
                range.end()
            ));
        }
        pairs.push((i, *value));
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read_by_name_or_refused() {
        let read = |names: &[&str], given: &[f64]| {
            let names: Vec<_> = names.iter().map(|n| (*n).to_owned()).collect();
            values(&names, given, "effort", &["x", "y"], -2.0..=2.0)
        };
        assert_eq!(
            read(&["y", "x"], &[1.0, -2.0]),
            Ok(vec![(1, 1.0), (0, -2.0)])
        );
        assert_eq!(read(&[], &[]), Ok(vec![]));
        for (names, given, says) in [
            (&["x"][..], &[][..], "1 names and 0 values"),
            (&["z"], &[1.0], "'z' is not one of x, y"),
            (&["x", "x"], &[1.0, 1.0], "'x' is given twice"),
            (
                &["x"],
                &[f64::NAN],
                "effort of 'x' is NaN, expected -2 to 2",
            ),
            (&["x"], &[3.0], "effort of 'x' is 3"),
        ] {
            let refused = read(names, given).unwrap_err();
            assert!(refused.contains(says), "{refused}");
        }
    }
}
