//! Motions of the whole arm commanded by other nodes: joint trajectories by action and topic, paths and twists of the
//! tip.
//!
//! | interface | type | begins |
//! | --- | --- | --- |
//! | action `follow_joint_trajectory` | control_msgs/FollowJointTrajectory | a trajectory with tolerances, feedback and a result |
//! | `joint_trajectory` | trajectory_msgs/JointTrajectory | a trajectory |
//! | `cartesian_path` | nav_msgs/Path | a path of the tip through timed poses |
//! | `delta_twist_cmds` | geometry_msgs/TwistStamped | streamed twists of the tip, as for MoveIt Servo |
//!
//! Messages are checked and answered by the simulation thread, between two steps, like service calls. An invalid
//! message has no effect; the mistake is logged and reported in `diagnostics` in one line.

mod goal;
mod messages;
mod refusals;

use nalgebra::UnitQuaternion;

use super::{
    command_arbiter::Commander,
    messages::WORLD,
    params::{BaseReaction, DynamicsParams},
    simulation::Simulation,
    step_status::StepStatus,
    world::World,
};
use crate::{
    control::commander::{
        ArmMotion, BaseState, JointSpline, KeptTip, TipFollower, TipResolver, TwistAxes,
        TwistServo, TwistStatus,
    },
    model::Frame,
    msg::{
        control_msgs::follow_joint_trajectory::FollowJointTrajectory, geometry_msgs::TwistStamped,
        nav_msgs::Path, trajectory_msgs::JointTrajectory,
    },
    nodes::{tip::tip_frame, topics},
    ros::{ActionServer, Gid, GoalRequest, Node, NodeError, Received, Subscription},
};
use goal::ActiveGoal;
pub use messages::link_names;
pub use refusals::Refusals;

/// Maximum number of messages per topic that one call of [`take`] handles, so that a flood cannot stall simulated time.
const MAX_MESSAGES: usize = 64;

/// The action and the subscriptions.
struct Endpoints {
    action: ActionServer<FollowJointTrajectory>,
    trajectories: Subscription<JointTrajectory>,
    paths: Subscription<Path>,
    twists: Subscription<TwistStamped>,
}

impl Endpoints {
    fn new(node: &Node) -> Result<Self, NodeError> {
        let trajectories = topics::JOINT_TRAJECTORY.subscribe(node)?;
        let paths = topics::CARTESIAN_PATH.subscribe(node)?;
        let twists = topics::TWIST_COMMANDS.subscribe(node)?;
        // Queues keep messages per publisher, so that one publisher cannot crowd out another.
        trajectories.separate_publishers();
        paths.separate_publishers();
        twists.separate_publishers();
        Ok(Self {
            action: ActionServer::with_requests(node, "follow_joint_trajectory")?,
            trajectories,
            paths,
            twists,
        })
    }
}

/// Inputs for motions, and the active goal.
pub struct Motions {
    /// `None` without the parameter `commander_interfaces`.
    endpoints: Option<Endpoints>,
    goal: Option<ActiveGoal>,
    /// Value of [`JointDrive::changes`](super::joint_drive::JointDrive::changes) when the last motion began; `None`
    /// after its end.
    begun: Option<u64>,
    /// Status of streamed twists that was reported last; `None` while the arm does not follow twists.
    twists_are: Option<TwistStatus>,
    /// The tip frame, or the reason why there is none.
    tip: Result<Frame, String>,
    refusals: Refusals,
    status: StepStatus,
}

impl Motions {
    /// Offers the interfaces.
    ///
    /// # Errors
    /// When DDS reports an error.
    pub fn new(node: &Node, params: &DynamicsParams, world: &World) -> Result<Self, NodeError> {
        let mut status = StepStatus::new(node.diagnostics().status("motions"));
        status.ok("no motion was asked for yet");
        Ok(Self {
            endpoints: match params.motions.interfaces {
                true => Some(Endpoints::new(node)?),
                false => None,
            },
            goal: None,
            begun: None,
            twists_are: None,
            tip: tip_of(world, &params.motions.tip_link),
            refusals: Refusals::default(),
            status,
        })
    }

    /// Whether a publisher of one of the topics is in the graph.
    pub fn is_matched(&self, publisher: Gid) -> bool {
        self.endpoints.as_ref().is_some_and(|endpoints| {
            endpoints.trajectories.is_matched(publisher)
                || endpoints.paths.is_matched(publisher)
                || endpoints.twists.is_matched(publisher)
        })
    }

