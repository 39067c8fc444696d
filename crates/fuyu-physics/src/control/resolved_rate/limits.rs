//! Limits of commanded tip twists and joint rates.

use nalgebra::DVector;

use crate::{model::Model, spatial::Twist};

/// Scales a twist to at most `linear` \[m/s\] and `angular` \[rad/s\], without changing its direction. Returns whether it
/// was scaled.
pub fn limit_twist(V: &Twist, linear: f64, angular: f64) -> (Twist, bool) {
    let part = |norm: f64, limit: f64| if norm > limit { limit / norm } else { 1.0 };
    let factor = part(V.linear.norm(), linear).min(part(V.angular.norm(), angular));
    let shorter = Twist::new(V.angular * factor, V.linear * factor);
    (shorter, factor < 1.0)
}

/// Limits of the joints' motion. Limits of rate and position scale the whole vector of rates, so that the tip slows
/// down but keeps its direction. The acceleration limit moves from the last rates towards the new ones; it may be
/// exceeded close to a position limit.
#[derive(Debug, Clone, PartialEq)]
pub struct RateLimits {
    /// Largest rate of each joint \[rad/s or m/s\].
    pub rate: Vec<f64>,
    /// Largest change of any joint's rate \[rad/s² or m/s²\].
    pub acceleration: f64,
    /// Time constant with which a joint approaches its position limit \[s\].
    pub slow_down: f64,
}

/// Which limits reduced a vector of rates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Limited {
    /// The joint whose rate limit acted.
    pub rate: Option<usize>,
    /// The joint whose position limit acted.
    pub position: Option<usize>,
}

impl RateLimits {
    /// The limits of `model`'s joints, with rates of at most `rate`.
    pub fn new(model: &Model, rate: f64, acceleration: f64) -> Self {
        let joints = model.joints().iter();
        Self {
            rate: joints.map(|j| j.limits.velocity.min(rate)).collect(),
            acceleration,
            slow_down: 0.5,
        }
    }

