//! Grasps: latching, holding and releasing targets.

use super::super::{
    divergence,
    external_wrenches::ExternalChange,
    free_body::FreeBody as _,
    params::{DynamicsParams, GraspParams},
    rigid_robot::frame_on_base,
    robot::Robot,
    target::Target,
};
use super::World;
use crate::{
    dynamics::{
        IntegrationMethod, JointPhysics, Momentum,
        capture::{Grasp, JointReaction},
        flexible::FlexibleSystem,
    },
    nodes::{geometry::with_matrix, tip_frame},
};

/// Maximum number of events that are kept.
const MOST_EVENTS: usize = 10_000;

/// Tolerance within which a scheduled event is due \[s\].
const ROUNDING: f64 = 1e-12;

/// A grasp has latched, opened, or could not latch; also used for contacts.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldEvent {
    /// Time \[s\].
    pub time: f64,
    /// Description, as a line.
    pub what: String,
}

/// The grasps of a world.
pub(super) struct Grasps {
    all: Vec<Grasping>,
    method: IntegrationMethod,
    joint_physics: JointPhysics,
    events: Vec<WorldEvent>,
    /// Why a grasp could not latch at its time, if that has happened.
    failure: Option<String>,
    /// Change of momentum and work of the robot due to targets that it held or touched.
    from_targets: ExternalChange,
}

/// A grasp, and its scheduled latching and release.
struct Grasping {
    params: GraspParams,
    grasp: Grasp,
    /// Whether it holds its target.
    is_closed: bool,
    /// Whether it may latch automatically; after it has opened, not before the frames have moved apart.
    is_armed: bool,
    latch_is_due: bool,
    release_is_due: bool,
}

impl Grasping {
    /// Opens the grasp, and schedules its latching and release unless they are before `time`.
    fn arm(&mut self, time: f64) {
        let is_ahead = |at: Option<f64>| at.is_some_and(|at| at >= time - ROUNDING);
        self.is_closed = false;
        self.is_armed = self.params.automatic;
        self.latch_is_due = is_ahead(self.params.at);
        self.release_is_due = is_ahead(self.params.release_at);
    }
}

impl Grasps {
    /// Whether there are no grasps.
    pub fn are_none(&self) -> bool {
        self.all.is_empty()
    }

    /// The grasps configured by the parameters.
    ///
    /// # Errors
    /// A line that names the parameter.
    pub fn new(params: &DynamicsParams, robot: &Robot, targets: &[Target]) -> Result<Self, String> {
        if !params.grasps.is_empty() {
            if let Some(robot) = robot.flexible() {
                check_flexible(robot.system(), params, targets)?;
            }
            if robot.loops().is_some() {
                return Err(
                    "parameter grasps: a robot with loop_closures cannot hold targets; remove one of the two"
                        .to_owned(),
                );
            }
        }
        let all = params.grasps.iter().map(|grasp| {
            let name = &grasp.name;
            let robot_frame = tip_frame(robot.model(), &grasp.frame).or_else(|e| {
                // The grasp frame may be on the base, too.
                robot.model().frame(&grasp.frame).cloned().ok_or_else(|| {
                    format!("parameter {name}.frame: {}", e.replacen("tip_link ", "", 1))
                })
            })?;
            let target = targets.iter().find(|target| target.name == grasp.target);
            let target = target.ok_or_else(|| {
                let known: Vec<_> = targets.iter().map(|t| t.name.as_str()).collect();
                format!(
                    "parameter {name}.target: '{}' is none of the targets ({})",
                    grasp.target,
                    known.join(", ")
                )
            })?;
            let base = &target.body.model().bodies()[0].name;
            let mut grasping = Grasping {
                grasp: Grasp {
                    robot: robot_frame,
                    target: frame_on_base(base, with_matrix(&grasp.X_TG)),
                    latch: grasp.latch,
                    joints: grasp.joints,
                },
                params: grasp.clone(),
                is_closed: false,
                is_armed: false,
                latch_is_due: false,
                release_is_due: false,
            };
            grasping.arm(0.0);
            Ok::<_, String>(grasping)
        });
        Ok(Self {
            all: all.collect::<Result<_, _>>()?,
            method: params.method,
            joint_physics: params.joint_physics,
            events: Vec::new(),
            failure: None,
            from_targets: ExternalChange::default(),
        })
    }

    /// The first time in `(time, end)` at which a grasp is scheduled to latch or open; `end` \[s\] if there is none.
    pub fn next_change(&self, time: f64, end: f64) -> f64 {
        let latches = self.all.iter().filter(|g| g.latch_is_due);
        let releases = self.all.iter().filter(|g| g.release_is_due);
        let times = (latches.filter_map(|g| g.params.at))
            .chain(releases.filter_map(|g| g.params.release_at));
        let within = times.filter(|t| *t > time + ROUNDING);
        within.fold(end, f64::min)
    }

