//! Detumbling: a couple that reduces the angular momentum of robot and target, within the limits of thrusters, wheels
//! and grasp.
//!
//! The couple opposes the angular momentum about the common centre of mass (closed forms in
//! [`control::detumbling`](crate::control::detumbling)). Wheels take their part first, as far as torque and capacity
//! allow, since they need no propellant; thrusters give the rest. The whole couple is reduced until the resulting wrench at
//! the grasp is within its limits: that wrench is linear in the couple.

use nalgebra::{Matrix3, Vector3};

use crate::control::attitude::WheelAllocator;
use crate::spatial::{RigidInertia, Wrench};

/// Limits of the actuators and of the grasp in detumbling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetumbleLimits {
    /// Largest couple of the thrusters \[N m\].
    pub couple: f64,
    /// Largest force at the grasp \[N\].
    pub grasp_force: f64,
    /// Largest torque at the grasp \[N m\].
    pub grasp_torque: f64,
}

impl Default for DetumbleLimits {
    fn default() -> Self {
        Self {
            couple: 10.0,
            grasp_force: 50.0,
            grasp_torque: 50.0,
        }
    }
}

/// A couple, divided between the actuators; base axes \[N m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedCouple {
    /// Couple of the thrusters: it removes momentum from robot and target.
    pub thrusters: Vector3<f64>,
    /// Couple of the wheels: it moves momentum into them. Their motors give this couple plus the couple `ω × h` that
    /// turns their momentum with the base.
    pub wheels: Vector3<f64>,
    /// Fraction of the requested couple that the limits at the grasp allow.
    pub scale: f64,
    /// Resulting wrench on the target at the grasp, base axes.
    pub grasp: Wrench,
}

/// Robot and target as one rigid body at one time; base axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stack {
    /// Inertia of robot and target about the common centre of mass \[kg m²\].
    pub inertia: Matrix3<f64>,
    /// The common centre of mass \[m\].
    pub com: Vector3<f64>,
    /// The target: mass, centre of mass and inertia about it.
    pub target: RigidInertia,
    /// The grasp's position \[m\].
    pub grasp: Vector3<f64>,
}

impl Stack {
    /// The wrench on the target at the grasp while the stack rotates at `w` \[rad/s\] as one rigid body and a `couple`
    /// \[N m\] acts on the base.
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

    /// The largest fraction of `couple`, up to 1, for which the wrench at the grasp is within limits; zero if the
    /// rotation alone exceeds them and no couple helps.
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

/// The largest `s` up to 1 with `|a + s (b - a)| <= limit`. If `a` is beyond the limit, the `s` that comes closest to
/// it.
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

/// Time for which the limits of the wheels must hold \[s\]: a few periods of control.
const WHEEL_PERIOD: f64 = 0.1;

/// Computes the couple that opposes the angular momentum, and divides it between the actuators.
#[derive(Debug, Clone)]
pub struct Detumbler {
    limits: DetumbleLimits,
    /// Time constant of the final phase, in which the couple is proportional to the momentum \[s\].
    time_constant: f64,
    wheels: Option<WheelAllocator>,
}

impl Detumbler {
    /// A detumbler with these limits. The couple becomes proportional to the momentum when a constant one would stop
    /// the rotation within `time_constant` \[s\].
    pub fn new(limits: DetumbleLimits, time_constant: f64) -> Self {
        Self {
            limits,
            time_constant,
            wheels: None,
        }
    }

    /// Adds wheels, which take their part first.
    pub fn with_wheels(mut self, wheels: WheelAllocator) -> Self {
        self.wheels = Some(wheels);
        self
    }

    /// Number of wheels.
    pub fn wheel_count(&self) -> usize {
        (self.wheels.as_ref()).map_or(0, |wheels| wheels.wheels().len())
    }

