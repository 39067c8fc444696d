//! Computed-torque control to joint positions that reach the goal on the floating base.

use nalgebra::DVector;

use super::floating_inverse_kinematics::{FloatingInverseKinematics, goal_at_rest};
use super::gains::{ConfigError, check_positive};
use super::unreachable_goal::UnreachableGoal;
use super::{
    IkError, Law, LawConfig, LawError, LawInput, LawStatus, Manipulator, PoseError,
    outstretched_inertia,
};
use crate::dynamics::{Input, Momentum, State};
use crate::model::{Joint, JointKind, Model};
use crate::spatial::{Pose, Twist};

/// Settings of [`ComputedTorque`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComputedTorqueConfig {
    /// Natural frequency of the joints' deviations from the trajectory \[rad/s\]; they are critically damped. Sampled with the period
    /// `T`, the loop is stable for `frequency T` well below 1, for any robot.
    pub frequency: f64,
    /// Largest joint rate of a trajectory \[rad/s; a third of the number in m/s\]; half of a joint's own limit if that
    /// is less.
    pub max_joint_rate: f64,
}

impl Default for ComputedTorqueConfig {
    fn default() -> Self {
        Self {
            frequency: 3.0,
            max_joint_rate: 0.15,
        }
    }
}

impl ComputedTorqueConfig {
    /// Refuses settings that are not positive and finite.
    ///
    /// # Errors
    /// [`ConfigError`] names the setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        check_positive("computed_torque.frequency", self.frequency)?;
        check_positive("computed_torque.max_joint_rate", self.max_joint_rate)
    }
}

/// Fraction of a joint's effort limit that a trajectory may use at its largest acceleration.
const EFFORT_FRACTION: f64 = 0.25;
/// Shortest trajectory \[s\].
const SHORTEST: f64 = 2.0;
/// Time after the end of a trajectory at which the tip is compared with its goal, in time constants of the deviations.
const SETTLED: f64 = 8.0;
/// Deviations of the tip above which another trajectory corrects them \[m, rad\].
const CORRECTED: (f64, f64) = (1e-3, 2e-3);
/// Motion of the goal above which another trajectory follows \[m, rad\].
const MOVED: (f64, f64) = (0.01, 0.02);
/// If no positions reach the goal on a straight line: largest deviation of the nearest pose that is approached instead
/// \[m, rad\], and number of such approaches. From there the base has another attitude, so the goal may be reachable.
const APPROACHED: (f64, f64) = (0.1, 0.2);
const APPROACHES: usize = 3;
/// Commanded rate above which friction is fully compensated \[rad/s or m/s\].
const SLIDING: f64 = 2e-4;

/// Moves the joints to positions at which the tip is at its goal (with `k_o` zero: at its position), and tracks that
/// motion with the inertia of the free-floating robot.
///
/// [`FloatingInverseKinematics`] finds the positions: unlike those for a fixed base, they take into account how the
/// base turns on the way. The joints move along a straight line in joint space, which no singular position interrupts
/// and which stays within the position limits, with a polynomial of degree 5 in time. The efforts are
///
/// ```text
/// τ = Ĥ (q̈_d + 2 ω ė + ω² e) - Ĥ q̈_0 - D q̇ + D (q̇_d + ω e) + F sat((q̇_d + ω e) / v_s),   e = q_d - q
/// ```
///
/// with the acceleration `q̈_0` without efforts, the joints' damping `D` and Coulomb friction `F`. So `Ĥ (ë + 2 ω ė +
/// ω² e) + D (ė + ω e) = 0`: critically damped for any inertia, and stable for any `D`, since the measured rate is not
/// used to compensate it. (Computed torque: J. Luh, M. Walker and R. Paul, Resolved-acceleration control of mechanical
/// manipulators, IEEE Trans. Automatic Control 25, 1980; with the reduced inertia of Masutani 1995 eq. (4.48).) The law
/// needs correct masses. If the tip is not at its goal after the end of the trajectory, for instance because the robot
/// has momentum, another trajectory corrects that.
#[derive(Debug, Clone)]
pub struct ComputedTorque {
    config: ComputedTorqueConfig,
    kinematics: FloatingInverseKinematics,
    trajectory: Option<Trajectory>,
    /// Number of approaches to the present goal.
    approaches: usize,
    unreachable: UnreachableGoal,
    state: State,
    no_efforts: Input,
    free: DVector<f64>,
    commanded: DVector<f64>,
}