    fn note(&mut self, time: f64, what: String) {
        if self.events.len() < MOST_EVENTS {
            self.events.push(WorldEvent { time, what });
        }
    }

    /// Opens all grasps, and schedules latching and release as at the start, unless they are before `time` \[s\].
    pub fn arm(&mut self, time: f64) {
        for grasping in &mut self.all {
            grasping.arm(time);
        }
        self.failure = None;
    }

    /// As [`Self::arm`], for a robot in its initial state: the effect of targets on it is zero again.
    pub fn reset(&mut self, time: f64) {
        self.arm(time);
        self.from_targets = ExternalChange::default();
    }

    /// Opens all grasps. Those that were closed do not latch automatically before their frames have been apart.
    pub fn open_all(&mut self) {
        for grasping in &mut self.all {
            if std::mem::take(&mut grasping.is_closed) {
                grasping.is_armed = false;
            }
        }
    }
}

/// Checks that a robot with flexible parts can hold the targets.
///
/// # Errors
/// A line that names the parameter.
fn check_flexible(
    robot: &FlexibleSystem,
    params: &DynamicsParams,
    targets: &[Target],
) -> Result<(), String> {
    if !robot.is_gyrostat() {
        return Err(
            "parameter grasps: a robot with appendages, elastic links or elastic joints cannot hold targets; \
             one with wheels and thrusters can; remove one of the two"
                .to_owned(),
        );
    }
    let is_held = |target: &&Target| params.grasps.iter().any(|g| g.target == target.name);
    for target in targets.iter().filter(is_held) {
        let name = &target.name;
        let system = FlexibleSystem::builder(target.body.model()).build();
        let system = system.map_err(|e| format!("parameter grasps: target '{name}': {e}"))?;
        let joints: Vec<_> = system.unsimulated_joints(&params.joint_physics).collect();
        if !joints.is_empty() {
            return Err(format!(
                "parameter grasps: friction, stops and speed limits of {} of target '{name}' are not simulated while a robot with \
                 wheels or thrusters holds it; switch them off with joint_physics.friction, .stops and .velocity_limits",
                joints.join(", ")
            ));
        }
    }
    Ok(())
}

/// Momentum and kinetic energy of the robot alone.
struct Carried {
    momentum_W: Momentum,
    energy: f64,
}

impl Carried {
    fn of(robot: &Robot) -> Self {
        Self {
            momentum_W: robot.state().momentum_W,
            energy: robot.kinetic_energy(),
        }
    }
}

impl World {
    /// Latches the first grasp whose frames are close enough. Returns a line that describes the result.
    ///
    /// # Errors
    /// A line that says why none latches: the distance of the frames, or the target that is held already.
    pub fn attach(&mut self) -> Result<String, String> {
        if self.grasps.all.is_empty() {
            return Err(
                "the robot has no grasps; the parameter grasps of the dynamics node lists them"
                    .to_owned(),
            );
        }
        let open = (0..self.grasps.all.len()).filter(|i| !self.grasps.all[*i].is_closed);
        let open: Vec<usize> = open.collect();
        if open.is_empty() {
            return Err("all grasps are closed already; detach first".to_owned());
        }
        let mut reasons = Vec::new();
        for i in open {
            match self.latch(i, self.time()) {
                Ok(done) => return Ok(done),
                Err(reason) => reasons.push(reason),
            }
        }
        Err(reasons.join("; "))
    }

    /// Opens all grasps. Returns a line that describes the result.
    ///
    /// # Errors
    /// A line, if no grasp is closed.
    pub fn detach(&mut self) -> Result<String, String> {
        let closed = self.grasps.all.iter().position(|g| g.is_closed);
        let closed = closed.ok_or_else(|| "no grasp is closed".to_owned())?;
        Ok(self.open(closed, self.time()))
    }

    /// Name of the held target.
    pub fn held_target(&self) -> Option<&str> {
        self.robot.held()
    }

    /// The targets that the robot may grasp or touch.
    pub fn coupled_targets(&self) -> impl Iterator<Item = &Target> {
        let is_graspable = |target: &&Target| {
            let mut grasps = self.grasps.all.iter();
            self.has_contact() || grasps.any(|g| g.params.target == target.name)
        };
        self.targets.iter().filter(is_graspable)
    }

    /// Events of grasps so far, oldest first.
    pub fn grasp_events(&self) -> &[WorldEvent] {
        &self.grasps.events
    }

