//! Damped least squares (Levenberg-Marquardt) from several starts: the search of every inverse kinematics here.

use nalgebra::{DVector, Vector3, Vector6};

use super::PoseError;

/// Remaining deviation from the goal.
pub(super) struct Deviation<R> {
    /// The quantity that a step reduces.
    pub residual: R,
    /// Square of the norm of `residual`.
    pub norm_squared: f64,
    /// Position \[m\] and angle \[rad\].
    pub left: (f64, f64),
}

impl Deviation<Vector6<f64>> {
    /// Stacks the position error `p` \[m\] and the rotation vector `turn` \[rad\] to the goal; `error` gives the
    /// remaining distance and angle.
    pub fn stacked(p: &Vector3<f64>, turn: &Vector3<f64>, error: &PoseError) -> Self {
        let residual = Vector6::new(p.x, p.y, p.z, turn.x, turn.y, turn.z);
        Self {
            norm_squared: residual.norm_squared(),
            left: (error.position.norm(), error.angle),
            residual,
        }
    }
}

/// A search for joint positions, or for a motion, that bring the tip to its goal.
pub(super) trait TipSearch {
    /// A point in the search space.
    type Point;
    /// Deviation from the goal in the coordinates of the steps.
    type Residual;

    /// Remaining deviation from the goal.
    fn deviation(&mut self, at: &Self::Point) -> Deviation<Self::Residual>;

    /// Whether the remaining deviation is small enough.
    fn is_at_goal(&self, left: (f64, f64)) -> bool;

    /// The point after a least-squares step with this damping. `None` if its equations cannot be solved.
    fn step(
        &mut self,
        from: &Self::Point,
        residual: &Self::Residual,
        damping: f64,
    ) -> Option<Self::Point>;
}

/// The point of a search that came nearest to the goal.
pub(super) struct Nearest<P> {
    /// The point; `None` if no result was finite.
    pub point: Option<P>,
    /// Remaining distance \[m\] and angle \[rad\].
    pub left: (f64, f64),
}

/// Settings of a descent.
pub(super) struct DampedDescent {
    /// Largest number of steps from one start.
    pub steps: usize,
    /// Damping of the first step.
    pub damping: f64,
    /// Smallest and largest damping.
    pub range: (f64, f64),
}

impl DampedDescent {
    /// Descends from `starts` initial points, given by `start`, until one leads to the goal.
    ///
    /// # Errors
    /// The nearest point that was found.
    pub fn search<S: TipSearch>(
        &self,
        search: &mut S,
        starts: usize,
        mut start: impl FnMut(&mut S, usize) -> S::Point,
    ) -> Result<S::Point, Nearest<S::Point>> {
        let mut nearest = Nearest {
            point: None,
            left: (f64::INFINITY, f64::INFINITY),
        };
        for attempt in 0..starts {
            let from = start(search, attempt);
            let (point, left) = self.descend(search, from);
            if search.is_at_goal(left) {
                return Ok(point);
            }
            if left.0 + left.1 < nearest.left.0 + nearest.left.1 {
                let point = Some(point);
                nearest = Nearest { point, left };
            }
        }
        Err(nearest)
    }

    /// Descends from one start; returns the final point and its remaining deviation.
    fn descend<S: TipSearch>(&self, search: &mut S, mut at: S::Point) -> (S::Point, (f64, f64)) {
        let mut damping = self.damping;
        let mut deviation = search.deviation(&at);
        for _ in 0..self.steps {
            if search.is_at_goal(deviation.left) || damping > self.range.1 {
                break;
            }
            let trial = search.step(&at, &deviation.residual, damping);
            let trial = trial.map(|trial| (search.deviation(&trial), trial));
            match trial {
                Some((left, trial)) if left.norm_squared < deviation.norm_squared => {
                    (at, deviation) = (trial, left);
                    damping = (damping * 0.3).max(self.range.0);
                }
                _ => damping *= 4.0,
            }
        }
        (at, deviation.left)
    }
}

/// A step in the same direction whose largest element is at most `longest`: a longer step leaves the region where the
/// Jacobian is a good approximation.
pub(super) fn shortened(step: DVector<f64>, longest: f64) -> DVector<f64> {
    let largest = step.amax();
    match largest > longest {
        true => step * (longest / largest),
        false => step,
    }
}
