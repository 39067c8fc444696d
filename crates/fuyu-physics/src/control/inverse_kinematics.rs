//! Inverse kinematics of the arm as if its base were fixed.

use nalgebra::{DMatrix, DVector, Matrix6xX, UnitQuaternion, Vector3, Vector6};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::PoseError;
use super::damped_descent::{DampedDescent, Deviation, Nearest, TipSearch, shortened};
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
/// Largest change of a joint in one step \[rad or m\].
const LONGEST_STEP: f64 = 0.5;
/// Number of starts of the search in addition to the given one.
const RESTARTS: usize = 20;
const DESCENT: DampedDescent = DampedDescent {
    steps: 300,
    damping: 1e-2,
    range: (1e-12, 1e8),
};

/// Joint positions within the limits that bring `tip` to `X_BD` (base frame): damped least squares with step control
/// (Levenberg-Marquardt) on position and rotation vector. The search descends from `start`; if that does not reach the
/// goal, it restarts from pseudo-random positions, the same in every call. Angles are returned within half a turn of
/// `start` where limits allow.
///
/// # Errors
/// [`IkError::NotFound`] if no start leads within 1e-9 m and rad.
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
    let found = DESCENT.search(&mut search, 1 + RESTARTS, |_, attempt| {
        let from = model.joints().iter().zip(start.iter()).map(|(joint, &q)| {
            let away = if attempt == 0 {
                0.0
            } else {
                random.random_range(-2.0..2.0)
            };
            within_limits(joint, q + away)
        });
        DVector::from_iterator(model.dof(), from)
    });
    match found {
        Ok(q) => Ok(unwound(model, q, start)),
        Err(Nearest { left, .. }) => Err(IkError::NotFound {
            position: left.0,
            angle: left.1,
        }),
    }
}

struct Search<'a> {
    model: &'a Model,
    tip: &'a Frame,
    X_BD: &'a Pose,
    workspace: Workspace,
    jacobian: Matrix6xX<f64>,
}

impl TipSearch for Search<'_> {
    type Point = DVector<f64>;
    type Residual = Vector6<f64>;

    /// The residual is position error and rotation vector from tip to goal (base axes), stacked.
    fn deviation(&mut self, q: &DVector<f64>) -> Deviation<Vector6<f64>> {
        self.workspace.set_positions(q);
        let X_BE = self.workspace.X_BF(self.tip);
        let error = PoseError::between(&X_BE, self.X_BD);
        let (p, turn) = (&error.position, rotation_vector(&X_BE, self.X_BD));
        Deviation::stacked(p, &turn, &error)
    }

    fn is_at_goal(&self, left: (f64, f64)) -> bool {
        left.0 <= TOLERANCE && left.1 <= TOLERANCE
    }

    /// A step within the limits, solved in the smaller one of joint space and task space.
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
        let step = if q.len() <= 6 {
            let normal = J.tr_mul(J) + DMatrix::identity(q.len(), q.len()) * damping;
            normal.cholesky()?.solve(&J.tr_mul(residual))
        } else {
            let normal = J * J.transpose() + nalgebra::Matrix6::identity() * damping;
            J.tr_mul(&normal.cholesky()?.solve(residual))
        };
        let step = shortened(step, LONGEST_STEP);
        let joints = self.model.joints().iter();
        let moved = joints
            .zip(q.iter().zip(&step))
            .map(|(j, (q, d))| within_limits(j, q + d));
        Some(DVector::from_iterator(q.len(), moved))
    }
}

/// Rotation vector from the tip's attitude to the goal's, in the axes of both poses, computed from the quaternion: the
/// matrix logarithm loses half the digits at small angles.
pub(super) fn rotation_vector(X_BE: &Pose, X_BD: &Pose) -> Vector3<f64> {
    UnitQuaternion::from(X_BD.rotation * X_BE.rotation.inverse()).scaled_axis()
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
    use crate::control::fixtures::servicer;

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
