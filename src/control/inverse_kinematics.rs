//! Inverse kinematics of the arm as if its base were fixed.

use nalgebra::{DVector, Matrix6, Matrix6xX, UnitQuaternion, Vector6};

use super::PoseError;
use crate::dynamics::Workspace;
use crate::model::{Frame, JointKind, Model};
use crate::spatial::Pose;

/// Why no joint positions were found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IkError {
    /// The iteration stalled away from the goal.
    #[error(
        "the goal is out of reach: the closest pose found is {position:.4} m and {angle:.4} rad away"
    )]
    OutOfReach {
        /// Remaining position error \[m\].
        position: f64,
        /// Remaining attitude error \[rad\].
        angle: f64,
    },
}

/// Joint positions that bring `tip` to `X_BD` (base frame), starting from `start`: damped least squares
/// with step control (Levenberg-Marquardt on position and rotation vector). Of several solutions the
/// one downhill from `start` is found; angles of continuous joints are brought within half a turn of it.
///
/// # Errors
/// [`IkError::OutOfReach`] when the iteration ends more than 1e-9 m or rad away.
pub fn inverse_kinematics(
    model: &Model,
    tip: &Frame,
    X_BD: &Pose,
    start: &DVector<f64>,
) -> Result<DVector<f64>, IkError> {
    const TOLERANCE: f64 = 1e-9;
    let mut workspace = Workspace::new(model);
    let mut jacobian = Matrix6xX::zeros(model.dof());
    let mut q = start.clone();
    let mut damping = 1e-2;
    let (mut residual, mut error) = deviation(model, &mut workspace, tip, X_BD, &q);
    for _ in 0..500 {
        if error.position.norm() < TOLERANCE && error.angle < TOLERANCE {
            break;
        }
        workspace.set_positions(model, &q);
        workspace.fixed_base_jacobian(tip, &mut jacobian);
        let normal = &jacobian * jacobian.transpose() + Matrix6::identity() * damping;
        let Some(factor) = normal.cholesky() else {
            break;
        };
        let step = jacobian.transpose() * factor.solve(&residual);
        let trial = &q + step;
        let (trial_residual, trial_error) = deviation(model, &mut workspace, tip, X_BD, &trial);
        if trial_residual.norm_squared() < residual.norm_squared() {
            (q, residual, error) = (trial, trial_residual, trial_error);
            damping = (damping * 0.3).max(1e-12);
        } else {
            damping *= 4.0;
            if damping > 1e8 {
                break;
            }
        }
    }
    if error.position.norm() > TOLERANCE
        || error.angle > TOLERANCE
        || !q.iter().all(|x| x.is_finite())
    {
        return Err(IkError::OutOfReach {
            position: error.position.norm(),
            angle: error.angle,
        });
    }
    for (j, joint) in model.joints().iter().enumerate() {
        if joint.kind == JointKind::Continuous {
            let turns = ((q[j] - start[j]) / std::f64::consts::TAU).round();
            q[j] -= turns * std::f64::consts::TAU;
        }
    }
    Ok(q)
}

/// Position error and rotation vector from tip to goal (base axes), stacked; and the pose error.
fn deviation(
    model: &Model,
    workspace: &mut Workspace,
    tip: &Frame,
    X_BD: &Pose,
    q: &DVector<f64>,
) -> (Vector6<f64>, PoseError) {
    workspace.set_positions(model, q);
    let X_BE = workspace.X_BF(tip);
    let error = PoseError::between(&X_BE, X_BD);
    // Through the quaternion: the matrix logarithm loses half the digits at small angles.
    let turn = UnitQuaternion::from(X_BD.rotation * X_BE.rotation.inverse()).scaled_axis();
    let p = &error.position;
    (Vector6::new(p.x, p.y, p.z, turn.x, turn.y, turn.z), error)
}
