//! Impedance of the tip: the tip moves as a mass that is tied to a moving frame by spring and damper.
//!
//! ```text
//! a = a_d + ω² e + 2 ζ ω ė        (position and rotation alike)
//! τ = Ĥ (Ĵ⁺ (a - a_0) - q̈_0)
//! ```
//!
//! with the generalized Jacobian `Ĵ` and reduced inertia `Ĥ` of the free-floating robot (Masutani 1995 eqs. (4.36),
//! (4.48)), the free motion `q̈_0`, and the tip's acceleration `a_0` at zero joint accelerations (N. Hogan, Impedance
//! control, J. Dynamic Systems, Measurement, and Control 107, 1985; the tip keeps its natural inertia, so no force
//! sensor is needed). [`TipLaw::Transpose`] is the thesis's law, eq. (5.1): `τ = Ĵᵀ (K e + D ė)`, the same impedance
//! without compensation of the arm's own dynamics.

use nalgebra::{DMatrix, DVector, Matrix6xX, Vector3, Vector6};

use super::frame_motion::FrameMotion;
use super::tip_mobility::effective_mass;
use crate::dynamics::{Input, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::{Pose, Twist};

/// Singular values of the Jacobian below this are damped.
const DAMPED: f64 = 0.05;

/// The law of the tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TipLaw {
    /// Impedance with natural frequency \[rad/s\] and damping ratio.
    Impedance {
        /// `ω`.
        frequency: f64,
        /// `ζ`.
        damping: f64,
    },
    /// The transpose of the generalized Jacobian.
    Transpose {
        /// Stiffness \[N/m\] and \[N m/rad\].
        stiffness: (f64, f64),
        /// Damping \[N s/m\] and \[N m s/rad\].
        damping: (f64, f64),
    },
}

/// Deviations of the tip from its goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipReport {
    /// Position of the goal relative to the tip, axes of I \[m\].
    pub position_error: Vector3<f64>,
    /// Rotation vector from the tip to the goal, axes of I \[rad\].
    pub rotation_error: Vector3<f64>,
    /// The goal's twist minus the tip's, axes of I.
    pub twist_error: Twist,
}

/// Drives the tip of a free-floating robot by its law.
#[derive(Debug, Clone)]
pub struct TipImpedance {
    law: TipLaw,
    tip: Frame,
    workspace: Workspace,
    jacobian: Matrix6xX<f64>,
    no_input: Input,
    free: DVector<f64>,
    efforts: DVector<f64>,
}

pub(super) fn stacked(twist: &Twist) -> Vector6<f64> {
    let (l, a) = (twist.linear, twist.angular);
    Vector6::new(l.x, l.y, l.z, a.x, a.y, a.z)
}

impl TipImpedance {
    /// The law for `tip` of a robot.
    pub fn new(model: &Model, tip: &Frame, law: TipLaw) -> Self {
        let n = model.dof();
        Self {
            law,
            tip: tip.clone(),
            workspace: Workspace::new(model),
            jacobian: Matrix6xX::zeros(n),
            no_input: Input::zero(model),
            free: DVector::zeros(n),
            efforts: DVector::zeros(n),
        }
    }

    /// Deviation of the tip from `goal` at `state` (in I).
    pub fn deviation(&mut self, state: &State, goal: &FrameMotion) -> TipReport {
        self.workspace.set_positions(&state.q);
        self.workspace.set_motion(state);
        let R_IB = state.R_WB;
        let X_IE: Pose = state.X_WB(&self.workspace) * self.workspace.X_BF(&self.tip);
        let V = self.workspace.V_WF_B(&self.tip);
        let V = Twist::new(R_IB * V.angular, R_IB * V.linear);
        let turn = goal.X.rotation * X_IE.rotation.inverse();
        TipReport {
            position_error: goal.X.translation.vector - X_IE.translation.vector,
            rotation_error: nalgebra::UnitQuaternion::from(turn).scaled_axis(),
            twist_error: Twist::new(goal.V.angular - V.angular, goal.V.linear - V.linear),
        }
    }

    /// Joint efforts \[N m or N\] at `state` (in I).
    pub fn efforts(&mut self, state: &State, goal: &FrameMotion) -> (&DVector<f64>, TipReport) {
        let report = self.deviation(state, goal);
        let R_BI = state.R_WB.inverse();
        let to_base = |v: &Vector3<f64>| R_BI * v;
        let e = stacked(&Twist::new(
            to_base(&report.rotation_error),
            to_base(&report.position_error),
        ));
        let de = stacked(&Twist::new(
            to_base(&report.twist_error.angular),
            to_base(&report.twist_error.linear),
        ));
        self.workspace
            .generalized_jacobian(&self.tip, &mut self.jacobian);
        match self.law {
            TipLaw::Transpose { stiffness, damping } => {
                let gains = |(l, a): (f64, f64)| Vector6::new(l, l, l, a, a, a);
                let force = gains(stiffness).component_mul(&e) + gains(damping).component_mul(&de);
                self.efforts = self.jacobian.tr_mul(&force);
            }
            TipLaw::Impedance { frequency, damping } => {
                (self.workspace).accelerations(state, &self.no_input, &mut self.free);
                self.workspace
                    .set_accelerations(&DVector::zeros(self.free.len()));
                let bias = stacked(&self.workspace.A_WF_B(&self.tip));
                let ahead = stacked(&Twist::new(
                    to_base(&goal.A.angular),
                    to_base(&goal.A.linear),
                ));
                let wanted = ahead + e * frequency.powi(2) + de * (2.0 * damping * frequency);
                let qdd = self.resolved(&(wanted - bias));
                let added = qdd - &self.free;
                self.efforts = self.workspace.reduced_inertia() * added;
            }
        }
        (&self.efforts, report)
    }

    /// Joint accelerations for an acceleration of the tip, by damped least squares near singular positions (C. W. Wampler,
    /// Manipulator inverse kinematic solutions based on vector formulations and damped least-squares methods, IEEE Trans.
    /// Systems, Man, and Cybernetics 16, 1986).
    fn resolved(&self, tip: &Vector6<f64>) -> DVector<f64> {
        let J = DMatrix::from_fn(6, self.jacobian.ncols(), |r, c| self.jacobian[(r, c)]);
        let square = &J * J.transpose();
        let weakest = square.clone().symmetric_eigenvalues().min().max(0.0).sqrt();
        let damping = match weakest < DAMPED {
            true => DAMPED * DAMPED - weakest * weakest,
            false => 0.0,
        };
        let square = square + DMatrix::identity(6, 6) * damping;
        let solved = square.cholesky().map(|f| f.solve(tip));
        solved.map_or_else(|| DVector::zeros(J.ncols()), |x| J.tr_mul(&x))
    }

    /// Effective mass \[kg\] of the tip in an impact along `direction` (base axes) at positions `q`.
    pub fn effective_mass(&mut self, q: &DVector<f64>, direction: &Vector3<f64>) -> f64 {
        self.workspace.set_positions(q);
        let tip = (&self.tip, &mut self.jacobian);
        effective_mass(&mut self.workspace, tip, direction)
    }
}
