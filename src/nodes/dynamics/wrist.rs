//! Force and torque sensor in a joint: it measures the wrench that the links beyond the joint exert on the rest of the
//! robot.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::{free_body::FreeBody, messages::header, robot::Robot, world::World};
use crate::{
    dynamics::Input,
    model::Frame,
    msg::geometry_msgs,
    nodes::{geometry::vector_to_msg, placement::declare_vector},
    ros::{Declare, Time},
    spatial::Wrench,
};

/// Location and measurement errors of the sensor.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WristParams {
    /// The joint that contains the sensor; empty without a sensor.
    pub joint: String,
    /// Link whose frame gives the sensor's axes and its centre; empty for the link moved by the joint.
    pub frame: String,
    /// Standard deviation of each component of force \[N\] and torque \[N m\].
    pub noise: (f64, f64),
    /// Bias of force \[N\] and torque \[N m\].
    pub bias: (Vector3<f64>, Vector3<f64>),
    /// Seed of the noise.
    pub seed: u64,
}

impl WristParams {
    /// Declares the parameters and reads them.
    pub fn declare(declare: &mut Declare) -> Self {
        let mut text = |name: &str, description: &str| -> String {
            let parameter = declare.param(name, "", description);
            parameter.read_only().value()
        };
        let joint = text(
            "wrist.joint",
            "Joint with a force and torque sensor: it measures what the links beyond exert on the rest; empty is no sensor",
        );
        let frame = text(
            "wrist.frame",
            "Link with the sensor's axes and its centre at the origin; empty is the link that the joint moves",
        );
        let mut noise = |name: &str, text: &str| {
            let parameter = declare.param(name, 0.0, text).range(0.0, 1e6);
            parameter.read_only().value()
        };
        let force = noise(
            "wrist.force_noise",
            "Standard deviation of each component of the measured force [N]",
        );
        let torque = noise(
            "wrist.torque_noise",
            "Standard deviation of each component of the measured torque [N m]",
        );
        Self {
            joint,
            frame,
            noise: (force, torque),
            bias: (
                declare_vector(
                    declare,
                    "wrist.force_bias",
                    "Bias of the measured force [N]",
                ),
                declare_vector(
                    declare,
                    "wrist.torque_bias",
                    "Bias of the measured torque [N m]",
                ),
            ),
            seed: (declare.param("wrist.seed", 1, "Seed of the measurement noise"))
                .read_only()
                .value()
                .unsigned_abs(),
        }
    }
}

/// The sensor.
pub(super) struct Wrist {
    params: WristParams,
    /// First body beyond the joint; the sensor carries its subtree.
    body: usize,
    frame: Frame,
    /// Held input and contact wrenches of a rigid robot.
    input: Input,
}

impl Wrist {
    /// The sensor configured by the parameters; `None` without one.
    ///
    /// # Errors
    /// A line that names the parameter and lists the known joints or links.
    pub fn new(params: &WristParams, robot: &Robot) -> Result<Option<Self>, String> {
        if params.joint.is_empty() {
            return Ok(None);
        }
        let model = robot.model();
        let joint = model
            .tree_joints()
            .position(|joint| joint.name == params.joint);
        let body = joint.map(|k| k + 1).ok_or_else(|| {
            let names: Vec<_> = model.tree_joints().map(|j| j.name.as_str()).collect();
            format!(
                "parameter wrist.joint is '{}', which is no joint of the robot that moves; it has {}",
                params.joint,
                names.join(", ")
            )
        })?;
        let name = match params.frame.as_str() {
            "" => model.bodies()[body].name.as_str(),
            name => name,
        };
        let frame = model.frame(name).ok_or_else(|| {
            let names: Vec<_> = model.frames().iter().map(|f| f.name.as_str()).collect();
            format!(
                "parameter wrist.frame is '{name}', which is no link of the robot; it has {}",
                names.join(", ")
            )
        })?;
        Ok(Some(Self {
            body,
            frame: frame.clone(),
            input: Input::zero(model),
            params: params.clone(),
        }))
    }