    /// Reports once that a grasp could not latch at its time, if that has happened.
    ///
    /// # Errors
    /// A line with the time, the grasp, and the distance of its frames.
    pub fn check_grasps(&mut self) -> Result<(), String> {
        self.grasps.failure.take().map_or(Ok(()), Err)
    }

    /// Change of momentum and work of the robot by external wrenches, thrusters and targets since the start; `None` if
    /// none has acted.
    pub fn change_from_outside(&self) -> Option<ExternalChange> {
        let has_met = !self.grasps.events.is_empty() || !self.contact_events().is_empty();
        let by_targets = has_met.then_some(self.grasps.from_targets);
        match (self.wrenches.change().copied(), by_targets) {
            (Some(mut sum), Some(other)) => {
                sum.momentum_W.linear += other.momentum_W.linear;
                sum.momentum_W.angular += other.momentum_W.angular;
                sum.work += other.work;
                Some(sum)
            }
            (change, by_targets) => change.or(by_targets),
        }
    }

    /// Opens all grasps without a release spring, because the state is about to be replaced.
    pub(in super::super) fn release_without_spring(&mut self) {
        self.robot.let_go();
        self.grasps.open_all();
    }

    /// Opens all grasps if the robot or the held target has diverged: each is then restored separately.
    pub(super) fn drop_diverged(&mut self) {
        let Some(held) = self.held_target() else {
            return;
        };
        let target = self.target_index(held).map(|i| &self.targets[i].body);
        let is_lost = divergence::of(&self.robot).is_some()
            || target.is_ok_and(|target| divergence::of(target).is_some());
        if is_lost {
            let what = format!("{held} is released, because the motion has diverged");
            self.release_without_spring();
            self.grasps.note(self.time(), what);
        }
    }

    /// Saves the state of the held target, to be restored after a divergence.
    pub(super) fn save_held_target(&mut self) {
        let held = self.held_target().map(|held| self.target_index(held));
        if let Some(Ok(index)) = held {
            self.targets[index].save();
        }
    }

    /// Latches and opens the grasps that are due at `time` \[s\].
    pub(super) fn follow_grasps(&mut self, time: f64) {
        for i in 0..self.grasps.all.len() {
            let grasping = &mut self.grasps.all[i];
            let is_due =
                |due: bool, at: Option<f64>| due && at.is_some_and(|at| at <= time + ROUNDING);
            if is_due(grasping.latch_is_due, grasping.params.at) {
                grasping.latch_is_due = false;
                if !grasping.is_closed
                    && let Err(reason) = self.latch(i, time)
                {
                    let failure = format!("at {time:.3} s: {reason}");
                    self.grasps.note(time, failure.clone());
                    self.grasps.failure = Some(failure);
                }
            }
            let grasping = &mut self.grasps.all[i];
            if is_due(grasping.release_is_due, grasping.params.release_at) {
                grasping.release_is_due = false;
                if grasping.is_closed {
                    self.open(i, time);
                }
            }
            self.follow_automatic(i, time);
        }
    }

    /// Latches grasp `i` automatically, if its frames are close enough.
    fn follow_automatic(&mut self, i: usize, time: f64) {
        let grasping = &self.grasps.all[i];
        if !grasping.params.automatic || grasping.is_closed {
            return;
        }
        let is_near = self.check_close(i).is_ok();
        if is_near && grasping.is_armed {
            // Fails if another target is held.
            let _ = self.latch(i, time);
        } else if !is_near {
            self.grasps.all[i].is_armed = true;
        }
    }

    /// Checks that the frames of grasp `i` are close enough. Returns the target's index.
    fn check_close(&self, i: usize) -> Result<usize, String> {
        let Grasping { params, grasp, .. } = &self.grasps.all[i];
        let at = |e: String| format!("grasp '{}': {e}", params.name);
        let index = self.target_index(&params.target).map_err(at)?;
        let X_WR = self.robot.X_WB() * self.robot.X_BF(&grasp.robot);
        let target = &self.targets[index].body;
        let X_WT = target.X_WB() * target.workspace().X_BF(&grasp.target);
        let apart = grasp.check_poses(&X_WR, &X_WT, params.distance, params.angle);
        apart.map_err(|e| at(e.to_string()))?;
        Ok(index)
    }

