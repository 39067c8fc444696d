//! Momentum and energy of a recorded run.

use nalgebra::Vector3;
use std::collections::HashMap;

use super::recorded::{BaseSample, JointSample, MomentumSample, RecordedRun};
use crate::dynamics::{Momentum, State, Workspace};
use crate::model::{Model, Spring};

/// Change of a momentum since the start.
pub struct Residual {
    /// Stamps \[ns\] and changes relative to `scale`.
    pub values: Vec<(i64, f64)>,
    /// What the changes are relative to.
    pub scale: f64,
    /// What that is.
    pub scale_of: &'static str,
}

/// Residuals of linear and angular momentum as `ground_truth/momentum` states them.
pub fn momentum_residuals(run: &RecordedRun) -> Option<[Residual; 2]> {
    let first = run.momentum.first()?;
    let carried = carried(run);
    let residual = |pick: fn(&MomentumSample) -> Vector3<f64>, carried: f64| {
        let start = pick(first);
        let (scale, scale_of) = scale_of(start.norm(), carried);
        let values = run
            .momentum
            .iter()
            .map(|m| (m.time, (pick(m) - start).norm() / scale))
            .collect();
        Residual {
            values,
            scale,
            scale_of,
        }
    };
    Some([
        residual(|m| m.linear, carried.0),
        residual(|m| m.angular, carried.1),
    ])
}

/// Momentum from recorded velocities.
pub(super) struct MotionMomentum {
    /// Largest change since the start, linear or angular, relative to `scales`.
    pub change: f64,
    /// What changes are relative to (linear \[N s\], angular \[N m s\]).
    pub scales: (f64, f64),
    /// Number of states that went into it.
    pub samples: usize,
}

/// What a run lacks.
pub(super) enum Missing {
    /// It was not recorded.
    Data(&'static str),
    /// The robot description is not one.
    Model(String),
}

/// Momentum from joint states, odometry and robot description, whatever the dynamics node says about it.
pub(super) fn motion_momentum(run: &RecordedRun) -> Result<MotionMomentum, Missing> {
    let model = match &run.model {
        None => return Err(Missing::Data("no robot_description")),
        Some(Err(e)) => return Err(Missing::Model(e.clone())),
        Some(Ok(model)) => model,
    };
    let mut motion = Motion::new(model, &run.joint_names).ok_or(Missing::Data(
        "joint_states and robot_description name other joints",
    ))?;
    let samples: Vec<(Momentum, (f64, f64))> =
        paired(run).map(|(j, b)| motion.momentum(j, b)).collect();
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
        // A NaN in either must come out.
        max([linear, angular].into_iter())
    }));
    Ok(MotionMomentum {
        change,
        scales: (linear_scale, angular_scale),
        samples: samples.len(),
    })
}

/// Kinetic energy against work.
pub(super) struct EnergyBalance {
    /// Largest difference between the change of kinetic energy and the work done since the start \[J\].
    pub residual: f64,
    /// Energy that flowed: work and losses summed without sign, or the peak energy if that is more \[J\].
    pub flow: f64,
    /// Largest kinetic energy \[J\].
    pub peak: f64,
}

/// Kinetic energy against the work of joint efforts and springs less the losses in joint damping.
pub(super) fn energy_balance(run: &RecordedRun) -> Result<EnergyBalance, &'static str> {
    let energy: HashMap<i64, f64> = run
        .momentum
        .iter()
        .map(|m| (m.time, m.kinetic_energy))
        .collect();
    if energy.is_empty() {
        return Err("no ground_truth/momentum");
    }
    if !run.joints.iter().any(|j| !j.effort.is_empty()) {
        return Err("joint_states carry no effort");
    }
    let passive = passive(run);
    let mut start = None;
    let (mut work, mut flow, mut peak, mut residual) = (0.0, 0.0, 0.0f64, None);
    let usual = usual_period(&run.joints);
    for pair in run.joints.windows(2) {
        if pair[1].time - pair[0].time > usual * 3 / 2 {
            // Samples are missing, and with them the efforts that acted: the balance begins anew.
            start = None;
            continue;
        }
        if start.is_none() {
            start = energy.get(&pair[0].time).map(|e| (*e, work));
        }
        let (step, moved) = work_between(&pair[0], &pair[1], &passive);
        work += step;
        flow += moved;
        if let (Some((e0, w0)), Some(e1)) = (start, energy.get(&pair[1].time)) {
            let difference = ((e1 - e0) - (work - w0)).abs();
            residual = Some(max([residual.unwrap_or(0.0), difference].into_iter()));
            peak = peak.max(*e1);
        }
    }
    Ok(EnergyBalance {
        residual: residual.ok_or("no joint_states and ground_truth/momentum of the same time")?,
        flow: peak.max(flow),
        peak,
    })
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

