//! Runge-Kutta integration of a [`FlexibleState`] with a fixed step.

use nalgebra::Vector3;

use super::acceleration::FlexibleEvaluation;
use super::base_modes::BaseModes;
use super::{
    FlexibleInput, FlexibleState, FlexibleSystem, FlexibleWorkspace, Losses, PartialWork, Wheel,
};
use crate::dynamics::rate::{Rate, advance, damping_loss};
use crate::dynamics::{IntegrationMethod, Tableau, checks};
use crate::spatial::Twist;

/// Efforts, wrenches and wheel torques as a function of time and state, evaluated at every stage of a step.
pub trait FlexibleForcing {
    /// Writes the input that acts on `state` at `time` \[s\]. `input` initially holds the values of the last call or
    /// the held values.
    fn apply(&mut self, time: f64, state: &FlexibleState, input: &mut FlexibleInput);
}

impl<F: FnMut(f64, &FlexibleState, &mut FlexibleInput)> FlexibleForcing for F {
    fn apply(&mut self, time: f64, state: &FlexibleState, input: &mut FlexibleInput) {
        self(time, state, input);
    }
}

/// Steps a [`FlexibleState`]; owns the memory of the stages. The attitude is integrated on the rotation group, and
/// momentum is part of the state, as in [`Integrator`](crate::dynamics::Integrator): without external forces it does
/// not change at all, bit by bit.
///
/// A step during which a thruster switches off is divided there, so that a pulse gives its exact impulse. Wheel torques
/// are limited so that a step ends at a wheel's speed limit; the base's reaction to the last torque may carry the wheel
/// beyond it by at most `τ h / I_base`.
#[derive(Clone, Debug)]
pub struct FlexibleIntegrator {
    pub(super) system: FlexibleSystem,
    tableau: &'static Tableau,
    pub(super) rates: Vec<Rate>,
    pub(super) extra_rates: Vec<ExtraRate>,
    /// State of a stage, then the result of a step.
    pub(super) stage: FlexibleState,
    input: FlexibleInput,
    equations: Equations,
}

/// The equations of motion, and their last result.
#[derive(Clone, Debug)]
struct Equations {
    result: FlexibleEvaluation,
    /// Faster equations for a robot whose flexible parts are all on the base.
    base_modes: Option<Box<BaseModes>>,
}

impl Equations {
    /// Evaluates the equations at `state`. The wheels' torques are held for `limits.0` \[s\] from speeds `limits.1` on.
    #[inline]
    fn evaluate(
        &mut self,
        state: &FlexibleState,
        workspace: &mut FlexibleWorkspace,
        input: &FlexibleInput,
        limits: (f64, &[f64]),
    ) {
        if let Some(base_modes) = &mut self.base_modes
            && !input.has_wrench()
            && state.on_time.iter().all(|t| *t <= 0.0)
        {
            base_modes.evaluate(state, input, limits, &mut self.result);
        } else {
            workspace.evaluate(state, input, limits, &mut self.result);
        }
    }
}

/// Accelerations of a robot with flexible parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accelerations<'a> {
    /// Acceleration of the base frame, base axes; the linear part is that of its origin as a point.
    pub base: Twist,
    /// Joint accelerations \[rad/s² or m/s²\].
    pub joints: &'a [f64],
    /// Accelerations of the modal coordinates.
    pub modes: &'a [f64],
    /// Accelerations of the motors of elastic joints, on the output side \[rad/s²\].
    pub motors: &'a [f64],
    /// Accelerations of the wheels relative to their bodies \[rad/s²\].
    pub wheels: &'a [f64],
}

/// Rates of modes, motors and wheels at a stage.
#[derive(Clone, Debug)]
pub(super) struct ExtraRate {
    pub xd: Vec<f64>,
    pub xdd: Vec<f64>,
    pub losses: Losses,
    pub work: PartialWork,
}

impl FlexibleIntegrator {
    /// An integrator for `system` with one of the library's methods.
    pub fn new(system: &FlexibleSystem, method: IntegrationMethod) -> Self {
        Self::with_tableau(system, method.tableau())
    }

    /// An integrator for `system` with any explicit tableau.
    pub fn with_tableau(system: &FlexibleSystem, tableau: &'static Tableau) -> Self {
        let n = system.extras();
        let rate = ExtraRate {
            xd: vec![0.0; n],
            xdd: vec![0.0; n],
            losses: Losses::default(),
            work: PartialWork::default(),
        };
        Self {
            tableau,
            rates: vec![Rate::zero(system.model().dof()); tableau.c.len()],
            extra_rates: vec![rate; tableau.c.len()],
            stage: FlexibleState::at_rest(system),
            input: FlexibleInput::zero(system),
            equations: Equations {
                result: FlexibleEvaluation::zero(system),
                base_modes: BaseModes::new(system).map(Box::new),
            },
            system: system.clone(),
        }
    }

