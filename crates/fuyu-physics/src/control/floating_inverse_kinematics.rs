//! Inverse kinematics on a free-floating base.

use nalgebra::{
    DVector, Matrix6, Matrix6xX, Point3, Translation3, UnitQuaternion, Vector3, Vector6,
};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::damped_descent::{DampedDescent, Deviation, Nearest, TipSearch, shortened};
use super::inverse_kinematics::rotation_vector;
use super::{IkError, PoseError};
use crate::dynamics::Workspace;
use crate::model::{Frame, Joint, Model};
use crate::spatial::{Pose, exp_so3};

/// Largest remaining error of a solution \[m and rad\], smaller than that of the base's predicted motion.
const TOLERANCE: f64 = 1e-6;
/// Largest change of a joint in one step of the search \[rad or m\].
const LONGEST_STEP: f64 = 0.4;
/// Number of starts of the search in addition to the given one.
const RESTARTS: usize = 60;
const DESCENT: DampedDescent = DampedDescent {
    steps: 150,
    damping: 1e-3,
    range: (1e-10, 1e6),
};
/// Steps in which the base's rotation is integrated along the motion of the joints.
const PIECES: usize = 12;
/// Distance kept from position limits \[rad or m\], so that a tracking error does not end at a stop.
const MARGIN: f64 = 0.02;
/// Largest rotation from the start, for joints without limits \[rad\].
const LARGEST_TURN: f64 = 2.0 * std::f64::consts::PI;
/// Largest displacement from the start, for sliders without limits \[m\].
const LARGEST_WAY: f64 = 6.0;

/// Inverse kinematics of an arm on a free-floating base without momentum, whose joints move along a straight line in
/// joint space: the base turns by eq. (4.23) of Masutani 1995, integrated along the line, and the system's centre of
/// mass stays in place. The final attitude of the base depends on the path, so the positions are valid for this path
/// only.
#[derive(Debug, Clone)]
pub struct FloatingInverseKinematics {
    model: Model,
    tip: Frame,
    /// Whether the goal's attitude is controlled, or its position only.
    controls_attitude: bool,
    workspace: Workspace,
    jacobian: Matrix6xX<f64>,
    base_map: Matrix6xX<f64>,
    middle: DVector<f64>,
    nearest: DVector<f64>,
}

impl FloatingInverseKinematics {
    /// Inverse kinematics for the frame `tip` of `model`.
    pub fn new(model: &Model, tip: &Frame) -> Self {
        let n = model.dof();
        Self {
            model: model.clone(),
            tip: tip.clone(),
            controls_attitude: true,
            workspace: Workspace::new(model),
            jacobian: Matrix6xX::zeros(n),
            base_map: Matrix6xX::zeros(n),
            middle: DVector::zeros(n),
            nearest: DVector::zeros(n),
        }
    }

    /// The positions nearest to the goal in the last search that failed.
    pub fn nearest(&self) -> &DVector<f64> {
        &self.nearest
    }

    /// Sets whether the goal's attitude is controlled, or its position only.
    pub fn set_controls_attitude(&mut self, controls_attitude: bool) {
        self.controls_attitude = controls_attitude;
    }

    /// Pose of the tip after the joints have moved straight from `start` to `end`, in the base frame at the start.
    ///
    /// # Panics
    /// If a vector does not have one element per joint.
    pub fn tip_after(&mut self, start: &DVector<f64>, end: &DVector<f64>) -> Pose {
        let workspace = &mut self.workspace;
        workspace.set_positions(start);
        let p_C = *workspace.p_BC();
        let step = (end - start) / PIECES as f64;
        let mut R = UnitQuaternion::identity();
        for piece in 0..PIECES {
            let middle = piece as f64 + 0.5;
            for (j, q) in self.middle.iter_mut().enumerate() {
                *q = start[j] + step[j] * middle;
            }
            workspace.set_positions(&self.middle);
            workspace.base_map(&mut self.base_map);
            let turned: Vector3<f64> = self.base_map.fixed_rows::<3>(3) * &step;
            R *= exp_so3(&turned);
        }
        workspace.set_positions(end);
        let p = p_C - R * workspace.p_BC();
        let X_0B = Pose::from_parts(Translation3::from(p), R.to_rotation_matrix());
        X_0B * workspace.X_BF(&self.tip)
    }

