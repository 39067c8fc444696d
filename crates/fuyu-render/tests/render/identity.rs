//! The same bits from run to run and for any number of threads.

use fuyu_render::{
    Camera, Distortion, Earth, Frame, Instance, Intrinsics, Material, Motion, Renderer, Scene,
    Sensor, Star, primitives, render,
};
use nalgebra::{Isometry3, Vector3};

fn scene() -> Scene {
    let mut scene = Scene::new();
    scene.sun.direction = Vector3::new(0.4, -0.7, -0.6);
    scene.stars = Star::random_sky(5.0, 9);
    scene.star_gain = 100.0;
    scene.earth = Some(Earth::at(Vector3::new(3e6, 2e6, 9e6)));
    for k in 0..12 {
        let mesh = match k % 3 {
            0 => primitives::sphere(0.5, Material::grey(0.6)),
            1 => primitives::cuboid(Vector3::new(0.6, 0.7, 0.8), Material::grey(0.4)),
            _ => primitives::cylinder(0.3, 1.5, Material::grey(0.7)),
        };
        let x = f64::from(k % 4) - 1.5;
        let y = f64::from(k / 4) - 1.0;
        let at = |t: f64| Isometry3::new(Vector3::new(x + t, y, 4.0), Vector3::new(x, t, y));
        let motion = Motion {
            open: at(0.0),
            close: at(0.1),
        };
        (scene.instances).push(Instance::new(mesh.into(), k as u16 + 1, motion));
    }
    scene
}

fn images() -> (Vec<u8>, Vec<u8>, Frame) {
    let lens = Distortion::PlumbBob([-0.2, 0.04, 1e-3, 0.0, 0.0]);
    let camera = Camera::new(Intrinsics::centred(331, 247, 260.0), lens, 3).unwrap();
    let frame = render(&scene(), &camera);
    let sensor = Sensor::default();
    (sensor.mono8(&frame, 1), sensor.rgb8(&frame, 2), frame)
}

#[test]
fn images_are_the_same_for_any_number_of_threads() {
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(images)
    };
    let one = with(1);
    assert!(one.2.ids.contains(&12));
    for threads in [1, 2, 3, 7] {
        let other = with(threads);
        assert!(
            one.0 == other.0 && one.1 == other.1 && one.2 == other.2,
            "{threads}"
        );
    }
}

#[test]
fn a_renderer_that_was_used_before_gives_the_same_image() {
    let camera = Camera::new(Intrinsics::centred(160, 120, 130.0), Distortion::None, 1).unwrap();
    let scene = scene();
    let mut renderer = Renderer::default();
    let mut other = scene.clone();
    other.instances.truncate(3);
    renderer.render(&other, &camera);
    assert_eq!(renderer.render(&scene, &camera), render(&scene, &camera));
}

#[test]
fn poses_that_are_not_finite_do_not_reach_the_image() {
    let camera = Camera::new(Intrinsics::centred(80, 60, 60.0), Distortion::None, 1).unwrap();
    let mut scene = scene();
    scene.instances[4].motion.open.translation.x = f64::NAN;
    let frame = render(&scene, &camera);
    assert!(frame.radiance.iter().flatten().all(|x| x.is_finite()));
    assert!(!frame.ids.contains(&5) && frame.ids.contains(&6));
    let lost = Motion::at_rest(Isometry3::translation(0.0, f64::INFINITY, 0.0));
    assert!(
        render(&scene, &camera.at(lost))
            .ids
            .iter()
            .all(|id| *id == 0)
    );
}
