//! Several floating systems in contact, stepped together.

use super::driven::{Drive, Forces};
use super::error::ContactError;
use super::events::{ColliderId, ContactEvent, ContactPoint, ContactWork};
use super::law::ContactLaw;
use super::radau::Radau;
use super::scene::{Collider, Pair, Scene};
use super::shape::Shape;
use crate::dynamics::{Floating, Input};
use crate::model::Frame;
use crate::spatial::Pose;

/// Number of events in one call of [`ContactWorld::step`] above which no more are located.
const EVENTS: usize = 10_000;
/// Number of steps in one call of [`ContactWorld::step`], rejected ones included, at which the call fails.
const STEPS: usize = 200_000;
/// Number of steps in one call, rejected ones included, above which the tolerance is raised, and number of further
/// steps per factor of ten: forces that jump, as those of polyhedra may, must not stall the integration.
const AFTER_MANY_STEPS: (usize, usize) = (5000, 1000);
/// Smallest step relative to the whole call. A step of this length is accepted even if its error is too large.
const SMALLEST: f64 = 1e-12;
/// Number of steps after an event, rejected ones included, above which the tolerance is raised, and number of further
/// steps per factor of ten: in a lasting contact, rounding of its force would otherwise keep the steps short.
const AFTER_LONG_CONTACT: (usize, usize) = (20_000, 100);
/// Upper limit of the tolerance raised in a lasting contact.
const LARGEST_RAISED: f64 = 1e-8;
/// Number of iterations above which the next step gets a new Jacobian.
const SLOW: usize = 4;

/// Depth \[m\] of contact that is not yet an overlap: rounding of poses.
const TOUCHING: f64 = 1e-9;

/// Largest number of events stored for [`ContactWorld::take_events`].
const KEPT: usize = 1024;

/// Several floating systems in contact, stepped together. Steps are as long as accuracy allows, however stiff the
/// contacts are: [Radau's implicit method](https://doi.org/10.1007/978-3-642-05221-7) of order 5 with error control,
/// from event to event. Total momentum is conserved to rounding at any tolerance. Of joint physics, springs and dampers
/// act; friction, stops and speed limits of joints do not.
///
/// ```
/// use fuyu_physics::dynamics::contact::{ContactLaw, ContactWorld, Shape};
/// use fuyu_physics::dynamics::{Floating, IntegrationMethod, State};
/// use fuyu_physics::model::ModelBuilder;
/// use fuyu_physics::spatial::{Pose, RigidInertia};
/// use nalgebra::{Matrix3, Vector3};
///
/// // Two balls of 1 kg; the first one moves towards the second at 1 m/s.
/// let ball = RigidInertia { mass: 1.0, com: Vector3::zeros(), about_com: Matrix3::identity() * 0.004 };
/// let model = ModelBuilder::new("ball", "ball", ball).build();
/// let systems = [0.0, 0.5].map(|x| {
///     let mut state = State::at_rest(&model);
///     state.p_WC.x = x;
///     state.momentum_W.linear.x = if x == 0.0 { 1.0 } else { 0.0 };
///     Floating::new(model.clone(), state, IntegrationMethod::Dop8)
/// });
/// let mut world = ContactWorld::new(systems.into());
/// let [a, b] = [0, 1].map(|i| world.add_collider(i, 0, Pose::identity(), Shape::Sphere { radius: 0.1 }));
/// let law = ContactLaw { dissipation: 0.0, ..ContactLaw::default() };
/// world.add_pair(a, b, law)?;
/// world.step(1.0)?;
/// // Without dissipation they exchange their velocities.
/// assert!((world.systems()[1].state().momentum_W.linear.x - 1.0).abs() < 1e-8);
/// # Ok::<(), fuyu_physics::dynamics::contact::ContactError>(())
/// ```
#[derive(Debug, Clone)]
pub struct ContactWorld {
    pub(super) systems: Vec<Floating>,
    pub(super) scene: Scene,
    pub(super) radau: Radau,
    /// State vector at the start of the step, and at trial points.
    pub(super) y: Vec<f64>,
    pub(super) trial: Vec<f64>,
    /// Tolerance of the error per step.
    pub(super) tolerance: f64,
    /// Factor by which the tolerance is currently raised.
    pub(super) raised: f64,
    pub(super) next_step: f64,
    /// Whether colliders, pairs or states have changed since the last step.
    pub(super) is_changed: bool,
    pub(super) work: ContactWork,
    pub(super) events: Vec<ContactEvent>,
    /// Longest step of the systems' own integrators, if they are used while nothing can touch.
    pub(super) free_step: Option<f64>,
    /// Systems whose states were replaced since the last step: contacts in which they overlap are suspended until the
    /// bodies have separated.
    pub(super) replaced: Vec<bool>,
    /// Work of contacts on each system, and energy that contacts have dissipated \[J\].
    pub(super) contact_work: Vec<f64>,
    pub(super) dissipated: f64,
    /// Steps since the last event.
    since_event: usize,
}

