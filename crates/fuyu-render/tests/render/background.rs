//! Stars and the Earth.

use fuyu_render::{
    Distortion, EARTH_RADIUS, Earth, Material, Motion, Scene, Star, primitives, render,
};
use nalgebra::{Isometry3, UnitVector3, Vector3};

use crate::{camera, put};

#[test]
fn a_star_is_where_its_direction_is_and_as_bright_as_its_magnitude() {
    let mut scene = Scene::new();
    let direction = UnitVector3::new_normalize(Vector3::new(0.123, -0.087, 1.0));
    scene.stars = vec![Star {
        direction,
        magnitude: 1.0,
    }];
    scene.star_gain = 1000.0;
    let camera = camera(320, 240, 300.0, Distortion::None);
    let frame = render(&scene, &camera);
    let [mut total, mut x, mut y] = [0.0; 3];
    for (i, radiance) in frame.radiance.iter().enumerate() {
        let value = f64::from(radiance[1]);
        total += value;
        x += value * (i % 320) as f64;
        y += value * (i / 320) as f64;
    }
    // A white pixel has the radiance E / pi and the solid angle cos^3 / f^2; a star of magnitude 1 has 10^-11.096 E.
    let solid_angle = direction.z.powi(3) / (300.0 * 300.0);
    let expected = 1000.0 * std::f64::consts::PI / solid_angle * 10_f64.powf(-0.4 * 27.74);
    assert!((total / expected - 1.0).abs() < 1e-3, "{total} {expected}");
    assert!((x / total - (159.5 + 36.9)).abs() < 0.02 && (y / total - (119.5 - 26.1)).abs() < 0.02);
}

// Far from the axis a pixel sees less of the sky, and a star is more of its light: 1 / cos^3 in a pinhole, 1.54 times at 30
// degrees; r^2 sin(angle) / r = sin(angle) / angle in an equidistant lens.
#[test]
fn stars_have_their_brightness_all_over_the_image() {
    for (lens, ratio) in [
        (Distortion::None, (30.0_f64.to_radians().cos()).powi(-3)),
        (
            Distortion::Equidistant([0.0; 4]),
            30.0_f64.to_radians() / 30.0_f64.to_radians().sin(),
        ),
    ] {
        let camera = camera(500, 400, 300.0, lens);
        let total = |angle: f64| {
            let mut scene = Scene::new();
            scene.stars = vec![Star {
                direction: UnitVector3::new_normalize(Vector3::new(angle.sin(), 0.0, angle.cos())),
                magnitude: 1.0,
            }];
            scene.star_gain = 1000.0;
            let frame = render(&scene, &camera);
            frame.radiance.iter().map(|r| f64::from(r[1])).sum::<f64>()
        };
        let found = total(30.0_f64.to_radians()) / total(0.0);
        assert!((found / ratio - 1.0).abs() < 1e-3, "{found} {ratio}");
    }
}

#[test]
fn bodies_and_the_earth_hide_stars() {
    let sky = |scene: &mut Scene| {
        scene.stars = Star::random_sky(6.5, 1);
        scene.star_gain = 1e4;
        // The far side of the Sun: nothing else is bright.
        scene.sun.intensity = 0.0;
        let frame = render(scene, &camera(200, 200, 100.0, Distortion::None));
        let bright = |i: &usize| frame.radiance[*i][0] > 0.0;
        let middle = |i: &usize| (80..120).contains(&(i % 200)) && (80..120).contains(&(i / 200));
        (
            (0..40_000).filter(|i| middle(i) && bright(i)).count(),
            (0..40_000).filter(|i| !middle(i) && bright(i)).count(),
        )
    };
    let (middle, around) = sky(&mut Scene::new());
    assert!(middle > 100 && around > 1000, "{middle} {around}");
    let mut hidden = Scene::new();
    put(
        &mut hidden,
        primitives::cuboid(Vector3::repeat(2.0), Material::grey(0.5)),
        1,
        Isometry3::translation(0.0, 0.0, 4.0),
    );
    assert_eq!(sky(&mut hidden).0, 0);
    let mut hidden = Scene::new();
    hidden.earth = Some(Earth::at(Vector3::new(0.0, 0.0, 15e6)));
    let (middle, around) = sky(&mut hidden);
    assert!(middle == 0 && around > 500, "{middle} {around}");
}

#[test]
fn the_earth_is_a_disc_of_its_angular_size() {
    let mut scene = Scene::new();
    let distance = 42_164e3;
    scene.earth = Some(Earth::at(Vector3::new(0.0, 0.0, distance)));
    scene.sun.direction = -Vector3::z();
    let mut camera = camera(300, 300, 800.0, Distortion::None);
    // The camera is displaced; the Earth is too far away to notice.
    camera.pose = Motion::at_rest(Isometry3::translation(5.0, 0.0, 0.0));
    let frame = render(&scene, &camera);
    let bright = frame.radiance.iter().filter(|c| c[2] > 0.0).count() as f64;
    // The sine of its angular radius is R / d.
    let radius = 800.0 * (EARTH_RADIUS / distance).asin().tan();
    let area = std::f64::consts::PI * radius * radius;
    assert!((bright / area - 1.0).abs() < 0.01, "{bright} {area}");
    assert!(frame.depth.iter().all(|z| z.is_infinite()));
}

#[test]
fn a_body_in_the_earths_shadow_is_dark_and_one_above_its_day_side_is_lit_from_below() {
    let lit = |earth: Vector3<f64>, sun: Vector3<f64>| {
        let mut scene = Scene::new();
        scene.sun.direction = sun;
        scene.earth = Some(Earth::at(earth));
        put(
            &mut scene,
            primitives::cuboid(Vector3::repeat(2.0), Material::grey(1.0)),
            1,
            Isometry3::translation(0.0, 0.0, 5.0),
        );
        render(&scene, &camera(20, 20, 20.0, Distortion::None)).radiance[10 * 20 + 10][0]
    };
    let below = -Vector3::z() * 7e6;
    // The camera's side of the box faces the Earth and the Sun behind it.
    assert_eq!(lit(below, -Vector3::z()), 0.0);
    // Sun from the far side: the side toward the Earth has its light only.
    let shine = 0.3 * (EARTH_RADIUS / 7e6).powi(2);
    assert!((f64::from(lit(below, Vector3::z())) - shine).abs() < 1e-4);
}
