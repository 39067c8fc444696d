//! A rigid robot with the target that it may hold and the bodies that it may touch.

use super::contact_system::ContactSystem;
use crate::{
    dynamics::{
        Floating, Forcing, Input, IntegrationMethod, JointPhysics, Momentum, State,
        capture::{CaptureError, Captured, Grasp, ReleaseSpring},
    },
    model::Frame,
    spatial::Pose,
};

/// A rigid robot. While it holds a target, the joined system of both is integrated; with contact, together with all
/// bodies that may touch. The resulting motion is copied to the robot itself, so that other modules need not
/// distinguish the cases.
pub struct RigidRobot {
    own: Floating,
    held: Option<Held>,
    contact_system: Option<Box<ContactSystem>>,
}

/// The held target and the joined system.
struct Held {
    /// Name of the target.
    target: String,
    captured: Captured,
}

impl RigidRobot {
    /// A robot without a held target.
    pub fn new(own: Floating) -> Self {
        Self {
            own,
            held: None,
            contact_system: None,
        }
    }

    /// Replaces the contact world in which the robot and a held target are integrated. Returns the previous one.
    pub(super) fn set_contact_system(
        &mut self,
        contact_system: Option<ContactSystem>,
    ) -> Option<ContactSystem> {
        let before = std::mem::replace(&mut self.contact_system, contact_system.map(Box::new));
        before.map(|before| *before)
    }

    /// The contact world, if there is contact. After a grasp or release it is out of date until contact is set up again
    /// ([`Self::current_contact_system`]).
    pub fn contact_system(&self) -> Option<&ContactSystem> {
        self.contact_system.as_deref()
    }

    /// Mutable [`Self::contact_system`].
    pub(super) fn contact_system_mut(&mut self) -> Option<&mut ContactSystem> {
        self.contact_system.as_deref_mut()
    }

    /// The contact world, if it is up to date: robot and held target are integrated in it.
    pub(super) fn current_contact_system(&self) -> Option<&ContactSystem> {
        (self.contact_system.as_deref()).filter(|contact_system| contact_system.is_of(self.whole()))
    }

    /// The joined system of robot and held target.
    pub(super) fn captured(&self) -> Option<&Captured> {
        self.held.as_ref().map(|held| &held.captured)
    }

    /// Chooses new axes for the ball joint of a spherical grasp if two of its axes are nearly aligned.
    pub(super) fn choose_axes_if_tilted(&mut self) {
        if let Some(held) = &mut self.held {
            held.captured.choose_axes_if_tilted();
        }
    }

    /// Momentum of all that is integrated together with the robot, angular about the common centre of mass.
    pub(super) fn whole_momentum(&self) -> Momentum {
        match self.current_contact_system() {
            Some(contact_system) => contact_system.momentum(),
            None => self.whole().state().momentum_W,
        }
    }

    /// Work of contacts on the robot since contact was set up \[J\].
    pub(super) fn contact_work(&self) -> f64 {
        (self.current_contact_system())
            .map_or(0.0, |contact_system| contact_system.world().contact_work(0))
    }

    /// The robot without a held target.
    pub fn own(&self) -> &Floating {
        &self.own
    }

    /// Mutable access to the robot itself. Its state must not be changed while it holds a target.
    pub fn own_mut(&mut self) -> &mut Floating {
        &mut self.own
    }

    /// The robot, or the joined system with a held target.
    pub fn whole(&self) -> &Floating {
        match &self.held {
            Some(held) => held.captured.floating(),
            None => &self.own,
        }
    }

    /// Whether the target is held by two grasps, which form a closed loop.
    pub(super) fn has_second_grasp(&self) -> bool {
        self.captured().is_some_and(Captured::has_loops)
    }

    /// Name of the held target.
    pub fn held(&self) -> Option<&str> {
        self.held.as_ref().map(|held| held.target.as_str())
    }

