//! The tumbling motions of Masutani 1995 chapter 3, described by isotropy, symmetry and momentum: sec. 3.4.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::estimation::free_body::{FreeRotation, FreeRotationError};

/// A tumbling motion, by isotropy, symmetry and momentum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TumblingMotion {
    /// Isotropy `e = I_z / I_x`, the smallest moment over the largest, (3.2).
    pub e: f64,
    /// Symmetry `s` in [-1, 1]: position of the middle moment between the smallest and the largest, (3.3).
    pub s: f64,
    /// Momentum `s_alpha` in [-1, 1]: position of `L² / 2E` between the smallest and the largest moment, (3.9).
    pub s_alpha: f64,
    /// Largest `|w|²` \[rad²/s²\].
    pub beta: f64,
}

/// Values of `e` in the grid: 0.35 to 1.00 in steps of 0.05.
pub const ISOTROPIES: usize = 14;
/// Values of `s_alpha` in the grid: -1.0 to 1.0 in steps of 0.1.
pub const MOMENTA: usize = 21;

/// The grid of sec. 3.6: all `s_alpha` of the first `e`, then of the next; `s = 0`, the least symmetric value.
pub fn grid(beta: f64) -> Vec<TumblingMotion> {
    let cells = (0..ISOTROPIES).flat_map(|e| (0..MOMENTA).map(move |s| (e, s)));
    cells
        .map(|(e, s_alpha)| TumblingMotion {
            e: (7 + e) as f64 / 20.0,
            s: 0.0,
            s_alpha: (s_alpha as f64 - 10.0) / 10.0,
            beta,
        })
        .collect()
}

impl TumblingMotion {
    /// Moments over twice the energy, and `alpha`, in the thesis's order of axes \[s²\]; (3.10)-(3.14).
    pub fn parameters(&self) -> (Vector3<f64>, f64) {
        let Self {
            e,
            s,
            s_alpha,
            beta,
        } = *self;
        let largest = (1.0 + e - s_alpha * (1.0 - e)) / (2.0 * e * beta);
        let least = e * largest;
        // This form is exact at both ends.
        let between = |s: f64| (0.5 * (1.0 + s) + 0.5 * (1.0 - s) * e) * largest;
        let (middle, alpha) = (between(s), between(s_alpha));
        let J = if alpha < middle {
            Vector3::new(largest, middle, least)
        } else {
            Vector3::new(least, middle, largest)
        };
        (J, alpha)
    }

    /// The motion itself: momentum along the camera's optical axis, `|w|²` least at time zero. (The text does not
    /// specify the start; this one reproduces its tables.)
    ///
    /// # Errors
    /// [`FreeRotationError`] if the numbers are outside their ranges.
    pub fn rotation(&self) -> Result<FreeRotation, FreeRotationError> {
        let (J, alpha) = self.parameters();
        // (2.9) at sn = 1, cn = 0: no rate about x.
        let square = |of: f64, gap: f64| {
            let spread = J.y - J.z;
            if spread == 0.0 {
                0.0
            } else {
                gap / (of * spread)
            }
        };
        let w = if J.y == J.z {
            Vector3::new(0.0, 0.0, J.z.sqrt().recip())
        } else {
            let (y, z) = (square(J.y, alpha - J.z), square(J.z, J.y - alpha));
            Vector3::new(0.0, y.max(0.0).sqrt(), z.max(0.0).sqrt())
        };
        let nutation = (J.y * w.y).atan2(J.z * w.z);
        let R_CB = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), nutation);
        FreeRotation::new(&Matrix3::from_diagonal(&J), R_CB, &w, 0.0)
    }
}
