//! The simulated world: the robot and the free bodies, at one time.

mod contact;
mod effort_tick;
#[cfg(test)]
mod flexible_tests;
mod grasping;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod wrist_tests;

pub use contact::LinkContact;
use contact::WorldContacts;
pub use effort_tick::EffortTick;
use grasping::Grasps;
pub use grasping::WorldEvent;

use super::divergence::{self, StateBackup};
use super::excitations::Excitations;
use super::external_wrenches::{ExternalChange, ExternalWrench, ExternalWrenches, WrenchAxes};
use super::free_body::{FreeBody as _, Restorable};
use super::imu::ImuParams;
use super::joint_command::Setpoint;
use super::joint_drive::{DriveMode, JointDrive, step_count};
use super::mean_efforts::MeanEfforts;
use super::params::DynamicsParams;
use super::robot::{Robot, RobotState};
use super::target::Target;
use super::tick_time::TickTime;
use super::wrist::Wrist;
use nalgebra::Vector3;

use crate::{
    control::{
        GripperGoal,
        commander::{ArmMotion, TwistServo},
        with_default_effort_limits,
    },
    model::Model,
    spatial::{Twist, Wrench},
    vision::{StarTracker, StarTrackerFrame},
};

/// Name of the robot in messages.
const ROBOT: &str = "the robot";

/// The robot and the free bodies, with a common time, and their grasps and contacts.
pub struct World {
    /// The robot.
    pub robot: Robot,
    /// The free bodies.
    pub targets: Vec<Target>,
    /// Initial state of the robot.
    start: RobotState,
    /// The robot's state before the last step.
    backup: StateBackup<Robot>,
    drive: JointDrive,
    wheel_torques: MeanEfforts,
    wrenches: ExternalWrenches,
    grasps: Grasps,
    contacts: Option<WorldContacts>,
    imu: ImuParams,
    pub(super) wrist: Option<Wrist>,
    /// Random walk of the gyro's bias up to the last tick \[rad/s\].
    gyro_walk: Vector3<f64>,
    star_tracker: Option<StarTracker>,
    time: TickTime,
    /// Longest integration step \[s\].
    time_step: f64,
    /// Names of the joints with a default effort limit, and the acceleration that gives it \[rad/s² or m/s²\].
    default_limits: (Vec<String>, f64),
    /// See [`World::not_simulated`].
    not_simulated: Option<String>,
}

impl World {
    /// The world in its initial state, as configured by the parameters.
    ///
    /// # Errors
    /// A line that names the file or parameter.
    pub fn new(params: &DynamicsParams) -> Result<Self, String> {
        let described = params.robot.compile()?;
        let (model, default_limits) = limited(&described, params.default_joint_acceleration);
        let robot = Robot::new(params, &model)?;
        if let Some(what) = divergence::of(&robot) {
            return Err(format!(
                "the robot cannot be simulated from its start: {what}"
            ));
        }
        let wheels = robot.flexible().map_or(&[][..], |r| r.system().wheels());
        let excitations = Excitations::new(&params.excitations, robot.model(), wheels)?;
        let targets = params.targets.iter();
        let targets =
            targets.map(|target| Target::new(target, params.method, &params.joint_physics));
        let targets = targets.collect::<Result<Vec<_>, _>>()?;
        let mut world = Self {
            grasps: Grasps::new(params, &robot, &targets)?,
            wrist: Wrist::new(&params.wrist, &robot)?,
            contacts: WorldContacts::new(params, &robot, &targets)?,
            not_simulated: not_simulated(&robot, params),
            drive: JointDrive::new(&robot, &params.drive, &params.grippers)?,
            wheel_torques: MeanEfforts::new(wheels.len()),
            wrenches: ExternalWrenches::new(robot.model()).with_excitations(excitations),
            start: robot.saved(),
            backup: StateBackup::new(&robot),
            robot,
            targets,
            imu: params.imu,
            gyro_walk: Vector3::zeros(),
            star_tracker: params.star_tracker.clone().map(StarTracker::new),
            time: TickTime::new(params.state_rate),
            time_step: params.time_step,
            default_limits,
        };
        world.follow_grasps(0.0);
        world.check_grasps()?;
        world.begin_contact()?;
        Ok(world)
    }

    /// Time \[s\].
    pub fn time(&self) -> f64 {
        self.time.now()
    }

    /// Time of the next tick, at which the next state is published \[s\].
    pub(super) fn next_tick(&self) -> f64 {
        self.time.next_tick()
    }