/// Joint positions as polynomials of time.
#[derive(Debug, Clone)]
struct Trajectory {
    start_time: f64,
    duration: f64,
    from: DVector<f64>,
    rate: DVector<f64>,
    to: DVector<f64>,
    /// The goal of the trajectory, see [`goal_at_rest`].
    goal: Pose,
}

impl Trajectory {
    /// Whether the trajectory leads to `goal`, or near enough.
    fn leads_to(&self, goal: &Pose) -> bool {
        PoseError::between(&self.goal, goal).is_within(MOVED)
    }

    /// Position, rate and acceleration of joint `j` at `time`. From rate `v` and zero acceleration to rest.
    fn at(&self, j: usize, time: f64) -> [f64; 3] {
        let T = self.duration;
        let t = (time - self.start_time).clamp(0.0, T);
        let (way, v) = (self.to[j] - self.from[j], self.rate[j]);
        if t >= T {
            return [self.to[j], 0.0, 0.0];
        }
        let a = (10.0 * way - 6.0 * v * T) / T.powi(3);
        let b = (-15.0 * way + 8.0 * v * T) / T.powi(4);
        let c = (6.0 * way - 3.0 * v * T) / T.powi(5);
        [
            self.from[j] + v * t + t.powi(3) * (a + t * (b + t * c)),
            v + t * t * (3.0 * a + t * (4.0 * b + t * 5.0 * c)),
            t * (6.0 * a + t * (12.0 * b + t * 20.0 * c)),
        ]
    }
}

impl ComputedTorque {
    /// The law, without a goal yet.
    pub fn new(config: ComputedTorqueConfig, manipulator: &Manipulator) -> Self {
        let Manipulator { model, tip, .. } = manipulator;
        Self {
            config,
            kinematics: FloatingInverseKinematics::new(model, tip),
            trajectory: None,
            approaches: 0,
            unreachable: UnreachableGoal::default(),
            state: State::at_rest(model),
            no_efforts: Input::zero(model),
            free: DVector::zeros(model.dof()),
            commanded: DVector::zeros(model.dof()),
        }
    }

    /// Whether another trajectory is needed.
    fn is_due(&self, input: &LawInput<'_>, goal: &Pose) -> bool {
        let Some(trajectory) = &self.trajectory else {
            return true;
        };
        if !trajectory.leads_to(goal) {
            return true;
        }
        let end = trajectory.start_time + trajectory.duration + SETTLED / self.config.frequency;
        let left = input.error.as_ref().map(|error| &error.pose);
        input.time > end
            && left.is_some_and(|e| {
                let is_turned = input.gains.k_o != 0.0 && e.angle > CORRECTED.1;
                e.position.norm() > CORRECTED.0 || is_turned
            })
    }

