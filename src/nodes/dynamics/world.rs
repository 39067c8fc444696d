//! The simulated world: the robot and the free bodies, at one time.

use super::imu::ImuParams;
use super::joint_drive::{DriveMode, JointDrive, step_count};
use super::loops::LoopParams;
use super::params::{DynamicsParams, joint_vector};
use super::target::Target;
use super::tick_time::TickTime;
use crate::{
    dynamics::{Floating, FormulationKind, State},
    nodes::choice,
};

/// The robot and the free bodies. They share nothing but time.
pub struct World {
    /// The robot.
    pub robot: Floating,
    /// The free bodies.
    pub targets: Vec<Target>,
    /// The robot's state at the start.
    start: State,
    /// The last finite state of the robot before the present one.
    last_finite: State,
    drive: JointDrive,
    imu: ImuParams,
    time: TickTime,
    /// Longest integration step \[s\].
    time_step: f64,
}

impl World {
    /// The world as the parameters describe it, at time zero.
    ///
    /// # Errors
    /// A line that names file or parameter.
    pub fn new(params: &DynamicsParams) -> Result<Self, String> {
        let model = params.robot.compile()?;
        let q = &params.initial_joint_positions;
        let mut state = State::at_rest_with(
            &model,
            &joint_vector("initial_joint_positions", q, model.dof())?,
        );
        let qd = &params.initial_joint_velocities;
        state.qd = joint_vector("initial_joint_velocities", qd, model.dof())?;
        let mut loops =
            LoopParams::loops(&params.loop_closures, &model).map_err(|e| e.to_string())?;
        (loops.assemble(&mut state, params.loop_tolerance)).map_err(|e| e.to_string())?;
        params.base.place(&model, &mut state);
        let robot = Floating::with_loops(loops, state, params.method);
        let robot = robot.with_formulation(params.formulation).map_err(|e| {
            let name = choice::name_of(&FormulationKind::NAMES, &params.formulation);
            format!("parameter formulation is '{name}': {e}")
        })?;
        let targets = params.targets.iter().map(|target| {
            Target::new(
                &target.name,
                &target.description,
                &target.motion,
                params.method,
            )
        });
        Ok(Self {
            drive: JointDrive::new(&robot, &params.servo)?,
            start: robot.state().clone(),
            last_finite: robot.state().clone(),
            robot,
            targets: targets.collect::<Result<_, _>>()?,
            imu: params.imu,
            time: TickTime::new(params.state_rate),
            time_step: params.time_step,
        })
    }

    /// Time \[s\].
    pub fn time(&self) -> f64 {
        self.time.now()
    }

    /// Time of the next state to publish \[s\].
    pub(super) fn next_tick(&self) -> f64 {
        self.time.next_tick()
    }

    /// Number of the last state that was due for publication.
    pub(super) fn ticks(&self) -> u64 {
        self.time.ticks()
    }

    /// Index of the target called `name`.
    ///
    /// # Errors
    /// A line that lists the targets there are.
    pub fn target_index(&self, name: &str) -> Result<usize, String> {
        let found = self.targets.iter().position(|t| t.name == name);
        found.ok_or_else(|| {
            let known: Vec<_> = self.targets.iter().map(|t| t.name.as_str()).collect();
            match known.as_slice() {
                [] => format!("'{name}' is not there: the dynamics node has no targets"),
                _ => format!("'{name}' is not one of {}", known.join(", ")),
            }
        })
    }

    /// Time is zero again; the bodies stay as they are.
    pub(super) fn reset_time(&mut self) {
        self.time.reset();
    }

    /// Robot and free bodies return to their states at the start, or to those in which they were spawned. Nothing acts
    /// on them.
    pub(super) fn reset_state(&mut self) {
        self.robot.set_state(self.start.clone());
        self.drive.reset(&mut self.robot);
        for target in &mut self.targets {
            target.reset();
        }
    }

    /// Errors of the inertial measurement unit.
    pub(super) fn imu(&self) -> &ImuParams {
        &self.imu
    }

    /// What the robot's description contains but is not simulated, as a line; `None` if all of it is.
    pub fn not_simulated(&self) -> Option<String> {
        let joints = self.robot.model().joints().iter();
        let with_friction: Vec<_> = joints
            .filter(|j| j.friction != 0.0)
            .map(|j| j.name.as_str())
            .collect();
        (!with_friction.is_empty()).then(|| {
            format!(
                "Coulomb friction of {} is not simulated; damping is",
                with_friction.join(", ")
            )
        })
    }

    /// Checks that all states are finite.
    ///
    /// # Errors
    /// A line with the time and what helps.
    pub fn check_finite(&self) -> Result<(), String> {
        let targets = self.targets.iter().map(|t| &t.body);
        if std::iter::once(&self.robot)
            .chain(targets)
            .all(|body| body.state().is_finite())
        {
            return Ok(());
        }
        Err(format!(
            "the simulated state is no longer finite at {:.3} s: the motion is too fast for a time_step of {} s, lower it",
            self.time(),
            self.time_step
        ))
    }

    /// Steps to the next tick.
    pub fn step_to_tick(&mut self) {
        let seconds = self.time.advance_to_tick();
        self.step_by(seconds);
        self.drive.finish_tick(self.time.period());
    }

