//! Sunlight, shadows and materials.

use fuyu_render::{Camera, Distortion, Material, Scene, Texture, primitives, render};
use nalgebra::{Isometry3, Vector3};

use crate::{camera, put};

/// A floor of reflectance 0.5 at z = 10 and a plate of 1 m by 1 m between it and the Sun, out of the camera's sight.
fn floor_and_plate(sun: Vector3<f64>) -> (Scene, Camera) {
    let mut scene = Scene::new();
    scene.sun.direction = sun;
    let floor = primitives::cuboid(Vector3::new(8.0, 8.0, 0.2), Material::grey(0.5));
    put(&mut scene, floor, 1, Isometry3::translation(0.0, 0.0, 10.1));
    let plate = primitives::cuboid(Vector3::new(1.0, 1.0, 0.001), Material::grey(0.5));
    put(&mut scene, plate, 2, Isometry3::translation(3.5, 0.0, 7.0));
    (scene, camera(400, 300, 500.0, Distortion::None))
}

#[test]
fn a_shadow_is_where_the_sun_projects_it() {
    // Rays that pass the plate at z = 7 meet the floor, 3 m farther, 3 m to the left.
    let (scene, camera) = floor_and_plate(Vector3::new(1.0, 0.1, -1.0));
    let frame = render(&scene, &camera);
    let texel = 11.0 / 2046.0;
    let cosine = 1.0 / 2.01_f64.sqrt();
    let (mut dark, mut wrong) = (0, 0);
    for (i, radiance) in frame.radiance.iter().enumerate() {
        let (u, v) = ((i % 400) as f64, (i / 400) as f64);
        if frame.ids[i] != 1 {
            continue;
        }
        let (x, y) = ((u - 199.5) / 50.0, (v - 149.5) / 50.0);
        // Back along the ray to the plate.
        let (px, py) = (x + 3.0 - 3.5, y + 0.3);
        let inside = (0.5 - px.abs()).min(0.5 - py.abs());
        let is_dark = radiance[0] == 0.0;
        dark += usize::from(is_dark);
        // A texel, seen obliquely, and the bias.
        if inside.abs() > 3.0 * texel {
            wrong += usize::from(is_dark != (inside > 0.0));
        }
        if !is_dark {
            assert!((f64::from(radiance[0]) - 0.5 * cosine).abs() < 1e-5);
        }
    }
    assert_eq!(wrong, 0);
    // A square metre at 50 px per metre.
    assert!((dark as f64 - 2500.0).abs() < 60.0, "{dark}");
}

#[test]
fn shadows_end_with_the_sun_and_with_ambient_light_alone() {
    let (mut scene, camera) = floor_and_plate(Vector3::new(1.0, 0.1, -1.0));
    scene.sun.intensity = 0.0;
    scene.ambient = 0.25;
    let frame = render(&scene, &camera);
    for (radiance, id) in frame.radiance.iter().zip(&frame.ids) {
        if *id != 0 {
            assert_eq!(*radiance, [0.125; 3]);
        }
    }
}

#[test]
fn a_sphere_is_lit_by_the_cosine_of_the_angle_to_the_sun() {
    let mut scene = Scene::new();
    let sun = Vector3::new(-0.4, -0.5, -0.8).normalize();
    scene.sun.direction = sun;
    let colour = [0.8, 0.4, 0.1];
    put(
        &mut scene,
        primitives::sphere(1.0, Material::diffuse(colour)),
        1,
        Isometry3::translation(0.0, 0.0, 4.0),
    );
    let frame = render(&scene, &camera(200, 200, 250.0, Distortion::None));
    let mut compared = 0;
    for (i, radiance) in frame.radiance.iter().enumerate() {
        let d = Vector3::new((i % 200) as f64 - 99.5, (i / 200) as f64 - 99.5, 250.0) / 250.0;
        let (a, b) = (d.norm_squared(), d.z * 4.0);
        let discriminant = b * b - a * 15.0;
        if discriminant < 0.3 {
            continue;
        }
        let n = d * ((b - discriminant.sqrt()) / a) - Vector3::new(0.0, 0.0, 4.0);
        let cosine = n.dot(&sun);
        if cosine > 0.15 {
            compared += 1;
            for (value, reflectance) in radiance.iter().zip(colour) {
                let expected = f64::from(reflectance) * cosine;
                assert!(
                    (f64::from(*value) - expected).abs() < 0.01,
                    "{value} {expected}"
                );
            }
        } else if cosine < -0.1 {
            assert_eq!(*radiance, [0.0; 3]);
        }
    }
    assert!(compared > 5000, "{compared}");
}

#[test]
fn a_highlight_is_where_the_sun_is_mirrored() {
    let mut scene = Scene::new();
    scene.sun.direction = Vector3::new(0.5, 0.0, -1.0);
    let shiny = Material {
        specular: 0.5,
        shininess: 400.0,
        ..Material::grey(0.0)
    };
    let wall = primitives::cuboid(Vector3::new(20.0, 20.0, 0.1), shiny);
    put(&mut scene, wall, 1, Isometry3::translation(0.0, 0.0, 10.05));
    let frame = render(&scene, &camera(300, 100, 100.0, Distortion::None));
    let row = &frame.radiance[50 * 300..51 * 300];
    let brightest = (0..300)
        .max_by(|a, b| row[*a][0].total_cmp(&row[*b][0]))
        .unwrap();
    // The mirrored Sun is in the direction (0.5, 0, 1): 50 px to the right.
    assert!(
        (brightest as f64 - (149.5 + 50.0)).abs() <= 1.5,
        "{brightest}"
    );
}

#[test]
fn textures_are_upright_on_a_box() {
    let mut scene = Scene::new();
    // Upper left red, upper right green, lower left blue, lower right black.
    let texels = vec![[255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 0, 0]];
    let painted = Material {
        texture: Some(Texture::new(2, 2, texels).unwrap().into()),
        ..Material::grey(1.0)
    };
    // The side that faces +x, seen from +x with z up.
    let size = Vector3::new(2.0, 2.0, 2.0);
    let attitude = nalgebra::UnitQuaternion::from_basis_unchecked(&[
        -Vector3::z(),
        Vector3::x(),
        -Vector3::y(),
    ]);
    let pose = Isometry3::from_parts(nalgebra::Translation3::new(0.0, 0.0, 5.0), attitude);
    scene.sun.direction = -Vector3::z();
    put(&mut scene, primitives::cuboid(size, painted), 1, pose);
    let frame = render(&scene, &camera(100, 100, 180.0, Distortion::None));
    let at = |u: usize, v: usize| frame.radiance[v * 100 + u];
    assert_eq!(at(27, 27).map(|x| x > 0.9), [true, false, false]);
    assert_eq!(at(72, 27).map(|x| x > 0.9), [false, true, false]);
    assert_eq!(at(27, 72).map(|x| x > 0.9), [false, false, true]);
}
