//! Command handling: messages on `joint_commands` are validated, admitted and applied to the world.

use std::time::{Duration, Instant};

use super::{
    command_arbiter::CommandArbiter,
    joint_command::{CommandKind, CommandLimits, CommandReader},
    joint_drive::DriveMode,
    params::DynamicsParams,
    response_tracking::ResponseTracker,
    step_status::StepStatus,
    world::World,
};
use crate::{
    msg::sensor_msgs::JointState,
    nodes::topics,
    ros::{Gid, Node, NodeError, Received, Subscription, Time},
};

/// How long diagnostics report a refused command while commands of another publisher act.
const REFUSAL_SHOWN: Duration = Duration::from_secs(5);

/// Receives commands, decides which of them act, and tracks which states they answer.
pub struct CommandHandler {
    node: Node,
    commands: Subscription<JointState>,
    reader: CommandReader,
    arbiter: CommandArbiter,
    responses: ResponseTracker,
    status: StepStatus,
    lockstep: bool,
    /// Age of the last command above which the robot is halted \[s\].
    timeout: f64,
    /// Simulated time at which the last valid command arrived \[s\].
    last_command: Option<f64>,
    refused: u64,
    refused_at: Option<Instant>,
}

impl CommandHandler {
    /// Subscribes to `joint_commands`.
    ///
    /// # Errors
    /// When the node cannot subscribe.
    pub fn new(node: &Node, params: &DynamicsParams) -> Result<Self, NodeError> {
        let commands = topics::JOINT_COMMANDS.subscribe(node)?;
        let mut status = StepStatus::new(node.diagnostics().status("commands"));
        status.warn(format!(
            "no command has arrived on {} yet",
            commands.topic()
        ));
        Ok(Self {
            node: node.clone(),
            commands,
            reader: CommandReader::new(CommandLimits {
                effort: params.max_effort,
                rate: params.max_rate,
            }),
            arbiter: CommandArbiter::new(Duration::from_secs_f64(params.command_timeout)),
            responses: ResponseTracker::default(),
            status,
            lockstep: params.lockstep,
            timeout: params.command_timeout,
            last_command: None,
            refused: 0,
            refused_at: None,
        })
    }

    /// The next received command that may act at the simulated time `now` \[s\]. Commands that answer a state of the
    /// previous run are dropped; in lockstep also those that arrive after the answer to the present state.
    pub fn next(&self, now: f64) -> Option<Received<JointState>> {
        let now = Time::from_secs_f64(now);
        let is_late = |command: &Received<JointState>| {
            self.responses.is_of_previous_run(stamp_of(command), now)
                || (self.lockstep && self.responses.is_answered())
        };
        loop {
            let command = self.commands.take()?;
            if !is_late(&command) {
                return Some(command);
            }
        }
    }

    /// Applies a command to the world at its present time, or refuses it. Returns whether it acts.
    pub fn apply(&mut self, received: &Received<JointState>, world: &mut World) -> bool {
        let command = match self.reader.read(&received.message, world.robot.model()) {
            Ok(command) => command,
            Err(problem) => {
                self.refuse(&format!("it {problem}"));
                return false;
            }
        };
        let is_present = |publisher| self.commands.is_matched(publisher);
        if !self.arbiter.admit(received.publisher, is_present) {
            self.refuse(&self.not_admitted(received.publisher));
            return false;
        }
        let (cut, limit) = match command.kind {
            CommandKind::Effort => (world.hold_efforts(command.values()), "an effort"),
            CommandKind::Rate => (world.drive_rates(command.values()), "a velocity"),
        };
        let now = world.time();
        self.last_command = Some(now);
        (self.responses).record(stamp_of(received), Time::from_secs_f64(now));
        if cut {
            self.status.warn(format!(
                "the last command exceeds {limit} limit and was cut"
            ));
        } else if self
            .refused_at
            .is_none_or(|at| at.elapsed() > REFUSAL_SHOWN)
        {
            self.status.ok("obeying joint_commands");
        }
        true
    }

    /// Why a valid command of this publisher is refused.
    fn not_admitted(&self, publisher: Gid) -> String {
        let name = |publisher| self.node.owner_of(publisher);
        let holder = self.arbiter.holder().map(name).unwrap_or_default();
        format!(
            "it is from {}, while {holder} commands the robot (until it ends, or is silent for command_timeout, {} s)",
            name(publisher),
            self.timeout
        )
    }

    fn refuse(&mut self, problem: &str) {
        self.refused += 1;
        self.refused_at = Some(Instant::now());
        let message = format!("{}: refused, {problem}", self.commands.topic());
        if self.refused == 1 {
            tracing::warn!("{message}");
        }
        self.status.warn(message);
        self.status.set("refused", self.refused);
    }

    /// Halts the robot if the last command is too old. Lockstep waits for commands instead.
    pub fn check_age(&mut self, world: &mut World) {
        let Some(last) = self.last_command else {
            return;
        };
        let age = world.time() - last;
        if age > self.timeout && !self.lockstep {
            world.halt();
            let effect = match world.drive_mode() {
                DriveMode::Rate => "the joints are stopped",
                DriveMode::Effort => "efforts are zero",
            };
            self.status.warn(format!(
                "no command on {} for {age:.1} s (command_timeout is {} s): {effect}",
                self.commands.topic(),
                self.timeout
            ));
        }
    }

    /// The robot's state was no longer finite and has been replaced.
    pub fn report_failure(&mut self, problem: &str) {
        tracing::error!("{problem}; the robot stays as it was, efforts are zero");
        self.status.error(format!("{problem}; efforts are zero"));
    }

    /// The state of the simulated time `now` \[s\] is published and waits for a response.
    pub fn expect_response(&mut self, now: f64) {
        self.responses.expect(Time::from_secs_f64(now));
    }

    /// The present state was changed: it needs a response again.
    pub fn expect_response_again(&mut self) {
        self.responses.expect_again();
    }

    /// Whether time may advance in lockstep: the present state has a response. Always true without lockstep.
    pub fn may_advance(&self) -> bool {
        !self.lockstep || self.responses.is_answered()
    }

    /// Whether the last state has no response yet but is likely to get one.
    pub fn response_is_due(&self) -> bool {
        self.responses.is_due()
    }

    /// Drops the commands that wait.
    pub fn discard(&self) {
        while self.commands.take().is_some() {}
    }

    /// The node is deactivated: no publisher holds the robot any more.
    pub fn deactivate(&mut self) {
        self.responses.expect_again();
        self.arbiter.release();
    }

    /// Time or state is reset: no command has been given yet.
    pub fn restart(&mut self) {
        self.discard();
        self.responses.restart();
        self.last_command = None;
        self.arbiter.release();
    }
}

fn stamp_of(command: &Received<JointState>) -> Time {
    Time::from(&command.message.header.stamp)
}
