//! Inverse kinematics of the arm as if its base were fixed.

use nalgebra::{DMatrix, DVector, Matrix6xX, UnitQuaternion, Vector6};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::PoseError;
use crate::{
    dynamics::Workspace,
    model::{Frame, Joint, Model},
    spatial::Pose,
};

/// Why no joint positions were found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IkError {
    /// The search did not reach the goal from any start.
    #[error(
        "no joint positions were found that reach the goal: the nearest pose found is {position:.4} m and {angle:.4} rad away"
    )]
    NotFound {
        /// Remaining position error \[m\].
        position: f64,
        /// Remaining attitude error \[rad\].
        angle: f64,
    },
}

/// Largest remaining error of a solution \[m and rad\].
const TOLERANCE: f64 = 1e-9;
/// Largest change of a joint in one step \[rad or m\]: a longer one leaves the region where the Jacobian
/// is a good approximation.
const LONGEST_STEP: f64 = 0.5;
/// Number of starts of the search in addition to the given one.
const RESTARTS: usize = 20;

/// Joint positions within the limits that bring `tip` to `X_BD` (base frame): damped least squares with
/// step control (Levenberg-Marquardt) on position and rotation vector. The search descends from `start`; where that
/// does not reach the goal, it starts again from pseudo-random positions that are the same in every call.
/// Angles are returned within half a turn of `start` where limits allow.
///
/// # Errors
/// [`IkError::NotFound`] when no start leads within 1e-9 m and rad.
pub fn inverse_kinematics(
    model: &Model,
    tip: &Frame,
    X_BD: &Pose,
    start: &DVector<f64>,
) -> Result<DVector<f64>, IkError> {
    let mut search = Search {
        model,
        tip,
        X_BD,
        workspace: Workspace::new(model),
        jacobian: Matrix6xX::zeros(model.dof()),
    };
    let mut random = StdRng::seed_from_u64(1);
    let mut nearest = (f64::INFINITY, f64::INFINITY);
    for attempt in 0..=RESTARTS {
        let from = model.joints().iter().zip(start.iter()).map(|(joint, &q)| {
            let away = if attempt == 0 {
                0.0
            } else {
                random.random_range(-2.0..2.0)
            };
            within_limits(joint, q + away)
        });
        let from = DVector::from_iterator(model.dof(), from);
        let (found, error) = search.descend(from);
        let left = (error.position.norm(), error.angle);
        if left.0 <= TOLERANCE && left.1 <= TOLERANCE {
            return Ok(unwound(model, found, start));
        }
        if left.0 + left.1 < nearest.0 + nearest.1 {
            nearest = left;
        }
    }
    Err(IkError::NotFound {
        position: nearest.0,
        angle: nearest.1,
    })
}

struct Search<'a> {
    model: &'a Model,
    tip: &'a Frame,
    X_BD: &'a Pose,
    workspace: Workspace,
    jacobian: Matrix6xX<f64>,
}

impl Search<'_> {
    /// Descends from `q`; returns the last positions and their pose error.
    fn descend(&mut self, mut q: DVector<f64>) -> (DVector<f64>, PoseError) {
        let mut damping = 1e-2;
        let (mut residual, mut error) = self.deviation(&q);
        for _ in 0..300 {
            if error.position.norm() <= TOLERANCE && error.angle <= TOLERANCE || damping > 1e8 {
                break;
            }
            let Some(step) = self.step(&q, &residual, damping) else {
                damping *= 4.0;
                continue;
            };
            let joints = self.model.joints().iter();
            let moved = joints
                .zip(q.iter().zip(&step))
                .map(|(j, (q, d))| within_limits(j, q + d));
            let trial = DVector::from_iterator(q.len(), moved);
            let (trial_residual, trial_error) = self.deviation(&trial);
            if trial_residual.norm_squared() < residual.norm_squared() {
                (q, residual, error) = (trial, trial_residual, trial_error);
                damping = (damping * 0.3).max(1e-12);
            } else {
                damping *= 4.0;
            }
        }
        (q, error)
    }

    /// A damped least-squares step, solved in the smaller of joint space and task space.
    fn step(
        &mut self,
        q: &DVector<f64>,
        residual: &Vector6<f64>,
        damping: f64,
    ) -> Option<DVector<f64>> {
        self.workspace.set_positions(q);
        self.workspace
            .fixed_base_jacobian(self.tip, &mut self.jacobian);
        let J = &self.jacobian;
        let mut step = if q.len() <= 6 {
            let normal = J.tr_mul(J) + DMatrix::identity(q.len(), q.len()) * damping;
            normal.cholesky()?.solve(&J.tr_mul(residual))
        } else {
            let normal = J * J.transpose() + nalgebra::Matrix6::identity() * damping;
            J.tr_mul(&normal.cholesky()?.solve(residual))
        };
        let longest = step.amax();
        if longest > LONGEST_STEP {
            step *= LONGEST_STEP / longest;
        }
        Some(step)
    }

    /// Position error and rotation vector from tip to goal (base axes), stacked; and the pose error.
    fn deviation(&mut self, q: &DVector<f64>) -> (Vector6<f64>, PoseError) {
        self.workspace.set_positions(q);
        let X_BE = self.workspace.X_BF(self.tip);
        let error = PoseError::between(&X_BE, self.X_BD);
        // Through the quaternion: the matrix logarithm loses half the digits at small angles.
        let turn = UnitQuaternion::from(self.X_BD.rotation * X_BE.rotation.inverse()).scaled_axis();
        let p = &error.position;
        (Vector6::new(p.x, p.y, p.z, turn.x, turn.y, turn.z), error)
    }
}

