//! Memory of an unreachable goal.

use super::{IkError, PoseError};
use crate::spatial::Pose;

/// A goal for which the search has failed. The search is slow, so it is not repeated until the goal moves.
#[derive(Debug, Clone, Default)]
pub(super) struct UnreachableGoal(Option<(Pose, IkError)>);

impl UnreachableGoal {
    /// Refuses a goal within these distances \[m, rad\] of the one that was not reached.
    pub fn check(&self, goal: &Pose, distances: (f64, f64)) -> Result<(), IkError> {
        match &self.0 {
            Some((refused, error)) if PoseError::between(refused, goal).is_within(distances) => {
                Err(error.clone())
            }
            _ => Ok(()),
        }
    }

    /// Remembers that the search for `goal` has failed.
    pub fn remember(&mut self, goal: &Pose, error: &IkError) {
        self.0 = Some((*goal, error.clone()));
    }
}
