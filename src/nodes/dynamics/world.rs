//! The simulated world: the robot and the free bodies, at one time.

use super::imu::ImuParams;
use super::loops::LoopParams;
use super::params::{DynamicsParams, joint_vector};
use super::target::Target;
use crate::{
    control::VelocityServo,
    dynamics::{Floating, FormulationKind, State},
    nodes::choice,
};

/// Length of the servo's steps over the time constant of its fastest motion at the start: it overshoots beyond one, and
/// is unstable beyond two.
const SERVO_STEP: f64 = 0.5;

/// The robot and the free bodies. They meet in nothing but time.
pub struct World {
    /// The robot.
    pub robot: Floating,
    /// The free bodies.
    pub targets: Vec<Target>,
    /// The robot's state at the start.
    start: State,
    imu: ImuParams,
    /// Drives the joints' rates while `rates_driven`; else efforts are held.
    servo: VelocityServo,
    rates_driven: bool,
    /// Longest step that the servo bears \[s\].
    servo_step: f64,
    time_step: f64,
    /// Time is counted in steps of this, so that states fall on exact multiples \[s\].
    period: f64,
    ticks: u64,
    /// How far past the last tick the world is \[s\].
    past_tick: f64,
    /// Joint efforts summed over time since the last tick \[N m s or N s\].
    impulses: Vec<f64>,
    /// Mean joint efforts between the last two ticks.
    mean_efforts: Vec<f64>,
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
        (loops.assemble(&model, &mut state, params.loop_tolerance)).map_err(|e| e.to_string())?;
        params.base.place(&model, &mut state);
        let robot = Floating::with_loops(model, state, params.method, loops);
        let robot = robot.by(params.formulation).map_err(|e| {
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
        let zeros = vec![0.0; robot.model().dof()];
        let servo = VelocityServo::new(robot.model(), params.servo.clone())
            .map_err(|e| format!("parameter velocity_servo.{e}"))?;
        let fastest = servo.max_bandwidth(robot.model(), &robot.state().q);
        Ok(Self {
            servo,
            rates_driven: false,
            servo_step: SERVO_STEP / fastest,
            impulses: zeros.clone(),
            mean_efforts: zeros,
            start: robot.state().clone(),
            robot,
            targets: targets.collect::<Result<_, _>>()?,
            imu: params.imu,
            time_step: params.time_step,
            period: 1.0 / params.state_rate,
            ticks: 0,
            past_tick: 0.0,
        })
    }

    /// Time \[s\].
    pub fn time(&self) -> f64 {
        self.tick_time(self.ticks) + self.past_tick
    }

    /// Position of the target called `name` among the targets.
    ///
    /// # Errors
    /// Says which targets there are.
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

    /// Time begins at zero again.
    pub fn reset_time(&mut self) {
        (self.ticks, self.past_tick) = (0, 0.0);
    }

    /// Robot and free bodies are where they were at the start, or where they were put, and move so. Nothing
    /// acts on them.
    pub fn reset_state(&mut self) {
        self.robot.set_state(self.start.clone());
        self.rates_driven = false;
        self.servo.reset();
        self.servo.halt();
        self.robot.release();
        self.impulses.fill(0.0);
        self.mean_efforts.fill(0.0);
        for target in &mut self.targets {
            target.reset();
        }
    }

    /// Which state this is, or was the last before now.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// How good the inertial measurement unit is.
    pub fn imu(&self) -> &ImuParams {
        &self.imu
    }

    /// Time of the next state to publish \[s\].
    pub fn next_tick(&self) -> f64 {
        self.tick_time(self.ticks + 1)
    }

    fn tick_time(&self, ticks: u64) -> f64 {
        ticks as f64 * self.period
    }

    /// What of the robot's description is not simulated, in words; `None` if all of it is.
    pub fn not_simulated(&self) -> Option<String> {
        let joints = self.robot.model().joints().iter();
        let rough: Vec<_> = joints
            .filter(|j| j.friction != 0.0)
            .map(|j| j.name.as_str())
            .collect();
        (!rough.is_empty()).then(|| {
            format!(
                "Coulomb friction of {} is not simulated; damping is",
                rough.join(", ")
            )
        })
    }

    /// A joint that is beyond its limits, in words. Nothing stops it there: limits of position and
    /// speed are told, not enforced.
    pub fn beyond_limits(&self) -> Option<String> {
        let state = self.robot.state();
        let joints = self.robot.model().joints().iter();
        joints
            .zip(state.q.iter().zip(&state.qd))
            .find_map(|(joint, (q, qd))| {
                let (name, limits) = (&joint.name, &joint.limits);
                if *q < limits.lower || *q > limits.upper {
                    let (lower, upper) = (limits.lower, limits.upper);
                    Some(format!(
                        "joint '{name}' is at {q:.4}, beyond its limits {lower} to {upper}"
                    ))
                } else if qd.abs() > limits.velocity {
                    let limit = limits.velocity;
                    Some(format!(
                        "joint '{name}' moves at {qd:.4}, faster than its limit {limit}"
                    ))
                } else {
                    None
                }
            })
    }

    /// Refuses a world that has lost its numbers.
    ///
    /// # Errors
    /// Says when, and what helps.
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
        self.step_by(self.period - self.past_tick);
        self.ticks += 1;
        self.past_tick = 0.0;
        for (mean, impulse) in self.mean_efforts.iter_mut().zip(&mut self.impulses) {
            *mean = *impulse / self.period;
            *impulse = 0.0;
        }
    }

