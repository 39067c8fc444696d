//! Performance figures of a run, as reported by `fuyu simulate`.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use serde::Serialize;

use super::{
    Moment,
    balance::{Balance, Carried, MomentumResidual, larger},
    target_summary::{TargetBalances, TargetSummary},
};
use crate::{
    nodes::dynamics::{FreeBody as _, World},
    spatial::roll_pitch_yaw_intrinsic,
};

/// Selection of the expensive figures, of which a campaign computes only those that it needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Figures {
    /// Whether momentum and energy residuals are computed.
    pub residuals: bool,
    /// Whether the largest accelerations of tip and base are computed.
    pub accelerations: bool,
    /// Whether events are collected.
    pub events: bool,
}

impl Figures {
    /// All figures.
    pub const ALL: Self = Self {
        residuals: true,
        accelerations: true,
        events: true,
    };

    /// The figures needed for results with these dotted names, as in `fuyu simulate --json`.
    pub fn of_results<'a>(names: impl Iterator<Item = &'a str>) -> Self {
        let mut needed = Self {
            residuals: false,
            accelerations: false,
            events: false,
        };
        for part in names.flat_map(|name| name.split(['.', '['])) {
            match part {
                "momentum_residual" | "energy_residual" => needed.residuals = true,
                "max_tip_acceleration" | "max_base_angular_acceleration" => {
                    needed.accelerations = true;
                }
                "events" => needed.events = true,
                _ => {}
            }
        }
        needed
    }
}

/// Accumulates the figures of a run, state by state.
pub struct Performance {
    figures: Figures,
    initial_base: Vector3<f64>,
    time: f64,
    /// Position and attitude error of the tip; `None` without a controller or operator.
    last_error: Option<(f64, Option<f64>)>,
    position_settled: Settled,
    attitude_settled: Settled,
    balance: Balance,
    targets: TargetBalances,
    max_tip_speed: Option<f64>,
    max_tip_acceleration: Option<f64>,
    max_base_angular_acceleration: f64,
    loop_gap: Option<f64>,
}

/// Time since which a value has stayed below a bound.
struct Settled {
    bound: f64,
    since: Option<f64>,
}

impl Settled {
    fn new(bound: f64) -> Self {
        Self { bound, since: None }
    }

    fn see(&mut self, time: f64, value: f64) {
        if value > self.bound {
            self.since = None;
        } else if self.since.is_none() {
            self.since = Some(time);
        }
    }
}

/// Performance figures of a run. Errors are true errors, not those measured by the camera. Figures of the tip are
/// `None` in a free motion; those of its attitude also with an operator, whose goal is a point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Simulated time \[s\].
    pub duration: f64,
    /// Final distance of the tip from the goal \[m\].
    pub tip_position_error: Option<f64>,
    /// Final angle of the tip from the goal \[rad\].
    pub tip_attitude_error: Option<f64>,
    /// Time after which the tip stays within 1 cm \[s\].
    pub time_to_1cm: Option<f64>,
    /// Time after which the tip stays within 2 degrees \[s\].
    pub time_to_2deg: Option<f64>,
    /// Displacement of the base body's centre of mass, world axes \[m\].
    pub base_displacement: [f64; 3],
    /// Final attitude of the base: roll, pitch, yaw of Masutani 1995 app. F \[rad\].
    pub base_attitude_rpy: [f64; 3],
    /// Momentum residual, see [`Balance::momentum_residual`].
    pub momentum_residual: MomentumResidual,
    /// Energy residual, see [`Balance::energy_residual`].
    pub energy_residual: f64,
    /// Largest speed of the tip in the world \[m/s\].
    pub max_tip_speed: Option<f64>,
    /// Largest acceleration of the tip in the world \[m/s²\].
    pub max_tip_acceleration: Option<f64>,
    /// Largest gap of a closed loop \[m or rad\]; `None` without one.
    pub loop_gap: Option<f64>,
    /// Largest angular acceleration of the base \[rad/s²\].
    pub max_base_angular_acceleration: f64,
    /// Targets with joints, by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub targets: BTreeMap<String, TargetSummary>,
    /// Wall time of the run \[s\].
    pub wall_time: f64,
}

impl Performance {
    /// Begins with the world's initial state. Figures not selected in `figures` are NaN or `None`.
    pub fn new(world: &World, figures: Figures) -> Self {
        Self {
            figures,
            initial_base: base_com(world),
            time: 0.0,
            last_error: None,
            position_settled: Settled::new(0.01),
            attitude_settled: Settled::new(2f64.to_radians()),
            balance: Balance::new(&Carried::of_robot(world)),
            targets: TargetBalances::new(world),
            max_tip_speed: None,
            max_tip_acceleration: None,
            max_base_angular_acceleration: match figures.accelerations {
                true => 0.0,
                false => f64::NAN,
            },
            loop_gap: None,
        }
    }

