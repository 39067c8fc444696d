//! The running simulation: when time goes on, what acts, and what is told of it.

use std::time::{Duration, Instant};

use super::{
    command_arbiter::CommandArbiter,
    outputs::Outputs,
    params::DynamicsParams,
    real_time_pacing::RealTimePacing,
    response_tracking::ResponseTracker,
    services::{Control, Stepping},
    world::World,
};
use crate::{
    msg::sensor_msgs::JointState,
    nodes::topics,
    ros::{Lifecycle, Node, NodeError, Status, Subscription, Time},
};

/// How often a state that waits for its answer is published again: the peer may have joined late.
const REPEAT: Duration = Duration::from_millis(100);

/// A closed loop that is open by more is not simulated as it should be \[m or rad\].
const LARGEST_GAP: f64 = 1e-6;

/// What time does when nobody steps it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// It stands still at the start.
    Stopped,
    /// It goes on.
    Playing,
    /// It stands still.
    Paused,
}

/// The world, and whoever talks to it.
pub struct Simulation<'a> {
    pub(super) node: &'a Node,
    lifecycle: &'a Lifecycle,
    pub(super) params: &'a DynamicsParams,
    pub(super) world: World,
    pub(super) outputs: Outputs,
    pub(super) control: Control,
    pub(super) phase: Phase,
    /// Steps that somebody waits for.
    pub(super) stepping: Option<Stepping>,
    /// Whether a call has changed the world since it was published.
    pub(super) changed: bool,
    /// Whether a call wants the node to end.
    pub(super) quitting: bool,
    pub(super) commands: Subscription<JointState>,
    pub(super) commander: CommandArbiter,
    pub(super) command_status: Status,
    time_status: Status,
    limit_status: Status,
    /// `None` without closed loops.
    loop_status: Option<Status>,
    /// Whether time may go on: it need not wait for a first command any more.
    pub(super) started: bool,
    /// Lockstep: whether the last state has its answer.
    pub(super) answered: bool,
    /// Whether time goes on since the pace was set, and has not begun anew.
    paced: bool,
    /// Simulated time at which the last valid command came \[s\].
    pub(super) last_command: Option<f64>,
    pub(super) refused: u64,
    pub(super) refused_at: Option<Instant>,
    pub(super) answers: ResponseTracker,
    /// States for whose answers time has waited.
    waited: u64,
    pub(super) efforts: Vec<f64>,
    pace: RealTimePacing,
}

impl<'a> Simulation<'a> {
    /// The world at its start, with all endpoints.
    ///
    /// # Errors
    /// For wrong parameters or descriptions, and when DDS refuses.
    pub fn new(
        node: &'a Node,
        lifecycle: &'a Lifecycle,
        params: &'a DynamicsParams,
    ) -> Result<Self, NodeError> {
        let input = |e: String| NodeError::Input(format!("node {}: {e}", node.name()));
        let world = World::new(params).map_err(input)?;
        announce(params, &world);
        let diagnostics = node.diagnostics();
        let commands = topics::JOINT_COMMANDS.subscribe(node)?;
        let command_status = diagnostics.status("commands");
        command_status.warn(format!(
            "no command has arrived on {} yet",
            commands.topic()
        ));
        Ok(Self {
            outputs: Outputs::new(node, &world, &params.robot.xml)?,
            control: Control::new(node)?,
            phase: match params.start_paused {
                true => Phase::Paused,
                false => Phase::Playing,
            },
            stepping: None,
            changed: false,
            quitting: false,
            commands,
            commander: CommandArbiter::new(Duration::from_secs_f64(params.command_timeout)),
            command_status,
            time_status: diagnostics.status("time"),
            limit_status: diagnostics.status("limits"),
            loop_status: (!params.loop_closures.is_empty())
                .then(|| diagnostics.status("loop closures")),
            started: !params.start_on_command,
            answered: false,
            paced: false,
            last_command: None,
            refused: 0,
            refused_at: None,
            answers: ResponseTracker::default(),
            waited: 0,
            efforts: vec![0.0; world.robot.model().dof()],
            pace: RealTimePacing::new(params.real_time_factor),
            world,
            lifecycle,
            params,
            node,
        })
    }

    /// Publishes the world as it is.
    ///
    /// # Errors
    /// When the state is no longer finite.
    pub fn publish(&mut self) -> Result<(), NodeError> {
        self.outputs.publish(&mut self.world)
    }

    /// Time goes on to the next state, if it goes on, or else a while passes. Calls are answered meanwhile.
    ///
    /// # Errors
    /// When the state is no longer finite.
    pub fn turn(&mut self) -> Result<(), NodeError> {
        let duration = self.params.duration;
        if self.phase == Phase::Playing && self.is_over() {
            self.phase = Phase::Paused;
            self.time_status.ok(format!(
                "the duration of {duration} s is over; time stands still"
            ));
        }
        if !self.runs() {
            self.paced = false;
            return self.repeat_until(|s| {
                s.take_commands(f64::NEG_INFINITY);
                s.runs()
            });
        }
        if !self.started && self.stepping.is_none() {
            self.time_status
                .warn("time is held until the first command");
            return self.repeat_until(|s| {
                s.take_commands(f64::NEG_INFINITY);
                s.started || !s.runs() || s.stepping.is_some()
            });
        }
        if !self.paced {
            self.paced = true;
            self.pace.start(self.world.time());
        }
        if self.params.lockstep {
            self.time_status.ok("lockstep");
            self.await_answer()?;
            self.await_pace()?;
        } else {
            self.await_tick()?;
        }
        // A call may have changed the state meanwhile, or begun it anew: then it waits for its own answer and time.
        let settled = self.paced && (self.answered || !self.params.lockstep);
        if settled && self.runs() && self.node.ok() {
            self.tick()?;
        }
        Ok(())
    }

