//! Camera images of spacecraft, computed on the processor: no GPU, display or system package, no files.
//!
//! A [`Scene`] holds bodies ([`Instance`]) made of triangles ([`Mesh`]), the Sun, the Earth and stars. [`render`] projects
//! it through a [`Camera`], lens distortion and motion blur included, to a [`Frame`]: radiance, depth and the id of the
//! body in every pixel. A [`Sensor`] turns radiance into grey or colour values with shot and read noise.
//!
//! ```
//! use fuyu_render::{Camera, Distortion, Instance, Intrinsics, Material, Motion, Scene, Sensor, primitives, render};
//! use nalgebra::{Isometry3, Vector3};
//!
//! let cube = primitives::cuboid(Vector3::new(1.0, 1.0, 1.0), Material::grey(0.6));
//! let mut scene = Scene::new();
//! scene.sun.direction = Vector3::new(0.0, -1.0, -1.0);
//! // Five metres in front of a camera at the origin, which looks along +z.
//! scene.instances.push(Instance::new(cube.into(), 7, Motion::at_rest(Isometry3::translation(0.0, 0.0, 5.0))));
//! let camera = Camera::new(Intrinsics::centred(640, 480, 600.0), Distortion::None, 1).unwrap();
//! let frame = render(&scene, &camera);
//! let middle = 240 * 640 + 320;
//! assert_eq!(frame.ids[middle], 7);
//! assert!((frame.depth[middle] - 4.5).abs() < 1e-4);
//! let grey = Sensor::default().mono8(&frame, 0);
//! assert!(grey[middle] > 20 && grey[0] < 5);
//! ```
//!
//! Axes: cameras have z forward, x right, y down (REP-103, optical frame). Pixel centres are at integers, as in
//! `sensor_msgs/CameraInfo`. Radiance is relative to that of a white diffuse surface in full sunlight at normal
//! incidence; reflectances and radiances are linear, not gamma-coded.
//!
//! Every result is the same to the last bit from run to run and for any number of threads.

mod camera;
mod earth;
pub mod encode;
mod frame;
mod lens;
pub mod load;
mod mesh;
mod motion;
pub mod primitives;
mod projection;
mod raster;
mod render;
mod scene;
mod sensor;
mod shade;
mod shadow;
mod stars;
pub mod urdf;

pub use camera::{Camera, CameraError, Intrinsics};
pub use earth::{EARTH_RADIUS, Earth};
pub use frame::Frame;
pub use lens::{Distortion, LensError};
pub use mesh::{LARGEST_MESH, Material, Mesh, MeshData, MeshError, Texture, from_srgb, to_srgb};
pub use motion::Motion;
pub use render::{Renderer, render};
pub use scene::{Instance, Scene, Sun};
pub use sensor::{Sensor, Transfer};
pub use stars::Star;
