//! The drives of the robot's joints: held efforts, or a velocity servo.

use super::mean_efforts::MeanEfforts;
use crate::{
    control::{VelocityServo, VelocityServoConfig},
    dynamics::Floating,
};

/// Longest sampling period of the servo, relative to the time constant of its fastest motion at the start. It overshoots
/// above 1 and is unstable above 2.
const SERVO_PERIOD: f64 = 0.5;

/// What the drives do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriveMode {
    /// They hold efforts.
    Effort,
    /// A servo drives the joint rates to references.
    Rate,
}

/// The drives of one robot. They act on its held efforts ([`Floating::efforts`]), which are stored there only.
pub struct JointDrive {
    mode: DriveMode,
    servo: VelocityServo,
    /// Longest sampling period of the servo \[s\].
    servo_period: f64,
    mean_efforts: MeanEfforts,
}

impl JointDrive {
    /// Drives that hold zero efforts.
    ///
    /// # Errors
    /// A line that names the wrong parameter of the servo.
    pub fn new(robot: &Floating, servo: &VelocityServoConfig) -> Result<Self, String> {
        let servo = VelocityServo::new(robot.model(), servo.clone())
            .map_err(|e| format!("parameter velocity_servo.{e}"))?;
        let fastest = servo.max_bandwidth(robot.model(), &robot.state().q);
        Ok(Self {
            mode: DriveMode::Effort,
            servo_period: SERVO_PERIOD / fastest,
            servo,
            mean_efforts: MeanEfforts::new(robot.model().dof()),
        })
    }

    /// What the drives do.
    pub fn mode(&self) -> DriveMode {
        self.mode
    }

    /// Mean joint efforts between the last two ticks \[N m or N\].
    pub fn mean_efforts(&self) -> &[f64] {
        self.mean_efforts.means()
    }

    /// Holds `efforts` (joint index, effort \[N m or N\]), cut to the joints' limits. Other joints keep their effort, or
    /// get zero if rates were driven until now. Returns whether any was cut.
    pub fn hold_efforts(
        &mut self,
        robot: &mut Floating,
        efforts: impl IntoIterator<Item = (usize, f64)>,
    ) -> bool {
        if self.mode == DriveMode::Rate {
            self.release(robot);
        }
        let mut cut = false;
        for (joint, effort) in efforts {
            let limit = robot.model().joints()[joint].limits.effort;
            let held = effort.clamp(-limit, limit);
            robot.input_mut().efforts[joint] = held;
            cut |= held != effort;
        }
        cut
    }

    /// Drives the joint rates to `rates` (joint index, rate \[rad/s or m/s\]), cut to the joints' limits. Other joints
    /// keep their reference, or get zero if efforts were held until now. Returns whether any was cut.
    pub fn drive_rates(
        &mut self,
        robot: &Floating,
        rates: impl IntoIterator<Item = (usize, f64)>,
    ) -> bool {
        if self.mode == DriveMode::Effort {
            self.mode = DriveMode::Rate;
            self.servo.reset();
        }
        let mut cut = false;
        for (joint, rate) in rates {
            cut |= self.servo.set_reference(robot.model(), joint, rate);
        }
        cut
    }

    /// The safe state without commands: driven rates become zero, which stops the arm, and held efforts become zero,
    /// which lets it coast.
    pub fn halt(&mut self, robot: &mut Floating) {
        self.servo.halt();
        if self.mode == DriveMode::Effort {
            robot.release();
        }
    }

    /// Holds zero efforts.
    pub fn release(&mut self, robot: &mut Floating) {
        self.mode = DriveMode::Effort;
        robot.release();
    }

    /// Everything is as at the start.
    pub fn reset(&mut self, robot: &mut Floating) {
        self.release(robot);
        self.servo.reset();
        self.mean_efforts.reset();
    }

    /// Forgets the efforts since the last tick, of a motion that is discarded.
    pub fn discard_efforts(&mut self) {
        self.mean_efforts.reset();
    }

    /// Advances the robot by `seconds` in integration steps of at most `time_step` \[s\].
    pub fn step(&mut self, robot: &mut Floating, seconds: f64, time_step: f64) {
        match self.mode {
            DriveMode::Effort => {
                let steps = step_count(seconds, time_step);
                self.mean_efforts.add(robot.efforts().as_slice(), seconds);
                robot.step(seconds / steps as f64, steps);
            }
            DriveMode::Rate => {
                let steps = step_count(seconds, time_step.min(self.servo_period));
                let dt = seconds / steps as f64;
                for _ in 0..steps {
                    let efforts = self.servo.efforts(robot.model(), robot.state(), dt);
                    robot.hold_efforts(efforts.as_slice());
                    self.mean_efforts.add(robot.efforts().as_slice(), dt);
                    robot.step(dt, 1);
                }
            }
        }
    }