    /// The same integrator with the general equations for every robot, to check the faster ones.
    #[must_use]
    pub fn with_general_equations(mut self) -> Self {
        self.equations.base_modes = None;
        self
    }

    /// The robot.
    pub fn system(&self) -> &FlexibleSystem {
        &self.system
    }

    /// Advances `state` by `dt` \[s\], with `forcing` evaluated at every stage. Afterwards `workspace` holds the new
    /// state. A negative `dt` goes back in time with the valves of the thrusters as they are, and without speed limits
    /// of the wheels.
    ///
    /// # Panics
    /// If `state` or `workspace` is of another system, or `forcing` changes the length of a vector.
    pub fn step(
        &mut self,
        state: &mut FlexibleState,
        workspace: &mut FlexibleWorkspace,
        dt: f64,
        forcing: &mut impl FlexibleForcing,
    ) {
        self.steps(state, workspace, dt, 1, forcing);
    }

    /// Takes `count` steps of `dt` \[s\], bit-identical to single steps; `workspace` is updated only after the last
    /// one.
    ///
    /// # Panics
    /// As [`FlexibleIntegrator::step`].
    pub fn steps(
        &mut self,
        state: &mut FlexibleState,
        workspace: &mut FlexibleWorkspace,
        dt: f64,
        count: usize,
        forcing: &mut impl FlexibleForcing,
    ) {
        self.check(state, workspace);
        for _ in 0..count {
            let mut left = dt;
            loop {
                let part = next_switch(state, left);
                self.compute_step(state, workspace, part, part, forcing);
                self.accept(state, part);
                if part < left {
                    left -= part;
                } else {
                    break;
                }
            }
        }
        workspace.set_state(state);
    }

