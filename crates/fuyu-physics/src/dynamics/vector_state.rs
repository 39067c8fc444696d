//! A free-floating robot's state as one vector, base motion included.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::ops::Range;

use super::{Formulation, Input, TreeAcceleration, TreeMotion};
use crate::model::Model;
use crate::spatial::Twist;

/// Layout of the state vector that TR-942 integrates: base position, base attitude as a quaternion
/// `w x y z`, joint positions; then base velocity and angular velocity, joint rates. World axes; the base is its
/// frame's origin.
/// Momentum and the norm of the quaternion are conserved only to the integrator's accuracy. Use [`State`](super::State)
/// except to test a formulation that computes accelerations only, or to reproduce results published with this state.
/// published with this state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VectorState {
    n: usize,
}

impl VectorState {
    /// The layout for robots like `model`.
    pub fn new(model: &Model) -> Self {
        Self { n: model.dof() }
    }

    /// Length of the vector.
    pub fn length(self) -> usize {
        13 + 2 * self.n
    }

    /// Base position \[m\].
    pub fn position(self) -> Range<usize> {
        0..3
    }

    /// Base attitude `w x y z`, not normalised.
    pub fn quaternion(self) -> Range<usize> {
        3..7
    }

    /// Joint positions \[rad or m\].
    pub fn q(self) -> Range<usize> {
        7..7 + self.n
    }

    /// Base velocity \[m/s\].
    pub fn velocity(self) -> Range<usize> {
        7 + self.n..10 + self.n
    }

    /// Base angular velocity \[rad/s\].
    pub fn angular_velocity(self) -> Range<usize> {
        10 + self.n..13 + self.n
    }

    /// Joint rates \[rad/s or m/s\].
    pub fn qd(self) -> Range<usize> {
        13 + self.n..13 + 2 * self.n
    }

    /// A state at rest at joint positions `q`, with the base frame at the world's origin and along its axes.
    pub fn at_rest_with(self, q: &[f64]) -> Vec<f64> {
        let mut x = vec![0.0; self.length()];
        x[self.quaternion().start] = 1.0;
        x[self.q()].copy_from_slice(q);
        x
    }

    /// The motion that `x` describes; the quaternion is normalised.
    pub fn motion(self, x: &[f64]) -> TreeMotion<'_> {
        let R_WB = UnitQuaternion::new_normalize(self.quaternion_of(x));
        TreeMotion {
            R_WB,
            V_WB_B: Twist::new(
                R_WB.inverse_transform_vector(&vector(x, self.angular_velocity())),
                R_WB.inverse_transform_vector(&vector(x, self.velocity())),
            ),
            q: &x[self.q()],
            qd: &x[self.qd()],
        }
    }

    /// Writes the rate of change of `x` under `input`, computed by `formulation`; `scratch` receives the accelerations.
    pub fn rate(
        self,
        formulation: &mut impl Formulation,
        input: &Input,
        x: &[f64],
        scratch: &mut TreeAcceleration,
        rate: &mut [f64],
    ) {
        let motion = self.motion(x);
        formulation.accelerations(&motion, input, scratch);
        let spin = Quaternion::from_imag(vector(x, self.angular_velocity()));
        let turning = spin * self.quaternion_of(x) * 0.5;
        rate[self.position()].copy_from_slice(&x[self.velocity()]);
        rate[self.quaternion()].copy_from_slice(&[turning.w, turning.i, turning.j, turning.k]);
        rate[self.q()].copy_from_slice(&x[self.qd()]);
        let Twist { angular, linear } = scratch.A_WB_B;
        rate[self.velocity()].copy_from_slice((motion.R_WB * linear).as_slice());
        rate[self.angular_velocity()].copy_from_slice((motion.R_WB * angular).as_slice());
        rate[self.qd()].copy_from_slice(scratch.qdd.as_slice());
    }

    fn quaternion_of(self, x: &[f64]) -> Quaternion<f64> {
        let [w, i, j, k] = [0, 1, 2, 3].map(|entry| x[self.quaternion().start + entry]);
        Quaternion::new(w, i, j, k)
    }
}

fn vector(x: &[f64], range: Range<usize>) -> Vector3<f64> {
    Vector3::from_column_slice(&x[range])
}
