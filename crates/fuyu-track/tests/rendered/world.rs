//! Images of a tumbling body, with what is true about them.

use fuyu_render::{
    Camera, Distortion, Frame, Instance, Intrinsics, Material, Mesh, Motion, Scene, Sensor, Star,
    Texture, primitives, render,
};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Id of the body in images.
pub const BODY: u16 = 2;
/// Id of the arm in images.
pub const ARM: u16 = 1;

/// What the camera sees, as a function of time.
pub struct World {
    /// The body, in its own frame.
    pub mesh: std::sync::Arc<Mesh>,
    /// Where the body is at time 0 \[m\], camera frame.
    pub position: Vector3<f64>,
    /// \[m/s\]
    pub velocity: Vector3<f64>,
    /// At time 0 \[rad/s\], body axes.
    pub angular_velocity: Vector3<f64>,
    /// Principal moments of inertia, body axes; equal ones give a constant rotation.
    pub moments: Vector3<f64>,
    /// Times between which the Sun is hidden \[s\].
    pub eclipse: [f64; 2],
    /// Toward the Sun.
    pub sun: Vector3<f64>,
    /// How bright stars are, 1 is physical; 0 leaves them out.
    pub stars: f64,
    /// Whether an arm crosses the image from left to right within 6 s.
    pub arm: bool,
    pub camera: Camera,
}

/// One image.
pub struct View {
    pub frame: Frame,
    pub grey: Vec<u8>,
    /// From the body's frame to the camera's.
    pub X_CB: Isometry3<f64>,
}

impl World {
    /// A body 8 m away in front light.
    pub fn new(mesh: Mesh) -> Self {
        let intrinsics = Intrinsics::centred(640, 480, 640.0);
        Self {
            mesh: mesh.into(),
            position: Vector3::new(0.1, -0.05, 8.0),
            velocity: Vector3::new(0.01, 0.0, 0.0),
            angular_velocity: Vector3::new(0.06, 0.1, 0.08),
            moments: Vector3::repeat(1.0),
            eclipse: [f64::INFINITY; 2],
            sun: Vector3::new(-0.4, -0.5, -1.0),
            stars: 0.0,
            arm: false,
            camera: Camera::new(intrinsics, Distortion::None, 4).expect("a usual camera"),
        }
    }

    /// From the body's axes to the camera's: Euler's equations and kinematics by the classical Runge-Kutta method.
    pub fn rotation(&self, time: f64) -> UnitQuaternion<f64> {
        let J = self.moments;
        let rate = |w: Vector3<f64>| (J.component_mul(&w).cross(&w)).component_div(&J);
        let steps = (time / 0.02).ceil().max(1.0);
        let h = time / steps;
        let (mut q, mut w) = (UnitQuaternion::identity(), self.angular_velocity);
        for _ in 0..steps as usize {
            let a = rate(w);
            let b = rate(w + 0.5 * h * a);
            let c = rate(w + 0.5 * h * b);
            let d = rate(w + h * c);
            let next = w + h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
            // The mean rate over the step, to third order.
            let middle = w + 0.5 * h * b;
            q *= UnitQuaternion::from_scaled_axis((w + 4.0 * middle + next) * (h / 6.0));
            w = next;
        }
        q
    }

    /// The image at `time` \[s\].
    pub fn view(&self, time: f64) -> View {
        let rotation = self.rotation(time);
        let place = self.position + self.velocity * time;
        let X_CB = Isometry3::from_parts(place.into(), rotation);
        let mut scene = Scene::new();
        scene.sun.direction = self.sun;
        if time >= self.eclipse[0] && time < self.eclipse[1] {
            scene.sun.intensity = 0.0;
            scene.ambient = 0.0;
        }
        scene.shadow_resolution = 512;
        scene.instances.push(Instance::new(
            self.mesh.clone(),
            BODY,
            Motion::at_rest(X_CB),
        ));
        if self.arm {
            let across = Translation3::new(-3.0 + time, 0.0, 5.0);
            let tilt = UnitQuaternion::from_scaled_axis(Vector3::new(1.2, 0.0, 0.0));
            let arm = primitives::cylinder(0.15, 12.0, material(3));
            let pose = Isometry3::from_parts(across, tilt);
            scene
                .instances
                .push(Instance::new(arm.into(), ARM, Motion::at_rest(pose)));
        }
        if self.stars > 0.0 {
            scene.stars = Star::random_sky(6.0, 5);
            scene.star_gain = self.stars;
        }
        let frame = render(&scene, &self.camera);
        let grey = Sensor::default().mono8(&frame, (time * 1000.0) as u64);
        View { frame, grey, X_CB }
    }
}

