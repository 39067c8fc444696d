//! Renders the images of the cameras from the states of the bodies.

use std::sync::Arc;

use fuyu_render::{Camera, Instance, Motion, Renderer, Scene, Star, Sun};
use nalgebra::{Isometry3, Point3};

use super::{
    body::{Body, BodyState},
    outputs::{ImageMessage, Output, Side, infos, messages, outputs},
    params::{ImageParams, ImageSettings},
};
use crate::{model::Frame, nodes::camera::images::shape::Shape};

/// Seed of the random stars, the same in all runs.
const SKY: u64 = 1;

/// Bodies and cameras during one exposure.
#[derive(Debug, Clone)]
pub struct Shot {
    /// Middle of the exposure \[s\].
    pub time: f64,
    /// Number of the exposure, which makes noise independent.
    pub number: u64,
    /// Meshes of the bodies.
    instances: Vec<Instance>,
    /// Motions of the cameras' optical frames.
    cameras: Vec<Motion>,
    settings: Arc<ImageSettings>,
}

/// The bodies, the robot first.
pub struct ImageScene {
    bodies: Vec<Body>,
    /// Optical frames of the cameras, on the robot.
    frames: Vec<Frame>,
    settings: Arc<ImageSettings>,
    number: u64,
}

impl ImageScene {
    /// A scene with the robot and the targets.
    ///
    /// # Errors
    /// A line that names the parameter of a link that the robot does not have.
    pub fn new(params: &ImageParams, robot: Body, targets: Vec<Body>) -> Result<Self, String> {
        let model = robot.model();
        let frames = params.cameras.iter().map(|spec| {
            let (name, link) = (&spec.name, &spec.link);
            model.frame(link).cloned().ok_or_else(|| {
                format!(
                    "parameter images.{name}.link: robot '{}' has no link '{link}'",
                    model.name()
                )
            })
        });
        let frames = frames.collect::<Result<_, _>>()?;
        let mut bodies = vec![robot];
        bodies.extend(targets);
        Ok(Self {
            bodies,
            frames,
            settings: Arc::new(params.settings.clone()),
            number: 0,
        })
    }

    /// The bodies, the robot first.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// Changes the settings for later shots.
    pub fn set_settings(&mut self, settings: ImageSettings) {
        self.settings = Arc::new(settings);
    }

    /// Restarts the numbering of shots for a new run.
    pub fn restart(&mut self) {
        self.number = 0;
    }

    /// The shot of all cameras with mid-exposure at `time` \[s\], given the states of all bodies.
    pub fn shot(&mut self, time: f64, states: &[BodyState]) -> Shot {
        let exposure = self.settings.sensor.exposure;
        let mut instances = Vec::new();
        for ((id, body), state) in (1..).zip(&mut self.bodies).zip(states) {
            let motions = body.part_motions(state, exposure);
            let parts = body.parts().zip(motions);
            instances
                .extend(parts.map(|(part, motion)| Instance::new(part.mesh.clone(), id, motion)));
        }
        let (robot, state) = (&mut self.bodies[0], &states[0]);
        let frames = self.frames.iter();
        let cameras = frames.map(|frame| robot.frame_motion(frame, state, exposure));
        self.number += 1;
        Shot {
            time,
            number: self.number - 1,
            instances,
            cameras: cameras.collect(),
            settings: self.settings.clone(),
        }
    }
}

/// Renders shots.
pub struct Imager {
    params: ImageParams,
    cameras: Vec<Camera>,
    /// Index of the first output of each camera.
    first: Vec<usize>,
    renderer: Renderer,
    scene: Scene,
    /// Magnitude of the faintest star currently in the scene.
    faintest: f64,
    pool: rayon::ThreadPool,
}

