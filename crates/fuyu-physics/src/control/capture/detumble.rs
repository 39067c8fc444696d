//! Detumbling: a couple that takes the angular momentum of robot and target, within the limits of thrusters, wheels
//! and grasp.
//!
//! The couple opposes the angular momentum about the common centre of mass (closed forms in
//! [`control::detumbling`](crate::control::detumbling)). Wheels take their share first, as far as torque and capacity
//! reach, since they need no propellant; thrusters give the rest. The whole is made smaller until the wrench that
//! it causes at the grasp is within its limits: that wrench is linear in the couple.

use nalgebra::{Matrix3, Vector3};

use crate::spatial::{RigidInertia, Wrench};

/// Reaction wheels about three orthogonal axes of the base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelLimits {
    /// Largest torque of each motor \[N m\].
    pub torque: f64,
    /// Largest momentum of each wheel \[N m s\].
    pub momentum: f64,
}

/// Limits of the actuators and of the grasp in detumbling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetumbleLimits {
    /// Largest couple of the thrusters \[N m\].
    pub couple: f64,
    /// Wheels, if there are any.
    pub wheels: Option<WheelLimits>,
    /// Largest force at the grasp \[N\].
    pub grasp_force: f64,
    /// Largest torque there \[N m\].
    pub grasp_torque: f64,
}

impl Default for DetumbleLimits {
    fn default() -> Self {
        Self {
            couple: 10.0,
            wheels: None,
            grasp_force: 50.0,
            grasp_torque: 50.0,
        }
    }
}

/// A couple, divided by actuators; base axes \[N m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedCouple {
    /// By thrusters: it removes momentum from the whole.
    pub thrusters: Vector3<f64>,
    /// By wheels: it moves momentum into them. Their motors give the opposite.
    pub wheels: Vector3<f64>,
    /// Which part of the couple asked for this is, because of the limits at the grasp.
    pub scale: f64,
    /// The wrench on the target at the grasp that follows, base axes.
    pub grasp: Wrench,
}

/// Robot and target as one body at one time; base axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stack {
    /// Inertia of everything about the common centre of mass \[kg m²\].
    pub inertia: Matrix3<f64>,
    /// The common centre of mass \[m\].
    pub com: Vector3<f64>,
    /// The target: mass, centre of mass and inertia about it.
    pub target: RigidInertia,
    /// The grasp's position \[m\].
    pub grasp: Vector3<f64>,
}

impl Stack {
    /// The wrench on the target at the grasp while the stack turns at `w` \[rad/s\] and a `couple` \[N m\] acts on the
    /// base, as of one rigid body.
    pub fn grasp_wrench(&self, w: &Vector3<f64>, couple: &Vector3<f64>) -> Wrench {
        let inverse = self.inertia.try_inverse().unwrap_or_else(Matrix3::zeros);
        let alpha = inverse * (couple - w.cross(&(self.inertia * w)));
        let r = self.target.com - self.com;
        let force = (alpha.cross(&r) + w.cross(&w.cross(&r))) * self.target.mass;
        let about = self.target.about_com;
        let torque =
            about * alpha + w.cross(&(about * w)) + (self.target.com - self.grasp).cross(&force);
        Wrench::new(torque, force)
    }

    /// The largest part of `couple`, up to 1, with which the wrench at the grasp is within limits; zero if the rotation
    /// alone exceeds them and no couple helps.
    pub fn grasp_scale(
        &self,
        w: &Vector3<f64>,
        couple: &Vector3<f64>,
        limits: &DetumbleLimits,
    ) -> f64 {
        let (at_rest, full) = (
            self.grasp_wrench(w, &Vector3::zeros()),
            self.grasp_wrench(w, couple),
        );
        let of_force = largest_part(&at_rest.force, &full.force, limits.grasp_force);
        of_force.min(largest_part(
            &at_rest.torque,
            &full.torque,
            limits.grasp_torque,
        ))
    }
}

