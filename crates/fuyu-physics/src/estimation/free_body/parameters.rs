//! Dynamic parameters: the four numbers that determine a free rotation up to its initial state. Masutani 1995 sec. 2.3.2.

use nalgebra::Vector3;

use crate::estimation::elliptic::Modulus;

/// Two moments are equal if they differ by less than this share of the largest.
const EQUAL: f64 = 1e-12;

/// A sum of terms with opposite signs is zero if it is less than this share of their absolute sum.
const ROUNDING: f64 = 1e-15;

/// Dynamic parameters: moments over twice the energy, `J = I / 2E`, and `alpha = L² / 4E²`, all \[s²\].
///
/// The axes are the thesis's: z is the principal axis that the angular velocity circles, y the one of the
/// middle moment. So either `J_x ≥ J_y ≥ alpha ≥ J_z` or `J_x ≤ J_y ≤ alpha ≤ J_z`. With two equal moments
/// z is the axis of symmetry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DynamicParameters {
    J: Vector3<f64>,
    alpha: f64,
    /// `|J_x - alpha|`, `|J_y - alpha|`, `|J_z - alpha|`, more accurate than the differences.
    gaps: Vector3<f64>,
}

/// Why parameters belong to no free rotation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ParametersError {
    /// A parameter is not positive or not finite.
    #[error("J = ({}, {}, {}) s², alpha = {alpha} s²: all must be positive and finite", J.x, J.y, J.z)]
    NotPositive {
        /// Moments over twice the energy \[s²\].
        J: Vector3<f64>,
        /// Squared momentum over four times the squared energy \[s²\].
        alpha: f64,
    },
    /// `alpha` does not lie between `J_y` and `J_z`.
    #[error(
        "J = ({}, {}, {}) s², alpha = {alpha} s²: alpha must lie between J_y and J_z, and J_y between J_x and alpha",
        J.x, J.y, J.z
    )]
    Order {
        /// Moments over twice the energy \[s²\].
        J: Vector3<f64>,
        /// Squared momentum over four times the squared energy \[s²\].
        alpha: f64,
    },
}

impl DynamicParameters {
    /// Parameters in the thesis's order of axes.
    ///
    /// # Errors
    /// [`ParametersError`] if one is not positive, or their order is wrong.
    pub fn new(J: Vector3<f64>, alpha: f64) -> Result<Self, ParametersError> {
        if !(J.iter().chain([&alpha]).all(|x| x.is_finite() && *x > 0.0)) {
            return Err(ParametersError::NotPositive { J, alpha });
        }
        let falling = J.x >= J.y && J.y >= alpha && alpha >= J.z;
        let rising = J.x <= J.y && J.y <= alpha && alpha <= J.z;
        // With an axis of symmetry there is no middle axis: alpha may lie anywhere between the moments.
        let symmetric = J.x == J.y && (alpha - J.z) * (J.x - alpha) >= 0.0;
        if !(falling || rising || symmetric) {
            return Err(ParametersError::Order { J, alpha });
        }
        let gaps = J.map(|j| (j - alpha).abs());
        Ok(Self { J, alpha, gaps })
    }

