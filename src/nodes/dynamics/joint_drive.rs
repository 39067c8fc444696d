//! Drives of the robot's joints: held efforts, a velocity servo, a position servo, or a motion of the whole arm; and
//! drives of grippers.

use super::{
    external_wrenches::ExternalWrenches, gripper_drive::GripperDrive, joint_command::Setpoint,
    mean_efforts::MeanEfforts, params::GripperParams, robot::Robot,
};
use crate::{
    control::{
        GripperGoal, ServoGains, VelocityServo, VelocityServoConfig,
        commander::{ArmMotion, JointDuty, JointPoint, JointServo, TwistServo},
    },
    model::Model,
};

/// Longest sampling period of a servo, relative to its smallest time constant in the initial posture. The servo
/// overshoots above 1 and is unstable above 2.
const SERVO_PERIOD: f64 = 0.5;

/// Tracking errors of a joint (position, rate) beyond which its reference counts as lost: the next motion then begins
/// at the measured state \[rad or m; per s\].
const MAX_TRACKING_ERROR: (f64, f64) = (0.05, 0.5);

/// Mode of the drive of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Holds an effort.
    Effort,
    /// A servo drives the rate to a reference.
    Rate,
    /// A servo drives the position to a reference.
    Position,
    /// Driven by a gripper's servo, independently of the arm.
    Gripper,
}

/// Mode of the drives of all joints except grippers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriveMode {
    /// All joints hold efforts.
    Effort,
    /// A servo tracks joint rates.
    Rate,
    /// A servo holds joint positions.
    Position,
    /// Different modes for different joints.
    Mixed,
    /// A motion of the whole arm.
    Motion,
}

/// Settings of the servos.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveConfig {
    /// Velocity servo.
    pub velocity: VelocityServoConfig,
    /// Bandwidth of the position servo, which also tracks motions \[rad/s\].
    pub position_bandwidth: f64,
}

/// The drives of one robot. They set its held efforts ([`Robot::efforts`]), which are stored only in the robot.
pub struct JointDrive {
    /// Model of the robot with all its inertia; deformable bodies are undeformed.
    model: Model,
    kinds: Vec<Kind>,
    grippers: Vec<GripperDrive>,
    rate_gains: ServoGains,
    servo: VelocityServo,
    position_servo: JointServo,
    /// References of joints with [`Kind::Position`], and of all joints during a motion, at the start of the last step.
    reference: Vec<JointPoint>,
    /// Start and length of the last step of a motion \[s\].
    last_step: (f64, f64),
    motion: Option<ArmMotion>,
    /// Number of motions begun or ended so far; see [`Self::changes`].
    changes: u64,
    duties: Vec<JointDuty>,
    /// Longest sampling periods of the velocity and position servos \[s\].
    periods: [f64; 2],
    mean_efforts: MeanEfforts,
}

impl JointDrive {
    /// Initial drives: joints hold zero effort, grippers hold their positions.
    ///
    /// # Errors
    /// A line that names the invalid parameter of the servo or of a gripper.
    pub fn new(
        robot: &Robot,
        config: &DriveConfig,
        grippers: &[GripperParams],
    ) -> Result<Self, String> {
        let model = robot.rigid_model();
        let servo = VelocityServo::new(&model, config.velocity.clone())
            .map_err(|e| format!("parameter velocity_servo.{e}"))?;
        let fastest = servo.max_bandwidth(&model, &robot.state().q);
        let n = model.dof();
        let grippers = grippers.iter().map(|g| GripperDrive::new(g, robot, &model));
        let grippers = grippers.collect::<Result<Vec<_>, _>>()?;
        let mut kinds = vec![Kind::Effort; n];
        for gripper in &grippers {
            kinds[gripper.joint()] = Kind::Gripper;
        }
        Ok(Self {
            kinds,
            grippers,
            rate_gains: config.velocity.gains.clone(),
            periods: [fastest, config.position_bandwidth].map(|fastest| SERVO_PERIOD / fastest),
            position_servo: JointServo::new(&model, config.position_bandwidth),
            servo,
            reference: vec![JointPoint::default(); n],
            last_step: (0.0, 0.0),
            motion: None,
            changes: 0,
            duties: vec![JointDuty::Track; n],
            mean_efforts: MeanEfforts::new(n),
            model,
        })
    }

