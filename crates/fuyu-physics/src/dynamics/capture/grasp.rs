//! A grasp: the frames that it joins, and when it is possible.

use nalgebra::UnitQuaternion;

use super::impulse::{JointReaction, Latch, LatchImpulses, LatchPair, System, close_latches};
use crate::dynamics::{Floating, LoopError, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::Pose;

/// A grasp: the frames that it joins and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Grasp {
    /// Frame of the robot, one of its model's.
    pub robot: Frame,
    /// Frame of the target, on its base.
    pub target: Frame,
    /// The directions that the latch holds.
    pub latch: Latch,
    /// Reaction of the robot's joints to the impulse. Locked joints stay locked afterwards; rate-held joints are free
    /// afterwards, for their servos to hold.
    pub joints: JointReaction,
}

/// Why a grasp is not possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CaptureError {
    /// The robot's frame does not exist.
    #[error(
        "the grasp's frame '{frame}' is none of robot '{robot}'; give a link of its description"
    )]
    UnknownFrame {
        /// The frame.
        frame: String,
        /// The robot.
        robot: String,
    },
    /// The target is grasped by a link that moves relative to its base.
    #[error("the grasp is on body {body} of target '{target}'; it must be on its base, body 0")]
    NotOnBase {
        /// The target.
        target: String,
        /// The body.
        body: usize,
    },
    /// The frames are too far apart.
    #[error(
        "the frames of the grasp are {distance:.4} m and {angle:.4} rad apart; at most {max_distance} m and {max_angle} rad are allowed"
    )]
    Apart {
        /// Distance \[m\].
        distance: f64,
        /// Angle \[rad\].
        angle: f64,
        /// Largest distance \[m\].
        max_distance: f64,
        /// Largest angle \[rad\].
        max_angle: f64,
    },
    /// Robot or target is a mechanism with closed loops.
    #[error("'{0}' has closed loops; only trees can grasp and be grasped")]
    ClosedLoops(String),
    /// The robot has deformable bodies or elastic joints.
    #[error(
        "'{0}' has deformable bodies or elastic joints; of robots with flexible parts only those with wheels and thrusters can grasp"
    )]
    Deformable(String),
    /// A robot with wheels or thrusters holds a target already.
    #[error(
        "'{0}' holds the target already; a robot with wheels or thrusters cannot grasp it with a second frame"
    )]
    SecondGrasp(String),
    /// The joined system cannot have the robot's wheels and thrusters.
    #[error("with the target, the robot cannot have its wheels and thrusters: {0}")]
    Wheels(String),
    /// A loop that a second grasp would close is impossible.
    #[error(transparent)]
    Loop(#[from] LoopError),
}

impl Grasp {
    /// Checks that the frames exist on `robot` and on the base of `target`.
    pub(super) fn check(&self, robot: &Model, target: &Floating) -> Result<(), CaptureError> {
        if robot.frame(&self.robot.name) != Some(&self.robot) {
            return Err(CaptureError::UnknownFrame {
                frame: self.robot.name.clone(),
                robot: robot.name().to_owned(),
            });
        }
        let name = target.model().name();
        if self.target.body != 0 {
            return Err(CaptureError::NotOnBase {
                target: name.to_owned(),
                body: self.target.body,
            });
        }
        if !target.loops().closures().is_empty() {
            return Err(CaptureError::ClosedLoops(name.to_owned()));
        }
        Ok(())
    }

    /// The impulse at which the latch closes between a robot, with its scratch memory, and a target; system 0 is the
    /// robot.
    pub(super) fn close(
        &self,
        (robot, of_robot): (&State, &mut Workspace),
        target: &Floating,
    ) -> LatchImpulses {
        let joints = vec![self.joints; of_robot.model().dof()];
        let mut of_target = target.workspace().clone();
        let mut systems = [
            System {
                state: robot,
                workspace: of_robot,
                joints: &joints,
            },
            System {
                state: target.state(),
                workspace: &mut of_target,
                joints: &[],
            },
        ];
        let pair = LatchPair {
            first: (0, &self.robot),
            second: (1, &self.target),
            latch: self.latch,
        };
        close_latches(&mut systems, &[pair])
    }

    /// Poses of the two frames in the world.
    fn poses(&self, robot: &Floating, target: &Floating) -> [Pose; 2] {
        [(robot, &self.robot), (target, &self.target)].map(|(system, frame)| {
            system.state().X_WB(system.workspace()) * system.workspace().X_BF(frame)
        })
    }

    /// Distance \[m\] and angle \[rad\] between the two frames.
    pub fn separation(&self, robot: &Floating, target: &Floating) -> (f64, f64) {
        let [X_WR, X_WT] = self.poses(robot, target);
        separation(&X_WR, &X_WT)
    }

    /// Checks that the frames are close enough to latch. For a ball joint the angle does not matter.
    ///
    /// # Errors
    /// [`CaptureError::Apart`].
    pub fn check_separation(
        &self,
        robot: &Floating,
        target: &Floating,
        max_distance: f64,
        max_angle: f64,
    ) -> Result<(), CaptureError> {
        let [X_WR, X_WT] = self.poses(robot, target);
        self.check_poses(&X_WR, &X_WT, max_distance, max_angle)
    }

    /// As [`Grasp::check_separation`], for the poses of the robot's frame and of the target's.
    ///
    /// # Errors
    /// [`CaptureError::Apart`].
    pub fn check_poses(
        &self,
        X_WR: &Pose,
        X_WT: &Pose,
        max_distance: f64,
        max_angle: f64,
    ) -> Result<(), CaptureError> {
        let (distance, angle) = separation(X_WR, X_WT);
        let is_turned = self.latch == Latch::Weld && angle > max_angle;
        if distance <= max_distance && !is_turned {
            return Ok(());
        }
        Err(CaptureError::Apart {
            distance,
            angle,
            max_distance,
            max_angle,
        })
    }
}

/// Distance \[m\] and angle \[rad\] between two frames.
fn separation(X_WR: &Pose, X_WT: &Pose) -> (f64, f64) {
    let X_RT = X_WR.inverse() * X_WT;
    let angle = UnitQuaternion::from_rotation_matrix(&X_RT.rotation).angle();
    (X_RT.translation.vector.norm(), angle)
}
