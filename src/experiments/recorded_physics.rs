//! Momentum and energy balances of a recorded run.

use nalgebra::Vector3;
use std::{borrow::Cow, collections::HashMap};

use super::recorded::{
    BaseSample, DeformationSample, ExternalSample, JointSample, MomentumSample, RecordedRun,
};
use crate::dynamics::{Momentum, State, Workspace};
use crate::model::{Model, Spring};

/// Change of a momentum component since the start.
pub struct Residual {
    /// Stamps \[ns\] and changes relative to `scale`.
    pub values: Vec<(i64, f64)>,
    /// Reference value of the changes.
    pub scale: f64,
    /// Description of the reference value.
    pub scale_of: &'static str,
}

/// Residuals of linear and angular momentum from `ground_truth/momentum`, minus the change due to external wrenches.
pub fn momentum_residuals(run: &RecordedRun) -> Option<[Residual; 2]> {
    let first = run.momentum.first()?;
    let carried = carried(run);
    type Parts = (
        fn(&MomentumSample) -> Vector3<f64>,
        fn(&ExternalSample) -> Vector3<f64>,
    );
    let residual = |(pick, external): Parts, carried: f64| {
        let own = |m: &MomentumSample| pick(m) - external(&run.external_until(m.time));
        let start = own(first);
        let (scale, scale_of) = scale_of(start.norm(), carried);
        let values = run
            .momentum
            .iter()
            .map(|m| (m.time, (own(m) - start).norm() / scale))
            .collect();
        Residual {
            values,
            scale,
            scale_of,
        }
    };
    Some([
        residual((|m| m.linear, |e| e.linear), carried.0),
        residual((|m| m.angular, |e| e.angular), carried.1),
    ])
}

/// Momentum computed from recorded velocities.
pub(super) struct MotionMomentum {
    /// Largest change since the start that external wrenches do not explain, linear or angular, relative to `scales`.
    pub change: f64,
    /// Reference values (linear \[N s\], angular \[N m s\]).
    pub scales: (f64, f64),
    /// Number of states used.
    pub samples: usize,
}

/// Data that are missing in a run.
pub(super) enum Missing {
    /// Not recorded.
    Data(&'static str),
    /// The robot description is invalid.
    Model(String),
}

/// Momentum from joint states, odometry and robot description, independent of `ground_truth/momentum`.
pub(super) fn motion_momentum(run: &RecordedRun) -> Result<MotionMomentum, Missing> {
    if !run.wheels.is_empty() || !run.deformation.is_empty() {
        return Err(Missing::Data(
            "robot_description does not describe appendages, elastic joints and wheels",
        ));
    }
    let model = match &run.model {
        None => return Err(Missing::Data("no robot_description")),
        Some(Err(e)) => return Err(Missing::Model(e.clone())),
        Some(Ok(model)) => model,
    };
    let mut motion = RecordedMotion::new(model, &run.joint_names).ok_or(Missing::Data(
        "joint_states and robot_description name different joints",
    ))?;
    let samples: Vec<(Momentum, (f64, f64))> = paired(run)
        .map(|(j, b)| {
            let (mut momentum, carried) = motion.momentum(j, b);
            let external = run.external_until(j.time);
            momentum.linear -= external.linear;
            momentum.angular -= external.angular;
            (momentum, carried)
        })
        .collect();
    let (first, _) = samples.first().ok_or(Missing::Data(
        "no joint_states and ground_truth/odom of the same time",
    ))?;
    let carried = samples.iter().fold((0.0, 0.0), |s: (f64, f64), (_, c)| {
        (s.0.max(c.0), s.1.max(c.1))
    });
    let (linear_scale, _) = scale_of(first.linear.norm(), carried.0);
    let (angular_scale, _) = scale_of(first.angular.norm(), carried.1);
    let change = max(samples.iter().map(|(m, _)| {
        let linear = (m.linear - first.linear).norm() / linear_scale;
        let angular = (m.angular - first.angular).norm() / angular_scale;
        // Propagate a NaN in either.
        max([linear, angular].into_iter())
    }));
    Ok(MotionMomentum {
        change,
        scales: (linear_scale, angular_scale),
        samples: samples.len(),
    })
}

/// Energy balance: kinetic energy compared with work.
pub(super) struct EnergyBalance {
    /// Largest difference between the change of kinetic energy and the work since the start, minus the part that
    /// [`unresolved_work`] explains \[J\].
    pub residual: f64,
    /// Sum of the differences that [`unresolved_work`] explains \[J\].
    pub unresolved: f64,
    /// Energy exchanged: sum of the absolute values of work and losses, or the peak energy if larger \[J\].
    pub flow: f64,
    /// Largest kinetic energy \[J\].
    pub peak: f64,
}

/// Work since a sample of momentum and energy.
struct WorkSince<'a> {
    sample: &'a MomentumSample,
    /// Work since then \[J\].
    work: f64,
    /// Sum of [`unresolved_work`] \[J\].
    unresolved: f64,
}

