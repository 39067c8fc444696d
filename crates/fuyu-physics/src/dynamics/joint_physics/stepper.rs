//! Steps from event to event.

use super::JointPhysics;
use super::collocation::{Acting, Collocation};
use super::joint_contacts::{Event, JointContacts};
use crate::dynamics::{Input, State};
use crate::model::Model;

/// Smallest piece of a step that is tried if the collocation does not converge, or is not accurate.
const SMALLEST_PIECE: f64 = 1e-6;

/// Largest error of the energy balance of a piece, relative to the sum of its energies, for the methods of order 4 and
/// 8. Smooth motion is far more accurate, except while a strong damper stops a joint in a fraction of a step and the
/// inertia changes at the same time: the step is then divided.
const ENERGY_ERROR: [f64; 2] = [1e-8, 1e-11];

/// Number of divisions of a step, and of a piece that does not converge, after which the rest of the step is accepted
/// as it is. The iteration does not converge at any length if the efforts are not a function of time and state, such as
/// those of a control law that depends on its last call.
const ATTEMPTS: usize = 1000;
const DIVERGED: usize = 16;

/// Error, relative to the largest accepted one, below which the next piece is twice as long.
const DOUBLED: f64 = 1e-3;

/// Decay of the fastest mode in a step up to which an explicit method is accurate.
const SLOW_DECAY: f64 = 0.5;

/// Number of events in a step after which no more are located: in the rest of the step a joint may exceed a limit by
/// its motion. No real mechanism has as many events.
const EVENTS: usize = 200;

/// Iterations that locate an event; each halves the bracket at least.
const LOCATING: usize = 80;

/// Excess of an event up to which it counts as located: position \[rad or m\], rate, or effort over its range.
const ROUNDING: f64 = 1e-14;

/// Width of the bracket at which an event is located, relative to the step.
const LOCATED: f64 = 1e-15;

/// Integrates the steps of a robot whose joints have damping, friction or limits.
#[derive(Debug, Clone)]
pub(in crate::dynamics) struct Stepper {
    contacts: JointContacts,
    collocation: Collocation,
    /// Whether damping or friction acts in every step.
    acts_always: bool,
    has_limits: bool,
    /// State at the start of a piece of the step.
    start: State,
    total: Input,
}

impl Stepper {
    /// A stepper for a tableau with `stages` stages; `None` if the model's joints have nothing to simulate. With closed
    /// loops (not `is_tree`), only damping is simulated.
    pub fn new(
        model: &Model,
        settings: &JointPhysics,
        stages: usize,
        is_tree: bool,
    ) -> Option<Self> {
        let settings = if is_tree {
            settings
        } else {
            &JointPhysics::DAMPING_ONLY
        };
        let contacts = JointContacts::new(model, settings);
        let is_damped = model.joints().iter().any(|joint| joint.damping != 0.0);
        let acts_always = is_damped || contacts.has_friction();
        let has_limits = contacts.has_limits();
        (acts_always || has_limits).then(|| Self {
            collocation: Collocation::new(model, stages),
            start: State::at_rest(model),
            total: Input::zero(model),
            contacts,
            acts_always,
            has_limits,
        })
    }

    /// Whether an explicit step from `start` to `end` is valid, since no limit was reached in it.
    pub fn is_free(&self, start: (&[f64], &[f64]), end: (&[f64], &[f64]), dt: f64) -> bool {
        !self.acts_always && self.contacts.respected(start, end, dt)
    }

    /// Whether every step needs [`Stepper::step`].
    pub fn acts_always(&self) -> bool {
        self.acts_always
    }

    /// Evaluates the equations of motion at `state` with all efforts in the joints. The result is in
    /// `acting.equations`; the workspace holds positions, motion and external wrench as after any evaluation.
    pub fn evaluate(&mut self, state: &State, acting: &mut Acting) {
        let Self {
            contacts,
            total,
            start,
            has_limits,
            ..
        } = self;
        if !acting.equations.loops.closures().is_empty()
            || !(*has_limits || contacts.has_friction())
        {
            acting
                .equations
                .evaluate(state, acting.workspace, acting.input);
            return;
        }
        start.copy_from(state);
        contacts.begin(start, acting.workspace);
        contacts.choose(start, acting, total);
        total.copy_from(acting.input);
        let efforts = contacts.sliding.iter().zip(&contacts.at_start_holding);
        for (effort, (sliding, holding)) in total.efforts.iter_mut().zip(efforts) {
            *effort += sliding + holding;
        }
        acting.equations.evaluate(state, acting.workspace, total);
    }

    /// Whether an explicit step of `dt` \[s\] is accurate for a mechanism with closed loops. If the mechanism passes a
    /// singular configuration, the iteration of [`Stepper::step`] does not converge, since the constraints change
    /// within the step.
    pub fn is_explicit_mechanism(
        &mut self,
        state: &mut State,
        dt: f64,
        acting: &mut Acting,
    ) -> bool {
        if acting.equations.loops.closures().is_empty() {
            return false;
        }
        acting.equations.loops.project(state, acting.workspace);
        self.contacts.begin(state, acting.workspace);
        self.collocation.start(state, &self.contacts, acting);
        self.collocation.fastest_decay() * dt <= SLOW_DECAY
    }

