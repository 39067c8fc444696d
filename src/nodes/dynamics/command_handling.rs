//! Commands that arrive: who may give them, and what they do.

use std::time::{Duration, Instant};

use super::{
    joint_command::{CommandLimits, JointCommand},
    simulation::Simulation,
};
use crate::{
    msg::sensor_msgs::JointState,
    ros::{Received, Time},
};

/// How long diagnostics tell of a refused command while others are obeyed.
const REFUSAL_SHOWN: Duration = Duration::from_secs(5);

impl Simulation<'_> {
    /// Obeys the commands that wait, from simulated time `now` on. In lockstep one of them is the answer to
    /// the last state, and those that come after it are too late.
    pub(super) fn take_commands(&mut self, now: f64) {
        let lockstep = self.params.lockstep;
        while let Some(received) = self.commands.take() {
            let stamp = Time::from(&received.message.header.stamp);
            let present = Time::from_secs_f64(self.world.time());
            if self.answers.is_of_before(stamp, present) || (lockstep && self.answered) {
                continue;
            }
            if self.started && !lockstep {
                self.world.step_within_tick(now);
            }
            let time = self.world.time();
            if self.obey(&received, time) {
                self.started = true;
                self.answered = stamp == Time::from_secs_f64(time);
            }
        }
    }

    fn obey(&mut self, received: &Received<JointState>, now: f64) -> bool {
        let limits = CommandLimits {
            effort: self.params.max_effort,
            rate: self.params.max_rate,
        };
        let command =
            match JointCommand::from_msg(&received.message, self.world.robot.model(), limits) {
                Ok(command) => command,
                Err(problem) => {
                    self.refuse(&format!("it {problem}"));
                    return false;
                }
            };
        let there = |gid| self.commands.is_matched(gid);
        if !self.commander.admit(received.publisher, there) {
            let name = |gid| self.node.owner_of(gid);
            let holder = self.commander.holder().map(name).unwrap_or_default();
            self.refuse(&format!(
                "it is from {}, while {holder} commands the robot (until it ends, or is silent for command_timeout, {} s)",
                name(received.publisher),
                self.params.command_timeout
            ));
            return false;
        }
        let (cut, limit) = match command {
            JointCommand::Efforts(efforts) => {
                if self.world.rates_driven() {
                    self.efforts.fill(0.0);
                }
                for (joint, effort) in efforts {
                    self.efforts[joint] = effort;
                }
                (self.world.hold_efforts(&self.efforts), "an effort")
            }
            JointCommand::Rates(rates) => (self.world.drive_rates(&rates), "a velocity"),
        };
        self.last_command = Some(now);
        self.answers
            .note(Time::from(&received.message.header.stamp));
        if cut {
            self.command_status.warn(format!(
                "the last command exceeds {limit} limit and was cut"
            ));
        } else if self
            .refused_at
            .is_none_or(|at| at.elapsed() > REFUSAL_SHOWN)
        {
            self.command_status.ok("obeying joint_commands");
        }
        true
    }

    fn refuse(&mut self, problem: &str) {
        self.refused += 1;
        self.refused_at = Some(Instant::now());
        let told = format!("{}: refused, {problem}", self.commands.topic());
        if self.refused == 1 {
            tracing::warn!("{told}");
        }
        self.command_status.warn(told);
        self.command_status.set("refused", self.refused);
    }

    pub(super) fn check_command_age(&mut self) {
        let Some(last) = self.last_command else {
            return;
        };
        let age = self.world.time() - last;
        if age > self.params.command_timeout && !self.params.lockstep {
            self.efforts.fill(0.0);
            self.world.halt();
            let zero = match self.world.rates_driven() {
                true => "the joints are stopped",
                false => "efforts are zero",
            };
            self.command_status.warn(format!(
                "no command on {} for {age:.1} s (command_timeout is {} s): {zero}",
                self.commands.topic(),
                self.params.command_timeout
            ));
        }
    }
}
