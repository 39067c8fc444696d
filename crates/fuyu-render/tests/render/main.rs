//! Images against what geometry and optics say, computed independently.

mod background;
mod distortion;
mod exposure;
mod geometry;
mod identity;
mod light;
mod meshes;

use fuyu_render::{Camera, Distortion, Instance, Intrinsics, Mesh, Motion, Scene};
use nalgebra::Isometry3;

/// A camera at the origin.
fn camera(width: u32, height: u32, focal_length: f64, lens: Distortion) -> Camera {
    Camera::new(Intrinsics::centred(width, height, focal_length), lens, 1).unwrap()
}

fn put(scene: &mut Scene, mesh: Mesh, id: u16, pose: Isometry3<f64>) {
    (scene.instances).push(Instance::new(mesh.into(), id, Motion::at_rest(pose)));
}
