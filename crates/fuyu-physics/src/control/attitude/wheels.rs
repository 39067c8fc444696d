//! Allocation of a torque to reaction wheels.

use nalgebra::{DVector, Matrix3, Matrix3xX, MatrixXx3, Vector3};

use super::AttitudeConfigError;
use super::error::require_positive;
use super::span::{SPAN, solve_within_span};
use crate::dynamics::flexible::{FlexibleSystem, Wheel};

/// Torque that the wheels give.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelAllocation {
    /// Torque of the wheels on the base, base axes \[N m\].
    pub torque: Vector3<f64>,
    /// Number of wheels at a limit of torque, momentum or speed.
    pub saturated: usize,
}

/// Divides a torque on the base among three or more reaction wheels.
///
/// The motor torques have the least sum of squares. The part that a wheel at its limit cannot give is redistributed to
/// the others (redistributed pseudo-inverse). With more than three wheels, torques that cancel each other move the
/// momenta towards those with the least sum of squares, as far as the limits allow.
#[derive(Debug, Clone)]
pub struct WheelAllocator {
    wheels: Vec<Wheel>,
    /// Axes in base axes, one column per wheel.
    axes: Matrix3xX<f64>,
    /// Pseudo-inverse of `axes`.
    inverse: MatrixXx3<f64>,
    equalization_time: f64,
    torques: DVector<f64>,
    balancing: DVector<f64>,
    lower: DVector<f64>,
    upper: DVector<f64>,
    at_limit: Vec<bool>,
}

impl WheelAllocator {
    /// An allocator for the wheels of `system`. Momenta are equalised with the time constant `equalization_time` \[s\].
    ///
    /// # Errors
    /// [`AttitudeConfigError`] for wheels that are not all on the base, whose axes do not span space, or a time that is
    /// not positive.
    pub fn new(
        system: &FlexibleSystem,
        equalization_time: f64,
    ) -> Result<Self, AttitudeConfigError> {
        require_positive("equalization_time [s]", equalization_time)?;
        let wheels = system.wheels().to_vec();
        let mut axes = Matrix3xX::zeros(wheels.len());
        for (i, wheel) in wheels.iter().enumerate() {
            let (body, axis) = system.wheel_axis(i);
            if body != 0 {
                return Err(AttitudeConfigError::Robot(format!(
                    "wheel {} is on {}; attitude control needs all wheels on the base",
                    wheel.name,
                    system.model().bodies()[body].name
                )));
            }
            axes.set_column(i, &axis);
        }
        let gram: Matrix3<f64> = &axes * axes.transpose();
        let eigen = gram.symmetric_eigen();
        let least = eigen.eigenvalues.min();
        let Some(gram_inverse) = gram.try_inverse().filter(|_| least > SPAN) else {
            let names: Vec<_> = wheels.iter().map(|w| &*w.name).collect();
            return Err(AttitudeConfigError::Robot(format!(
                "the wheels give no torque about one axis at least (wheels: {}); attitude control needs three or more whose axes span space",
                names.join(", ")
            )));
        };
        let n = wheels.len();
        Ok(Self {
            inverse: axes.transpose() * gram_inverse,
            axes,
            wheels,
            equalization_time,
            torques: DVector::zeros(n),
            balancing: DVector::zeros(n),
            lower: DVector::zeros(n),
            upper: DVector::zeros(n),
            at_limit: vec![false; n],
        })
    }

    /// The wheels.
    pub fn wheels(&self) -> &[Wheel] {
        &self.wheels
    }

    /// Axes in base axes, one column per wheel.
    pub fn axes(&self) -> &Matrix3xX<f64> {
        &self.axes
    }

    /// Motor torques of the last call \[N m\].
    pub fn torques(&self) -> &[f64] {
        self.torques.as_slice()
    }

    /// Which wheels were at a limit in the last call.
    pub fn at_limit(&self) -> &[bool] {
        &self.at_limit
    }

    /// Zero torques.
    pub fn release(&mut self) {
        self.torques.fill(0.0);
        self.at_limit.fill(false);
    }