fn within_limits(joint: &Joint, position: f64) -> f64 {
    position.clamp(joint.limits.lower, joint.limits.upper)
}

/// The same posture with every angle within half a turn of `start`, as far as limits allow.
fn unwound(model: &Model, mut q: DVector<f64>, start: &DVector<f64>) -> DVector<f64> {
    for (j, joint) in model.joints().iter().enumerate() {
        if joint.kind.is_rotational() {
            let turns = ((q[j] - start[j]) / std::f64::consts::TAU).round();
            let nearer = q[j] - turns * std::f64::consts::TAU;
            if within_limits(joint, nearer) == nearer {
                q[j] = nearer;
            }
        }
    }
    q
}

#[cfg(test)]
mod tests {
    use super::*;

    fn servicer() -> (Model, Frame) {
        let model =
            Model::from_urdf(include_str!("../../../../urdf/servicer.urdf"), "servicer").unwrap();
        let tip = model.frame("tool0").unwrap().clone();
        (model, tip)
    }

    fn pose(model: &Model, tip: &Frame, q: &DVector<f64>) -> Pose {
        let mut workspace = Workspace::new(model);
        workspace.set_positions(q);
        workspace.X_BF(tip)
    }

    #[test]
    fn reachable_goals_are_found_from_anywhere() {
        let (model, tip) = servicer();
        let mut random = StdRng::seed_from_u64(7);
        let mut posture = || DVector::from_fn(6, |_, _| random.random_range(-3.0..3.0));
        let mut found = 0;
        for _ in 0..100 {
            let (goal, start) = (pose(&model, &tip, &posture()), posture());
            if let Ok(q) = inverse_kinematics(&model, &tip, &goal, &start) {
                found += 1;
                let left = PoseError::between(&pose(&model, &tip, &q), &goal);
                assert!(left.position.norm() < 1e-8 && left.angle < 1e-8);
                assert!((q - start).amax() <= std::f64::consts::PI + 1e-12);
            }
        }
        assert_eq!(found, 100);
    }

    #[test]
    fn solutions_respect_joint_limits() {
        let xml = include_str!("../../../../urdf/servicer.urdf").replacen(
            "<joint name=\"joint3\" type=\"continuous\">",
            "<joint name=\"joint3\" type=\"revolute\">\
             <limit lower=\"0.2\" upper=\"2.5\" effort=\"1e3\" velocity=\"1\"/>",
            1,
        );
        let model = Model::from_urdf(&xml, "limited servicer").unwrap();
        let tip = model.frame("tool0").unwrap().clone();
        assert_eq!(model.joints()[2].limits.lower, 0.2);
        let goal = pose(
            &model,
            &tip,
            &DVector::from_row_slice(&[0.3, -0.4, 0.9, 0.5, 0.3, -0.2]),
        );
        // From here the descent leads to the solution with the elbow on the other side.
        let start = DVector::from_row_slice(&[0.3, 0.5, -0.9, 0.1, 0.3, -0.2]);
        let q = inverse_kinematics(&model, &tip, &goal, &start).unwrap();
        assert!((0.2..=2.5).contains(&q[2]), "{q}");
    }

    #[test]
    fn an_unreachable_goal_is_an_error() {
        let (model, tip) = servicer();
        let start = DVector::from_element(6, 0.3);
        let mut far = pose(&model, &tip, &start);
        far.translation.x += 30.0;
        let refused = inverse_kinematics(&model, &tip, &far, &start);
        assert!(matches!(refused, Err(IkError::NotFound { position, .. }) if position > 10.0));
    }
}