    /// Whether the arm moves without further commands: a goal is active, a motion has not ended, or twists are not
    /// silent.
    pub fn is_moving(&self, world: &World) -> bool {
        let end = world.drive().motion_end();
        let is_silent = self.twists_are == Some(TwistStatus::Silent);
        self.goal.is_some() || (world.time() < end && !(end.is_infinite() && is_silent))
    }

    /// Drops pending messages and rejects pending goals.
    pub fn discard(&mut self, reason: &str) {
        while let Some(request) = self.next_goal() {
            request.reject();
            tracing::warn!("follow_joint_trajectory: refused, {reason}");
        }
        while self.next_trajectory().is_some() {}
        while self.next_path().is_some() {}
        while self.next_twist().is_some() {}
    }

    fn next_goal(&mut self) -> Option<GoalRequest<FollowJointTrajectory>> {
        self.endpoints.as_mut()?.action.take_request()
    }

    fn next_trajectory(&mut self) -> Option<Received<JointTrajectory>> {
        self.endpoints.as_mut()?.trajectories.take()
    }

    fn next_path(&mut self) -> Option<Received<Path>> {
        self.endpoints.as_mut()?.paths.take()
    }

    fn next_twist(&mut self) -> Option<Received<TwistStamped>> {
        self.endpoints.as_mut()?.twists.take()
    }

    /// Aborts the active goal.
    pub fn abort(&mut self, reason: &str) {
        self.begun = None;
        if let Some(goal) = self.goal.take() {
            goal.abort(reason);
        }
    }
}

/// The tip frame; an empty `tip_link` is `tool0`, or the last link.
fn tip_of(world: &World, tip_link: &str) -> Result<Frame, String> {
    let model = world.robot.model();
    match tip_link {
        "" if model.frame("tool0").is_some() => tip_frame(model, "tool0"),
        "" => {
            let last = model
                .frames()
                .last()
                .map_or("", |frame| frame.name.as_str());
            tip_frame(model, last)
        }
        name => tip_frame(model, name),
    }
}

/// Handles cancellations, pending goals and pending messages.
pub fn take(simulation: &mut Simulation) {
    cancel(simulation);
    for _ in 0..MAX_MESSAGES {
        let Some(request) = simulation.motions.next_goal() else {
            break;
        };
        goal::begin(simulation, request);
    }
    for _ in 0..MAX_MESSAGES {
        let Some(received) = simulation.motions.next_trajectory() else {
            break;
        };
        let outcome = begin_trajectory(simulation, &received);
        answer(simulation, "joint_trajectory", outcome);
    }
    for _ in 0..MAX_MESSAGES {
        let Some(received) = simulation.motions.next_path() else {
            break;
        };
        let outcome = begin_path(simulation, &received);
        answer(simulation, "cartesian_path", outcome);
    }
    for _ in 0..MAX_MESSAGES {
        let Some(received) = simulation.motions.next_twist() else {
            break;
        };
        let outcome = take_twist(simulation, &received);
        answer(simulation, "delta_twist_cmds", outcome);
    }
}

/// Reports why a message was refused.
fn answer(simulation: &mut Simulation, topic: &str, outcome: Result<(), String>) {
    if let Err(problem) = outcome {
        let motions = &mut simulation.motions;
        motions
            .refusals
            .report(&mut motions.status, topic, &problem);
    }
}

/// Checks that the commander holds the robot or could get it.
fn check_free(simulation: &Simulation, commander: Commander) -> Result<(), String> {
    let is_present = |publisher| simulation.motions.is_matched(publisher);
    (simulation.commands.check_free(commander, is_present))
        .map_err(|problem| format!("it is {problem}"))
}

/// Makes the commander the holder of the robot.
fn engage(simulation: &mut Simulation, commander: Commander) -> Result<(), String> {
    let Simulation {
        commands,
        motions,
        world,
        ..
    } = simulation;
    let is_present = |publisher| motions.is_matched(publisher);
    (commands.engage(commander, world, is_present)).map_err(|problem| format!("it is {problem}"))
}

/// Begins a motion on behalf of the commander that holds the robot.
fn begin(simulation: &mut Simulation, motion: ArmMotion) {
    let is_streamed = matches!(motion, ArmMotion::Twist(_));
    simulation.world.begin(motion);
    simulation.commands.begin_motion(is_streamed);
    simulation.clock.release();
    simulation.motions.begun = Some(simulation.world.drive().motion_count());
}

fn base_of(world: &World) -> BaseState {
    world.robot.base_state()
}