impl View {
    /// Id of the body at a pixel.
    pub fn id(&self, u: f64, v: f64) -> u16 {
        self.frame.ids[v.round() as usize * self.frame.width + u.round() as usize]
    }

    /// The point of the body that is seen at (u, v), in the body's frame \[m\]; `None` unless the pixels around are all of
    /// the body and of one surface.
    pub fn point(&self, camera: &Camera, u: f64, v: f64) -> Option<Vector3<f64>> {
        let (column, row) = (u as usize, v as usize);
        let at = |c: usize, r: usize| {
            let i = r * self.frame.width + c;
            (self.frame.ids[i] == BODY).then(|| 1.0 / f64::from(self.frame.depth[i]))
        };
        let corners = [
            at(column, row)?,
            at(column + 1, row)?,
            at(column, row + 1)?,
            at(column + 1, row + 1)?,
        ];
        // Over a plane, inverse depth is linear in the image.
        if (corners[0] + corners[3] - corners[1] - corners[2]).abs() > 1e-4 {
            return None;
        }
        let (a, b) = (u - column as f64, v - row as f64);
        let upper = corners[0] + a * (corners[1] - corners[0]);
        let lower = corners[2] + a * (corners[3] - corners[2]);
        let depth = 1.0 / (upper + b * (lower - upper));
        let p_C = camera.ray([u, v])? * depth;
        Some(self.X_CB.inverse_transform_point(&p_C.into()).coords)
    }

    /// Where the body's point is in this image, and whether something is in front of it.
    pub fn project(&self, camera: &Camera, p_B: &Vector3<f64>) -> ([f64; 2], bool) {
        let p_C = self.X_CB.transform_point(&(*p_B).into()).coords;
        let [u, v] = camera.project(&p_C).expect("in front of the camera");
        let (w, h) = (self.frame.width as f64, self.frame.height as f64);
        if !(u > 0.0 && v > 0.0 && u < w - 1.0 && v < h - 1.0) {
            return ([u, v], true);
        }
        let i = v.round() as usize * self.frame.width + u.round() as usize;
        // Half a pixel of a steep surface.
        let hidden = f64::from(self.frame.depth[i]) < p_C.z - 0.05;
        ([u, v], hidden)
    }
}

/// Blotches of several sizes, from 1/4 to 1/64 of the image.
pub fn material(seed: u64) -> Material {
    const SIZE: usize = 256;
    let hash = |x: u64, y: u64, octave: u64| {
        let mut h = seed ^ (x << 40) ^ (y << 20) ^ (octave << 8);
        for _ in 0..2 {
            h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            h ^= h >> 27;
        }
        (h % 1000) as f64 / 1000.0
    };
    let texels = (0..SIZE * SIZE).map(|i| {
        let (x, y) = (i % SIZE, i / SIZE);
        let mut value = 0.0;
        for (octave, cells) in [4, 16, 64].into_iter().enumerate() {
            let cell = SIZE / cells;
            let h = hash((x / cell) as u64, (y / cell) as u64, octave as u64);
            value += h / 3.0;
        }
        [(90.0 + 160.0 * value) as u8; 3]
    });
    let texture = Texture::new(SIZE, SIZE, texels.collect()).expect("all texels");
    Material {
        texture: Some(texture.into()),
        ..Material::grey(0.7)
    }
}

/// A box with structured surfaces.
pub fn textured_box() -> Mesh {
    primitives::cuboid(Vector3::new(1.8, 1.4, 1.4), material(1))
}
