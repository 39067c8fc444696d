//! Feed-forward of the goal's motion.

use nalgebra::{DVector, Matrix6, Matrix6xX, UnitQuaternion, Vector3, Vector6};

use crate::dynamics::{InverseDynamics, Momentum, TreeMotion, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::Twist;

/// Efforts with which [`TransposeJacobian`](super::TransposeJacobian) and [`StraightPath`](super::StraightPath) follow a
/// moving goal, at any momentum of the robot.
///
/// The law of the thesis keeps its tip at a goal at rest, at zero momentum. It damps all joint motion, so the tip lags
/// behind a moving goal until the law's efforts balance the damping. Let `q̇_D` be the joint rates that move the tip
/// with the goal,
///
/// ```text
/// Ĵ q̇_D = V_D - V_0
/// ```
///
/// with the goal's twist `V_D` and that of the tip under momentum alone, `V_0 = (H_B⁻¹ L, H_B⁻¹ L × r)`, both relative to
/// the system's centre of mass. Let `s = q̇ - q̇_D` and add to the law
///
/// ```text
/// τ_f = K_V q̇_D + Ĥ q̈_D + C(q, q̇) q̇_D + g(q, q̇, L)
/// ```
///
/// where `Ĥ` is the reduced inertia (4.48), `C` its Christoffel matrix and `g` the terms that momentum adds to the
/// joints' equations (zero for `L = 0`). The closed loop is then
///
/// ```text
/// Ĥ ṡ + C s = Ĵᵀ (k_p ē_p, k_o ē_o) - K_V s
/// ```
///
/// which is that of the thesis with `s` for `q̇`: since `dU/dt = -(k_p ē_p, k_o ē_o)ᵀ Ĵ s`, the function `½ sᵀ Ĥ s + U`
/// of eqs. (5.13), (5.27) decreases at the rate `sᵀ K_V s`, and its proof is valid wherever `Ĵ` has full rank. For a
/// goal at rest and zero momentum, nothing is added.
///
/// `C s = Γ(q̇, s)` is bilinear and symmetric, so it follows from inverse dynamics at two rates: `Γ(q̇, s) = ¼ (c(q̇ +
/// s) - c(q̇ - s))`, where `c(v) = Γ(v, v)` are the efforts of constant rates at zero momentum. `q̈_D` is the change of
/// `q̇_D` along the motion, by a central difference over less than a millisecond, so it is also right for the damped
/// inverse.
#[derive(Debug, Clone)]
pub struct FeedForward {
    /// Damping of the inverse of `Ĵ` \[m or rad\]: closer to a singularity than this, the tip lags behind.
    pub damping: f64,
    /// Largest joint rate that is fed forward \[rad/s or m/s\], so that a goal that leaves the workspace does not
    /// accelerate the arm without bound.
    pub max_joint_rate: f64,
    tip: Frame,
    /// Angular momentum, base axes.
    L_B: Vector3<f64>,
    neighbour: Workspace,
    jacobian: Matrix6xX<f64>,
    /// `q̇_D` now, and at a neighbouring time.
    rates: DVector<f64>,
    neighbour_rates: DVector<f64>,
    neighbour_q: DVector<f64>,
    scratch: DVector<f64>,
    acceleration: DVector<f64>,
    inverse: InverseDynamics,
    forces: [DVector<f64>; 3],
}

/// Step of the central difference \[s\]: truncation and rounding errors are both below 1e-9 of the rates here. The
/// rounding error enters the efforts multiplied by the arm's inertia, so it should not vary between equal runs.
const TIME_STEP: f64 = 2e-4;

/// Damping that leaves 4 % of the goal's velocity to the law where the smallest singular value is 0.1.
const DAMPING: f64 = 0.02;

/// Some ten times the rate that a servicer's joints need to follow a target that it can catch.
const MAX_JOINT_RATE: f64 = 0.3;

/// A moving goal, and the state of the robot that follows it.
#[derive(Debug, Clone, Copy)]
pub struct MovingGoal<'a> {
    /// Joint positions \[rad or m\].
    pub q: &'a DVector<f64>,
    /// Joint rates \[rad/s or m/s\].
    pub qd: &'a DVector<f64>,
    /// Angular velocity of the base, base axes \[rad/s\].
    pub w_IB_B: &'a Vector3<f64>,
    /// Twist of the goal in I, base axes.
    pub V_ID_B: &'a Twist,
    /// Rate of change of the goal's twist in I, base axes.
    pub A_ID_B: &'a Twist,
}

impl FeedForward {
    /// Feed-forward for `model` with its tip at `tip`.
    pub fn new(model: &Model, tip: &Frame) -> Self {
        let zero = DVector::zeros(model.dof());
        Self {
            damping: DAMPING,
            max_joint_rate: MAX_JOINT_RATE,
            tip: tip.clone(),
            L_B: Vector3::zeros(),
            neighbour: Workspace::new(model),
            jacobian: Matrix6xX::zeros(model.dof()),
            rates: zero.clone(),
            neighbour_rates: zero.clone(),
            neighbour_q: zero.clone(),
            scratch: zero.clone(),
            acceleration: zero.clone(),
            inverse: InverseDynamics::new(model),
            forces: [zero.clone(), zero.clone(), zero],
        }
    }

    /// Joint rates `q̇_D` of the last [`update`](Self::update) \[rad/s or m/s\].
    pub fn rates(&self) -> &DVector<f64> {
        &self.rates
    }

