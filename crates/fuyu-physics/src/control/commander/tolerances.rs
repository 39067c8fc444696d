//! Tolerances of a joint trajectory: during the motion and at the goal.

use std::fmt;

use super::joint_spline::JointPoint;

/// Largest deviations of a joint; those that are zero are not checked.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StateTolerance {
    /// Of the position \[rad or m\].
    pub position: f64,
    /// Of the rate \[rad/s or m/s\].
    pub rate: f64,
    /// Of the acceleration \[rad/s² or m/s²\].
    pub acceleration: f64,
}

/// Tolerances of a trajectory, one element per joint of the trajectory.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrajectoryTolerances {
    /// Tolerances during the motion.
    pub path: Vec<StateTolerance>,
    /// Tolerances at the end.
    pub goal: Vec<StateTolerance>,
    /// Time allowed after the end of the trajectory to reach the goal \[s\]; zero is unlimited.
    pub goal_time: f64,
}

/// The deviating quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// The position.
    Position,
    /// The rate.
    Velocity,
    /// The acceleration.
    Acceleration,
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
        })
    }
}

/// A tolerance that is violated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// Index of the joint in the trajectory.
    pub joint: usize,
    /// The deviating quantity.
    pub quantity: Quantity,
    /// The deviation.
    pub error: f64,
    /// The tolerance.
    pub tolerance: f64,
}

/// Progress of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress {
    /// The trajectory is running, or waits for its goal.
    Running,
    /// The trajectory has reached its goal.
    Succeeded,
    /// A tolerance of the path is violated.
    PathViolated(Violation),
    /// The goal was not reached in time.
    GoalViolated(Violation),
}

/// Compares the motion of a trajectory's joints with its tolerances.
#[derive(Debug, Clone, PartialEq)]
pub struct GoalMonitor {
    tolerances: TrajectoryTolerances,
    /// End of the trajectory \[s\].
    end: f64,
}

impl GoalMonitor {
    /// A monitor for a trajectory that ends at `end` \[s\].
    pub fn new(tolerances: TrajectoryTolerances, end: f64) -> Self {
        Self { tolerances, end }
    }

    /// The progress at `time` \[s\], with the `errors` (desired minus actual) of the trajectory's joints. The
    /// tolerances of the path apply before the end, those of the goal from the end on.
    pub fn progress(&self, time: f64, errors: &[JointPoint]) -> Progress {
        if time < self.end - 1e-9 {
            return match violation(errors, &self.tolerances.path) {
                Some(violation) => Progress::PathViolated(violation),
                None => Progress::Running,
            };
        }
        match violation(errors, &self.tolerances.goal) {
            None => Progress::Succeeded,
            Some(violation) => {
                let allowed = self.tolerances.goal_time;
                match allowed > 0.0 && time > self.end + allowed + 1e-9 {
                    true => Progress::GoalViolated(violation),
                    false => Progress::Running,
                }
            }
        }
    }
}

/// The first deviation that is larger than its tolerance, or not a number.
fn violation(errors: &[JointPoint], tolerances: &[StateTolerance]) -> Option<Violation> {
    errors
        .iter()
        .zip(tolerances)
        .enumerate()
        .find_map(|(joint, (error, tolerance))| {
            let checked = [
                (Quantity::Position, error.position, tolerance.position),
                (Quantity::Velocity, error.rate, tolerance.rate),
                (
                    Quantity::Acceleration,
                    error.acceleration,
                    tolerance.acceleration,
                ),
            ];
            let violated = checked.into_iter().find(|(_, error, tolerance)| {
                // NaN also violates the tolerance.
                let is_within = error.abs() <= *tolerance;
                *tolerance > 0.0 && !is_within
            });
            violated.map(|(quantity, error, tolerance)| Violation {
                joint,
                quantity,
                error,
                tolerance,
            })
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(position: f64, rate: f64) -> JointPoint {
        JointPoint {
            position,
            rate,
            acceleration: 0.0,
        }
    }

    fn monitor(goal_time: f64) -> GoalMonitor {
        let of = |position, rate| StateTolerance {
            position,
            rate,
            acceleration: 0.0,
        };
        let tolerances = TrajectoryTolerances {
            path: vec![of(0.1, 0.0), of(0.0, 0.5)],
            goal: vec![of(0.01, 0.02); 2],
            goal_time,
        };
        GoalMonitor::new(tolerances, 5.0)
    }

    // Fails if a tolerance of zero is checked, or that of another joint.
    #[test]
    fn the_path_is_checked_before_the_end() {
        let monitor = monitor(0.0);
        let running = monitor.progress(1.0, &[error(-0.09, 9.0), error(9.0, 0.4)]);
        assert_eq!(running, Progress::Running);
        let Progress::PathViolated(violation) =
            monitor.progress(1.0, &[error(0.0, 0.0), error(0.0, -0.6)])
        else {
            panic!("the rate of the second joint deviates");
        };
        assert_eq!(
            (violation.joint, violation.quantity),
            (1, Quantity::Velocity)
        );
        let nan = monitor.progress(1.0, &[error(f64::NAN, 0.0), error(0.0, 0.0)]);
        assert!(matches!(nan, Progress::PathViolated(_)));
    }

    #[test]
    fn the_goal_may_be_reached_within_its_time() {
        let (off, there) = ([error(0.05, 0.0), error(0.0, 0.0)], [error(0.005, 0.01); 2]);
        let monitor = monitor(1.0);
        assert_eq!(monitor.progress(4.9, &off), Progress::Running);
        assert_eq!(monitor.progress(4.9, &there), Progress::Running);
        assert_eq!(monitor.progress(5.5, &off), Progress::Running);
        assert_eq!(monitor.progress(5.5, &there), Progress::Succeeded);
        let late = monitor.progress(6.1, &off);
        assert!(matches!(late, Progress::GoalViolated(v) if v.joint == 0 && v.error == 0.05));
        // Without a time it waits for ever, as joint_trajectory_controller does.
        assert_eq!(self::monitor(0.0).progress(1e3, &off), Progress::Running);
    }
}
