//! Where bodies are in the image, and how far away.

use fuyu_render::{Distortion, Material, Mesh, MeshData, Scene, primitives, render};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::{camera, put};

fn turned(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    let attitude = UnitQuaternion::from_euler_angles(0.3, -0.7, 1.1);
    Isometry3::from_parts(Translation3::new(x, y, z), attitude)
}

/// Distance along z at which the ray (x, y, 1) enters a box (slabs).
fn ray_box(X_CB: &Isometry3<f64>, size: &Vector3<f64>, x: f64, y: f64) -> Option<f64> {
    let inverse = X_CB.inverse();
    let origin = inverse * Point3::origin();
    let d = inverse.rotation * Vector3::new(x, y, 1.0);
    let (mut enter, mut leave) = (f64::MIN, f64::MAX);
    for i in 0..3 {
        let at = |side: f64| (side * 0.5 * size[i] - origin[i]) / d[i];
        enter = enter.max(at(-1.0).min(at(1.0)));
        leave = leave.min(at(-1.0).max(at(1.0)));
    }
    (enter < leave).then_some(enter)
}

/// Distance along z at which the ray (x, y, 1) enters a sphere.
fn ray_sphere(centre: &Vector3<f64>, radius: f64, x: f64, y: f64) -> Option<f64> {
    let d = Vector3::new(x, y, 1.0);
    let (a, b) = (d.norm_squared(), d.dot(centre));
    let discriminant = b * b - a * (centre.norm_squared() - radius * radius);
    (discriminant > 0.0).then(|| (b - discriminant.sqrt()) / a)
}

/// A sphere of many triangles.
fn fine_sphere(radius: f64) -> Mesh {
    let (rings, segments) = (180, 360);
    let mut data = MeshData::default();
    for i in 0..=rings {
        for k in 0..segments {
            let (a, b) = (
                std::f64::consts::PI * f64::from(i) / f64::from(rings),
                std::f64::consts::TAU * f64::from(k) / f64::from(segments),
            );
            let p = [a.sin() * b.cos(), a.sin() * b.sin(), a.cos()];
            data.positions.push(p.map(|x| (x * radius) as f32));
        }
    }
    for i in 0..rings as u32 {
        for k in 0..segments as u32 {
            let a = i * segments as u32 + k;
            let b = i * segments as u32 + (k + 1) % segments as u32;
            let below = segments as u32;
            data.triangles.push([a, a + below, b + below]);
            data.triangles.push([a, b + below, b]);
        }
    }
    Mesh::new(data).unwrap()
}

#[test]
fn every_pixel_of_a_box_has_the_depth_of_its_ray() {
    let size = Vector3::new(1.0, 0.6, 1.4);
    let pose = turned(0.2, -0.1, 4.0);
    let mut scene = Scene::new();
    put(
        &mut scene,
        primitives::cuboid(size, Material::grey(0.5)),
        3,
        pose,
    );
    let camera = camera(320, 240, 300.0, Distortion::None);
    let frame = render(&scene, &camera);
    let (mut inside, mut wrong) = (0, 0);
    for (i, (depth, id)) in frame.depth.iter().zip(&frame.ids).enumerate() {
        let (u, v) = ((i % 320) as f64, (i / 320) as f64);
        let expected = ray_box(&pose, &size, (u - 159.5) / 300.0, (v - 119.5) / 300.0);
        match (expected, id) {
            (Some(z), 3) => {
                inside += 1;
                assert!(
                    (f64::from(*depth) - z).abs() < 2e-5 * z,
                    "({u}, {v}): {depth} {z}"
                );
            }
            (None, 0) => assert_eq!(*depth, f32::INFINITY),
            _ => wrong += 1,
        }
    }
    assert!(inside > 6000, "{inside}");
    // Only rays that meet an edge to within rounding.
    assert!(wrong <= 2, "{wrong}");
}

#[test]
fn a_sphere_has_the_depth_and_outline_of_its_rays() {
    let centre = Vector3::new(-0.3, 0.2, 3.0);
    let mut scene = Scene::new();
    put(
        &mut scene,
        fine_sphere(0.8),
        1,
        Translation3::from(centre).into(),
    );
    let frame = render(&scene, &camera(320, 240, 300.0, Distortion::None));
    let (mut worst, mut wrong, mut inside) = (0.0_f64, 0, 0);
    for (i, (depth, id)) in frame.depth.iter().zip(&frame.ids).enumerate() {
        let (x, y) = ((i % 320) as f64 - 159.5, (i / 320) as f64 - 119.5);
        let ray = |r: f64| ray_sphere(&centre, r, x / 300.0, y / 300.0);
        match (ray(0.8), id) {
            (Some(z), 1) => {
                inside += 1;
                // Facets are up to r (1 - cos) below the sphere, more at the outline.
                if ray(0.79).is_some() {
                    worst = worst.max((f64::from(*depth) - z).abs());
                }
            }
            (None, 0) => {}
            _ => wrong += 1,
        }
    }
    assert!(worst < 1e-3, "{worst}");
    assert!(inside > 18_000 && wrong < 20, "{inside} {wrong}");
}

