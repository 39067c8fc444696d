//! Steering: limited joint rates for a commanded twist of the tip; the part of the teleop node that needs no ROS graph.

use nalgebra::{DVector, UnitQuaternion};

use super::operator_command::{CommandFrame, OperatorCommand};
use crate::{
    control::{Limited, RateLimits, Resolved, ResolvedRate, ResolvedRateConfig, limit_twist},
    dynamics::Workspace,
    model::{Frame, Model},
    spatial::Twist,
};

/// Settings of the steering.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SteeringConfig {
    /// Resolution of the tip's twist into joint rates.
    pub resolution: ResolvedRateConfig,
    /// Largest speed that may be commanded \[m/s\].
    pub max_linear_speed: f64,
    /// Largest angular speed that may be commanded \[rad/s\].
    pub max_angular_speed: f64,
    /// Largest rate of any joint, in addition to its own limit \[rad/s or m/s\].
    pub max_joint_rate: f64,
    /// Largest change of any joint's rate \[rad/s² or m/s²\].
    pub max_joint_acceleration: f64,
}

/// Limits that acted on a command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steered {
    /// Singularity measures of the posture.
    pub resolved: Resolved,
    /// Joint limits that acted.
    pub limited: Limited,
    /// Whether the command exceeded a speed limit of the tip.
    pub too_fast: bool,
}

/// Longest time step for which the acceleration limit is evaluated \[s\].
const MAX_STEP: f64 = 0.1;

/// Resolved-rate steering of a robot's tip.
pub struct Steering {
    model: Model,
    workspace: Workspace,
    config: SteeringConfig,
    resolver: ResolvedRate,
    limits: RateLimits,
    /// Joint rates of the last command.
    rates: DVector<f64>,
    before: DVector<f64>,
    last: Option<f64>,
}

impl Steering {
    /// A steering with zero rates.
    pub fn new(model: Model, tip: &Frame, config: SteeringConfig) -> Self {
        let rest = DVector::zeros(model.dof());
        Self {
            workspace: Workspace::new(&model),
            resolver: ResolvedRate::new(&model, tip, config.resolution),
            limits: limits(&model, &config),
            rates: rest.clone(),
            before: rest,
            last: None,
            config,
            model,
        }
    }