    /// Angular momentum of wheels that turn with `speeds` \[rad/s\] relative to the base, base axes \[N m s\].
    ///
    /// # Panics
    /// If there is not one speed per wheel.
    pub fn momentum(&self, speeds: &[f64]) -> Vector3<f64> {
        assert_eq!(speeds.len(), self.wheels.len(), "one speed per wheel");
        let columns = self.axes.column_iter().zip(&self.wheels).zip(speeds);
        columns
            .map(|((axis, wheel), speed)| axis * (wheel.inertia * speed))
            .sum()
    }

    /// Largest momentum of a wheel as a fraction of its limit, at these speeds; zero without limits.
    pub fn largest_load(&self, speeds: &[f64]) -> f64 {
        let loads = self.wheels.iter().zip(speeds);
        loads.fold(0.0, |most, (wheel, speed)| {
            most.max(speed.abs() / wheel.speed_limit())
        })
    }

    /// Motor torques that give `torque` on the base (base axes) for `period` \[s\], within the limits at `speeds`
    /// \[rad/s\]; without speeds, within the torque limits only.
    ///
    /// # Panics
    /// If there is not one speed per wheel.
    pub fn allocate(
        &mut self,
        torque: &Vector3<f64>,
        speeds: Option<&[f64]>,
        period: f64,
    ) -> WheelAllocation {
        self.set_bounds(speeds, period);
        // A motor accelerates its wheel one way and the base the other way.
        self.torques.gemv(-1.0, &self.inverse, torque, 0.0);
        self.redistribute(torque);
        if let Some(speeds) = speeds
            && self.wheels.len() > 3
        {
            self.equalize(speeds);
        }
        WheelAllocation {
            torque: -(&self.axes * &self.torques),
            saturated: self.at_limit.iter().filter(|at| **at).count(),
        }
    }

    /// Motor torques that give `bias` and the largest part, up to all, of `torque` on the base (base axes), within the
    /// limits for `period` \[s\] at `speeds` \[rad/s\]. Returns that part; `None`, with zero torques, if no part is
    /// within the limits.
    ///
    /// # Panics
    /// If there is not one speed per wheel.
    pub fn allocate_part(
        &mut self,
        torque: &Vector3<f64>,
        bias: &Vector3<f64>,
        speeds: &[f64],
        period: f64,
    ) -> Option<f64> {
        self.set_bounds(Some(speeds), period);
        self.torques.gemv(-1.0, &self.inverse, bias, 0.0);
        // Used as scratch.
        self.balancing.gemv(-1.0, &self.inverse, torque, 0.0);
        let (mut least, mut most) = (0.0_f64, 1.0_f64);
        for i in 0..self.wheels.len() {
            let (own, of_part) = (self.torques[i], self.balancing[i]);
            let bounds = [self.lower[i], self.upper[i]];
            if of_part == 0.0 {
                if own < bounds[0] || own > bounds[1] {
                    least = f64::INFINITY;
                }
                continue;
            }
            let [a, b] = bounds.map(|bound| (bound - own) / of_part);
            least = least.max(a.min(b));
            most = most.min(a.max(b));
        }
        if least > most {
            self.torques.fill(0.0);
            return None;
        }
        self.torques.axpy(most, &self.balancing, 1.0);
        self.clamp_torques();
        Some(most)
    }

    /// Sets the bounds of the motor torques for `period` \[s\].
    fn set_bounds(&mut self, speeds: Option<&[f64]>, period: f64) {
        if let Some(speeds) = speeds {
            assert_eq!(speeds.len(), self.wheels.len(), "one speed per wheel");
        }
        for (i, wheel) in self.wheels.iter().enumerate() {
            let (lower, upper) = match speeds {
                Some(speeds) => (
                    wheel.limited_torque(f64::NEG_INFINITY, speeds[i], period),
                    wheel.limited_torque(f64::INFINITY, speeds[i], period),
                ),
                None => (-wheel.max_torque, wheel.max_torque),
            };
            (self.lower[i], self.upper[i]) = (lower, upper);
            self.at_limit[i] = false;
        }
    }

