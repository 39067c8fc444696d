//! Estimates at the times of the last gyro samples.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Matrix6, Matrix6x3, UnitQuaternion, Vector3};

use crate::control::Stamp;
use crate::control::attitude::GyroErrors;
use crate::spatial::exp_so3;

/// Covariance of the error of the attitude (a rotation vector in base axes) and of the bias.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertainty {
    pub covariance: Matrix6<f64>,
}

impl Uncertainty {
    /// Covariance before any attitude is known: only the bias part has a meaning.
    pub fn of_bias(deviation: f64) -> Self {
        let mut covariance = Matrix6::zeros();
        for i in 0..3 {
            covariance[(i, i)] = std::f64::consts::PI.powi(2);
            covariance[(3 + i, 3 + i)] = deviation * deviation;
        }
        Self { covariance }
    }

    /// Covariance after a gap: the attitude is lost, and the bias has drifted with this variance.
    pub fn after_gap(&self, variance: f64) -> Self {
        let mut next = Self::of_bias(0.0);
        let bias = self.covariance.fixed_view::<3, 3>(3, 3) + Matrix3::identity() * variance;
        next.covariance
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&bias);
        next
    }
}

/// The estimate at the time of a gyro sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    pub stamp: Stamp,
    pub w_measured: Vector3<f64>,
    pub R_WB: UnitQuaternion<f64>,
    pub bias: Vector3<f64>,
    pub uncertainty: Uncertainty,
}

impl Node {
    /// The estimate at the next gyro sample. Between two samples the rate is linear in time.
    pub fn propagated(&self, stamp: Stamp, w_measured: Vector3<f64>, errors: &GyroErrors) -> Self {
        let dt = stamp.seconds_since(self.stamp);
        let (w0, w1) = (self.w_measured - self.bias, w_measured - self.bias);
        // Magnus expansion of a linear rate, to third order.
        let turn = (w0 + w1) * (0.5 * dt) + w0.cross(&w1) * (dt * dt / 12.0);
        let mut transition = Matrix6::identity();
        let rotation = exp_so3(&-turn).to_rotation_matrix().into_inner();
        transition.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
        let of_bias = right_jacobian(&turn) * -dt;
        transition.fixed_view_mut::<3, 3>(0, 3).copy_from(&of_bias);
        let mut covariance = transition * self.uncertainty.covariance * transition.transpose();
        // Markley & Crassidis eq. (6.93), isotropic.
        let (v, u) = (
            errors.angle_random_walk.powi(2),
            errors.rate_random_walk.powi(2),
        );
        for i in 0..3 {
            covariance[(i, i)] += v * dt + u * dt.powi(3) / 3.0;
            covariance[(i, 3 + i)] -= u * dt * dt / 2.0;
            covariance[(3 + i, i)] -= u * dt * dt / 2.0;
            covariance[(3 + i, 3 + i)] += u * dt;
        }
        let mut R_WB = self.R_WB * exp_so3(&turn);
        R_WB.renormalize_fast();
        Self {
            stamp,
            w_measured,
            R_WB,
            bias: self.bias,
            uncertainty: Uncertainty { covariance },
        }
    }

    /// Sets the attitude to a measurement with this variance of each component.
    pub fn start(&mut self, measured: &UnitQuaternion<f64>, variance: f64) {
        self.R_WB = *measured;
        let P = &mut self.uncertainty.covariance;
        P.fixed_view_mut::<3, 6>(0, 0).fill(0.0);
        P.fixed_view_mut::<6, 3>(0, 0).fill(0.0);
        for i in 0..3 {
            P[(i, i)] = variance;
        }
    }