    /// Latches grasp `i` at `time` \[s\].
    fn latch(&mut self, i: usize, time: f64) -> Result<String, String> {
        let index = self.check_close(i)?;
        let held = self.held_target().map(str::to_owned);
        let Grasping { params, grasp, .. } = &self.grasps.all[i];
        let (name, target, grasp) = (params.name.clone(), params.target.clone(), grasp.clone());
        let at = |e: String| format!("grasp '{name}': {e}");
        match held {
            Some(other) if other != target => {
                return Err(at(format!(
                    "the robot holds '{other}' already; detach it first"
                )));
            }
            Some(_) if self.grasps.has_locked_joints(i) => {
                return Err(at(
                    "a second grasp needs joints that are not locked, in both grasps".to_owned(),
                ));
            }
            _ => {}
        }
        let before = Carried::of(&self.robot);
        let Self {
            robot,
            targets,
            grasps,
            ..
        } = self;
        let body = &mut targets[index].body;
        let lost = robot
            .grasp(
                (&target, body),
                &grasp,
                grasps.method,
                &grasps.joint_physics,
            )
            .map_err(|e| at(e.to_string()))?;
        grasps.all[i].is_closed = true;
        grasps.all[i].is_armed = false;
        self.count_change_by_targets(&before, &ExternalChange::default());
        let what = format!("grasp '{name}' holds {target}, {lost:.3e} J lost");
        self.grasps.note(time, what.clone());
        Ok(what)
    }

    /// Opens all grasps at `time` \[s\], with the release spring of grasp `i`, which is closed.
    fn open(&mut self, i: usize, time: f64) -> String {
        let params = &self.grasps.all[i].params;
        let (target, spring) = (params.target.clone(), params.spring);
        let before = Carried::of(&self.robot);
        match self.target_index(&target) {
            Ok(index) => {
                let body = &mut self.targets[index].body;
                self.robot.release_target(body, spring.as_ref());
            }
            Err(_) => self.robot.let_go(),
        }
        self.count_change_by_targets(&before, &ExternalChange::default());
        self.grasps.open_all();
        let what = format!("{target} is released");
        self.grasps.note(time, what.clone());
        what
    }

    /// Before a step of a robot that holds or may touch something: data for [`Self::finish_held_step`].
    pub(super) fn begin_held_step(&self) -> Option<HeldStep> {
        if self.held_target().is_none() && self.robot.current_contact_system().is_none() {
            return None;
        }
        Some(HeldStep {
            before: Carried::of(&self.robot),
            known: self.known_change(),
        })
    }

    /// After a step of the robot that began at `time` \[s\]: updates the targets that it holds or may touch.
    pub(super) fn finish_held_step(&mut self, step: HeldStep, time: f64) {
        let (then, now) = (step.known, self.known_change());
        let known = ExternalChange {
            momentum_W: Momentum {
                linear: now.momentum_W.linear - then.momentum_W.linear,
                angular: now.momentum_W.angular - then.momentum_W.angular,
            },
            work: now.work - then.work,
        };
        self.count_change_by_targets(&step.before, &known);
        self.show_held_target();
        self.finish_contact(time);
    }

    /// Copies the motion of the held target in the joined system to the target.
    fn show_held_target(&mut self) {
        let Some(held) = self.held_target() else {
            return;
        };
        if let Ok(index) = self.target_index(held) {
            self.robot.copy_target_to(&mut self.targets[index].body);
        }
    }

    /// Change of momentum by external wrenches so far, and work on robot and held target except by contacts.
    fn known_change(&self) -> ExternalChange {
        let momentum_W = (self.wrenches.change()).map_or_else(Momentum::default, |c| c.momentum_W);
        let work = self.robot.whole_work() - self.robot.contact_work();
        ExternalChange { momentum_W, work }
    }

    /// Attributes the change of the robot since `before`, minus the `known` change by others, to targets.
    fn count_change_by_targets(&mut self, before: &Carried, known: &ExternalChange) {
        let now = Carried::of(&self.robot);
        let change = &mut self.grasps.from_targets;
        let (then, of_others) = (&before.momentum_W, &known.momentum_W);
        change.momentum_W.linear += now.momentum_W.linear - then.linear - of_others.linear;
        change.momentum_W.angular += now.momentum_W.angular - then.angular - of_others.angular;
        change.work += now.energy - before.energy - known.work;
    }
}

impl Grasps {
    /// Whether grasp `i` or a closed grasp locks the robot's joints during the impulse.
    fn has_locked_joints(&self, i: usize) -> bool {
        let is_locked = |g: &Grasping| g.grasp.joints == JointReaction::Locked;
        is_locked(&self.all[i]) || self.all.iter().any(|g| g.is_closed && is_locked(g))
    }
}

/// Data before a step, see [`World::begin_held_step`].
pub(super) struct HeldStep {
    before: Carried,
    known: ExternalChange,
}

#[cfg(test)]
mod tests;