/// The largest `s` up to 1 with `|a + s (b - a)| <= limit`. Where `a` is beyond the limit already, the `s` that comes
/// closest to it.
fn largest_part(a: &Vector3<f64>, b: &Vector3<f64>, limit: f64) -> f64 {
    if b.norm() <= limit {
        return 1.0;
    }
    let d = b - a;
    let (dd, ad, aa) = (d.norm_squared(), a.dot(&d), a.norm_squared());
    let discriminant = ad * ad - dd * (aa - limit * limit);
    let s = match discriminant >= 0.0 {
        true => (-ad + discriminant.sqrt()) / dd,
        false => -ad / dd,
    };
    s.clamp(0.0, 1.0)
}

/// Shares the couple that opposes the angular momentum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detumbler {
    limits: DetumbleLimits,
    /// Time constant of the end, in which the couple is proportional to the momentum \[s\].
    pub time_constant: f64,
}

impl Detumbler {
    /// With limits; the couple becomes proportional once it would stop the rest within `time_constant` \[s\].
    pub fn new(limits: DetumbleLimits, time_constant: f64) -> Self {
        Self {
            limits,
            time_constant,
        }
    }

    /// The couple for the stack that turns at `w` (base axes) with the angular momentum `momentum` of its bodies
    /// without wheels, which have `wheels` \[N m s\].
    pub fn couple(
        &self,
        stack: &Stack,
        w: &Vector3<f64>,
        momentum: &Vector3<f64>,
        wheels: &Vector3<f64>,
    ) -> SharedCouple {
        let size = momentum.norm();
        let available = self.limits.couple + self.wheel_torque();
        let asked = match size > 0.0 {
            true => -momentum * ((size / self.time_constant).min(available) / size),
            false => Vector3::zeros(),
        };
        let by_wheels = self.wheel_share(&asked, w, wheels);
        let mut rest = asked - by_wheels;
        if rest.norm() > self.limits.couple {
            rest *= self.limits.couple / rest.norm();
        }
        let whole = by_wheels + rest;
        let scale = stack.grasp_scale(w, &whole, &self.limits);
        SharedCouple {
            thrusters: rest * scale,
            wheels: by_wheels * scale,
            scale,
            grasp: stack.grasp_wrench(w, &(whole * scale)),
        }
    }

    fn wheel_torque(&self) -> f64 {
        self.limits.wheels.map_or(0.0, |w| w.torque)
    }

