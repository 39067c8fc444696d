//! Lens distortion in images, against formulas written down here a second time.

use fuyu_render::{Camera, Distortion, Intrinsics, Material, Scene, primitives, render};
use nalgebra::{Translation3, Vector3};

use crate::put;

/// Column and row of a point after plumb_bob distortion (OpenCV, camera calibration).
fn plumb_bob(p: &Vector3<f64>, f: f64, c: [f64; 2], k: [f64; 5]) -> [f64; 2] {
    let (x, y) = (p.x / p.z, p.y / p.z);
    let r = (x * x + y * y).sqrt();
    let radial = 1.0 + k[0] * r.powi(2) + k[1] * r.powi(4) + k[4] * r.powi(6);
    let u = x * radial + 2.0 * k[2] * x * y + k[3] * (r.powi(2) + 2.0 * x.powi(2));
    let v = y * radial + k[2] * (r.powi(2) + 2.0 * y.powi(2)) + 2.0 * k[3] * x * y;
    [f * u + c[0], f * v + c[1]]
}

/// The same for the equidistant model (Kannala and Brandt 2006, as in OpenCV's fisheye module).
fn equidistant(p: &Vector3<f64>, f: f64, c: [f64; 2], k: [f64; 4]) -> [f64; 2] {
    let angle = p.xy().norm().atan2(p.z);
    let powers = (0..4).map(|i| k[i] * angle.powi(2 * i as i32 + 3));
    let distance = angle + powers.sum::<f64>();
    let direction = p.xy() / p.xy().norm();
    [
        f * distance * direction.x + c[0],
        f * distance * direction.y + c[1],
    ]
}

fn check(lens: Distortion, focal_length: f64, expected: impl Fn(&Vector3<f64>) -> [f64; 2]) {
    let mut scene = Scene::new();
    let mut points = Vec::new();
    for x in -4..=4 {
        for y in -3..=3 {
            let p = Vector3::new(0.41 * f64::from(x) + 0.01, 0.4 * f64::from(y) + 0.01, 2.5);
            points.push(p);
            let dot = primitives::sphere(0.02, Material::grey(0.5));
            put(
                &mut scene,
                dot,
                points.len() as u16,
                Translation3::from(p).into(),
            );
        }
    }
    let camera = Camera::new(Intrinsics::centred(1280, 960, focal_length), lens, 1).unwrap();
    let frame = render(&scene, &camera);
    let mut sums = vec![[0.0; 3]; points.len() + 1];
    for (i, id) in frame.ids.iter().enumerate() {
        let sum = &mut sums[usize::from(*id)];
        *sum = [
            sum[0] + 1.0,
            sum[1] + (i % 1280) as f64,
            sum[2] + (i / 1280) as f64,
        ];
    }
    let mut seen = 0;
    for (p, sum) in points.iter().zip(&sums[1..]) {
        let [u, v] = expected(p);
        let margin = 15.0;
        if u < margin || v < margin || u > 1279.0 - margin || v > 959.0 - margin {
            continue;
        }
        seen += 1;
        let off = (sum[1] / sum[0] - u).hypot(sum[2] / sum[0] - v);
        // The centroid of about 100 whole pixels.
        assert!(
            sum[0] > 40.0 && off < 0.25,
            "{p} at ({u}, {v}): off by {off}"
        );
        let projected = camera.project(p).unwrap();
        assert!((projected[0] - u).hypot(projected[1] - v) < 1e-9);
    }
    assert!(seen >= 45, "{seen}");
}

#[test]
fn plumb_bob_images_agree_with_the_published_formula() {
    let k = [-0.25, 0.08, 1e-3, -8e-4, 0.002];
    check(Distortion::PlumbBob(k), 900.0, |p| {
        plumb_bob(p, 900.0, [639.5, 479.5], k)
    });
}

#[test]
fn equidistant_images_agree_with_the_published_formula() {
    let k = [0.02, -0.01, 0.003, -0.001];
    check(Distortion::Equidistant(k), 800.0, |p| {
        equidistant(p, 800.0, [639.5, 479.5], k)
    });
}

#[test]
fn a_fisheye_shows_nothing_beyond_its_image_circle() {
    let mut scene = Scene::new();
    let inside = primitives::cuboid(Vector3::repeat(20.0), Material::grey(0.5));
    put(&mut scene, inside, 1, nalgebra::Isometry3::identity());
    let lens = Distortion::Equidistant([0.0; 4]);
    let camera = Camera::new(Intrinsics::centred(400, 400, 120.0), lens, 1).unwrap();
    let frame = render(&scene, &camera);
    // 89 degrees are 186 px from the middle.
    for (i, id) in frame.ids.iter().enumerate() {
        let r = ((i % 400) as f64 - 199.5).hypot((i / 400) as f64 - 199.5);
        if (r - 186.4).abs() > 1.0 {
            assert_eq!(*id == 1, r < 186.4, "{i}");
        }
    }
}