    /// Accelerations at `state` under `input`. Wheels have their torque limits; their speed limits apply at this
    /// instant.
    ///
    /// # Panics
    /// As [`FlexibleIntegrator::step`].
    pub fn accelerations(
        &mut self,
        state: &FlexibleState,
        workspace: &mut FlexibleWorkspace,
        input: &FlexibleInput,
    ) -> Accelerations<'_> {
        self.check(state, workspace);
        let limits = (0.0, state.wheel_speeds());
        self.equations.evaluate(state, workspace, input, limits);
        let result = &self.equations.result;
        let (modes, rotors) = result.xdd.split_at(self.system.modes());
        let (motors, wheels) = rotors.split_at(self.system.elastic_joints().len());
        Accelerations {
            base: result.tree.acceleration.A_WB_B,
            joints: result.tree.acceleration.qdd.as_slice(),
            modes,
            motors,
            wheels,
        }
    }

    /// Computes the accelerations of all frames at `state` under `input`: afterwards `workspace` holds state and
    /// accelerations ([`FlexibleWorkspace::A_WF_B`]).
    ///
    /// # Panics
    /// As [`FlexibleIntegrator::step`].
    pub fn set_accelerations(
        &mut self,
        state: &FlexibleState,
        workspace: &mut FlexibleWorkspace,
        input: &FlexibleInput,
    ) {
        self.check(state, workspace);
        let limits = (0.0, state.wheel_speeds());
        workspace.evaluate(state, input, limits, &mut self.equations.result);
        workspace.set_poses();
    }

    pub(super) fn check(&self, state: &FlexibleState, workspace: &FlexibleWorkspace) {
        assert!(
            self.system.is(workspace.system()),
            "the integrator and the workspace are of different systems"
        );
        assert!(
            state.fits(&self.system),
            "the state is of another system than the integrator"
        );
    }

    /// Computes a step of `dt` from `state` and leaves the result in `self.stage`. Wheel torques are limited for being
    /// held for `hold` \[s\]; 0 applies the speed limits at the start of the step only.
    pub(super) fn compute_step(
        &mut self,
        state: &FlexibleState,
        workspace: &mut FlexibleWorkspace,
        dt: f64,
        hold: f64,
        forcing: &mut impl FlexibleForcing,
    ) {
        let Self {
            system,
            tableau,
            rates,
            extra_rates,
            stage,
            input,
            equations,
        } = self;
        let mass = system.total_mass();
        let limits = (hold, state.wheel_speeds());
        let mut turned = Vector3::zeros();
        stage.on_time.copy_from_slice(&state.on_time);
        stage.open_for.copy_from_slice(&state.open_for);
        stage.impulse.copy_from_slice(&state.impulse);
        for (i, c) in tableau.c.iter().enumerate() {
            stage.tree.time = state.tree.time + c * dt;
            let at = if i == 0 { state } else { &*stage };
            forcing.apply(at.tree.time, at, input);
            checks::input(&input.tree, system.model());
            assert_eq!(
                input.wheel_torques.len(),
                system.wheels().len(),
                "input.wheel_torques must have one element per wheel"
            );
            equations.evaluate(at, workspace, input, limits);
            let result = &equations.result;
            rates[i].set(&at.tree, &result.tree, mass, &turned);
            extra_rates[i].xd.copy_from_slice(at.xd.as_slice());
            extra_rates[i].xdd.copy_from_slice(&result.xdd);
            extra_rates[i].losses = result.losses;
            extra_rates[i].work = result.partial_power;
            let weights = tableau.weights_after(i);
            turned = advance(&mut stage.tree, &state.tree, &rates[..=i], weights, dt);
            advance_extras(stage, state, &extra_rates[..=i], weights, dt);
        }
        stage.tree.time = state.tree.time + dt;
        stage.tree.R_WB.renormalize_fast();
    }

    /// Replaces `state` by the result of the step of `dt`.
    pub(super) fn accept(&mut self, state: &mut FlexibleState, dt: f64) {
        std::mem::swap(state, &mut self.stage);
        let joints = self.system.model().joints();
        let weights = self.tableau.weights_after(self.tableau.c.len() - 1);
        state.tree.dissipated.damping += damping_loss(&self.rates, weights, joints, dt);
        for (i, thruster) in self.system.thrusters().iter().enumerate() {
            if state.on_time[i] > 0.0 {
                state.impulse[i] += thruster.thrust * dt;
                state.on_time[i] = (state.on_time[i] - dt).max(0.0);
                state.open_for[i] += dt;
            }
            if state.on_time[i] <= 0.0 {
                state.open_for[i] = 0.0;
            }
        }
    }

    /// Time in the computed step of `dt` from `state` at which the first wheel reaches its speed limit, by linear
    /// interpolation; `None` if no wheel passes its limit.
    pub(super) fn until_wheel_limit(&self, state: &FlexibleState, dt: f64) -> Option<f64> {
        let speeds = state.wheel_speeds().iter().zip(self.stage.wheel_speeds());
        let wheels = self.system.wheels().iter().zip(speeds);
        let parts = wheels.filter_map(|(wheel, (start, end))| {
            let (limit, start, end) = (wheel.speed_limit(), start.abs(), end.abs());
            let margin = Wheel::AT_LIMIT * limit;
            // From inside to outside.
            let passes = start < limit - margin && end > limit;
            // The middle of the margin at the limit.
            passes.then(|| dt * (limit - 0.5 * margin - start) / (end - start))
        });
        parts.reduce(f64::min)
    }
}

/// The part of `left` \[s\] until the next thruster switches off; all of `left` if it is negative.
pub(super) fn next_switch(state: &FlexibleState, left: f64) -> f64 {
    let open = state.on_time.iter().filter(|t| **t > 0.0);
    let next = open.fold(left, |next, t| next.min(*t));
    // A remainder that is only rounding is joined to this part.
    if left - next < 1e-12 * left {
        left
    } else {
        next
    }
}

/// `into = from + dt Σ weights rates` of modes, motors and wheels.
#[inline(always)]
fn advance_extras(
    into: &mut FlexibleState,
    from: &FlexibleState,
    rates: &[ExtraRate],
    weights: &[f64],
    dt: f64,
) {
    let (x, xd) = (into.x.as_mut_slice(), into.xd.as_mut_slice());
    x.copy_from_slice(from.x.as_slice());
    xd.copy_from_slice(from.xd.as_slice());
    (into.losses, into.partial_work) = (from.losses, from.partial_work);
    for (rate, weight) in rates.iter().zip(weights) {
        if *weight == 0.0 {
            continue;
        }
        let k = dt * weight;
        into.losses.add_scaled(&rate.losses, k);
        into.partial_work.add_scaled(&rate.work, k);
        for ((x, xd), (x_rate, xd_rate)) in
            (x.iter_mut().zip(xd.iter_mut())).zip(rate.xd.iter().zip(&rate.xdd))
        {
            *x += x_rate * k;
            *xd += xd_rate * k;
        }
    }
}