    /// Number of the last tick.
    pub(super) fn ticks(&self) -> u64 {
        self.time.ticks()
    }

    /// Index of the target called `name`.
    ///
    /// # Errors
    /// A line that lists the known targets.
    pub fn target_index(&self, name: &str) -> Result<usize, String> {
        let found = self.targets.iter().position(|t| t.name == name);
        found.ok_or_else(|| {
            let known: Vec<_> = self.targets.iter().map(|t| t.name.as_str()).collect();
            match known.as_slice() {
                [] => format!("'{name}' is not there: the dynamics node has no targets"),
                _ => format!("'{name}' is not one of {}", known.join(", ")),
            }
        })
    }

    /// Resets time to zero; bodies keep their states, but held targets are released.
    pub(super) fn reset_time(&mut self) {
        self.wrenches.clear(None);
        self.release_without_spring();
        self.time.reset();
        self.grasps.arm(0.0);
        self.gyro_walk = Vector3::zeros();
    }

    /// Robot and free bodies return to their initial states, or to those in which they were spawned. All commands,
    /// wrenches and grasps end.
    pub(super) fn reset_state(&mut self) {
        self.robot.restore(&self.start);
        self.grasps.reset(self.time.now());
        self.reset_contact();
        self.drive.reset(&mut self.robot);
        self.wrenches.reset(&mut self.robot);
        self.wheel_torques.reset();
        for target in &mut self.targets {
            target.reset();
        }
    }

    /// Parameters of the inertial measurement unit.
    pub(super) fn imu(&self) -> &ImuParams {
        &self.imu
    }

    /// Current bias of the gyro \[rad/s\].
    pub(super) fn gyro_bias(&self) -> Vector3<f64> {
        self.imu.gyro_bias + self.gyro_walk
    }

    /// Exposes the star tracker to the current attitude. Call this once for every state.
    pub fn expose_star_tracker(&mut self) {
        let time = self.time.now();
        if let Some(tracker) = &mut self.star_tracker {
            tracker.show(time, &self.robot.state().R_WB);
        }
    }

    /// The next attitude that the star tracker has ready at the current time, oldest first.
    pub fn next_star_tracker_frame(&mut self) -> Option<StarTrackerFrame> {
        let time = self.time.now();
        self.star_tracker.as_mut()?.deliver(time)
    }

    /// Whether there is a star tracker.
    pub fn has_star_tracker(&self) -> bool {
        self.star_tracker.is_some()
    }

    /// Parts of the robot's description that are not simulated, as a line; `None` if there are none.
    pub fn not_simulated(&self) -> Option<&str> {
        self.not_simulated.as_deref()
    }

    /// Lists the joints with default effort limits, as a line; `None` if the description gives all limits.
    pub fn default_effort_limits(&self) -> Option<String> {
        let (joints, acceleration) = &self.default_limits;
        (!joints.is_empty()).then(|| {
            format!(
                "no effort limit for {}: limited to {acceleration} rad/s2 (or m/s2) of acceleration with the arm outstretched (default_joint_acceleration)",
                joints.join(", ")
            )
        })
    }

    /// Checks that no motion has diverged: states are finite, and speeds and distances within their limits.
    ///
    /// # Errors
    /// A line with the time, the quantity that is too large, and a remedy.
    pub fn check_divergence(&self) -> Result<(), String> {
        if let Some(what) = divergence::of(&self.robot) {
            return Err(self.diverged(ROBOT, &what));
        }
        for target in &self.targets {
            if let Some(what) = divergence::of(&target.body) {
                return Err(self.diverged(&target.name, &what));
            }
        }
        Ok(())
    }

    fn diverged(&self, name: &str, what: &str) -> String {
        let cause = match self.drive.mode() {
            DriveMode::Effort if name == ROBOT && self.robot.efforts().amax() > 0.0 => {
                "lower the efforts or gains, or sample the controller more often (state_rate)"
            }
            _ => "lower time_step",
        };
        format!(
            "the motion of {name} has diverged at {:.3} s, {what}: it is too fast for a time_step of {} s; {cause}",
            self.time(),
            self.time_step
        )
    }

    /// Advances to the next tick.
    pub fn step_to_tick(&mut self) {
        let start = self.time.now();
        let seconds = self.time.advance_to_tick();
        self.step_from(start, seconds);
        self.finish_tick();
    }

