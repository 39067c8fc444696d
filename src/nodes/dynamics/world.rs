//! The simulated world: the robot and the free bodies, at one time.

use super::divergence::{self, StateBackup};
use super::imu::ImuParams;
use super::joint_drive::{DriveMode, JointDrive, step_count};
use super::loops::LoopParams;
use super::params::{DynamicsParams, joint_vector};
use super::target::Target;
use super::tick_time::TickTime;
use crate::{
    control::with_default_effort_limits,
    dynamics::{Floating, FormulationKind, State},
    model::Model,
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
    /// The robot's state before the last step.
    backup: StateBackup,
    drive: JointDrive,
    imu: ImuParams,
    time: TickTime,
    /// Longest integration step \[s\].
    time_step: f64,
    /// Names of the joints whose effort limit is the default, and its acceleration \[rad/s² or m/s²\].
    default_limits: (Vec<String>, f64),
}

impl World {
    /// The world as the parameters describe it, at time zero.
    ///
    /// # Errors
    /// A line that names file or parameter.
    pub fn new(params: &DynamicsParams) -> Result<Self, String> {
        let described = params.robot.compile()?;
        let (model, default_limits) = limited(&described, params.default_joint_acceleration);
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
        if let Some(what) = divergence::of(&robot) {
            return Err(format!(
                "the robot cannot be simulated from its start: {what}"
            ));
        }
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
            backup: StateBackup::new(&robot),
            robot,
            targets: targets.collect::<Result<_, _>>()?,
            imu: params.imu,
            time: TickTime::new(params.state_rate),
            time_step: params.time_step,
            default_limits,
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

    /// Which effort limits are not from the robot's description, as a line; `None` if all are.
    pub fn default_effort_limits(&self) -> Option<String> {
        let (joints, acceleration) = &self.default_limits;
        (!joints.is_empty()).then(|| {
            format!(
                "no effort limit for {}: limited to {acceleration} rad/s2 (or m/s2) of acceleration with the arm outstretched (default_joint_acceleration)",
                joints.join(", ")
            )
        })
    }

    /// Checks that no state has diverged ([`divergence::of`]).
    ///
    /// # Errors
    /// A line with the time, what moves too fast, and what helps.
    pub fn check_divergence(&self) -> Result<(), String> {
        let targets = self.targets.iter().map(|t| (t.name.as_str(), &t.body));
        for (name, body) in std::iter::once(("the robot", &self.robot)).chain(targets) {
            if let Some(what) = divergence::of(body) {
                return Err(self.diverged(name, &what));
            }
        }
        Ok(())
    }

    fn diverged(&self, name: &str, what: &str) -> String {
        let cause = match self.drive.mode() {
            DriveMode::Effort if self.robot.efforts().amax() > 0.0 => {
                "lower the efforts or gains, or sample the controller more often (state_rate)"
            }
            _ => "lower time_step",
        };
        format!(
            "the motion of {name} has diverged at {:.3} s, {what}: it is too fast for a time_step of {} s; {cause}",
            self.time(),
            self.time_step
        )
    }

    /// Steps to the next tick.
    pub fn step_to_tick(&mut self) {
        let seconds = self.time.advance_to_tick();
        self.step_by(seconds);
        self.drive.finish_tick(self.time.period());
    }

    /// Steps to the next tick, and restores what has diverged, as [`Self::restore_diverged`].
    ///
    /// # Errors
    /// As [`Self::check_divergence`], before anything was restored.
    pub(super) fn step_to_tick_or_restore(&mut self) -> Result<(), String> {
        self.step_to_tick();
        self.restore_diverged()
    }

    /// Steps to `time` \[s\], but not beyond the next tick, and restores what has diverged, as
    /// [`Self::restore_diverged`]. Does nothing if `time` is in the past.
    ///
    /// # Errors
    /// As [`Self::check_divergence`], before anything was restored.
    pub(super) fn step_within_tick_or_restore(&mut self, time: f64) -> Result<(), String> {
        let Some(seconds) = self.time.advance_within_tick(time) else {
            return Ok(());
        };
        self.step_by(seconds);
        self.restore_diverged()
    }

    /// Whether time is between two ticks.
    pub(super) fn is_between_ticks(&self) -> bool {
        self.time.is_between_ticks()
    }

    /// A body whose motion has diverged gets the state before its last step, so that a commander that asks for too much does
    /// not end the simulation for all others. The robot's joints are stopped, and its efforts are zero until the next
    /// command; momentum is conserved, unless it has diverged already since the last command: then the robot is stopped
    /// altogether. A target is stopped.
    ///
    /// # Errors
    /// As [`Self::check_divergence`], before anything was restored.
    fn restore_diverged(&mut self) -> Result<(), String> {
        let checked = self.check_divergence();
        if checked.is_err() {
            let time = self.time.now();
            if divergence::of(&self.robot).is_some() {
                self.backup.restore(&mut self.robot, time);
                self.drive.release(&mut self.robot);
                self.drive.discard_efforts();
            }
            for target in &mut self.targets {
                if divergence::of(&target.body).is_some() {
                    target.restore(time);
                }
            }
        }
        checked
    }

    /// Mean joint efforts between the last two ticks \[N m or N\].
    pub(super) fn mean_efforts(&self) -> &[f64] {
        self.drive.mean_efforts()
    }

    /// Holds joint `efforts` (joint index, effort \[N m or N\]) from now on, cut to the joints' limits. Other joints keep
    /// their effort, or get zero if rates were driven until now. Returns whether any was cut.
    pub fn hold_efforts(&mut self, efforts: impl IntoIterator<Item = (usize, f64)>) -> bool {
        self.backup.command();
        self.drive.hold_efforts(&mut self.robot, efforts)
    }

    /// Lets a servo drive the joints to `rates` (joint index, rate \[rad/s or m/s\]) from now on, cut to the joints'
    /// limits. Other joints keep their reference, or get zero if efforts were held until now. Returns whether any was cut.
    pub fn drive_rates(&mut self, rates: impl IntoIterator<Item = (usize, f64)>) -> bool {
        self.backup.command();
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
        self.backup.save(&self.robot);
        (self.drive).step(&mut self.robot, seconds, self.time_step);
        let steps = step_count(seconds, self.time_step);
        for target in &mut self.targets {
            target.step(seconds / steps as f64, steps);
        }
    }
}

/// The robot with effort limits for all joints, the names of those whose description gives none, and the `acceleration`
/// \[rad/s² or m/s²\] of the limits that they get. With zero they get none.
fn limited(described: &Model, acceleration: f64) -> (Model, (Vec<String>, f64)) {
    let unlimited = (described.joints().iter()).filter(|joint| joint.limits.effort.is_infinite());
    let names: Vec<_> = unlimited.map(|joint| joint.name.clone()).collect();
    match acceleration == 0.0 || names.is_empty() {
        true => (described.clone(), (Vec::new(), acceleration)),
        false => (
            with_default_effort_limits(described, acceleration),
            (names, acceleration),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        dynamics::Workspace,
        nodes::{
            dynamics::{imu, joint_states, momentum},
            scenario::Scenario,
        },
        ros::Time,
        spatial::Twist,
    };
    use nalgebra::{Isometry3, Vector3};

    fn params(config: &str) -> DynamicsParams {
        let scenario = Scenario::read(&format!("package://fuyu/config/{config}.yaml")).unwrap();
        scenario.dynamics().unwrap()
    }

    fn world(config: &str) -> World {
        World::new(&params(config)).unwrap()
    }

    /// All numbers that are published are finite.
    fn assert_publishable(world: &mut World) {
        assert!(world.check_divergence().is_ok());
        let stamp = Time::from_secs_f64(world.time());
        let states = joint_states(stamp, "base_link", world);
        let numbers = [&states.position, &states.velocity, &states.effort];
        assert!(
            numbers
                .iter()
                .all(|list| list.iter().all(|x| x.is_finite()))
        );
        let momentum = momentum(stamp, &world.robot);
        assert!(momentum.kinetic_energy.is_finite());
        let imu = imu(stamp, "base_link", world);
        let (w, a) = (imu.angular_velocity, imu.linear_acceleration);
        assert!([w.x, w.y, w.z, a.x, a.y, a.z].iter().all(|x| x.is_finite()));
    }

    #[test]
    fn a_state_that_is_not_finite_is_replaced_by_the_one_before() {
        let mut world = world("positioning");
        world.hold_efforts([(0, 1.0)]);
        world.step_to_tick_or_restore().unwrap();
        let before = world.robot.state().clone();
        world.robot.input_mut().efforts[0] = f64::NAN;
        // A command in the middle of a period steps the world, too.
        let problem = world.step_within_tick_or_restore(0.015).unwrap_err();
        assert!(problem.contains("diverged at 0.015 s"), "{problem}");
        let state = world.robot.state();
        assert_eq!((&state.q, &state.R_WB), (&before.q, &before.R_WB));
        assert_eq!(state.momentum_W, before.momentum_W);
        assert_eq!((state.qd.amax(), world.robot.efforts().amax()), (0.0, 0.0));
        world.step_to_tick_or_restore().unwrap();
        assert_eq!(world.ticks(), 2);
        assert!(world.mean_efforts().iter().all(|effort| *effort == 0.0));
        assert_publishable(&mut world);
    }

    // Would break if a state beyond all measure were kept, or published, because its numbers are still finite.
    #[test]
    fn large_efforts_at_any_time_never_end_the_simulation() {
        for joint_acceleration in [0.0, 1000.0] {
            let mut params = params("positioning");
            params.default_joint_acceleration = joint_acceleration;
            let mut world = World::new(&params).unwrap();
            let mut problems = Vec::new();
            for tick in 0..500 {
                for part in 0..3 {
                    world.hold_efforts((0..6).map(|j| (j, if part == 1 { 300.0 } else { 280.0 })));
                    let time = world.time() + 0.0031;
                    problems.extend(world.step_within_tick_or_restore(time).err());
                    assert_publishable(&mut world);
                }
                problems.extend(world.step_to_tick_or_restore().err());
                assert_publishable(&mut world);
                assert_eq!(world.ticks(), tick + 1);
            }
            assert!(!problems.is_empty());
            assert!(problems[0].contains("joint '"), "{}", problems[0]);
            // The robot obeys again.
            world.hold_efforts((0..6).map(|j| (j, 0.0)));
            world.robot.set_state(world.start.clone());
            world.hold_efforts([(1, 1.0)]);
            for _ in 0..100 {
                world.step_to_tick_or_restore().unwrap();
            }
            assert!(world.robot.state().qd[1] > 1e-3);
        }
    }

    // The motion is in the momentum: stopping the joints does not help.
    #[test]
    fn a_base_that_turns_too_fast_is_stopped() {
        for rate in [100.0, 1e5] {
            let mut world = world("servicing");
            let spin = Twist::new(Vector3::new(0.0, 0.0, rate), Vector3::zeros());
            let mut state = world.robot.state().clone();
            let X_WB = Isometry3::identity();
            state.set_base(&mut Workspace::new(world.robot.model()), &X_WB, &spin);
            world.robot.set_state(state);
            let mut count = 0;
            for _ in 0..500 {
                count += usize::from(world.step_to_tick_or_restore().is_err());
                assert_publishable(&mut world);
            }
            println!("{rate} rad/s: restored {count} times");
            assert!(
                count <= 2
                    && (count == 2) == (world.robot.state().momentum_W.angular.norm() == 0.0)
            );
        }
    }

    #[test]
    fn a_target_beyond_all_measure_is_stopped() {
        let mut world = world("servicing");
        let mut state = world.targets[0].body.state().clone();
        state.momentum_W.linear.x = 1e300;
        world.targets[0].body.set_state(state);
        assert!(
            world
                .step_to_tick_or_restore()
                .unwrap_err()
                .contains("target")
        );
        world.step_to_tick_or_restore().unwrap();
        assert_eq!(world.targets[0].body.state().momentum_W.linear.x, 0.0);
        assert_publishable(&mut world);
    }

    #[test]
    fn joints_without_an_effort_limit_get_one() {
        let mut world = world("positioning");
        let note = world.default_effort_limits().unwrap();
        assert!(
            note.contains("joint1, joint2") && note.contains("1000 rad/s2"),
            "{note}"
        );
        assert!(world.hold_efforts([(5, 300.0)]));
        assert_eq!(world.robot.efforts()[5], 25.0);
        let mut params = params("positioning");
        params.default_joint_acceleration = 0.0;
        let mut world = World::new(&params).unwrap();
        assert_eq!(world.default_effort_limits(), None);
        assert!(!world.hold_efforts([(5, 300.0)]));
    }

    // Would break if a command in the middle of a period cost an integration step more in a free body.
    #[test]
    fn steps_within_a_period_end_at_the_same_tick() {
        let mut world = world("servicing");
        world.step_within_tick_or_restore(0.004).unwrap();
        world.step_within_tick_or_restore(0.002).unwrap();
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
            let time = world.time() + 0.003;
            world.step_within_tick_or_restore(time).unwrap();
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
