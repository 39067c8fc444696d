//! Grasp load: force and torque on a captured target.

use nalgebra::Vector3;

use crate::{
    model::Frame,
    nodes::dynamics::{FreeBody, World},
};

/// Largest force and torque at the grasp, computed from the changes of the target's momentum between states.
#[derive(Debug, Clone, Copy, Default)]
pub struct GraspLoad {
    before: Option<Sample>,
    largest: (f64, f64),
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    time: f64,
    linear: Vector3<f64>,
    angular: Vector3<f64>,
    /// Position of the grasp relative to the target's centre of mass, world axes \[m\].
    arm: Vector3<f64>,
}

impl GraspLoad {
    /// Adds a state of the target with index `target`. The robot holds it by `tip` if a grasp has latched, or, with
    /// contact, if its gripper `is_closed`.
    pub fn see(&mut self, world: &World, target: usize, tip: &Frame, is_closed: bool) {
        let target = &world.targets[target];
        let fingers_hold = is_closed && world.has_contact();
        if !fingers_hold && world.held_target() != Some(target.name.as_str()) {
            self.before = None;
            return;
        }
        let state = target.body.state();
        let X_WE = world.robot.X_WB() * world.robot.X_BF(tip);
        let now = Sample {
            time: world.time(),
            linear: state.momentum_W.linear,
            angular: state.momentum_W.angular,
            arm: X_WE.translation.vector - state.p_WC,
        };
        if let Some(before) = self.before.replace(now) {
            let dt = now.time - before.time;
            if dt <= 0.0 {
                return;
            }
            let force = (now.linear - before.linear) / dt;
            let about_center = (now.angular - before.angular) / dt;
            let arm = (now.arm + before.arm) * 0.5;
            let torque = about_center - arm.cross(&force);
            let (largest_force, largest_torque) = self.largest;
            self.largest = (
                largest_force.max(force.norm()),
                largest_torque.max(torque.norm()),
            );
        }
    }

    /// Largest force \[N\] and torque \[N m\] so far.
    pub fn largest(&self) -> (f64, f64) {
        self.largest
    }
}