    /// Angular momentum of wheels that turn with `speeds` \[rad/s\] relative to the base, base axes \[N m s\].
    ///
    /// # Panics
    /// If there is not one speed per wheel.
    pub fn wheel_momentum(&self, speeds: &[f64]) -> Vector3<f64> {
        match &self.wheels {
            Some(wheels) => wheels.momentum(speeds),
            None => Vector3::zeros(),
        }
    }

    /// Motor torques of the wheels for the last couple \[N m\].
    pub fn wheel_torques(&self) -> &[f64] {
        (self.wheels.as_ref()).map_or(&[], WheelAllocator::torques)
    }

    /// No couple: zero motor torques.
    pub fn release(&mut self) {
        if let Some(wheels) = &mut self.wheels {
            wheels.release();
        }
    }

    /// The couple for a stack that rotates at `w` (base axes), with angular momentum `momentum` of its bodies without
    /// wheels, and wheel speeds `speeds` \[rad/s\].
    ///
    /// # Panics
    /// If there is not one speed per wheel.
    pub fn couple(
        &mut self,
        stack: &Stack,
        w: &Vector3<f64>,
        momentum: &Vector3<f64>,
        speeds: &[f64],
    ) -> SharedCouple {
        let size = momentum.norm();
        let asked = match size > 0.0 {
            true => {
                let available = self.limits.couple + self.wheel_torque(&(momentum / size));
                -momentum * ((size / self.time_constant).min(available) / size)
            }
            false => Vector3::zeros(),
        };
        let carried = w.cross(&self.wheel_momentum(speeds));
        let by_wheels = self.wheel_share(&asked, &carried, speeds);
        let mut rest = asked - by_wheels;
        if rest.norm() > self.limits.couple {
            rest *= self.limits.couple / rest.norm();
        }
        let scale = stack.grasp_scale(w, &(by_wheels + rest), &self.limits);
        let (mut wheels, thrusters) = (by_wheels, rest * scale);
        if scale < 1.0 {
            wheels = self.wheel_share(&(by_wheels * scale), &carried, speeds);
        }
        SharedCouple {
            thrusters,
            wheels,
            scale,
            grasp: stack.grasp_wrench(w, &(thrusters + wheels)),
        }
    }

    /// Largest torque of the wheels along a direction \[N m\].
    fn wheel_torque(&self, direction: &Vector3<f64>) -> f64 {
        let Some(wheels) = &self.wheels else {
            return 0.0;
        };
        let axes = wheels.axes().column_iter().zip(wheels.wheels());
        // Avoids NaN for a wheel without limit perpendicular to the direction.
        let along = axes.map(|(axis, wheel)| match axis.dot(direction).abs() {
            0.0 => 0.0,
            along => along * wheel.max_torque,
        });
        along.sum()
    }