/// A follower of tip motions that begins with the joints' current motion.
fn follower(world: &World, tip: &Frame, reaction: BaseReaction, limits: bool) -> TipFollower {
    let model = world.robot.model();
    let (kept, is_least) = match reaction {
        BaseReaction::Free => (KeptTip::Pose, false),
        BaseReaction::Least(kept) => (kept, true),
    };
    let resolver = TipResolver::new(model, tip, kept, is_least);
    let resolver = match limits {
        true => resolver,
        false => resolver.without_limits(),
    };
    TipFollower::new(model, resolver, &world.drive().current_motion(&world.robot))
}

/// The motion that follows a trajectory's spline.
fn trajectory_motion(simulation: &Simulation, spline: JointSpline) -> Result<ArmMotion, String> {
    match simulation.params.base_reaction.get() {
        BaseReaction::Free => Ok(ArmMotion::Joints(spline)),
        reaction => {
            let tip = simulation.motions.tip.clone()?;
            let follower = follower(&simulation.world, &tip, reaction, true);
            Ok(ArmMotion::least_reaction(spline, follower))
        }
    }
}

fn begin_trajectory(
    simulation: &mut Simulation,
    received: &Received<JointTrajectory>,
) -> Result<(), String> {
    let message = &received.message;
    let (trajectory, start) = {
        let world = &simulation.world;
        messages::trajectory(message, world.robot.model(), world.time())
            .map_err(|problem| format!("it {problem}"))?
    };
    let (spline, end) = spline(simulation, &trajectory, start)?;
    let motion = trajectory_motion(simulation, spline)?;
    engage(simulation, Commander::Publisher(received.publisher))?;
    begin(simulation, motion);
    simulation
        .motions
        .status
        .ok(format!("a joint trajectory until {end:.2} s"));
    Ok(())
}

/// Refuses motions of a robot with closed loops, whose joints are not independent.
fn check_tree(world: &World) -> Result<(), String> {
    match world.robot.loops().is_none() {
        true => Ok(()),
        false => Err(
            "the robot has closed loops; motions are for robots without, use joint_commands"
                .to_owned(),
        ),
    }
}

/// The spline that leads from the joints' current motion along the trajectory, and the end of the trajectory \[s\].
fn spline(
    simulation: &Simulation,
    trajectory: &crate::control::commander::JointTrajectory,
    start: f64,
) -> Result<(JointSpline, f64), String> {
    let world = &simulation.world;
    check_tree(world)?;
    let present = world.drive().current_motion(&world.robot);
    let model = world.robot.model();
    let spline =
        (trajectory.spline(model, start, world.time(), &present)).map_err(|e| format!("it {e}"))?;
    let end = start + trajectory.duration();
    // A trajectory whose only point is at the current time gets the time that it needs.
    let end = if end > world.time() {
        end
    } else {
        spline.end()
    };
    Ok((spline, end))
}

fn begin_path(simulation: &mut Simulation, received: &Received<Path>) -> Result<(), String> {
    let tip = simulation.motions.tip.clone()?;
    let world = &simulation.world;
    check_tree(world)?;
    let base_name = world.robot.model().frames()[0].name.clone();
    let (path, start) = messages::path(&received.message, &base_name, world.time())
        .map_err(|problem| format!("it {problem}"))?;
    let reaction = simulation.params.base_reaction.get();
    let mut follower = follower(world, &tip, reaction, true);
    let (X, V) = follower.tip(&base_of(world), path.frame());
    let spline = (path.spline(start, world.time(), &X, &V)).map_err(|e| format!("it {e}"))?;
    let end = spline.end();
    engage(simulation, Commander::Publisher(received.publisher))?;
    begin(simulation, ArmMotion::path(spline, follower));
    simulation
        .motions
        .status
        .ok(format!("a path of the tip until {end:.2} s"));
    Ok(())
}

fn take_twist(
    simulation: &mut Simulation,
    received: &Received<TwistStamped>,
) -> Result<(), String> {
    let tip = simulation.motions.tip.clone()?;
    check_tree(&simulation.world)?;
    let config = simulation.params.motions.twist;
    let now = simulation.world.time();
    let twist = messages::twist(&received.message, now, config.incoming_command_timeout)
        .map_err(|problem| format!("it {problem}"))?;
    let axes = twist_axes(&simulation.world, &received.message.header.frame_id)
        .map_err(|problem| format!("it {problem}"))?;
    engage(simulation, Commander::Publisher(received.publisher))?;
    if simulation.world.twist_servo().is_none() {
        let model = simulation.world.robot.model().clone();
        let follower = follower(&simulation.world, &tip, BaseReaction::Free, false);
        let servo = TwistServo::new(&model, follower, config);
        begin(simulation, ArmMotion::Twist(Box::new(servo)));
    }
    simulation.clock.release();
    if let Some(servo) = simulation.world.twist_servo() {
        servo.command(axes, twist, now);
    }
    Ok(())
}