    /// Joint positions, within the limits, to which the joints move straight from `start` so that the tip ends at
    /// `X_BD` (base frame at the start): damped least squares with step control, with the generalized Jacobian. The
    /// search descends from `guess`; if that does not reach the goal, it restarts from up to 60 pseudo-random
    /// positions, the same in every call.
    ///
    /// # Errors
    /// [`IkError::NotFound`] if no start leads within 1e-6 m and rad.
    pub fn solve(
        &mut self,
        start: &DVector<f64>,
        X_BD: &Pose,
        guess: &DVector<f64>,
    ) -> Result<DVector<f64>, IkError> {
        let mut random = StdRng::seed_from_u64(1);
        let mut search = Search {
            kinematics: self,
            start,
            X_BD,
        };
        let found = DESCENT.search(&mut search, 1 + RESTARTS, |search, attempt| {
            let joints = search.kinematics.model.joints().iter();
            let from = joints.zip(start).zip(guess).map(|((joint, q), guess)| {
                let [lower, upper] = range(joint, *q);
                match attempt {
                    0 => guess.clamp(lower, upper),
                    _ if lower < upper => random.random_range(lower..upper),
                    _ => lower,
                }
            });
            DVector::from_iterator(start.len(), from)
        });
        found.map_err(|Nearest { point, left }| {
            if let Some(q) = point {
                self.nearest = q;
            }
            IkError::NotFound {
                position: left.0,
                angle: left.1,
            }
        })
    }
}

struct Search<'a> {
    kinematics: &'a mut FloatingInverseKinematics,
    start: &'a DVector<f64>,
    X_BD: &'a Pose,
}

impl TipSearch for Search<'_> {
    type Point = DVector<f64>;
    type Residual = Vector6<f64>;

    /// The residual is position error and rotation vector from the tip to the goal, stacked, in axes of the base at `q`.
    fn deviation(&mut self, q: &DVector<f64>) -> Deviation<Vector6<f64>> {
        let X_0E = self.kinematics.tip_after(self.start, q);
        let FloatingInverseKinematics {
            workspace,
            tip,
            controls_attitude,
            ..
        } = &*self.kinematics;
        // The workspace is at q: the tip's pose there gives the axes.
        let R_0B = X_0E.rotation * workspace.X_BF(tip).rotation.inverse();
        let error = PoseError::between(&X_0E, self.X_BD);
        let turn = rotation_vector(&X_0E, self.X_BD);
        let (p, mut turn) = (R_0B.inverse() * error.position, R_0B.inverse() * turn);
        if !controls_attitude {
            turn.fill(0.0);
        }
        Deviation::stacked(&p, &turn, &error)
    }

    fn is_at_goal(&self, left: (f64, f64)) -> bool {
        left.0 <= TOLERANCE && (!self.kinematics.controls_attitude || left.1 <= TOLERANCE)
    }

    /// A step within the ranges of the joints. Joints at the end of their range that would leave it take no part; they
    /// are found in two rounds.
    fn step(
        &mut self,
        q: &DVector<f64>,
        residual: &Vector6<f64>,
        damping: f64,
    ) -> Option<DVector<f64>> {
        let FloatingInverseKinematics {
            model,
            tip,
            controls_attitude,
            workspace,
            jacobian,
            ..
        } = &mut *self.kinematics;
        let ranges: Vec<[f64; 2]> = (model.joints().iter().zip(self.start))
            .map(|(joint, from)| range(joint, *from))
            .collect();
        workspace.set_positions(q);
        workspace.generalized_jacobian(tip, jacobian);
        if !*controls_attitude {
            jacobian.fixed_rows_mut::<3>(3).fill(0.0);
        }
        let mut blocked = vec![false; q.len()];
        let mut rounds = 0;
        let step: DVector<f64> = loop {
            let normal = &*jacobian * jacobian.transpose() + Matrix6::identity() * damping;
            let step = jacobian.tr_mul(&normal.cholesky()?.solve(residual));
            let before = blocked.clone();
            for (j, [lower, upper]) in ranges.iter().enumerate() {
                if q[j] >= *upper && step[j] > 0.0 || q[j] <= *lower && step[j] < 0.0 {
                    blocked[j] = true;
                    jacobian.column_mut(j).fill(0.0);
                }
            }
            rounds += 1;
            if rounds > 2 || blocked == before || !blocked.contains(&false) {
                break step;
            }
        };
        let step = shortened(step, LONGEST_STEP);
        let moved = ranges.iter().zip(q.iter().zip(&step));
        let moved = moved.map(|([lower, upper], (q, d))| (q + d).clamp(*lower, *upper));
        Some(DVector::from_iterator(q.len(), moved))
    }
}

