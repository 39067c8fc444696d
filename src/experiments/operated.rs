//! A simulated operator at the teleop node's place, without DDS.

use nalgebra::{DVector, Point3, Vector3};

use crate::{
    control::Operator,
    nodes::{
        dynamics::World,
        scenario::Scenario,
        teleop::{SimulatedOperator, Steered, Steering},
        tip_frame,
    },
    spatial::Twist,
};

/// Operator and steering: what a teleop node and whoever sits before it do.
pub struct Operated {
    steering: Steering,
    operator: Operator,
    /// Where the tip is to go, in the world \[m\].
    goal: Vector3<f64>,
    rates: Vec<(usize, f64)>,
}

/// What operator and steering did with a state.
pub struct Drive<'a> {
    /// What became of the command.
    pub steered: Steered,
    /// The steering, with the rates of this moment.
    pub steering: &'a Steering,
    /// True distance of the tip from the goal \[m\].
    pub distance: f64,
}

impl Operated {
    /// What `scenario` says of teleop node and operator.
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

    /// Lets the operator look at the present state and steer.
    pub fn answer(&mut self, world: &mut World) -> Drive<'_> {
        let time = world.time();
        let robot = &world.robot;
        let X_BE = robot.workspace().X_BF(self.steering.tip());
        let X_WB = robot.state().X_WB(robot.workspace());
        let goal_B = X_WB.inverse() * Point3::from(self.goal);
        let way = goal_B.coords - X_BE.translation.vector;
        let velocity = self.operator.command(time, &way);
        let q: &DVector<f64> = &robot.state().q;
        let V_B = Twist::new(Vector3::zeros(), velocity);
        let steered = self.steering.steer(time, q, &V_B);
        self.rates.clear();
        (self.rates).extend(self.steering.rates().iter().copied().enumerate());
        world.drive_rates(self.rates.iter().copied());
        Drive {
            steered,
            steering: &self.steering,
            distance: way.norm(),
        }
    }
}