    /// Grasps a target: the impulse of the capture changes the motion of both. If the target is held already, a second
    /// grasp closes a loop. Returns the energy lost \[J\].
    ///
    /// # Errors
    /// [`CaptureError`]; nothing has changed then.
    pub fn grasp(
        &mut self,
        (name, target): (&str, &mut Floating),
        grasp: &Grasp,
        method: IntegrationMethod,
        joint_physics: &JointPhysics,
    ) -> Result<f64, CaptureError> {
        let impulse = match &mut self.held {
            Some(held) => (held.captured).grasp_again(&grasp.robot, &grasp.target, grasp.latch)?,
            None => {
                let (captured, impulse) = Captured::new(&self.own, target, grasp, method)?;
                self.held = Some(Held {
                    target: name.to_owned(),
                    captured: captured.with_joint_physics(joint_physics),
                });
                impulse
            }
        };
        if let Some(held) = &self.held {
            held.captured.copy_robot_to(&mut self.own);
            held.captured.copy_target_to(target);
        }
        Ok(impulse.energy_lost)
    }

    /// Opens all grasps; a `spring` pushes robot and target apart.
    pub fn release(&mut self, target: &mut Floating, spring: Option<&ReleaseSpring>) {
        if let Some(held) = self.held.take() {
            let released = held.captured.release(spring);
            self.own.set_state(released.robot);
            target.set_state(released.target);
        }
    }

    /// Forgets the held target; the robot keeps its motion.
    pub fn let_go(&mut self) {
        self.held = None;
    }

    /// Copies the motion of the held target in the joined system to `target`.
    pub fn copy_target_to(&self, target: &mut Floating) {
        if let Some(held) = &self.held {
            held.captured.copy_target_to(target);
        }
    }

    /// Replaces the state; a held target is forgotten.
    pub fn restore(&mut self, state: &State) {
        self.let_go();
        self.own.set_state(state.clone());
    }

    /// Computes the accelerations of all frames under the held input and contacts.
    pub fn set_accelerations(&mut self) {
        match &mut self.held {
            Some(held) => {
                held.captured.hold_robot_input(self.own.input());
                let joined = held.captured.floating_mut();
                if let Some(contact_system) = &self.contact_system
                    && contact_system.is_of(joined)
                {
                    contact_system.add_wrenches(joined);
                }
                held.captured.copy_robot_accelerations_to(&mut self.own);
            }
            None => match current_system(&mut self.contact_system, &self.own) {
                Some(contact_system) => contact_system.set_accelerations(&mut self.own),
                None => {
                    self.own.accelerations();
                }
            },
        }
    }

    /// Advances by `steps` steps of `dt` \[s\] under the robot's held input.
    pub fn step(&mut self, dt: f64, steps: usize) {
        match &mut self.held {
            Some(held) => {
                held.captured.hold_robot_input(self.own.input());
                match current_system(&mut self.contact_system, held.captured.floating()) {
                    Some(contact_system) => {
                        contact_system.step(held.captured.floating_mut(), dt * steps as f64);
                    }
                    None => held.captured.step(dt, steps),
                }
                held.captured.copy_robot_to(&mut self.own);
            }
            None => match current_system(&mut self.contact_system, &self.own) {
                Some(contact_system) => contact_system.step(&mut self.own, dt * steps as f64),
                None => self.own.step(dt, steps),
            },
        }
    }

    /// Advances by one step of `dt` \[s\]; at every stage, `forcing` changes the held input.
    pub fn step_with(&mut self, dt: f64, forcing: &mut impl Forcing) {
        match &mut self.held {
            Some(held) => {
                let input = self.own.input_mut();
                match current_system(&mut self.contact_system, held.captured.floating()) {
                    Some(contact_system) => {
                        held.captured.step_by(input, forcing, |joined, forces| {
                            let mut forces = |time: f64, state: &State, input: &mut Input| {
                                forces(time, state, input);
                            };
                            contact_system.step_with(joined, dt, &mut forces);
                        })
                    }
                    None => (held.captured).step_with(dt, input, forcing),
                }
                held.captured.copy_robot_to(&mut self.own);
            }
            None => match current_system(&mut self.contact_system, &self.own) {
                Some(contact_system) => contact_system.step_with(&mut self.own, dt, forcing),
                None => self.own.step_with(dt, forcing),
            },
        }
    }
}

/// The contact world, if `system` is integrated in it.
fn current_system<'a>(
    contact_system: &'a mut Option<Box<ContactSystem>>,
    system: &Floating,
) -> Option<&'a mut ContactSystem> {
    (contact_system.as_deref_mut()).filter(|contact_system| contact_system.is_of(system))
}

/// A frame called `name` at pose `X_BF` of the base.
pub(super) fn frame_on_base(name: &str, X_BF: Pose) -> Frame {
    Frame {
        name: name.to_owned(),
        body: 0,
        parent: None,
        X_BF,
    }
}
