//! Command handling: validates messages on `joint_commands`, admits them by the command arbiter, and applies them.

use std::time::{Duration, Instant};

use super::{
    command_arbiter::{CommandArbiter, Commander},
    joint_command::{CommandLimits, CommandReader},
    joint_drive::DriveMode,
    params::DynamicsParams,
    response_tracking::ResponseTracker,
    step_status::StepStatus,
    world::World,
};
use crate::{
    msg::{sensor_msgs::JointState, std_msgs::Float64},
    nodes::topics,
    ros::{Gid, Node, NodeError, Publisher, Received, Subscription, Time},
};

/// How long diagnostics keep reporting a refused command while commands of another publisher are applied.
const REFUSAL_SHOWN: Duration = Duration::from_secs(5);

/// Delay of an answer, in periods, above which it counts as late: a delay of one period is often tolerable for the law.
const LATE_PERIODS: f64 = 1.5;
/// Number of consecutive late answers after which a warning is logged.
const LATE_ANSWERS: u32 = 20;

/// Receives commands, decides which of them are applied, and tracks which states they answer.
pub struct CommandHandler {
    node: Node,
    commands: Subscription<JointState>,
    reader: CommandReader,
    arbiter: CommandArbiter,
    responses: ResponseTracker,
    status: StepStatus,
    lockstep: bool,
    /// Lockstep: whether every state waits for a command.
    is_awaited: bool,
    /// Age of the last command above which the robot is halted \[s\].
    timeout: f64,
    /// Publishes the delay of answers; `None` in lockstep, or if simulated time waits for answers (`answer_timeout`).
    delays: Option<Publisher<Float64>>,
    /// Time between two states \[s\].
    period: f64,
    /// Consecutive answers that acted later than [`LATE_PERIODS`] after their state.
    late_in_a_row: u32,
    /// Whether late answers have been logged.
    has_logged_delay: bool,
    /// Simulated time at which the last valid command arrived \[s\].
    last_command: Option<f64>,
    refused: u64,
    refused_at: Option<Instant>,
    /// Why the last command was refused, if none was applied since.
    refusal: Option<String>,
    /// Lockstep: the last refused command that answers the current state; it is retried once the robot is free.
    set_aside: Option<Received<JointState>>,
}

