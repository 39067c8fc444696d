//! A small simulator of a tumbling body before a camera. It shares no code with the estimator: Euler's equations with
//! torques, relative orbital motion and a turning camera are integrated together by the classical Runge-Kutta method.

use fuyu_physics::estimation::{Feature, FeatureFrame};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector2, Vector3};
use rand::{RngExt, rngs::StdRng};
use rand_distr::StandardNormal;

/// What acts on body and camera. The default is a torque-free body at rest before a camera at rest.
#[derive(Debug, Clone, Default)]
pub struct World {
    /// Principal moments of inertia \[kg m²\].
    pub I: Vector3<f64>,
    /// Orbital rate \[rad/s\]; zero for no orbit.
    pub orbital_rate: f64,
    /// Whether gravity turns the body.
    pub gravity_gradient: bool,
    /// Direction from the Earth at time zero and normal of the orbit, inertial axes.
    pub orbit: (Vector3<f64>, Vector3<f64>),
    /// Angular acceleration fixed to the body, as of outgassing \[rad/s²\].
    pub body_acceleration: Vector3<f64>,
    /// Angular acceleration in inertial axes \[rad/s²\]: values a second apart, interpolated linearly. Zero if empty.
    pub inertial_acceleration: Vec<Vector3<f64>>,
    /// Constant acceleration of the body's centre, inertial axes \[m/s²\].
    pub centre_acceleration: Vector3<f64>,
    /// Angular velocity of the camera in its own axes is `camera_rate * (1 + 0.5 sin(camera_pace t))` \[rad/s\].
    pub camera_rate: Vector3<f64>,
    /// \[rad/s\].
    pub camera_pace: f64,
    /// An impulse: time \[s\], and change of the angular velocity in body axes \[rad/s\].
    pub push: Option<(f64, Vector3<f64>)>,
}

/// State of body and camera.
#[derive(Debug, Clone, Copy)]
pub struct State {
    /// Attitude of the body in inertial axes.
    pub R_WB: UnitQuaternion<f64>,
    /// Angular velocity in body axes \[rad/s\].
    pub w_B: Vector3<f64>,
    /// Position of the body's centre from the camera, inertial axes \[m\].
    pub r_W: Vector3<f64>,
    /// Its velocity \[m/s\].
    pub v_W: Vector3<f64>,
    /// Attitude of the camera in inertial axes.
    pub R_WC: UnitQuaternion<f64>,
}

#[derive(Clone, Copy)]
struct Slope {
    q: Quaternion<f64>,
    w: Vector3<f64>,
    r: Vector3<f64>,
    v: Vector3<f64>,
    c: Quaternion<f64>,
}

impl World {
    fn up(&self, t: f64) -> Vector3<f64> {
        let (radial, normal) = self.orbit;
        let angle = self.orbital_rate * t;
        radial * angle.cos() + normal.cross(&radial) * angle.sin()
    }

    /// Angular velocity of the camera in its own axes \[rad/s\].
    pub fn camera_rate(&self, t: f64) -> Vector3<f64> {
        self.camera_rate * (1.0 + 0.5 * (self.camera_pace * t).sin())
    }

    /// Angular acceleration in inertial axes \[rad/s²\].
    fn inertial_acceleration(&self, t: f64) -> Vector3<f64> {
        let k = t.floor();
        let at = |k: f64| self.inertial_acceleration.get(k as usize).copied();
        match (at(k), at(k + 1.0)) {
            (Some(a), Some(b)) => a.lerp(&b, t - k),
            (a, _) => a.unwrap_or_default(),
        }
    }

    fn slope(&self, t: f64, s: &State) -> Slope {
        let n2 = self.orbital_rate * self.orbital_rate;
        let up = if n2 > 0.0 {
            self.up(t)
        } else {
            Vector3::zeros()
        };
        let acceleration =
            self.body_acceleration + s.R_WB.inverse() * self.inertial_acceleration(t);
        let mut torque = self.I.component_mul(&acceleration);
        if self.gravity_gradient {
            let up_B = s.R_WB.inverse() * up;
            torque += up_B.cross(&self.I.component_mul(&up_B)) * (3.0 * n2);
        }
        let momentum = self.I.component_mul(&s.w_B);
        Slope {
            q: s.R_WB.quaternion() * Quaternion::from_imag(s.w_B) * 0.5,
            w: (torque - s.w_B.cross(&momentum)).component_div(&self.I),
            r: s.v_W,
            v: (up * (3.0 * up.dot(&s.r_W)) - s.r_W) * n2 + self.centre_acceleration,
            c: s.R_WC.quaternion() * Quaternion::from_imag(self.camera_rate(t)) * 0.5,
        }
    }