    /// The part of the couple `asked` that wheels can give now: the rate of their momentum is `-τ - ω × h` with
    /// `carried` = `ω × h`. The part is the largest within the limits of all motors for which no full wheel takes more
    /// momentum. If `-ω × h` alone fills a full wheel and no part suffices against it, the wheels keep their speeds:
    /// their couple is then `-ω × h`, not a part of `asked`.
    fn wheel_share(
        &mut self,
        asked: &Vector3<f64>,
        carried: &Vector3<f64>,
        speeds: &[f64],
    ) -> Vector3<f64> {
        let Some(wheels) = &mut self.wheels else {
            return Vector3::zeros();
        };
        match wheels.allocate_part(asked, carried, speeds, WHEEL_PERIOD) {
            Some(part) => asked * part,
            None => -carried,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::detumbling::BrakingCouple;
    use crate::control::fixtures::{PYRAMID, SPIN, satellite_with_wheels};
    use crate::spatial::exp_so3;
    use nalgebra::UnitQuaternion;

    /// Wheels about the given axes of the base, each with limits of torque \[N m\] and momentum \[N m s\].
    fn wheels(axes: &[[f64; 3]], torque: f64, momentum: f64) -> WheelAllocator {
        WheelAllocator::new(&satellite_with_wheels(axes, torque, momentum), 20.0).unwrap()
    }

    const ORTHOGONAL: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    fn limits(couple: f64) -> DetumbleLimits {
        DetumbleLimits {
            couple,
            grasp_force: 1e3,
            grasp_torque: 1e3,
        }
    }

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

    /// Final state of a run.
    struct Outcome {
        w: Vector3<f64>,
        /// Momentum of the wheels, total in base axes and of each wheel.
        h: Vector3<f64>,
        each: Vec<f64>,
        /// Total momentum, inertial axes.
        momentum: Vector3<f64>,
        largest_force: f64,
        largest_motor_torque: f64,
    }

    /// Integrates robot and target, and each wheel by the torque of its motor, with small midpoint steps.
    fn run(detumbler: &mut Detumbler, w: Vector3<f64>, duration: f64) -> Outcome {
        let stack = stack();
        let inverse = stack.inertia.try_inverse().unwrap();
        let mut each = vec![0.0; detumbler.wheel_count()];
        let axes = detumbler
            .wheels
            .as_ref()
            .map(|wheels| wheels.axes().clone());
        let total = |each: &[f64]| match &axes {
            Some(axes) => axes * nalgebra::DVector::from_column_slice(each),
            None => Vector3::zeros(),
        };
        let mut w = w;
        let mut R = UnitQuaternion::identity();
        let steps = 20_000;
        let dt = duration / f64::from(steps);
        let (mut largest_force, mut largest_motor_torque) = (0.0_f64, 0.0_f64);
        for _ in 0..steps {
            let mut rates = |w: &Vector3<f64>, each: &[f64]| {
                let momentum = stack.inertia * w;
                let speeds: Vec<f64> = each.iter().map(|h| h / SPIN).collect();
                let shared = detumbler.couple(&stack, w, &momentum, &speeds);
                let motors = detumbler.wheel_torques().to_vec();
                for torque in &motors {
                    largest_motor_torque = largest_motor_torque.max(torque.abs());
                }
                largest_force = largest_force.max(shared.grasp.force.norm());
                // Euler's equation of a body with wheels: what the motors give acts on the body with the opposite sign.
                let whole = momentum + total(each);
                let dw = inverse * (shared.thrusters - total(&motors) - w.cross(&whole));
                (dw, motors)
            };
            let (dw, dh) = rates(&w, &each);
            let mid_w = w + dw * (0.5 * dt);
            let mid: Vec<f64> = (each.iter().zip(&dh))
                .map(|(h, d)| h + 0.5 * dt * d)
                .collect();
            let (dw, dh) = rates(&mid_w, &mid);
            R *= exp_so3(&(mid_w * dt));
            w += dw * dt;
            for (h, d) in each.iter_mut().zip(&dh) {
                *h += d * dt;
            }
        }
        let h = total(&each);
        Outcome {
            momentum: R * (stack.inertia * w + h),
            w,
            h,
            each,
            largest_force,
            largest_motor_torque,
        }
    }

    // Closed form A: the constant couple stops the stack in |L| / τ; halfway, half of the momentum is left.
    #[test]
    fn thrusters_stop_the_stack_in_the_time_of_the_closed_form() {
        let limits = limits(8.0);
        let w = Vector3::new(0.02, -0.03, 0.04);
        let momentum = (stack().inertia * w).norm();
        let mut detumbler = Detumbler::new(limits, 1e-3);
        let duration = BrakingCouple::Constant(limits.couple).duration(momentum);
        let left = run(&mut detumbler, w, 0.5 * duration).momentum;
        assert!((left.norm() - 0.5 * momentum).abs() < 1e-6 * momentum);
        let w = run(&mut detumbler, w, 1.01 * duration).w;
        assert!(w.norm() < 1e-5, "{w}");
    }

    // Closed form F: wheels move momentum and remove none. Afterwards they hold all of it, in the axes of the base.
    #[test]
    fn wheels_take_the_momentum_and_the_whole_keeps_it() {
        let w = Vector3::new(0.01, -0.015, 0.02);
        let total = stack().inertia * w;
        for axes in [&ORTHOGONAL[..], &PYRAMID[..]] {
            let mut detumbler =
                Detumbler::new(limits(0.0), 5.0).with_wheels(wheels(axes, 2.0, 200.0));
            let end = run(&mut detumbler, w, 150.0);
            assert!(end.w.norm() < 1e-6, "{}", end.w);
            assert!((end.h.norm() - total.norm()).abs() < 1e-5 * total.norm());
            let after = end.momentum;
            assert!(
                (after - total).norm() < 1e-5 * total.norm(),
                "{after} {total}"
            );
            assert!(
                end.largest_motor_torque <= 2.0,
                "{}",
                end.largest_motor_torque
            );
        }
    }

    // Wheels that are too small fill up; thrusters remove the rest.
    #[test]
    fn thrusters_take_what_wheels_cannot() {
        for axes in [&ORTHOGONAL[..], &PYRAMID[..]] {
            let mut detumbler =
                Detumbler::new(limits(3.0), 5.0).with_wheels(wheels(axes, 1.0, 4.0));
            let end = run(&mut detumbler, Vector3::new(0.01, -0.015, 0.02), 150.0);
            assert!(end.w.norm() < 1e-5, "{}", end.w);
            assert!(
                end.each.iter().all(|h| h.abs() <= 4.0 + 1e-9),
                "{:?}",
                end.each
            );
            assert!(end.each.iter().any(|h| h.abs() > 3.9), "{:?}", end.each);
        }
    }

    // No part of the couple can both stay within the torque about y and unload the full wheel about x, which -ω × h
    // fills: checks of each axis separately would let it take 0.14 N m. The other cases have a part, computed by hand.
    #[test]
    fn a_full_wheel_takes_no_more() {
        let wheels = wheels(&ORTHOGONAL, 1.0, 10.0);
        let mut detumbler = Detumbler::new(limits(3.0), 5.0).with_wheels(wheels);
        let mut rate = |asked: [f64; 3], w: [f64; 3], h: [f64; 3]| {
            let [asked, w, h] = [asked, w, h].map(Vector3::from);
            let carried = w.cross(&h);
            let given = detumbler.wheel_share(&asked, &carried, (h / SPIN).as_slice());
            let change = -given - carried;
            let motors = Vector3::from_column_slice(detumbler.wheel_torques());
            assert!((motors - change).norm() < 1e-12, "{motors} {change}");
            (given, change)
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

    // With and without wheels. Fails if the couple is reduced after the wheels' torques have been chosen, which leaves
    // the motor torques too large.
    #[test]
    fn the_couple_is_cut_to_the_limit_at_the_grasp() {
        let limits = DetumbleLimits {
            couple: 50.0,
            grasp_force: 10.0,
            grasp_torque: 100.0,
        };
        let w = Vector3::new(0.02, -0.03, 0.04);
        let stack = stack();
        let plain = Detumbler::new(limits, 3.0);
        let with_wheels = plain.clone().with_wheels(wheels(&PYRAMID, 20.0, 30.0));
        for mut detumbler in [plain, with_wheels] {
            let speeds = vec![0.0; detumbler.wheel_count()];
            let shared = detumbler.couple(&stack, &w, &(stack.inertia * w), &speeds);
            assert!(shared.scale < 1.0);
            assert!(
                (shared.grasp.force.norm() - 10.0).abs() < 1e-9,
                "{shared:?}"
            );
            let end = run(&mut detumbler, w, 600.0);
            assert!(end.momentum.norm() < 1e-5 || end.each.len() == 4);
            assert!(
                end.w.norm() < 1e-5 && end.largest_force < 10.0 + 1e-9,
                "{} {}",
                end.w,
                end.largest_force
            );
        }
    }
}
