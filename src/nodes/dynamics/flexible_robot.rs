//! A robot with flexible parts, wheels or thrusters, with the target that it may hold.

use crate::dynamics::{
    Floating, IntegrationMethod,
    capture::{CaptureError, CapturedGyrostat, Grasp, ReleaseSpring},
    flexible::{FlexibleFloating, FlexibleForcing, FlexibleState},
};

/// A robot with flexible parts, wheels or thrusters. While it holds a target, the joined system of both is integrated,
/// and its motion is copied to the robot itself, so that other modules need not distinguish the two cases.
pub struct FlexibleRobot {
    own: FlexibleFloating,
    held: Option<Held>,
}

/// The held target and the joined system.
struct Held {
    /// Name of the target.
    target: String,
    captured: CapturedGyrostat,
}

impl FlexibleRobot {
    /// A robot without a held target.
    pub fn new(own: FlexibleFloating) -> Self {
        Self { own, held: None }
    }

    /// The robot without a held target.
    pub fn own(&self) -> &FlexibleFloating {
        &self.own
    }

    /// Mutable access to the robot itself, for commands. Its motion must not be changed while it holds a target.
    pub fn own_mut(&mut self) -> &mut FlexibleFloating {
        &mut self.own
    }

    /// State of the robot including a held target.
    pub fn whole_state(&self) -> &FlexibleState {
        match &self.held {
            Some(held) => held.captured.floating().state(),
            None => self.own.state(),
        }
    }

    /// Name of the held target.
    pub fn held(&self) -> Option<&str> {
        self.held.as_ref().map(|held| held.target.as_str())
    }

    /// Grasps a target: the impulse of the capture changes the motion of both. Returns the energy lost \[J\].
    ///
    /// # Errors
    /// [`CaptureError`], also if it holds the target already; nothing has changed then.
    pub fn grasp(
        &mut self,
        (name, target): (&str, &mut Floating),
        grasp: &Grasp,
        method: IntegrationMethod,
    ) -> Result<f64, CaptureError> {
        if self.held.is_some() {
            let robot = self.own.model().name().to_owned();
            return Err(CaptureError::SecondGrasp(robot));
        }
        let (captured, impulse) = CapturedGyrostat::new(&self.own, target, grasp, method)?;
        captured.copy_robot_to(&mut self.own);
        captured.copy_target_to(target);
        self.held = Some(Held {
            target: name.to_owned(),
            captured,
        });
        Ok(impulse.energy_lost)
    }

    /// Opens the grasp; a `spring` pushes robot and target apart.
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
    pub fn set_state(&mut self, state: FlexibleState) {
        self.let_go();
        self.own.set_state(state);
    }

    /// Computes the accelerations of all frames under the held input.
    pub fn set_accelerations(&mut self) {
        match &mut self.held {
            Some(held) => {
                held.captured.hold_robot_input(&self.own);
                held.captured.copy_robot_accelerations_to(&mut self.own);
            }
            None => self.own.set_accelerations(),
        }
    }

    /// Advances by `steps` steps of `dt` \[s\] under the held input.
    pub fn step(&mut self, dt: f64, steps: usize) {
        match &mut self.held {
            Some(held) => {
                held.captured.hold_robot_input(&self.own);
                held.captured.step(dt, steps);
                held.captured.copy_robot_to(&mut self.own);
            }
            None => self.own.step(dt, steps),
        }
    }

    /// Advances by one step of `dt` \[s\]; at every stage, `forcing` changes the held input.
    pub fn step_with(&mut self, dt: f64, forcing: &mut impl FlexibleForcing) {
        match &mut self.held {
            Some(held) => {
                held.captured.step_with(dt, &mut self.own, forcing);
                held.captured.copy_robot_to(&mut self.own);
            }
            None => self.own.step_with(dt, forcing),
        }
    }
}
