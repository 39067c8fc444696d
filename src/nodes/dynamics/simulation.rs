//! The main loop: waits until the next state may be simulated, advances to it and publishes it.

use std::time::{Duration, Instant};

use super::{
    actuator_inputs::{self, ActuatorInputs},
    clock::{Phase, SimulationClock, long_wait},
    command_handling::CommandHandler,
    gripper_actions::{self, GripperActions},
    motions::{self, Motions},
    outputs::Outputs,
    params::DynamicsParams,
    robot_status::RobotStatus,
    services::{self, Services, StepRequests},
    shared_time::SharedTime,
    time_status::TimeStatus,
    world::World,
    wrench_inputs::{self, WrenchInputs},
};
use crate::ros::{Lifecycle, Node, NodeError, Time};

/// Period at which the current state is published again while time stands still, for nodes that join late.
const REPUBLISH_PERIOD: Duration = Duration::from_millis(100);

/// Lead of `/clock` over this node above which a warning is reported \[s\].
const LARGE_LAG: f64 = 0.5;

/// Response to calls and goals while the node is inactive.
const INACTIVE: &str = "the node is inactive; activate it by ~/change_state first";

/// Maximum number of commands handled before time and service calls are checked again.
const MAX_COMMANDS: usize = 256;

/// The world, its clock, and its connections to the ROS graph.
///
/// Services access its parts only between steps (`services`).
pub struct Simulation<'a> {
    pub(super) node: &'a Node,
    lifecycle: &'a Lifecycle,
    pub(super) params: &'a DynamicsParams,
    pub(super) world: World,
    pub(super) clock: SimulationClock,
    pub(super) commands: CommandHandler,
    pub(super) motions: Motions,
    pub(super) grippers: GripperActions,
    /// `None` without the parameter `commander_interfaces`.
    pub(super) wrench_inputs: Option<WrenchInputs>,
    /// `None` for a robot without wheels and thrusters.
    pub(super) actuator_inputs: Option<ActuatorInputs>,
    pub(super) outputs: Outputs,
    pub(super) services: Services,
    pub(super) steps: StepRequests,
    pub(super) shared_time: SharedTime,
    time_status: TimeStatus,
    robot_status: RobotStatus,
}

impl<'a> Simulation<'a> {
    /// The simulation in its initial state, with all endpoints.
    ///
    /// # Errors
    /// For invalid parameters or descriptions, or when DDS reports an error.
    pub fn new(
        node: &'a Node,
        lifecycle: &'a Lifecycle,
        params: &'a DynamicsParams,
    ) -> Result<Self, NodeError> {
        let input = |e: String| NodeError::Input(format!("node {}: {e}", node.name()));
        let world = World::new(params).map_err(input)?;
        log_world(params, &world);
        let shared_time = SharedTime::new(node, params)?;
        let mut clock = SimulationClock::new(params);
        if let Some(refusal) = shared_time.refusal() {
            tracing::info!("{refusal}");
            clock.set_phase(Phase::Playing);
        }
        Ok(Self {
            commands: CommandHandler::new(node, params)?,
            motions: Motions::new(node, params, &world)?,
            grippers: GripperActions::new(node, &params.grippers)?,
            wrench_inputs: match params.motions.interfaces {
                true => Some(WrenchInputs::new(node)?),
                false => None,
            },
            actuator_inputs: ActuatorInputs::new(node, params, &world)?,
            outputs: Outputs::new(node, &world, params, !shared_time.is_follower())?,
            services: Services::new(node, &params.resource_folders, !params.grasps.is_empty())?,
            steps: StepRequests::new(node)?,
            shared_time,
            clock,
            time_status: TimeStatus::new(node, params),
            robot_status: RobotStatus::new(node, params),
            world,
            lifecycle,
            params,
            node,
        })
    }

    /// Publishes the current state of the world.
    pub fn publish(&mut self) {
        self.outputs.publish(&mut self.world);
        // Other robots advance by whole ticks.
        if !self.world.is_between_ticks() {
            self.shared_time.published(self.world.time());
        }
    }

