//! Noise, saturation and motion blur.

use fuyu_render::{
    Camera, Distortion, Frame, Instance, Intrinsics, Material, Motion, Scene, Sensor, Transfer,
    primitives, render,
};
use nalgebra::{Isometry3, Vector3};

/// A frame of the same radiance everywhere.
fn uniform(radiance: f32) -> Frame {
    let (width, height) = (400, 300);
    Frame {
        width,
        height,
        radiance: vec![[radiance; 3]; width * height],
        depth: vec![f32::INFINITY; width * height],
        ids: vec![0; width * height],
    }
}

fn mean_and_variance(values: &[u8]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    let squares = values.iter().map(|v| (f64::from(*v) - mean).powi(2));
    (mean, squares.sum::<f64>() / n)
}

#[test]
fn noise_has_the_variance_of_shot_and_read_noise() {
    // Small wells, so that noise is several levels.
    let sensor = Sensor {
        exposure: 2e-3,
        sensitivity: 1e6,
        full_well: 2000.0,
        read_noise: 12.0,
        ..Sensor::default()
    };
    let per_electron = 255.0 / 2000.0;
    for radiance in [0.03, 0.2, 0.45, 0.7] {
        let values = sensor.mono8(&uniform(radiance), 5);
        let electrons = 2000.0 * f64::from(radiance);
        let (mean, variance) = mean_and_variance(&values);
        let expected = electrons * per_electron;
        // Rounding to levels adds a twelfth.
        let noise = (electrons + 144.0) * per_electron.powi(2) + 1.0 / 12.0;
        // Four standard errors of 120,000 pixels.
        let n = values.len() as f64;
        assert!(
            (mean - expected).abs() < 4.0 * (noise / n).sqrt() + 0.02,
            "{mean} {expected}"
        );
        assert!(
            (variance / noise - 1.0).abs() < 4.0 * (2.0 / n).sqrt() + 0.01,
            "{variance} {noise}"
        );
    }
}

#[test]
fn without_noise_values_are_proportional_until_the_wells_are_full() {
    let quiet = Sensor {
        shot_noise: false,
        read_noise: 0.0,
        full_well: 10_000.0,
        ..Sensor::default()
    };
    for (radiance, value) in [
        (0.0, 0),
        (0.5, 128),
        (0.9999, 255),
        (3.0, 255),
        (f32::NAN, 0),
    ] {
        assert_eq!(quiet.mono8(&uniform(radiance), 0)[77], value, "{radiance}");
    }
    let longer = Sensor {
        exposure: 2e-3,
        ..quiet.clone()
    };
    assert_eq!(longer.mono8(&uniform(0.25), 0)[77], 128);
    let srgb = Sensor {
        transfer: Transfer::Srgb,
        ..quiet
    };
    // IEC 61966-2-1: 0.2140 of the light is half of the range.
    assert_eq!(srgb.rgb8(&uniform(0.214_04), 0)[77], 128);
}

#[test]
fn frames_have_independent_noise_that_repeats_with_the_seed() {
    let sensor = Sensor::default();
    let frame = uniform(0.4);
    assert_eq!(sensor.mono8(&frame, 3), sensor.mono8(&frame, 3));
    let other = Sensor {
        seed: 2,
        ..sensor.clone()
    };
    for (a, b) in [
        (sensor.mono8(&frame, 3), sensor.mono8(&frame, 4)),
        (sensor.mono8(&frame, 3), other.mono8(&frame, 3)),
        // Seeds are not an offset of the number.
        (sensor.mono8(&frame, 3), other.mono8(&frame, 2)),
    ] {
        let ((ma, va), (mb, vb)) = (mean_and_variance(&a), mean_and_variance(&b));
        let products = a
            .iter()
            .zip(&b)
            .map(|(a, b)| (f64::from(*a) - ma) * (f64::from(*b) - mb));
        let correlation = products.sum::<f64>() / a.len() as f64 / (va * vb).sqrt();
        assert!(
            correlation.abs() < 4.0 / (a.len() as f64).sqrt(),
            "{correlation}"
        );
    }
}

