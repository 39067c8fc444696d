//! Rates of change of a state, and the weighted sums of them that make up a Runge-Kutta step.

use nalgebra::{DVector, Quaternion, UnitQuaternion, Vector3};

use super::kernel::{Quat, SERIES_LIMIT, Vec3, rotation_vector_rate_series};
use super::{Evaluation, State};
use crate::{
    model::Joint,
    spatial::{exp_so3, rotation_vector_rate},
};

/// A state's rate of change at one stage. The coordinate of the attitude is the rotation vector since the start of the
/// step.
#[derive(Debug, Clone)]
pub(super) struct Rate {
    turned: Vector3<f64>,
    com: Vector3<f64>,
    linear_momentum: Vector3<f64>,
    angular_momentum: Vector3<f64>,
    q: DVector<f64>,
    qd: DVector<f64>,
    work: f64,
}

impl Rate {
    pub(super) fn zero(n: usize) -> Self {
        Self {
            turned: Vector3::zeros(),
            com: Vector3::zeros(),
            linear_momentum: Vector3::zeros(),
            angular_momentum: Vector3::zeros(),
            q: DVector::zeros(n),
            qd: DVector::zeros(n),
            work: 0.0,
        }
    }

    /// The numbers of a state, in the order of their rates in [`Rate::number`]. The rotation vector counts as 1.
    pub(super) fn values(state: &State) -> impl Iterator<Item = f64> {
        let m = &state.momentum_W;
        let vectors = [&state.p_WC, &m.linear, &m.angular];
        let vectors = vectors.into_iter().flat_map(|v| v.iter().copied());
        let joints = state.q.iter().chain(&state.qd).copied();
        ([1.0; 3].into_iter().chain(vectors).chain(joints)).chain([state.work])
    }

    /// Number `place` of the rate: of the rotation vector, centre of mass, linear and angular momentum, joint positions, joint
    /// rates, work.
    pub(super) fn number(&self, place: usize) -> f64 {
        let n = self.q.len();
        match place {
            0..3 => self.turned[place],
            3..6 => self.com[place - 3],
            6..9 => self.linear_momentum[place - 6],
            9..12 => self.angular_momentum[place - 9],
            _ if place < 12 + n => self.q[place - 12],
            _ if place < 12 + 2 * n => self.qd[place - 12 - n],
            _ => self.work,
        }
    }

    /// Sets the rate from the equations of motion at `state`; `turned` is the rotation vector since the start of the
    /// step.
    #[inline(always)]
    pub(super) fn set(
        &mut self,
        state: &State,
        evaluation: &Evaluation,
        mass: f64,
        turned: &Vector3<f64>,
    ) {
        self.turned = turn_rate(turned, &evaluation.w_WB_B);
        self.com = state.momentum_W.linear / mass;
        (self.linear_momentum, self.angular_momentum) = match &evaluation.external {
            Some(wrench) => (state.R_WB * wrench.force, state.R_WB * wrench.torque),
            None => (Vector3::zeros(), Vector3::zeros()),
        };
        self.work = evaluation.power;
        self.q.as_mut_slice().copy_from_slice(state.qd.as_slice());
        let qdd = evaluation.acceleration.qdd.as_slice();
        self.qd.as_mut_slice().copy_from_slice(qdd);
    }

    /// Power dissipated by the joints' damping \[W\].
    fn damping_power(&self, joints: &[Joint]) -> f64 {
        let rates = joints.iter().zip(&self.q);
        rates.map(|(joint, qd)| joint.damping * qd * qd).sum()
    }
}

/// Energy dissipated by the joints' damping in a step of `dt` \[s\] with these `rates` and `weights` of its stages
/// \[J\].
pub(super) fn damping_loss(rates: &[Rate], weights: &[f64], joints: &[Joint], dt: f64) -> f64 {
    let powers = rates.iter().map(|rate| rate.damping_power(joints));
    let lost: f64 = powers.zip(weights).map(|(power, b)| power * b).sum();
    dt * lost
}

/// `into = from + dt Σ weights rates`; returns the rotation vector from the attitude of `from` to that of `into`.
#[inline(always)]
pub(super) fn advance(
    into: &mut State,
    from: &State,
    rates: &[Rate],
    weights: &[f64],
    dt: f64,
) -> Vector3<f64> {
    into.p_WC = from.p_WC;
    into.momentum_W = from.momentum_W;
    into.work = from.work;
    into.dissipated = from.dissipated;
    let (q, qd) = (into.q.as_mut_slice(), into.qd.as_mut_slice());
    q.copy_from_slice(from.q.as_slice());
    qd.copy_from_slice(from.qd.as_slice());
    let mut turned = Vector3::zeros();
    for (rate, weight) in rates.iter().zip(weights) {
        if *weight == 0.0 {
            continue;
        }
        let k = dt * weight;
        turned += rate.turned * k;
        into.p_WC += rate.com * k;
        into.momentum_W.linear += rate.linear_momentum * k;
        into.momentum_W.angular += rate.angular_momentum * k;
        into.work += rate.work * k;
        let joints = rate.q.as_slice().iter().zip(rate.qd.as_slice());
        for ((q, qd), (q_rate, qd_rate)) in q.iter_mut().zip(&mut *qd).zip(joints) {
            *q += q_rate * k;
            *qd += qd_rate * k;
        }
    }
    into.R_WB = turn(&from.R_WB, &turned);
    turned
}

/// Rate of the rotation vector `turned` of a body with angular velocity `w_WB_B`.
#[inline(always)]
pub(super) fn turn_rate(turned: &Vector3<f64>, w_WB_B: &Vector3<f64>) -> Vector3<f64> {
    if turned.norm_squared() <= SERIES_LIMIT {
        let (turned, w) = (Vec3((*turned).into()), Vec3((*w_WB_B).into()));
        rotation_vector_rate_series(turned, w).0.into()
    } else {
        rotation_vector_rate(turned, w_WB_B)
    }
}

/// `R_WB exp([turned×])`.
#[inline(always)]
pub(super) fn turn(R_WB: &UnitQuaternion<f64>, turned: &Vector3<f64>) -> UnitQuaternion<f64> {
    if turned.norm_squared() <= SERIES_LIMIT {
        let [i, j, k, w] = R_WB.coords.into();
        let v = Vec3([i, j, k]);
        let after = Quat { w, v }.compose(Quat::exp_series(Vec3((*turned).into())));
        let [i, j, k] = after.v.0;
        UnitQuaternion::new_unchecked(Quaternion::new(after.w, i, j, k))
    } else {
        R_WB * exp_so3(turned)
    }
}