/// Range of positions that the search uses, for a joint that starts at `q`.
fn range(joint: &Joint, q: f64) -> [f64; 2] {
    let limits = &joint.limits;
    let margin = MARGIN.min(0.1 * (limits.upper - limits.lower));
    let farthest = match joint.kind.is_rotational() {
        true => LARGEST_TURN,
        false => LARGEST_WAY,
    };
    let lower = (limits.lower + margin).max(q.min(limits.upper) - farthest);
    let upper = (limits.upper - margin).min(q.max(limits.lower) + farthest);
    match lower <= upper {
        true => [lower, upper],
        false => [q, q],
    }
}

/// The goal relative to the system's centre of mass in non-rotating axes: it stays fixed while the arm moves.
pub(super) fn goal_at_rest(workspace: &Workspace, R_IB: &UnitQuaternion<f64>, X_BD: &Pose) -> Pose {
    let p = Point3::from(X_BD.translation.vector - workspace.p_BC());
    let R = R_IB.to_rotation_matrix();
    Pose::from_parts(Translation3::from((R * p).coords), R * X_BD.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::fixtures::servicer;
    use crate::dynamics::{Floating, IntegrationMethod, State};

    /// Compares with the dynamics: a robot at rest whose joints are driven along the line. Fails if the base turns the
    /// other way, or if its centre of mass moves.
    #[test]
    fn the_tip_ends_where_the_dynamics_put_it() {
        let (model, tip) = servicer();
        let start = DVector::from_row_slice(&[0.3, 0.8, -1.0, 0.4, 0.2, -0.3]);
        let end = DVector::from_row_slice(&[0.5, 0.5, -1.4, 0.1, 0.6, 0.2]);
        let mut floating = FloatingInverseKinematics::new(&model, &tip);
        let predicted = floating.tip_after(&start, &end);
        let mut state = State::at_rest_with(&model, &start);
        state.qd = &end - &start;
        let X_WB = state.X_WB(&{
            let mut workspace = Workspace::new(&model);
            workspace.set_positions(&start);
            workspace
        });
        let mut robot = Floating::new(model.clone(), state, IntegrationMethod::Dop8);
        // Constant rates by computed accelerations would hide the map: step states with held rates instead.
        for _ in 0..1000 {
            robot.step(1e-3, 1);
            let mut state = robot.state().clone();
            state.qd = &end - &start;
            let done = state.time;
            state.q = &start + (&end - &start) * done;
            robot.set_state(state);
        }
        let found =
            X_WB.inverse() * robot.state().X_WB(robot.workspace()) * robot.workspace().X_BF(&tip);
        let error = PoseError::between(&found, &predicted);
        assert!(
            error.position.norm() < 2e-3 && error.angle < 2e-3,
            "{error:?}"
        );
        // On a fixed base the tip ends elsewhere.
        let mut workspace = Workspace::new(&model);
        workspace.set_positions(&end);
        let fixed = PoseError::between(&workspace.X_BF(&tip), &predicted);
        assert!(fixed.position.norm() > 0.02, "{fixed:?}");
    }

    #[test]
    fn positions_are_found_and_unreachable_goals_refused() {
        let (model, tip) = servicer();
        let mut floating = FloatingInverseKinematics::new(&model, &tip);
        let start = DVector::from_element(6, 0.4);
        let mut random = StdRng::seed_from_u64(5);
        for _ in 0..20 {
            let end = DVector::from_fn(6, |_, _| random.random_range(-2.0..2.0));
            let goal = floating.tip_after(&start, &end);
            let q = floating.solve(&start, &goal, &start).unwrap();
            let left = PoseError::between(&floating.tip_after(&start, &q), &goal);
            assert!(left.position.norm() < 1e-5 && left.angle < 1e-5);
        }
        let mut far = floating.tip_after(&start, &start);
        far.translation.x += 30.0;
        let refused = floating.solve(&start, &far, &start);
        assert!(matches!(refused, Err(IkError::NotFound { position, .. }) if position > 10.0));
    }
}