impl ContactWorld {
    /// A world of these systems, without colliders.
    pub fn new(systems: Vec<Floating>) -> Self {
        let scene = Scene::new(systems.iter());
        Self {
            scene,
            radau: Radau::new(0),
            y: Vec::new(),
            trial: Vec::new(),
            tolerance: 1e-8,
            raised: 1.0,
            next_step: f64::INFINITY,
            is_changed: true,
            work: ContactWork::default(),
            events: Vec::with_capacity(KEPT),
            free_step: None,
            replaced: vec![false; systems.len()],
            contact_work: vec![0.0; systems.len()],
            dissipated: 0.0,
            since_event: 0,
            systems,
        }
    }

    /// The same world with another tolerance: about the error per step \[m, rad, m/s, rad/s\]; 1e-8 by default. A
    /// smaller tolerance is raised up to that default while a contact lasts for thousands of steps.
    #[must_use]
    pub fn with_tolerance(mut self, tolerance: f64) -> Self {
        self.tolerance = tolerance.clamp(1e-16, 1e-2);
        self.is_changed = true;
        self
    }

    /// The same world, but while nothing can touch, the systems are stepped by their own integrators, in steps of at
    /// most `dt` \[s\]: then friction, stops and speed limits of joints act, and results equal those without contact.
    ///
    /// # Panics
    /// If `dt` is not positive.
    #[must_use]
    pub fn with_free_steps(mut self, dt: f64) -> Self {
        assert!(dt > 0.0, "free steps of {dt} s never end");
        self.free_step = Some(dt);
        self
    }

    /// Fixes a shape to body `body` of system `system`, at pose `X_BS`.
    ///
    /// # Panics
    /// If there is no such body.
    pub fn add_collider(
        &mut self,
        system: usize,
        body: usize,
        X_BS: Pose,
        shape: Shape,
    ) -> ColliderId {
        let count = self.systems[system].model().bodies().len();
        assert!(
            body < count,
            "system {system} has {count} bodies, not body {body}"
        );
        self.is_changed = true;
        self.scene.colliders.push(Collider {
            system,
            body,
            X_BS,
            shape,
            name: None,
            X_WS: X_BS,
        });
        ColliderId(self.scene.colliders.len() - 1)
    }

    /// Fixes a shape to a frame of system `system`.
    ///
    /// # Panics
    /// As [`Self::add_collider`].
    pub fn add_collider_on(
        &mut self,
        system: usize,
        frame: &Frame,
        X_FS: &Pose,
        shape: Shape,
    ) -> ColliderId {
        self.add_collider(system, frame.body, frame.X_BF * X_FS, shape)
    }

    /// Names a collider in messages; without a name they use that of its body.
    pub fn name_collider(&mut self, id: ColliderId, name: &str) {
        self.scene.colliders[id.0].name = Some(name.to_owned());
    }

