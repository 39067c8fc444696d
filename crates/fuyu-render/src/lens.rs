//! Lens distortion, as `sensor_msgs/CameraInfo` describes it.

/// A distortion model with its coefficients. Points are in the image plane at z = 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// A pinhole.
    None,
    /// `plumb_bob` (Brown-Conrady): k1, k2, p1, p2, k3.
    PlumbBob([f64; 5]),
    /// `equidistant` (Kannala-Brandt fisheye): k1, k2, k3, k4, of the angle from the axis.
    Equidistant([f64; 4]),
}

/// Why a distortion cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LensError {
    /// The model is not known.
    #[error("'{0}' is not known; it must be plumb_bob or equidistant")]
    Model(String),
    /// The number of coefficients is wrong.
    #[error("{model} has {expected} coefficients, not {count}")]
    Count {
        /// The model.
        model: &'static str,
        /// How many it has.
        expected: usize,
        /// How many were given.
        count: usize,
    },
    /// A coefficient is not finite.
    #[error("coefficient {0} is not finite")]
    NotFinite(f64),
}

impl Distortion {
    /// The model called `model` in `sensor_msgs/distortion_models`. Without coefficients, or with zeros only, `plumb_bob`
    /// is a pinhole.
    ///
    /// # Errors
    /// [`LensError`] for another name or number of coefficients.
    pub fn new(model: &str, coefficients: &[f64]) -> Result<Self, LensError> {
        if let Some(wrong) = coefficients.iter().find(|k| !k.is_finite()) {
            return Err(LensError::NotFinite(*wrong));
        }
        let wrong = |model, expected| LensError::Count {
            model,
            expected,
            count: coefficients.len(),
        };
        match model {
            "plumb_bob" if coefficients.iter().all(|k| *k == 0.0) => match coefficients.len() {
                0 | 5 => Ok(Self::None),
                _ => Err(wrong("plumb_bob", 5)),
            },
            "plumb_bob" => match coefficients.try_into() {
                Ok(k) => Ok(Self::PlumbBob(k)),
                Err(_) => Err(wrong("plumb_bob", 5)),
            },
            "equidistant" => match coefficients.try_into() {
                Ok(k) => Ok(Self::Equidistant(k)),
                Err(_) => Err(wrong("equidistant", 4)),
            },
            other => Err(LensError::Model(other.to_owned())),
        }
    }

    /// Name of the model in `sensor_msgs/distortion_models`, and its coefficients.
    pub fn model(&self) -> (&'static str, Vec<f64>) {
        match self {
            Self::None => ("plumb_bob", vec![0.0; 5]),
            Self::PlumbBob(k) => ("plumb_bob", k.to_vec()),
            Self::Equidistant(k) => ("equidistant", k.to_vec()),
        }
    }

    /// Where the lens shows the point (`x`, `y`) of the undistorted image plane.
    pub fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        match self {
            Self::None => [x, y],
            Self::PlumbBob([k1, k2, p1, p2, k3]) => {
                let r2 = x * x + y * y;
                let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                [
                    x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                    y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
                ]
            }
            Self::Equidistant(k) => {
                let r = x.hypot(y);
                if r == 0.0 {
                    return [x, y];
                }
                let scale = fisheye(k, r.atan()).0 / r;
                [x * scale, y * scale]
            }
        }
    }

    /// The point of the undistorted image plane that the lens shows at (`x`, `y`); `None` where it shows nothing: beyond
    /// the image circle, or where the polynomial folds back.
    pub fn undistort(&self, shown: [f64; 2]) -> Option<[f64; 2]> {
        match self {
            Self::None => Some(shown),
            Self::PlumbBob(k) => self.undistort_plumb_bob(k, shown),
            Self::Equidistant(k) => {
                let r = shown[0].hypot(shown[1]);
                if r == 0.0 {
                    return Some(shown);
                }
                let angle = fisheye_angle(k, r)?;
                let scale = angle.tan() / r;
                Some(shown.map(|x| x * scale))
            }
        }
    }

    /// Newton's method from the middle outward: in steps along the ray, so that it stays on the branch that begins there.
    fn undistort_plumb_bob(&self, k: &[f64; 5], shown: [f64; 2]) -> Option<[f64; 2]> {
        let [k1, k2, p1, p2, k3] = *k;
        const STEPS: u32 = 8;
        let mut p = [0.0; 2];
        for step in 1..=STEPS {
            let goal = shown.map(|x| x * f64::from(step) / f64::from(STEPS));
            let mut converged = false;
            for _ in 0..20 {
                let [x, y] = p;
                let r2 = x * x + y * y;
                let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                // Derivative of the radial factor by r2, times two.
                let slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3));
                let xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x;
                let xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
                let yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x;
                let determinant = xx * yy - xy * xy;
                if determinant.is_nan() || determinant <= 1e-9 {
                    return None;
                }
                let now = self.distort(p);
                let [ex, ey] = [goal[0] - now[0], goal[1] - now[1]];
                if ex.abs().max(ey.abs()) < 1e-13 * (1.0 + goal[0].abs().max(goal[1].abs())) {
                    converged = true;
                    break;
                }
                p[0] += (yy * ex - xy * ey) / determinant;
                p[1] += (xx * ey - xy * ex) / determinant;
            }
            if !converged {
                return None;
            }
        }
        Some(p)
    }
}