    /// Steps to the next tick. If a state is not finite then, the robot gets its last finite state and zero efforts, so
    /// that a commander that asks for too much does not end the simulation for all others.
    ///
    /// # Errors
    /// As [`Self::check_finite`] before the robot's state was replaced.
    pub(super) fn step_to_tick_or_restore(&mut self) -> Result<(), String> {
        self.step_to_tick();
        self.check_finite().inspect_err(|_| {
            self.robot.set_state(self.last_finite.clone());
            self.drive.release(&mut self.robot);
            self.drive.discard_efforts();
        })
    }

    /// Steps to `time` \[s\], but not beyond the next tick. Does nothing if `time` is in the past.
    pub(super) fn step_within_tick(&mut self, time: f64) {
        if let Some(seconds) = self.time.advance_within_tick(time) {
            self.step_by(seconds);
        }
    }

    /// Mean joint efforts between the last two ticks \[N m or N\].
    pub(super) fn mean_efforts(&self) -> &[f64] {
        self.drive.mean_efforts()
    }

    /// Holds joint `efforts` (joint index, effort \[N m or N\]) from now on, cut to the joints' limits. Other joints keep
    /// their effort, or get zero if rates were driven until now. Returns whether any was cut.
    pub fn hold_efforts(&mut self, efforts: impl IntoIterator<Item = (usize, f64)>) -> bool {
        self.drive.hold_efforts(&mut self.robot, efforts)
    }

    /// Lets a servo drive the joints to `rates` (joint index, rate \[rad/s or m/s\]) from now on, cut to the joints'
    /// limits. Other joints keep their reference, or get zero if efforts were held until now. Returns whether any was cut.
    pub fn drive_rates(&mut self, rates: impl IntoIterator<Item = (usize, f64)>) -> bool {
        self.drive.drive_rates(&self.robot, rates)
    }

    /// What the joints' drives do.
    pub(super) fn drive_mode(&self) -> DriveMode {
        self.drive.mode()
    }

    /// Puts the joints' drives into their safe state, as [`JointDrive::halt`].
    pub(super) fn halt(&mut self) {
        self.drive.halt(&mut self.robot);
    }

    fn step_by(&mut self, seconds: f64) {
        if self.robot.state().is_finite() {
            self.last_finite.copy_from(self.robot.state());
        }
        (self.drive).step(&mut self.robot, seconds, self.time_step);
        let steps = step_count(seconds, self.time_step);
        for target in &mut self.targets {
            target.body.step(seconds / steps as f64, steps);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::scenario::Scenario;

    fn world(config: &str) -> World {
        let scenario = Scenario::read(&format!("package://fuyu/config/{config}.yaml")).unwrap();
        World::new(&scenario.dynamics().unwrap()).unwrap()
    }

    #[test]
    fn a_state_that_is_not_finite_is_replaced_by_the_last_finite_one() {
        let mut world = world("positioning");
        world.hold_efforts([(0, 1.0)]);
        world.step_to_tick_or_restore().unwrap();
        let finite = world.robot.state().clone();
        world.robot.input_mut().efforts[0] = f64::NAN;
        // The step before the tick makes it not finite already.
        world.step_within_tick(0.015);
        assert!(!world.robot.state().is_finite());
        let problem = world.step_to_tick_or_restore().unwrap_err();
        assert!(problem.contains("no longer finite at 0.020 s"), "{problem}");
        assert_eq!(*world.robot.state(), finite);
        assert_eq!(world.robot.efforts().amax(), 0.0);
        assert!(world.mean_efforts().iter().all(|effort| *effort == 0.0));
        world.step_to_tick_or_restore().unwrap();
        assert_eq!(world.ticks(), 3);
    }

    // Would break if a command in the middle of a period cost an integration step more in a free body.
    #[test]
    fn steps_within_a_period_end_at_the_same_tick() {
        let mut world = world("servicing");
        world.step_within_tick(0.004);
        world.step_within_tick(0.002);
        assert_eq!(world.time(), 0.004);
        world.step_to_tick();
        assert_eq!((world.time(), world.ticks()), (0.01, 1));
        assert!((world.robot.state().time - 0.01).abs() < 1e-15);
        assert!((world.targets[0].body.state().time - 0.01).abs() < 1e-15);
    }

    // Would break if a step copied states or efforts into new memory.
    #[test]
    fn steps_and_commands_do_not_allocate() {
        let mut world = world("servicing");
        let mut steps = || {
            world.hold_efforts([(0, 0.1)]);
            world.step_within_tick(world.time() + 0.003);
            world.step_to_tick_or_restore().unwrap();
            world.drive_rates([(1, 0.01)]);
            world.step_to_tick_or_restore().unwrap();
        };
        steps();
        assert_eq!(allocation_counter::measure(steps).count_total, 0);
    }

    #[test]
    fn a_reset_restores_the_start() {
        let mut world = world("servicing");
        let start = (
            world.robot.state().clone(),
            world.targets[0].body.state().clone(),
        );
        world.drive_rates([(0, 0.1)]);
        for _ in 0..10 {
            world.step_to_tick();
        }
        world.reset_time();
        world.reset_state();
        assert_eq!(*world.robot.state(), start.0);
        assert_eq!(*world.targets[0].body.state(), start.1);
        assert_eq!((world.time(), world.drive_mode()), (0.0, DriveMode::Effort));
        assert!(world.mean_efforts().iter().all(|effort| *effort == 0.0));
    }
}