    /// Advances to the next state, or waits until time may advance; answers service calls meanwhile. Returns early when
    /// the node stops or a lifecycle transition is requested.
    pub fn run_once(&mut self) {
        if self.time_went_back() {
            services::follow_reset(self);
        }
        if self.clock.phase() == Phase::Playing
            && self.clock.is_over(self.world.time())
            && !self.shared_time.is_follower()
        {
            self.clock.set_phase(Phase::Paused);
            self.time_status.is_over(self.clock.duration());
        }
        if !self.may_advance() {
            self.clock.interrupt();
            return self.wait_until(|s| {
                s.take_commands(f64::NEG_INFINITY);
                s.may_advance()
            });
        }
        if !self.clock.is_released() && !self.steps.is_pending() {
            let since = Instant::now();
            self.time_status.begin_wait();
            return self.wait_until(|s| {
                let seconds = long_wait(since).unwrap_or(0);
                s.time_status
                    .is_held(seconds, &s.commands.missing_command_reason());
                s.take_commands(f64::NEG_INFINITY);
                s.clock.is_released()
                    || !s.may_advance()
                    || s.steps.is_pending()
                    || s.time_went_back()
            });
        }
        if !self.shared_time.is_complete() {
            self.clock.interrupt();
            return self.wait_for_robots(|s| s.shared_time.is_complete());
        }
        self.clock.run(self.world.time());
        if self.params.lockstep {
            self.time_status.in_lockstep();
            self.wait_for_response();
        }
        match (self.shared_time.is_follower(), self.params.lockstep) {
            (true, true) => self.wait_for_robots(Self::is_in_step),
            (true, false) => {
                self.wait_for_robots(Self::is_in_step);
                self.wait_for_late_response();
            }
            (false, true) => {
                if !self.is_in_step() {
                    self.wait_for_robots(Self::is_in_step);
                }
                self.wait_for_pace();
            }
            (false, false) => self.wait_for_tick(),
        }
        // A service call may have paused, changed or restarted the simulation meanwhile.
        if self.is_advancing()
            && self.is_answered()
            && (self.is_in_step() || self.owns_real_time())
            && self.node.ok()
        {
            self.tick();
        }
    }

    /// Whether the other robots permit time to advance to the next state.
    fn is_in_step(&self) -> bool {
        self.shared_time.may_reach(self.world.next_tick())
    }

    /// Whether time follows the computer's clock, whether or not other robots keep up.
    fn owns_real_time(&self) -> bool {
        !self.params.lockstep && !self.shared_time.is_follower()
    }

    /// Whether the other node that owns the time was reset.
    fn time_went_back(&self) -> bool {
        self.shared_time.went_back(self.world.time())
    }

    /// Waits for other robots until `done`.
    fn wait_for_robots(&mut self, done: impl Fn(&Self) -> bool) {
        let since = Instant::now();
        self.time_status.begin_wait();
        self.wait_until(|s| {
            let time = s.world.time();
            match (s.shared_time.leader(), long_wait(since)) {
                (Some(leader), Some(_)) if s.shared_time.stands_still(time) => {
                    s.time_status.is_stopped_by(leader, time);
                }
                (_, Some(seconds)) => {
                    (s.time_status).waits_for_robots(seconds, &s.shared_time.awaited_robots(time));
                }
                (_, None) => {}
            }
            s.take_commands(f64::NEG_INFINITY);
            done(s) || !s.may_advance() || s.time_went_back()
        });
    }

    /// Answers service calls while the node is inactive, without simulating.
    pub fn idle(&mut self) {
        self.clock.interrupt();
        services::answer_calls(self);
        self.commands.discard();
        self.motions.discard(INACTIVE);
        self.grippers.discard(INACTIVE);
        if let Some(inputs) = &mut self.wrench_inputs {
            inputs.discard(INACTIVE);
        }
        if let Some(inputs) = &mut self.actuator_inputs {
            inputs.discard();
        }
        self.time_status.is_inactive();
        self.node.wait_for(REPUBLISH_PERIOD);
    }

    /// The node is deactivated: halts the robot and ends requested steps.
    pub fn deactivate(&mut self) {
        self.world.halt_all();
        self.motions.abort("the node was deactivated");
        (self.grippers).abort(&self.world, "the node was deactivated");
        self.commands.deactivate();
        self.steps.end("the node was deactivated");
    }

    /// Whether the node may simulate.
    pub(super) fn is_active(&self) -> bool {
        self.lifecycle.is_active()
    }

    /// Stops time. Time is first advanced to the next tick, so that later steps are whole ones.
    pub(super) fn pause(&mut self, phase: Phase) {
        if self.world.is_between_ticks() {
            self.step_to_tick();
        }
        self.clock.set_phase(phase);
        self.time_status.stands_still(phase);
    }

    /// Resets commands, pacing and response tracking after time or state was reset.
    pub(super) fn restart(&mut self) {
        self.world.halt_all();
        self.motions.abort("the simulation was reset");
        self.motions.discard("the simulation was reset");
        (self.grippers).abort(&self.world, "the simulation was reset");
        self.grippers.discard("the simulation was reset");
        self.commands.restart();
        if let Some(inputs) = &mut self.actuator_inputs {
            inputs.restart();
        }
        self.clock.restart();
        self.shared_time.restart();
    }

