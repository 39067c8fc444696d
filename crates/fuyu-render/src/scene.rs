//! Scenes: bodies, Sun, Earth and stars.

use std::sync::Arc;

use nalgebra::Vector3;

use crate::{Earth, Mesh, Motion, Star};

/// A mesh at a place in the world.
#[derive(Debug, Clone)]
pub struct Instance {
    /// Its triangles.
    pub mesh: Arc<Mesh>,
    /// Its value in a segmented image; 0 is the background.
    pub id: u16,
    /// The mesh's frame in the world.
    pub motion: Motion,
}

impl Instance {
    /// A mesh at a place in the world.
    pub fn new(mesh: Arc<Mesh>, id: u16, motion: Motion) -> Self {
        Self { mesh, id, motion }
    }
}

/// The Sun, infinitely far away and a point, so that shadows are hard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    /// Direction toward it in the world; need not be a unit vector.
    pub direction: Vector3<f64>,
    /// Its irradiance; 1 is full sunlight, 0 an eclipse.
    pub intensity: f64,
}

/// Bodies and lights.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The bodies. One whose motion is not finite is not drawn.
    pub instances: Vec<Instance>,
    /// The Sun.
    pub sun: Sun,
    /// Light from all directions, as a fraction of full sunlight.
    pub ambient: f64,
    /// The Earth, if there is one. It dims the Sun when it is in its way, and lights bodies.
    pub earth: Option<Earth>,
    /// Stars.
    pub stars: Vec<Star>,
    /// Brightness of stars; 1 is physical.
    pub star_gain: f64,
    /// Columns and rows of all shadow maps together: each of n maps has this over sqrt(n), within limits (64 to 8192).
    pub shadow_resolution: usize,
}

impl Default for Scene {
    fn default() -> Self {
        Self::new()
    }
}

impl Scene {
    /// An empty scene in full sunlight along -z.
    pub fn new() -> Self {
        Self {
            instances: Vec::new(),
            sun: Sun {
                direction: Vector3::z(),
                intensity: 1.0,
            },
            ambient: 0.0,
            earth: None,
            stars: Vec::new(),
            star_gain: 1.0,
            shadow_resolution: 2048,
        }
    }

    /// The unit vector toward the Sun; z if its direction has no length.
    pub(crate) fn toward_sun(&self) -> Vector3<f64> {
        let unit = self.sun.direction.try_normalize(0.0);
        unit.filter(|s| s.iter().all(|x| x.is_finite()))
            .unwrap_or_else(Vector3::z)
    }

    /// The first instance whose closed mesh contains the point `p` of the world \[m\] when the shutter opens.
    pub fn body_around(&self, p: &Vector3<f64>) -> Option<usize> {
        self.instances.iter().position(|instance| {
            let p_M = instance.motion.open.inverse() * nalgebra::Point3::from(*p);
            instance.mesh.contains(&p_M.coords)
        })
    }
}
