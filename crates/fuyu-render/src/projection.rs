//! Triangles in a camera's frame, ready to be drawn.

use nalgebra::{Isometry3, Rotation3, Vector3};
use rayon::prelude::*;

use crate::{
    Scene,
    camera::{Bounds, Rays},
};

/// A triangle as three half spaces through the camera (homogeneous rasterisation; Olano and Greer, Triangle scan
/// conversion using 2D homogeneous coordinates, 1997). A ray (x, y, 1) meets it if all of `edges` are not negative on the
/// ray; its inverse depth there is `inverse_depth` on the ray. There is nothing to clip, and rays need not be in a plane
/// grid, so that distorted images are exact, too.
#[derive(Debug, Clone, Copy)]
pub struct Projected {
    /// Coefficients of x, y, 1.
    pub edges: [[f32; 3]; 3],
    /// Coefficients of x, y, 1 \[1/m\].
    pub inverse_depth: [f32; 3],
    /// Index of the instance.
    pub instance: u32,
    /// Index of the triangle in its mesh.
    pub triangle: u32,
    /// Rows of tiles in which it may be seen: first and last.
    pub rows: [u16; 2],
    /// Columns of tiles in which it may be seen: first and last.
    pub columns: [u16; 2],
    pub bounds: Bounds,
}

/// Pose of an instance for one sample.
#[derive(Debug, Clone, Copy)]
pub struct Placed {
    /// Of the mesh in the world.
    pub X_WM: Isometry3<f64>,
    /// Its rotation.
    pub R_WM: Rotation3<f64>,
    pub is_drawn: bool,
}

/// The poses of all instances at a fraction of the exposure.
pub fn placed(scene: &Scene, fraction: f64) -> Vec<Placed> {
    let instances = scene.instances.iter();
    let places = instances.map(|instance| {
        let X_WM = instance.motion.at(fraction);
        Placed {
            X_WM,
            R_WM: X_WM.rotation.to_rotation_matrix(),
            is_drawn: instance.motion.is_finite(),
        }
    });
    places.collect()
}

/// Triangles that one task projects.
const BLOCK: usize = 2048;

/// Some triangles of an instance.
struct Block {
    instance: usize,
    /// Of the mesh in the camera's frame.
    X_CM: Isometry3<f64>,
    /// Whether back faces are left out.
    culls: bool,
    triangles: std::ops::Range<usize>,
}

/// Projects all triangles that may be seen, in their order. `X_CW` takes the world to the camera's frame.
pub fn project(
    scene: &Scene,
    places: &[Placed],
    X_CW: &Isometry3<f64>,
    rays: &Rays,
    near: f64,
) -> Vec<Projected> {
    let mut blocks = Vec::new();
    let mut view = Bounds::NONE;
    for row in &rays.rows {
        if row.x[0] <= row.x[1] {
            view.add(row.x[0], row.y[0]);
            view.add(row.x[1], row.y[1]);
        }
    }
    for (i, (instance, place)) in scene.instances.iter().zip(places).enumerate() {
        let (centre, radius) = instance.mesh.bounding_sphere();
        let X_CM = X_CW * place.X_WM;
        let centre_C = X_CM.rotation * centre + X_CM.translation.vector;
        if !place.is_drawn || centre_C.z + radius < near || misses(&view, &centre_C, radius) {
            continue;
        }
        let mesh = &instance.mesh;
        // Seen from outside a closed mesh, its back faces are hidden; from inside they are all there is.
        let camera_M = X_CM.inverse().translation.vector;
        let culls = mesh.hides_back_faces() && !mesh.contains(&camera_M);
        let count = mesh.data().triangles.len();
        let starts = (0..count).step_by(BLOCK);
        blocks.extend(starts.map(|start| Block {
            instance: i,
            X_CM,
            culls,
            triangles: start..(start + BLOCK).min(count),
        }));
    }
    let project_block = |block: &Block| {
        let data = scene.instances[block.instance].mesh.data();
        let X_CM = &block.X_CM;
        let (R, p) = (X_CM.rotation.to_rotation_matrix(), X_CM.translation.vector);
        let place = |i: u32| R * Vector3::from(data.positions[i as usize].map(f64::from)) + p;
        let triangles = block.triangles.clone().filter_map(|index| {
            let corners = data.triangles[index].map(place);
            let mut projected = one(&corners, block.culls, near, rays)?;
            projected.instance = block.instance as u32;
            projected.triangle = index as u32;
            Some(projected)
        });
        triangles.collect::<Vec<_>>()
    };
    let projected: Vec<Vec<Projected>> = blocks.par_iter().map(project_block).collect();
    projected.concat()
}