impl Imager {
    /// An imager with the configured cameras.
    ///
    /// # Errors
    /// A line that names the invalid camera, or says that no threads can be started.
    pub fn new(params: &ImageParams) -> Result<Self, String> {
        let cameras = params.cameras.iter().map(|spec| {
            let camera = Camera::new(spec.intrinsics, spec.distortion, params.samples);
            camera.map_err(|e| format!("parameter images.{}: {e}", spec.name))
        });
        let mut first = Vec::new();
        let mut count = 0;
        for spec in &params.cameras {
            first.push(count);
            count += outputs(spec).len();
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(params.threads)
            .thread_name(|i| format!("render {i}"))
            .build()
            .map_err(|e| format!("no thread can be started that renders: {e}"))?;
        Ok(Self {
            cameras: cameras.collect::<Result<_, _>>()?,
            params: params.clone(),
            first,
            renderer: Renderer::default(),
            scene: Scene::new(),
            faintest: f64::NEG_INFINITY,
            pool,
        })
    }

    /// The output topics; indices in other results refer to this order.
    pub fn outputs(params: &ImageParams) -> Vec<Output> {
        params.cameras.iter().flat_map(outputs).collect()
    }

    /// The calibrations at `time` \[s\], with the indices of their outputs.
    pub fn infos(&self, time: f64) -> Vec<(usize, ImageMessage)> {
        let cameras = self.params.cameras.iter().zip(&self.first);
        let all = cameras.flat_map(|(spec, first)| {
            let infos = infos(spec, time).into_iter();
            infos.map(move |(i, message)| (first + i, message))
        });
        all.collect()
    }

    /// Renders the images of all cameras. Returns messages with the indices of their outputs.
    pub fn render(&mut self, shot: &Shot) -> Vec<(usize, ImageMessage)> {
        let settings = &shot.settings;
        let scene = &mut self.scene;
        scene.instances.clone_from(&shot.instances);
        scene.sun = Sun {
            direction: settings.sun,
            intensity: settings.sun_intensity,
        };
        scene.ambient = settings.ambient;
        scene.earth = settings.earth;
        scene.star_gain = settings.star_gain;
        scene.shadow_resolution = self.params.shadow_resolution;
        if self.faintest != settings.faintest_star {
            scene.stars = Star::random_sky(settings.faintest_star, SKY);
            self.faintest = settings.faintest_star;
        }
        let mut all = self.infos(shot.time);
        let (scene, renderer, pool) = (&self.scene, &mut self.renderer, &self.pool);
        let cameras = self.params.cameras.iter().zip(&self.cameras);
        for (k, ((spec, camera), motion)) in cameras.zip(&shot.cameras).enumerate() {
            let mut sides = vec![(Side::Left, *motion)];
            if spec.baseline > 0.0 {
                let right_eye = Isometry3::translation(spec.baseline, 0.0, 0.0);
                sides.push((Side::Right, motion.of_part(&right_eye)));
            }
            for (side, motion) in sides {
                let number = 2 * (shot.number * self.first.len() as u64 + k as u64);
                let number = number + u64::from(side == Side::Right);
                let found = pool.install(|| {
                    let frame = renderer.render(scene, &camera.at(motion));
                    messages(spec, side, shot.time, &frame, &settings.sensor, number)
                });
                let found = found.into_iter();
                all.extend(found.map(|(i, message)| (self.first[k] + i, message)));
            }
        }
        all
    }

    /// A line for each camera that is inside a closed mesh, so that its image shows nothing else.
    pub fn enclosed(&self, shot: &Shot) -> Vec<String> {
        let cameras = self.params.cameras.iter().zip(&self.cameras);
        let lines = cameras
            .zip(&shot.cameras)
            .filter_map(|((spec, camera), motion)| {
                // The point where the view volume begins: a camera may be on the surface of its own housing.
                let p_W = motion.open * Point3::new(0.0, 0.0, camera.near);
                let around = shot.instances.iter().find(|instance| {
                    let p_M = instance.motion.open.inverse() * p_W;
                    instance.mesh.contains(&p_M.coords)
                });
                let id = around?.id;
                let body = match id {
                    1 => "the robot",
                    id => self.params.bodies[usize::from(id) - 2].as_str(),
                };
                Some(format!(
                    "the camera '{}' is inside of a mesh of {body}; move its link {} out of it",
                    spec.name, spec.link
                ))
            });
        lines.collect()
    }
}

/// The shape of a description, if all its meshes can be drawn.
///
/// # Errors
/// A line for each mesh that cannot be drawn.
pub fn checked_shape(xml: &str, source: &str) -> Result<Shape, String> {
    let shape = Shape::of_urdf(xml, source);
    match shape.problems.is_empty() {
        true => Ok(shape),
        false => Err(shape.problems.join("\n")),
    }
}