impl<'a> WorkSince<'a> {
    fn new(sample: &'a MomentumSample) -> Self {
        Self {
            sample,
            work: 0.0,
            unresolved: 0.0,
        }
    }
}

/// Compares kinetic and strain energy with the work of joint efforts, wheel torques, springs and external wrenches
/// minus the dissipated energy. If dissipation is not recorded, that of the joints' damping is computed.
pub(super) fn energy_balance(run: &RecordedRun) -> Result<EnergyBalance, &'static str> {
    let energy: HashMap<i64, &MomentumSample> = run.momentum.iter().map(|m| (m.time, m)).collect();
    let strain: HashMap<i64, f64> = (run.deformation.iter())
        .map(|sample| (sample.time, sample.strain_energy))
        .collect();
    // A robot without deformation has no strain energy.
    let stored = |m: &MomentumSample| match strain.is_empty() {
        true => Some(m.kinetic_energy),
        false => Some(m.kinetic_energy + strain.get(&m.time)?),
    };
    if energy.is_empty() {
        return Err("no ground_truth/momentum");
    }
    if !run.joints.iter().any(|j| !j.effort.is_empty()) {
        return Err("joint_states contain no effort");
    }
    let driven = Driven::of(run);
    let joints = driven.samples;
    let mut passive = passive(run);
    passive.resize(passive.len() + driven.more, Default::default());
    if run.momentum.iter().any(|m| m.dissipated_energy != 0.0) {
        for (damping, _) in &mut passive {
            *damping = 0.0;
        }
    }
    let (mut flow, mut peak, mut residual) = (0.0, 0.0f64, None);
    let (mut difference, mut unresolved) = (0.0, 0.0);
    let mut since: Option<WorkSince<'_>> = None;
    let usual = usual_period(&joints);
    for (i, pair) in joints.windows(2).enumerate() {
        if pair[1].time.saturating_sub(pair[0].time) > usual.saturating_mul(3) / 2 {
            // Samples, and so the efforts, are missing: restart the balance.
            (since, difference) = (None, 0.0);
            continue;
        }
        since = since.or_else(|| energy.get(&pair[0].time).copied().map(WorkSince::new));
        let (done, moved) = work_between(&pair[0], &pair[1], &passive);
        let external =
            run.external_until(pair[1].time).work - run.external_until(pair[0].time).work;
        flow += moved + external.abs();
        let Some(last) = &mut since else {
            continue;
        };
        last.work += done + external;
        let next = joints.get(i + 2).unwrap_or(&pair[1]);
        last.unresolved += unresolved_work(&pair[0], &pair[1], next);
        let stored_now = energy
            .get(&pair[1].time)
            .and_then(|e1| Some((e1, stored(e1)?)));
        if let (Some((e1, now)), Some(before)) = (stored_now, stored(last.sample)) {
            let lost = e1.dissipated_energy - last.sample.dissipated_energy;
            flow += lost;
            let found = (now - before) + lost - last.work;
            let explained = if found.abs() <= last.unresolved {
                found
            } else {
                last.unresolved.copysign(found)
            };
            difference += found - explained;
            unresolved += explained.abs();
            residual = Some(max(
                [residual.unwrap_or(0.0), f64::abs(difference)].into_iter()
            ));
            peak = peak.max(e1.kinetic_energy);
            since = Some(WorkSince::new(e1));
        }
    }
    Ok(EnergyBalance {
        residual: residual.ok_or("no joint_states and ground_truth/momentum of the same time")?,
        unresolved,
        flow: peak.max(flow),
        peak,
    })
}

/// All motor-driven axes: the joints, then the motors of elastic joints, then the wheels.
struct Driven<'a> {
    samples: Cow<'a, [JointSample]>,
    /// Number of axes other than joints.
    more: usize,
}

