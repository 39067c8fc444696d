//! Summary of targets with joints, as reported by `fuyu simulate`.

use std::collections::BTreeMap;

use serde::Serialize;

use super::balance::{Balance, Carried, MomentumResidual};
use crate::nodes::dynamics::{Target, World};

/// Final joint state of a target, and residuals of its momentum and energy.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TargetSummary {
    /// Final joint positions by name \[rad or m\].
    pub joint_positions: BTreeMap<String, f64>,
    /// Final joint rates by name \[rad/s or m/s\].
    pub joint_velocities: BTreeMap<String, f64>,
    /// Momentum residual, see [`Balance::momentum_residual`].
    pub momentum_residual: MomentumResidual,
    /// Energy residual, see [`Balance::energy_residual`].
    pub energy_residual: f64,
}

/// Momentum and energy of a target, or, if the robot can grasp or touch it, of both together.
fn carried(world: &World, target: &Target) -> Carried {
    let mut coupled = world.coupled_targets();
    match coupled.any(|other| other.name == target.name) {
        true => Carried::of_robot(world),
        false => Carried::of_target(&target.body),
    }
}

/// The balances of all targets with joints.
pub(super) struct TargetBalances(Vec<Option<Balance>>);

impl TargetBalances {
    /// Starts balances with the current state.
    pub fn new(world: &World) -> Self {
        let balance = |target: &Target| {
            target
                .has_joints()
                .then(|| Balance::new(&carried(world, target)))
        };
        Self(world.targets.iter().map(balance).collect())
    }

    /// Adds the current state.
    pub fn see(&mut self, world: &World) {
        for (balance, target) in self.0.iter_mut().zip(&world.targets) {
            if let Some(balance) = balance {
                balance.see(&carried(world, target));
            }
        }
    }

    /// The summaries by the targets' names.
    pub fn summary(&self, world: &World) -> BTreeMap<String, TargetSummary> {
        let with_targets = self.0.iter().zip(&world.targets);
        let summary = |(balance, target): (&Option<Balance>, &Target)| {
            let balance = balance.as_ref()?;
            let joints = target.body.model().joints().iter();
            let names: Vec<_> = joints.map(|joint| joint.name.clone()).collect();
            let by_name = |values: &[f64]| {
                let values = values.iter().copied();
                names.iter().cloned().zip(values).collect()
            };
            let state = target.body.state();
            let summary = TargetSummary {
                joint_positions: by_name(state.q.as_slice()),
                joint_velocities: by_name(state.qd.as_slice()),
                momentum_residual: balance.momentum_residual(),
                energy_residual: balance.energy_residual(),
            };
            Some((target.name.clone(), summary))
        };
        with_targets.filter_map(summary).collect()
    }
}
