//! Contact world: robot and targets that may touch, integrated together.

use std::collections::BTreeMap;

use crate::{
    dynamics::{
        Floating, Forcing, Input, Momentum, State,
        contact::{ColliderId, ContactPoint, ContactWorld},
    },
    model::Frame,
    spatial::{Pose, Wrench},
};

/// The link that carries a collider.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Label {
    /// Its name in messages and events: a link of the robot, a target, or `TARGET/LINK`.
    pub link: String,
    /// The owner: 0 for the robot, or the target's number counted from one.
    pub owner: usize,
    /// Index of the link's body in the robot's own model; `None` for targets.
    pub robot_body: Option<usize>,
}

/// A contact of two links that begins or ends.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkEvent {
    /// Time since the start of the step \[s\].
    pub after: f64,
    /// Description, as a line.
    pub what: String,
}

/// The robot and the targets as a contact world: the robot, with a held target, is system 0, the free targets follow.
/// The resulting motion is copied to the robot itself, so that drives, wrenches and sensors need not distinguish the
/// cases.
pub struct ContactSystem {
    world: ContactWorld,
    /// The link of each collider.
    labels: Vec<Label>,
    /// Ids of all targets.
    targets: Vec<u64>,
    /// Index in `targets` of the held target.
    held: Option<usize>,
    /// Number of contact points of two links, each represented by the first collider on it.
    touched: BTreeMap<[usize; 2], usize>,
    events: Vec<LinkEvent>,
    /// Error of the last step, if it failed.
    failure: Option<String>,
    input: Input,
}

impl ContactSystem {
    /// A contact world with the links of its colliders and the ids of its targets; `held` is the index of the held
    /// target.
    pub(super) fn new(
        world: ContactWorld,
        labels: Vec<Label>,
        targets: Vec<u64>,
        held: Option<usize>,
    ) -> Self {
        Self {
            input: Input::zero(world.systems()[0].model()),
            world,
            labels,
            targets,
            held,
            touched: BTreeMap::new(),
            events: Vec::new(),
            failure: None,
        }
    }

    /// The contact world: the robot with a held target is system 0, the free targets follow.
    pub fn world(&self) -> &ContactWorld {
        &self.world
    }

    /// Mutable [`Self::world`], for checks.
    pub(super) fn world_mut(&mut self) -> &mut ContactWorld {
        &mut self.world
    }

    /// Whether its targets have these ids, and `held` is the index of the held target.
    pub(super) fn has_targets(&self, ids: impl Iterator<Item = u64>, held: Option<usize>) -> bool {
        self.held == held && self.targets.iter().copied().eq(ids)
    }

    /// Whether the contacts are those of the current state of `system`, the robot with a held target.
    pub(super) fn is_at(&self, system: &Floating) -> bool {
        self.world.systems()[0].state() == system.state()
    }

    /// Whether `system` is the robot with the same held target as here.
    pub(super) fn is_of(&self, system: &Floating) -> bool {
        self.world.systems()[0].model() == system.model()
    }

    /// The free targets: index of the system, and index among all targets.
    pub(super) fn free_targets(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let held = self.held;
        let free = (0..self.targets.len()).filter(move |i| Some(*i) != held);
        free.enumerate().map(|(system, i)| (system + 1, i))
    }

    /// The link of a collider.
    pub fn label(&self, collider: ColliderId) -> &Label {
        &self.labels[collider.index()]
    }

