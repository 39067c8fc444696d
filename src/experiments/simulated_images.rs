//! Images of a simulated run, rendered as by the camera node but without its thread.

use super::ClosedLoop;
use crate::{
    model::Model,
    msg::{nav_msgs::Odometry, sensor_msgs::JointState},
    nodes::{
        camera::images::{
            Body, BodyState, ImageMessage, ImageParams, ImageScene, Imager, Output, checked_shape,
        },
        dynamics::{World, joint_states, odometry, target_joint_states},
    },
    ros::Time,
    vision::FrameStream,
};

/// Cameras whose images are rendered, and images that wait for their latency.
pub struct SimulatedImages {
    image_scene: ImageScene,
    imager: Imager,
    /// Indices of the drawn targets.
    targets: Vec<usize>,
    outputs: Vec<Output>,
    stream: FrameStream<Vec<(usize, ImageMessage)>>,
}

impl SimulatedImages {
    /// The cameras of `params` on the robot of a run, whose description is `xml`.
    ///
    /// # Errors
    /// A line that names the invalid parameter or mesh.
    pub fn new(params: &ImageParams, run: &ClosedLoop, xml: &str) -> Result<Self, String> {
        Self::of_world(params, &run.world, xml)
    }

    /// As [`Self::new`], for a world.
    ///
    /// # Errors
    /// A line that names the invalid parameter or mesh.
    pub fn of_world(params: &ImageParams, world: &World, xml: &str) -> Result<Self, String> {
        // Compiled as in the camera node.
        let body = |xml: &str, source: &str| {
            let repaired = Model::repaired_from_urdf(xml, source).map_err(|e| e.to_string())?;
            Ok::<_, String>(Body::new(repaired.model, &checked_shape(xml, source)?))
        };
        let names = params.bodies.iter();
        let targets = names.map(|name| world.target_index(name));
        let targets: Vec<usize> = (targets.collect::<Result<_, _>>())
            .map_err(|e| format!("parameter images.bodies: {e}"))?;
        let bodies = targets.iter().map(|i| {
            let target = &world.targets[*i];
            body(&target.description, &target.name)
        });
        let bodies = bodies.collect::<Result<_, _>>()?;
        Ok(Self {
            image_scene: ImageScene::new(params, body(xml, "robot")?, bodies)?,
            imager: Imager::new(params)?,
            targets,
            outputs: Imager::outputs(params),
            stream: FrameStream::new(params.settings.stream),
        })
    }

    /// The output topics; indices in other results refer to this order.
    pub fn outputs(&self) -> &[Output] {
        &self.outputs
    }

    /// The calibrations, with the indices of their outputs.
    pub fn infos(&self) -> Vec<(usize, ImageMessage)> {
        self.imager.infos(0.0)
    }

    /// Exposes the cameras to the current state. Returns the delivered images with the indices of their outputs.
    ///
    /// # Errors
    /// If the state is not finite.
    pub fn show(&mut self, world: &World) -> Result<Vec<(usize, ImageMessage)>, String> {
        let stamp = Time::from_secs_f64(world.time());
        let time = stamp.as_secs_f64();
        if let Some(exposure) = self.stream.expose(time) {
            if exposure.first_of_run {
                self.image_scene.restart();
            }
            let messages = match exposure.lost {
                true => Vec::new(),
                false => {
                    let states = self.states(stamp, world)?;
                    let shot = self.image_scene.shot(time, &states);
                    self.imager.render(&shot)
                }
            };
            self.stream.push(time, messages, exposure);
        }
        let mut delivered = Vec::new();
        while let Some(messages) = self.stream.deliver(time) {
            delivered.extend(messages);
        }
        Ok(delivered)
    }

    fn states(&self, stamp: Time, world: &World) -> Result<Vec<BodyState>, String> {
        let robot: (JointState, Odometry) = (
            joint_states(stamp, "", world),
            odometry(stamp, "", &world.robot),
        );
        let mut states = vec![self.image_scene.bodies()[0].state(Some(&robot.0), &robot.1)?];
        for (body, i) in self.image_scene.bodies()[1..].iter().zip(&self.targets) {
            let target = &world.targets[*i];
            let joints = target_joint_states(stamp, target);
            states.push(body.state(Some(&joints), &odometry(stamp, "", &target.body))?);
        }
        Ok(states)
    }
}
