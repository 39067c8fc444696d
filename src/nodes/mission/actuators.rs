//! Wheels and thrusters of the robot, which absorb the momentum of robot and target.

use crate::{
    control::{
        attitude::WheelAllocator,
        capture::{CaptureMission, ThrusterPulses},
    },
    model::Model,
    nodes::dynamics::FlexibleParams,
    ros::Declare,
};

/// Time constant for equalising the momenta of more than three wheels \[s\]; not used, since a mission does not
/// equalise.
const EQUALIZATION: f64 = 100.0;

/// Wheels and thrusters that a mission uses.
#[derive(Debug, Clone)]
pub struct Actuators {
    /// Parameters of the robot's wheels and thrusters, and of its other flexible parts.
    parts: FlexibleParams,
    uses_wheels: bool,
    uses_thrusters: bool,
    /// Pulse period of the thrusters \[s\].
    period: f64,
}

impl Actuators {
    /// Declares the parameters and reads them.
    ///
    /// # Errors
    /// A line that names a parameter, its value, and the allowed values.
    pub fn declare(declare: &mut Declare) -> Result<Self, String> {
        let mut flag = |name: &str, text: &str| {
            let parameter = declare.param(name, true, text);
            parameter.read_only().value()
        };
        let uses_wheels = flag(
            "use_wheels",
            "Let the robot's wheels take their share of the momentum, by wheel_commands",
        );
        let uses_thrusters = flag(
            "use_thrusters",
            "Let the robot's thrusters give the couple, by thruster_commands; an ideal couple on wrench otherwise",
        );
        let period = declare.param(
            "thruster_period",
            0.1,
            "Period in which thrusters give the couple on average [s]",
        );
        let period = period.range(1e-3, 10.0).read_only().value();
        Ok(Self {
            parts: FlexibleParams::declare_with_packages(declare)?,
            uses_wheels,
            uses_thrusters,
            period,
        })
    }

    /// Names of the wheels in use.
    pub fn wheels(&self) -> impl Iterator<Item = &str> {
        let used = self.parts.wheels.iter().filter(|_| self.uses_wheels);
        used.map(|params| params.wheel.name.as_str())
    }

    /// Names of the thrusters in use.
    pub fn thrusters(&self) -> impl Iterator<Item = &str> {
        let used = self.parts.thrusters.iter().filter(|_| self.uses_thrusters);
        used.map(|params| params.thruster.name.as_str())
    }

    /// Whether wheels are in use.
    pub fn has_wheels(&self) -> bool {
        self.wheels().next().is_some()
    }

    /// Whether thrusters are in use.
    pub fn has_thrusters(&self) -> bool {
        self.thrusters().next().is_some()
    }

    /// Adds the wheels and thrusters in use to a mission.
    ///
    /// # Errors
    /// A line that names the parameter and the allowed values.
    pub fn fit(&self, mission: CaptureMission, robot: &Model) -> Result<CaptureMission, String> {
        let mut mission = mission;
        if mission.config().detumble.couple == 0.0 && !self.has_wheels() {
            return Err(
                "couple is 0 and no wheels are in use; a positive couple [N m] or wheels must stop the rotation".to_owned(),
            );
        }
        if !self.has_wheels() && !self.has_thrusters() {
            return Ok(mission);
        }
        let system = self.parts.system(robot)?;
        if self.has_wheels() {
            let wheels = WheelAllocator::new(&system, EQUALIZATION).map_err(|e| {
                format!("use_wheels is true, but {e}; with false they are not used")
            })?;
            mission = mission.with_wheels(wheels);
        }
        if self.has_thrusters() {
            let pulses = ThrusterPulses::new(&system, self.period).map_err(|e| {
                format!(
                    "use_thrusters is true, but {e}; with false an ideal couple acts on the base"
                )
            })?;
            if let Some(pulses) = pulses {
                mission = mission.with_thrusters(pulses);
            }
        }
        Ok(mission)
    }
}
