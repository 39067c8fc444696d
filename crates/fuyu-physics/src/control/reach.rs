//! Inverse kinematics of a free-floating robot: joint motions at zero momentum that bring the tip to a goal in the world.

use nalgebra::{DMatrix, DVector, Matrix6xX, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::damped_descent::{DampedDescent, Deviation, Nearest, TipSearch, shortened};
use super::workspace_radius;
use crate::dynamics::{State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::{Pose, exp_so3};

/// Goal of the tip's frame, in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReachGoal {
    /// Position of the frame's origin \[m\].
    pub position: Vector3<f64>,
    /// Attitude; any if `None`.
    pub attitude: Option<UnitQuaternion<f64>>,
}

/// A motion that reaches the goal.
#[derive(Debug, Clone, PartialEq)]
pub struct Reached {
    /// Joint positions along the motion, from the start to the end, connected by straight lines in joint space.
    pub path: Vec<DVector<f64>>,
    /// Pose of the base frame at the end of the motion, in the world.
    pub X_WB: Pose,
    /// Pose of the tip at the end of the motion, in the world.
    pub X_WE: Pose,
}

impl Reached {
    /// Joint positions at the end \[rad or m\].
    pub fn q(&self) -> &DVector<f64> {
        &self.path[self.path.len() - 1]
    }
}

/// Why no motion was found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ReachError {
    /// No joint moves the tip.
    #[error("no joint moves the tip")]
    FixedTip,
    /// The goal is farther from the centre of mass, which does not move, than the tip can be in any posture.
    #[error(
        "the goal is {distance:.4} m from the centre of mass, which cannot move; the tip gets at most {reach:.4} m away from it"
    )]
    TooFar {
        /// Distance of the goal from the centre of mass \[m\].
        distance: f64,
        /// Upper bound of the tip's distance from the centre of mass \[m\].
        reach: f64,
    },
    /// The search found no motion.
    #[error(
        "no motion was found that reaches the goal: the nearest pose found is {position:.4} m and {angle:.4} rad away"
    )]
    NotFound {
        /// Remaining position error \[m\].
        position: f64,
        /// Remaining attitude error \[rad\]; zero if the attitude is free.
        angle: f64,
    },
}

/// Largest remaining error \[m and rad\].
const TOLERANCE: f64 = 1e-9;
/// Largest change of a joint in one step \[rad or m\], for which the base's rotation is integrated to some 1e-8 rad.
const LONGEST_STEP: f64 = 0.05;
/// Number of other postures from which the search restarts.
const DETOURS: usize = 30;
/// Largest change of a joint on the way to such a posture \[rad or m\].
const DETOUR: f64 = 2.0;
const DESCENT: DampedDescent = DampedDescent {
    steps: 400,
    damping: 1e-3,
    range: (1e-12, 1e8),
};

/// A joint motion from `start` that brings `tip` to `goal`, for a free-floating robot at zero momentum: the base turns
/// with the joints by momentum conservation, and the centre of mass stays where it is in `start`. Momentum and rates of
/// `start` are ignored.
///
/// The system is nonholonomic: the final attitude of the base depends on the whole path, not only on the final joint
/// positions. The search therefore follows motions. It descends along the generalized Jacobian (damped least squares on
/// position and rotation vector) within the joints' limits. If it gets stuck, the robot first moves to a pseudo-random
/// posture (the same in every call), which also turns the base, and descends from there. A goal that is not found may still
/// be reachable; a goal that is [`ReachError::TooFar`] is not.
///
/// # Errors
/// [`ReachError`].
///
/// # Panics
/// If `start` does not fit the robot.
pub fn free_floating_reach(
    model: &Model,
    tip: &Frame,
    start: &State,
    goal: &ReachGoal,
) -> Result<Reached, ReachError> {
    if tip.body == 0 {
        return Err(ReachError::FixedTip);
    }
    let distance = (goal.position - start.p_WC).norm();
    if let Some(reach) = workspace_radius(model, tip)
        && distance > reach + TOLERANCE
    {
        return Err(ReachError::TooFar { distance, reach });
    }
    let mut search = Search::new(model, tip, start, goal);
    let mut random = StdRng::seed_from_u64(1);
    let found = DESCENT.search(&mut search, 1 + DETOURS, |search, attempt| {
        let mut motion = Motion::at(start);
        if attempt > 0 {
            let posture = random_posture(model, &start.q, &mut random);
            search.travel(&mut motion, &posture);
        }
        motion
    });
    match found {
        Ok(motion) => {
            let [X_WB, X_WE] = search.poses(&motion);
            let path = motion.path;
            Ok(Reached { path, X_WB, X_WE })
        }
        Err(Nearest { left, .. }) => Err(ReachError::NotFound {
            position: left.0,
            angle: left.1,
        }),
    }
}

