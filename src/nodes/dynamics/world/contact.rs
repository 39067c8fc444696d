//! Contacts in the world: when the contact world is set up, contact events, and the energy of contact.

use super::super::{
    contact_builder::ContactBuilder, contact_system::ContactSystem, params::DynamicsParams,
    rigid_robot::RigidRobot, robot::Robot, target::Target,
};
use super::{World, WorldEvent};
use crate::dynamics::{capture::Captured, contact::ContactPoint};

/// Angle by which a ball joint may turn before the choice of its axes is checked again \[rad\].
const LARGEST_TURN: f64 = 0.25;
/// Shortest time between two such checks \[s\].
const SHORTEST: f64 = 1e-4;

/// Maximum number of events that are kept.
const MOST_EVENTS: usize = 10_000;

/// The contacts of a world, with their events and energies.
pub(super) struct WorldContacts {
    builder: ContactBuilder,
    events: Vec<WorldEvent>,
    /// Why contacts could not be simulated, if that has happened.
    failure: Option<String>,
    /// Energy dissipated by contacts in earlier contact worlds \[J\].
    dissipated_before: f64,
    /// Ids of the targets for which contact could not be set up, and the index of the held target then.
    refused: Option<(Vec<u64>, Option<usize>)>,
}

/// A contact point of two links.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkContact<'a> {
    /// Names of the links: a link of the robot, a target, or `TARGET/LINK`.
    pub links: [&'a str; 2],
    /// Position, depth, and force on the first link.
    pub point: ContactPoint,
}

impl WorldContacts {
    /// The contacts configured by the parameters; `None` without contact.
    ///
    /// # Errors
    /// A line that names a parameter or a description.
    pub fn new(
        params: &DynamicsParams,
        robot: &Robot,
        targets: &[Target],
    ) -> Result<Option<Self>, String> {
        let Some(of_contact) = &params.contact else {
            return Ok(None);
        };
        let model = robot.model();
        let allowed = &params.resource_folders;
        let builder =
            ContactBuilder::new(of_contact, params.time_step, &params.robot, model, allowed)?;
        builder.check(model, targets)?;
        Ok(Some(Self {
            builder,
            events: Vec::new(),
            failure: None,
            dissipated_before: 0.0,
            refused: None,
        }))
    }

    /// Before a contact world is replaced: records its dissipated energy, and the stored energy beyond the `stored`
    /// energy \[J\] of its successor, which is lost.
    fn record_replaced(&mut self, before: &ContactSystem, stored: f64) {
        let lost = before.world().stored_energy() - stored;
        self.dissipated_before += before.world().dissipated_energy() + lost.max(0.0);
    }

    /// Records that contacts of these links have ended at `time` \[s\].
    fn note_ends(&mut self, time: f64, links: Vec<[String; 2]>) {
        for [a, b] in links {
            self.note(time, format!("contact of {a} and {b} ends"));
        }
    }

    fn note(&mut self, time: f64, what: String) {
        if self.events.len() < MOST_EVENTS {
            self.events.push(WorldEvent { time, what });
        }
    }
}

impl World {
    /// Whether contact is simulated.
    pub fn has_contact(&self) -> bool {
        self.contacts.is_some()
    }

    /// Contacts of links that have begun or ended, oldest first.
    pub fn contact_events(&self) -> &[WorldEvent] {
        self.contacts.as_ref().map_or(&[], |c| &c.events)
    }