    /// Mean joint efforts over the time since the tick before \[N m or N\]: what acted, whenever in
    /// between commands came.
    pub fn mean_efforts(&self) -> &[f64] {
        &self.mean_efforts
    }

    /// Steps to `time` \[s\], which lies between now and the next tick.
    pub fn step_within_tick(&mut self, time: f64) {
        let past = (time - self.tick_time(self.ticks)).min(self.period);
        if past > self.past_tick {
            self.step_by(past - self.past_tick);
            self.past_tick = past;
        }
    }

    /// Holds joint efforts from now on, as [`Floating::hold_efforts`]; rates are not driven any more.
    pub fn hold_efforts(&mut self, efforts: &[f64]) -> bool {
        self.rates_driven = false;
        self.robot.hold_efforts(efforts)
    }

    /// Lets the servo drive the joints' rates from now on: those of `rates` (joint index, rate) to these \[rad/s or
    /// m/s\], cut to the joints' limits, the others as before or, if efforts were held until now, to zero. Returns
    /// whether any was cut.
    pub fn drive_rates(&mut self, rates: &[(usize, f64)]) -> bool {
        if !self.rates_driven {
            self.rates_driven = true;
            self.servo.reset();
        }
        let model = self.robot.model();
        let mut cut = false;
        for &(joint, rate) in rates {
            cut |= self.servo.set_reference(model, joint, rate);
        }
        cut
    }

    /// Whether rates are driven, not efforts held.
    pub fn rates_driven(&self) -> bool {
        self.rates_driven
    }

    /// What is done without a command: driven rates become zero, held efforts too.
    pub fn halt(&mut self) {
        self.servo.halt();
        if !self.rates_driven {
            self.robot.release();
        }
    }

    fn step_by(&mut self, seconds: f64) {
        // A rounding more than a whole number of steps must not cost one more.
        let count = |longest: f64| (seconds / longest - 1e-6).ceil().max(1.0) as usize;
        let steps = count(self.time_step);
        if self.rates_driven {
            let steps = count(self.time_step.min(self.servo_step));
            let dt = seconds / steps as f64;
            for _ in 0..steps {
                let (model, state) = (self.robot.model(), self.robot.state());
                let efforts = self.servo.efforts(model, state, dt);
                self.robot.hold_efforts(efforts.as_slice());
                self.count_impulses(dt);
                self.robot.step(dt, 1);
            }
        } else {
            self.count_impulses(seconds);
            self.robot.step(seconds / steps as f64, steps);
        }
        for target in &mut self.targets {
            target.body.step(seconds / steps as f64, steps);
        }
    }

    fn count_impulses(&mut self, seconds: f64) {
        for (impulse, effort) in self.impulses.iter_mut().zip(self.robot.efforts().iter()) {
            *impulse += effort * seconds;
        }
    }
}