    /// Name of the link in whose frame the wrench is given.
    pub fn frame(&self) -> &str {
        &self.frame.name
    }

    /// Wrench that the links beyond the joint exert on the rest, about the sensor's centre and in its axes. Requires
    /// [`Robot::set_accelerations`].
    fn wrench(&mut self, robot: &mut Robot) -> Wrench {
        let on_rest_B = match robot.flexible_mut() {
            Some(flexible) => flexible.transmitted_wrench(self.body),
            None => self.of_rigid(robot),
        };
        let X_BS = robot.X_BF(&self.frame);
        let torque = on_rest_B.torque - X_BS.translation.vector.cross(&on_rest_B.force);
        Wrench::new(
            X_BS.rotation.inverse_transform_vector(&torque),
            X_BS.rotation.inverse_transform_vector(&on_rest_B.force),
        )
    }

    /// As [`Self::wrench`], about the base's origin in base axes, for a rigid robot including contacts.
    fn of_rigid(&mut self, robot: &Robot) -> Wrench {
        let Some(floating) = robot.rigid() else {
            return Wrench::ZERO;
        };
        self.input.copy_from(floating.input());
        if let (Some(touching), Some(whole)) = (robot.current_contact_system(), robot.rigid_whole())
            && touching.is_at(whole)
        {
            let X_WB = FreeBody::X_WB(floating);
            touching.add_wrenches_on_links(floating, &X_WB, &mut self.input.wrenches);
        }
        floating.transmitted_wrench(self.body, &self.input.wrenches)
    }

    /// The wrench with bias and noise. They depend only on the seed and `tick`: publishing a state twice gives the same
    /// measurement.
    fn measure(&mut self, robot: &mut Robot, tick: u64) -> Wrench {
        let truth = self.wrench(robot);
        let params = &self.params;
        // Random numbers independent of those of the inertial measurement unit.
        let mut random = StdRng::seed_from_u64(params.seed.rotate_left(16) ^ tick ^ 0x5749_5354);
        let mut noise = |deviation: f64| {
            let mut normal = || random.sample::<f64, _>(StandardNormal);
            Vector3::new(normal(), normal(), normal()) * deviation
        };
        let force = truth.force + params.bias.0 + noise(params.noise.0);
        let torque = truth.torque + params.bias.1 + noise(params.noise.1);
        Wrench::new(torque, force)
    }
}

impl World {
    /// Current measurement of the force and torque sensor, in the axes of its link; `None` without a sensor.
    pub fn wrist_wrench(&mut self) -> Option<Wrench> {
        let mut wrist = self.wrist.take()?;
        let tick = self.ticks();
        let measured = self.under_excitations(|robot| {
            robot.set_accelerations();
            wrist.measure(robot, tick)
        });
        self.wrist = Some(wrist);
        Some(measured)
    }

    /// Name of the link of the force and torque sensor; `None` without one.
    pub fn wrist_frame(&self) -> Option<&str> {
        self.wrist.as_ref().map(Wrist::frame)
    }
}

/// The sensor's measurement as a message; `None` without a sensor.
pub fn wrist_message(stamp: Time, world: &mut World) -> Option<geometry_msgs::WrenchStamped> {
    let mut message = blank_wrist_message(world)?;
    update_wrist_message(&mut message, stamp, world);
    Some(message)
}

/// Template of a sensor message, for [`update_wrist_message`]; `None` without a sensor.
pub(super) fn blank_wrist_message(world: &World) -> Option<geometry_msgs::WrenchStamped> {
    Some(geometry_msgs::WrenchStamped {
        header: header(Time::ZERO, world.wrist_frame()?),
        ..geometry_msgs::WrenchStamped::default()
    })
}

/// Updates a message of [`blank_wrist_message`].
pub(super) fn update_wrist_message(
    message: &mut geometry_msgs::WrenchStamped,
    stamp: Time,
    world: &mut World,
) {
    if let Some(wrench) = world.wrist_wrench() {
        message.header.stamp = stamp.into();
        message.wrench.force = vector_to_msg(&wrench.force);
        message.wrench.torque = vector_to_msg(&wrench.torque);
    }
}