    /// Plans the motion from the present state to the goal. The search allocates memory.
    fn plan(
        &mut self,
        input: &LawInput<'_>,
        model: &Model,
        X_BD: &Pose,
        goal: Pose,
    ) -> Result<(), IkError> {
        self.unreachable.check(&goal, MOVED)?;
        let guess = self.trajectory.as_ref().map_or(input.q, |last| &last.to);
        let controls_attitude = input.gains.k_o != 0.0;
        self.kinematics.set_controls_attitude(controls_attitude);
        let last = self.trajectory.as_ref();
        if !last.is_some_and(|last| last.leads_to(&goal)) {
            self.approaches = 0;
        }
        let to = match self.kinematics.solve(input.q, X_BD, guess) {
            Ok(to) => to,
            Err(IkError::NotFound { position, angle })
                if position < APPROACHED.0
                    && (angle < APPROACHED.1 || !controls_attitude)
                    && self.approaches < APPROACHES =>
            {
                self.approaches += 1;
                self.kinematics.nearest().clone()
            }
            Err(error) => {
                self.unreachable.remember(&goal, &error);
                return Err(error);
            }
        };
        let needed = model.joints().iter().enumerate().map(|(j, joint)| {
            let way = (to[j] - input.q[j]).abs();
            let fastest = self.fastest(joint);
            // Largest rate and acceleration of the polynomial from rest: 15/8 and 10/√3 of the mean.
            let by_rate = 1.875 * way / fastest;
            let acceleration =
                EFFORT_FRACTION * joint.limits.effort / outstretched_inertia(model, j);
            by_rate.max((5.774 * way / acceleration).sqrt())
        });
        self.trajectory = Some(Trajectory {
            start_time: input.time,
            duration: needed.fold(SHORTEST, f64::max),
            from: input.q.clone(),
            rate: input.qd.clone(),
            to,
            goal,
        });
        Ok(())
    }

    fn fastest(&self, joint: &Joint) -> f64 {
        let most = self.config.max_joint_rate;
        let most = if joint.kind == JointKind::Prismatic {
            most / 3.0
        } else {
            most
        };
        most.min(0.5 * joint.limits.velocity)
    }
}

impl Law for ComputedTorque {
    fn efforts(
        &mut self,
        input: &LawInput<'_>,
        manipulator: &mut Manipulator,
        efforts: &mut DVector<f64>,
    ) -> Result<LawStatus, LawError> {
        if let Some(tip) = input.tip() {
            let goal = goal_at_rest(&manipulator.workspace, input.R_IB, &tip.X_BD);
            if self.is_due(input, &goal) {
                self.plan(input, &manipulator.model, &tip.X_BD, goal)?;
            }
        }
        let Some(trajectory) = &self.trajectory else {
            return Ok(LawStatus::Inactive);
        };
        let workspace = &mut manipulator.workspace;
        let turning = Twist::new(*input.w_IB_B, nalgebra::Vector3::zeros());
        self.state.q.copy_from(input.q);
        self.state.qd.copy_from(input.qd);
        self.state.momentum_W = Momentum {
            linear: nalgebra::Vector3::zeros(),
            angular: workspace.momentum_of(&turning, input.qd).angular,
        };
        workspace.set_motion(&self.state);
        workspace.accelerations(&self.state, &self.no_efforts, &mut self.free);
        let omega = self.config.frequency;
        for (j, joint) in manipulator.model.joints().iter().enumerate() {
            let [q, rate, acceleration] = trajectory.at(j, input.time);
            let (error, error_rate) = (q - input.q[j], rate - input.qd[j]);
            self.commanded[j] =
                acceleration + omega * (2.0 * error_rate + omega * error) - self.free[j];
            let wanted = rate + omega * error;
            efforts[j] = joint.damping * (wanted - input.qd[j])
                + joint.friction * (wanted / SLIDING).clamp(-1.0, 1.0);
        }
        efforts.gemv(1.0, workspace.reduced_inertia(), &self.commanded, 1.0);
        Ok(LawStatus::JointFeedback)
    }

    fn reset(&mut self) {
        self.trajectory = None;
        self.unreachable = UnreachableGoal::default();
        self.approaches = 0;
    }

    fn configure(&mut self, config: &LawConfig) -> bool {
        let LawConfig::ComputedTorque(config) = config else {
            return false;
        };
        self.config = *config;
        true
    }

    fn joint_damping_fraction(&self) -> f64 {
        0.0
    }
}