    /// Enables contact of two colliders.
    ///
    /// # Errors
    /// [`ContactError`] if the law is not valid, or if the two cannot touch.
    pub fn add_pair(
        &mut self,
        first: ColliderId,
        second: ColliderId,
        law: ContactLaw,
    ) -> Result<(), ContactError> {
        let names = || [first, second].map(|id| self.name(id));
        if let Err(problem) = law.check() {
            let [first, second] = names();
            return Err(ContactError::Law {
                first,
                second,
                problem,
            });
        }
        let [a, b] = [first, second].map(|id| &self.scene.colliders[id.0]);
        let reason = if (a.system, a.body) == (b.system, b.body) {
            Some("they are on one body")
        } else if a.shape == Shape::HalfSpace && b.shape == Shape::HalfSpace {
            Some("both are half-spaces")
        } else if a.shape.is_unsafe_with(&b.shape) {
            Some(
                "the energy of a capsule on a cylinder or mesh is not conserved yet; give the other shape as a box, or spheres instead of the capsule",
            )
        } else if [a, b]
            .iter()
            .any(|c| !self.systems[c.system].loops().closures().is_empty())
        {
            Some("one of them is part of a mechanism with closed loops")
        } else {
            None
        };
        if let Some(reason) = reason {
            let [first, second] = names();
            return Err(ContactError::Pair {
                first,
                second,
                reason,
            });
        }
        self.is_changed = true;
        self.scene.pairs.push(Pair {
            first: first.0,
            second: second.0,
            law,
            points: 0..0,
            is_suspended: false,
        });
        Ok(())
    }

    /// Name of a collider's body.
    fn name(&self, id: ColliderId) -> String {
        let collider = &self.scene.colliders[id.0];
        if let Some(name) = &collider.name {
            return name.clone();
        }
        let model = self.systems[collider.system].model();
        format!("{} of {}", model.bodies()[collider.body].name, model.name())
    }

    /// The systems.
    pub fn systems(&self) -> &[Floating] {
        &self.systems
    }

    /// A system, to set its state, efforts or wrenches.
    pub fn system_mut(&mut self, i: usize) -> &mut Floating {
        self.is_changed = true;
        &mut self.systems[i]
    }

    /// Held efforts and external wrenches of a system. Unlike [`Self::system_mut`], this keeps step length, Jacobian
    /// and extrapolation of the integrator.
    pub fn input_mut(&mut self, i: usize) -> &mut Input {
        self.systems[i].input_mut()
    }

    /// Counts of the integration since the start.
    pub fn work(&self) -> ContactWork {
        self.work
    }

    /// Checks that no colliders overlap, except pairs whose contact is ignored because of an overlap.
    ///
    /// # Errors
    /// [`ContactError::Overlap`] with the deepest point.
    pub fn check_apart(&mut self) -> Result<(), ContactError> {
        self.begin();
        let mut deepest: Option<(f64, usize)> = None;
        let pairs = self.scene.pairs.iter().enumerate();
        for (k, pair) in pairs.filter(|(_, pair)| !pair.is_suspended) {
            for point in &self.scene.points[pair.points.clone()] {
                let depth = -point.touch.gap;
                if depth > deepest.map_or(TOUCHING, |d| d.0) {
                    deepest = Some((depth, k));
                }
            }
        }
        let Some((depth, k)) = deepest else {
            return Ok(());
        };
        let pair = &self.scene.pairs[k];
        let [first, second] = [pair.first, pair.second].map(|i| self.name(ColliderId(i)));
        Err(ContactError::Overlap {
            first,
            second,
            depth,
        })
    }

