//! Boxes, cylinders and spheres as URDF has them.

use nalgebra::Vector3;

use crate::{Material, Mesh, MeshData};

/// Segments of a circle.
const SEGMENTS: u32 = 48;

/// A box with these edge lengths \[m\], centred at the origin. Each side shows the whole texture, if there is one.
///
/// # Panics
/// If a length is not positive and finite.
pub fn cuboid(size: Vector3<f64>, material: Material) -> Mesh {
    let mut data = MeshData::default();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let first = data.positions.len() as u32;
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for [a, b] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                let mut p = [0.0; 3];
                p[axis] = (0.5 * sign * size[axis]) as f32;
                p[u] = (sign * (a - 0.5) * size[u]) as f32;
                p[v] = ((b - 0.5) * size[v]) as f32;
                data.positions.push(p);
                data.uvs.push([a as f32, b as f32]);
            }
            data.triangles.push([first, first + 1, first + 2]);
            data.triangles.push([first, first + 2, first + 3]);
        }
    }
    built(data, material)
}

/// A cylinder about z, centred at the origin; `radius` and `length` in metres.
///
/// # Panics
/// If one is not positive and finite.
pub fn cylinder(radius: f64, length: f64, material: Material) -> Mesh {
    let mut data = MeshData::default();
    let (r, h) = (radius as f32, (0.5 * length) as f32);
    // The shell; its last vertices are at the same place as the first, with another texture coordinate.
    for k in 0..=SEGMENTS {
        let (cos, sin) = direction(k % SEGMENTS, SEGMENTS);
        for (z, v) in [(-h, 0.0), (h, 1.0)] {
            data.positions.push([r * cos, r * sin, z]);
            data.normals.push([cos, sin, 0.0]);
            data.uvs.push([k as f32 / SEGMENTS as f32, v]);
        }
    }
    for k in 0..SEGMENTS {
        let a = 2 * k;
        data.triangles.push([a, a + 2, a + 3]);
        data.triangles.push([a, a + 3, a + 1]);
    }
    for (z, up) in [(-h, -1.0), (h, 1.0)] {
        let first = data.positions.len() as u32;
        for k in 0..SEGMENTS {
            let (cos, sin) = direction(k, SEGMENTS);
            data.positions.push([r * cos, r * sin, z]);
            data.normals.push([0.0, 0.0, up]);
            data.uvs.push([0.5 + 0.5 * cos, 0.5 + 0.5 * sin]);
        }
        for k in 1..SEGMENTS - 1 {
            let (b, c) = if up > 0.0 { (k, k + 1) } else { (k + 1, k) };
            data.triangles.push([first, first + b, first + c]);
        }
    }
    built(data, material)
}

/// A sphere of this radius \[m\] about the origin.
///
/// # Panics
/// If it is not positive and finite.
pub fn sphere(radius: f64, material: Material) -> Mesh {
    let mut data = MeshData::default();
    let rings = SEGMENTS / 2;
    for i in 0..=rings {
        // Exactly zero at the poles, so that their vertices are one.
        let (cos, sin) = match i {
            0 => (1.0, 0.0),
            _ if i == rings => (-1.0, 0.0),
            _ => direction(i, 2 * rings),
        };
        for k in 0..=SEGMENTS {
            let (x, y) = direction(k % SEGMENTS, SEGMENTS);
            let n = [sin * x, sin * y, cos];
            data.positions.push(n.map(|x| x * radius as f32));
            data.normals.push(n);
            data.uvs
                .push([k as f32 / SEGMENTS as f32, 1.0 - i as f32 / rings as f32]);
        }
    }
    for i in 0..rings {
        for k in 0..SEGMENTS {
            let a = i * (SEGMENTS + 1) + k;
            let b = a + SEGMENTS + 1;
            data.triangles.push([a, b, b + 1]);
            data.triangles.push([a, b + 1, a + 1]);
        }
    }
    built(data, material)
}

/// Cosine and sine of the angle of `k` of `n` segments.
fn direction(k: u32, n: u32) -> (f32, f32) {
    let angle = f64::from(k) / f64::from(n) * std::f64::consts::TAU;
    (angle.cos() as f32, angle.sin() as f32)
}

fn built(mut data: MeshData, material: Material) -> Mesh {
    data.materials.push(material);
    Mesh::new(data).expect("the lengths are positive and finite")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn primitives_are_closed_and_face_outward() {
        let material = || Material::grey(0.5);
        for mesh in [
            cuboid(Vector3::new(1.0, 2.0, 3.0), material()),
            cylinder(0.4, 2.0, material()),
            sphere(1.5, material()),
        ] {
            assert!(mesh.is_closed());
            assert!(mesh.hides_back_faces());
        }
    }

    #[test]
    fn sizes_are_those_asked_for() {
        let (_, radius) =
            cuboid(Vector3::new(2.0, 4.0, 4.0), Material::grey(0.5)).bounding_sphere();
        assert!((radius - 3.0).abs() < 1e-6);
        let (_, radius) = cylinder(0.3, 0.8, Material::grey(0.5)).bounding_sphere();
        assert!((radius - 0.5).abs() < 1e-6);
    }
}