impl<'a> Driven<'a> {
    fn of(run: &'a RecordedRun) -> Self {
        let no_motors = run.deformation.iter().all(|d| d.joint_names.is_empty());
        if run.wheels.is_empty() && no_motors {
            return Self {
                samples: Cow::Borrowed(&run.joints),
                more: 0,
            };
        }
        let wheels: HashMap<i64, &JointSample> = run.wheels.iter().map(|w| (w.time, w)).collect();
        // Only samples with the same motors as the first one can be compared.
        let motors = run.deformation.first().map_or(&[][..], |d| &d.joint_names);
        let is_whole = |d: &&DeformationSample| {
            let lengths = [d.motor_position.len(), d.motor_velocity.len()];
            d.joint_names == motors && lengths == [motors.len(); 2]
        };
        let deformation: HashMap<i64, &DeformationSample> = (run.deformation.iter())
            .filter(is_whole)
            .map(|d| (d.time, d))
            .collect();
        let joined = run.joints.iter().filter_map(|joints| {
            let mut sample = joints.clone();
            sample.effort.resize(sample.q.len(), 0.0);
            if !no_motors {
                add_motors(
                    &mut sample,
                    deformation.get(&joints.time)?,
                    &run.joint_names,
                );
            }
            if !run.wheels.is_empty() {
                let wheels = wheels.get(&joints.time)?;
                sample.q.extend(&wheels.q);
                sample.qd.extend(&wheels.qd);
                sample.effort.extend(&wheels.effort);
            }
            Some(sample)
        });
        let samples: Vec<JointSample> = joined.collect();
        let all = samples.first().map_or(0, |sample| sample.q.len());
        Self {
            more: all.saturating_sub(run.joint_names.len()),
            samples: Cow::Owned(samples),
        }
    }
}

/// Adds the motors of elastic joints, on which the joints' efforts act.
fn add_motors(sample: &mut JointSample, deformation: &DeformationSample, names: &[String]) {
    let angles = deformation.motor_position.iter();
    let motors = angles.zip(&deformation.motor_velocity);
    for (joint, (angle, rate)) in deformation.joint_names.iter().zip(motors) {
        let of_joint = names.iter().position(|name| name == joint);
        let effort = of_joint.map_or(0.0, |j| std::mem::take(&mut sample.effort[j]));
        sample.q.push(*angle);
        sample.qd.push(*rate);
        sample.effort.push(effort);
    }
}

/// Median time between samples \[ns\].
fn usual_period(joints: &[JointSample]) -> i64 {
    let mut periods: Vec<i64> = joints.windows(2).map(|p| p[1].time - p[0].time).collect();
    periods.sort_unstable();
    periods
        .get(periods.len() / 2)
        .copied()
        .unwrap_or(i64::MAX / 3)
}

/// The largest value; NaN if any value is NaN.
pub(super) fn max(values: impl Iterator<Item = f64>) -> f64 {
    // Comparisons would discard a NaN.
    values.fold(0.0, |m, v| if v > m || v.is_nan() { v } else { m })
}

/// Reference value for a momentum, and its description.
fn scale_of(initial: f64, carried: f64) -> (f64, &'static str) {
    if initial >= carried && initial > 0.0 {
        (initial, "at the start")
    } else if carried > 0.0 {
        (carried, "carried by the bodies, summed without sign")
    } else {
        (1.0, "(nothing moves)")
    }
}

/// Largest sum of the magnitudes of the bodies' momenta (linear, angular); zero if unknown.
fn carried(run: &RecordedRun) -> (f64, f64) {
    let Some(Ok(model)) = &run.model else {
        return (0.0, 0.0);
    };
    let Some(mut motion) = RecordedMotion::new(model, &run.joint_names) else {
        return (0.0, 0.0);
    };
    paired(run)
        .map(|(j, b)| motion.momentum(j, b).1)
        .fold((0.0, 0.0), |s, c| (s.0.max(c.0), s.1.max(c.1)))
}

/// Pairs of joint states and base states with equal stamps.
fn paired(run: &RecordedRun) -> impl Iterator<Item = (&JointSample, &BaseSample)> {
    let base: HashMap<i64, &BaseSample> = run.base.iter().map(|b| (b.time, b)).collect();
    run.joints
        .iter()
        .filter_map(move |j| Some((j, *base.get(&j.time)?)))
}

/// Momentum from recorded joint and base velocities.
struct RecordedMotion {
    workspace: Workspace,
    state: State,
    /// Index in the model of each recorded joint.
    order: Vec<usize>,
}

impl RecordedMotion {
    fn new(model: &Model, names: &[String]) -> Option<Self> {
        let order: Vec<usize> = names
            .iter()
            .map(|name| model.joint_index(name))
            .collect::<Option<_>>()?;
        (order.len() == model.dof()).then(|| Self {
            workspace: Workspace::new(model),
            state: State::at_rest(model),
            order,
        })
    }

