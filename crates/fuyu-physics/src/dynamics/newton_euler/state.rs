//! State of the bodies: 13 numbers each.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use super::System;
use crate::dynamics::Momentum;

/// Pose and velocity of one body: the variables of TR-942 section 2.2, 13 per body, in this order in a state vector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyState {
    /// Centre of mass in the world \[m\].
    pub p_WC: Vector3<f64>,
    /// Attitude as `w, x, y, z`. Integration does not preserve its norm; it is normalized when read as a rotation.
    pub Q_WB: Quaternion<f64>,
    /// Velocity of the centre of mass in the world, body axes \[m/s\].
    pub v_WC_B: Vector3<f64>,
    /// Angular velocity in the world, body axes \[rad/s\].
    pub w_WB_B: Vector3<f64>,
}

impl BodyState {
    /// The 13 numbers of body `body` in `state`.
    ///
    /// # Panics
    /// If `state` is too short.
    pub fn read(state: &[f64], body: usize) -> Self {
        let x = &state[13 * body..13 * body + 13];
        let v = |i: usize| Vector3::new(x[i], x[i + 1], x[i + 2]);
        Self {
            p_WC: v(0),
            Q_WB: Quaternion::new(x[3], x[4], x[5], x[6]),
            v_WC_B: v(7),
            w_WB_B: v(10),
        }
    }

    /// Writes the 13 numbers to `state`.
    ///
    /// # Panics
    /// If `state` is too short.
    pub fn write(&self, state: &mut [f64], body: usize) {
        let x = &mut state[13 * body..13 * body + 13];
        let q = &self.Q_WB;
        x[..3].copy_from_slice(self.p_WC.as_slice());
        x[3..7].copy_from_slice(&[q.w, q.i, q.j, q.k]);
        x[7..10].copy_from_slice(self.v_WC_B.as_slice());
        x[10..].copy_from_slice(self.w_WB_B.as_slice());
    }

    /// The attitude as a rotation.
    pub fn R_WB(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(self.Q_WB)
    }

    /// Rates of position and attitude: the kinematic equations that complete TR-942 eq. (2.2.10).
    pub(super) fn rates(&self) -> (Vector3<f64>, Quaternion<f64>) {
        let turning = self.Q_WB * Quaternion::from_imag(self.w_WB_B) * 0.5;
        (self.R_WB() * self.v_WC_B, turning)
    }
}

impl System {
    /// Momentum of all bodies together, world axes; the angular momentum is about the system's centre of mass.
    pub fn momentum(&self, state: &[f64]) -> Momentum {
        let mass: f64 = self.bodies.iter().map(|b| b.inertia.mass).sum();
        let (mut first, mut linear, mut angular) =
            (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        for (b, body) in self.bodies.iter().enumerate() {
            let at = BodyState::read(state, b);
            let (R_WB, m) = (at.R_WB(), body.inertia.mass);
            let p = R_WB * at.v_WC_B * m;
            first += at.p_WC * m;
            linear += p;
            angular += at.p_WC.cross(&p) + R_WB * (body.inertia.about_com * at.w_WB_B);
        }
        Momentum {
            linear,
            angular: angular - (first / mass).cross(&linear),
        }
    }

    /// Kinetic energy of all bodies, and potential energy of the springs \[J\]. With two or three free rotations the
    /// potential energy is that of the angles on which the springs act.
    pub fn energy(&self, state: &[f64]) -> (f64, f64) {
        let kinetic = (self.bodies.iter().enumerate()).map(|(b, body)| {
            let (at, inertia) = (BodyState::read(state, b), &body.inertia);
            let spin: Matrix3<f64> = inertia.about_com;
            inertia.mass * at.v_WC_B.norm_squared() + at.w_WB_B.dot(&(spin * at.w_WB_B))
        });
        let stored = (0..self.hinges.len()).map(|i| {
            let displaced = self.displacement(state, i);
            let springs = self.hinges[i].springs.iter().zip(displaced);
            springs
                .map(|(s, y)| s.stiffness * (y - s.rest).powi(2))
                .sum::<f64>()
        });
        (0.5 * kinetic.sum::<f64>(), 0.5 * stored.sum::<f64>())
    }
}
