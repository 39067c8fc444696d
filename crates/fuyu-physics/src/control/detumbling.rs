//! Closed forms for stopping a tumbling body, or robot and target together: time, remaining motion, necessary limits.
//!
//! A couple opposed to the angular momentum `L` about the centre of mass reduces the magnitude of `L` and keeps its
//! direction, for any inertia of the body and any motion of its joints. Since `|L|' >= -τ` for every couple of
//! magnitude `τ`, none is faster (M. Athans, P. Falb and R. Lacoss, Time-, fuel-, and energy-optimal control of
//! nonlinear norm-invariant systems, IEEE Trans. Automatic Control 8, 1963). A rigid body then passes through the
//! attitudes of its free motion, ever more slowly ([`Slowdown`]).

use std::f64::consts::FRAC_PI_4;

use nalgebra::{UnitQuaternion, Vector3};

use crate::estimation::elliptic::carlson_rf;

/// An external couple opposed to the angular momentum, as thrusters give it; or the couple with which wheels take up a
/// body's momentum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BrakingCouple {
    /// Constant magnitude \[N m\].
    Constant(f64),
    /// Proportional to the angular momentum, with this gain \[1/s\].
    Proportional(f64),
}

/// State of a rigid body relative to its free motion while a [`BrakingCouple`] acts: its attitude is that of the free
/// motion at `time`, its angular velocity that of the free motion there times `factor`, its kinetic energy the free one
/// times `factor²`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slowdown {
    /// Time of the free motion \[s\].
    pub time: f64,
    /// Angular momentum over that at the start.
    pub factor: f64,
}

impl BrakingCouple {
    /// Time at which a body with angular momentum `momentum` \[N m s\] is at rest \[s\]; infinite for a proportional
    /// couple.
    pub fn duration(self, momentum: f64) -> f64 {
        match self {
            _ if momentum == 0.0 => 0.0,
            Self::Constant(torque) => momentum / torque,
            Self::Proportional(_) => f64::INFINITY,
        }
    }

    /// Progress after `t` \[s\] from angular momentum `momentum` \[N m s\]. A body at rest stays where it is, with factor 0.
    pub fn slowdown(self, momentum: f64, t: f64) -> Slowdown {
        match self {
            _ if momentum == 0.0 => Slowdown {
                time: 0.0,
                factor: 0.0,
            },
            Self::Proportional(0.0) => Slowdown {
                time: t,
                factor: 1.0,
            },
            Self::Constant(torque) => {
                let t = t.min(self.duration(momentum));
                Slowdown {
                    time: t - torque * t * t / (2.0 * momentum),
                    factor: (1.0 - torque * t / momentum).max(0.0),
                }
            }
            Self::Proportional(gain) => Slowdown {
                time: -(-gain * t).exp_m1() / gain,
                factor: (-gain * t).exp(),
            },
        }
    }
}

/// Bounds of the angular momentum \[N m s\] of a rigid body under the couple `-D ω`, `t` \[s\] after it was `momentum`;
/// `moments` are the principal moments. The lower bound is reached in rotation about the axis of the smallest moment,
/// the upper one about that of the largest.
pub fn damped_momentum(momentum: f64, damping: f64, moments: &Vector3<f64>, t: f64) -> (f64, f64) {
    let after = |moment: f64| momentum * (-damping * t / moment).exp();
    (after(moments.min()), after(moments.max()))
}

/// Bounds of the time \[s\] in which limited couples about three axes of the body stop it, if each opposes the angular
/// momentum's component along its axis.
pub fn time_with_body_limits(momentum: f64, limits: &Vector3<f64>) -> (f64, f64) {
    (momentum / limits.norm(), momentum / limits.min())
}

/// The exact time for couples about three inertially fixed axes.
pub fn time_with_inertial_limits(momentum: &Vector3<f64>, limits: &Vector3<f64>) -> f64 {
    momentum.abs().component_div(limits).max()
}

/// Momentum \[N m s\] of reaction wheels, body axes, when they have changed the body's angular momentum to
/// `body_momentum` (body axes); `total` is the total in inertial axes, which they do not change. Wheels move momentum;
/// only external couples remove it.
pub fn wheel_momentum(
    total: &Vector3<f64>,
    R_WB: &UnitQuaternion<f64>,
    body_momentum: &Vector3<f64>,
) -> Vector3<f64> {
    R_WB.inverse_transform_vector(total) - body_momentum
}

/// Largest total torque \[N m\] that the motors of wheels with momentum `wheels` need to take momentum from a body at
/// the rate `torque`: they also turn the wheels' momentum with the body.
pub fn wheel_motor_torque(torque: f64, w: &Vector3<f64>, wheels: &Vector3<f64>) -> f64 {
    torque + w.norm() * wheels.norm()
}