/// The axes in which the frame `frame_id` gives twists.
fn twist_axes(world: &World, frame_id: &str) -> Result<TwistAxes, String> {
    let model = world.robot.model();
    let name = match frame_id {
        "" => model.frames()[0].name.as_str(),
        name => name,
    };
    if name == WORLD {
        return Ok(TwistAxes::World(UnitQuaternion::identity()));
    }
    if let Some(frame) = model.frame(name) {
        return Ok(TwistAxes::Robot(frame.clone()));
    }
    if let Ok(index) = world.target_index(name) {
        return Ok(TwistAxes::World(world.targets[index].body.state().R_WB));
    }
    Err(format!(
        "has frame_id '{name}'; give world, the name of a target or a link of the robot: {}",
        link_names(model)
    ))
}

/// If a client has asked to cancel the goal: ends it, and brings the joints to rest.
fn cancel(simulation: &mut Simulation) {
    let is_cancelled = |goal: &mut ActiveGoal| goal.is_canceling();
    let Some(goal) = simulation.motions.goal.take_if(is_cancelled) else {
        return;
    };
    stop(simulation);
    let text = format!(
        "cancelled at {:.3} s: the joints are stopped",
        simulation.world.time()
    );
    simulation.motions.status.ok(text.clone());
    goal.canceled(text);
}

/// Brings the joints to rest, and releases the robot from its holder.
fn stop(simulation: &mut Simulation) {
    let world = &simulation.world;
    let present = world.drive().current_motion(&world.robot);
    let stop = JointSpline::stop(world.robot.model(), world.time(), &present);
    begin(simulation, ArmMotion::Joints(stop));
    simulation.commands.end_motion();
    simulation.motions.begun = None;
}

/// After a step: follows the goal's progress, and releases the robot from its holder when a motion is over.
pub fn follow(simulation: &mut Simulation) {
    if let Some(servo) = simulation.world.twist_servo() {
        let status = servo.status();
        report_twists(status, simulation);
        return;
    }
    simulation.motions.twists_are = None;
    let Some(begun) = simulation.motions.begun else {
        return;
    };
    if simulation.world.drive().motion_count() != begun {
        let text = "the motion was ended: the arm was commanded otherwise, reset, or has diverged";
        simulation.motions.abort(text);
        simulation.commands.end_motion();
        return;
    }
    if simulation.motions.goal.is_some() {
        goal::follow(simulation);
        return;
    }
    let end = simulation.world.drive().motion_end();
    if simulation.world.time() >= end {
        simulation.motions.begun = None;
        simulation.commands.end_motion();
        simulation
            .motions
            .status
            .ok("the last motion is over; the arm is held");
    }
}

fn report_twists(status: TwistStatus, simulation: &mut Simulation) {
    if simulation.motions.twists_are == Some(status) || simulation.motions.refusals.is_shown() {
        return;
    }
    simulation.motions.twists_are = Some(status);
    let name = |j: usize| simulation.world.robot.model().joints()[j].name.clone();
    let problem = match status {
        TwistStatus::Following | TwistStatus::Silent => None,
        TwistStatus::Approaching => Some("near a singular position: the tip slows down".to_owned()),
        TwistStatus::Halted => Some("too near a singular position: the tip has halted".to_owned()),
        TwistStatus::Leaving => {
            Some("leaving a singular position: the tip moves slowly".to_owned())
        }
        TwistStatus::JointBound(j) => Some(format!(
            "joint '{}' is near its position limit: the tip slows down",
            name(j)
        )),
        TwistStatus::RateLimit(j) => Some(format!(
            "joint '{}' is at its rate limit: the tip is slower than commanded",
            name(j)
        )),
        TwistStatus::TooFast => Some(
            "the twist exceeds twist_servo.max_linear_speed or max_angular_speed: it is cut"
                .to_owned(),
        ),
    };
    let motions = &mut simulation.motions;
    match (problem, status) {
        (Some(problem), _) => motions.status.warn(problem),
        (None, TwistStatus::Silent) => {
            (motions.status).ok("no twist for incoming_command_timeout: the joints are halted");
        }
        (None, _) => motions.status.ok("the tip follows twists"),
    }
}
