//! Control loops that are unstable because they are sampled, found before a run.

use super::{
    controller::{ControllerParams, second_tip},
    dynamics::{DynamicsParams, World},
    tip_frame,
};
use crate::control::{Controller, LawConfig, SampledDamping};

/// When the efforts that answer a state act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delay {
    /// From that state on: in lockstep, and in `fuyu simulate`.
    None,
    /// Up to a period later: in real time.
    UpToPeriod,
}

impl Delay {
    /// Largest product of decay rate and period with which damping is stable.
    fn limit(self) -> f64 {
        match self {
            Self::None => SampledDamping::UNSTABLE,
            Self::UpToPeriod => SampledDamping::UNSTABLE_IF_LATE,
        }
    }
}

/// Why the damping of the control loop is unstable at the start, and parameters with which it is not; `None` if it is
/// stable. The loop is sampled once per published state.
///
/// # Errors
/// When the parameters do not fit together.
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
    if let LawConfig::OperationalSpace(law) = &config.law {
        let rate = law.damping();
        return Ok((rate > limit).then(|| {
            let frequency = two_digits(law.frequency * limit / rate, f64::floor);
            format!(
                "parameter operational_space.frequency: the sampled loop is unstable: it damps the tip at {rate:.0} 1/s, sampled every {period} s; {}. Give frequency {frequency} rad/s or less{}",
                stable_below(limit, delay),
                or_state_rate(rate * limit.recip() / period)
            )
        }));
    }
    if let LawConfig::ComputedTorque(law) = &config.law {
        // Critically damped: 2 ω.
        let rate = 2.0 * law.frequency;
        return Ok((rate > limit).then(|| {
            format!(
                "parameter computed_torque.frequency: the sampled loop is unstable: it damps the joints at {rate:.0} 1/s, sampled every {period} s; {}. Give frequency {} rad/s or less{}",
                stable_below(limit, delay),
                two_digits(0.5 * limit, f64::floor),
                or_state_rate(rate * limit.recip() / period)
            )
        }));
    }
    let tips = second_tip(model, &controller.second_tip_link)?;
    let controller =
        Controller::with_tips(model.clone(), tip, tips, config).map_err(|e| e.to_string())?;
    let gains = controller.joint_damping();
    let mut workspace = world.robot.workspace().clone();
    let Some(damping) = SampledDamping::at(&mut workspace, &gains) else {
        return Ok(None);
    };
    if damping.rate <= limit {
        return Ok(None);
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

fn stable_below(limit: f64, delay: Delay) -> String {
    let condition = match delay {
        Delay::None => "",
        Delay::UpToPeriod => " for any delay of the commands up to this period",
    };
    format!("that is stable up to {limit:.0} 1/s{condition}")
}

/// The state rate that works \[Hz\], if the dynamics node accepts it.
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
    // Removes the digits that the product with 0.1, 0.01, ... leaves.
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
