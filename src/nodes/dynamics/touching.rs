//! Robot and targets that touch, stepped together.

use std::collections::BTreeMap;

use crate::{
    dynamics::{
        Floating, Forcing, Input, Momentum, State,
        contact::{ColliderId, ContactPoint, ContactWorld},
    },
    model::Frame,
    spatial::{Pose, Wrench},
};

/// The link of a collider.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Label {
    /// Its name in messages and events: a link of the robot, a target, or `TARGET/LINK`.
    pub link: String,
    /// The robot (0) or the target (its number from one).
    pub owner: usize,
    /// Index of the link's body in the robot's own model; `None` for targets.
    pub robot_body: Option<usize>,
}

/// Two links begin or end to touch.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkEvent {
    /// Time since the start of the step \[s\].
    pub after: f64,
    /// What, as a line.
    pub what: String,
}

/// The robot and the targets as one system: the robot, with the target that it holds, is system 0, the other targets follow.
/// The robot itself has the motion that it has here, so that drives, wrenches and sensors need not know.
pub struct Touching {
    world: ContactWorld,
    /// Of each collider.
    labels: Vec<Label>,
    /// Ids of all targets.
    targets: Vec<u64>,
    /// Number in `targets` of the target that the robot holds.
    held: Option<usize>,
    /// Points at which two links touch, by the first colliders of these links.
    touched: BTreeMap<[usize; 2], usize>,
    events: Vec<LinkEvent>,
    /// Why the last step could not be taken.
    failure: Option<String>,
    input: Input,
}

impl Touching {
    /// A world with the labels of its colliders and the ids of its targets, of which the robot holds number `held`.
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

    /// The contact world: the robot with what it holds is system 0, the other targets follow.
    pub fn world(&self) -> &ContactWorld {
        &self.world
    }

    /// The same, to check it.
    pub(super) fn world_mut(&mut self) -> &mut ContactWorld {
        &mut self.world
    }

    /// Whether its targets have these ids, and the robot holds number `held` of them.
    pub(super) fn has_targets(&self, ids: impl Iterator<Item = u64>, held: Option<usize>) -> bool {
        self.held == held && self.targets.iter().copied().eq(ids)
    }

    /// Whether the contacts are those of the present state of `system`, the robot with what it holds.
    pub(super) fn is_at(&self, system: &Floating) -> bool {
        self.world.systems()[0].state() == system.state()
    }

    /// Whether the robot, with what it holds, is `system`.
    pub(super) fn is_of(&self, system: &Floating) -> bool {
        self.world.systems()[0].model() == system.model()
    }

    /// The targets that the robot does not hold: number of the system, and number among all targets.
    pub(super) fn free_targets(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let held = self.held;
        let free = (0..self.targets.len()).filter(move |i| Some(*i) != held);
        free.enumerate().map(|(system, i)| (system + 1, i))
    }

    /// The link of a collider.
    pub fn label(&self, collider: ColliderId) -> &Label {
        &self.labels[collider.index()]
    }

    /// The points at which bodies touch and press on each other now.
    pub fn points(&self) -> impl Iterator<Item = ContactPoint> + '_ {
        self.world.contacts()
    }

    /// Takes over the state of system `i`, if it was changed from outside.
    pub(super) fn follow(&mut self, i: usize, body: &Floating) {
        if self.world.systems()[i].state() != body.state() {
            // Contacts that go on are found again.
            self.touched.clear();
            self.world.replace_state(i, body.state());
        }
    }

    /// Advances everything by `dt` \[s\] under the held input of the robot.
    pub(super) fn step(&mut self, robot: &mut Floating, dt: f64) {
        self.follow(0, robot);
        self.world.input_mut(0).copy_from(robot.input());
        let start = robot.state().time;
        let stepped = self.world.step(dt);
        self.finish(stepped.map_err(|e| e.to_string()), start, robot);
    }

    /// The same under the input that `forcing` makes of the held one at every stage.
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

    /// Records contacts and events of a step from `start` \[s\].
    fn finish(&mut self, stepped: Result<(), String>, start: f64, robot: &mut Floating) {
        if let Err(e) = stepped {
            self.failure = Some(e);
            return;
        }
        self.world.show(0, robot);
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

    /// The first collider on the link of a collider.
    fn first_of_link(&self, collider: ColliderId) -> usize {
        let label = &self.labels[collider.index()];
        let first = self.labels.iter().position(|other| other == label);
        first.unwrap_or(collider.index())
    }

    /// Contacts that have begun or ended since the last call.
    pub(super) fn take_events(&mut self) -> std::vec::Drain<'_, LinkEvent> {
        self.events.drain(..)
    }

    /// Contacts that `before`, the bodies in another grouping, had are continued: those that have ended meanwhile are returned,
    /// those that go on have no event.
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

    /// Why a step could not be taken, once.
    pub(super) fn take_failure(&mut self) -> Option<String> {
        self.failure.take()
    }

    /// Pairs of links that touch now, by name.
    pub(super) fn touching_links(&self) -> Vec<[String; 2]> {
        let of = |point: ContactPoint| point.colliders.map(|c| self.label(c).link.clone());
        self.points().map(of).collect()
    }

    /// All pairs of links but those of the robot with the target that it holds.
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

    /// Shapes that overlap do not act on each other before they have been apart, unless their links are among
    /// `touching`.
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

    /// Computes the accelerations of the robot's frames under what acts now, contacts included.
    pub(super) fn set_accelerations(&mut self, robot: &mut Floating) {
        if !self.is_at(robot) {
            // Contacts of another state.
            robot.accelerations();
            return;
        }
        self.input.copy_from(robot.input());
        self.world.add_wrenches(0, robot.input_mut());
        robot.accelerations();
        robot.input_mut().copy_from(&self.input);
    }

    /// Adds what contacts exert now to the input of `system`, the robot with what it holds, if it is in the state of the contacts.
    pub(super) fn add_wrenches(&self, system: &mut Floating) {
        if self.is_at(system) {
            self.world.add_wrenches(0, system.input_mut());
        }
    }

    /// Adds what contacts exert now on the links of `robot`, which is at `X_WB`, to `wrenches` on its bodies.
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

    /// Momentum of everything, angular about the common centre of mass.
    pub(super) fn momentum(&self) -> Momentum {
        self.world.momentum()
    }
}