/// The largest value; NaN if there is one.
pub(super) fn max(values: impl Iterator<Item = f64>) -> f64 {
    // NaN must not be lost in a comparison.
    values.fold(0.0, |m, v| if v > m || v.is_nan() { v } else { m })
}

/// What a momentum is compared with, and what that is called.
fn scale_of(initial: f64, carried: f64) -> (f64, &'static str) {
    if initial >= carried && initial > 0.0 {
        (initial, "at the start")
    } else if carried > 0.0 {
        (carried, "carried by the bodies, summed without sign")
    } else {
        (1.0, "(nothing moves)")
    }
}

/// Largest sum of the momenta that single bodies carry (linear, angular); zero if it is not known.
fn carried(run: &RecordedRun) -> (f64, f64) {
    let Some(Ok(model)) = &run.model else {
        return (0.0, 0.0);
    };
    let Some(mut motion) = Motion::new(model, &run.joint_names) else {
        return (0.0, 0.0);
    };
    paired(run)
        .map(|(j, b)| motion.momentum(j, b).1)
        .fold((0.0, 0.0), |s, c| (s.0.max(c.0), s.1.max(c.1)))
}

/// Joint states and base states of the same time.
fn paired(run: &RecordedRun) -> impl Iterator<Item = (&JointSample, &BaseSample)> {
    let base: HashMap<i64, &BaseSample> = run.base.iter().map(|b| (b.time, b)).collect();
    run.joints
        .iter()
        .filter_map(move |j| Some((j, *base.get(&j.time)?)))
}

/// Momentum from recorded joint and base velocities.
struct Motion<'a> {
    model: &'a Model,
    workspace: Workspace,
    state: State,
    /// Place in the model of each recorded joint.
    order: Vec<usize>,
}

impl<'a> Motion<'a> {
    fn new(model: &'a Model, names: &[String]) -> Option<Self> {
        let order: Vec<usize> = names
            .iter()
            .map(|name| model.joint_index(name))
            .collect::<Option<_>>()?;
        (order.len() == model.dof()).then(|| Self {
            model,
            workspace: Workspace::new(model),
            state: State::at_rest(model),
            order,
        })
    }

    /// Momentum in world axes, and the sum of what single bodies carry.
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

/// Damper and spring of each recorded joint.
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

/// Work of efforts and springs less damping losses between two samples \[J\], and the sum of its parts
/// without sign.
fn work_between(a: &JointSample, b: &JointSample, passive: &[(f64, Spring)]) -> (f64, f64) {
    let dt = (b.time - a.time) as f64 * 1e-9;
    let (mut work, mut flow) = (0.0, 0.0);
    for (j, (damping, spring)) in passive.iter().enumerate() {
        let moved = b.q[j] - a.q[j];
        // A sample's effort acted since the one before; rates in between are taken as linear.
        let done = b.effort.get(j).copied().unwrap_or(0.0) * moved;
        // A spring's work depends on where it was and is, exactly.
        let released = spring.stiffness * (spring.rest - 0.5 * (a.q[j] + b.q[j])) * moved;
        // Where nothing damps, rates do not count, not even bad ones.
        let lost = match *damping {
            0.0 => 0.0,
            c => c * dt * (a.qd[j] * a.qd[j] + a.qd[j] * b.qd[j] + b.qd[j] * b.qd[j]) / 3.0,
        };
        work += done + released - lost;
        flow += done.abs() + released.abs() + lost;
    }
    (work, flow)
}