    /// Whether phase, requested steps and lifecycle permit time to advance.
    fn may_advance(&self) -> bool {
        let wanted = self.clock.phase() == Phase::Playing || self.steps.is_pending();
        wanted && self.is_active() && !self.lifecycle.is_asked()
    }

    /// Whether the current state has the commands for which lockstep waits. Always true without lockstep.
    fn is_answered(&self) -> bool {
        let is_moving = self.motions.is_moving(&self.world);
        let inputs = self.actuator_inputs.as_ref();
        self.commands.may_advance(is_moving) && inputs.is_none_or(ActuatorInputs::may_advance)
    }

    /// Why an awaited command is missing.
    fn missing_command_reason(&self) -> String {
        let inputs = self.actuator_inputs.as_ref();
        let wheels = inputs.and_then(ActuatorInputs::missing_command_reason);
        wheels.unwrap_or_else(|| self.commands.missing_command_reason())
    }

    /// Outside lockstep, steps the world to the simulated time `now` \[s\], at which a command takes effect.
    pub(super) fn step_to_command(&mut self, now: f64) {
        if self.clock.is_released() && !self.params.lockstep {
            let stepped = self.world.step_within_tick_or_restore(now);
            self.robot_status.stepped(stepped);
        }
    }

    /// Whether time has advanced without interruption since [`SimulationClock::run`].
    fn is_advancing(&self) -> bool {
        self.may_advance() && self.clock.is_running() && !self.time_went_back()
    }

    /// Applies pending commands. Outside lockstep the world is first stepped to the simulated time `now` \[s\], so that
    /// a command takes effect when it arrives.
    fn take_commands(&mut self, now: f64) {
        // A publisher that floods the topic must not stall simulated time.
        for _ in 0..MAX_COMMANDS {
            let Self {
                commands,
                motions,
                world,
                ..
            } = self;
            let is_present = |publisher| motions.is_matched(publisher);
            let Some(command) = commands.next(world.time(), is_present) else {
                break;
            };
            if !commands.admit(&command, world, is_present) {
                continue;
            }
            self.step_to_command(now);
            self.commands.apply(&command, &mut self.world);
            self.clock.release();
        }
        motions::take(self);
        gripper_actions::take(self);
        wrench_inputs::take(self);
        actuator_inputs::take(self, now);
    }

    /// Advances to the next state and publishes it; counts it as a requested step.
    fn tick(&mut self) {
        self.commands.check_age(&mut self.world);
        if let Some(inputs) = &mut self.actuator_inputs {
            inputs.check_age(&mut self.world);
        }
        self.step_to_tick();
        let time = self.world.time();
        self.time_status
            .count_unanswered(self.commands.unanswered());
        if let Some(factor) = self.clock.achieved(time) {
            self.time_status.achieved(time, factor);
        }
        let lag = self.shared_time.lag(time);
        if let (Some(leader), true) = (self.shared_time.leader(), lag > LARGE_LAG) {
            self.time_status.catches_up(leader, lag);
        }
        if self.steps.count() {
            self.pause(Phase::Paused);
        }
    }

    /// Advances to the next state and publishes it.
    fn step_to_tick(&mut self) {
        let stepped = self.world.step_to_tick_or_restore();
        self.robot_status.stepped(stepped);
        for checked in [self.world.check_grasps(), self.world.check_contacts()] {
            if let Err(problem) = checked {
                tracing::error!("{problem}");
            }
        }
        self.clock.release();
        self.commands.expect_response(self.world.time());
        if let Some(inputs) = &mut self.actuator_inputs {
            inputs.expect();
        }
        self.publish();
        motions::follow(self);
        gripper_actions::follow(self);
        self.robot_status.report(&self.world.robot);
    }

    /// Answers service calls, and publishes the current state periodically, until `done`, the node stops or a lifecycle
    /// transition is requested.
    fn wait_until(&mut self, mut done: impl FnMut(&mut Self) -> bool) {
        let mut next = Instant::now() + REPUBLISH_PERIOD;
        loop {
            services::answer_calls(self);
            self.shared_time.take();
            if !self.node.ok() || self.lifecycle.is_asked() || done(self) {
                return;
            }
            self.node
                .wait_for(next.saturating_duration_since(Instant::now()));
            if Instant::now() >= next {
                self.publish();
                next += REPUBLISH_PERIOD;
            }
        }
    }