    /// Computes `q̇_D` and `q̈_D` for a goal; `workspace` holds the positions of `goal.q`.
    pub fn update(&mut self, workspace: &Workspace, goal: &MovingGoal) {
        let turning = Twist::new(*goal.w_IB_B, Vector3::zeros());
        self.L_B = workspace.momentum_of(&turning, goal.qd).angular;
        self.scratch.fill(0.0);
        self.compute_neighbour_rates(goal, TIME_STEP);
        self.acceleration.copy_from(&self.neighbour_rates);
        self.compute_neighbour_rates(goal, -TIME_STEP);
        self.acceleration -= &self.neighbour_rates;
        self.acceleration /= 2.0 * TIME_STEP;
        rates(
            workspace,
            &self.tip,
            goal.V_ID_B,
            &self.L_B,
            (self.damping, self.max_joint_rate),
            &self.scratch,
            &mut self.jacobian,
            &mut self.rates,
        );
    }

    /// Computes `q̇_D` at the time `dt` \[s\] from now, if robot and goal continue their motion.
    fn compute_neighbour_rates(&mut self, goal: &MovingGoal, dt: f64) {
        // Vectors that are constant in I rotate in base axes.
        let w = goal.w_IB_B;
        let turned = |v: &Vector3<f64>, rate: Vector3<f64>| v + (rate - w.cross(v)) * dt;
        let V_ID_B = Twist::new(
            turned(&goal.V_ID_B.angular, goal.A_ID_B.angular),
            turned(&goal.V_ID_B.linear, goal.A_ID_B.linear),
        );
        let L_B = turned(&self.L_B, Vector3::zeros());
        self.neighbour_q.copy_from(goal.q);
        self.neighbour_q.axpy(dt, goal.qd, 1.0);
        self.neighbour.set_positions(&self.neighbour_q);
        rates(
            &self.neighbour,
            &self.tip,
            &V_ID_B,
            &L_B,
            (self.damping, self.max_joint_rate),
            &self.scratch,
            &mut self.jacobian,
            &mut self.neighbour_rates,
        );
    }

    /// Adds `τ_f` to `efforts` \[N m or N\], after [`update`](Self::update) for the same goal; the velocity gains are
    /// `fraction` of `k_v`.
    pub fn add(
        &mut self,
        workspace: &Workspace,
        goal: &MovingGoal,
        k_v: &[f64],
        fraction: f64,
        efforts: &mut DVector<f64>,
    ) {
        let (qd, L_B) = (goal.qd, self.L_B);
        // Ĥ q̈_D + c(q̇) + g, then c at q̇ + s and at q̇ - s = q̇_D.
        let Self {
            inverse,
            forces,
            scratch,
            acceleration,
            rates,
            ..
        } = self;
        let mut efforts_of =
            |qd: &DVector<f64>, L: Vector3<f64>, qdd: &[f64], out: &mut DVector<f64>| {
                let momentum = Momentum {
                    linear: Vector3::zeros(),
                    angular: L,
                };
                let motion = TreeMotion {
                    R_WB: UnitQuaternion::identity(),
                    V_WB_B: workspace.base_twist(&momentum, qd),
                    q: goal.q.as_slice(),
                    qd: qd.as_slice(),
                };
                inverse.free_floating_efforts(&motion, qdd, &[], out.as_mut_slice());
            };
        let [all, fast, slow] = forces;
        efforts_of(qd, L_B, acceleration.as_slice(), all);
        scratch.copy_from(qd);
        scratch.axpy(-1.0, rates, 2.0);
        acceleration.fill(0.0);
        efforts_of(scratch, Vector3::zeros(), acceleration.as_slice(), fast);
        efforts_of(rates, Vector3::zeros(), acceleration.as_slice(), slow);
        for j in 0..efforts.len() {
            efforts[j] += fraction * k_v[j] * rates[j] + all[j] - 0.25 * (fast[j] - slow[j]);
        }
    }
}

/// Writes the joint rates that move the tip with the twist `V_ID_B` in I while the system has the angular momentum `L_B`.
#[expect(
    clippy::too_many_arguments,
    reason = "called for the present and for neighbouring states"
)]
fn rates(
    workspace: &Workspace,
    tip: &Frame,
    V_ID_B: &Twist,
    L_B: &Vector3<f64>,
    (damping, max_joint_rate): (f64, f64),
    no_rates: &DVector<f64>,
    J: &mut Matrix6xX<f64>,
    out: &mut DVector<f64>,
) {
    workspace.generalized_jacobian(tip, J);
    let momentum = Momentum {
        linear: Vector3::zeros(),
        angular: *L_B,
    };
    let base = workspace.base_twist(&momentum, no_rates);
    let p_BE = workspace.X_BF(tip).translation.vector;
    let v = V_ID_B.linear - base.linear - base.angular.cross(&p_BE);
    let w = V_ID_B.angular - base.angular;
    let tip_twist = Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z);
    damped_inverse(J, &tip_twist, damping, out);
    let largest = out.amax();
    if largest > max_joint_rate {
        *out *= max_joint_rate / largest;
    }
}

/// `Jᵀ (J Jᵀ + λ²)⁻¹ v`: the damped least-squares solution.
fn damped_inverse(J: &Matrix6xX<f64>, v: &Vector6<f64>, damping: f64, out: &mut DVector<f64>) {
    let mut square = Matrix6::from_diagonal_element(damping * damping);
    for column in J.column_iter() {
        square.ger(1.0, &column, &column, 1.0);
    }
    // Positive definite because of the damping; a Jacobian that is not finite gives zero rates.
    match square.cholesky() {
        Some(factor) => out.gemv_tr(1.0, J, &factor.solve(v), 0.0),
        None => out.fill(0.0),
    }
}