/// A posture within the limits, not far from `q`.
fn random_posture(model: &Model, q: &DVector<f64>, random: &mut StdRng) -> DVector<f64> {
    let joints = model.joints().iter().zip(q.iter());
    let posture = joints.map(|(joint, q)| {
        let lower = joint.limits.lower.max(q - DETOUR);
        let upper = joint.limits.upper.min(q + DETOUR);
        lower + (upper - lower) * random.random_range(0.0..1.0)
    });
    DVector::from_iterator(q.len(), posture)
}

/// Joint positions and attitude of the base during the motion.
#[derive(Debug, Clone)]
struct Motion {
    path: Vec<DVector<f64>>,
    R_WB: UnitQuaternion<f64>,
}

impl Motion {
    fn at(start: &State) -> Self {
        Self {
            path: vec![start.q.clone()],
            R_WB: start.R_WB,
        }
    }

    fn q(&self) -> &DVector<f64> {
        &self.path[self.path.len() - 1]
    }
}

struct Search<'a> {
    model: &'a Model,
    tip: &'a Frame,
    goal: &'a ReachGoal,
    p_WC: Vector3<f64>,
    workspace: Workspace,
    columns: Matrix6xX<f64>,
}

impl<'a> Search<'a> {
    fn new(model: &'a Model, tip: &'a Frame, start: &State, goal: &'a ReachGoal) -> Self {
        Self {
            model,
            tip,
            goal,
            p_WC: start.p_WC,
            workspace: Workspace::new(model),
            columns: Matrix6xX::zeros(model.dof()),
        }
    }

    /// Poses of base and tip in the world.
    fn poses(&mut self, motion: &Motion) -> [Pose; 2] {
        self.workspace.set_positions(motion.q());
        let R_WB = motion.R_WB.to_rotation_matrix();
        let p_WB = self.p_WC - R_WB * self.workspace.p_BC();
        let X_WB = Pose::from_parts(Translation3::from(p_WB), R_WB);
        [X_WB, X_WB * self.workspace.X_BF(self.tip)]
    }

    /// Angular velocity of the base for joint rates `rates`, base axes.
    fn base_rate(&mut self, q: &DVector<f64>, rates: &DVector<f64>) -> Vector3<f64> {
        self.workspace.set_positions(q);
        self.workspace.base_map(&mut self.columns);
        self.columns.fixed_rows::<3>(3) * rates
    }

    /// Moves the joints by `change`, and the base with them: Magnus's method of fourth order, with rates at the Gauss
    /// points.
    fn advance(&mut self, motion: &mut Motion, change: &DVector<f64>) {
        let at = |s: f64| motion.q() + change * (0.5 + s * 3.0_f64.sqrt() / 6.0);
        let (first, second) = (at(-1.0), at(1.0));
        let (a, b) = (
            self.base_rate(&first, change),
            self.base_rate(&second, change),
        );
        let turned = (a + b) * 0.5 + a.cross(&b) * (3.0_f64.sqrt() / 12.0);
        let q = motion.q() + change;
        motion.R_WB *= exp_so3(&turned);
        motion.path.push(q);
    }

    /// Moves the joints straight to a posture.
    fn travel(&mut self, motion: &mut Motion, posture: &DVector<f64>) {
        let change = posture - motion.q();
        let steps = (change.amax() / LONGEST_STEP).ceil().max(1.0);
        let step = change / steps;
        for _ in 0..steps as usize {
            self.advance(motion, &step);
        }
    }