/// A target that is stopped in a plane by a force of limited size at its grasp point, which stays in place: the force
/// both slows the rotation and holds the centre of mass on its circle, `ω'² + ω⁴ <= A²`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GraspForceLimit {
    /// Mass of the target \[kg\].
    pub mass: f64,
    /// Distance of the target's centre of mass from the grasp point \[m\].
    pub radius: f64,
    /// Largest force \[N\].
    pub force: f64,
}

impl GraspForceLimit {
    /// `A = F / (m r)` \[rad/s²\].
    fn acceleration(&self) -> f64 {
        self.force / (self.mass * self.radius)
    }

    /// The fastest rotation that the force can hold \[rad/s\].
    pub fn holdable_rate(&self) -> f64 {
        self.acceleration().sqrt()
    }

    /// Shortest time to rest from `rate` \[s\], `F(arcsin(ω/√A) | -1) / √A`; NaN beyond [`Self::holdable_rate`].
    pub fn time(&self, rate: f64) -> f64 {
        let fastest = self.holdable_rate();
        let sin = rate / fastest;
        let square = sin * sin;
        // F(φ | m) = sin φ R_F(cos² φ, 1 - m sin² φ, 1), DLMF 19.25.5.
        match 1.0 - square {
            left if left > -1e-12 => sin * carlson_rf(left.max(0.0), 1.0 + square, 1.0) / fastest,
            _ => f64::NAN,
        }
    }

    /// Angle until rest \[rad\].
    pub fn angle(&self, rate: f64) -> f64 {
        let sin = rate * rate / self.acceleration();
        if (1.0..=1.0 + 1e-12).contains(&sin) {
            FRAC_PI_4
        } else {
            0.5 * sin.asin()
        }
    }
}

/// A joint between base and target that brakes their relative rotation in a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointBrake {
    /// Moment of inertia of the base about its centre of mass \[kg m²\].
    pub base: f64,
    /// Moment of inertia of the target about its centre of mass \[kg m²\].
    pub target: f64,
}

impl JointBrake {
    /// Inertia of the relative rotation \[kg m²\].
    pub fn reduced_inertia(&self) -> f64 {
        self.base * self.target / (self.base + self.target)
    }

    /// Time \[s\] and angle \[rad\] in which a constant torque stops a relative rotation at `rate`.
    pub fn constant_torque(&self, rate: f64, torque: f64) -> (f64, f64) {
        let inertia = self.reduced_inertia();
        (
            rate * inertia / torque,
            rate * rate * inertia / (2.0 * torque),
        )
    }

    /// Time constant \[s\] and angle \[rad\] in which a damper \[N m s/rad\] stops the relative rotation.
    pub fn damper(&self, rate: f64, damping: f64) -> (f64, f64) {
        let inertia = self.reduced_inertia();
        (inertia / damping, rate * inertia / damping)
    }

    /// Energy dissipated in either case \[J\].
    pub fn dissipated(&self, rate: f64) -> f64 {
        0.5 * self.reduced_inertia() * rate * rate
    }

    /// Final rate of both bodies \[rad/s\], from their total angular momentum \[N m s\].
    pub fn common_rate(&self, momentum: f64) -> f64 {
        momentum / (self.base + self.target)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Both results were zero divided by zero.
    #[test]
    fn a_body_at_rest_and_a_couple_of_zero_change_nothing() {
        let at_rest = Slowdown {
            time: 0.0,
            factor: 0.0,
        };
        let free = Slowdown {
            time: 3.0,
            factor: 1.0,
        };
        for couple in [BrakingCouple::Constant, BrakingCouple::Proportional] {
            for size in [0.0, 2.0] {
                assert_eq!(couple(size).slowdown(0.0, 3.0), at_rest);
                assert_eq!(couple(size).duration(0.0), 0.0);
            }
            assert_eq!(couple(0.0).slowdown(5.0, 3.0), free);
        }
    }

    // F(π/2 | -1) = 1.3110287771461 (half of the lemniscate constant).
    #[test]
    fn the_time_at_the_limit_of_the_force_is_lemniscatic() {
        let limit = GraspForceLimit {
            mass: 2.0,
            radius: 0.5,
            force: 4.0,
        };
        let fastest = limit.holdable_rate();
        let time = limit.time(fastest);
        assert!((time - 1.311_028_777_146_1 / 2.0).abs() < 1e-12, "{time}");
        assert!(limit.time(1.01 * fastest).is_nan());
    }
}
