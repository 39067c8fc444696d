//! Pulses of thrusters with a given mean couple.

use nalgebra::Vector3;

use crate::control::attitude::{AttitudeConfigError, ThrusterAllocator};
use crate::dynamics::flexible::FlexibleSystem;

/// Turns a couple that changes from step to step into on-times of thrusters, once per period. The mean couple over a
/// period is the couple requested at its start.
#[derive(Debug, Clone)]
pub struct ThrusterPulses {
    allocator: ThrusterAllocator,
    period: f64,
    /// Start of the present period \[s\]; `None` with closed valves.
    begun: Option<f64>,
}

impl ThrusterPulses {
    /// Pulses of the thrusters of `system`, with a period \[s\]; `None` if it has none.
    ///
    /// # Errors
    /// [`AttitudeConfigError`] as of [`ThrusterAllocator::new`].
    pub fn new(system: &FlexibleSystem, period: f64) -> Result<Option<Self>, AttitudeConfigError> {
        let allocator = ThrusterAllocator::new(system, period)?;
        Ok(allocator.map(|allocator| Self {
            allocator,
            period,
            begun: None,
        }))
    }

    /// On-times \[s\] from `time` \[s\] on, if a period starts then, for a mean couple \[N m\] with the common centre
    /// of mass at `p_BC` \[m\] (both base axes). If no couple is requested, open valves close at once.
    pub fn follow(
        &mut self,
        time: f64,
        couple: &Vector3<f64>,
        p_BC: &Vector3<f64>,
    ) -> Option<&[f64]> {
        if *couple == Vector3::zeros() {
            self.begun.take()?;
            self.allocator.reset();
            return Some(self.allocator.on_times());
        }
        // Half a nanosecond, for rounding of sums of periods. Time may also have jumped back.
        let lasts = |begun: f64| (0.0..self.period - 5e-10).contains(&(time - begun));
        if self.begun.is_some_and(lasts) {
            return None;
        }
        self.begun = Some(time);
        self.allocator.allocate(couple, p_BC);
        Some(self.allocator.on_times())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Unit;

    use super::*;
    use crate::control::fixtures::satellite;
    use crate::dynamics::flexible::Thruster;

    const THRUST: f64 = 2.0;

    /// Position and direction of twelve thrusters: pairs that push against each other about each axis, both ways.
    fn mountings() -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let mut all = Vec::new();
        for axis in 0..3 {
            let (lever, along) = (
                Vector3::ith((axis + 1) % 3, 1.0),
                Vector3::ith((axis + 2) % 3, 1.0),
            );
            for sign in [1.0, -1.0] {
                all.extend([(lever, along * sign), (-lever, -along * sign)]);
            }
        }
        all
    }

    fn pulses(period: f64) -> ThrusterPulses {
        let model = satellite();
        let base = model.frame("base_link").unwrap();
        let mut builder = FlexibleSystem::builder(&model);
        for (i, (position, direction)) in mountings().into_iter().enumerate() {
            let direction = Unit::new_normalize(direction);
            let thruster = Thruster {
                name: format!("t{i}"),
                position,
                direction,
                thrust: THRUST,
                min_on_time: 0.02,
            };
            builder = builder.thruster(base, thruster);
        }
        let system = builder.build().unwrap();
        ThrusterPulses::new(&system, period).unwrap().unwrap()
    }

    /// Angular impulse about `p_BC` \[N m s\].
    fn impulse(on_times: &[f64], p_BC: &Vector3<f64>) -> Vector3<f64> {
        let each = mountings().into_iter().zip(on_times);
        each.map(|((p, d), t)| (p - p_BC).cross(&d) * (THRUST * t))
            .sum()
    }

    // Ten seconds of steps of 0.01 s with a rotating couple: one command per period, and the sum of the impulses is
    // that of the couple to within a pulse of the shortest length. Commands in every step would give ten times the
    // impulse.
    #[test]
    fn the_mean_of_the_pulses_is_the_couple() {
        let mut pulses = pulses(0.1);
        let p_BC = Vector3::new(0.4, 0.2, -0.1);
        let (mut wanted, mut given, mut commands) = (Vector3::zeros(), Vector3::zeros(), 0);
        for k in 0..1000 {
            let time = f64::from(k) * 0.01;
            let couple = Vector3::new((0.3 * time).cos(), (0.3 * time).sin(), 0.02);
            if let Some(on_times) = pulses.follow(time, &couple, &p_BC) {
                assert!(
                    on_times.iter().all(|t| *t == 0.0 || *t >= 0.02),
                    "{on_times:?}"
                );
                given += impulse(on_times, &p_BC);
                wanted += couple * 0.1;
                commands += 1;
            }
        }
        assert_eq!(commands, 100);
        assert!(
            (given - wanted).norm() < 2.0 * 0.02 * THRUST * 1.5,
            "{given} {wanted}"
        );
    }

    #[test]
    fn valves_close_once_when_no_couple_is_wanted() {
        let mut pulses = pulses(0.1);
        let none = Vector3::zeros();
        assert_eq!(pulses.follow(0.0, &none, &none), None);
        assert!(pulses.follow(0.0, &Vector3::x(), &none).is_some());
        assert_eq!(pulses.follow(0.05, &Vector3::x(), &none), None);
        let closed = pulses.follow(0.06, &none, &none).map(<[f64]>::to_vec);
        assert_eq!(closed, Some(vec![0.0; 12]));
        assert_eq!(pulses.follow(0.07, &none, &none), None);
        assert!(pulses.follow(0.08, &Vector3::x(), &none).is_some());
        // Simulated time jumps back.
        assert!(pulses.follow(0.01, &Vector3::x(), &none).is_some());
    }
}