    /// Change of the joints in a damped least-squares step within the limits: joints that it would move beyond their
    /// limits stop there, and the others compensate.
    fn change(
        &mut self,
        q: &DVector<f64>,
        residual: &DVector<f64>,
        damping: f64,
    ) -> Option<DVector<f64>> {
        let n = q.len();
        self.workspace.set_positions(q);
        self.workspace
            .generalized_jacobian(self.tip, &mut self.columns);
        let mut J = DMatrix::from_fn(residual.len(), n, |r, c| self.columns[(r, c)]);
        let mut left = residual.clone();
        let mut held = DVector::zeros(n);
        for _ in 0..=n {
            let normal = &J * J.transpose() + DMatrix::identity(J.nrows(), J.nrows()) * damping;
            let step = J.tr_mul(&normal.cholesky()?.solve(&left));
            let step = shortened(step, LONGEST_STEP);
            let mut is_within = true;
            for (j, joint) in self.model.joints().iter().enumerate() {
                let limited = (q[j] + step[j]).clamp(joint.limits.lower, joint.limits.upper);
                if step[j] != 0.0 && limited != q[j] + step[j] {
                    is_within = false;
                    held[j] = limited - q[j];
                    left.axpy(-held[j], &J.column(j), 1.0);
                    J.column_mut(j).fill(0.0);
                }
            }
            if is_within {
                return Some(step + held);
            }
        }
        Some(held)
    }
}