    /// Updates mean efforts, mean wheel torques and the gyro's bias at the end of a tick.
    fn finish_tick(&mut self) {
        self.drive.finish_tick(self.time.period());
        self.wheel_torques.finish_tick(self.time.period());
        self.gyro_walk += self.imu.bias_step(self.time.ticks(), self.time.period());
    }

    /// Advances to the next tick, and restores bodies that have diverged, as [`Self::restore_diverged`].
    ///
    /// # Errors
    /// As [`Self::check_divergence`], for the motion before restoring.
    pub(super) fn step_to_tick_or_restore(&mut self) -> Result<(), String> {
        self.step_to_tick();
        self.restore_diverged()
    }

    /// Advances to `time` \[s\], but not beyond the next tick, and restores bodies that have diverged, as
    /// [`Self::restore_diverged`]. Does nothing if `time` is in the past.
    ///
    /// # Errors
    /// As [`Self::check_divergence`], for the motion before restoring.
    pub(super) fn step_within_tick_or_restore(&mut self, time: f64) -> Result<(), String> {
        let start = self.time.now();
        let Some(seconds) = self.time.advance_within_tick(time) else {
            return Ok(());
        };
        self.step_from(start, seconds);
        self.restore_diverged()
    }

    /// Whether time is between two ticks.
    pub(super) fn is_between_ticks(&self) -> bool {
        self.time.is_between_ticks()
    }

    /// Restores bodies that have diverged to the state before the last step, so that an excessive command does not end
    /// the simulation for everyone. The robot's joints are stopped, its efforts are zero until the next command, and
    /// wrenches on it end. Its momentum is kept, unless it has diverged before since the last command: then it is
    /// stopped completely. Likewise for targets.
    ///
    /// # Errors
    /// As [`Self::check_divergence`], for the motion before restoring.
    fn restore_diverged(&mut self) -> Result<(), String> {
        let checked = self.check_divergence();
        if checked.is_err() {
            let time = self.time.now();
            self.drop_diverged();
            if divergence::of(&self.robot).is_some() {
                self.backup.restore(&mut self.robot, time);
                self.wrenches.undo_step(&mut self.robot);
                self.drive.release(&mut self.robot);
                self.drive.discard_efforts();
                self.wheel_torques.reset();
            }
            for target in &mut self.targets {
                if divergence::of(&target.body).is_some() {
                    target.restore(time);
                }
            }
        }
        checked
    }

    /// Mean joint efforts between the last two ticks \[N m or N\].
    pub(super) fn mean_efforts(&self) -> &[f64] {
        self.drive.mean_efforts()
    }

    /// Mean torques of the wheels' motors between the last two ticks \[N m\].
    pub(super) fn mean_wheel_torques(&self) -> &[f64] {
        self.wheel_torques.means()
    }

    /// Holds wheel `torques` (wheel index, torque \[N m\]), limited by what each motor can give. Other wheels keep
    /// their torques.
    ///
    /// # Panics
    /// If there is no wheel of this index.
    pub fn hold_wheel_torques(&mut self, torques: impl IntoIterator<Item = (usize, f64)>) {
        self.backup.note_command();
        if let Some(robot) = self.robot.flexible_mut() {
            for (i, torque) in torques {
                robot.input_mut().wheel_torques[i] = torque;
            }
        }
    }

    /// Sets the torques of all wheels to zero.
    pub fn release_wheels(&mut self) {
        if let Some(robot) = self.robot.flexible_mut() {
            robot.input_mut().wheel_torques.fill(0.0);
        }
    }

    /// Opens thruster valves for some time from now (thruster index, time \[s\]). Other thrusters are not affected.
    ///
    /// # Panics
    /// If there is no thruster of this index.
    pub fn fire(&mut self, on_times: impl IntoIterator<Item = (usize, f64)>) {
        self.backup.note_command();
        if let Some(robot) = self.robot.flexible_mut() {
            for (i, seconds) in on_times {
                robot.fire(i, seconds);
            }
        }
    }

    /// Holds joint `efforts` (joint index, effort \[N m or N\]), clamped to the joints' limits. Other joints keep their
    /// setpoints. Returns whether any was clamped.
    pub fn hold_efforts(&mut self, efforts: impl IntoIterator<Item = (usize, f64)>) -> bool {
        self.backup.note_command();
        self.drive.hold_efforts(&mut self.robot, efforts)
    }