    fn step(&self, t: f64, s: &State, h: f64) -> State {
        let moved = |k: &Slope, h: f64| State {
            R_WB: UnitQuaternion::new_normalize(s.R_WB.quaternion() + k.q * h),
            w_B: s.w_B + k.w * h,
            r_W: s.r_W + k.r * h,
            v_W: s.v_W + k.v * h,
            R_WC: UnitQuaternion::new_normalize(s.R_WC.quaternion() + k.c * h),
        };
        let a = self.slope(t, s);
        let b = self.slope(t + h / 2.0, &moved(&a, h / 2.0));
        let c = self.slope(t + h / 2.0, &moved(&b, h / 2.0));
        let d = self.slope(t + h, &moved(&c, h));
        let sixth = Slope {
            q: (a.q + (b.q + c.q) * 2.0 + d.q) / 6.0,
            w: (a.w + (b.w + c.w) * 2.0 + d.w) / 6.0,
            r: (a.r + (b.r + c.r) * 2.0 + d.r) / 6.0,
            v: (a.v + (b.v + c.v) * 2.0 + d.v) / 6.0,
            c: (a.c + (b.c + c.c) * 2.0 + d.c) / 6.0,
        };
        moved(&sixth, h)
    }

    /// States at ascending times, from `start` at time zero.
    pub fn run(&self, start: State, times: &[f64]) -> Vec<State> {
        let (mut t, mut s) = (0.0, start);
        let mut push = self.push;
        let mut out = Vec::with_capacity(times.len());
        for &to in times {
            while t < to {
                let mut end = to;
                if let Some((at, change)) = push
                    && at <= to
                {
                    if at <= t {
                        s.w_B += change;
                        push = None;
                    } else {
                        end = at;
                    }
                }
                let steps = ((end - t) * (20.0 + 60.0 * s.w_B.norm())).ceil().max(1.0);
                let h = (end - t) / steps;
                for k in 0..steps as usize {
                    s = self.step(t + h * k as f64, &s, h);
                }
                t = end;
            }
            out.push(s);
        }
        out
    }
}

/// A camera with lens distortion, and what its tracker does to image points.
#[derive(Debug, Clone)]
pub struct Eye {
    /// Focal length \[px\].
    pub focal: f64,
    /// Principal point \[px\].
    pub centre: Vector2<f64>,
    /// First radial coefficient.
    pub radial: f64,
    /// Gaussian noise before rounding \[px\].
    pub noise: f64,
    /// Whether coordinates are rounded to whole pixels.
    pub rounded: bool,
    /// Whether the far side of the body is hidden.
    pub occlusion: bool,
    /// Share of image points that are anywhere.
    pub outliers: f64,
    /// Number of points that are seen at a time, if not all.
    pub visible: Option<usize>,
}

impl Eye {
    /// A camera of 1024 px, `width` focal lengths wide.
    pub fn new(width: f64, noise: f64, rounded: bool) -> Self {
        Self {
            focal: 1024.0 / width,
            centre: Vector2::new(511.5, 511.5),
            radial: 0.0,
            noise,
            rounded,
            occlusion: false,
            outliers: 0.0,
            visible: None,
        }
    }

    /// The frame at `time` \[s\] of the body with `points` (body axes, \[m\]) in state `s`.
    pub fn frame(
        &self,
        time: f64,
        s: &State,
        points: &[Vector3<f64>],
        rng: &mut StdRng,
    ) -> FeatureFrame {
        let R_CW: Matrix3<f64> = *s.R_WC.inverse().to_rotation_matrix().matrix();
        let mut features = Vec::new();
        let from = self.visible.map_or(0, |_| (time * 2.0) as usize);
        for (id, p) in points.iter().enumerate() {
            // The visible points change one by one.
            let place = (id + points.len() * 1000 - from) % points.len();
            if self.visible.is_some_and(|count| place >= count) {
                continue;
            }
            let p_W = s.R_WB * p;
            let x = R_CW * (p_W + s.r_W);
            if x.z < 0.05 || (self.occlusion && p_W.dot(&(p_W + s.r_W)) > 0.0) {
                continue;
            }
            let n = x.xy() / x.z;
            let ideal = n * (1.0 + self.radial * n.norm_squared()) * self.focal + self.centre;
            let noise = Vector2::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal)) * self.noise;
            let mut seen = ideal + noise;
            if self.outliers > 0.0 && rng.random_range(0.0..1.0) < self.outliers {
                seen = Vector2::from_fn(|_, _| rng.random_range(0.0..1023.0));
            }
            if self.rounded {
                seen = seen.map(f64::round);
            }
            features.push(Feature {
                id: id as u64,
                u: seen.x,
                v: seen.y,
            });
        }
        FeatureFrame::new(time, features)
    }
}