    /// Kalman update. Returns whether the measurement was within the gate; otherwise nothing changes.
    pub fn correct(&mut self, measured: &UnitQuaternion<f64>, variance: f64, gate: f64) -> bool {
        let innovation = (self.R_WB.inverse() * measured).scaled_axis();
        let P = &self.uncertainty.covariance;
        let noise = Matrix3::identity() * variance;
        let S: Matrix3<f64> = P.fixed_view::<3, 3>(0, 0) + noise;
        let Some(S_inverse) = S.try_inverse() else {
            return false;
        };
        if innovation.dot(&(S_inverse * innovation)) > gate {
            return false;
        }
        let gain: Matrix6x3<f64> = P.fixed_view::<6, 3>(0, 0) * S_inverse;
        let correction = gain * innovation;
        // Joseph's form.
        let mut keep = Matrix6::identity();
        let mut left = keep.fixed_view_mut::<6, 3>(0, 0);
        left -= gain;
        let P = keep * P * keep.transpose() + gain * noise * gain.transpose();
        self.uncertainty.covariance = (P + P.transpose()) * 0.5;
        self.R_WB *= exp_so3(&correction.fixed_rows::<3>(0).into_owned());
        self.bias += correction.fixed_rows::<3>(3);
        true
    }
}

/// `∫₀¹ exp(-s [u×]) ds`.
fn right_jacobian(u: &Vector3<f64>) -> Matrix3<f64> {
    let cross = u.cross_matrix();
    let x = u.norm_squared();
    let (a, b) = if x < 1e-4 {
        (0.5 - x / 24.0, 1.0 / 6.0 - x / 120.0)
    } else {
        let angle = x.sqrt();
        ((1.0 - angle.cos()) / x, (angle - angle.sin()) / (x * angle))
    };
    Matrix3::identity() - cross * a + cross * cross * b
}

/// A queue of fixed capacity.
#[derive(Debug, Clone)]
pub struct History {
    nodes: VecDeque<Node>,
    capacity: usize,
}

impl History {
    pub fn new(capacity: usize) -> Self {
        Self {
            nodes: VecDeque::with_capacity(capacity),
            capacity,
        }
    }

    pub fn clear(&mut self) {
        self.nodes.clear();
    }

    pub fn newest(&self) -> Option<&Node> {
        self.nodes.back()
    }

    /// Adds a node, at the cost of the oldest if there is no room.
    pub fn push(&mut self, node: Node) {
        if self.nodes.len() == self.capacity {
            self.nodes.pop_front();
        }
        self.nodes.push_back(node);
    }

    /// Index of the last node that is not after `stamp`.
    pub fn place(&self, stamp: Stamp) -> Option<usize> {
        self.nodes
            .partition_point(|node| node.stamp <= stamp)
            .checked_sub(1)
    }

    pub fn node_mut(&mut self, at: usize) -> &mut Node {
        &mut self.nodes[at]
    }

    /// Mean measured rate from node `at` to `stamp`, which is before the next node.
    pub fn rate_after(&self, at: usize, stamp: Stamp) -> Vector3<f64> {
        let node = &self.nodes[at];
        let Some(next) = self.nodes.get(at + 1) else {
            return node.w_measured;
        };
        let share = stamp.seconds_since(node.stamp) / next.stamp.seconds_since(node.stamp);
        node.w_measured + (next.w_measured - node.w_measured) * (0.5 * share)
    }

    /// Integrates the gyro again after node `at`.
    pub fn propagate_from(&mut self, at: usize, errors: &GyroErrors) {
        for i in at + 1..self.nodes.len() {
            let Node {
                stamp, w_measured, ..
            } = self.nodes[i];
            self.nodes[i] = self.nodes[i - 1].propagated(stamp, w_measured, errors);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Compares with a sum over small steps.
    #[test]
    fn the_right_jacobian_is_an_integral() {
        for scale in [1e-3, 0.0099, 0.0101, 0.4, 2.0] {
            let u = Vector3::new(0.3, -0.9, 0.4) * scale;
            let count = 4000;
            let steps = (0..count).map(|i| {
                let s = (f64::from(i) + 0.5) / f64::from(count);
                exp_so3(&(-u * s)).to_rotation_matrix().into_inner()
            });
            let sum = steps.sum::<Matrix3<f64>>() / f64::from(count);
            assert!((right_jacobian(&u) - sum).amax() < 1e-7, "{scale}");
        }
    }
}