    /// The parameters of a body with positive principal `moments` (any unit) with angular velocity `w`
    /// (principal axes, not zero), and the indices of the axes that become x, y and z.
    pub(super) fn from_motion(moments: &Vector3<f64>, w: &Vector3<f64>) -> (Self, [usize; 3]) {
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| moments[a].total_cmp(&moments[b]));
        let [low, middle, high] = order;
        // Moments that are equal to rounding are made equal: for a body that turns across its axis of symmetry, a
        // relative difference ε would cause a rate of order √ε.
        let mut moments = *moments;
        for (a, b) in [(low, middle), (middle, high), (low, middle)] {
            if moments[b] - moments[a] <= EQUAL * moments[high] {
                let mean = 0.5 * (moments[a] + moments[b]);
                (moments[a], moments[b]) = (mean, mean);
            }
        }
        let J = moments / moments.dot(&w.component_mul(w));
        let alpha = J.component_mul(w).norm_squared();
        // J - alpha without cancellation, since Σ J w² = 1.
        let term = |i: usize, j: usize| J[j] * (J[i] - J[j]) * w[j] * w[j];
        let gap = |i: usize| {
            let terms = [0, 1, 2].map(|j| term(i, j));
            let sum: f64 = terms.iter().sum();
            let rounding = ROUNDING * terms.iter().map(|t| t.abs()).sum::<f64>();
            if sum.abs() <= rounding { 0.0 } else { sum }
        };
        let z_is_low = if moments[middle] == moments[high] {
            true
        } else {
            moments[low] != moments[middle] && gap(middle) > 0.0
        };
        let axes = if z_is_low {
            [high, middle, low]
        } else {
            [low, middle, high]
        };
        let parameters = Self {
            J: Vector3::from(axes.map(|i| J[i])),
            alpha,
            gaps: Vector3::from(axes.map(|i| gap(i).abs())),
        };
        (parameters, axes)
    }

    /// `J_x, J_y, J_z` \[s²\].
    pub fn J(&self) -> Vector3<f64> {
        self.J
    }

    /// `alpha` \[s²\].
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// Whether two moments are equal, to rounding: z is then the axis of symmetry.
    pub fn is_axisymmetric(&self) -> bool {
        (self.J.x - self.J.y).abs() <= EQUAL * self.J.max()
    }

    /// Whether all moments are equal, to rounding, or z is the axis of rotation: the angular velocity is
    /// then constant.
    pub fn is_single_axis(&self) -> bool {
        self.J.max() - self.J.min() <= EQUAL * self.J.max() || self.gaps.z == 0.0
    }

    /// Squared amplitudes of the three rates: the roots of (2.9).
    pub(super) fn squared_amplitudes(&self) -> Vector3<f64> {
        let J = &self.J;
        let [xz, yz] = [(J.x - J.z).abs(), (J.y - J.z).abs()];
        Vector3::new(
            self.gaps.z / (J.x * xz),
            self.gaps.z / (J.y * yz),
            self.gaps.x / (J.z * xz),
        )
    }

    /// The rate of the elliptic functions' argument \[rad/s\], eqs. (2.10) and (2.14); negative if
    /// `J_x > J_z`.
    pub fn lambda(&self) -> f64 {
        let J = &self.J;
        let squared = (J.y - J.z).abs() * self.gaps.x / (J.x * J.y * J.z);
        squared.sqrt().copysign(J.z - J.x)
    }

    /// The modulus `k`, eq. (2.11), and its complement from the exact difference
    /// `1 - k² = (J_x - J_z)(J_y - alpha) / ((J_y - J_z)(J_x - alpha))`.
    pub fn modulus(&self) -> Modulus {
        if self.is_axisymmetric() {
            return Modulus::new(0.0);
        }
        let J = &self.J;
        let below = (J.y - J.z).abs() * self.gaps.x;
        let k_squared = self.gaps.z * (J.x - J.y).abs() / below;
        let complement = (J.x - J.z).abs() * self.gaps.y / below;
        // Due to rounding they may add up to slightly more than one.
        Modulus::from_squares(k_squared.min(1.0), complement.min(1.0))
    }

    /// `ν = J_z (J_x - J_y) / (J_x (J_y - J_z))`: measure of the variation of the precession rate.
    pub(super) fn unevenness(&self) -> f64 {
        if self.is_axisymmetric() {
            return 0.0;
        }
        let J = &self.J;
        J.z * (J.x - J.y).abs() / (J.x * (J.y - J.z).abs())
    }

    /// Period of `|w|²` \[s\]: `2 K / |lambda|`. The print of (2.31) lacks the absolute value.
    pub fn period(&self) -> f64 {
        2.0 * self.modulus().quarter_period() / self.lambda().abs()
    }

    /// Largest `|w|²` \[rad²/s²\], eq. (2.29).
    pub fn beta(&self) -> f64 {
        (self.J.x + self.J.z - self.alpha) / (self.J.x * self.J.z)
    }

    /// Least `|w|²` \[rad²/s²\], eq. (2.30).
    pub fn gamma(&self) -> f64 {
        (self.J.y + self.J.z - self.alpha) / (self.J.y * self.J.z)
    }
}
