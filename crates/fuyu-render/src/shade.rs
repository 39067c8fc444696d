//! Light on a surface.

use nalgebra::Vector3;

use crate::{Material, Mesh, Scene, projection::Placed, shadow::Shadows};

/// The lights of one sample.
pub struct Lights {
    /// Unit vector toward the Sun in the world.
    toward_sun: Vector3<f64>,
    sun: f32,
    ambient: f32,
    /// Irradiance from the Earth, and the unit vector toward its centre.
    earthshine: f32,
    toward_earth: Vector3<f64>,
}

/// A point of a surface that a camera sees.
pub struct Point<'a> {
    /// Index of the instance.
    pub instance: usize,
    pub mesh: &'a Mesh,
    pub place: &'a Placed,
    /// Index of the triangle.
    pub triangle: usize,
    /// Weights of its corners.
    pub weights: [f32; 3],
    /// In the world \[m\].
    pub p_W: Vector3<f64>,
    /// Unit vector toward the camera.
    pub toward_camera: Vector3<f64>,
}

impl Lights {
    /// The lights at the point `p_W` of the world.
    pub fn new(scene: &Scene, p_W: &Vector3<f64>) -> Self {
        let toward_sun = scene.toward_sun();
        let reaches = |earth: &crate::Earth| earth.sunlight(p_W, &toward_sun);
        let visible = scene.earth.as_ref().map_or(1.0, reaches);
        let shine = scene.earth.map(|earth| earth.earthshine(p_W, &toward_sun));
        let (earthshine, toward_earth) = shine.unwrap_or((0.0, Vector3::z()));
        let intensity = scene.sun.intensity.max(0.0);
        Self {
            toward_sun,
            sun: (intensity * visible) as f32,
            ambient: scene.ambient.max(0.0) as f32,
            earthshine: (intensity * earthshine) as f32,
            toward_earth,
        }
    }

    /// Radiance of a point toward the camera. Both sides of a surface look the same.
    pub fn radiance(&self, point: &Point, shadows: &Shadows) -> [f32; 3] {
        let data = point.mesh.data();
        let t = data.triangles[point.triangle].map(|i| i as usize);
        let material = &data.materials[data.triangle_materials[point.triangle] as usize];
        let R = &point.place.R_WM;
        let [a, b, c] = t.map(|i| Vector3::from(data.positions[i].map(f64::from)));
        let flat = R * (b - a).cross(&(c - a));
        let flat = flat.try_normalize(0.0).unwrap_or(point.toward_camera);
        let facing = |n: Vector3<f64>, side: f64| if side < 0.0 { -n } else { n };
        let side = flat.dot(&point.toward_camera);
        let normal = smooth_normal(point, &t).map_or(flat, |n| R * n);
        let (flat, normal) = (facing(flat, side), facing(normal, side));
        let reflectance = match &material.texture {
            None => material.diffuse,
            Some(texture) => {
                let [u, v] = interpolated(&data.uvs, &t, point.weights);
                let texel = texture.sample(u, v);
                std::array::from_fn(|i| texel[i] * material.diffuse[i])
            }
        };
        let mut diffuse = self.ambient;
        if self.earthshine > 0.0 {
            // A broad light: half of it reaches a surface edge-on.
            diffuse += self.earthshine * (0.5 + 0.5 * normal.dot(&self.toward_earth)) as f32;
        }
        let mut highlight = 0.0;
        let cosine = normal.dot(&self.toward_sun);
        if self.sun > 0.0
            && cosine > 0.0
            && flat.dot(&self.toward_sun) > 0.0
            && shadows.is_lit(point.instance, &point.p_W, &flat)
        {
            diffuse += self.sun * cosine as f32;
            highlight = self.sun * self.highlight(point, material, &normal);
        }
        reflectance.map(|r| r * diffuse + highlight)
    }

    fn highlight(&self, point: &Point, material: &Material, normal: &Vector3<f64>) -> f32 {
        if material.specular <= 0.0 {
            return 0.0;
        }
        let half = (self.toward_sun + point.toward_camera).try_normalize(1e-9);
        let cosine = half.map_or(0.0, |h| h.dot(normal)).max(0.0) as f32;
        // Normalized, so that a sharper highlight is brighter.
        let norm = (material.shininess + 8.0) / 8.0;
        material.specular * norm * cosine.powf(material.shininess)
    }
}

/// The unit normal between those of the corners; `None` if the mesh has none there.
fn smooth_normal(point: &Point, t: &[usize; 3]) -> Option<Vector3<f64>> {
    let normals = &point.mesh.data().normals;
    if normals.is_empty() || t.iter().any(|i| normals[*i] == [0.0; 3]) {
        return None;
    }
    let n = interpolated(normals, t, point.weights);
    Vector3::from(n.map(f64::from)).try_normalize(1e-6)
}

/// The value between those of the corners; zero without values.
fn interpolated<const N: usize>(
    values: &[[f32; N]],
    t: &[usize; 3],
    weights: [f32; 3],
) -> [f32; N] {
    if values.is_empty() {
        return [0.0; N];
    }
    std::array::from_fn(|k| (0..3).map(|i| weights[i] * values[t[i]][k]).sum())
}
