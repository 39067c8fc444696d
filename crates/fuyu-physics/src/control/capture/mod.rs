//! Capture of a free target by a free-floating robot: observe, plan, approach, grasp, detumble, identify.
//!
//! | part | what it does |
//! | --- | --- |
//! | [`OwnMotion`] | the robot's own motion, from gyro and encoders |
//! | [`TargetTrack`] | the grasp frame's motion and its uncertainty, from measured poses and the estimator's forecast |
//! | [`RendezvousPlanner`] | joint motions that meet a moving frame at zero relative twist |
//! | [`Clearance`] | distances between arm, base and target |
//! | [`GripWatch`] | whether a gripper holds something, from the joint of its fingers |
//! | [`TipImpedance`] | drives the tip as a mass with spring and damper; effective mass of the tip |
//! | [`Detumbler`] | shares the angular momentum between thrusters and wheels, within limits at the grasp |
//! | [`ThrusterPulses`] | turns a couple into on-times of thrusters |
//! | [`Excitation`] | joint motions from which the target's inertia is identified |
//! | [`CaptureMission`] | runs the phases; decides when to wait, retreat and abort |
//!
//! No part of this module knows the pose of the base in the world. The target is known only from measurements.

mod clearance;
mod detumble;
mod excitation;
mod excitation_load;
mod feasibility;
#[cfg(test)]
pub(in crate::control::capture) mod fixtures;
mod frame_motion;
mod grip_watch;
mod mission;
mod own_motion;
mod payload;
mod plan;
mod postures;
mod rendezvous;
mod rotation_forecast;
mod shaping;
mod shooting;
mod target_track;
mod thruster_pulses;
mod tip_impedance;
mod tip_mobility;

pub use clearance::{Clearance, ClearanceConfig, Distances};
pub use detumble::{DetumbleLimits, Detumbler, SharedCouple, Stack};
pub use excitation::Excitation;
pub use frame_motion::FrameMotion;
pub use grip_watch::GripWatch;
pub use mission::{
    CaptureConfig, CaptureMission, Command, Gripper, MissionError, Phase, PhaseFigure, PhaseReport,
    Sample,
};
pub use own_motion::{OwnMotion, inertial_state};
pub use payload::{presumed, stack, with_payload};
pub use plan::{JointLimitsShare, Objective, Plan, PlanError, Start};
pub use rendezvous::{Rendezvous, RendezvousPlanner};
pub use rotation_forecast::RotationForecast;
pub use target_track::{TargetTrack, TrackConfig, Uncertainty};
pub use thruster_pulses::ThrusterPulses;
pub use tip_impedance::{TipImpedance, TipLaw, TipReport};