/// Largest angle from the axis that an image plane at z = 1 can hold \[rad\].
const WIDEST: f64 = 89.0 * std::f64::consts::PI / 180.0;

/// Distance from the middle at which a fisheye shows the angle `angle`, and its derivative.
fn fisheye(k: &[f64; 4], angle: f64) -> (f64, f64) {
    let a2 = angle * angle;
    let value = 1.0 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3])));
    let slope = 1.0 + a2 * (3.0 * k[0] + a2 * (5.0 * k[1] + a2 * (7.0 * k[2] + a2 * 9.0 * k[3])));
    (angle * value, slope)
}

/// The first angle at which a fisheye reaches the distance `r`.
fn fisheye_angle(k: &[f64; 4], r: f64) -> Option<f64> {
    const STEPS: u32 = 64;
    let mut low = 0.0;
    for step in 1..=STEPS {
        let high = WIDEST * f64::from(step) / f64::from(STEPS);
        let (value, slope) = fisheye(k, high);
        if value >= r {
            // Between two angles: bisection with Newton's steps.
            let (mut low, mut high) = (low, high);
            let mut angle = 0.5 * (low + high);
            for _ in 0..60 {
                let (value, slope) = fisheye(k, angle);
                if (value - r).abs() < 1e-15 * (1.0 + r) {
                    break;
                }
                if value < r {
                    low = angle
                } else {
                    high = angle
                }
                let next = angle - (value - r) / slope;
                angle = if next > low && next < high {
                    next
                } else {
                    0.5 * (low + high)
                };
            }
            return Some(angle);
        }
        if slope <= 0.0 {
            return None;
        }
        low = high;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn undistortion_inverts_distortion() {
        let lenses = [
            Distortion::None,
            Distortion::PlumbBob([-0.28, 0.07, 8e-4, -3e-4, 0.01]),
            Distortion::PlumbBob([0.15, -0.02, -1e-3, 2e-3, 0.0]),
            Distortion::Equidistant([-0.013, 0.02, -0.012, 0.002]),
        ];
        for lens in lenses {
            for i in -9..=9 {
                for j in -9..=9 {
                    let p = [f64::from(i) * 0.09, f64::from(j) * 0.08];
                    let back = lens.undistort(lens.distort(p)).unwrap();
                    let off = (back[0] - p[0]).hypot(back[1] - p[1]);
                    assert!(off < 1e-11, "{lens:?} {p:?} {back:?}");
                }
            }
        }
    }

    #[test]
    fn points_are_where_the_published_formulas_put_them() {
        // r2 = 0.13, by hand from the definition in OpenCV's documentation.
        let [x, y] = Distortion::PlumbBob([-0.3, 0.1, 0.001, -0.002, 0.0]).distort([0.3, 0.2]);
        let radial = 1.0 - 0.3 * 0.13 + 0.1 * 0.0169;
        assert!((x - (0.3 * radial + 2.0 * 0.001 * 0.06 - 0.002 * (0.13 + 0.18))).abs() < 1e-15);
        assert!((y - (0.2 * radial + 0.001 * (0.13 + 0.08) - 2.0 * 0.002 * 0.06)).abs() < 1e-15);
        // Without coefficients a fisheye shows angles: 45 degrees at pi / 4.
        let [x, y] = Distortion::Equidistant([0.0; 4]).distort([1.0, 0.0]);
        assert!((x - std::f64::consts::FRAC_PI_4).abs() < 1e-15 && y == 0.0);
    }

    #[test]
    fn what_no_lens_shows_has_no_direction() {
        // The radius 1 / sqrt(3 * 0.3) = 1.05 is shown at 0.70; nothing is shown beyond.
        let barrel = Distortion::PlumbBob([-0.3, 0.0, 0.0, 0.0, 0.0]);
        assert!(barrel.undistort([0.69, 0.0]).is_some());
        assert_eq!(barrel.undistort([0.72, 0.0]), None);
        let fisheye = Distortion::Equidistant([0.0; 4]);
        assert!(fisheye.undistort([1.5, 0.0]).is_some());
        assert_eq!(fisheye.undistort([1.6, 0.0]), None);
    }

    #[test]
    fn wrong_models_are_refused() {
        let refused = |model, k: &[f64]| Distortion::new(model, k).unwrap_err().to_string();
        assert!(refused("fisheye", &[]).contains("plumb_bob or equidistant"));
        assert!(refused("plumb_bob", &[0.1, 0.2]).contains("has 5 coefficients, not 2"));
        assert!(refused("equidistant", &[0.1, f64::NAN, 0.0, 0.0]).contains("not finite"));
        assert_eq!(
            Distortion::new("plumb_bob", &[0.0; 5]),
            Ok(Distortion::None)
        );
    }
}
