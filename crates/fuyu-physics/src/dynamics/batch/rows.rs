//! Steps of states stored as rows of the caller's array.

use rayon::prelude::*;

use super::block::{Block, read};
use super::{Batch, Piece, Task, hold};
use crate::dynamics::kernel::GROUP_SIZE;
use crate::dynamics::state_row::check_efforts;
use crate::dynamics::{RowError, State, StateRow};

/// Efforts for all states.
#[derive(Debug, Clone, Copy)]
pub enum EffortRows<'a> {
    /// The efforts that are held already.
    Held,
    /// The same efforts for every state, one per joint \[N m or N\].
    Common(&'a [f64]),
    /// One row per state, one effort per joint \[N m or N\].
    Each(&'a [f64]),
}

impl<'a> EffortRows<'a> {
    /// The efforts of state `index`.
    fn of(self, index: usize, dof: usize) -> Option<&'a [f64]> {
        match self {
            Self::Held => None,
            Self::Common(efforts) => Some(efforts),
            Self::Each(efforts) => Some(&efforts[index * dof..][..dof]),
        }
    }
}

impl Batch {
    /// Takes the states from `rows` (one [`StateRow`] each), holds `efforts`, advances by `steps` steps of `dt` \[s\],
    /// and writes the states back. Results equal those of [`Batch::set_state`], [`Batch::hold_efforts`] and
    /// [`Batch::step`]; the batch then contains the same states.
    ///
    /// # Errors
    /// [`RowError`] if a row is not a state or an effort is not finite; nothing has then changed.
    ///
    /// # Panics
    /// If the length of `rows` or `efforts` does not fit.
    pub fn step_rows(
        &mut self,
        rows: &mut [f64],
        efforts: EffortRows,
        dt: f64,
        steps: usize,
    ) -> Result<(), RowError> {
        self.take_rows(rows, efforts)?;
        self.advance_rows(rows, Task::Step { dt, steps }, |piece, _| {
            piece.reborrow().run(None);
        });
        Ok(())
    }

    /// As [`Batch::step_rows`], with efforts that are sampled at the start of every step and held during it:
    /// `law(index, qd, efforts)` receives the number of a state, its joint rates \[rad/s or m/s\], and the efforts \[N
    /// m or N\] of the previous step (initially the held ones), which it may change. The efforts are clamped to the
    /// joints' effort limits.
    ///
    /// # Errors
    /// [`RowError`] if a row is not a state; nothing has then changed.
    ///
    /// # Panics
    /// If the length of `rows` does not fit.
    pub fn step_rows_with(
        &mut self,
        rows: &mut [f64],
        dt: f64,
        steps: usize,
        law: impl Fn(usize, &[f64], &mut [f64]) + Sync,
    ) -> Result<(), RowError> {
        self.take_rows(rows, EffortRows::Held)?;
        let (dof, count) = (self.model().dof(), self.len());
        self.advance_rows(rows, Task::Step { dt, steps: 1 }, |piece, first| {
            let (mut qd, mut efforts) = (vec![0.0; dof], vec![0.0; dof]);
            // Block by block, so that a block stays in the processor's cache from step to step.
            for (b, block) in piece.blocks.iter_mut().enumerate() {
                let first = first + b * GROUP_SIZE;
                let lanes = GROUP_SIZE.min(count - first);
                for _ in 0..steps {
                    for lane in 0..lanes {
                        read(&block.qd, lane, &mut qd);
                        read(&block.efforts, lane, &mut efforts);
                        law(first + lane, &qd, &mut efforts);
                        hold(block, lane, &efforts, &piece.setup.model);
                    }
                    let one = Piece {
                        setup: piece.setup,
                        blocks: std::slice::from_mut(block),
                        scratch: piece.scratch,
                        task: piece.task,
                    };
                    one.run(None);
                }
            }
        });
        Ok(())
    }

