//! Processor time of a frame: 640 x 480 pixels, 8,212 triangles, shadow map of 2048 x 2048, stars.
//!
//! `cargo run --release -p fuyu-render --example speed`

use fuyu_render::{
    Camera, Distortion, Earth, Instance, Intrinsics, Material, Mesh, MeshData, Motion, Renderer,
    Scene, Sensor, Star, primitives,
};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// The case with the Earth behind the satellite.
const EARTH: &str = "640 x 480, the Earth in view";

/// A satellite of about 8,212 triangles: a body with many small parts, two panels, an antenna.
fn satellite() -> Mesh {
    let mut whole = MeshData::default();
    let mut add = |mesh: Mesh, x: f64, y: f64, z: f64| {
        let mut data = mesh.data().clone();
        data.transform(&Vector3::repeat(1.0), &Isometry3::translation(x, y, z));
        whole.append(data);
    };
    let grey = Material::grey;
    add(
        primitives::cuboid(Vector3::new(1.0, 1.0, 1.4), grey(0.6)),
        0.0,
        0.0,
        0.0,
    );
    for side in [-1.0, 1.0] {
        add(
            primitives::cuboid(Vector3::new(3.0, 0.04, 1.0), grey(0.2)),
            side * 2.2,
            0.0,
            0.0,
        );
    }
    add(primitives::sphere(0.4, grey(0.8)), 0.0, 0.0, 1.0);
    add(primitives::sphere(0.3, grey(0.8)), 0.5, 0.5, 0.7);
    for k in 0..20 {
        let angle = f64::from(k) * 0.7;
        add(
            primitives::cylinder(0.05, 0.3, grey(0.4)),
            0.5 * angle.cos(),
            0.5 * angle.sin(),
            -0.6 + 0.06 * f64::from(k),
        );
    }
    Mesh::new(whole).expect("primitives are valid")
}

/// Processor time of this thread \[ms\] (Linux).
fn processor_time() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds: Option<f64> = text.split(' ').next().and_then(|word| word.parse().ok());
    nanoseconds.unwrap_or(f64::NAN) * 1e-6
}

fn main() {
    let mesh = std::sync::Arc::new(satellite());
    let triangles = mesh.data().triangles.len();
    let mut scene = Scene::new();
    scene.sun.direction = Vector3::new(0.5, -0.6, -0.8);
    scene.ambient = 0.02;
    scene.stars = Star::random_sky(6.5, 1);
    let pose = |k: f64| {
        let attitude = UnitQuaternion::from_euler_angles(0.3 * k, 0.5, 0.2 * k);
        Isometry3::from_parts(Translation3::new(0.0, 0.0, 5.0), attitude)
    };
    scene
        .instances
        .push(Instance::new(mesh, 1, Motion::at_rest(pose(0.0))));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.expect("a thread can be started");
    for (name, size, focal_length, lens) in [
        ("640 x 480", (640, 480), 700.0, Distortion::None),
        (EARTH, (640, 480), 700.0, Distortion::None),
        (
            "640 x 480, distorted",
            (640, 480),
            700.0,
            Distortion::PlumbBob([-0.2, 0.05, 0.0, 0.0, 0.0]),
        ),
        ("1024 x 1024", (1024, 1024), 1100.0, Distortion::None),
    ] {
        let intrinsics = Intrinsics::centred(size.0, size.1, focal_length);
        let camera = Camera::new(intrinsics, lens, 1).expect("a valid camera");
        scene.earth = (name == EARTH).then(|| Earth::at(Vector3::new(0.0, 1e6, 6.8e6)));
        let mut renderer = Renderer::default();
        let sensor = Sensor::default();
        let (mut drawn, mut exposed) = (Vec::new(), Vec::new());
        pool.install(|| {
            // The first frame takes the memory.
            renderer.render(&scene, &camera);
            for k in 0..60 {
                scene.instances[0].motion = Motion::at_rest(pose(f64::from(k) * 0.1));
                let start = processor_time();
                let frame = renderer.render(&scene, &camera);
                let middle = processor_time();
                std::hint::black_box(sensor.mono8(&frame, k as u64));
                drawn.push(middle - start);
                exposed.push(processor_time() - middle);
            }
        });
        // Clocks of some systems advance in steps of 4 ms.
        let mean = |times: &[f64]| times.iter().sum::<f64>() / times.len() as f64;
        let (drawn, exposed) = (mean(&drawn), mean(&exposed));
        println!(
            "{name}: {triangles} triangles, one thread: render {drawn:.1} ms, sensor with noise {exposed:.1} ms, sum {:.1} ms",
            drawn + exposed
        );
    }
}