    /// Momentum in world axes, and the sum of the magnitudes over the bodies.
    fn momentum(&mut self, joints: &JointSample, base: &BaseSample) -> (Momentum, (f64, f64)) {
        let state = &mut self.state;
        for (i, &j) in self.order.iter().enumerate() {
            state.q[j] = joints.q[i];
            state.qd[j] = joints.qd[i];
        }
        let X_WB = &base.X_WB;
        state.set_base(&mut self.workspace, X_WB, &base.V_WB_B);
        self.workspace.set_motion(state);
        (state.momentum_W, self.workspace.momentum_scale())
    }
}

/// Damping and spring of each recorded joint.
fn passive(run: &RecordedRun) -> Vec<(f64, Spring)> {
    let of_joint = |name: &String| match &run.model {
        Some(Ok(model)) => model.joint_index(name).map_or(Default::default(), |j| {
            let joint = &model.joints()[j];
            (joint.damping, joint.spring)
        }),
        _ => Default::default(),
    };
    run.joint_names.iter().map(of_joint).collect()
}

/// Largest work between samples `a` and `b` that their mean effort and motion do not show \[J\]; `next` is the sample
/// after `b`. The mean of a product differs from the product of the means by at most a quarter of the product of both
/// ranges (Grüss 1935, Math. Z. 39, p. 215). Only if a command acts between two samples does the effort have such a
/// range.
fn unresolved_work(a: &JointSample, b: &JointSample, next: &JointSample) -> f64 {
    let dt = (b.time - a.time) as f64 * 1e-9;
    let effort = |sample: &JointSample, j: usize| sample.effort.get(j).copied().unwrap_or(0.0);
    let of_joint = |j: usize| {
        let around = [effort(a, j), effort(b, j), effort(next, j)];
        let highest = around.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let lowest = around.into_iter().fold(f64::INFINITY, f64::min);
        // NaN rates have no known range and get no allowance.
        let rates = (b.qd[j] - a.qd[j]).abs();
        0.25 * (highest - lowest) * if rates.is_nan() { 0.0 } else { rates } * dt
    };
    (0..b.q.len()).map(of_joint).sum()
}

/// Work of efforts and springs minus damping losses between two samples \[J\], and the sum of the magnitudes of these
/// parts.
fn work_between(a: &JointSample, b: &JointSample, passive: &[(f64, Spring)]) -> (f64, f64) {
    let dt = (b.time - a.time) as f64 * 1e-9;
    let (mut work, mut flow) = (0.0, 0.0);
    for (j, (damping, spring)) in passive.iter().enumerate() {
        let moved = b.q[j] - a.q[j];
        // A sample's effort has acted since the previous sample; rates in between are interpolated linearly.
        let done = b.effort.get(j).copied().unwrap_or(0.0) * moved;
        // The work of a spring depends on the end points only.
        let released = spring.stiffness * (spring.rest - 0.5 * (a.q[j] + b.q[j])) * moved;
        // Without damping, rates are not used, so that NaN rates do no harm.
        let lost = match *damping {
            0.0 => 0.0,
            c => c * dt * (a.qd[j] * a.qd[j] + a.qd[j] * b.qd[j] + b.qd[j] * b.qd[j]) / 3.0,
        };
        work += done + released - lost;
        flow += done.abs() + released.abs() + lost;
    }
    (work, flow)
}

#[cfg(test)]
mod tests {
    use super::*;

    // A body of 1 kg at 1 m/s, braked by 2 N during the second half of 0.1 s. Would break if a change of effort between
    // two samples counted as an energy error.
    #[test]
    fn an_effort_that_changes_between_samples_is_allowed_for() {
        let sample = |time, q, qd, effort| JointSample {
            time,
            q: vec![q],
            qd: vec![qd],
            effort: vec![effort],
        };
        let braked = 0.05 - 0.5 * 2.0 * 0.05f64.powi(2);
        let [a, b, next] = [
            sample(0, 0.0, 1.0, 0.0),
            sample(100_000_000, 0.05 + braked, 0.9, -1.0),
            sample(200_000_000, 0.185, 0.8, -2.0),
        ];
        let (work, _) = work_between(&a, &b, &[Default::default()]);
        let error = (0.5 * (0.9f64.powi(2) - 1.0) - work).abs();
        let allowed = unresolved_work(&a, &b, &next);
        assert!((error - 0.0025).abs() < 1e-12, "{error}");
        assert!((allowed - 0.005).abs() < 1e-12, "{allowed}");
        // With a constant effort there is no allowance.
        assert_eq!(unresolved_work(&next, &next, &next), 0.0);
    }
}