    /// Clips the torques to their bounds, and redistributes the missing torque to wheels within their bounds.
    fn redistribute(&mut self, torque: &Vector3<f64>) {
        for _ in 0..self.wheels.len() {
            let mut changed = false;
            for i in 0..self.wheels.len() {
                let bounded = self.torques[i].max(self.lower[i]).min(self.upper[i]);
                if bounded != self.torques[i] {
                    self.torques[i] = bounded;
                    self.at_limit[i] = true;
                    changed = true;
                }
            }
            if !changed {
                return;
            }
            let missing = torque + &self.axes * &self.torques;
            let mut gram = Matrix3::zeros();
            for (axis, _) in self.free_axes() {
                gram += axis * axis.transpose();
            }
            let push = solve_within_span(&gram, &missing);
            for i in 0..self.wheels.len() {
                if !self.at_limit[i] {
                    self.torques[i] -= self.axes.column(i).dot(&push);
                }
            }
        }
        self.clamp_torques();
    }

    fn clamp_torques(&mut self) {
        for i in 0..self.wheels.len() {
            self.torques[i] = self.torques[i].max(self.lower[i]).min(self.upper[i]);
        }
    }

    /// Axes of the wheels that are not at a limit, with their indices.
    fn free_axes(&self) -> impl Iterator<Item = (Vector3<f64>, usize)> {
        let axes = self.axes.column_iter().enumerate();
        axes.filter(|(i, _)| !self.at_limit[*i])
            .map(|(i, axis)| (axis.into_owned(), i))
    }