/// Whether a sphere is outside of the pyramid of the rays.
fn misses(view: &Bounds, centre: &Vector3<f64>, radius: f64) -> bool {
    let beyond = |normal: Vector3<f64>| normal.dot(centre) > radius * normal.norm();
    let [x0, x1] = view.x.map(f64::from);
    let [y0, y1] = view.y.map(f64::from);
    beyond(Vector3::new(1.0, 0.0, -x1))
        || beyond(Vector3::new(-1.0, 0.0, x0))
        || beyond(Vector3::new(0.0, 1.0, -y1))
        || beyond(Vector3::new(0.0, -1.0, y0))
}

fn one(corners: &[Vector3<f64>; 3], culls: bool, near: f64, rays: &Rays) -> Option<Projected> {
    let [a, b, c] = corners;
    let normals = [b.cross(c), c.cross(a), a.cross(b)];
    // Six times the volume of the tetrahedron with the camera: positive if its back is seen.
    let volume = a.dot(&normals[0]);
    if volume == 0.0 || (culls && volume > 0.0) {
        return None;
    }
    let bounds = bounds(corners, near)?;
    // A power of two does not change the common edge of two triangles by rounding, so that no gap opens between them.
    let largest = normals
        .iter()
        .map(nalgebra::Matrix::amax)
        .fold(0.0, f64::max);
    let scale = volume.signum() * 2.0_f64.powi(-(largest.log2().floor() as i32));
    let total = (normals[0] + normals[1] + normals[2]) / volume;
    let in_view = |row: &Bounds| row.overlap(&bounds);
    let first = rays.rows.iter().position(in_view)?;
    let last = rays.rows.iter().rposition(in_view)?;
    let (left, right) = rays.columns(&bounds);
    Some(Projected {
        edges: normals.map(|n| [n.x, n.y, n.z].map(|x| (x * scale) as f32)),
        inverse_depth: [total.x, total.y, total.z].map(|x| x as f32),
        instance: 0,
        triangle: 0,
        rows: [first as u16, last as u16],
        columns: [left as u16, right as u16],
        bounds,
    })
}

/// Bounds of the part of a triangle that is beyond `near`, in the plane z = 1; `None` if nothing is.
fn bounds(corners: &[Vector3<f64>; 3], near: f64) -> Option<Bounds> {
    let mut bounds = Bounds::NONE;
    let mut add = |p: &Vector3<f64>| bounds.add((p.x / p.z) as f32, (p.y / p.z) as f32);
    let mut any = false;
    for i in 0..3 {
        let (a, b) = (&corners[i], &corners[(i + 1) % 3]);
        if a.z >= near {
            any = true;
            add(a);
        }
        if (a.z < near) != (b.z < near) {
            let fraction = (near - a.z) / (b.z - a.z);
            let mut crossing = a + (b - a) * fraction;
            crossing.z = near;
            add(&crossing);
        }
    }
    if !any {
        return None;
    }
    // The last bit of a conversion may be on the wrong side.
    let widen = |[low, high]: [f32; 2]| {
        let margin = 1e-6 * (1.0 + low.abs().max(high.abs()));
        [low - margin, high + margin]
    };
    Some(Bounds {
        x: widen(bounds.x),
        y: widen(bounds.y),
    })
}