impl CommandHandler {
    /// Subscribes to `joint_commands`.
    ///
    /// # Errors
    /// When the node cannot subscribe.
    pub fn new(node: &Node, params: &DynamicsParams) -> Result<Self, NodeError> {
        let commands = topics::JOINT_COMMANDS.subscribe(node)?;
        // The queue keeps messages per publisher, so that one publisher cannot crowd out another.
        commands.separate_publishers();
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
            is_awaited: params.lockstep && params.lockstep_on.joints,
            timeout: params.command_timeout,
            delays: match params.answer_timeout == 0.0 && !params.lockstep {
                true => Some(topics::COMMAND_DELAY.advertise(node)?),
                false => None,
            },
            period: 1.0 / params.state_rate,
            late_in_a_row: 0,
            has_logged_delay: false,
            last_command: None,
            refused: 0,
            refused_at: None,
            refusal: None,
            set_aside: None,
        })
    }

    /// The next received command that may be applied at the simulated time `now` \[s\]. Drops commands that answer a
    /// state of the previous run, and in lockstep also those that arrive after the current state was answered.
    /// `is_present` says whether a publisher of another topic is still in the graph.
    pub fn next(
        &mut self,
        now: f64,
        is_present: impl Fn(Gid) -> bool,
    ) -> Option<Received<JointState>> {
        let now = Time::from_secs_f64(now);
        let is_late = |command: &Received<JointState>| {
            self.responses.is_of_previous_run(stamp_of(command), now)
                || (self.lockstep && self.responses.is_answered())
        };
        while let Some(command) = self.commands.take() {
            if !is_late(&command) {
                return Some(command);
            }
        }
        let is_present = |publisher| self.commands.is_matched(publisher) || is_present(publisher);
        self.set_aside.take_if(|command| {
            let commander = Commander::Publisher(command.publisher);
            stamp_of(command) != now || self.arbiter.is_free_for(commander, is_present)
        })
    }

    /// Decides whether a command is applied: it must be valid and its commander must hold the robot or get it.
    /// Otherwise the command is refused. `is_present` says whether a publisher of another topic is still in the graph.
    pub fn admit(
        &mut self,
        received: &Received<JointState>,
        world: &mut World,
        is_present: impl Fn(Gid) -> bool,
    ) -> bool {
        if let Err(problem) = (self.reader).read(&received.message, world.robot.model()) {
            self.refuse(format!("it {problem}"));
            return false;
        }
        let commander = Commander::Publisher(received.publisher);
        if let Err(problem) = self.engage(commander, world, is_present) {
            self.refuse(format!("it is {problem}"));
            // Its publisher has answered this state already and will not repeat the command.
            if self.lockstep && stamp_of(received) == Time::from_secs_f64(world.time()) {
                self.set_aside = Some(received.clone());
            }
            return false;
        }
        true
    }

    /// Applies an admitted command to the world at the current time.
    pub fn apply(&mut self, received: &Received<JointState>, world: &mut World) {
        let Ok(command) = self.reader.read(&received.message, world.robot.model()) else {
            return;
        };
        let now = world.time();
        let (stamp, time) = (stamp_of(received), Time::from_secs_f64(now));
        let has_efforts = command.has_efforts();
        if !has_efforts {
            self.responses.velocity_command_acts(stamp, time);
        } else if let Some(delay) = self.responses.command_acts(stamp, time)
            && let Some(delays) = &self.delays
        {
            delays.publish(&Float64 {
                data: delay.as_secs_f64(),
            });
        }
        let cut = world.command(command.setpoints());
        let delayed = has_efforts.then(|| self.delay_problem()).flatten();
        self.last_command = Some(now);
        self.refusal = None;
        if let Some(limit) = cut {
            self.status.warn(format!(
                "the last command exceeds {limit} limit and was cut"
            ));
        } else if let Some(problem) = delayed {
            self.status.warn(problem);
        } else if self
            .refused_at
            .is_none_or(|at| at.elapsed() > REFUSAL_SHOWN)
        {
            self.status.ok("obeying joint_commands");
        }
    }

    /// A warning if answers have been late for a while; logged once.
    fn delay_problem(&mut self) -> Option<String> {
        let delay = self.responses.delay().as_secs_f64();
        self.late_in_a_row = match delay > LATE_PERIODS * self.period {
            true => self.late_in_a_row.saturating_add(1),
            false => 0,
        };
        if self.late_in_a_row < LATE_ANSWERS {
            return None;
        }
        let problem = format!(
            "{}: efforts act {:.0} ms, {:.1} periods, after the state that they answer; a control loop that is stable \
             without this delay may diverge. A larger answer_timeout makes time wait for answers, lockstep for all; without \
             waiting, delay_compensation of the controller helps",
            self.commands.topic(),
            1e3 * delay,
            delay / self.period
        );
        if !self.has_logged_delay {
            self.has_logged_delay = true;
            tracing::warn!("{problem}");
        }
        Some(problem)
    }

    /// Why an awaited command is missing.
    pub fn missing_command_reason(&self) -> String {
        let topic = self.commands.topic();
        match (&self.refusal, self.arbiter.holder()) {
            (Some(refusal), _) => format!("the last one on {topic} was refused, {refusal}"),
            (None, None) => format!("none has arrived on {topic}"),
            (None, Some(Commander::Action)) => {
                "follow_joint_trajectory, which commanded the robot, has no goal".to_owned()
            }
            (None, Some(Commander::Publisher(holder))) => {
                let name = self.node.owner_of(holder);
                match self.commands.is_matched(holder) {
                    true => format!("{name} has stopped sending on {topic}; is it active?"),
                    false => format!("{name}, which commanded the robot, has left the graph"),
                }
            }
        }
    }

    /// Checks that the commander holds the robot or could get it. `is_present` says whether a publisher of a topic
    /// other than `joint_commands` is still in the graph.
    ///
    /// # Errors
    /// As [`Self::engage`].
    pub fn check_free(
        &self,
        commander: Commander,
        is_present: impl Fn(Gid) -> bool,
    ) -> Result<(), String> {
        let is_present = |publisher| self.commands.is_matched(publisher) || is_present(publisher);
        match self.arbiter.is_free_for(commander, is_present) {
            true => Ok(()),
            false => Err(self.not_admitted(commander)),
        }
    }

    /// Makes the commander of a valid command the holder of the robot. If it takes over from another commander, the
    /// joints stop: held efforts and driven rates become zero. `is_present` says whether a publisher of a topic other
    /// than `joint_commands` is still in the graph.
    ///
    /// # Errors
    /// A line that names the refused commander and the one that holds the robot.
    pub fn engage(
        &mut self,
        commander: Commander,
        world: &mut World,
        is_present: impl Fn(Gid) -> bool,
    ) -> Result<(), String> {
        let before = self.arbiter.holder();
        let is_present = |publisher| self.commands.is_matched(publisher) || is_present(publisher);
        if !self.arbiter.admit(commander, is_present) {
            return Err(self.not_admitted(commander));
        }
        if before.is_some_and(|before| before != commander) {
            world.stop_joints();
        }
        Ok(())
    }

    /// The holder begins a motion. The motion needs no further commands unless it `is_streamed`: then silence of the
    /// commander counts.
    pub fn begin_motion(&mut self, is_streamed: bool) {
        if !is_streamed {
            self.arbiter.begin_motion();
        }
        self.last_command = None;
        self.refusal = None;
        self.status.ok("a motion is being executed");
    }

    /// The motion is over.
    pub fn end_motion(&mut self) {
        if self.arbiter.is_moving() {
            self.status.ok("the arm is held where its motion has ended");
        }
        self.arbiter.end_motion();
    }

    /// The reason for refusing a valid command of this commander.
    fn not_admitted(&self, commander: Commander) -> String {
        let name = |commander| match commander {
            Commander::Publisher(publisher) => self.node.owner_of(publisher),
            Commander::Action => "a client of follow_joint_trajectory".to_owned(),
        };
        let holder = self.arbiter.holder().map(name).unwrap_or_default();
        let end = match self.arbiter.is_moving() {
            true => "until its motion ends".to_owned(),
            false => format!(
                "until it ends, or is silent for command_timeout, {} s",
                self.timeout
            ),
        };
        format!(
            "from {}, while {holder} commands the robot ({end})",
            name(commander)
        )
    }

    fn refuse(&mut self, problem: String) {
        self.refused += 1;
        self.refused_at = Some(Instant::now());
        let message = format!("{}: refused, {problem}", self.commands.topic());
        self.refusal = Some(problem);
        if self.refused == 1 {
            tracing::warn!("{message}");
        }
        self.status.warn(message);
        self.status.set("refused", self.refused);
    }

    /// Halts the robot if the last command is too old; never in lockstep, which waits for commands.
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
                DriveMode::Mixed => {
                    "driven joints are stopped, efforts are zero, positions are held"
                }
                DriveMode::Position | DriveMode::Motion => {
                    return self.status.ok("holding the commanded positions");
                }
            };
            self.status.warn(format!(
                "no command on {} for {age:.1} s (command_timeout is {} s): {effect}",
                self.commands.topic(),
                self.timeout
            ));
        }
    }

    /// The state of simulated time `now` \[s\] was published: its response is tracked from now on.
    pub fn expect_response(&mut self, now: f64) {
        self.responses.state_published(Time::from_secs_f64(now));
    }

    /// The current state was changed: an earlier response to it no longer counts.
    pub fn expect_response_again(&mut self) {
        self.responses.state_changed();
    }

    /// Whether time may advance: outside lockstep always; in lockstep if the current state has a response, or a motion
    /// is being executed (`is_moving`), which needs none.
    pub fn may_advance(&self, is_moving: bool) -> bool {
        !self.is_awaited || self.responses.is_answered() || is_moving
    }

    /// Whether the current state has no response yet but is likely to get one.
    pub fn response_is_due(&self) -> bool {
        self.responses.is_awaiting_response()
    }

    /// Number of states left without an answer by a commander that answers states.
    pub fn unanswered(&self) -> u64 {
        self.responses.unanswered()
    }

    /// Drops pending commands.
    pub fn discard(&mut self) {
        self.set_aside = None;
        while self.commands.take().is_some() {}
    }

    /// The node is deactivated: releases the robot from its holder.
    pub fn deactivate(&mut self) {
        self.responses.state_changed();
        self.arbiter.release();
    }

    /// Resets after time or state was reset: forgets all commands and the holder.
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
