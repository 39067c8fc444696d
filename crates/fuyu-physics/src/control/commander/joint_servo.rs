//! Servo that tracks joint motions with the inertia of the free-floating robot.

use nalgebra::{DMatrix, DVector};

use super::joint_spline::JointPoint;
use crate::control::task_priority::factorize;
use crate::dynamics::{Input, State, Workspace};
use crate::model::Model;

/// Commanded rate above which friction is fully compensated \[rad/s or m/s\].
const SLIDING: f64 = 2e-4;

/// Fraction of a joint's effort limit for braking to a distant reference; the rest is for the other joints' motion.
const BRAKING_SHARE: f64 = 0.5;

/// Task of the drive of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum JointDuty {
    /// Holds an effort \[N m or N\].
    Effort(f64),
    /// Drives a rate \[rad/s or m/s\] with a bandwidth \[rad/s\].
    Rate(f64, f64),
    /// Tracks the joint's [`JointPoint`].
    Track,
}

/// Computed torque for joints with different tasks.
///
/// A tracked joint gets the acceleration `q̈_d + 2 ω ė + ω² e` with `e = q_d - q`, a joint with a commanded rate `v`
/// gets `ω_v (v - q̇)`. With the free motion `q̈_0` (no efforts) and `x = q̈ - q̈_0` the equation of motion is `Ĥ x =
/// τ`, with the reduced inertia of Masutani 1995 eq. (4.48): the rows of joints with given efforts are solved for their
/// `x`, then the other rows give the other efforts, so all joints move independently. (Computed torque: J. Luh, M.
/// Walker and R. Paul, Resolved-acceleration control of mechanical manipulators, IEEE Trans. Automatic Control 25,
/// 1980.) Damping `D` and friction `F` of the joints are compensated for the wanted rate `v_w = q̇_d + ω e / 2`, not
/// the measured one: `D (v_w - q̇) + F sat(v_w / v_s)`, which is stable for any damping. `ω e / 2` is limited to the
/// joint's largest rate, and to `√(2 a |e|)`, from which half of its effort limit can stop it (`a = τ_max / (2 Ĥ_jj)`),
/// so that a distant position is approached without overshoot.
///
/// The servo is sampled: efforts are held between calls. With the period `T` it is stable for `ω T` well below 1.
///
/// `Ĥ` includes the body that the last link holds. If the grip is compliant, the measured rates are those of the much
/// lighter last link, which oscillates on the grip, and not those of the body. Then `ė` is computed from filtered
/// positions ([`JointServo::with_compliance`]).
#[derive(Debug, Clone)]
pub struct JointServo {
    bandwidth: f64,
    filter: Option<RateFilter>,
    workspace: Workspace,
    no_efforts: Input,
    free: DVector<f64>,
    added: DVector<f64>,
    efforts: DVector<f64>,
    factor: DMatrix<f64>,
    matrix: DMatrix<f64>,
}

/// Rates of the position errors `e` after a low-pass filter of first order: `τ ė_f = e - e_f`.
#[derive(Debug, Clone)]
struct RateFilter {
    /// `τ` \[s\].
    time_constant: f64,
    /// Time of the last sample \[s\].
    time: Option<f64>,
    /// `e_f`.
    errors: Vec<f64>,
    /// `ė_f`.
    rates: Vec<f64>,
}

impl RateFilter {
    fn new(joints: usize, time_constant: f64) -> Self {
        Self {
            time_constant,
            time: None,
            errors: vec![0.0; joints],
            rates: vec![0.0; joints],
        }
    }

    /// Updates the filter with the errors at `time` \[s\]. Before the first sample the rates are zero.
    fn take(&mut self, time: f64, errors: impl Iterator<Item = f64>) {
        let period = self.time.map(|before| (time - before).max(0.0));
        // Exact for an error that is constant over the period.
        let share = period.map(|period| -(-period / self.time_constant).exp_m1());
        self.time = Some(time);
        for (j, error) in errors.enumerate() {
            match share {
                Some(share) => {
                    self.errors[j] += share * (error - self.errors[j]);
                    self.rates[j] = (error - self.errors[j]) / self.time_constant;
                }
                None => self.errors[j] = error,
            }
        }
    }
}

impl JointServo {
    /// Largest natural frequency of the servo, as a fraction of the natural frequency of a held body on its grip.
    const COMPLIANT_SHARE: f64 = 0.2;

    /// A servo with the natural frequency `bandwidth` \[rad/s\].
    pub fn new(model: &Model, bandwidth: f64) -> Self {
        let n = model.dof();
        Self {
            bandwidth,
            filter: None,
            workspace: Workspace::new(model),
            no_efforts: Input::zero(model),
            free: DVector::zeros(n),
            added: DVector::zeros(n),
            efforts: DVector::zeros(n),
            factor: DMatrix::zeros(n, n),
            matrix: DMatrix::zeros(n, n),
        }
    }

