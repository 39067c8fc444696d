//! Eight states (the lanes of an `F64x8`) next to each other in memory.

use nalgebra::{Quaternion, UnitQuaternion};

use crate::dynamics::kernel::{F64x8, GROUP_SIZE};
use crate::dynamics::{Dissipated, Momentum, State};

/// Eight states with their held efforts and last accelerations. The last block of a batch may have unused lanes.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub(super) time: F64x8,
    pub(super) work: F64x8,
    /// Energy dissipated by damping, friction, stops, speed limits.
    dissipated: [F64x8; 4],
    pub(super) q: Vec<F64x8>,
    pub(super) qd: Vec<F64x8>,
    pub(super) qdd: Vec<F64x8>,
    pub(super) efforts: Vec<F64x8>,
    /// Quaternions `i j k w`.
    pub(super) R_WB: [F64x8; 4],
    pub(super) p_WC: [F64x8; 3],
    pub(super) linear_momentum_W: [F64x8; 3],
    pub(super) angular_momentum_W: [F64x8; 3],
}

impl Block {
    /// Eight copies of `state`, without efforts.
    pub(super) fn repeating(state: &State) -> Self {
        let zeros = vec![F64x8::ZERO; state.q.len()];
        let mut block = Self {
            time: F64x8::ZERO,
            work: F64x8::ZERO,
            dissipated: [F64x8::ZERO; 4],
            q: zeros.clone(),
            qd: zeros.clone(),
            qdd: zeros.clone(),
            efforts: zeros,
            R_WB: [F64x8::ZERO; 4],
            p_WC: [F64x8::ZERO; 3],
            linear_momentum_W: [F64x8::ZERO; 3],
            angular_momentum_W: [F64x8::ZERO; 3],
        };
        (0..GROUP_SIZE).for_each(|lane| block.set_state(lane, state));
        block
    }

    pub(super) fn set_state(&mut self, lane: usize, state: &State) {
        self.time.0[lane] = state.time;
        self.work.0[lane] = state.work;
        let lost = &state.dissipated;
        let lost = [
            lost.damping,
            lost.friction,
            lost.stops,
            lost.velocity_limits,
        ];
        put(&mut self.dissipated, lane, &lost);
        put(&mut self.R_WB, lane, state.R_WB.coords.as_slice());
        put(&mut self.p_WC, lane, state.p_WC.as_slice());
        let Momentum { linear, angular } = &state.momentum_W;
        put(&mut self.linear_momentum_W, lane, linear.as_slice());
        put(&mut self.angular_momentum_W, lane, angular.as_slice());
        put(&mut self.q, lane, state.q.as_slice());
        put(&mut self.qd, lane, state.qd.as_slice());
    }

    /// Copies the states of `other`, a block of the same robot; accelerations and efforts stay.
    pub(super) fn copy_states(&mut self, other: &Self) {
        (self.time, self.work) = (other.time, other.work);
        self.dissipated = other.dissipated;
        self.q.copy_from_slice(&other.q);
        self.qd.copy_from_slice(&other.qd);
        self.R_WB = other.R_WB;
        self.p_WC = other.p_WC;
        self.linear_momentum_W = other.linear_momentum_W;
        self.angular_momentum_W = other.angular_momentum_W;
    }

    pub(super) fn read_state(&self, lane: usize, into: &mut State) {
        into.time = self.time.0[lane];
        into.work = self.work.0[lane];
        let [damping, friction, stops, velocity_limits] = get(&self.dissipated, lane);
        into.dissipated = Dissipated {
            damping,
            friction,
            stops,
            velocity_limits,
        };
        into.R_WB = UnitQuaternion::new_unchecked(Quaternion::from(get(&self.R_WB, lane)));
        into.p_WC = get(&self.p_WC, lane).into();
        into.momentum_W = Momentum {
            linear: get(&self.linear_momentum_W, lane).into(),
            angular: get(&self.angular_momentum_W, lane).into(),
        };
        read(&self.q, lane, into.q.as_mut_slice());
        read(&self.qd, lane, into.qd.as_mut_slice());
    }
}

/// Writes `values` into a lane.
pub(super) fn put(rows: &mut [F64x8], lane: usize, values: &[f64]) {
    for (row, value) in rows.iter_mut().zip(values) {
        row.0[lane] = *value;
    }
}

/// The numbers of a lane.
pub(super) fn get<const N: usize>(rows: &[F64x8; N], lane: usize) -> [f64; N] {
    rows.map(|row| row.0[lane])
}

/// Reads a lane into `values`.
pub(super) fn read(rows: &[F64x8], lane: usize, values: &mut [f64]) {
    for (row, value) in rows.iter().zip(values) {
        *value = row.0[lane];
    }
}
