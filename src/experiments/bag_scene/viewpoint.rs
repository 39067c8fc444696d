//! Placement of the camera for pictures of a run.

use fuyu_render::{Camera, Distortion, Instance, Intrinsics, Motion};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

use super::{PictureError, PictureOptions};

/// Number of samples per pixel, for smooth edges.
const SAMPLES: usize = 9;

/// Factor by which bounding spheres are enlarged, for a margin around the picture.
const MARGIN: f64 = 1.1;

/// The nearest camera in the given direction that has all bodies in view at all times.
pub fn placed_camera(
    bodies: &[Vec<Vec<Instance>>],
    options: &PictureOptions,
) -> Result<Camera, PictureError> {
    let (width, height) = options.size;
    let half = 0.5 * options.field_of_view;
    let focal_length = 0.5 * f64::from(width) / half.tan();
    let camera = Camera::new(
        Intrinsics::centred(width, height, focal_length),
        Distortion::None,
        SAMPLES,
    );
    let camera = camera.map_err(|e| PictureError::Input(format!("--size: {e}")))?;
    // Bounding spheres of the meshes, in camera axes.
    let R_WC = optical_axes(options.azimuth, options.elevation);
    let spheres: Vec<(Vector3<f64>, f64)> = (bodies.iter().flatten().flatten())
        .map(|instance| {
            let (centre, radius) = instance.mesh.bounding_sphere();
            let p_W = instance.motion.open * Point3::from(centre);
            (R_WC.inverse() * p_W.coords, radius)
        })
        .collect();
    if spheres.is_empty() {
        let text = "nothing to draw: no description has a visual element that can be drawn";
        return Err(PictureError::Input(text.to_owned()));
    }
    let vertical = (f64::from(height) / f64::from(width) * half.tan()).atan();
    let (_, from_sides) = between_sides(&spheres, 0, half);
    let (_, from_top) = between_sides(&spheres, 1, vertical);
    let z = from_sides.min(from_top);
    let (x, y) = (
        in_the_middle(&spheres, 0, half, z),
        in_the_middle(&spheres, 1, vertical, z),
    );
    let depths = spheres.iter().map(|(c, _)| c.z);
    let (near, far) = depths.fold((f64::MAX, f64::MIN), |(near, far), z| {
        (near.min(z), far.max(z))
    });
    let middle = 0.5 * (near + far);
    let z = middle - (middle - z) * options.distance;
    let p_WC = R_WC * Vector3::new(x, y, z);
    let rotation = UnitQuaternion::from_rotation_matrix(&R_WC);
    Ok(camera.at(Motion::at_rest(Isometry3::from_parts(
        p_WC.into(),
        rotation,
    ))))
}

/// Position of a camera that looks along z such that all spheres are in its view along one transverse axis, x (0) or y
/// (1), for the half angle of view `half` \[rad\]. Returns the coordinate on this axis and the largest possible z.
///
/// A sphere touches a side plane of the view if the distance of its centre from the plane equals its radius. Each of
/// the two side planes bounds the position; the intersection of the bounds is the foremost position.
fn between_sides(spheres: &[(Vector3<f64>, f64)], axis: usize, half: f64) -> (f64, f64) {
    let (sin, cos) = half.sin_cos();
    let most = |sign: f64| {
        let each = spheres.iter();
        each.map(|(c, r)| sign * c[axis] * cos + r * MARGIN - c.z * sin)
            .fold(f64::MIN, f64::max)
    };
    let (one, other) = (most(1.0), most(-1.0));
    ((one - other) / (2.0 * cos), -(one + other) / (2.0 * sin))
}

/// Coordinate on a transverse axis of a camera at `z` that centres the spheres in its view: that of the narrowest view
/// that contains all of them.
fn in_the_middle(spheres: &[(Vector3<f64>, f64)], axis: usize, half: f64, z: f64) -> f64 {
    let (mut narrow, mut wide) = (0.0, half);
    for _ in 0..50 {
        let tried = 0.5 * (narrow + wide);
        match between_sides(spheres, axis, tried).1 >= z {
            true => wide = tried,
            false => narrow = tried,
        }
    }
    between_sides(spheres, axis, wide).0
}

/// Axes of an optical frame that looks against the given direction, with the world's z axis upward in the picture.
fn optical_axes(azimuth: f64, elevation: f64) -> Rotation3<f64> {
    let (sin, cos) = azimuth.sin_cos();
    let toward = Vector3::new(
        cos * elevation.cos(),
        sin * elevation.cos(),
        elevation.sin(),
    );
    let right = Vector3::new(-sin, cos, 0.0);
    let z = -toward;
    Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, z.cross(&right), z]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_looks_at_the_bodies_with_z_upward() {
        let R_WC = optical_axes(0.0, 0.0);
        // Seen from +x, +y is on the right and +z is up.
        assert!((R_WC * Vector3::z() + Vector3::x()).norm() < 1e-15);
        assert!((R_WC * Vector3::x() - Vector3::y()).norm() < 1e-15);
        assert!((R_WC * Vector3::y() + Vector3::z()).norm() < 1e-15);
        let R_WC = optical_axes(-2.1, 0.4);
        assert!((R_WC.matrix().determinant() - 1.0).abs() < 1e-14);
        assert!((R_WC * Vector3::y()).z < -0.9);
    }

    // Fails if a body is cut off at a side of the picture, or the camera is farther away than necessary.
    #[test]
    fn the_camera_is_as_far_away_as_all_bodies_need() {
        use fuyu_render::{Material, Scene, primitives};
        let ball = std::sync::Arc::new(primitives::sphere(1.0, Material::grey(0.5)));
        let at = |x, y, z| {
            let motion = Motion::at_rest(Isometry3::translation(x, y, z));
            Instance::new(ball.clone(), 1, motion)
        };
        let bodies = [vec![vec![at(5.0, 1.0, 2.0)], vec![at(-3.0, 4.0, 0.0)]]];
        for (azimuth, elevation) in [(0.0, 0.0), (1.0, 0.3), (-2.5, -1.2)] {
            let options = PictureOptions {
                azimuth,
                elevation,
                ..PictureOptions::default()
            };
            let camera = placed_camera(&bodies, &options).unwrap();
            let mut scene = Scene::new();
            scene.instances = bodies[0].concat();
            let frame = fuyu_render::render(&scene, &camera);
            let (w, h) = (frame.width, frame.height);
            let seen = |u: usize, v: usize| frame.ids[v * w + u] != 0;
            let drawn: Vec<(usize, usize)> = (0..h)
                .flat_map(|v| (0..w).map(move |u| (u, v)))
                .filter(|(u, v)| seen(*u, *v))
                .collect();
            let left = drawn.iter().map(|p| p.0).min().unwrap();
            let right = w - 1 - drawn.iter().map(|p| p.0).max().unwrap();
            let top = drawn.iter().map(|p| p.1).min().unwrap();
            let bottom = h - 1 - drawn.iter().map(|p| p.1).max().unwrap();
            // In the tighter direction the bodies touch both edges; in the other direction they are centred.
            let edges = [left.max(right), top.max(bottom)];
            assert!((1..60).contains(edges.iter().min().unwrap()), "{edges:?}");
            assert!(left.min(right) > 0 && top.min(bottom) > 0, "{edges:?}");
            assert!(left.abs_diff(right) < 60, "{left} {right}");
            assert!(top.abs_diff(bottom) < 60, "{top} {bottom}");
        }
    }
}