    /// Calls `advance` for every piece, with the number of its first state, and writes the states to `rows`.
    fn advance_rows(
        &mut self,
        rows: &mut [f64],
        task: Task,
        advance: impl Fn(&mut Piece<'_>, usize) + Sync,
    ) {
        let layout = StateRow::new(self.model().dof());
        let size = self.piece_size() * GROUP_SIZE;
        let pieces = self.pieces(task);
        let numbered = (pieces.zip(rows.par_chunks_mut(size * layout.len()))).enumerate();
        numbered.for_each(|(k, (mut piece, rows))| {
            advance(&mut piece, k * size);
            let mut state = State::at_rest(&piece.setup.model);
            for_each_lane(
                piece.blocks,
                rows.chunks_exact_mut(layout.len()),
                |block, lane, row| {
                    block.read_state(lane, &mut state);
                    layout.write(&state, row);
                },
            );
        });
    }

    /// Takes the states from `rows`, holds `efforts`, and writes the joint accelerations \[rad/s² or m/s²\] to `qdd`, one row per
    /// state.
    ///
    /// # Errors
    /// As [`Batch::step_rows`].
    ///
    /// # Panics
    /// If the length of `rows`, `efforts` or `qdd` does not fit.
    pub fn accelerate_rows(
        &mut self,
        rows: &[f64],
        efforts: EffortRows,
        qdd: &mut [f64],
    ) -> Result<(), RowError> {
        let dof = self.model().dof();
        self.check_count("qdd", qdd.len() / dof.max(1));
        self.take_rows(rows, efforts)?;
        self.accelerate();
        for (index, row) in qdd.chunks_exact_mut(dof.max(1)).enumerate() {
            let (block, lane) = (&self.blocks[index / GROUP_SIZE], index % GROUP_SIZE);
            for (value, lanes) in row.iter_mut().zip(&block.qdd) {
                *value = lanes.0[lane];
            }
        }
        Ok(())
    }

    /// Copies states and efforts to the blocks, if all are valid.
    fn take_rows(&mut self, rows: &[f64], efforts: EffortRows) -> Result<(), RowError> {
        let model = self.model().clone();
        let (dof, count) = (model.dof(), self.len());
        let layout = StateRow::new(dof);
        assert_eq!(rows.len(), count * layout.len(), "length of `rows`");
        let size = self.piece_size() * GROUP_SIZE;
        let checked = (rows.par_chunks(size * layout.len()).enumerate())
            .map(|(k, rows)| layout.check(rows, k * size));
        checked.collect::<Result<(), _>>()?;
        match efforts {
            EffortRows::Held => {}
            EffortRows::Common(common) => {
                assert_eq!(common.len(), dof, "length of `efforts`");
                check_efforts(&model, common, 0)?;
            }
            EffortRows::Each(each) => {
                assert_eq!(each.len(), count * dof, "length of `efforts`");
                check_efforts(&model, each, 0)?;
            }
        }
        let pieces = self.pieces(Task::Accelerate);
        let numbered = pieces.zip(rows.par_chunks(size * layout.len())).enumerate();
        numbered.for_each(|(k, (piece, rows))| {
            let mut state = State::at_rest(&model);
            let mut index = k * size;
            for_each_lane(
                piece.blocks,
                rows.chunks_exact(layout.len()),
                |block, lane, row| {
                    layout.read(row, &mut state);
                    block.set_state(lane, &state);
                    if let Some(efforts) = efforts.of(index, dof) {
                        hold(block, lane, efforts, &model);
                    }
                    index += 1;
                },
            );
        });
        Ok(())
    }
}

/// Calls `visit` with block, lane and row of every state.
fn for_each_lane<R>(
    blocks: &mut [Block],
    rows: impl Iterator<Item = R>,
    mut visit: impl FnMut(&mut Block, usize, R),
) {
    for (index, row) in rows.enumerate() {
        visit(&mut blocks[index / GROUP_SIZE], index % GROUP_SIZE, row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::IntegrationMethod;
    use crate::model::Model;
    use nalgebra::DVector;

    // The state of every lane is written to its own row, and the efforts are those of the state.
    #[test]
    fn rows_move_like_states_alone() {
        let urdf = include_str!("../../../../../urdf/servicer.urdf");
        let model = Model::from_urdf(urdf, "servicer").unwrap();
        let layout = StateRow::new(6);
        let count = 37;
        let mut rows = vec![0.0; count * layout.len()];
        let mut efforts = vec![0.0; count * 6];
        let mut alone = Batch::new(&model, IntegrationMethod::Rk4, count);
        for (k, row) in rows.chunks_exact_mut(layout.len()).enumerate() {
            let q = DVector::from_fn(6, |j, _| (1.7 * (k * 6 + j) as f64).sin());
            let state = State::at_rest_with(&model, &q);
            layout.write(&state, row);
            alone.set_state(k, &state);
            let own = &mut efforts[k * 6..][..6];
            own.iter_mut()
                .enumerate()
                .for_each(|(j, e)| *e = (k + j) as f64);
            alone.hold_efforts(k, own);
        }
        let mut batch = Batch::new(&model, IntegrationMethod::Rk4, count);
        for _ in 0..3 {
            let each = EffortRows::Each(&efforts);
            batch.step_rows(&mut rows, each, 0.01, 2).unwrap();
            alone.step(0.01, 2);
        }
        let mut qdd = vec![0.0; count * 6];
        batch
            .accelerate_rows(&rows, EffortRows::Held, &mut qdd)
            .unwrap();
        alone.accelerate();
        let mut state = State::at_rest(&model);
        for (k, row) in rows.chunks_exact(layout.len()).enumerate() {
            layout.read(row, &mut state);
            assert_eq!(state, alone.state(k));
            assert_eq!(batch.state(k), alone.state(k));
            assert!((0..6).all(|j| qdd[k * 6 + j] == alone.qdd(k, j)));
        }
    }

    // Every state has its own law, sampled once a step: bit-identical to efforts that are computed from the rows before each.
    #[test]
    fn a_law_is_sampled_in_every_step() {
        let urdf = include_str!("../../../../../urdf/servicer.urdf");
        let model = Model::from_urdf(urdf, "servicer").unwrap();
        let layout = StateRow::new(6);
        let count = 21;
        let mut rows = vec![0.0; count * layout.len()];
        for (k, row) in rows.chunks_exact_mut(layout.len()).enumerate() {
            let mut state = State::at_rest(&model);
            state.qd = DVector::from_fn(6, |j, _| 0.1 * (k as f64 + 0.3 * j as f64).sin());
            layout.write(&state, row);
        }
        let law = |index: usize, qd: &[f64], efforts: &mut [f64]| {
            for (effort, qd) in efforts.iter_mut().zip(qd) {
                *effort = 0.5 * *effort - (10.0 + index as f64) * qd;
            }
        };
        let mut expected = rows.clone();
        let mut alone = Batch::new(&model, IntegrationMethod::Rk4, count);
        let mut efforts = vec![0.0; count * 6];
        for _ in 0..7 {
            let states = expected.chunks_exact(layout.len());
            for (k, (row, efforts)) in states.zip(efforts.chunks_exact_mut(6)).enumerate() {
                law(k, &row[7..13], efforts);
            }
            let each = EffortRows::Each(&efforts);
            alone.step_rows(&mut expected, each, 0.01, 1).unwrap();
        }
        let mut batch = Batch::new(&model, IntegrationMethod::Rk4, count);
        batch.step_rows_with(&mut rows, 0.01, 7, law).unwrap();
        assert_eq!(rows, expected);
    }

    #[test]
    fn a_wrong_row_changes_nothing() {
        let urdf = include_str!("../../../../../urdf/servicer.urdf");
        let model = Model::from_urdf(urdf, "servicer").unwrap();
        let layout = StateRow::new(6);
        let mut rows = vec![0.0; 20 * layout.len()];
        let state = State::at_rest(&model);
        rows.chunks_exact_mut(layout.len())
            .for_each(|row| layout.write(&state, row));
        rows[19 * layout.len()] = f64::NAN;
        let before = rows.clone();
        let mut batch = Batch::new(&model, IntegrationMethod::Rk4, 20);
        let common = [1.0; 6];
        let error = batch
            .step_rows(&mut rows, EffortRows::Common(&common), 0.01, 1)
            .unwrap_err();
        assert_eq!(
            error.to_string(),
            "state 19: time is NaN; it must be finite"
        );
        assert!(
            rows.iter()
                .zip(&before)
                .all(|(a, b)| a.to_bits() == b.to_bits())
        );
        assert_eq!(batch.state(0), state);
    }
}
