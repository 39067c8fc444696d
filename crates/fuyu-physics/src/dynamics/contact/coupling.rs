//! Interface for a program that owns robots and targets itself: exchange of their states, and effects of contacts on
//! them.

use nalgebra::Vector3;

use super::driven::Drive;
use super::error::ContactError;
use super::world::ContactWorld;
use crate::dynamics::{Floating, Input, Momentum, State};
use crate::spatial::Wrench;

impl ContactWorld {
    /// Advances all systems by `dt` \[s\], as [`Self::step`]. At every stage `forces` sets the input of system `system`
    /// from time \[s\], state and the input of the last call; afterwards its input for the new state is held.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn step_with(
        &mut self,
        dt: f64,
        system: usize,
        forces: &mut dyn FnMut(f64, &State, &mut Input),
    ) -> Result<(), ContactError> {
        self.step_driven(dt, Some((system, forces)))
    }

    /// Steps all systems by their own integrators.
    pub(super) fn step_freely(&mut self, dt: f64, longest: f64, drive: &mut Drive) {
        // Rounding of a whole number of steps must not add a step.
        let steps = (dt / longest - 1e-6).ceil().max(1.0);
        let step = dt / steps;
        for (i, system) in self.systems.iter_mut().enumerate() {
            match &mut drive.forces {
                Some((driven, forces)) if *driven == i => {
                    let mut apply = |time: f64, state: &State, input: &mut Input| {
                        forces(time, state, input);
                    };
                    for _ in 0..steps as usize {
                        system.step_with(step, &mut apply);
                    }
                }
                _ => system.step(step, steps as usize),
            }
        }
        self.radau.restart();
    }

    /// Evaluates the forces at the new state, and holds them.
    pub(super) fn hold_last(&mut self, drive: &mut Drive) {
        if let Some((i, forces)) = &mut drive.forces {
            let system = &mut self.systems[*i];
            let state = system.state().clone();
            forces(state.time, &state, system.input_mut());
        }
    }

    /// Copies the state of system `i` to `body`, a copy of that system. Does not allocate.
    ///
    /// # Panics
    /// If `body` is another system.
    pub fn copy_state_to(&self, i: usize, body: &mut Floating) {
        let state = self.systems[i].state();
        body.change_state(|own| own.copy_from(state));
    }

    /// Replaces the state of system `i`. Contacts with bodies that overlap in the new state are ignored until they have
    /// separated.
    ///
    /// # Panics
    /// If the state is of another system.
    pub fn replace_state(&mut self, i: usize, state: &State) {
        self.is_changed = true;
        self.replaced[i] = true;
        self.systems[i].set_state(state.clone());
    }

    /// Ignores contacts of colliders that overlap now and for which `is_new` is true, until they have separated.
    pub fn suspend_overlaps(&mut self, is_new: impl Fn([super::ColliderId; 2]) -> bool) {
        self.begin();
        let scene = &mut self.scene;
        for pair in &mut scene.pairs {
            let colliders = [pair.first, pair.second].map(super::ColliderId);
            let overlaps = (scene.points[pair.points.clone()].iter()).any(|p| p.touch.gap < 0.0);
            pair.is_suspended |= overlaps && is_new(colliders);
        }
        // Discard the events of these contacts: they are ignored.
        self.events.clear();
        self.is_changed = true;
    }

    /// Momentum of all systems, angular about their common centre of mass, world axes.
    pub fn momentum(&self) -> Momentum {
        let states = || self.systems.iter().map(Floating::state);
        let masses = || self.systems.iter().map(|s| s.workspace().mass);
        let total: f64 = masses().sum();
        let moments = masses().zip(states()).map(|(mass, s)| s.p_WC * mass);
        let p_WC = moments.sum::<Vector3<f64>>() / total;
        let mut sum = Momentum::default();
        for state in states() {
            let Momentum { linear, angular } = &state.momentum_W;
            sum.linear += linear;
            sum.angular += angular + (state.p_WC - p_WC).cross(linear);
        }
        sum
    }

    /// Work that contacts have done on system `i` since the start \[J\].
    pub fn contact_work(&self, i: usize) -> f64 {
        self.contact_work[i]
    }

    /// Energy that contacts have dissipated since the start \[J\]: the energy taken from the systems, less the energy
    /// stored in normal deflections. Deflection of bristles counts as dissipated.
    pub fn dissipated_energy(&self) -> f64 {
        self.dissipated
    }

    /// Adds the wrenches of contacts on the bodies of system `i` to those in `input`: about the origins of the bodies'
    /// frames, in their axes.
    ///
    /// # Panics
    /// If `input` is of another system.
    pub fn add_wrenches(&self, i: usize, input: &mut Input) {
        let scene = &self.scene;
        for pair in scene.pairs.iter().filter(|pair| !pair.is_suspended) {
            let (first, second) = (&scene.colliders[pair.first], &scene.colliders[pair.second]);
            for point in &scene.points[pair.points.clone()] {
                if point.force == Vector3::zeros() {
                    continue;
                }
                for (collider, force) in [(first, point.force), (second, -point.force)] {
                    if collider.system != i {
                        continue;
                    }
                    let X_WB = &scene.members[i].X_WB[collider.body];
                    let force_B = X_WB.rotation.inverse_transform_vector(&force);
                    let arm = X_WB.inverse_transform_point(&point.at.into()).coords;
                    input.wrenches[collider.body] += Wrench::new(arm.cross(&force_B), force_B);
                }
            }
        }
    }
}
