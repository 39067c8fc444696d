//! Polhode and herpolhode: the path of the angular velocity in the body and in space. Masutani 1995
//! sec. 2.3.5. The print calls the herpolhode the path of the angular momentum, which is constant.

use nalgebra::Vector3;

use super::DynamicParameters;

/// Polar coordinates of the angular velocity on the invariable plane, about the momentum's direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Herpolhode {
    /// Distance ρ from the momentum's direction \[rad/s\], (2.24).
    pub radius: f64,
    /// Rate χ' of the angle about the momentum \[rad/s\], (2.25).
    pub angle_rate: f64,
}

impl DynamicParameters {
    /// Point of the invariable plane that belongs to the angular velocity `w` (principal axes, \[rad/s\]), a point of the
    /// polhode. At the plane's centre, where the angle is undefined, its rate is infinite or NaN.
    pub fn herpolhode(&self, w: &Vector3<f64>) -> Herpolhode {
        let (J, alpha) = (self.J(), self.alpha());
        // ρ = |L × w| / |L|: the difference of (2.24) loses digits near the centre.
        let radius = J.component_mul(w).cross(w).norm() / alpha.sqrt();
        let gaps = (J.x - alpha) * (J.y - alpha) * (J.z - alpha);
        let product = J.x * J.y * J.z * alpha * radius * radius;
        Herpolhode {
            radius,
            angle_rate: (1.0 + gaps / product) / alpha.sqrt(),
        }
    }
}