    /// Changes the settings; rates approach the new ones within the acceleration limit.
    pub fn set_config(&mut self, config: SteeringConfig) {
        self.resolver.config = config.resolution;
        self.limits = limits(&self.model, &config);
        self.config = config;
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The tip.
    pub fn tip(&self) -> &Frame {
        self.resolver.tip()
    }

    /// The settings.
    pub fn config(&self) -> &SteeringConfig {
        &self.config
    }

    /// Joint rates of the last command \[rad/s or m/s\].
    pub fn rates(&self) -> &DVector<f64> {
        &self.rates
    }

    /// Sets zero rates at `time` \[s\].
    pub fn stop(&mut self, time: f64) {
        self.rates.fill(0.0);
        self.last = Some(time);
    }

    /// The commanded twist in base axes, at joint positions `q` and base attitude `R_WB`.
    ///
    /// # Errors
    /// The reason why the base's attitude is unknown, if the command needs it.
    pub fn in_base_axes(
        &mut self,
        command: &OperatorCommand,
        q: &DVector<f64>,
        R_WB: Result<UnitQuaternion<f64>, String>,
    ) -> Result<Twist, String> {
        let V = &command.twist;
        Ok(match command.frame {
            CommandFrame::Base => *V,
            CommandFrame::Tip => {
                self.workspace.set_positions(q);
                let R_BE = self.workspace.X_BF(self.resolver.tip()).rotation;
                Twist::new(R_BE * V.angular, R_BE * V.linear)
            }
            CommandFrame::World => {
                let R_BW = R_WB?.inverse();
                Twist::new(R_BW * V.angular, R_BW * V.linear)
            }
        })
    }

    /// Computes joint rates for the twist `V_B` (base axes) at joint positions `q` and `time` \[s\]; they are in
    /// [`Self::rates`].
    pub fn steer(&mut self, time: f64, q: &DVector<f64>, V_B: &Twist) -> Steered {
        let config = &self.config;
        let (V, too_fast) = limit_twist(V_B, config.max_linear_speed, config.max_angular_speed);
        let since = self.last.map_or(0.0, |last| time - last);
        if since < 0.0 {
            // The simulation has restarted with joints at rest.
            self.rates.fill(0.0);
        }
        self.last = Some(time);
        self.before.copy_from(&self.rates);
        let (model, rates) = (&self.model, &mut self.rates);
        let resolved = (self.resolver).rates(model, &mut self.workspace, q, &V, rates);
        let dt = since.clamp(0.0, MAX_STEP);
        let limited = self.limits.apply(model, q, &self.before, dt, rates);
        Steered {
            resolved,
            limited,
            too_fast,
        }
    }
}

fn limits(model: &Model, config: &SteeringConfig) -> RateLimits {
    RateLimits::new(model, config.max_joint_rate, config.max_joint_acceleration)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::control::Resolution;

    fn steering() -> Steering {
        let xml = include_str!("../../../urdf/servicer.urdf");
        let model = Model::from_urdf(xml, "servicer").unwrap();
        let tip = model.frame("tool0").unwrap().clone();
        let config = SteeringConfig {
            resolution: ResolvedRateConfig::default(),
            max_linear_speed: 0.5,
            max_angular_speed: 0.2,
            max_joint_rate: 0.5,
            max_joint_acceleration: 1.0,
        };
        Steering::new(model, &tip, config)
    }

    fn posture() -> DVector<f64> {
        DVector::from_row_slice(&[1.13, 1.73, -1.66, -0.38, 0.5, -0.73])
    }

    #[test]
    fn commands_are_rotated_from_their_frame_to_base_axes() {
        let mut steering = steering();
        let q = posture();
        let ahead = Twist::new(Vector3::zeros(), Vector3::x());
        let R_WB = UnitQuaternion::from_euler_angles(0.2, -0.4, 1.0);
        let mut workspace = Workspace::new(steering.model());
        workspace.set_positions(&q);
        let R_BE = workspace.X_BF(steering.tip()).rotation;
        for (frame, expected) in [
            (CommandFrame::Base, Vector3::x()),
            (CommandFrame::Tip, R_BE * Vector3::x()),
            (CommandFrame::World, R_WB.inverse() * Vector3::x()),
        ] {
            let command = OperatorCommand {
                frame,
                twist: ahead,
            };
            let V = steering.in_base_axes(&command, &q, Ok(R_WB)).unwrap();
            assert!((V.linear - expected).norm() < 1e-14);
            let unknown = steering.in_base_axes(&command, &q, Err("lost".to_owned()));
            assert_eq!(unknown.is_err(), frame == CommandFrame::World);
        }
    }

    // A step of the rates would be a step of the servo's torque.
    #[test]
    fn a_change_of_method_does_not_make_rates_jump() {
        let mut steering = steering();
        let q = posture();
        let V = Twist::new(Vector3::zeros(), Vector3::new(0.1, 0.2, 0.0));
        let mut time = 0.0;
        for (_, method) in Resolution::NAMES.iter().cycle().take(8) {
            let mut config = *steering.config();
            config.resolution.method = *method;
            steering.set_config(config);
            for _ in 0..200 {
                let before = steering.rates().clone();
                steering.steer(time, &q, &V);
                let jump = (steering.rates() - before).amax();
                assert!(jump <= 0.01 + 1e-12, "{jump}");
                time += 0.01;
            }
            let settled = steering.rates().clone();
            steering.steer(time, &q, &V);
            assert!((steering.rates() - settled).amax() < 1e-12);
            assert!(steering.rates().amax() > 0.01);
        }
        // A jump back in time resets the rates.
        steering.steer(0.0, &q, &V);
        assert_eq!(steering.rates().amax(), 0.0);
        steering.steer(0.01, &q, &V);
        assert!(steering.rates().amax() > 0.0);
        steering.stop(0.02);
        assert_eq!(steering.rates().amax(), 0.0);
    }
}
