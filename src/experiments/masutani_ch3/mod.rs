//! The simulations of Masutani 1995 chapter 3: 294 motions, observed under a condition, estimated, and evaluated by
//! their prediction.
//!
//! ```
//! use fuyu::experiments::masutani_ch3::{Condition, TumblingMotion, cell};
//!
//! let motion = TumblingMotion { e: 0.5, s: 0.0, s_alpha: 0.3, beta: 0.8 }.rotation()?;
//! let cell = cell(&motion, Condition::TrueRates);
//! let errors = cell.result.expect("the motion can be estimated");
//! assert!(errors.prediction.axis.to_degrees() < 1.1);
//! # Ok::<(), fuyu::estimation::free_body::FreeRotationError>(())
//! ```

mod cell;
mod condition;
mod motions;
mod tables;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

pub use cell::{Cell, CellErrors, cell, judge, options};
pub use condition::{Condition, camera, points, rates, tracks};
pub use motions::{ISOTROPIES, MOMENTA, TumblingMotion, grid};
pub use tables::{ModelTable, TABLE_3_2, TABLE_3_3, TABLE_3_4, TABLE_3_5, TABLE_3_6, TABLE_3_7};

/// Interval between frames \[s\], table 3.1.
pub const INTERVAL: f64 = 0.6;
/// Intervals observed: 360 s.
pub const INTERVALS: u32 = 600;
/// Length of the evaluated prediction after the observation \[s\].
pub const HORIZON: f64 = 30.0;

/// Applies `work` to each of `items` on `threads` threads; the results are in the order of the items and do not depend
/// on the number of threads.
pub fn in_parallel<T: Sync, R: Send>(
    items: &[T],
    threads: usize,
    work: impl Fn(&T) -> R + Sync,
) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::with_capacity(items.len()));
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, items.len().max(1)) {
            scope.spawn(|| {
                while let Some((i, item)) = {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    items.get(i).map(|item| (i, item))
                } {
                    let result = work(item);
                    let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
                    done.push((i, result));
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, result)| result).collect()
}