    /// Ends a tick that was `period` \[s\] long.
    pub fn finish_tick(&mut self, period: f64) {
        self.mean_efforts.finish_tick(period);
    }
}

/// Number of equal steps of at most `longest` that `seconds` are divided into.
pub fn step_count(seconds: f64, longest: f64) -> usize {
    // A rounding error above a whole number of steps must not add a step.
    (seconds / longest - 1e-6).ceil().max(1.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        control::ServoGains,
        dynamics::{IntegrationMethod, State},
        model::Model,
    };

    fn robot() -> (Floating, JointDrive) {
        let joint = r#"<joint name="joint1" type="continuous">"#;
        let urdf = include_str!("../../../urdf/planar_two_link.urdf");
        let urdf = urdf.replace(
            joint,
            &format!(r#"{joint}<limit effort="5" velocity="2"/>"#),
        );
        let model = Model::from_urdf(&urdf, "planar").unwrap();
        let state = State::at_rest(&model);
        let robot = Floating::new(model, state, IntegrationMethod::Rk4);
        let config = VelocityServoConfig {
            gains: ServoGains::Bandwidth(10.0),
            integral: 0.0,
        };
        let drive = JointDrive::new(&robot, &config).unwrap();
        (robot, drive)
    }

    #[test]
    fn joints_without_a_new_effort_keep_theirs() {
        let (mut robot, mut drive) = robot();
        assert!(!drive.hold_efforts(&mut robot, [(0, 1.0), (1, 2.0)]));
        assert!(!drive.hold_efforts(&mut robot, [(1, -3.0)]));
        assert_eq!(robot.efforts().as_slice(), [1.0, -3.0]);
        assert!(drive.hold_efforts(&mut robot, [(0, 6.0)]));
        assert_eq!(robot.efforts().as_slice(), [5.0, -3.0]);
        // The cut of an earlier command is not reported again.
        assert!(!drive.hold_efforts(&mut robot, [(1, 1.0)]));
    }

    // Would break if an effort or a rate from before a change of mode acted after it.
    #[test]
    fn a_change_of_mode_starts_from_zero() {
        let (mut robot, mut drive) = robot();
        drive.hold_efforts(&mut robot, [(0, 1.0)]);
        drive.drive_rates(&robot, [(0, 0.1), (1, 0.1)]);
        assert_eq!(drive.mode(), DriveMode::Rate);
        drive.step(&mut robot, 0.1, 0.01);
        drive.hold_efforts(&mut robot, [(1, 2.0)]);
        assert_eq!(drive.mode(), DriveMode::Effort);
        assert_eq!(robot.efforts().as_slice(), [0.0, 2.0]);
        drive.drive_rates(&robot, [(1, 0.2)]);
        assert_eq!(drive.servo.reference().as_slice(), [0.0, 0.2]);
    }

    #[test]
    fn without_commands_efforts_end_and_driven_joints_stop() {
        let (mut robot, mut drive) = robot();
        drive.hold_efforts(&mut robot, [(0, 1.0)]);
        drive.halt(&mut robot);
        assert_eq!(robot.efforts().as_slice(), [0.0, 0.0]);
        drive.drive_rates(&robot, [(0, 0.1)]);
        // The effort limit of 5 N m lets the joint accelerate only slowly.
        drive.step(&mut robot, 8.0, 0.01);
        assert!((robot.state().qd[0] - 0.1).abs() < 1e-3);
        drive.halt(&mut robot);
        assert_eq!(drive.mode(), DriveMode::Rate);
        drive.step(&mut robot, 8.0, 0.01);
        assert!(robot.state().qd[0].abs() < 1e-3);
    }

    #[test]
    fn the_servo_is_sampled_no_slower_than_it_bears() {
        let (mut robot, mut drive) = robot();
        drive.drive_rates(&robot, [(0, 0.1)]);
        // Twice the limit of stability: one sample per step would diverge.
        for _ in 0..20 {
            drive.step(&mut robot, 0.4, 0.4);
        }
        // A proportional servo leaves an error that balances the Coriolis forces.
        assert!((robot.state().qd[0] - 0.1).abs() < 1e-3);
    }

    #[test]
    fn rounding_does_not_add_a_step() {
        assert_eq!(step_count(0.1 + 0.2, 0.1), 3);
        assert_eq!(step_count(0.301, 0.1), 4);
        assert_eq!(step_count(0.0, 0.1), 1);
    }
}