    /// Common mode of the drives, grippers excepted.
    pub fn mode(&self) -> DriveMode {
        if self.motion.is_some() {
            return DriveMode::Motion;
        }
        let are_all = |kind| (self.kinds.iter()).all(|k| *k == kind || *k == Kind::Gripper);
        // A robot without joints is in effort mode.
        if are_all(Kind::Effort) {
            DriveMode::Effort
        } else if are_all(Kind::Rate) {
            DriveMode::Rate
        } else if are_all(Kind::Position) {
            DriveMode::Position
        } else {
            DriveMode::Mixed
        }
    }

    /// Number of motions begun or ended so far. A changed number means that a motion has ended or was replaced.
    pub fn motion_count(&self) -> u64 {
        self.changes
    }

    /// Mean joint efforts between the last two ticks \[N m or N\].
    pub fn mean_efforts(&self) -> &[f64] {
        self.mean_efforts.means()
    }

    /// Sets setpoints of joints, clamped to the joints' limits. Other joints keep their setpoints. A motion of the arm
    /// ends, and joints without a new setpoint come to rest. Setpoints for grippers' joints are ignored. Returns which
    /// kind of setpoint was clamped, if any.
    pub fn command(
        &mut self,
        robot: &mut Robot,
        setpoints: impl IntoIterator<Item = (usize, Setpoint)>,
    ) -> Option<&'static str> {
        self.settle(robot);
        let mut cut = None;
        for (joint, setpoint) in setpoints {
            if self.kinds[joint] == Kind::Gripper {
                continue;
            }
            let limits = &robot.model().joints()[joint].limits;
            match setpoint {
                Setpoint::Effort(effort) => {
                    self.kinds[joint] = Kind::Effort;
                    let held = effort.clamp(-limits.effort, limits.effort);
                    robot.input_mut().efforts[joint] = held;
                    if held != effort {
                        cut = Some("an effort");
                    }
                }
                Setpoint::Rate(rate) => {
                    self.kinds[joint] = Kind::Rate;
                    if self.servo.set_reference(&self.model, joint, rate) {
                        cut = Some("a velocity");
                    }
                }
                Setpoint::Position(position) => {
                    self.kinds[joint] = Kind::Position;
                    let held = position.clamp(limits.lower, limits.upper);
                    self.reference[joint] = JointPoint {
                        position: held,
                        ..JointPoint::default()
                    };
                    if held != position {
                        cut = Some("a position");
                    }
                }
            }
        }
        cut
    }

    /// Holds `efforts` (joint index, effort \[N m or N\]), clamped to the joints' limits. Other joints keep their
    /// setpoints. Returns whether any was clamped.
    pub fn hold_efforts(
        &mut self,
        robot: &mut Robot,
        efforts: impl IntoIterator<Item = (usize, f64)>,
    ) -> bool {
        let setpoints = efforts
            .into_iter()
            .map(|(j, effort)| (j, Setpoint::Effort(effort)));
        self.command(robot, setpoints).is_some()
    }

    /// Drives joints at `rates` (joint index, rate \[rad/s or m/s\]), clamped to the joints' limits. Other joints keep
    /// their setpoints. Returns whether any was clamped.
    pub fn drive_rates(
        &mut self,
        robot: &mut Robot,
        rates: impl IntoIterator<Item = (usize, f64)>,
    ) -> bool {
        let setpoints = rates.into_iter().map(|(j, rate)| (j, Setpoint::Rate(rate)));
        self.command(robot, setpoints).is_some()
    }

    /// Begins a motion of all joints at `time` \[s\], which replaces their setpoints.
    pub fn begin(&mut self, robot: &Robot, motion: ArmMotion, time: f64) {
        // The motion may end before its first step.
        self.reference = self.current_motion(robot);
        self.last_step = (time, 0.0);
        self.changes += 1;
        self.motion = Some(motion);
    }

    /// The servo of streamed twists, while it moves the arm.
    pub fn twist_servo(&mut self) -> Option<&mut TwistServo> {
        match &mut self.motion {
            Some(ArmMotion::Twist(servo)) => Some(servo),
            _ => None,
        }
    }

    /// The joints' current motion: their references, or the measured state of joints that have no reference or have
    /// lost it.
    pub fn current_motion(&self, robot: &Robot) -> Vec<JointPoint> {
        let state = robot.state();
        let joints = self.kinds.iter().enumerate().map(|(j, kind)| {
            let measured = JointPoint {
                position: state.q[j],
                rate: state.qd[j],
                acceleration: 0.0,
            };
            let reference = match (&self.motion, kind) {
                (None, Kind::Effort | Kind::Rate) | (_, Kind::Gripper) => return measured,
                (None, Kind::Position) => self.reference[j],
                (Some(_), _) => self.reference_now(j),
            };
            let off = (
                (reference.position - measured.position).abs(),
                (reference.rate - measured.rate).abs(),
            );
            match off.0 > MAX_TRACKING_ERROR.0 || off.1 > MAX_TRACKING_ERROR.1 {
                true => measured,
                false => reference,
            }
        });
        joints.collect()
    }

    /// Reference of joint `j` at the end of the last step.
    fn reference_now(&self, j: usize) -> JointPoint {
        let (from, (start, t)) = (&self.reference[j], self.last_step);
        let motion = self.motion.as_ref();
        JointPoint {
            position: from.position + t * (from.rate + 0.5 * t * from.acceleration),
            rate: from.rate + t * from.acceleration,
            // Not the mean over the step, which is large if the rate has jumped in it.
            acceleration: motion.map_or(0.0, |motion| motion.acceleration(j, start + t)),
        }
    }

    /// Current references of the motion; `None` without a motion.
    pub fn references(&self) -> Option<impl Iterator<Item = JointPoint> + '_> {
        (self.motion.is_some()).then(|| (0..self.kinds.len()).map(|j| self.reference_now(j)))
    }

    /// End of the motion \[s\]; minus infinity without a motion.
    pub fn motion_end(&self) -> f64 {
        let end = self.motion.as_ref().map(ArmMotion::end);
        end.unwrap_or(f64::NEG_INFINITY)
    }

    /// Ends a motion: the joints come to rest within a few time constants of the servo, and hold their positions.
    fn settle(&mut self, robot: &Robot) {
        if self.motion.is_none() {
            return;
        }
        let present = self.current_motion(robot);
        let joints = robot.model().joints().iter().zip(present);
        for (j, (joint, now)) in joints.enumerate() {
            if self.kinds[j] == Kind::Gripper {
                continue;
            }
            self.kinds[j] = Kind::Position;
            // With this reference the rate decays exponentially, without overshoot.
            let rest = now.position + now.rate / self.position_servo.bandwidth();
            self.reference[j] = JointPoint {
                position: rest.clamp(joint.limits.lower, joint.limits.upper),
                ..JointPoint::default()
            };
        }
        self.motion = None;
        self.changes += 1;
    }

    /// Safe state when commands end: driven rates become zero, which stops the joints; held efforts become zero, which
    /// lets them coast; positions stay held; a motion ends with the joints held.
    pub fn halt(&mut self, robot: &mut Robot) {
        self.settle(robot);
        self.servo.halt();
        for (effort, kind) in robot.input_mut().efforts.iter_mut().zip(&self.kinds) {
            if *kind == Kind::Effort {
                *effort = 0.0;
            }
        }
    }

    /// Sets all joints to zero effort; grippers keep their goals.
    pub fn release(&mut self, robot: &mut Robot) {
        self.changes += u64::from(self.motion.take().is_some());
        for kind in self.kinds.iter_mut().filter(|k| **k != Kind::Gripper) {
            *kind = Kind::Effort;
        }
        robot.release();
    }

    /// Restores the initial state.
    pub fn reset(&mut self, robot: &mut Robot) {
        self.release(robot);
        self.grippers.iter_mut().for_each(GripperDrive::reset);
        self.servo.reset();
        self.mean_efforts.reset();
    }

    /// Discards the efforts recorded since the last tick, because that motion has diverged.
    pub fn discard_efforts(&mut self) {
        self.mean_efforts.reset();
    }

    /// Advances the robot from `time` by `seconds` in integration steps of at most `time_step` \[s\], under held
    /// efforts, servos and external `wrenches`.
    pub fn step(
        &mut self,
        robot: &mut Robot,
        wrenches: &mut ExternalWrenches,
        time: f64,
        seconds: f64,
        time_step: f64,
    ) {
        if seconds <= 0.0 {
            return;
        }
        if let Some((dt, steps)) = self.begin_held(robot, seconds, time_step) {
            wrenches.step(robot, time, dt, steps);
            return;
        }
        let mode = self.mode();
        if mode != DriveMode::Rate {
            self.servo.reset_integral();
        }
        for gripper in &mut self.grippers {
            gripper.follow_schedule(robot, time);
        }
        let [rates, positions] = self.periods;
        let of_grippers = self.grippers.iter().map(GripperDrive::longest_step);
        let time_step = of_grippers.fold(time_step, f64::min);
        let longest = match mode {
            DriveMode::Effort => time_step,
            DriveMode::Rate => time_step.min(rates),
            DriveMode::Position | DriveMode::Motion => time_step.min(positions),
            DriveMode::Mixed => time_step.min(rates).min(positions),
        };
        let steps = step_count(seconds, longest);
        let dt = seconds / steps as f64;
        for step in 0..steps {
            let now = time + step as f64 * dt;
            if mode != DriveMode::Effort {
                self.set_efforts(robot, mode, now, dt);
            }
            for gripper in &mut self.grippers {
                gripper.hold_effort(robot, dt);
            }
            self.mean_efforts.add(robot.efforts().as_slice(), dt);
            wrenches.step(robot, now, dt, 1);
        }
    }

    /// If all joints hold efforts and there are no grippers: records the efforts for `seconds`, and returns length
    /// \[s\] and number of integration steps of at most `time_step` \[s\].
    pub fn begin_held(
        &mut self,
        robot: &Robot,
        seconds: f64,
        time_step: f64,
    ) -> Option<(f64, usize)> {
        if self.mode() != DriveMode::Effort || !self.grippers.is_empty() {
            return None;
        }
        self.servo.reset_integral();
        let steps = step_count(seconds, time_step);
        self.mean_efforts.add(robot.efforts().as_slice(), seconds);
        Some((seconds / steps as f64, steps))
    }

    /// Adds an effort that does not come from the drive, acting on `joint` for `seconds`, to the mean efforts.
    pub fn add_effort(&mut self, joint: usize, effort: f64, seconds: f64) {
        self.mean_efforts.add_one(joint, effort, seconds);
    }

    /// Computes the servos' efforts for a step of `dt` \[s\] that begins at `now` \[s\].
    fn set_efforts(&mut self, robot: &mut Robot, mode: DriveMode, now: f64, dt: f64) {
        if mode == DriveMode::Rate {
            let efforts = self.servo.efforts(&self.model, robot.state(), dt);
            robot.hold_efforts(efforts.as_slice());
            return;
        }
        if let Some(motion) = &mut self.motion {
            motion.advance(&robot.base_state(), now, dt, &mut self.reference);
            self.last_step = (now, dt);
        }
        for (j, duty) in self.duties.iter_mut().enumerate() {
            let rate = self.servo.reference()[j];
            *duty = match (&self.motion, self.kinds[j], &self.rate_gains) {
                // A gripper's own servo sets its effort afterwards; here the effort of the last step is kept.
                (_, Kind::Gripper, _) | (None, Kind::Effort, _) => {
                    JointDuty::Effort(robot.efforts()[j])
                }
                (Some(_), _, _) | (None, Kind::Position, _) => JointDuty::Track,
                (None, Kind::Rate, ServoGains::Bandwidth(omega)) => JointDuty::Rate(rate, *omega),
                (None, Kind::Rate, ServoGains::PerJoint(gains)) => {
                    JointDuty::Effort(gains[j] * (rate - robot.state().qd[j]))
                }
            };
        }
        let efforts = (self.position_servo).efforts(robot.state(), &self.duties, &self.reference);
        robot.hold_efforts(efforts.as_slice());
    }

    /// The grippers, in the order of the parameter `grippers`.
    pub fn grippers(&self) -> &[GripperDrive] {
        &self.grippers
    }

    /// Sets the goal of a gripper.
    ///
    /// # Panics
    /// If there is no gripper of this index.
    pub fn set_gripper_goal(&mut self, robot: &Robot, gripper: usize, goal: GripperGoal) {
        self.grippers[gripper].set_goal(robot, goal);
    }

    /// Ends a tick that was `period` \[s\] long.
    pub fn finish_tick(&mut self, period: f64) {
        self.mean_efforts.finish_tick(period);
    }
}

/// Number of equal steps of at most `longest` \[s\] into which `seconds` are divided.
pub fn step_count(seconds: f64, longest: f64) -> usize {
    // A rounding error above a whole number of steps must not add a step.
    (seconds / longest - 1e-6).ceil().max(1.0) as usize
}

#[cfg(test)]
mod tests;