    /// What of the couple `asked` wheels can give now: the rate of their momentum is `-τ - ω × h`, its opposite the motors'
    /// torque, limited about each axis. The part is the largest with which no full wheel takes more. Where `-ω × h` alone
    /// fills a full one and no part is enough against it, the wheels keep their speeds: their couple is then `-ω × h`, not a
    /// part of `asked`.
    fn wheel_share(
        &self,
        asked: &Vector3<f64>,
        w: &Vector3<f64>,
        momentum: &Vector3<f64>,
    ) -> Vector3<f64> {
        let Some(limits) = self.limits.wheels else {
            return Vector3::zeros();
        };
        let carried = w.cross(momentum);
        // h' = -s τ - ω × h; the part s from `least` to `share`.
        let (mut least, mut share) = (0.0_f64, 1.0_f64);
        for i in 0..3 {
            let (of_couple, own) = (-asked[i], -carried[i]);
            if of_couple != 0.0 {
                let room = match of_couple > 0.0 {
                    true => limits.torque - own,
                    false => limits.torque + own,
                };
                share = share.min((room / of_couple.abs()).clamp(0.0, 1.0));
            }
            if momentum[i].abs() < limits.momentum {
                continue;
            }
            // Of a full wheel, both along its momentum: together they must not be positive.
            let (of_couple, own) = (of_couple * momentum[i], own * momentum[i]);
            if of_couple > 0.0 {
                share = share.min(-own / of_couple);
            } else if own > 0.0 {
                least = least.max(own / of_couple.abs());
            }
        }
        match least <= share {
            true => asked * share,
            false => -carried,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::detumbling::BrakingCouple;
    use crate::spatial::exp_so3;
    use nalgebra::UnitQuaternion;

    fn stack() -> Stack {
        Stack {
            inertia: Matrix3::new(900.0, 20.0, -10.0, 20.0, 1200.0, 30.0, -10.0, 30.0, 1500.0),
            com: Vector3::new(0.1, 0.3, 0.0),
            target: RigidInertia {
                mass: 300.0,
                com: Vector3::new(0.5, 3.0, 0.2),
                about_com: Matrix3::from_diagonal(&Vector3::new(90.0, 120.0, 100.0)),
            },
            grasp: Vector3::new(0.4, 2.1, 0.0),
        }
    }

    /// Integrates robot and target with wheels by small midpoint steps; returns the momentum after `duration`.
    fn run(
        detumbler: &Detumbler,
        w: Vector3<f64>,
        duration: f64,
    ) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>, f64) {
        let stack = stack();
        let inverse = stack.inertia.try_inverse().unwrap();
        let (mut w, mut h) = (w, Vector3::zeros());
        let mut R = UnitQuaternion::identity();
        let steps = 20_000;
        let dt = duration / f64::from(steps);
        let mut largest = 0.0_f64;
        for _ in 0..steps {
            let rates = |w: &Vector3<f64>, h: &Vector3<f64>| {
                let momentum = stack.inertia * w;
                let shared = detumbler.couple(&stack, w, &momentum, h);
                let couple = shared.thrusters + shared.wheels;
                let dw = inverse * (couple - w.cross(&momentum));
                (dw, -shared.wheels - w.cross(h), shared)
            };
            let (dw, dh, shared) = rates(&w, &h);
            largest = largest.max(shared.grasp.force.norm());
            let (mid_w, mid_h) = (w + dw * (0.5 * dt), h + dh * (0.5 * dt));
            let (dw, dh, _) = rates(&mid_w, &mid_h);
            R *= exp_so3(&(mid_w * dt));
            w += dw * dt;
            h += dh * dt;
        }
        (w, h, R * (stack.inertia * w + h), largest)
    }

    // Closed form A: the constant couple stops the stack in |L| / τ; halfway, half of the momentum is left.
    #[test]
    fn thrusters_stop_the_stack_in_the_time_of_the_closed_form() {
        let limits = DetumbleLimits {
            couple: 8.0,
            grasp_force: 1e3,
            grasp_torque: 1e3,
            wheels: None,
        };
        let w = Vector3::new(0.02, -0.03, 0.04);
        let momentum = (stack().inertia * w).norm();
        let detumbler = Detumbler::new(limits, 1e-3);
        let duration = BrakingCouple::Constant(limits.couple).duration(momentum);
        let (_, _, left, _) = run(&detumbler, w, 0.5 * duration);
        assert!((left.norm() - 0.5 * momentum).abs() < 1e-6 * momentum);
        let (w, ..) = run(&detumbler, w, 1.01 * duration);
        assert!(w.norm() < 1e-5, "{w}");
    }

    // Closed form F: wheels move momentum and remove none. Afterwards they have all of it, in the axes of the base.
    #[test]
    fn wheels_take_the_momentum_and_the_whole_keeps_it() {
        let wheels = WheelLimits {
            torque: 2.0,
            momentum: 200.0,
        };
        let limits = DetumbleLimits {
            couple: 0.0,
            grasp_force: 1e3,
            grasp_torque: 1e3,
            wheels: Some(wheels),
        };
        let w = Vector3::new(0.01, -0.015, 0.02);
        let total = stack().inertia * w;
        let detumbler = Detumbler::new(limits, 5.0);
        let (w, h, after, _) = run(&detumbler, w, 150.0);
        assert!(w.norm() < 1e-6, "{w}");
        assert!((h.norm() - total.norm()).abs() < 1e-5 * total.norm());
        assert!(
            (after - total).norm() < 1e-5 * total.norm(),
            "{after} {total}"
        );
    }

    // Wheels that are too small fill up; thrusters remove the rest.
    #[test]
    fn thrusters_take_what_wheels_cannot() {
        let limits = DetumbleLimits {
            couple: 3.0,
            grasp_force: 1e3,
            grasp_torque: 1e3,
            wheels: Some(WheelLimits {
                torque: 1.0,
                momentum: 4.0,
            }),
        };
        let detumbler = Detumbler::new(limits, 5.0);
        let (w, h, ..) = run(&detumbler, Vector3::new(0.01, -0.015, 0.02), 150.0);
        assert!(w.norm() < 1e-5 && h.amax() < 4.0 + 0.05, "{w} {h}");
    }

    // No part of the couple can both stay within the torque about y and unload the full wheel about x, which -ω × h fills:
    // checks axis by axis let it take 0.14 N m. The other cases have a part, by hand.
    #[test]
    fn a_full_wheel_takes_no_more() {
        let limits = DetumbleLimits {
            couple: 3.0,
            grasp_force: 1e3,
            grasp_torque: 1e3,
            wheels: Some(WheelLimits {
                torque: 1.0,
                momentum: 10.0,
            }),
        };
        let detumbler = Detumbler::new(limits, 5.0);
        let rate = |asked: [f64; 3], w: [f64; 3], h: [f64; 3]| {
            let [asked, w, h] = [asked, w, h].map(Vector3::from);
            let given = detumbler.wheel_share(&asked, &w, &h);
            (given, -given - w.cross(&h))
        };
        let (w, h) = ([0.0, -0.05, 0.0], [10.0, 0.0, 4.0]);
        let (_, kept) = rate([0.3, 5.0, 0.0], w, h);
        assert_eq!(kept, Vector3::zeros());
        // Nothing asked about the full axis, which turns either way.
        for h in [h, [-10.0, 0.0, -4.0]] {
            let (_, kept) = rate([0.0, 0.5, 0.0], w, h);
            assert_eq!(kept, Vector3::zeros());
        }
        // The couple unloads the full wheel by as much as it takes.
        let (given, change) = rate([0.3, 0.5, 0.0], w, h);
        assert_eq!(given, Vector3::new(0.3, 0.5, 0.0));
        assert!((change.x + 0.1).abs() < 1e-12, "{change}");
        // -ω × h unloads it by 0.2 N m, the couple fills it with 0.4 N m: half of it is possible.
        let (given, change) = rate([-0.4, 0.0, 0.0], [0.0, 0.05, 0.0], h);
        assert!((given.x + 0.2).abs() < 1e-12 && change.x.abs() < 1e-12);
    }

    // The wrench by differentiating the target's momentum along the motion.
    #[test]
    fn the_wrench_at_the_grasp_is_the_change_of_the_targets_momentum() {
        let stack = stack();
        let (w, couple) = (
            Vector3::new(0.03, -0.05, 0.02),
            Vector3::new(3.0, -1.0, 2.0),
        );
        let inverse = stack.inertia.try_inverse().unwrap();
        let momenta = |t: f64| {
            // Attitude and rate to second order.
            let alpha = inverse * (couple - w.cross(&(stack.inertia * w)));
            let R = exp_so3(&(w * t + alpha * (0.5 * t * t)));
            let w = w + alpha * t;
            let r = stack.target.com - stack.com;
            let linear = R * (w.cross(&r) * stack.target.mass);
            let at = R * r;
            (linear, R * (stack.target.about_com * w) + at.cross(&linear))
        };
        let h = 1e-4;
        let (a, b) = (momenta(-h), momenta(h));
        let (force, torque) = ((b.0 - a.0) / (2.0 * h), (b.1 - a.1) / (2.0 * h));
        let found = stack.grasp_wrench(&w, &couple);
        assert!(
            (found.force - force).norm() < 1e-5,
            "{} {force}",
            found.force
        );
        let about_grasp = torque - (stack.grasp - stack.com).cross(&force);
        assert!((found.torque - about_grasp).norm() < 1e-5);
    }

    #[test]
    fn the_couple_is_cut_to_the_limit_at_the_grasp() {
        let limits = DetumbleLimits {
            couple: 50.0,
            grasp_force: 10.0,
            grasp_torque: 100.0,
            wheels: None,
        };
        let w = Vector3::new(0.02, -0.03, 0.04);
        let (stack, detumbler) = (stack(), Detumbler::new(limits, 3.0));
        let shared = detumbler.couple(&stack, &w, &(stack.inertia * w), &Vector3::zeros());
        assert!(shared.scale < 1.0);
        assert!(
            (shared.grasp.force.norm() - 10.0).abs() < 1e-9,
            "{shared:?}"
        );
        let (left, _, _, largest) = run(&detumbler, w, 600.0);
        assert!(
            left.norm() < 1e-5 && largest < 10.0 + 1e-9,
            "{left} {largest}"
        );
    }
}