    /// The points at which bodies currently press on each other.
    pub fn points(&self) -> impl Iterator<Item = ContactPoint> + '_ {
        self.world.contacts()
    }

    /// Adopts the state of system `i`, if it was changed from outside.
    pub(super) fn follow(&mut self, i: usize, body: &Floating) {
        if self.world.systems()[i].state() != body.state() {
            // Contacts that persist are detected again.
            self.touched.clear();
            self.world.replace_state(i, body.state());
        }
    }

    /// Advances all bodies by `dt` \[s\] under the robot's held input.
    pub(super) fn step(&mut self, robot: &mut Floating, dt: f64) {
        self.follow(0, robot);
        self.world.input_mut(0).copy_from(robot.input());
        let start = robot.state().time;
        let stepped = self.world.step(dt);
        self.finish(stepped.map_err(|e| e.to_string()), start, robot);
    }

    /// As [`Self::step`]; at every stage, `forcing` changes the held input.
    pub(super) fn step_with(&mut self, robot: &mut Floating, dt: f64, forcing: &mut impl Forcing) {
        self.follow(0, robot);
        self.world.input_mut(0).copy_from(robot.input());
        let start = robot.state().time;
        let mut forces = |time: f64, state: &State, input: &mut Input| {
            forcing.apply(time, state, input);
        };
        let stepped = self.world.step_with(dt, 0, &mut forces);
        self.finish(stepped.map_err(|e| e.to_string()), start, robot);
        robot.input_mut().copy_from(self.world.systems()[0].input());
    }

    /// Records the outcome of a step that began at `start` \[s\]: motion of the robot, contacts and events, or failure.
    fn finish(&mut self, stepped: Result<(), String>, start: f64, robot: &mut Floating) {
        if let Err(e) = stepped {
            self.failure = Some(e);
            return;
        }
        self.world.copy_state_to(0, robot);
        let events: Vec<_> = self.world.take_events().collect();
        for event in &events {
            let links = event.colliders.map(|c| self.first_of_link(c));
            let count = self.touched.entry(links).or_default();
            let was = *count;
            *count = match event.begins {
                true => was + 1,
                false => was.saturating_sub(1),
            };
            let verb = match (was, *count) {
                (0, 1) => "begins",
                (1, 0) => "ends",
                _ => continue,
            };
            let [a, b] = links.map(|k| self.labels[k].link.as_str());
            self.events.push(LinkEvent {
                after: event.time - start,
                what: format!("contact of {a} and {b} {verb}"),
            });
        }
    }

    /// The first collider on the link that carries `collider`.
    fn first_of_link(&self, collider: ColliderId) -> usize {
        let label = &self.labels[collider.index()];
        let first = self.labels.iter().position(|other| other == label);
        first.unwrap_or(collider.index())
    }

    /// Contacts that have begun or ended since the last call.
    pub(super) fn take_events(&mut self) -> std::vec::Drain<'_, LinkEvent> {
        self.events.drain(..)
    }

    /// Takes over the contacts of `before`, the contact world that this one replaces. Returns the contacts that have
    /// ended; persisting contacts produce no event.
    pub(super) fn continue_from(&mut self, before: &Self) -> Vec<[String; 2]> {
        let points: Vec<_> = self.points().map(|point| point.colliders).collect();
        for colliders in points {
            let links = colliders.map(|c| self.first_of_link(c));
            *self.touched.entry(links).or_default() += 1;
        }
        let now: Vec<_> = self.links_in_contact().collect();
        let is_over =
            |links: &[&str; 2]| !now.contains(links) && !now.contains(&[links[1], links[0]]);
        let ended = before.links_in_contact().filter(is_over);
        ended.map(|links| links.map(str::to_owned)).collect()
    }

    /// Pairs of links whose contact has begun and not ended.
    pub(super) fn links_in_contact(&self) -> impl Iterator<Item = [&str; 2]> {
        let touched = self.touched.iter().filter(|(_, count)| **count > 0);
        touched.map(|(links, _)| links.map(|k| self.labels[k].link.as_str()))
    }

    /// The error of a failed step, returned once.
    pub(super) fn take_failure(&mut self) -> Option<String> {
        self.failure.take()
    }

    /// Pairs of links that touch now, by name.
    pub(super) fn touching_links(&self) -> Vec<[String; 2]> {
        let of = |point: ContactPoint| point.colliders.map(|c| self.label(c).link.clone());
        self.points().map(of).collect()
    }

    /// All pairs of links, except those of the robot with the held target.
    pub(super) fn pairs_without_held(&self) -> Vec<[String; 2]> {
        let held = self.held.map(|i| i + 1);
        let mut pairs = Vec::new();
        for (k, a) in self.labels.iter().enumerate() {
            for b in &self.labels[k + 1..] {
                let is_held = (a.owner == 0 && Some(b.owner) == held)
                    || (b.owner == 0 && Some(a.owner) == held);
                if !is_held {
                    pairs.push([a.link.clone(), b.link.clone()]);
                }
            }
        }
        pairs
    }

    /// Suspends the contact of shapes that overlap until they have been apart, except for pairs of links in `touching`.
    pub(super) fn suspend_overlaps(&mut self, touching: &[[String; 2]]) {
        let Self { world, labels, .. } = self;
        world.suspend_overlaps(|colliders| {
            let links = colliders.map(|c| labels[c.index()].link.as_str());
            !touching.iter().any(|known| {
                let known = [known[0].as_str(), known[1].as_str()];
                known == links || known == [links[1], links[0]]
            })
        });
    }

    /// Computes the accelerations of the robot's frames under the held input and contacts.
    pub(super) fn set_accelerations(&mut self, robot: &mut Floating) {
        if !self.is_at(robot) {
            // The contacts are those of another state.
            robot.accelerations();
            return;
        }
        self.input.copy_from(robot.input());
        self.world.add_wrenches(0, robot.input_mut());
        robot.accelerations();
        robot.input_mut().copy_from(&self.input);
    }

    /// Adds the contact wrenches to the input of `system`, the robot with a held target, if its state is that of the
    /// contacts.
    pub(super) fn add_wrenches(&self, system: &mut Floating) {
        if self.is_at(system) {
            self.world.add_wrenches(0, system.input_mut());
        }
    }

    /// Adds the contact wrenches on the links of `robot`, whose pose is `X_WB`, to `wrenches` on its bodies.
    pub(super) fn add_wrenches_on_links(
        &self,
        robot: &Floating,
        X_WB: &Pose,
        wrenches: &mut [Wrench],
    ) {
        for point in self.points() {
            let [first, second] = point.colliders;
            for (collider, force_W) in [(first, point.force), (second, -point.force)] {
                let Some(body) = self.label(collider).robot_body else {
                    continue;
                };
                let frame = Frame {
                    name: String::new(),
                    body,
                    parent: None,
                    X_BF: Pose::identity(),
                };
                let X_WL = X_WB * robot.workspace().X_BF(&frame);
                let force_L = X_WL.rotation.inverse_transform_vector(&force_W);
                let arm = X_WL.inverse_transform_point(&point.at.into()).coords;
                wrenches[body] += Wrench::new(arm.cross(&force_L), force_L);
            }
        }
    }

    /// Total momentum, angular about the common centre of mass.
    pub(super) fn momentum(&self) -> Momentum {
        self.world.momentum()
    }
}
