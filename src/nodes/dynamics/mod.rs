//! The dynamics node: integrates the free-floating robot and owns time.
//!
//! A command acts from the moment it arrives: in real time the world is stepped to that moment under the
//! old efforts first. In lockstep it acts from the state that it answers. In between is the usual case: time
//! keeps the pace of the clock, but waits up to `answer_timeout` for a commander that has answered so far.
//!
//! What a command fills decides what it is: `effort` is held as it is, `velocity` is what a servo in the robot's drives
//! ([`VelocityServo`](crate::control::VelocityServo)) drives the joints' rates to, with a bandwidth of its own and no more
//! effort than they have. The last command is for the whole robot: joints that it does not name keep their effort or rate,
//! or get zero if the command before was of the other kind. When commands end, held efforts become zero, which lets the arm
//! coast, and driven rates become zero, which stops it.

mod answers;
mod commands;
mod imu;
mod loops;
mod messages;
mod outputs;
mod pace;
mod params;
mod world;

pub use imu::{ImuParams, imu};
pub use loops::{EndParams, LoopParams};
pub use messages::{FrameTree, WORLD, joint_states, momentum, odometry};
pub use params::{Description, DynamicsParams, Motion, TargetParams};
pub use world::{Target, World, odometry_topic};

use std::time::{Duration, Instant};

use crate::{
    msg::sensor_msgs::JointState,
    nodes::topics,
    ros::{Node, NodeError, Received, Status, Subscription, Time},
};
use answers::Answers;
use commands::{Command, CommandLimits};
use outputs::Outputs;
use pace::Pace;

/// How often a state that waits for its answer is published again: the peer may have joined late.
const REPEAT: Duration = Duration::from_millis(100);

/// A closed loop that is open by more is not simulated as it should be \[m or rad\].
const LARGEST_GAP: f64 = 1e-6;

/// How long diagnostics tell of a refused command while others are obeyed.
const REFUSAL_SHOWN: Duration = Duration::from_secs(5);

/// The node's program.
///
/// # Errors
/// For wrong parameters or descriptions, when DDS refuses, or when the state is no longer finite.
pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let params = DynamicsParams::declare(&mut declare);
    declare.finish()?;
    let input = |e: String| NodeError::Input(format!("node {}: {e}", node.name()));
    let params = params.map_err(input)?;
    let world = World::new(&params).map_err(input)?;
    let robot = world.robot.model();
    if let Some(missing) = world.not_simulated() {
        tracing::warn!("{}: {missing}", params.robot.source);
    }
    if params.state_rate > 100.0 && !params.lockstep {
        tracing::warn!(
            "state_rate is {} Hz: above 100 Hz a subscriber that dies without a word slows the others for about a minute",
            params.state_rate
        );
    }
    let loops = world.robot.loops();
    if !loops.closures().is_empty() {
        tracing::info!(
            "{} loop closures leave {} of {} joints free",
            loops.closures().len(),
            loops.mobility(),
            robot.dof()
        );
    }
    tracing::info!(
        "{}: {} bodies, {} joints, {} kg; {} free bodies beside it",
        params.robot.source,
        robot.bodies().len(),
        robot.dof(),
        robot.total_mass(),
        world.targets.len()
    );
    Simulation {
        node,
        outputs: Outputs::new(node, &world, &params.robot.xml)?,
        commands: topics::JOINT_COMMANDS.subscribe(node)?,
        command_status: node.diagnostics().status("commands"),
        time_status: node.diagnostics().status("time"),
        limit_status: node.diagnostics().status("limits"),
        loop_status: (!params.loop_closures.is_empty())
            .then(|| node.diagnostics().status("loop closures")),
        last_command: None,
        refused: 0,
        refused_at: None,
        answers: Answers::default(),
        waited: 0,
        efforts: vec![0.0; robot.dof()],
        pace: Pace::new(params.real_time_factor),
        world,
        params,
    }
    .run()
}

struct Simulation<'a> {
    node: &'a Node,
    params: DynamicsParams,
    world: World,
    outputs: Outputs,
    commands: Subscription<JointState>,
    command_status: Status,
    time_status: Status,
    limit_status: Status,
    /// `None` without closed loops.
    loop_status: Option<Status>,
    /// Simulated time at which the last valid command came \[s\].
    last_command: Option<f64>,
    refused: u64,
    refused_at: Option<Instant>,
    answers: Answers,
    /// States for whose answers time has waited.
    waited: u64,
    efforts: Vec<f64>,
    pace: Pace,
}