    /// Distance \[m\] and angle \[rad\] of the tip from the goal at the last state; `None` if not available.
    pub fn tip_errors(&self) -> [Option<f64>; 2] {
        [
            self.last_error.map(|e| e.0),
            self.last_error.and_then(|e| e.1),
        ]
    }

    /// Adds a state, with the efforts for it.
    pub fn see(&mut self, world: &mut World, moment: &Moment) {
        self.time = world.time();
        if let Some(answer) = &moment.answer {
            let (position, attitude) = (answer.error.position.norm(), answer.error.angle);
            self.last_error = Some((position, Some(attitude)));
            self.position_settled.see(self.time, position);
            self.attitude_settled.see(self.time, attitude);
        }
        if let Some(drive) = &moment.drive {
            // An operator's goal is a point.
            self.last_error = Some((drive.distance, None));
            self.position_settled.see(self.time, drive.distance);
        }

        if self.figures.residuals {
            self.balance.see(&Carried::of_robot(world));
        }
        self.targets.see(world);
        let robot = &world.robot;
        if let (Some(loops), Some(robot)) = (robot.loops(), robot.rigid()) {
            for (_, gap) in loops.gaps(robot.workspace()) {
                let open = larger(gap.translation, gap.rotation);
                self.loop_gap = Some(larger(self.loop_gap.unwrap_or(0.0), open));
            }
        }
        let largest = |so_far, v: Vector3<f64>| larger(so_far, v.norm());
        let tip = match (&moment.answer, &moment.drive) {
            (Some(answer), _) => Some(answer.control_loop.controller().tip()),
            (None, Some(drive)) => Some(drive.steering.tip()),
            (None, None) => None,
        };
        if let Some(tip) = tip {
            let so_far = self.max_tip_speed.unwrap_or(0.0);
            self.max_tip_speed = Some(largest(so_far, world.robot.V_WF_B(tip).linear));
        }
        if !self.figures.accelerations {
            return;
        }
        world.robot.set_accelerations();
        let robot = &world.robot;
        if let Some(tip) = tip {
            let so_far = self.max_tip_acceleration.unwrap_or(0.0);
            self.max_tip_acceleration = Some(largest(so_far, robot.A_WF_B(tip).linear));
        }
        self.max_base_angular_acceleration = largest(
            self.max_base_angular_acceleration,
            robot.A_WF_B(&robot.model().frames()[0]).angular,
        );
    }

    /// The figures of a run with wall time `wall_time` \[s\].
    pub fn summary(&self, world: &World, wall_time: f64) -> Summary {
        let X_WB = world.robot.X_WB();
        let (momentum_residual, energy_residual) = match self.figures.residuals {
            true => (
                self.balance.momentum_residual(),
                self.balance.energy_residual(),
            ),
            false => (MomentumResidual::UNKNOWN, f64::NAN),
        };
        Summary {
            duration: self.time,
            tip_position_error: self.last_error.map(|e| e.0),
            tip_attitude_error: self.last_error.and_then(|e| e.1),
            time_to_1cm: self.position_settled.since,
            time_to_2deg: self.attitude_settled.since,
            base_displacement: (base_com(world) - self.initial_base).into(),
            base_attitude_rpy: roll_pitch_yaw_intrinsic(&X_WB.rotation),
            momentum_residual,
            energy_residual,
            max_tip_speed: self.max_tip_speed,
            max_tip_acceleration: self.max_tip_acceleration,
            loop_gap: self.loop_gap,
            max_base_angular_acceleration: self.max_base_angular_acceleration,
            targets: self.targets.summary(world),
            wall_time,
        }
    }
}

/// Position of the base body's centre of mass in the world.
fn base_com(world: &World) -> Vector3<f64> {
    let X_WB = world.robot.X_WB();
    X_WB.rotation * world.robot.model().bodies()[0].inertia.com + X_WB.translation.vector
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_found_in_the_names_of_results() {
        let needed = |names: &[&str]| {
            let figures = Figures::of_results(names.iter().copied());
            [figures.residuals, figures.accelerations, figures.events]
        };
        assert_eq!(needed(&["tip_position_error", "final.q.j1"]), [false; 3]);
        assert_eq!(needed(&["robots./a.energy_residual"]), [true, false, false]);
        assert_eq!(
            needed(&["momentum_residual.linear", "events[0].time"]),
            [true, false, true]
        );
        for name in ["max_tip_acceleration", "max_base_angular_acceleration"] {
            assert_eq!(needed(&[name]), [false, true, false]);
        }
    }

    #[test]
    fn settling_is_the_time_after_which_it_stays_below() {
        let mut settled = Settled::new(1.0);
        for (time, value) in [
            (0.0, 0.5),
            (1.0, 2.0),
            (2.0, 0.9),
            (3.0, 1.1),
            (4.0, 1.0),
            (5.0, 0.1),
        ] {
            settled.see(time, value);
        }
        assert_eq!(settled.since, Some(4.0));
        settled.see(6.0, 3.0);
        assert_eq!(settled.since, None);
    }
}
