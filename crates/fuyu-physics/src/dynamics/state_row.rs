//! A state as a row of numbers, for arrays of states that another program owns.

use std::ops::Range;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::State;

/// Largest deviation of an attitude quaternion's norm from one.
const NORM_TOLERANCE: f64 = 1e-6;

/// Layout of a [`State`] in a row: time, joint positions, joint rates, attitude of the base (x, y, z, w), centre of
/// mass, linear momentum, angular momentum, work, and energy dissipated by damping, friction, stops and speed limits.
/// Units and frames are those of [`State`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StateRow {
    dof: usize,
}

/// A row that is not a state.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RowError {
    /// A number is NaN or infinite.
    #[error("state {row}: {quantity} is {value}; it must be finite")]
    NotFinite {
        /// Number of the row.
        row: usize,
        /// The quantity.
        quantity: String,
        /// Its value.
        value: f64,
    },
    /// The attitude is not a rotation.
    #[error("state {row}: the attitude quaternion has the norm {norm}; it must be 1")]
    Norm {
        /// Number of the row.
        row: usize,
        /// The norm.
        norm: f64,
    },
    /// An effort is NaN or infinite.
    #[error("state {row}: the effort of joint '{joint}' is {value}; it must be finite")]
    Effort {
        /// Number of the row.
        row: usize,
        /// The joint.
        joint: String,
        /// The effort.
        value: f64,
    },
}

impl StateRow {
    /// The layout for a robot with `dof` joints.
    pub const fn new(dof: usize) -> Self {
        Self { dof }
    }

    /// Length of a row.
    pub const fn len(self) -> usize {
        2 * self.dof + 19
    }

    /// Never: a row has at least the base's numbers.
    pub const fn is_empty(self) -> bool {
        false
    }