impl Simulation<'_> {
    fn run(mut self) -> Result<(), NodeError> {
        self.command_status.warn(format!(
            "no command has arrived on {} yet",
            self.commands.topic()
        ));
        self.outputs.publish(&mut self.world)?;
        if self.params.start_on_command {
            self.time_status
                .warn("time is held until the first command");
            self.repeat_until(|s| s.take_commands(0.0) > 0)?;
        }
        self.pace.start(self.world.time());
        while self.node.ok() {
            let duration = self.params.duration;
            if duration > 0.0 && self.world.time() >= duration - 1e-9 {
                self.time_status
                    .ok("the duration is over; time stands still");
                self.repeat_until(|_| false)?;
                break;
            }
            if self.params.lockstep {
                self.time_status.ok("lockstep");
                self.await_answer()?;
                self.await_pace();
            } else {
                self.await_tick();
            }
            self.check_command_age();
            self.step();
            self.answers.expect(Time::from_secs_f64(self.world.time()));
            self.outputs.publish(&mut self.world)?;
            match self.world.beyond_limits() {
                Some(problem) => self.limit_status.warn(problem),
                None => self.limit_status.ok("within the joints' limits"),
            }
            self.report_loops();
            self.report_time();
        }
        Ok(())
    }

    fn report_loops(&self) {
        let (Some(status), robot) = (&self.loop_status, &self.world.robot) else {
            return;
        };
        let mut open = None;
        for (closure, gap) in robot.loops().gaps(robot.workspace()) {
            let (name, m, rad) = (&closure.name, gap.translation, gap.rotation);
            status.set(&format!("{name} gap [m]"), format!("{m:.1e}"));
            status.set(&format!("{name} gap [rad]"), format!("{rad:.1e}"));
            if m.max(rad) > LARGEST_GAP {
                open = Some(format!(
                    "loop closure '{name}' is open by {m:.1e} m, {rad:.1e} rad: lower time_step"
                ));
            }
        }
        match open {
            Some(problem) => status.warn(problem),
            None => status.ok("closed"),
        }
    }

    /// Steps to the next state. One that is not finite is given up: the robot stays as it was, with zero
    /// efforts, and says so; whoever commands too much must not end the simulation for all others.
    fn step(&mut self) {
        let before = self.world.robot.state().clone();
        self.world.step_to_tick();
        if let Err(problem) = self.world.check_finite() {
            self.efforts.fill(0.0);
            self.world.robot.set_state(before);
            self.world.hold_efforts(&self.efforts);
            tracing::error!("{problem}; the robot stays as it was, efforts are zero");
            self.command_status
                .error(format!("{problem}; efforts are zero"));
        }
    }

    /// Publishes the state again and again until `done` says so or the node is to stop.
    fn repeat_until(&mut self, mut done: impl FnMut(&mut Self) -> bool) -> Result<(), NodeError> {
        let mut next = Instant::now() + REPEAT;
        while self.node.ok() && !done(self) {
            self.node
                .wait_for(next.saturating_duration_since(Instant::now()));
            if Instant::now() >= next {
                self.outputs.publish(&mut self.world)?;
                next += REPEAT;
            }
        }
        Ok(())
    }

    /// Lockstep: waits for the command that carries this state's stamp.
    fn await_answer(&mut self) -> Result<(), NodeError> {
        let stamp = Time::from_secs_f64(self.world.time());
        let since = Instant::now();
        self.repeat_until(|s| {
            if since.elapsed() > Duration::from_secs(1) {
                let waited = since.elapsed().as_secs();
                s.time_status.warn(format!(
                    "lockstep: waiting for {waited} s for the command that answers the state of {stamp} s"
                ));
            }
            while let Some(received) = s.commands.take() {
                let answers = Time::from(&received.message.header.stamp) == stamp;
                if s.obey(&received, s.world.time()) && answers {
                    return true;
                }
            }
            false
        })
    }

    /// Lockstep in real time: waits for the next state to be due.
    fn await_pace(&mut self) {
        let due = self.pace.instant(self.world.next_tick());
        while self.node.ok() && Instant::now() < due {
            self.node
                .wait_for(due.saturating_duration_since(Instant::now()));
        }
    }

    /// Real time: lets commands act as they arrive, until the next state is due, or longer while the answer
    /// to the last one is.
    fn await_tick(&mut self) {
        let due = self.pace.instant(self.world.next_tick());
        let patience = due + Duration::from_secs_f64(self.params.answer_timeout);
        let mut late = false;
        loop {
            self.take_commands(self.pace.time(Instant::now()));
            let now = Instant::now();
            let end = match now >= due && self.answers.due() {
                true => patience,
                false => due,
            };
            if now >= end {
                break;
            }
            late |= now >= due;
            if !self.node.wait_for(end - now) {
                break;
            }
        }
        self.waited += u64::from(late);
    }

    /// Obeys the commands that wait, from simulated time `now` on; gives how many were valid.
    fn take_commands(&mut self, now: f64) -> usize {
        let mut obeyed = 0;
        while let Some(received) = self.commands.take() {
            if self.last_command.is_some() || !self.params.start_on_command {
                self.world.step_within_tick(now);
            }
            obeyed += usize::from(self.obey(&received, self.world.time()));
        }
        obeyed
    }

    fn obey(&mut self, received: &Received<JointState>, now: f64) -> bool {
        let limits = CommandLimits {
            effort: self.params.max_effort,
            rate: self.params.max_rate,
        };
        match Command::from_msg(&received.message, self.world.robot.model(), limits) {
            Ok(command) => {
                let (cut, limit) = match command {
                    Command::Efforts(efforts) => {
                        if self.world.rates_driven() {
                            self.efforts.fill(0.0);
                        }
                        for (joint, effort) in efforts {
                            self.efforts[joint] = effort;
                        }
                        (self.world.hold_efforts(&self.efforts), "an effort")
                    }
                    Command::Rates(rates) => (self.world.drive_rates(&rates), "a velocity"),
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
            Err(problem) => {
                self.refused += 1;
                self.refused_at = Some(Instant::now());
                let told = format!("{}: refused, it {problem}", self.commands.topic());
                if self.refused == 1 {
                    tracing::warn!("{told}");
                }
                self.command_status.warn(told);
                self.command_status.set("refused", self.refused);
                false
            }
        }
    }

    fn check_command_age(&mut self) {
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

    fn report_time(&mut self) {
        if let Some(achieved) = self.pace.achieved(self.world.time()) {
            self.time_status
                .set("simulated time [s]", format!("{:.2}", self.world.time()));
            self.time_status
                .set("real time factor", format!("{achieved:.3}"));
            self.time_status
                .set("states that waited for their answer", self.waited);
            let wanted = self.params.real_time_factor;
            if self.params.lockstep || wanted == 0.0 {
                return;
            }
            if achieved < 0.95 * wanted {
                self.time_status
                    .warn(format!("slower than the real_time_factor of {wanted}"));
            } else {
                self.time_status.ok("in time");
            }
        }
    }
}