#[test]
fn colours_weigh_as_rec_709_says_in_grey() {
    let quiet = Sensor {
        shot_noise: false,
        read_noise: 0.0,
        full_well: 1e4,
        ..Sensor::default()
    };
    let mut frame = uniform(0.0);
    frame.radiance[0] = [1.0, 0.0, 0.0];
    frame.radiance[1] = [0.0, 1.0, 0.0];
    frame.radiance[2] = [0.0, 0.0, 1.0];
    assert_eq!(quiet.mono8(&frame, 0)[..3], [54, 182, 18]);
    assert_eq!(
        quiet.rgb8(&frame, 0)[..9],
        [255, 0, 0, 0, 255, 0, 0, 0, 255]
    );
}

#[test]
fn an_edge_that_moves_is_blurred_over_its_path() {
    let mut scene = Scene::new();
    scene.sun.direction = -Vector3::z();
    let wall = primitives::cuboid(Vector3::new(4.0, 4.0, 0.1), Material::grey(1.0));
    // Its left edge moves from x = 0 to x = 0.2, 5 m away: from column 99.5 by 20 px.
    let at = |x: f64| Isometry3::translation(2.0 + x, 0.0, 5.05);
    let motion = Motion {
        open: at(0.0),
        close: at(0.2),
    };
    scene.instances.push(Instance::new(wall.into(), 1, motion));
    let camera = Camera::new(Intrinsics::centred(200, 20, 500.0), Distortion::None, 40).unwrap();
    let frame = render(&scene, &camera);
    let row: Vec<f64> = frame.radiance[10 * 200..11 * 200]
        .iter()
        .map(|c| f64::from(c[0]))
        .collect();
    for (u, value) in row.iter().enumerate() {
        let expected = ((u as f64 - 99.5) / 20.0).clamp(0.0, 1.0);
        assert!(
            (value - expected).abs() < 0.04,
            "column {u}: {value} {expected}"
        );
    }
    // Depth and ids are those of half the exposure: the edge is at 109.5.
    let first = frame.ids[10 * 200..]
        .iter()
        .position(|id| *id == 1)
        .unwrap();
    assert_eq!(first, 110);
}

#[test]
fn a_camera_that_turns_blurs_like_a_scene_that_turns() {
    let wall = || primitives::cuboid(Vector3::new(1.0, 1.0, 0.1), Material::grey(1.0));
    let turned = |angle: f64| Isometry3::rotation(Vector3::y() * angle);
    let place = Isometry3::translation(0.1, 0.0, 4.0);
    let mut camera =
        Camera::new(Intrinsics::centred(160, 120, 200.0), Distortion::None, 8).unwrap();
    let (mut still, mut moving) = (Scene::new(), Scene::new());
    for scene in [&mut still, &mut moving] {
        scene.sun.direction = -Vector3::z();
        // No sunlight that turns with the scene.
        (scene.sun.intensity, scene.ambient) = (0.0, 1.0);
    }
    still
        .instances
        .push(Instance::new(wall().into(), 1, Motion::at_rest(place)));
    let motion = Motion {
        open: turned(0.05) * place,
        close: turned(-0.05) * place,
    };
    moving
        .instances
        .push(Instance::new(wall().into(), 1, motion));
    let of_scene = render(&moving, &camera);
    camera.pose = Motion {
        open: turned(-0.05),
        close: turned(0.05),
    };
    let of_camera = render(&still, &camera);
    let differing = of_scene.radiance.iter().zip(&of_camera.radiance);
    let differing = differing.filter(|(a, b)| (a[0] - b[0]).abs() > 0.3).count();
    assert!(differing < 40, "{differing}");
    assert!(of_scene.radiance.iter().any(|c| c[0] > 0.2 && c[0] < 0.8));
}