    /// The servo for a robot that holds a body through a compliant grip. `frequency` `Ω` \[rad/s\] is the lowest
    /// natural frequency of the body on the grip with a fixed last link; it must be positive.
    ///
    /// Far above `Ω` the body stands still, and a joint moves the last link against the grip: an oscillator with the stiffness
    /// `K >= Ĥ Ω²` and some damping ratio `ζ`. With the bandwidth `ω` and the filter's time constant `τ`, the gain of the
    /// position feedback is at most `Ĥ (ω² + 2 ω / τ)`. With `ω <= Ω/5` and `τ = 1/(5 ω)`, that is `11 ω² Ĥ <= 0.44 K`: less
    /// than the stiffness of the grip, at any sampling period. Sampled feedback destabilises an undamped oscillator, however
    /// weak the feedback is; this one is stable at all natural frequencies and periods if `ζ >= 0.3`, which the joints' and the
    /// grip's damping provide (computed in the test `a_damped_grip_is_stable_at_any_period`). The filter shifts the phase at
    /// `ω` by 11 degrees.
    ///
    /// # Panics
    /// If `frequency` is not positive.
    pub fn with_compliance(mut self, frequency: f64) -> Self {
        assert!(frequency > 0.0, "the natural frequency must be positive");
        self.bandwidth = self.bandwidth.min(Self::COMPLIANT_SHARE * frequency);
        let time_constant = 0.2 / self.bandwidth;
        self.filter = Some(RateFilter::new(self.efforts.len(), time_constant));
        self
    }

    /// Natural frequency \[rad/s\].
    pub fn bandwidth(&self) -> f64 {
        self.bandwidth
    }

    /// Efforts \[N m or N\] at `state` for the joints' `duties`, within the joints' limits; `reference` holds the
    /// motions of tracked joints.
    ///
    /// # Panics
    /// If a length does not fit the robot.
    pub fn efforts(
        &mut self,
        state: &State,
        duties: &[JointDuty],
        reference: &[JointPoint],
    ) -> &DVector<f64> {
        let model = self.workspace.model().clone();
        assert_eq!(
            duties.len(),
            model.dof(),
            "duties has one element per joint"
        );
        assert_eq!(
            reference.len(),
            model.dof(),
            "reference has one element per joint"
        );
        let workspace = &mut self.workspace;
        workspace.set_positions(&state.q);
        workspace.set_motion(state);
        workspace.accelerations(state, &self.no_efforts, &mut self.free);
        let inertia = workspace.reduced_inertia();
        let omega = self.bandwidth;
        if let Some(filter) = &mut self.filter {
            let errors = reference.iter().zip(state.q.iter());
            filter.take(state.time, errors.map(|(point, q)| point.position - q));
        }
        let mut is_mixed = false;
        for (j, joint) in model.joints().iter().enumerate() {
            let (q, qd) = (state.q[j], state.qd[j]);
            let fastest = joint.limits.velocity;
            let (acceleration, wanted) = match duties[j] {
                JointDuty::Effort(effort) => {
                    is_mixed = true;
                    self.efforts[j] = effort;
                    continue;
                }
                JointDuty::Rate(rate, bandwidth) => (bandwidth * (rate - qd), rate),
                JointDuty::Track => {
                    let point = &reference[j];
                    let off = point.position - q;
                    let braking = BRAKING_SHARE * joint.limits.effort / inertia[(j, j)];
                    let fastest = fastest.min((2.0 * braking * off.abs()).sqrt());
                    let catching_up = 0.5 * omega * off;
                    let catching_up = catching_up.clamp(-fastest, fastest);
                    let wanted = point.rate + catching_up;
                    let missing = match &self.filter {
                        Some(filter) => catching_up + filter.rates[j],
                        None => wanted - qd,
                    };
                    (point.acceleration + 2.0 * omega * missing, wanted)
                }
            };
            self.added[j] = acceleration - self.free[j];
            self.efforts[j] = joint.damping * (wanted - qd)
                + joint.friction * (wanted / SLIDING).clamp(-1.0, 1.0);
        }
        if is_mixed {
            solve_free_joints(
                inertia,
                duties,
                &self.efforts,
                (&mut self.matrix, &mut self.factor),
                &mut self.added,
            );
        }
        for (j, joint) in model.joints().iter().enumerate() {
            if !matches!(duties[j], JointDuty::Effort(_)) {
                self.efforts[j] += inertia.column(j).dot(&self.added);
            }
            let limit = joint.limits.effort;
            self.efforts[j] = self.efforts[j].clamp(-limit, limit);
        }
        &self.efforts
    }
}