    /// Adds torques whose sum on the base is zero, and which reduce momenta whose sum is zero.
    fn equalize(&mut self, speeds: &[f64]) {
        let total = self.momentum(speeds);
        self.balancing.gemv(1.0, &self.inverse, &total, 0.0);
        let mut share = 1.0_f64;
        for (i, wheel) in self.wheels.iter().enumerate() {
            let excess = wheel.inertia * speeds[i] - self.balancing[i];
            let torque = -excess / self.equalization_time;
            self.balancing[i] = torque;
            let room = match torque > 0.0 {
                true => self.upper[i] - self.torques[i],
                false => self.lower[i] - self.torques[i],
            };
            if torque.abs() > room.abs() {
                share = share.min(room / torque);
            }
        }
        self.torques.axpy(share, &self.balancing, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::fixtures::{PYRAMID, satellite_with_wheels as system};

    #[test]
    fn the_torque_asked_for_is_given_with_the_smallest_sum_of_squares() {
        let system = system(&PYRAMID, 10.0, 100.0);
        let mut allocator = WheelAllocator::new(&system, 20.0).unwrap();
        let wanted = Vector3::new(1.0, -2.0, 0.5);
        let given = allocator.allocate(&wanted, None, 0.1);
        assert!((given.torque - wanted).norm() < 1e-14);
        assert_eq!(given.saturated, 0);
        // The only torques of a pyramid that cancel have opposite signs in neighbouring wheels.
        let null = [1.0, -1.0, 1.0, -1.0];
        let along: f64 = null
            .iter()
            .zip(allocator.torques())
            .map(|(n, u)| n * u)
            .sum();
        assert!(along.abs() < 1e-14, "{along}");
    }

    // With one wheel at its limit the three others still span space.
    #[test]
    fn other_wheels_take_over_from_one_at_its_limit() {
        let system = system(&PYRAMID, 1.0, 100.0);
        let mut allocator = WheelAllocator::new(&system, 20.0).unwrap();
        let wanted = Vector3::new(1.3, -0.1, 0.6);
        let plain = allocator.inverse.clone() * wanted;
        assert!(plain.amax() > 1.0);
        let given = allocator.allocate(&wanted, None, 0.1);
        assert_eq!(given.saturated, 1);
        assert!((given.torque - wanted).norm() < 1e-14, "{}", given.torque);
        assert!(allocator.torques().iter().all(|u| u.abs() <= 1.0));
        // Beyond what all can give: every torque within its limit.
        let given = allocator.allocate(&Vector3::new(0.0, 0.0, 50.0), None, 0.1);
        assert_eq!(given.saturated, 4);
        assert!((given.torque - Vector3::z() * 4.0 / 2f64.sqrt()).norm() < 1e-14);
    }

    // Orthogonal wheels are independent: each is limited exactly and separately.
    #[test]
    fn orthogonal_wheels_are_limited_one_by_one() {
        let system = system(
            &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            4.0,
            100.0,
        );
        let mut allocator = WheelAllocator::new(&system, 20.0).unwrap();
        let given = allocator.allocate(&Vector3::new(7.0, -1.234_567_89, -4.1), None, 0.1);
        assert_eq!(allocator.torques(), [-4.0, 1.234_567_89, 4.0]);
        assert_eq!(given.torque, Vector3::new(4.0, -1.234_567_89, -4.0));
        assert_eq!(allocator.at_limit(), [true, false, true]);
    }

    // A wheel at its momentum limit takes no more momentum, but gives it back; near the limit it takes the remaining
    // part.
    #[test]
    fn momentum_limits_bound_the_torques() {
        let system = system(
            &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            4.0,
            10.0,
        );
        let mut allocator = WheelAllocator::new(&system, 20.0).unwrap();
        let speeds = [100.0, -99.0, 100.0];
        let given = allocator.allocate(&Vector3::new(-1.0, 3.0, 1.0), Some(&speeds), 0.1);
        assert_eq!(given.torque.x, 0.0);
        assert!((given.torque.y - 0.1 / 0.1).abs() < 1e-12);
        assert_eq!(given.torque.z, 1.0);
        assert_eq!(given.saturated, 2);
        assert!((allocator.largest_load(&speeds) - 1.0).abs() < 1e-15);
        let h = allocator.momentum(&speeds);
        assert!((h - Vector3::new(10.0, -9.9, 10.0)).norm() < 1e-14);
    }

    // The momenta that cancel each other decay with the time constant; the torque on the base stays.
    #[test]
    fn momenta_are_equalised_without_torque_on_the_base() {
        let system = system(&PYRAMID, 2.0, 1000.0);
        let mut allocator = WheelAllocator::new(&system, 20.0).unwrap();
        let mut speeds = [300.0, 0.0, 250.0, -20.0];
        let wanted = Vector3::new(0.01, 0.0, -0.02);
        let null = |s: &[f64; 4]| 0.1 * (s[0] - s[1] + s[2] - s[3]);
        let (before, h) = (null(&speeds), allocator.momentum(&speeds));
        for _ in 0..200 {
            let given = allocator.allocate(&wanted, Some(&speeds), 0.1);
            assert!((given.torque - wanted).norm() < 1e-13);
            for (speed, torque) in speeds.iter_mut().zip(allocator.torques()) {
                *speed += torque / 0.1 * 0.1;
            }
        }
        let ratio = null(&speeds) / before;
        assert!(
            (ratio - (1.0 - 0.1 / 20.0_f64).powi(200)).abs() < 1e-12,
            "{ratio}"
        );
        let change = allocator.momentum(&speeds) - h + wanted * 20.0;
        assert!(change.norm() < 1e-11, "{change}");
    }

    #[test]
    fn too_few_wheels_and_wheels_elsewhere_are_refused() {
        let flat = system(
            &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]],
            1.0,
            1.0,
        );
        let text = WheelAllocator::new(&flat, 20.0).unwrap_err().to_string();
        assert_eq!(
            text,
            "the wheels give no torque about one axis at least (wheels: w0, w1, w2); attitude control needs three or more whose axes span space"
        );
        let none = system(&[], 1.0, 1.0);
        assert!(WheelAllocator::new(&none, 20.0).is_err());
        let text = WheelAllocator::new(&flat, 0.0).unwrap_err().to_string();
        assert_eq!(
            text,
            "equalization_time [s] is 0; it must be positive and finite"
        );
    }
}