    /// Drives joints at `rates` (joint index, rate \[rad/s or m/s\]) by a servo, clamped to the joints' limits. Other
    /// joints keep their setpoints. Returns whether any was clamped.
    pub fn drive_rates(&mut self, rates: impl IntoIterator<Item = (usize, f64)>) -> bool {
        self.backup.note_command();
        self.drive.drive_rates(&mut self.robot, rates)
    }

    /// Sets setpoints of joints, as [`JointDrive::command`].
    pub(super) fn command(&mut self, setpoints: &[(usize, Setpoint)]) -> Option<&'static str> {
        self.backup.note_command();
        (self.drive).command(&mut self.robot, setpoints.iter().copied())
    }

    /// Begins a motion of all joints, which replaces their setpoints.
    pub(super) fn begin(&mut self, motion: ArmMotion) {
        self.backup.note_command();
        self.drive.begin(&self.robot, motion, self.time.now());
    }

    /// Sets the goal of a gripper; grippers are in the order of the parameter `grippers`.
    pub fn set_gripper_goal(&mut self, gripper: usize, goal: GripperGoal) {
        self.backup.note_command();
        self.drive.set_gripper_goal(&self.robot, gripper, goal);
    }

    /// The joints' drives.
    pub(super) fn drive(&self) -> &JointDrive {
        &self.drive
    }

    /// The servo of streamed twists, while it moves the arm.
    pub(super) fn twist_servo(&mut self) -> Option<&mut TwistServo> {
        self.drive.twist_servo()
    }

    /// Change of momentum and work by external wrenches and thrusters on robot and held target since the start, without
    /// the effect of targets; `None` if none has acted.
    pub fn external_change(&self) -> Option<&ExternalChange> {
        self.wrenches.change()
    }

    /// Whether the scenario itself can exert external forces on the robot: by thrusters or excitations of links.
    pub fn is_acted_on(&self) -> bool {
        let robot = self.robot.flexible();
        let has_thrusters = robot.is_some_and(|r| !r.system().thrusters().is_empty());
        has_thrusters || self.wrenches.excitations().has_link_waves()
    }

    /// Applies a couple \[N m\] (base axes) to the base for `seconds` from now, as a message on `wrench` does. It
    /// replaces the previous one.
    ///
    /// # Errors
    /// A line, if too many wrenches act or wait.
    pub fn hold_couple(&mut self, couple: Vector3<f64>, seconds: f64) -> Result<(), String> {
        let link = self.robot.model().frames()[0].clone();
        let now = self.time();
        self.wrenches.add(ExternalWrench {
            axes: WrenchAxes::Robot(link.clone()),
            link,
            point: Vector3::zeros(),
            wrench: Wrench::new(couple, Vector3::zeros()),
            from: now,
            until: now + seconds,
            is_streamed: true,
        })
    }

    /// External wrenches, to add or clear some.
    pub(super) fn wrenches_mut(&mut self) -> &mut ExternalWrenches {
        &mut self.wrenches
    }

    /// Mode of the joints' drives.
    pub(super) fn drive_mode(&self) -> DriveMode {
        self.drive.mode()
    }

    /// Stops the joints when another commander takes over: efforts and rates become zero. A motion continues, since the
    /// next command begins with it.
    pub(super) fn stop_joints(&mut self) {
        if self.drive.mode() != DriveMode::Motion {
            self.drive.halt(&mut self.robot);
        }
    }

    /// Puts the joints' drives into the safe state, as [`JointDrive::halt`].
    pub(super) fn halt(&mut self) {
        self.drive.halt(&mut self.robot);
    }

    /// Halts the joints, and sets wheel torques to zero.
    pub(super) fn halt_all(&mut self) {
        self.halt();
        self.release_wheels();
    }

    /// Acceleration of the base frame's origin as a point, and angular acceleration, under the current input, in the
    /// world, base axes.
    pub(super) fn base_acceleration(&mut self) -> Twist {
        self.under_excitations(|robot| robot.A_WB_B())
    }

    /// Calls `read` on the robot with the excitations of the current time added to its input.
    pub(super) fn under_excitations<T>(&mut self, read: impl FnOnce(&mut Robot) -> T) -> T {
        let time = self.time.now();
        (self.wrenches).while_excited(&mut self.robot, time, read)
    }

    /// Adds the wheels' motor torques during `seconds` from `time` \[s\] to their means.
    fn add_wheel_torques(&mut self, time: f64, seconds: f64) {
        if let Some(robot) = self.robot.flexible() {
            let wheels = robot.system().wheels().iter();
            let commands = robot.input().wheel_torques.iter();
            let speeds = robot.state().wheel_speeds().iter();
            for (i, (wheel, (command, speed))) in wheels.zip(commands.zip(speeds)).enumerate() {
                let excitation = self.wrenches.excitations().mean_torque(i, time, seconds);
                let torque = wheel.limited_torque(*command + excitation, *speed, seconds);
                self.wheel_torques.add_one(i, torque, seconds);
            }
        }
    }

    /// Steps the targets that are not integrated together with the robot.
    fn step_free_targets(&mut self, seconds: f64) {
        let steps = step_count(seconds, self.time_step);
        for i in 0..self.targets.len() {
            if !self.is_stepped_with_robot(i) {
                self.targets[i].step(seconds / steps as f64, steps);
            }
        }
    }

    /// Advances the bodies by `seconds` from `start` \[s\] to the current time.
    fn step_from(&mut self, start: f64, seconds: f64) {
        self.backup.save(&self.robot);
        self.wrenches.save_change();
        self.follow_grasps(start);
        self.save_held_target();
        self.prepare_contact(start);
        let end = self.time.now();
        let (mut time, mut targets_at) = (start, start);
        loop {
            // Steps end where wrenches and excitations begin or end.
            let next_grasp = self.grasps.next_change(time, end);
            let next = self.wrenches.next_change(time, next_grasp);
            let next = self.next_choice_of_axes(time, next);
            // The difference of two times equals the period only up to rounding.
            let part = match (time == start, next < end) {
                (true, false) => seconds,
                (false, false) => end - time,
                (_, true) => next - time,
            };
            self.add_wheel_torques(time, part);
            for (joint, effort) in self.wrenches.excitations().mean_efforts(time, part) {
                self.drive.add_effort(joint, effort, part);
            }
            let held = self.begin_held_step();
            (self.drive).step(
                &mut self.robot,
                &mut self.wrenches,
                time,
                part,
                self.time_step,
            );
            if let Some(held) = held {
                self.finish_held_step(held, time);
            }
            if next >= next_grasp {
                let whole = targets_at == start && next >= end;
                self.step_free_targets(if whole { seconds } else { next - targets_at });
                targets_at = next;
                self.follow_grasps(next);
            }
            self.renew_contact(next);
            if next >= end {
                break;
            }
            time = next;
        }
    }
}

