//! Transpose-Jacobian control that moves the tip on the straight line to its goal.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{DVector, Matrix6xX, Rotation3, Unit, Vector3};

use super::gains::{ConfigError, check_not_negative, check_positive};
use super::transpose_jacobian::transpose_times;
use super::virtual_tip_inertia::{InertiaWrench, VirtualTipInertia};
use super::{
    JacobianKind, Law, LawConfig, LawError, LawInput, LawStatus, Manipulator, SaturatedError,
};

/// Method by which the path is kept straight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shaping {
    /// The force on the tip is rotated away from the tip's velocity, Masutani 1995 eqs. (7.2), (7.8)-(7.12). Straight, but
    /// slow where the arm hardly moves along the rotated force.
    Rotation,
    /// The tip is damped across the line and along it, and the joints hardly: straight, and equally fast in all
    /// postures.
    Damping,
}

impl Shaping {
    /// All of them by name.
    pub const NAMES: [(&'static str, Self); 2] =
        [("rotation", Self::Rotation), ("damping", Self::Damping)];
}

/// Settings of [`StraightPath`].
#[derive(Debug, Clone, PartialEq)]
pub struct StraightPathConfig {
    /// Which Jacobian turns the wrench on the tip into joint efforts.
    pub jacobian: JacobianKind,
    /// Method by which the path is kept straight.
    pub shaping: Shaping,
    /// Gain of the rotation, eq. (7.11).
    pub k_r: f64,
    /// `ψ_L`, the largest rotation of the force \[rad\].
    pub psi_max: f64,
    /// Damping of the tip along the line \[N s/m\]: with `k_p`, the time constant is `d_along / k_p`.
    pub d_along: f64,
    /// Damping of the tip across the line \[N s/m\].
    pub d_across: f64,
    /// Damping of the tip's angular velocity \[N m s/rad\]; acts where `k_o` is not zero.
    pub d_turn: f64,
    /// Fraction of `K_V` that remains on the joints while the tip is damped, above 0 to 1.
    pub joint_damping_fraction: f64,
    /// Sampling period of the control loop \[s\], which bounds the damping; zero for a continuous loop.
    pub period: f64,
}

/// Largest fraction of a tip's velocity that damping removes in one period. From 2 on it is unstable, and from 2/3 on
/// if efforts are a period late.
const MAX_REMOVED: f64 = 0.5;

impl Default for StraightPathConfig {
    /// The rotation of the thesis, continuous; damping for a time constant of 3 s with its `k_p` of 20 N/m.
    fn default() -> Self {
        Self {
            jacobian: JacobianKind::Generalized,
            shaping: Shaping::Rotation,
            k_r: 5.0,
            psi_max: 0.45 * PI,
            d_along: 60.0,
            d_across: 600.0,
            d_turn: 60.0,
            joint_damping_fraction: 0.05,
            period: 0.0,
        }
    }
}

impl StraightPathConfig {
    /// Refuses settings that violate the conditions of the proof of stability.
    ///
    /// # Errors
    /// [`ConfigError`] names the setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        check_not_negative("straight_path.k_r", self.k_r)?;
        check_not_negative("straight_path.psi_max", self.psi_max)?;
        check_not_negative("straight_path.d_along", self.d_along)?;
        check_not_negative("straight_path.d_across", self.d_across)?;
        check_not_negative("straight_path.d_turn", self.d_turn)?;
        check_not_negative("straight_path.period", self.period)?;
        let fraction = self.joint_damping_fraction;
        check_positive("straight_path.joint_damping_fraction", fraction)?;
        check_not_negative("1 - straight_path.joint_damping_fraction", 1.0 - fraction)
    }

    /// The virtual inertia of the tip under gains with `k_o`: it keeps the damping stable at the sampling period
    /// [`period`](Self::period) in every posture.
    pub fn virtual_tip_inertia(&self, k_o: f64) -> VirtualTipInertia {
        let period = self.period / MAX_REMOVED;
        let rotates = self.shaping == Shaping::Damping && k_o > 0.0;
        VirtualTipInertia {
            mass: period * self.d_along.max(self.d_across),
            inertia: if rotates { period * self.d_turn } else { 0.0 },
        }
    }
}

/// Transpose-Jacobian control with a straight path, in one of two ways; the tip's velocity `V_E = Ĵ_L q̇` is
/// that of a robot without momentum. The torque on the tip is that of
/// [`TransposeJacobian`](super::TransposeJacobian), or zero (`k_o = 0`) as in chapter 7 of the thesis.
///
/// [`Shaping::Rotation`] is `τ = k_p Ĵ_Lᵀ P ē_p + k_o Ĵ_Aᵀ ē_o - K_V q̇`, eq. (7.2), with the rotation `P` about `V_E ×
/// e_p`. It keeps the Lyapunov function of chapter 5, since `V_E · (P - I) ē_p ≤ 0`, eq. (7.3): the rotated force gives
/// the moving tip no more power than the original one, for a rotation of up to `2π - 2φ`. If `V_E` or `e_p` is zero the
/// rotation is undefined, and `P = I`.
///
/// [`Shaping::Damping`] is `τ = k_p Ĵ_Lᵀ ē_p + k_o Ĵ_Aᵀ ē_o - Ĵ_Lᵀ D Ĵ_L q̇ - d_o Ĵ_Aᵀ Ĵ_A q̇ - σ K_V q̇` with `D =
/// d_along ê êᵀ + d_across (I - ê êᵀ)`, `ê` towards the goal. It differs from the law of chapter 5 only by its damping,
/// which is positive definite: `dW/dt = -V_Eᵀ D V_E - d_o |Ω_E|² - σ q̇ᵀ K_V q̇ ≤ 0`. Slow motion is then `D V_E = k_p
/// ē_p`: along the line at a speed that depends on the distance alone, not on the posture. Under `K_V` it is `V_E = k_p
/// Ĵ_L K_V⁻¹ Ĵ_Lᵀ ē_p`, bent towards the directions in which the arm is compliant; a rotated force that makes it
/// straight has a small component along stiff directions and is therefore slow.
///
/// If the wrist is light, both methods remove the tip's velocity too fast for a sampled law. So with
/// [`StraightPathConfig::period`] the tip is given a virtual inertia ([`StraightPathConfig::virtual_tip_inertia`]): the
/// damping is then stable in every posture, and slow motion does not change. The rotation is as stiff as damping of
/// `k_p |e_p| k_r / |V_E|`, which is unbounded at rest, so its gain is also bounded, `k_r ≤ ½ d_across |V_E| / k_p
/// |e_p|`; any rotation from zero to `2π - 2φ` satisfies (7.3). The factor is one half because the rotated force
/// changes up to twice as fast with the direction of `V_E` as that damping would.
///
/// For a moving goal, `q̇` is replaced by `s = q̇ - q̇_D` throughout, see [`FeedForward`](super::FeedForward): the path
/// is straight relative to the goal.
#[derive(Debug, Clone)]
pub struct StraightPath {
    config: StraightPathConfig,
    fixed_base: Matrix6xX<f64>,
    generalized: Matrix6xX<f64>,
    /// `s`.
    rates: DVector<f64>,
    inertia_wrench: InertiaWrench,
}

impl StraightPath {
    /// The law for a robot.
    pub fn new(config: StraightPathConfig, manipulator: &Manipulator) -> Self {
        let joints = manipulator.model.dof();
        Self {
            config,
            fixed_base: Matrix6xX::zeros(joints),
            generalized: Matrix6xX::zeros(joints),
            rates: DVector::zeros(joints),
            inertia_wrench: InertiaWrench::new(manipulator),
        }
    }