    /// Nothing is simulated, but calls are answered.
    ///
    /// # Errors
    /// When the state is no longer finite.
    pub fn idle(&mut self) -> Result<(), NodeError> {
        self.paced = false;
        self.attend()?;
        while self.commands.take().is_some() {}
        self.time_status.warn("the node is not active");
        self.node.wait_for(REPEAT);
        Ok(())
    }

    /// Nothing drives the robot any more.
    pub fn let_go(&mut self) {
        self.efforts.fill(0.0);
        self.world.halt();
        self.answered = false;
        self.commander.forget();
        self.end_steps("the node was deactivated");
    }

    /// Whether the time to simulate is over.
    pub(super) fn is_over(&self) -> bool {
        let duration = self.params.duration;
        duration > 0.0 && self.world.time() >= duration - 1e-9
    }

    /// Whether time goes on.
    fn runs(&self) -> bool {
        let goes_on = self.phase == Phase::Playing || self.stepping.is_some();
        goes_on && self.is_active() && !self.lifecycle.is_asked()
    }

    /// Whether the node may simulate.
    pub(super) fn is_active(&self) -> bool {
        self.lifecycle.is_active()
    }

    /// Time stands still from now on.
    pub(super) fn pause(&mut self, phase: Phase) {
        self.phase = phase;
        self.time_status.ok(match phase {
            Phase::Stopped => "stopped",
            _ => "paused",
        });
    }

    /// What was to come belongs to a world that is no more.
    pub(super) fn begin_anew(&mut self) {
        while self.commands.take().is_some() {}
        self.answers.begin_anew();
        self.answered = false;
        self.paced = false;
        self.efforts.fill(0.0);
        self.last_command = None;
        self.started = !self.params.start_on_command;
        self.commander.forget();
    }

    /// The last state was changed: its answer is still to come.
    pub(super) fn expect_answer(&mut self) {
        self.answered = false;
    }

    fn tick(&mut self) -> Result<(), NodeError> {
        self.check_command_age();
        self.step();
        self.started = true;
        self.answered = false;
        self.answers.expect(Time::from_secs_f64(self.world.time()));
        self.outputs.publish(&mut self.world)?;
        match self.world.beyond_limits() {
            Some(problem) => self.limit_status.warn(problem),
            None => self.limit_status.ok("within the joints' limits"),
        }
        self.report_loops();
        self.report_time();
        self.count_step();
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

    /// ResponseTracker calls and publishes the state again and again, until `done` says so, the node is to stop or a
    /// transition of its lifecycle is asked for.
    fn repeat_until(&mut self, mut done: impl FnMut(&mut Self) -> bool) -> Result<(), NodeError> {
        let mut next = Instant::now() + REPEAT;
        loop {
            self.attend()?;
            if !self.node.ok() || self.lifecycle.is_asked() || done(self) {
                return Ok(());
            }
            self.node
                .wait_for(next.saturating_duration_since(Instant::now()));
            if Instant::now() >= next {
                self.outputs.publish(&mut self.world)?;
                next += REPEAT;
            }
        }
    }

    /// Lockstep: waits for the command that carries this state's stamp.
    fn await_answer(&mut self) -> Result<(), NodeError> {
        let since = Instant::now();
        self.repeat_until(|s| {
            if since.elapsed() > Duration::from_secs(1) {
                let waited = since.elapsed().as_secs();
                let stamp = Time::from_secs_f64(s.world.time());
                s.time_status.warn(format!(
                    "lockstep: waiting for {waited} s for the command that answers the state of {stamp} s"
                ));
            }
            s.take_commands(f64::NEG_INFINITY);
            s.answered || !s.runs() || !s.paced
        })
    }

    /// Lockstep in real time: waits for the next state to be due.
    fn await_pace(&mut self) -> Result<(), NodeError> {
        let due = self.pace.instant(self.world.next_tick());
        while self.node.ok() && self.runs() && self.paced && Instant::now() < due {
            self.node
                .wait_for(due.saturating_duration_since(Instant::now()));
            self.attend()?;
        }
        Ok(())
    }

    /// Real time: lets commands act as they arrive, until the next state is due, or longer while the answer
    /// to the last one is.
    fn await_tick(&mut self) -> Result<(), NodeError> {
        let due = self.pace.instant(self.world.next_tick());
        let patience = due + Duration::from_secs_f64(self.params.answer_timeout);
        let mut late = false;
        loop {
            self.attend()?;
            if !self.runs() || !self.paced {
                break;
            }
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
        Ok(())
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

/// What the log should say of a world.
fn announce(params: &DynamicsParams, world: &World) {
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
}
