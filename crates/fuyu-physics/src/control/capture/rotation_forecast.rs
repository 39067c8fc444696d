//! A forecast of the rotation of a free body.

use nalgebra::{UnitQuaternion, Vector3};

use crate::spatial::exp_so3;

/// Attitudes `R_IF` of axes fixed to the target, at equal intervals.
#[derive(Debug, Clone, PartialEq)]
pub struct RotationForecast {
    /// Time of the first attitude \[s\].
    pub start: f64,
    /// Interval \[s\].
    pub period: f64,
    /// The attitudes; at least three.
    pub attitudes: Vec<UnitQuaternion<f64>>,
}

impl RotationForecast {
    /// Time of the last attitude \[s\].
    pub fn end(&self) -> f64 {
        self.start + self.period * (self.attitudes.len() - 1) as f64
    }

    /// Whether the forecast covers `time` \[s\]; it extends one interval beyond the end.
    pub fn covers(&self, time: f64) -> bool {
        time >= self.start - 1e-6 && time <= self.end() + self.period
    }

    /// Attitude, angular velocity \[rad/s\] and angular acceleration \[rad/s²\] (axes of I) at `time` \[s\]: the parabola of
    /// rotation vectors through the three nearest attitudes.
    ///
    /// # Panics
    /// If there are fewer than three attitudes.
    pub fn at(&self, time: f64) -> (UnitQuaternion<f64>, Vector3<f64>, Vector3<f64>) {
        let last = self.attitudes.len() - 2;
        let k = ((time - self.start) / self.period).round().max(1.0) as usize;
        let k = k.min(last);
        let (before, at, after) = (
            &self.attitudes[k - 1],
            &self.attitudes[k],
            &self.attitudes[k + 1],
        );
        let T = self.period;
        let (u0, u2) = (
            (at.inverse() * before).scaled_axis(),
            (at.inverse() * after).scaled_axis(),
        );
        let (first, second) = ((u2 - u0) / (2.0 * T), (u2 + u0) / (T * T));
        let t = time - (self.start + T * k as f64);
        let u = first * t + second * (0.5 * t * t);
        let du = first + second * t;
        // Right Jacobian of the exponential map to second order: w = u' - u × u' / 2 + u × (u × u') / 6.
        let w = du - u.cross(&du) * 0.5 + u.cross(&u.cross(&du)) / 6.0;
        let alpha = second - u.cross(&second) * 0.5
            + (du.cross(&u.cross(&du)) + u.cross(&u.cross(&second))) / 6.0;
        let R = at * exp_so3(&u);
        (R, R * w, R * alpha)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::capture::fixtures::{tumbling, within};

    // Compares with a free body in the elliptic closed form of estimation, which is independent of the parabola.
    #[test]
    fn a_forecast_is_interpolated_with_its_derivatives() {
        let body = tumbling();
        let forecast = RotationForecast {
            start: 3.0,
            period: 0.2,
            attitudes: (0..60)
                .map(|k| body.attitude(3.0 + 0.2 * f64::from(k)))
                .collect(),
        };
        for t in [3.0, 5.13, 9.9, 14.7] {
            let (R, w, alpha) = forecast.at(t);
            let h = 1e-4;
            let truth = (body.angular_velocity(t + h) - body.angular_velocity(t - h)) / (2.0 * h);
            // Third derivatives, of w³, times the interval cubed.
            assert!(R.angle_to(&body.attitude(t)) < 1e-5, "{t}");
            within(&w, &body.angular_velocity(t), 1e-4);
            within(&alpha, &truth, 2e-3);
        }
    }
}