    /// The points at which bodies are in contact now, without pairs whose contact is ignored.
    pub fn contacts(&self) -> impl Iterator<Item = ContactPoint> + '_ {
        let acting = self.scene.pairs.iter().filter(|pair| !pair.is_suspended);
        acting.flat_map(move |pair| {
            let points = self.scene.points[pair.points.clone()].iter();
            points
                .filter(|point| point.touch.gap < 0.0)
                .map(move |point| ContactPoint {
                    colliders: [ColliderId(pair.first), ColliderId(pair.second)],
                    at: point.at,
                    normal: point.touch.normal * if point.touch.of_second { -1.0 } else { 1.0 },
                    depth: -point.touch.gap,
                    force: point.force,
                    slip: point.slip,
                })
        })
    }

    /// Energy that the contacts store \[J\].
    pub fn stored_energy(&self) -> f64 {
        self.scene.stored_energy()
    }

    /// Kinetic energy of all systems \[J\].
    pub fn kinetic_energy(&self) -> f64 {
        self.systems
            .iter()
            .map(|system| system.workspace().kinetic_energy())
            .sum()
    }

    /// Error estimate that counts as one. The estimate is of a lower order than the method, so that it may exceed the
    /// wanted error (the transformation of tolerances in Hairer's program RADAU5).
    fn estimate(&self) -> f64 {
        0.1 * self.tolerance.powf(2.0 / 3.0)
    }

    /// Copies the states of the systems, and updates the contact modes.
    pub(super) fn begin(&mut self) {
        if self.is_changed {
            let count = self.scene.assign(self.estimate());
            self.radau = Radau::new(count);
            self.y = vec![0.0; count];
            self.trial = vec![0.0; count];
            self.next_step = f64::INFINITY;
        }
        self.scene
            .start(self.systems.iter().map(Floating::state), &mut self.y);
        for (member, system) in self.scene.members.iter_mut().zip(&self.systems) {
            member.held.copy_from(system.input());
        }
        self.scene.look(&self.y);
        self.scene.resume_pairs();
        if std::mem::take(&mut self.is_changed) {
            self.scene.suspend_pairs(&self.replaced);
            self.replaced.fill(false);
            self.change_modes(0.0);
            self.scene.look(&self.y);
        }
    }

    /// Updates the contact modes `elapsed` after the start of the step, and stores the events.
    fn change_modes(&mut self, elapsed: f64) {
        let Self {
            scene,
            y,
            events,
            systems,
            ..
        } = self;
        let time = systems.first().map_or(0.0, |system| system.state().time) + elapsed;
        let mut kept = |first: usize, second: usize, point: usize, begins: bool| {
            if events.len() < KEPT {
                let colliders = [ColliderId(first), ColliderId(second)];
                events.push(ContactEvent {
                    time,
                    colliders,
                    point,
                    begins,
                });
            }
        };
        scene.change_modes(y, &mut kept);
    }

    /// Removes and returns the stored contact events: those since the last call, at most 1024.
    pub fn take_events(&mut self) -> impl Iterator<Item = ContactEvent> + '_ {
        self.events.drain(..)
    }

    /// Advances all systems by `dt` \[s\] under their held inputs.
    ///
    /// # Errors
    /// [`ContactError::NotConverged`]; the systems then keep their states.
    pub fn step(&mut self, dt: f64) -> Result<(), ContactError> {
        self.step_driven(dt, None)
    }

    /// [`Self::step`] with forces on a system that are evaluated at every stage.
    pub(super) fn step_driven(
        &mut self,
        dt: f64,
        forces: Option<(usize, Forces)>,
    ) -> Result<(), ContactError> {
        self.begin();
        let start = (self.systems.first()).map_or(0.0, |system| system.state().time);
        let mut drive = Drive { forces, start };
        if let Some(free_step) = self.free_step
            && self.scene.is_apart(dt)
        {
            self.step_freely(dt, free_step, &mut drive);
            return Ok(());
        }
        let stored = self.scene.stored_energy();
        self.begin_radau(0.0, &mut drive);
        let (mut left, mut events) = (dt, 0);
        let first = self.work.steps + self.work.rejected;
        while left > 0.0 {
            let tries = self.work.steps + self.work.rejected - first;
            let factors = tries
                .saturating_sub(AFTER_MANY_STEPS.0)
                .div_ceil(AFTER_MANY_STEPS.1);
            self.raised = 10f64
                .powi(factors.min(9) as i32)
                .max(self.raised_in_long_contact());
            let wanted = self.next_step.min(self.scene.longest_step());
            let wanted = wanted.max(SMALLEST * dt);
            // Avoid a tiny step at the end.
            let h = if wanted >= left {
                left
            } else if wanted > 0.5 * left {
                0.5 * left
            } else {
                wanted
            };
            let before = (self.work.steps + self.work.rejected, self.work.events);
            let taken = self.advance(h, dt - left, SMALLEST * dt, &mut events, &mut drive);
            self.since_event = match self.work.events > before.1 {
                true => 0,
                false => self.since_event + self.work.steps + self.work.rejected - before.0,
            };
            let Some(taken) = taken.filter(|_| tries < STEPS) else {
                self.is_changed = true;
                let time = start + dt - left;
                return Err(ContactError::NotConverged { time });
            };
            left = if taken >= left { 0.0 } else { left - taken };
        }
        let mut of_contacts = 0.0;
        for (i, system) in self.systems.iter_mut().enumerate() {
            let (scene, y) = (&self.scene, &self.y);
            system.change_state(|state| {
                let end = state.time + dt;
                scene.read(i, y, state);
                state.time = end;
            });
            let work = scene.contact_work(i, y);
            self.contact_work[i] += work;
            of_contacts += work;
        }
        self.dissipated += stored - self.scene.stored_energy() - of_contacts;
        self.hold_last(&mut drive);
        Ok(())
    }

    /// Takes one step of at most `h`, `elapsed` after the start, which may end at an event. Returns its length; `None`
    /// if not even the smallest step converges.
    fn advance(
        &mut self,
        mut h: f64,
        elapsed: f64,
        smallest: f64,
        events: &mut usize,
        drive: &mut Drive,
    ) -> Option<f64> {
        let iteration = self.iteration_tolerance() * self.raised;
        if self.radau.is_new() || self.radau.iterations > SLOW {
            self.set_jacobian(elapsed, drive);
        }
        loop {
            let error = self.try_radau(elapsed, h, iteration, drive);
            let error = match error {
                Some(error) => error / self.raised,
                // A step of the smallest length is accepted as it is.
                None if h <= smallest && self.radau.is_current && self.radau.is_finite => 1.0,
                None => {
                    self.work.rejected += 1;
                    if !self.radau.is_current {
                        self.set_jacobian(elapsed, drive);
                    } else if h <= smallest {
                        return None;
                    } else {
                        h *= 0.5;
                    }
                    continue;
                }
            };
            let factor = 0.9 * error.max(1e-8).powf(-0.25);
            if !error.is_finite() && h <= smallest {
                return None;
            }
            if (error > 1.0 || error.is_nan()) && h > smallest {
                self.work.rejected += 1;
                h *= if error.is_nan() {
                    0.1
                } else {
                    factor.clamp(0.1, 0.9)
                };
                continue;
            }
            if let Some(after) = self.find_violation(h)
                && *events < EVENTS
            {
                *events += 1;
                let taken = self.locate(elapsed, after, iteration, drive);
                self.accept(taken);
                self.scene.look(&self.y);
                self.change_modes(elapsed + taken);
                self.work.events += 1;
                self.radau.restart();
                self.begin_radau(elapsed + taken, drive);
                self.next_step = h;
                return Some(taken);
            }
            // Keeping the step length saves a factorization.
            self.next_step = if (1.0..1.2).contains(&factor) {
                h
            } else {
                h * factor.clamp(0.2, 8.0)
            };
            self.accept(h);
            self.begin_radau(elapsed + h, drive);
            return Some(h);
        }
    }

    /// Factor by which the tolerance is raised after many steps without an event.
    fn raised_in_long_contact(&self) -> f64 {
        let (first, more) = AFTER_LONG_CONTACT;
        let beyond = self.since_event.saturating_sub(first) as f64;
        let most = 0.1 * LARGEST_RAISED.powf(2.0 / 3.0) / self.estimate();
        10f64.powf(beyond / more as f64).clamp(1.0, most.max(1.0))
    }

    /// Tolerance of the iteration in units of the error estimate.
    fn iteration_tolerance(&self) -> f64 {
        let estimate = self.estimate();
        (estimate.sqrt()).min(0.03).max(1e-15 / estimate)
    }

    fn accept(&mut self, h: f64) {
        self.radau.accept(h);
        for (y, change) in self.y.iter_mut().zip(self.radau.accepted()) {
            *y += change;
        }
        self.scene.turn_on(&mut self.y);
        self.work.steps += 1;
    }
}