#[test]
fn small_bodies_are_where_the_pinhole_projects_them() {
    let mut scene = Scene::new();
    let mut points = Vec::new();
    for (id, (x, y)) in (1..).zip([
        (-1.0, -0.7),
        (0.4, -0.2),
        (0.0, 0.0),
        (1.1, 0.8),
        (-0.6, 0.5),
    ]) {
        let p = Vector3::new(x, y, 2.0 + 0.3 * f64::from(id));
        points.push(p);
        let dot = primitives::sphere(0.03, Material::grey(0.5));
        put(&mut scene, dot, id as u16, Translation3::from(p).into());
    }
    let frame = render(&scene, &camera(640, 480, 500.0, Distortion::None));
    for (id, p) in (1..).zip(&points) {
        let pixels = (0..640 * 480).filter(|i| frame.ids[*i] == id);
        let pixels: Vec<[f64; 2]> = pixels
            .map(|i| [(i % 640) as f64, (i / 640) as f64])
            .collect();
        let mean = |k: usize| pixels.iter().map(|q| q[k]).sum::<f64>() / pixels.len() as f64;
        let (u, v) = (319.5 + 500.0 * p.x / p.z, 239.5 + 500.0 * p.y / p.z);
        // The centre of a sphere's image is a little farther out than the image of its centre: r^2 / d^2 of its distance.
        let off = (mean(0) - u).hypot(mean(1) - v);
        assert!(pixels.len() > 40 && off < 0.15, "{id}: {off}");
    }
}

#[test]
fn nearer_bodies_hide_farther_ones_whatever_their_order() {
    let near = || primitives::cuboid(Vector3::repeat(0.5), Material::grey(0.5));
    let far = || primitives::cuboid(Vector3::repeat(2.0), Material::grey(0.5));
    let at = |z: f64| Isometry3::translation(0.0, 0.0, z);
    let (mut a, mut b) = (Scene::new(), Scene::new());
    put(&mut a, near(), 1, at(3.0));
    put(&mut a, far(), 2, at(6.0));
    put(&mut b, far(), 2, at(6.0));
    put(&mut b, near(), 1, at(3.0));
    let camera = camera(160, 120, 150.0, Distortion::None);
    let (a, b) = (render(&a, &camera), render(&b, &camera));
    assert_eq!(a.ids[60 * 160 + 80], 1);
    assert_eq!(a.ids[60 * 160 + 50], 2);
    assert_eq!((a.ids, a.depth), (b.ids, b.depth));
}

#[test]
fn bodies_that_reach_behind_the_camera_are_cut_not_mirrored() {
    let mut scene = Scene::new();
    // A wall at the right that passes the camera: from z = -5 to z = 5 at x = 1.
    let wall = primitives::cuboid(Vector3::new(0.1, 0.5, 10.0), Material::grey(0.5));
    put(&mut scene, wall, 1, Isometry3::translation(1.05, 0.0, 0.0));
    let frame = render(&scene, &camera(200, 100, 50.0, Distortion::None));
    let row = &frame.ids[50 * 200..51 * 200];
    // Its far end at z = 5 is 50 / 5 = 10 px from the middle, its near part beyond the border.
    let first = row.iter().position(|id| *id == 1).unwrap();
    assert_eq!(first, 110);
    assert!(row[first..].iter().all(|id| *id == 1));
    assert!(frame.depth[50 * 200 + 199] < 0.6);
}

#[test]
fn a_closed_mesh_is_seen_from_inside_and_an_open_one_from_both_sides() {
    let mut scene = Scene::new();
    put(
        &mut scene,
        primitives::cuboid(Vector3::repeat(2.0), Material::grey(0.5)),
        1,
        Isometry3::identity(),
    );
    let view = camera(64, 48, 40.0, Distortion::None);
    let frame = render(&scene, &view);
    assert!(frame.ids.iter().all(|id| *id == 1));
    assert!((frame.depth[24 * 64 + 32] - 1.0).abs() < 1e-5);
    assert_eq!(scene.body_around(&Vector3::new(0.1, 0.0, 0.0)), Some(0));
    assert_eq!(scene.body_around(&Vector3::new(1.1, 0.0, 0.0)), None);
    for order in [[0, 1, 2], [0, 2, 1]] {
        let mut scene = Scene::new();
        let sheet = MeshData {
            positions: vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![order],
            ..MeshData::default()
        };
        put(
            &mut scene,
            Mesh::new(sheet).unwrap(),
            1,
            Isometry3::translation(0.0, 0.0, 2.0),
        );
        let seen = render(&scene, &view)
            .ids
            .iter()
            .filter(|id| **id == 1)
            .count();
        // Half of 40 by 40 pixels.
        assert!((780..820).contains(&seen), "{seen}");
    }
}

#[test]
fn no_gap_opens_between_triangles() {
    // Two thousand thin triangles that share their corners fill a disc; a wall is behind it.
    let mut data = MeshData::default();
    data.positions.push([0.013, -0.007, 0.0]);
    let n = 2000_u32;
    for k in 0..n {
        let angle = std::f64::consts::TAU * f64::from(k) / f64::from(n);
        data.positions
            .push([angle.cos() as f32, angle.sin() as f32, 0.0]);
        data.triangles.push([0, 1 + k, 1 + (k + 1) % n]);
    }
    let mut scene = Scene::new();
    put(
        &mut scene,
        Mesh::new(data).unwrap(),
        1,
        turned(0.0, 0.0, 3.0),
    );
    let frame = render(&scene, &camera(640, 480, 600.0, Distortion::None));
    for (i, row) in frame.ids.chunks(640).enumerate() {
        let first = row.iter().position(|id| *id == 1);
        let last = row.iter().rposition(|id| *id == 1);
        if let (Some(first), Some(last)) = (first, last) {
            assert!(row[first..=last].iter().all(|id| *id == 1), "row {i}");
        }
    }
}