    /// Limits the commanded `rates` at the joint positions `q`, `dt` \[s\] after the rates `before`.
    pub fn apply(
        &self,
        model: &Model,
        q: &DVector<f64>,
        before: &DVector<f64>,
        dt: f64,
        rates: &mut DVector<f64>,
    ) -> Limited {
        let mut limited = Limited::default();
        let mut factor = 1.0;
        for (j, (rate, limit)) in rates.iter().zip(&self.rate).enumerate() {
            if rate.abs() * factor > *limit {
                (factor, limited.rate) = (limit / rate.abs(), Some(j));
            }
        }
        *rates *= factor;
        let step = self.acceleration * dt;
        let changes = rates.iter().zip(before.iter()).map(|(r, b)| (r - b).abs());
        let largest = changes.fold(0.0, f64::max);
        if largest > step {
            let part = step / largest;
            rates.zip_apply(before, |rate, before| {
                *rate = before + (*rate - before) * part;
            });
        }
        let mut factor = 1.0;
        for (j, (joint, rate)) in model.joints().iter().zip(rates.iter()).enumerate() {
            let room = match *rate > 0.0 {
                true => joint.limits.upper - q[j],
                false => q[j] - joint.limits.lower,
            };
            let allowed = room.max(0.0) / self.slow_down;
            if rate.abs() * factor > allowed {
                (factor, limited.position) = (allowed / rate.abs(), Some(j));
            }
        }
        *rates *= factor;
        limited
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn model(limits: &str) -> Model {
        let xml = include_str!("../../../../../urdf/planar_two_link.urdf");
        let joint2 = "<joint name=\"joint2\" type=\"continuous\">";
        let limited = format!("<joint name=\"joint2\" type=\"revolute\">{limits}");
        assert!(xml.contains(joint2));
        Model::from_urdf(&xml.replace(joint2, &limited), "planar").unwrap()
    }

    const LIMIT: &str = "<limit lower=\"-1\" upper=\"1\" velocity=\"0.4\" effort=\"100\"/>";

    #[test]
    fn a_twist_that_is_too_long_keeps_its_direction() {
        let V = Twist::new(Vector3::new(0.0, 0.0, 0.1), Vector3::new(3.0, 4.0, 0.0));
        let (limited, cut) = limit_twist(&V, 0.5, 1.0);
        assert!(cut && (limited.linear - V.linear * 0.1).norm() < 1e-15);
        assert!((limited.angular - V.angular * 0.1).norm() < 1e-15);
        assert_eq!(limit_twist(&V, 5.0, 1.0), (V, false));
    }

    // Limits that act on each joint separately would change the ratio.
    #[test]
    fn joints_slow_down_together() {
        let model = model(LIMIT);
        let limits = RateLimits::new(&model, 1.0, 1e9);
        assert_eq!(limits.rate, [1.0, 0.4]);
        let (rest, mut rates) = (DVector::zeros(2), DVector::from_row_slice(&[1.2, 0.8]));
        let limited = limits.apply(&model, &rest, &rest, 0.1, &mut rates);
        assert_eq!(limited.rate, Some(1));
        assert!((rates - DVector::from_row_slice(&[0.6, 0.4])).norm() < 1e-15);
    }

    #[test]
    fn rates_change_no_faster_than_they_may() {
        let model = model(LIMIT);
        let limits = RateLimits::new(&model, 1.0, 2.0);
        let before = DVector::from_row_slice(&[0.1, -0.1]);
        let mut rates = DVector::from_row_slice(&[-0.9, 0.1]);
        limits.apply(&model, &DVector::zeros(2), &before, 0.1, &mut rates);
        assert!((rates - DVector::from_row_slice(&[-0.1, -0.06])).norm() < 1e-15);
    }

    // The position limit has priority: applied after it, the acceleration limit would violate it.
    #[test]
    fn position_limits_come_before_the_acceleration() {
        let model = model(LIMIT);
        let limits = RateLimits::new(&model, 1.0, 0.5);
        let before = DVector::from_row_slice(&[0.2, 0.4]);
        let mut rates = DVector::from_row_slice(&[0.2, 0.4]);
        let q = DVector::from_row_slice(&[0.0, 0.95]);
        let limited = limits.apply(&model, &q, &before, 0.1, &mut rates);
        assert_eq!(limited.position, Some(1));
        assert!((rates - DVector::from_row_slice(&[0.05, 0.1])).norm() < 1e-12);
        // Away from it, only the acceleration limit acts.
        let mut rates = DVector::from_row_slice(&[0.0, -0.4]);
        let limited = limits.apply(&model, &q, &DVector::zeros(2), 0.1, &mut rates);
        assert_eq!(limited.position, None);
        assert!((rates - DVector::from_row_slice(&[0.0, -0.05])).norm() < 1e-12);
    }

    #[test]
    fn a_joint_comes_to_rest_at_its_limit_and_may_leave_it() {
        let model = model(LIMIT);
        let limits = RateLimits::new(&model, 1.0, 1e9);
        let mut q = DVector::from_row_slice(&[0.0, 0.9]);
        let dt = 0.01;
        for _ in 0..2000 {
            let mut rates = DVector::from_row_slice(&[0.2, 0.3]);
            let limited = limits.apply(&model, &q, &DVector::zeros(2), dt, &mut rates);
            assert_eq!(limited.position.is_some(), rates[1] < 0.3);
            q += rates * dt;
        }
        assert!(q[1] <= 1.0 && q[1] > 1.0 - 1e-6, "{q}");
        q[1] = 1.1;
        let mut back = DVector::from_row_slice(&[0.0, -0.3]);
        let limited = limits.apply(&model, &q, &DVector::zeros(2), dt, &mut back);
        assert_eq!((back[1], limited.position), (-0.3, None));
    }
}