/// Computes the accelerations `added` of the joints with given efforts: solves their rows of `Ĥ x = τ`. The other rows
/// become `x = x`.
fn solve_free_joints(
    inertia: &DMatrix<f64>,
    duties: &[JointDuty],
    efforts: &DVector<f64>,
    (matrix, factor): (&mut DMatrix<f64>, &mut DMatrix<f64>),
    added: &mut DVector<f64>,
) {
    let is_free = |j: usize| matches!(duties[j], JointDuty::Effort(_));
    let n = duties.len();
    for i in (0..n).filter(|&i| is_free(i)) {
        let driven = (0..n).filter(|&j| !is_free(j));
        let taken: f64 = driven.map(|j| inertia[(i, j)] * added[j]).sum();
        // The elements of free joints are not read above.
        added[i] = efforts[i] - taken;
    }
    for i in 0..n {
        for j in 0..n {
            matrix[(i, j)] = match (is_free(i) && is_free(j), i == j) {
                (true, _) => inertia[(i, j)],
                (false, true) => 1.0,
                (false, false) => 0.0,
            };
        }
    }
    factorize(matrix, factor);
    factor.solve_lower_triangular_mut(added);
    factor.tr_solve_lower_triangular_mut(added);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::{Floating, IntegrationMethod};
    use nalgebra::{Matrix3, RowVector3, Vector3};

    fn servicer() -> Model {
        let xml = include_str!("../../../../../urdf/servicer.urdf");
        Model::from_urdf(xml, "servicer").unwrap()
    }

    // The accelerations equal the requested ones, on a robot with momentum, and joints with given efforts are not
    // disturbed. Fails with the inertia of a fixed base, or without the coupling between the groups.
    #[test]
    fn every_joint_does_its_duty() {
        let model = servicer();
        let mut state = State::at_rest_with(
            &model,
            &DVector::from_row_slice(&[0.3, 0.8, -1.0, 0.4, 0.2, -0.3]),
        );
        state.qd = DVector::from_row_slice(&[0.1, -0.2, 0.05, 0.3, -0.1, 0.2]);
        state.momentum_W.angular = nalgebra::Vector3::new(3.0, -2.0, 5.0);
        let mut servo = JointServo::new(&model, 5.0);
        let track = |j: usize| JointPoint {
            position: state.q[j] + 0.02,
            rate: state.qd[j] - 0.1,
            acceleration: 0.05,
        };
        let reference: Vec<_> = (0..6).map(track).collect();
        let duties = [
            JointDuty::Track,
            JointDuty::Effort(1.5),
            JointDuty::Rate(0.2, 4.0),
            JointDuty::Track,
            JointDuty::Effort(-0.2),
            JointDuty::Track,
        ];
        let efforts = servo.efforts(&state, &duties, &reference).clone();
        assert_eq!((efforts[1], efforts[4]), (1.5, -0.2));
        let mut robot = Floating::new(model.clone(), state.clone(), IntegrationMethod::Rk4);
        robot.hold_efforts(efforts.as_slice());
        assert_eq!(robot.efforts(), &efforts, "no limit acts");
        let found = robot.accelerations().clone();
        // Damping of the robot's joints is compensated for the wanted rate.
        let tracked = 0.05 - 2.0 * 5.0 * 0.1 + 25.0 * 0.02;
        for (j, expected) in [
            (0, tracked),
            (2, 4.0 * (0.2 - 0.05)),
            (3, tracked),
            (5, tracked),
        ] {
            assert!((found[j] - expected).abs() < 1e-9, "{j}: {}", found[j]);
        }
    }

    /// Spectral radius of the sampled loop: an oscillator of unit stiffness and natural frequency with the damping
    /// ratio `zeta`, on a fixed body, under the feedback `-(gain + rate_gain (1 - filter)) x`, held for `phase`;
    /// `ratio` is `τ / T`.
    fn spectral_radius(zeta: f64, phase: f64, ratio: f64) -> f64 {
        // ω² Ĥ / K and 2 ω Ĥ / (τ K), with Ω = 5 ω and τ = 1 / (5 ω).
        let (gain, rate_gain) = (1.0 / 25.0, 10.0 / 25.0);
        let motion = Matrix3::new(
            0.0,
            1.0,
            0.0, //
            -1.0,
            -2.0 * zeta,
            1.0, //
            0.0,
            0.0,
            0.0,
        );
        let held = (motion * phase).exp();
        let share = -(-1.0 / ratio).exp_m1();
        // First the filter takes the position, then the effort follows, then both are held.
        let filtered = Vector3::new(share, 0.0, 1.0 - share);
        let effort = Vector3::new(-gain - rate_gain, 0.0, 0.0) + rate_gain * filtered;
        let row = |r: usize| {
            RowVector3::new(held[(r, 0)], held[(r, 1)], 0.0) + held[(r, 2)] * effort.transpose()
        };
        let loop_matrix = Matrix3::from_rows(&[row(0), row(1), filtered.transpose()]);
        let eigenvalues = loop_matrix.complex_eigenvalues();
        eigenvalues.iter().fold(0.0, |most, v| v.norm().max(most))
    }

    // Checks the claim of `with_compliance`: fails if the gains of the servo or the time constant of its filter are
    // larger.
    #[test]
    fn a_damped_grip_is_stable_at_any_period() {
        let phases = || (1..2000).map(|k| 0.01 * f64::from(k));
        for ratio in [1.0, 5.0, 25.0, 100.0] {
            let radius = |zeta| {
                phases()
                    .map(|phase| spectral_radius(zeta, phase, ratio))
                    .fold(0.0, f64::max)
            };
            assert!(radius(0.3) < 1.0, "{ratio}: {}", radius(0.3));
            assert!(radius(0.05) > 1.0, "{ratio}: {}", radius(0.05));
        }
    }
}