    /// The current contact points.
    pub fn contact_points(&self) -> impl Iterator<Item = LinkContact<'_>> {
        let system = self.robot.current_contact_system().into_iter();
        system.flat_map(|system| {
            system.points().map(|point| LinkContact {
                links: point.colliders.map(|c| system.label(c).link.as_str()),
                point,
            })
        })
    }

    /// Energy stored in contacts now, and energy dissipated by contacts so far \[J\]; `None` without contact.
    pub fn contact_energy(&self) -> Option<(f64, f64)> {
        let contacts = self.contacts.as_ref()?;
        let before = contacts.dissipated_before;
        let stored =
            (self.robot.current_contact_system()).map_or(0.0, |t| t.world().stored_energy());
        let own = (self.robot.contact_system()).map_or(0.0, |t| t.world().dissipated_energy());
        Some((stored, before + own))
    }

    /// Reports once that contacts could not be simulated, if that has happened.
    ///
    /// # Errors
    /// A line with the reason.
    pub fn check_contacts(&mut self) -> Result<(), String> {
        let failure = self.contacts.as_mut().and_then(|c| c.failure.take());
        failure.map_or(Ok(()), Err)
    }

    /// Sets up contact at the start.
    ///
    /// # Errors
    /// A line on shapes that cannot touch, or on bodies that overlap.
    pub(super) fn begin_contact(&mut self) -> Result<(), String> {
        let Some(contacts) = &self.contacts else {
            return Ok(());
        };
        let Some(robot) = self.robot.rigid_mut() else {
            return Ok(());
        };
        if robot.held().is_some() {
            // A target that is held now may be free later.
            contacts.builder.check_pairs(robot, &self.targets)?;
        }
        if robot.has_second_grasp() {
            return Ok(());
        }
        let mut system = contacts.builder.build(robot, &self.targets)?;
        if robot.held().is_some() {
            // A target that is held from the start may overlap with the hand.
            let apart = system.pairs_without_held();
            system.suspend_overlaps(&apart);
        }
        let found = system.world_mut().check_apart();
        found.map_err(|e| format!("parameter contact: {e}"))?;
        self.set_contact_system(Some(system));
        Ok(())
    }

    /// Checks that contact with the current targets can be simulated.
    ///
    /// # Errors
    /// A line on a description, a shape or a pair of shapes.
    pub(in super::super) fn check_shapes(&self) -> Result<(), String> {
        match (&self.contacts, self.robot.as_rigid()) {
            (Some(contacts), Some(robot)) => contacts.builder.check_pairs(robot, &self.targets),
            _ => Ok(()),
        }
    }

    fn set_contact_system(&mut self, system: Option<ContactSystem>) {
        if let Some(robot) = self.robot.rigid_mut() {
            robot.set_contact_system(system);
        }
    }

    /// `end` \[s\], or an earlier time after `time` \[s\] at which the axes of a ball joint between robot and held
    /// target must be checked: they stay the same while the contact world is integrated.
    pub(super) fn next_choice_of_axes(&self, time: f64, end: f64) -> f64 {
        let robot = self
            .robot
            .as_rigid()
            .filter(|robot| robot.current_contact_system().is_some());
        let captured = robot.and_then(RigidRobot::captured);
        match captured.and_then(Captured::ball_joint_rate) {
            Some(rate) => end.min(time + (LARGEST_TURN / rate).max(SHORTEST)),
            None => end,
        }
    }

    /// Sets up contact again if the targets or the held target have changed.
    pub(super) fn renew_contact(&mut self, time: f64) {
        let Some(contacts) = &mut self.contacts else {
            return;
        };
        let Some(robot) = self.robot.rigid_mut() else {
            return;
        };
        robot.choose_axes_if_tilted();
        let ids = || self.targets.iter().map(|target| target.id);
        let held = self
            .targets
            .iter()
            .position(|t| robot.held() == Some(&t.name));
        let is_current =
            (robot.current_contact_system()).is_some_and(|system| system.has_targets(ids(), held));
        if robot.has_second_grasp() {
            // Contact is not simulated while two grasps form a closed loop.
            if let Some(system) = robot.set_contact_system(None) {
                contacts.record_replaced(&system, 0.0);
                let ended = system
                    .links_in_contact()
                    .map(|links| links.map(str::to_owned));
                contacts.note_ends(time, ended.collect());
            }
            return;
        }
        let is_refused = (contacts.refused.as_ref()).is_some_and(|(refused, holding)| {
            *holding == held && refused.iter().copied().eq(ids())
        });
        if !is_current && !is_refused {
            contacts.refused = None;
            let built = contacts.builder.build(robot, &self.targets);
            let before = robot.set_contact_system(None);
            match built {
                Ok(mut system) => {
                    let known = (before.as_ref()).map_or(Vec::new(), ContactSystem::touching_links);
                    system.suspend_overlaps(&known);
                    if let Some(before) = before {
                        contacts.record_replaced(&before, system.world().stored_energy());
                        contacts.note_ends(time, system.continue_from(&before));
                    }
                    robot.set_contact_system(Some(system));
                }
                Err(problem) => {
                    if let Some(before) = before {
                        contacts.record_replaced(&before, 0.0);
                    }
                    contacts.refused = Some((ids().collect(), held));
                    contacts.failure = Some(problem);
                }
            }
        }
    }

    /// Before a step: adopts states that were changed from outside since the last step.
    pub(super) fn prepare_contact(&mut self, time: f64) {
        self.renew_contact(time);
        let system = self
            .robot
            .rigid_mut()
            .and_then(RigidRobot::contact_system_mut);
        if let Some(system) = system {
            for (number, i) in system.free_targets() {
                let target = &mut self.targets[i];
                system.follow(number, &target.body);
                target.save();
            }
        }
    }

    /// Whether target `i` is integrated together with the robot.
    pub(super) fn is_stepped_with_robot(&self, i: usize) -> bool {
        self.held_target() == Some(self.targets[i].name.as_str())
            || self.robot.current_contact_system().is_some()
    }

    /// After a step of the robot that began at `time` \[s\]: copies the motion of the targets in the contact world to
    /// them, and records events.
    pub(super) fn finish_contact(&mut self, time: f64) {
        let (Some(contacts), Some(robot)) = (&mut self.contacts, self.robot.rigid_mut()) else {
            return;
        };
        if robot.current_contact_system().is_none() {
            return;
        }
        let Some(system) = robot.contact_system_mut() else {
            return;
        };
        for (number, i) in system.free_targets() {
            system
                .world()
                .copy_state_to(number, &mut self.targets[i].body);
        }
        let events: Vec<_> = system.take_events().collect();
        for event in events {
            contacts.note(time + event.after, event.what);
        }
        if let Some(failure) = system.take_failure() {
            contacts.failure = Some(failure);
        }
    }

    /// Resets contact to the start.
    pub(super) fn reset_contact(&mut self) {
        if let Some(contacts) = &mut self.contacts {
            contacts.failure = None;
        }
    }
}

#[cfg(test)]
mod tests;