/// The robot with effort limits for all joints; the names of the joints that get a default limit, from `acceleration`
/// \[rad/s² or m/s²\], and this acceleration. No default limits if it is zero.
fn limited(described: &Model, acceleration: f64) -> (Model, (Vec<String>, f64)) {
    let unlimited = (described.joints().iter()).filter(|joint| joint.limits.effort.is_infinite());
    let names: Vec<_> = unlimited.map(|joint| joint.name.clone()).collect();
    match acceleration == 0.0 || names.is_empty() {
        true => (described.clone(), (Vec::new(), acceleration)),
        false => (
            with_default_effort_limits(described, acceleration),
            (names, acceleration),
        ),
    }
}

/// A line on joint physics that is requested but not simulated, always or near other bodies; `None` if there is none.
fn not_simulated(robot: &Robot, params: &DynamicsParams) -> Option<String> {
    let settings = &params.joint_physics;
    if let Some(robot) = robot.flexible() {
        let names: Vec<_> = robot.system().unsimulated_joints(settings).collect();
        return (!names.is_empty()).then(|| {
            format!(
                "Coulomb friction, stops and speed limits of {} are not simulated for a robot with flexible parts, wheels or thrusters; \
                 damping and springs are (joint_physics.friction, .stops and .velocity_limits switch this note off)",
                names.join(", ")
            )
        });
    }
    let place = match (robot.loops(), &params.contact) {
        (Some(_), _) => "in closed loops",
        (None, Some(_)) => "while bodies are close to each other",
        (None, None) => return None,
    };
    let joints = robot.model().joints().iter();
    let more_than_damped = joints.filter(|joint| {
        let limits = &joint.limits;
        let has_stops = limits.lower.is_finite() || limits.upper.is_finite();
        (settings.friction && joint.friction != 0.0) || (settings.stops && has_stops)
    });
    let names: Vec<_> = more_than_damped.map(|joint| joint.name.as_str()).collect();
    (!names.is_empty()).then(|| {
        format!(
            "Coulomb friction and stops of {} are not simulated {place}; damping is \
             (joint_physics.friction and joint_physics.stops switch this note off)",
            names.join(", ")
        )
    })
}
