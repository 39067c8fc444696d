//! Allocation of a torque to thruster on-times.

mod nnls;

use nalgebra::{Matrix3, Vector3};

use super::AttitudeConfigError;
use super::error::require_positive;
use super::span::solve_within_span;
use crate::dynamics::flexible::FlexibleSystem;
use nnls::{Column, NonNegative, ROWS};

/// Torque and force of the thrusters in a period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThrusterAllocation {
    /// Mean torque about the centre of mass over the period, base axes \[N m\].
    pub torque: Vector3<f64>,
    /// Mean force over the period, base axes \[N\].
    pub force: Vector3<f64>,
    /// Whether less than the requested torque is given because a thruster would have to fire longer than the period.
    pub saturated: bool,
}

/// Turns a torque about the centre of mass into on-times within a control period (pulse width modulation).
///
/// Non-negative least squares (C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23) for the
/// torque's impulse and, with small weights, for no net force and little propellant. On-times shorter than half of a
/// thruster's shortest on-time are omitted, other short ones are lengthened to it; the resulting error of the impulse is
/// corrected in the next period.
#[derive(Debug, Clone)]
pub struct ThrusterAllocator {
    thrusters: Vec<Mounted>,
    columns: Vec<Column>,
    solver: NonNegative,
    period: f64,
    on_times: Vec<f64>,
    /// Impulse of the requested torque that was not given because of the shortest on-times \[N m s\].
    remainder: Vector3<f64>,
}

/// A thruster on the base.
#[derive(Debug, Clone)]
struct Mounted {
    position: Vector3<f64>,
    force: Vector3<f64>,
    min_on_time: f64,
}

/// Weight of a net force relative to that of a torque with the mean lever arm, and of propellant.
const FORCE_WEIGHT: f64 = 1e-2;
const PROPELLANT_WEIGHT: f64 = 1e-4;