impl TipSearch for Search<'_> {
    type Point = Motion;
    type Residual = DVector<f64>;

    /// The residual is the position error and, if the attitude matters, the rotation vector to the goal (base axes), stacked.
    fn deviation(&mut self, motion: &Motion) -> Deviation<DVector<f64>> {
        let [X_WB, X_WE] = self.poses(motion);
        let R_BW = X_WB.rotation.inverse();
        let position = R_BW * (self.goal.position - X_WE.translation.vector);
        let turn = self.goal.attitude.map(|attitude| {
            let turn = attitude * UnitQuaternion::from(X_WE.rotation).inverse();
            R_BW * turn.scaled_axis()
        });
        let rows = position.iter().chain(turn.iter().flat_map(|t| t.iter()));
        let residual = DVector::from_iterator(if turn.is_some() { 6 } else { 3 }, rows.copied());
        Deviation {
            norm_squared: residual.norm_squared(),
            left: (position.norm(), turn.map_or(0.0, |t| t.norm())),
            residual,
        }
    }

    fn is_at_goal(&self, left: (f64, f64)) -> bool {
        left.0 <= TOLERANCE && left.1 <= TOLERANCE
    }

    fn step(&mut self, motion: &Motion, residual: &DVector<f64>, damping: f64) -> Option<Motion> {
        let change = self.change(motion.q(), residual, damping)?;
        let mut moved = motion.clone();
        self.advance(&mut moved, &change);
        Some(moved)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::fixtures::servicer;
    use crate::dynamics::Momentum;
    use crate::model::{JointKind, ModelBuilder};
    use crate::spatial::RigidInertia;
    use nalgebra::{Isometry3, Matrix3};

    fn start(model: &Model) -> State {
        let q = DVector::from_fn(model.dof(), |j, _| 0.4 - 0.2 * j as f64);
        let mut state = State::at_rest_with(model, &q);
        let pose = Isometry3::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.3, 0.6, -0.4));
        state.set_base(&mut Workspace::new(model), &pose, &Default::default());
        state
    }

    /// Pose of tip and base after the joints have moved along a path: small steps of the midpoint rule on the base
    /// twist at zero momentum, unlike the integration of the search.
    fn integrated(model: &Model, tip: &Frame, start: &State, path: &[DVector<f64>]) -> [Pose; 2] {
        const PIECES: usize = 200;
        let mut workspace = Workspace::new(model);
        let mut state = start.clone();
        for pair in path.windows(2) {
            let rate = (&pair[1] - &pair[0]) / PIECES as f64;
            for k in 0..PIECES {
                workspace.set_positions(&(&pair[0] + &rate * (k as f64 + 0.5)));
                let twist = workspace.base_twist(&Momentum::default(), &rate);
                state.R_WB *= UnitQuaternion::from_scaled_axis(twist.angular);
            }
        }
        workspace.set_positions(path.last().unwrap());
        let X_WB = state.X_WB(&workspace);
        [X_WB, X_WB * workspace.X_BF(tip)]
    }

    #[test]
    fn goals_of_feasible_motions_are_reached() {
        let (model, tip) = servicer();
        let start = start(&model);
        let mut random = StdRng::seed_from_u64(5);
        let mut reached = 0;
        for _ in 0..20 {
            let posture = random_posture(&model, &start.q, &mut random);
            let [_, goal] = integrated(&model, &tip, &start, &[start.q.clone(), posture]);
            let goal = ReachGoal {
                position: goal.translation.vector,
                attitude: Some(UnitQuaternion::from(goal.rotation)),
            };
            let Ok(found) = free_floating_reach(&model, &tip, &start, &goal) else {
                continue;
            };
            reached += 1;
            assert_eq!(found.path[0], start.q);
            let [base, end] = integrated(&model, &tip, &start, &found.path);
            let apart = (end.translation.vector - goal.position).norm();
            let turned = UnitQuaternion::from(end.rotation).angle_to(&goal.attitude.unwrap());
            assert!(apart < 1e-6 && turned < 1e-6, "{apart} {turned}");
            assert!((base.translation.vector - found.X_WB.translation.vector).norm() < 1e-6);
        }
        assert!(reached >= 19, "{reached}");
    }

    #[test]
    fn positions_alone_leave_the_attitude_free_and_limits_hold() {
        let xml = include_str!("../../../../urdf/servicer.urdf").replacen(
            "<joint name=\"joint3\" type=\"continuous\">",
            "<joint name=\"joint3\" type=\"revolute\">\
             <limit lower=\"-0.5\" upper=\"0.3\" effort=\"1e3\" velocity=\"1\"/>",
            1,
        );
        let model = Model::from_urdf(&xml, "limited").unwrap();
        let tip = model.frame("tool0").unwrap().clone();
        let start = start(&model);
        let [_, now] = integrated(&model, &tip, &start, std::slice::from_ref(&start.q));
        let goal = ReachGoal {
            position: now.translation.vector.lerp(&start.p_WC, 0.2) + Vector3::new(0.1, -0.3, 0.2),
            attitude: None,
        };
        let found = free_floating_reach(&model, &tip, &start, &goal).unwrap();
        assert!((found.X_WE.translation.vector - goal.position).norm() <= TOLERANCE);
        assert!(found.path.iter().all(|q| (-0.5..=0.3).contains(&q[2])));
        let [_, end] = integrated(&model, &tip, &start, &found.path);
        assert!((end.translation.vector - goal.position).norm() < 1e-6);
    }

    /// A boom on a base: its tip moves on a circle about the centre of mass, with a radius of 0.5 + 1 m minus the
    /// recoil of the base.
    #[test]
    fn a_single_joint_reaches_a_circle_only() {
        let turning = |mass: f64, inertia: f64| RigidInertia {
            mass,
            com: Vector3::zeros(),
            about_com: Matrix3::identity() * inertia,
        };
        let ball = |mass| turning(mass, 0.1);
        let mut builder = ModelBuilder::new("boom", "base", turning(3.0, 6.8));
        let axis = Vector3::z_axis();
        builder.body(
            "arm",
            0,
            JointKind::Continuous,
            axis,
            Pose::identity(),
            ball(1.0),
        );
        let far = Pose::translation(2.0, 0.0, 0.0);
        builder.weld(1, &ball(1.0).expressed_in(&far));
        builder.frame("tip", 1, Some("arm".to_owned()), far);
        let model = builder.build();
        let tip = model.frame("tip").unwrap();
        let start = State::at_rest(&model);
        // The centre of mass is 2/5 m from the joint, so the tip is 1.6 m from it.
        let at = |radius: f64, angle: f64| ReachGoal {
            position: start.p_WC + Vector3::new(angle.cos(), angle.sin(), 0.0) * radius,
            attitude: None,
        };
        assert!((start.p_WC.x - 0.4).abs() < 1e-15);
        let found = free_floating_reach(&model, tip, &start, &at(1.6, 1.0)).unwrap();
        // The arm with the base as a point has 0.2 + 4 · 0.4² + 1.6² = 3.4 kg m² about the centre of mass, half of the base's
        // own inertia: it turns by two thirds of the joint's angle, and the base by one third the other way.
        let base = nalgebra::UnitQuaternion::from(found.X_WB.rotation);
        assert!((found.q()[0] - 1.5).abs() < 1e-8, "{}", found.q());
        assert!((base.scaled_axis() - Vector3::new(0.0, 0.0, -0.5)).norm() < 1e-8);
        assert!(matches!(
            free_floating_reach(&model, tip, &start, &at(1.4, 1.0)),
            Err(ReachError::NotFound { position, .. }) if (position - 0.2).abs() < 1e-6
        ));
        assert!(matches!(
            free_floating_reach(&model, tip, &start, &at(1.7, 1.0)),
            Err(ReachError::TooFar { distance, reach })
                if (distance - 1.7).abs() < 1e-12 && (reach - 1.6).abs() < 1e-12
        ));
        assert_eq!(
            free_floating_reach(&model, &model.frames()[0], &start, &at(1.0, 0.0)),
            Err(ReachError::FixedTip)
        );
    }
}
