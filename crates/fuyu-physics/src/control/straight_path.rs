//! Transpose-Jacobian control whose tip keeps to the straight line to its goal.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{DVector, Matrix6xX, Rotation3, Unit, Vector3};

use super::gains::{check_not_negative, check_positive};
use super::transpose_jacobian::transpose_times;
use super::virtual_tip_inertia::InertiaWrench;
use super::{
    ControlReport, ControllerConfig, GainError, Gains, JacobianKind, Law, LawError, Manipulator,
    Measurement, VirtualTipInertia,
};

/// How the path is kept straight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shaping {
    /// The pull is turned away from the velocity of the tip, Masutani 1995 eqs. (7.2), (7.8)-(7.12). Straight, but
    /// slow where the arm hardly moves along the turned pull.
    Rotation,
    /// The tip is damped across the line and along it, and the joints hardly: straight, and as fast in one posture
    /// as in another.
    Damping,
}

impl Shaping {
    /// All of them by name.
    pub const NAMES: [(&'static str, Self); 2] =
        [("rotation", Self::Rotation), ("damping", Self::Damping)];
}

/// What [`StraightPath`] has for itself.
#[derive(Debug, Clone, PartialEq)]
pub struct StraightPathConfig {
    /// How the path is kept straight.
    pub shaping: Shaping,
    /// Gain of the rotation, eq. (7.11).
    pub k_r: f64,
    /// `ψ_L`, the most by which the pull is turned \[rad\].
    pub psi_max: f64,
    /// Damping of the tip along the line \[N s/m\]: with `k_p`, the time constant is `d_along / k_p`.
    pub d_along: f64,
    /// Damping of the tip across the line \[N s/m\].
    pub d_across: f64,
    /// Damping of the turning tip \[N m s/rad\]; acts where `k_o` is not zero.
    pub d_turn: f64,
    /// Part of `K_V` that stays on the joints while the tip is damped, above 0 to 1.
    pub joint_part: f64,
    /// Time from one answer of the law to the next \[s\], by which damping is bounded; zero: it answers all the time.
    pub period: f64,
}

/// Damping takes at most this part of a tip's velocity away in one period. From 2 on it is unstable, and from 2/3 on if efforts
/// come a period late.
const MOST_DAMPED: f64 = 0.5;

impl Default for StraightPathConfig {
    /// The thesis's rotation, continuous; damping for a time constant of 3 s with its `k_p` of 20 N/m.
    fn default() -> Self {
        Self {
            shaping: Shaping::Rotation,
            k_r: 5.0,
            psi_max: 0.45 * PI,
            d_along: 60.0,
            d_across: 600.0,
            d_turn: 60.0,
            joint_part: 0.05,
            period: 0.0,
        }
    }
}

impl StraightPathConfig {
    /// Refuses what breaks the proof of stability.
    ///
    /// # Errors
    /// [`GainError`] naming the setting.
    pub fn check(&self) -> Result<(), GainError> {
        check_not_negative("straight_path.k_r", self.k_r)?;
        check_not_negative("straight_path.psi_max", self.psi_max)?;
        check_not_negative("straight_path.d_along", self.d_along)?;
        check_not_negative("straight_path.d_across", self.d_across)?;
        check_not_negative("straight_path.d_turn", self.d_turn)?;
        check_not_negative("straight_path.period", self.period)?;
        check_positive("straight_path.joint_part", self.joint_part)?;
        check_not_negative("1 - straight_path.joint_part", 1.0 - self.joint_part)
    }

    /// The load that the tip is made to feel under gains with `k_o`: with it the damping stays bounded by
    /// [`period`](Self::period), whatever the posture is.
    pub fn virtual_tip_inertia(&self, k_o: f64) -> VirtualTipInertia {
        let period = self.period / MOST_DAMPED;
        let turns = self.shaping == Shaping::Damping && k_o > 0.0;
        VirtualTipInertia {
            mass: period * self.d_along.max(self.d_across),
            inertia: if turns { period * self.d_turn } else { 0.0 },
        }
    }
}

/// Transpose-Jacobian control with a straight path, in one of two ways; the tip's velocity `V_E = Ĵ_L q̇` is
/// that of a robot without momentum. The attitude is pulled as by
/// [`TransposeJacobian`](super::TransposeJacobian), or left free (`k_o = 0`) as in the thesis's chapter 7.
///
/// [`Shaping::Rotation`] is `τ = k_p Ĵ_Lᵀ P ē_p + k_o Ĵ_Aᵀ ē_o - K_V q̇`, eq. (7.2), with the rotation `P` about
/// `V_E × e_p`. It keeps the Lyapunov function of chapter 5, since `V_E · (P - I) ē_p ≤ 0`, eq. (7.3): the turned
/// pull gives the moving tip no more power than the straight one, for a turn of up to `2π - 2φ`. Where `V_E` or `e_p`
/// is zero the rotation is not defined, and `P = I`.
///
/// [`Shaping::Damping`] is `τ = k_p Ĵ_Lᵀ ē_p + k_o Ĵ_Aᵀ ē_o - Ĵ_Lᵀ D Ĵ_L q̇ - d_o Ĵ_Aᵀ Ĵ_A q̇ - σ K_V q̇` with
/// `D = d_along ê êᵀ + d_across (I - ê êᵀ)`, `ê` towards the goal. All that is added to or taken from the law of
/// chapter 5 is damping, and what remains is positive definite: `dW/dt = -V_Eᵀ D V_E - d_o |Ω_E|² - σ q̇ᵀ K_V q̇ ≤ 0`.
/// Slow motion is then `D V_E = k_p ē_p`: along the line at a pace that depends on the distance alone, not on the
/// posture, whereas under `K_V` it is `V_E = k_p Ĵ_L K_V⁻¹ Ĵ_Lᵀ ē_p`, bent towards where the arm yields, and a
/// rotation of the pull that straightens it leaves little of it along stiff directions: that is why it crawls.
///
/// Both take the tip's velocity away faster than a law can bear that answers once a period, where the wrist is light.
/// So with [`StraightPathConfig::period`] the tip feels a load ([`StraightPathConfig::virtual_tip_inertia`]): the damping is then stable in
/// every posture, and slow motion is as before. The rotation is as stiff as damping of `k_p |e_p| k_r / |V_E|`, without bounds
/// at rest, so its gain is bounded too, `k_r ≤ ½ d_across |V_E| / k_p |e_p|`; any turn from zero to `2π - 2φ` keeps (7.3).
/// Half, because the turned pull changes up to twice as fast with the direction of `V_E` as that damping would.
///
/// For a goal that moves `q̇` is `s = q̇ - q̇_D` in all of this, see [`FeedForward`](super::FeedForward): the path is straight
/// beside the goal.
#[derive(Debug, Clone)]
pub struct StraightPath {
    gains: Gains,
    jacobian: JacobianKind,
    config: StraightPathConfig,
    law: Matrix6xX<f64>,
    tip_moves: Matrix6xX<f64>,
    /// `s`.
    rates: DVector<f64>,
    load: InertiaWrench,
}

impl StraightPath {
    /// The law for an arm.
    pub fn new(config: &ControllerConfig, arm: &Manipulator) -> Self {
        let joints = arm.model.dof();
        Self {
            gains: config.gains.clone(),
            jacobian: config.jacobian,
            config: config.straight_path.clone(),
            law: Matrix6xX::zeros(joints),
            tip_moves: Matrix6xX::zeros(joints),
            rates: DVector::zeros(joints),
            load: InertiaWrench::new(arm),
        }
    }

    /// The position error as the tip's velocity turns it, eqs. (7.8)-(7.12).
    fn rotated(&self, e_p: &Vector3<f64>, V_E: &Vector3<f64>) -> Vector3<f64> {
        let axis = V_E.cross(e_p);
        let Some(axis) = Unit::try_new(axis, f64::MIN_POSITIVE) else {
            return *e_p;
        };
        let phi = V_E.angle(e_p);
        let wanted = if phi <= FRAC_PI_2 { phi } else { PI - phi };
        let StraightPathConfig {
            k_r,
            d_across,
            period,
            ..
        } = self.config;
        let k_r = if period > 0.0 {
            k_r.min(0.5 * d_across * V_E.norm() / (self.gains.k_p * e_p.norm()))
        } else {
            k_r
        };
        let psi = (k_r * wanted)
            .min(2.0 * (PI - phi))
            .min(self.config.psi_max);
        Rotation3::from_axis_angle(&axis, psi) * e_p
    }
}

impl Law for StraightPath {
    fn configure(&mut self, config: &ControllerConfig) {
        self.gains.clone_from(&config.gains);
        self.jacobian = config.jacobian;
        self.config.clone_from(&config.straight_path);
    }

    fn feeds_forward(&self) -> bool {
        true
    }

    fn efforts(
        &mut self,
        arm: &mut Manipulator,
        seen: &Measurement<'_>,
        pull: &mut DVector<f64>,
    ) -> Result<ControlReport, LawError> {
        let mut report = ControlReport::on(seen);
        let Some((e_p, e_o)) = report.saturate(&self.gains.saturation) else {
            return Ok(report);
        };
        (arm.workspace).generalized_jacobian(&arm.tip, &mut self.tip_moves);
        self.rates.copy_from(seen.qd);
        if let Some(lead) = seen.lead {
            self.rates -= lead;
        }
        let (mut V_E, mut W_E) = (Vector3::zeros(), Vector3::zeros());
        for (column, rate) in self.tip_moves.column_iter().zip(&self.rates) {
            V_E += column.fixed_rows::<3>(0) * *rate;
            W_E += column.fixed_rows::<3>(3) * *rate;
        }
        let mut torque = e_o * self.gains.k_o;
        let force = match self.config.shaping {
            Shaping::Rotation => self.rotated(&e_p, &V_E) * self.gains.k_p,
            Shaping::Damping => {
                let along = e_p.try_normalize(f64::MIN_POSITIVE);
                let along = along.map_or(V_E, |e| e * e.dot(&V_E));
                if self.gains.k_o > 0.0 {
                    torque -= W_E * self.config.d_turn;
                }
                let (d_along, d_across) = (self.config.d_along, self.config.d_across);
                e_p * self.gains.k_p - along * d_along - (V_E - along) * d_across
            }
        };
        let jacobian = match self.jacobian {
            JacobianKind::Generalized => &self.tip_moves,
            JacobianKind::FixedBase => {
                arm.workspace.fixed_base_jacobian(&arm.tip, &mut self.law);
                &self.law
            }
        };
        transpose_times(jacobian, &force, &torque, pull);
        let load = self.config.virtual_tip_inertia(self.gains.k_o);
        if load.mass > 0.0 {
            let (part, k_v) = (self.joint_damping(), &self.gains.k_v);
            let rates = &self.rates;
            let efforts = |j: usize| pull[j] - part * k_v[j] * rates[j];
            let wrench = (self.load).wrench(load, arm, seen, &self.tip_moves, rates, efforts);
            pull.gemv_tr(1.0, jacobian, &wrench, 1.0);
        }
        Ok(report)
    }

    fn joint_damping(&self) -> f64 {
        match self.config.shaping {
            Shaping::Rotation => 1.0,
            Shaping::Damping => self.config.joint_part,
        }
    }
}
