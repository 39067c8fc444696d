//! Stability check of sampled control loops before a run.

use super::{
    controller::{ControllerParams, second_tip},
    dynamics::{DynamicsParams, World},
    tip_frame,
};
use crate::control::{Controller, JacobianKind, LawConfig, LinearisedLoop, SampledDamping};
use crate::dynamics::Workspace;
use nalgebra::{DMatrix, DVector};

/// Delay with which the efforts that answer a state act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delay {
    /// They act from that state on: in lockstep, and in `fuyu simulate`.
    None,
    /// They act up to one period later: in real time.
    UpToPeriod,
}

impl Delay {
    /// Largest stable product of the damping's decay rate and the sampling period.
    fn limit(self) -> f64 {
        match self {
            Self::None => SampledDamping::UNSTABLE,
            Self::UpToPeriod => SampledDamping::UNSTABLE_IF_LATE,
        }
    }
}

/// The reason why the control loop is unstable in the initial posture, with stable parameters; `None` if it is stable.
/// The loop is sampled once per published state.
///
/// # Errors
/// If the parameters do not fit together.
pub fn instability(
    dynamics: &DynamicsParams,
    controller: &ControllerParams,
    delay: Delay,
) -> Result<Option<String>, String> {
    let world = World::new(dynamics)?;
    let model = world.robot.model();
    let period = 1.0 / dynamics.state_rate;
    let tip = tip_frame(model, &controller.tip_link)?;
    let config = controller.complete(controller.config.clone(), model, &tip)?;
    let limit = delay.limit() / period;
    let by_frequency = match &config.law {
        LawConfig::OperationalSpace(law) => {
            Some(("operational_space", "tip", law.frequency, law.damping()))
        }
        // Critically damped: 2 ω.
        LawConfig::ComputedTorque(law) => Some((
            "computed_torque",
            "joints",
            law.frequency,
            2.0 * law.frequency,
        )),
        _ => None,
    };
    if let Some((law, damped, frequency, rate)) = by_frequency {
        return Ok((rate > limit).then(|| {
            format!(
                "parameter {law}.frequency: the sampled loop is unstable: it damps the {damped} at {rate:.0} 1/s, sampled every {period} s; {}. Give frequency {} rad/s or less{}",
                stable_below(limit, delay),
                two_digits(frequency * limit / rate, f64::floor),
                or_state_rate(rate / limit / period)
            )
        }));
    }
    let tips = second_tip(model, &controller.second_tip_link)?;
    let controller =
        Controller::with_tips(model.clone(), tip, tips, config).map_err(|e| e.to_string())?;
    let gains = controller.joint_damping();
    let mut workspace = Workspace::new(model);
    workspace.set_positions(&world.robot.state().q);
    let Some(damping) = SampledDamping::at(&mut workspace, &gains) else {
        return Ok(None);
    };
    if damping.rate <= limit {
        return Ok(stiffness_instability(
            &controller,
            &mut workspace,
            &world.robot.state().q,
            period,
        ));
    }
    let (j, rate) = (damping.joint, damping.rate);
    let k_v = &controller.config().gains.k_v;
    // The law may use a fraction of the gain.
    let fraction = gains[j] / k_v[j];
    let remedy = match damping.largest_gain(1.0 / period) {
        Some(gain) => format!(
            "k_v[{j}] of at most {}",
            two_digits(gain / fraction, f64::floor)
        ),
        None => format!(
            "all of k_v at most {} times as large",
            two_digits(1.0 / (rate * period), f64::floor)
        ),
    };
    Ok(Some(format!(
        "parameter k_v: the sampled loop is unstable: joint '{}' is damped at {rate:.0} 1/s (k_v[{j}] is {}), sampled every {period} s; {}. A smaller time_step does not help. Give {remedy}{}",
        model.joints()[j].name,
        k_v[j],
        stable_below(limit, delay),
        or_state_rate(rate)
    )))
}

/// The reason why the position gains are too large for the sampling period, with stable gains; `None` if they are not
/// too large. The loop is linearised about the initial posture. Judged without delay: a loop that is unstable without
/// delay is unstable with any. A delay of a whole period, for which `k_v` is judged, is rare, and a saturating law
/// tolerates it for some time.
fn stiffness_instability(
    controller: &Controller,
    workspace: &mut Workspace,
    q: &DVector<f64>,
    period: f64,
) -> Option<String> {
    let config = controller.config();
    let (model, n) = (controller.model(), controller.model().dof());
    let jacobian = match &config.law {
        // The other Jacobian may be unstable even in continuous time.
        LawConfig::TransposeJacobian(law) if law.jacobian == JacobianKind::Generalized => {
            law.jacobian
        }
        LawConfig::JointPd(_) => JacobianKind::Generalized,
        _ => return None,
    };
    let (tip, gains) = (controller.tip(), &config.gains);
    let mut near = LinearisedLoop::at(model, workspace, tip, q, gains, jacobian);
    if let LawConfig::JointPd(law) = &config.law {
        near.stiffness = DMatrix::from_diagonal(&DVector::from_column_slice(&law.k_p));
    }
    let part = near.largest_stable_part(period);
    if part == 1.0 {
        return None;
    }
    // The joint with the largest ratio of its own stiffness to its own inertia.
    let stiffest = |j: usize| near.stiffness[(j, j)] / near.inertia[(j, j)];
    let j = (0..n).max_by(|a, b| stiffest(*a).total_cmp(&stiffest(*b)))?;
    let at_most = |gain: f64| two_digits(part * gain, f64::floor);
    let (parameter, remedy) = match &config.law {
        LawConfig::JointPd(law) => (
            "joint_k_p",
            format!("joint_k_p[{j}] of at most {}", at_most(law.k_p[j])),
        ),
        _ if gains.k_o == 0.0 => ("k_p", format!("k_p of at most {}", at_most(gains.k_p))),
        _ => {
            let (k_p, k_o) = (at_most(gains.k_p), at_most(gains.k_o));
            (
                "k_p",
                format!("k_p of at most {k_p} and k_o of at most {k_o}"),
            )
        }
    };
    Some(format!(
        "parameter {parameter}: the sampled loop is unstable: deviations of joint '{}' grow, sampled every {period} s, since the position gains are too large for the damping. Give {remedy}",
        model.joints()[j].name
    ))
}

fn stable_below(limit: f64, delay: Delay) -> String {
    let condition = match delay {
        Delay::None => "",
        Delay::UpToPeriod => " for any delay of the commands up to this period",
    };
    format!("that is stable up to {limit:.0} 1/s{condition}")
}

/// Suggestion of a stable state rate \[Hz\], if the dynamics node accepts it.
fn or_state_rate(rate: f64) -> String {
    let rate = two_digits(rate, f64::ceil);
    match rate <= 1000.0 {
        true => format!(", or dynamics a state_rate of {rate} Hz or more"),
        false => String::new(),
    }
}

/// A positive value rounded to two digits.
fn two_digits(value: f64, round: fn(f64) -> f64) -> f64 {
    let digit = 10f64.powi(value.log10().floor() as i32 - 1);
    let rounded = round(value / digit) * digit;
    // Removes digits left by the product with 0.1, 0.01, ...
    format!("{rounded:.12e}").parse().unwrap_or(rounded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_two_digits() {
        assert_eq!(two_digits(1234.0, f64::ceil), 1300.0);
        assert_eq!(two_digits(0.5678, f64::floor), 0.56);
        assert_eq!(two_digits(80.0, f64::floor), 80.0);
    }
}
