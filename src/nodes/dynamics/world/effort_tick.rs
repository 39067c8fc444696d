//! Effort ticks: ticks in which a rigid robot moves under held efforts only. Their steps can be computed by the caller,
//! for several worlds together.

use super::World;
use crate::dynamics::Floating;

/// The integration steps of a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffortTick {
    /// Length of a step \[s\].
    pub dt: f64,
    /// Number of steps.
    pub steps: usize,
}

impl World {
    /// Begins the next tick if a rigid robot moves under held efforts only: without targets, contacts, wrenches and
    /// servos. Time has then advanced; the caller must step [`World::effort_tick_robot`] and call [`World::finish_effort_tick`].
    /// Otherwise returns `None` with nothing changed; [`World::step_to_tick`] works for all ticks.
    pub fn begin_effort_tick(&mut self) -> Option<EffortTick> {
        let is_alone = self.targets.is_empty() && self.contacts.is_none() && self.grasps.are_none();
        let is_left = self.wrenches.are_none() && !self.time.is_between_ticks();
        if !is_alone || !is_left || self.robot.rigid().is_none() {
            return None;
        }
        let seconds = self.time.period();
        let (dt, steps) = (self.drive).begin_held(&self.robot, seconds, self.time_step)?;
        self.time.advance_to_tick();
        self.backup.save(&self.robot);
        self.wrenches.save_change();
        Some(EffortTick { dt, steps })
    }

    /// The robot to step; `None` unless it is rigid.
    pub fn effort_tick_robot(&mut self) -> Option<&mut Floating> {
        Some(self.robot.rigid_mut()?.own_mut())
    }

    /// Ends a tick begun by [`World::begin_effort_tick`].
    pub fn finish_effort_tick(&mut self) {
        self.finish_tick();
    }
}