    /// Names and index ranges of the quantities.
    pub fn parts(self) -> [(&'static str, Range<usize>); 9] {
        let n = self.dof;
        let mut end = 0;
        let mut part = |name, length| {
            let start = end;
            end += length;
            (name, start..end)
        };
        [
            part("time", 1),
            part("q", n),
            part("qd", n),
            part("attitude", 4),
            part("com", 3),
            part("linear_momentum", 3),
            part("angular_momentum", 3),
            part("work", 1),
            part("dissipated", 4),
        ]
    }

    /// Writes `state` into `row`.
    ///
    /// # Panics
    /// If the row or the state has another length.
    pub fn write(self, state: &State, row: &mut [f64]) {
        let n = self.dof;
        assert_eq!(row.len(), self.len(), "length of a row");
        row[0] = state.time;
        let (q, rest) = row[1..].split_at_mut(n);
        let (qd, base) = rest.split_at_mut(n);
        q.copy_from_slice(state.q.as_slice());
        qd.copy_from_slice(state.qd.as_slice());
        base[..4].copy_from_slice(state.R_WB.coords.as_slice());
        base[4..7].copy_from_slice(state.p_WC.as_slice());
        base[7..10].copy_from_slice(state.momentum_W.linear.as_slice());
        base[10..13].copy_from_slice(state.momentum_W.angular.as_slice());
        base[13] = state.work;
        let lost = &state.dissipated;
        base[14..].copy_from_slice(&[
            lost.damping,
            lost.friction,
            lost.stops,
            lost.velocity_limits,
        ]);
    }

    /// Reads `row` into `state` without checks: [`StateRow::check`] must have accepted the row.
    ///
    /// # Panics
    /// If the row or the state has another length.
    pub fn read(self, row: &[f64], state: &mut State) {
        let n = self.dof;
        assert_eq!(row.len(), self.len(), "length of a row");
        state.time = row[0];
        state.q.as_mut_slice().copy_from_slice(&row[1..=n]);
        state.qd.as_mut_slice().copy_from_slice(&row[n + 1..=2 * n]);
        let base = &row[2 * n + 1..];
        let q = Quaternion::new(base[3], base[0], base[1], base[2]);
        state.R_WB = UnitQuaternion::new_unchecked(q);
        let vector = |at: usize| Vector3::new(base[at], base[at + 1], base[at + 2]);
        state.p_WC = vector(4);
        state.momentum_W.linear = vector(7);
        state.momentum_W.angular = vector(10);
        state.work = base[13];
        let lost = &mut state.dissipated;
        (lost.damping, lost.friction) = (base[14], base[15]);
        (lost.stops, lost.velocity_limits) = (base[16], base[17]);
    }

    /// Refuses rows that are not states; `first` is the number of the first row.
    ///
    /// # Errors
    /// [`RowError`] of the first wrong number.
    pub fn check(self, rows: &[f64], first: usize) -> Result<(), RowError> {
        let attitude = 2 * self.dof + 1;
        for (index, row) in rows.chunks_exact(self.len()).enumerate() {
            // Zero unless a number is not finite.
            let sum: f64 = row.iter().map(|x| x * 0.0).sum();
            let [x, y, z, w] = [0, 1, 2, 3].map(|k| row[attitude + k]);
            let norm = (x * x + y * y + z * z + w * w).sqrt();
            if sum == 0.0 && (norm - 1.0).abs() <= NORM_TOLERANCE {
                continue;
            }
            let row_number = first + index;
            let wrong = row.iter().position(|x| !x.is_finite());
            return Err(match wrong {
                None => RowError::Norm {
                    row: row_number,
                    norm,
                },
                Some(at) => RowError::NotFinite {
                    row: row_number,
                    quantity: self.name_of(at),
                    value: row[at],
                },
            });
        }
        Ok(())
    }

    /// Name of the number at index `at`, such as `q[2]`.
    fn name_of(self, at: usize) -> String {
        let parts = self.parts();
        let found = parts.into_iter().find(|(_, place)| place.contains(&at));
        found.map_or_else(String::new, |(name, place)| match place.len() {
            1 => name.to_owned(),
            _ => format!("{name}[{}]", at - place.start),
        })
    }
}

/// Refuses efforts that are not finite. There is one row per state, starting with state number `first`.
#[cfg(feature = "batch")]
pub(super) fn check_efforts(
    model: &crate::model::Model,
    efforts: &[f64],
    first: usize,
) -> Result<(), RowError> {
    let sum: f64 = efforts.iter().map(|x| x * 0.0).sum();
    if sum == 0.0 {
        return Ok(());
    }
    let wrong = efforts.iter().position(|x| !x.is_finite());
    let at = wrong.unwrap_or_default();
    Err(RowError::Effort {
        row: first + at / model.dof(),
        joint: model.joints()[at % model.dof()].name.clone(),
        value: efforts[at],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Model;
    use nalgebra::DVector;

    fn state() -> (Model, State) {
        let model = Model::from_urdf(include_str!("../../../../urdf/servicer.urdf"), "servicer");
        let model = model.unwrap();
        let mut state = State::at_rest_with(&model, &DVector::from_fn(6, |j, _| 0.1 * j as f64));
        state.time = 2.5;
        state.qd.fill(-0.25);
        state.R_WB = UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3);
        state.momentum_W.linear = Vector3::new(1.0, 2.0, 3.0);
        state.momentum_W.angular = Vector3::new(4.0, 5.0, 6.0);
        state.work = 7.0;
        state.dissipated.damping = 8.0;
        state.dissipated.velocity_limits = 9.0;
        (model, state)
    }

    #[test]
    fn a_row_has_every_number_of_a_state() {
        let (model, state) = state();
        let layout = StateRow::new(model.dof());
        let mut row = vec![f64::NAN; layout.len()];
        layout.write(&state, &mut row);
        assert!(row.iter().all(|x| x.is_finite()));
        let mut read = State::at_rest(&model);
        layout.read(&row, &mut read);
        assert_eq!(read, state);
        let parts = layout.parts();
        assert_eq!(parts[8].1.end, layout.len());
        let of = |name| parts.iter().find(|p| p.0 == name).unwrap().1.clone();
        assert_eq!(row[of("angular_momentum")], [4.0, 5.0, 6.0]);
        assert_eq!(row[of("qd")], [-0.25; 6]);
    }

    #[test]
    fn wrong_numbers_are_named() {
        let (model, state) = state();
        let layout = StateRow::new(model.dof());
        let mut rows = vec![0.0; 3 * layout.len()];
        for row in rows.chunks_exact_mut(layout.len()) {
            layout.write(&state, row);
        }
        assert_eq!(layout.check(&rows, 0), Ok(()));
        let mut nan = rows.clone();
        nan[2 * layout.len() + 9] = f64::NAN;
        let error = layout.check(&nan, 5).unwrap_err().to_string();
        assert_eq!(error, "state 7: qd[2] is NaN; it must be finite");
        rows[layout.len() + 13] += 0.1;
        let error = layout.check(&rows, 0).unwrap_err().to_string();
        assert!(
            error.starts_with("state 1: the attitude quaternion has the norm 1.0"),
            "{error}"
        );
    }

    #[cfg(feature = "batch")]
    #[test]
    fn efforts_that_are_not_finite_are_named() {
        let (model, _) = state();
        let mut efforts = [0.0; 12];
        efforts[8] = f64::INFINITY;
        let error = check_efforts(&model, &efforts, 0).unwrap_err().to_string();
        assert_eq!(
            error,
            "state 1: the effort of joint 'joint3' is inf; it must be finite"
        );
    }
}