    /// The position error `e_p`, rotated away from the tip's velocity `V_E`: eqs. (7.8)-(7.12).
    fn rotated(&self, k_p: f64, e_p: &Vector3<f64>, V_E: &Vector3<f64>) -> Vector3<f64> {
        let axis = V_E.cross(e_p);
        let Some(axis) = Unit::try_new(axis, f64::MIN_POSITIVE) else {
            return *e_p;
        };
        let phi = V_E.angle(e_p);
        let acute = if phi <= FRAC_PI_2 { phi } else { PI - phi };
        let StraightPathConfig {
            k_r,
            d_across,
            period,
            ..
        } = self.config;
        let k_r = if period > 0.0 {
            k_r.min(0.5 * d_across * V_E.norm() / (k_p * e_p.norm()))
        } else {
            k_r
        };
        let psi = (k_r * acute).min(2.0 * (PI - phi)).min(self.config.psi_max);
        Rotation3::from_axis_angle(&axis, psi) * e_p
    }
}

impl Law for StraightPath {
    fn efforts(
        &mut self,
        input: &LawInput<'_>,
        manipulator: &mut Manipulator,
        efforts: &mut DVector<f64>,
    ) -> Result<LawStatus, LawError> {
        let Some(SaturatedError {
            position: e_p,
            orientation: e_o,
            ..
        }) = input.error
        else {
            return Ok(LawStatus::Inactive);
        };
        let gains = input.gains;
        (manipulator.workspace).generalized_jacobian(&manipulator.tip, &mut self.generalized);
        self.rates.copy_from(input.qd);
        if let Some(reference) = input.reference_rates {
            self.rates -= reference;
        }
        let (mut V_E, mut W_E) = (Vector3::zeros(), Vector3::zeros());
        for (column, rate) in self.generalized.column_iter().zip(&self.rates) {
            V_E += column.fixed_rows::<3>(0) * *rate;
            W_E += column.fixed_rows::<3>(3) * *rate;
        }
        let mut torque = e_o * gains.k_o;
        let force = match self.config.shaping {
            Shaping::Rotation => self.rotated(gains.k_p, &e_p, &V_E) * gains.k_p,
            Shaping::Damping => {
                let along = e_p.try_normalize(f64::MIN_POSITIVE);
                let along = along.map_or(V_E, |e| e * e.dot(&V_E));
                if gains.k_o > 0.0 {
                    torque -= W_E * self.config.d_turn;
                }
                let (d_along, d_across) = (self.config.d_along, self.config.d_across);
                e_p * gains.k_p - along * d_along - (V_E - along) * d_across
            }
        };
        let jacobian = match self.config.jacobian {
            JacobianKind::Generalized => &self.generalized,
            JacobianKind::FixedBase => {
                (manipulator.workspace).fixed_base_jacobian(&manipulator.tip, &mut self.fixed_base);
                &self.fixed_base
            }
        };
        transpose_times(jacobian, &force, &torque, efforts);
        let inertia = self.config.virtual_tip_inertia(gains.k_o);
        if inertia.mass > 0.0 {
            let (fraction, k_v) = (self.joint_damping_fraction(), &gains.k_v);
            let rates = &self.rates;
            let damped = |j: usize| efforts[j] - fraction * k_v[j] * rates[j];
            let wrench = (self.inertia_wrench).compute(
                inertia,
                manipulator,
                input.q,
                &self.generalized,
                rates,
                damped,
            );
            efforts.gemv_tr(1.0, jacobian, &wrench, 1.0);
        }
        Ok(LawStatus::TipFeedback)
    }

    fn configure(&mut self, config: &LawConfig) -> bool {
        let LawConfig::StraightPath(config) = config else {
            return false;
        };
        self.config.clone_from(config);
        true
    }

    fn joint_damping_fraction(&self) -> f64 {
        match self.config.shaping {
            Shaping::Rotation => 1.0,
            Shaping::Damping => self.config.joint_damping_fraction,
        }
    }

    fn monitors_convergence(&self) -> bool {
        true
    }

    fn feeds_forward(&self) -> bool {
        true
    }
}