    /// Lockstep: waits for the commands that carry the stamp of the current state.
    fn wait_for_response(&mut self) {
        let since = Instant::now();
        self.time_status.begin_wait();
        self.wait_until(|s| {
            if let Some(seconds) = long_wait(since) {
                let stamp = Time::from_secs_f64(s.world.time());
                let reason = s.missing_command_reason();
                (s.time_status).waits_for_response(seconds, stamp, &reason);
            }
            s.take_commands(f64::NEG_INFINITY);
            s.is_answered() || !s.is_advancing()
        });
    }

    /// Lockstep in real time: waits until the next state is due.
    fn wait_for_pace(&mut self) {
        let due = self.clock.due(self.world.next_tick());
        while self.node.ok() && self.is_advancing() && Instant::now() < due {
            self.node
                .wait_for(due.saturating_duration_since(Instant::now()));
            services::answer_calls(self);
        }
    }

    /// Real time owned by another node: waits up to `answer_timeout` for the response to the current state, if one is
    /// due. The owner of the time waits for this robot meanwhile.
    fn wait_for_late_response(&mut self) {
        let latest = Instant::now() + Duration::from_secs_f64(self.params.answer_timeout);
        let mut is_late = false;
        while self.commands.response_is_due() && self.is_in_step() && self.is_advancing() {
            let now = Instant::now();
            if now >= latest || !self.node.wait_for(latest - now) {
                break;
            }
            is_late = true;
            services::answer_calls(self);
            self.shared_time.take();
            self.take_commands(f64::NEG_INFINITY);
        }
        if is_late {
            self.time_status.count_late_response();
        }
    }

    /// Real time: applies commands as they arrive until the next state is due, or until `answer_timeout` after that
    /// while the response to the current state is due.
    fn wait_for_tick(&mut self) {
        let due = self.clock.due(self.world.next_tick());
        let latest = due + Duration::from_secs_f64(self.params.answer_timeout);
        let mut repeat = due + REPUBLISH_PERIOD;
        let mut is_late = false;
        loop {
            services::answer_calls(self);
            self.shared_time.take();
            if !self.is_advancing() {
                break;
            }
            // While time waits for an answer, the answer takes effect at the state that it answers, as in lockstep: if
            // the world were stepped with the previous efforts first, every answer would be late by a whole period.
            let is_held = Instant::now() >= due && self.commands.response_is_due();
            self.take_commands(match is_held {
                true => f64::NEG_INFINITY,
                false => self.clock.time_of(Instant::now()),
            });
            let now = Instant::now();
            let response_is_due = self.commands.response_is_due();
            let robot_is_due = self.shared_time.is_awaiting_follower();
            let end = match now >= due && (response_is_due || robot_is_due) {
                true => latest,
                false => due,
            };
            if now >= end {
                break;
            }
            is_late |= now >= due && response_is_due;
            if now >= repeat {
                if robot_is_due {
                    self.outputs.repeat_time();
                }
                repeat = now + REPUBLISH_PERIOD;
            }
            let next = match end == latest {
                true => end.min(repeat),
                false => end,
            };
            if !self.node.wait_for(next.saturating_duration_since(now)) {
                break;
            }
        }
        if is_late {
            self.time_status.count_late_response();
        }
    }
}

/// Logs a summary of the world, and the parts of the descriptions that cannot be simulated.
fn log_world(params: &DynamicsParams, world: &World) {
    let robot = world.robot.model();
    if let Some(missing) = world.not_simulated() {
        tracing::warn!("{}: {missing}", params.robot.source);
    }
    if let Some(limits) = world.default_effort_limits() {
        tracing::warn!("{}: {limits}", params.robot.source);
    }
    if params.state_rate > 100.0 && !params.lockstep {
        tracing::warn!(
            "state_rate is {} Hz: above 100 Hz a subscriber that dies without notice slows the others for about a minute",
            params.state_rate
        );
    }
    if let Some(loops) = world.robot.loops() {
        tracing::info!(
            "{} loop closures leave {} of {} joints free",
            loops.closures().len(),
            loops.mobility(),
            robot.dof()
        );
    }
    tracing::info!(
        "{}: {} bodies, {} joints, {} kg; {} other free bodies",
        params.robot.source,
        robot.bodies().len(),
        robot.dof(),
        world.robot.total_mass(),
        world.targets.len()
    );
    if let Some(robot) = world.robot.flexible() {
        let system = robot.system();
        tracing::info!(
            "{} appendages with {} modes, {} elastic joints, {} wheels, {} thrusters",
            system.modal_bodies().len(),
            system.modes(),
            system.elastic_joints().len(),
            system.wheels().len(),
            system.thrusters().len()
        );
    }
}