impl ThrusterAllocator {
    /// An allocator for the thrusters of `system`, with a control period of `period` \[s\]; `None` if it has none.
    ///
    /// # Errors
    /// [`AttitudeConfigError`] for thrusters that are not on the base, that cannot give a torque in every direction, or
    /// whose shortest on-time is longer than the period.
    pub fn new(system: &FlexibleSystem, period: f64) -> Result<Option<Self>, AttitudeConfigError> {
        require_positive("period [s]", period)?;
        let mut thrusters = Vec::new();
        for (i, thruster) in system.thrusters().iter().enumerate() {
            let (body, position, force) = system.thruster_force(i);
            let name = &thruster.name;
            if body != 0 {
                return Err(AttitudeConfigError::Robot(format!(
                    "thruster {name} is on {}; attitude control needs all thrusters on the base",
                    system.model().bodies()[body].name
                )));
            }
            if thruster.min_on_time > period {
                return Err(AttitudeConfigError::Value {
                    what: format!("thruster {name}, min_on_time [s]"),
                    value: thruster.min_on_time,
                    expected: "at most the control period",
                });
            }
            thrusters.push(Mounted {
                position,
                force,
                min_on_time: thruster.min_on_time,
            });
        }
        if thrusters.is_empty() {
            return Ok(None);
        }
        let n = thrusters.len();
        let mut allocator = Self {
            columns: vec![Column::zeros(); n],
            solver: NonNegative::new(n),
            on_times: vec![0.0; n],
            remainder: Vector3::zeros(),
            thrusters,
            period,
        };
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let mut torque = Vector3::zeros();
                torque[axis] = sign;
                let found = allocator.wanted_on_times(&(torque * period), &Vector3::zeros());
                let given = allocator.impulse(&Vector3::zeros()).0 / period;
                if !found || (given - torque).norm() > 1e-6 {
                    return Err(AttitudeConfigError::Robot(format!(
                        "the thrusters give no torque of {sign:+} about base axis {}; desaturation needs every direction",
                        ["x", "y", "z"][axis]
                    )));
                }
            }
        }
        allocator.reset();
        Ok(Some(allocator))
    }

    /// On-times of the last call \[s\], from the beginning of the period.
    pub fn on_times(&self) -> &[f64] {
        &self.on_times
    }

    /// Closes all valves, and discards the missing impulse.
    pub fn reset(&mut self) {
        self.on_times.fill(0.0);
        self.remainder = Vector3::zeros();
    }

    /// On-times that give the mean torque `torque` about the centre of mass `p_BC` (both base axes) over the period.
    pub fn allocate(&mut self, torque: &Vector3<f64>, p_BC: &Vector3<f64>) -> ThrusterAllocation {
        let wanted = torque * self.period + self.remainder;
        if !self.wanted_on_times(&wanted, p_BC) {
            self.reset();
        }
        let longest = self.on_times.iter().copied().fold(0.0, f64::max);
        let saturated = longest > self.period;
        if saturated {
            let share = self.period / longest;
            self.on_times.iter_mut().for_each(|t| *t *= share);
        }
        let (intended, _) = self.impulse(p_BC);
        for (time, thruster) in self.on_times.iter_mut().zip(&self.thrusters) {
            let shortest = thruster.min_on_time;
            *time = match *time {
                t if t < 0.5 * shortest || t <= 0.0 => 0.0,
                t => t.max(shortest),
            };
        }
        let (angular, linear) = self.impulse(p_BC);
        self.remainder = intended - angular;
        ThrusterAllocation {
            torque: angular / self.period,
            force: linear / self.period,
            saturated,
        }
    }

    /// Impulses of torque and force of the on-times.
    fn impulse(&self, p_BC: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let (mut angular, mut linear) = (Vector3::zeros(), Vector3::zeros());
        for (time, thruster) in self.on_times.iter().zip(&self.thrusters) {
            linear += thruster.force * *time;
            angular += (thruster.position - p_BC).cross(&thruster.force) * *time;
        }
        (angular, linear)
    }

    /// Solves for the on-times without limits; false if no on-times give the impulse.
    fn wanted_on_times(&mut self, impulse: &Vector3<f64>, p_BC: &Vector3<f64>) -> bool {
        let (mut torque_size, mut force_size) = (0.0_f64, 0.0_f64);
        for thruster in &self.thrusters {
            let torque = (thruster.position - p_BC).cross(&thruster.force);
            torque_size = torque_size.max(torque.norm());
            force_size = force_size.max(thruster.force.norm());
        }
        if torque_size <= 0.0 {
            return false;
        }
        // Units: the largest torque and force, and the on-time that gives the impulse with the largest torque.
        let scale = impulse.norm() / torque_size;
        if scale == 0.0 {
            self.on_times.fill(0.0);
            return true;
        }
        for (column, thruster) in self.columns.iter_mut().zip(&self.thrusters) {
            let torque = (thruster.position - p_BC).cross(&thruster.force) / torque_size;
            let force = thruster.force * (FORCE_WEIGHT / force_size);
            let propellant = PROPELLANT_WEIGHT * thruster.force.norm() / force_size;
            *column = Column::from([
                torque.x, torque.y, torque.z, force.x, force.y, force.z, propellant,
            ]);
        }
        let mut target = Column::zeros();
        let direction = impulse / impulse.norm();
        target.fixed_rows_mut::<3>(0).copy_from(&direction);
        self.solver
            .solve(&self.columns, &target, &mut self.on_times);
        self.meet_torque(&direction);
        self.on_times.iter_mut().for_each(|t| *t *= scale);
        true
    }

    /// Removes the torque error due to the small weights, by the smallest change of the on-times of the firing
    /// thrusters.
    fn meet_torque(&mut self, direction: &Vector3<f64>) {
        let torque_of = |column: &Column| column.fixed_rows::<3>(0).into_owned();
        let (mut gram, mut missing) = (Matrix3::zeros(), *direction);
        for (column, time) in self.columns.iter().zip(&self.on_times) {
            if *time > 0.0 {
                let torque = torque_of(column);
                gram += torque * torque.transpose();
                missing -= torque * *time;
            }
        }
        let push = solve_within_span(&gram, &missing);
        let change = |column: &Column| torque_of(column).dot(&push);
        let mut pairs = self.columns.iter().zip(&self.on_times);
        if pairs.any(|(column, time)| *time > 0.0 && time + change(column) < 0.0) {
            return;
        }
        for (column, time) in self.columns.iter().zip(&mut self.on_times) {
            if *time > 0.0 {
                *time += change(column);
            }
        }
    }
}

const _: () = assert!(ROWS == 7, "torque, force, propellant");

#[cfg(test)]
mod tests;