    /// Advances `state` by `dt` \[s\].
    pub fn step(&mut self, state: &mut State, dt: f64, acting: &mut Acting) {
        let end_time = state.time + dt;
        acting.equations.loops.project(state, acting.workspace);
        self.contacts.begin(state, acting.workspace);
        let (mut left, mut piece, mut events) = (dt, dt, 0);
        let mut attempts = 0;
        while left > 0.0 {
            self.start.copy_from(state);
            self.contacts.choose(&self.start, acting, &mut self.total);
            self.collocation.start(&self.start, &self.contacts, acting);
            let (length, error) =
                self.advance_divided((piece.min(left), left, dt), &mut attempts, acting);
            piece = length;
            let event = match events < EVENTS {
                true => self.find_event(piece, dt, acting),
                false => None,
            };
            if let Some((taken, joint, event)) = event {
                events += 1;
                std::mem::swap(state, &mut self.collocation.end.state);
                if taken > 0.0 {
                    self.contacts.locked.fill(false);
                } else {
                    // The joint would start to move only by rounding.
                    state.copy_from(&self.start);
                    self.contacts.locked[joint] = true;
                }
                self.contacts.happen(joint, event, state, acting.workspace);
                left -= taken;
            } else {
                std::mem::swap(state, &mut self.collocation.end.state);
                self.contacts.locked.fill(false);
                left = if piece >= left { 0.0 } else { left - piece };
                if error < DOUBLED {
                    piece *= 2.0;
                }
            }
        }
        state.time = end_time;
    }

    /// Advances by `piece`, or by the largest of its halves, quarters, ... that is accurate. Returns the piece taken
    /// and the error of the energy balance relative to the largest accepted one. `attempts` counts the divisions in the
    /// step of `dt`, of which `left` remains.
    fn advance_divided(
        &mut self,
        (mut piece, left, dt): (f64, f64, f64),
        attempts: &mut usize,
        acting: &mut Acting,
    ) -> (f64, f64) {
        let mut error = self.advance_accurately(piece, acting);
        let mut diverged = 0;
        while error > 1.0 && piece > SMALLEST_PIECE * dt && *attempts < ATTEMPTS {
            *attempts += 1;
            diverged = if error.is_finite() { 0 } else { diverged + 1 };
            if diverged > DIVERGED {
                *attempts = ATTEMPTS;
                piece = left;
            } else {
                piece *= 0.5;
            }
            error = self.advance_accurately(piece, acting);
        }
        (piece, error)
    }

    /// Computes a piece of the step from `self.start`; returns whether it has converged.
    fn advance(&mut self, piece: f64, acting: &mut Acting) -> bool {
        self.collocation
            .step(&self.start, piece, &mut self.contacts, acting)
    }

    /// [`Self::advance`], but returns the error of the energy balance relative to the largest accepted one; infinite if
    /// the piece has not converged.
    fn advance_accurately(&mut self, piece: f64, acting: &mut Acting) -> f64 {
        if !self.advance(piece, acting) {
            return f64::INFINITY;
        }
        let error = self.collocation.energy_error(&self.start, acting);
        error / ENERGY_ERROR[usize::from(self.collocation.order() > 4)]
    }

    /// The event that is exceeded most at the end of a piece, as [`JointContacts::furthest`].
    fn past(&mut self, piece: f64, acting: &mut Acting) -> (usize, Event, f64) {
        self.advance(piece, acting);
        self.past_at_end(acting)
    }

    fn past_at_end(&mut self, acting: &mut Acting) -> (usize, Event, f64) {
        let is_held = self.contacts.held.contains(&true);
        if is_held {
            self.collocation.evaluate_end(&mut self.contacts, acting);
        }
        let end = &self.collocation.end;
        self.contacts
            .furthest(&end.state, is_held.then_some(&end.holding))
    }

    /// The first event within a piece that has been integrated: its time from the start of the piece, its joint, and
    /// its type. Afterwards the integrated piece ends at the event.
    fn find_event(
        &mut self,
        piece: f64,
        dt: f64,
        acting: &mut Acting,
    ) -> Option<(f64, usize, Event)> {
        let (mut before, mut after) = (0.0, None);
        for node in &self.collocation.at_nodes {
            let found = self.contacts.furthest(&node.state, Some(&node.holding));
            let time = node.state.time - self.start.time;
            if found.2 > 0.0 {
                after = Some(time);
                break;
            }
            before = time;
        }
        if after.is_none() {
            let found = self.past_at_end(acting);
            if found.2 <= 0.0 {
                return None;
            }
            after = Some(piece);
        }
        let mut after = after?;
        let mut found = self.past(after, acting);
        let mut past_before = if before > 0.0 {
            self.past(before, acting).2
        } else {
            0.0
        };
        if found.2 <= 0.0 {
            // The states at the nodes are less accurate than those at the end of a piece: there was no event. The piece
            // ends here, and the next one begins.
            let _ = self.past(after, acting);
            return Some((after, found.0, Event::Release));
        }
        // Illinois method: false position that halves the value of an end that stays.
        let mut past_after = found.2;
        let mut last_side = 0;
        for _ in 0..LOCATING {
            if after - before <= LOCATED * dt {
                break;
            }
            let middle = 0.5 * (before + after);
            let guess = before - past_before * (after - before) / (past_after - past_before);
            let inside = guess > before && guess < after && past_before < 0.0;
            let time = if inside { guess } else { middle };
            let at = self.past(time, acting);
            if at.2.abs() <= ROUNDING {
                return Some((time, at.0, at.1));
            }
            if at.2 > 0.0 {
                (after, past_after, found) = (time, at.2, at);
                if last_side == 1 {
                    past_before *= 0.5;
                }
                last_side = 1;
            } else {
                (before, past_before) = (time, at.2);
                if last_side == -1 {
                    past_after *= 0.5;
                }
                last_side = -1;
            }
        }
        if before == 0.0 {
            return Some((0.0, found.0, found.1));
        }
        self.advance(after, acting);
        Some((after, found.0, found.1))
    }
}
