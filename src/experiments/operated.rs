//! A simulated operator with the steering of the teleop node, in a single thread without DDS.

use nalgebra::{DVector, Point3, Vector3};

use crate::{
    control::Operator,
    nodes::{
        dynamics::{FreeBody as _, World},
        scenario::Scenario,
        teleop::{SimulatedOperator, Steered, Steering},
        tip_frame,
    },
    spatial::Twist,
};

/// A simulated operator and the steering of the teleop node.
pub struct Operated {
    steering: Steering,
    operator: Operator,
    /// Goal of the tip in the world \[m\].
    goal: Vector3<f64>,
    rates: Vec<(usize, f64)>,
}

/// Command of the operator at one state, and its steering.
pub struct Drive<'a> {
    /// Limits that acted on the command.
    pub steered: Steered,
    /// The steering, with the current joint rates.
    pub steering: &'a Steering,
    /// True distance of the tip from the goal \[m\].
    pub distance: f64,
}

impl Operated {
    /// Operator and steering as configured by `scenario`.
    ///
    /// # Errors
    /// A line that names file, node and parameter.
    pub fn new(scenario: &Scenario, world: &World) -> Result<Self, String> {
        let params = scenario.teleop()?;
        let at = |e: String| format!("{}: teleop: {e}", scenario.path().display());
        let model = world.robot.model();
        let tip = tip_frame(model, &params.tip_link).map_err(|e| at(format!("parameter {e}")))?;
        let SimulatedOperator { goal, config } = params.operator.ok_or_else(|| {
            at("parameter operator.goal is not given; a simulation needs an operator".to_owned())
        })?;
        Ok(Self {
            steering: Steering::new(model.clone(), &tip, params.steering),
            operator: Operator::new(config),
            goal,
            rates: Vec::with_capacity(model.dof()),
        })
    }

    /// Computes the operator's command at the current state, and drives the joints accordingly.
    pub fn answer(&mut self, world: &mut World) -> Drive<'_> {
        let time = world.time();
        let robot = &world.robot;
        let X_BE = robot.X_BF(self.steering.tip());
        let X_WB = robot.X_WB();
        let goal_B = X_WB.inverse() * Point3::from(self.goal);
        let displacement = goal_B.coords - X_BE.translation.vector;
        let velocity = self.operator.command(time, &displacement);
        let q: &DVector<f64> = &robot.state().q;
        let V_B = Twist::new(Vector3::zeros(), velocity);
        let steered = self.steering.steer(time, q, &V_B);
        self.rates.clear();
        (self.rates).extend(self.steering.rates().iter().copied().enumerate());
        world.drive_rates(self.rates.iter().copied());
        Drive {
            steered,
            steering: &self.steering,
            distance: displacement.norm(),
        }
    }
}
