//! Steps of several independent robots in the SIMD lanes of one register.

use super::block::{Block, put, read};
use super::{Batch, Piece, Scratch, Task};
use crate::dynamics::joint_physics::JointSteps;
use crate::dynamics::kernel::GROUP_SIZE;
use crate::dynamics::{Floating, Tableau};
use crate::model::Model;

/// Steps several [`Floating`] of the same robot together, each under its own held efforts: one instruction computes as
/// many robots as a register has lanes. The robots keep their states and inputs; only the steps are common.
///
/// Results are bit-identical to those of [`Floating::step`]. There are no threads.
///
/// ```
/// use fuyu_physics::dynamics::{Floating, IntegrationMethod, State, SimdGroup};
/// use fuyu_physics::model::Model;
///
/// let urdf = include_str!("../../../../../urdf/planar_two_link.urdf");
/// let model = Model::from_urdf(urdf, "planar_two_link.urdf")?;
/// let robot = |effort| {
///     let mut robot = Floating::new(model.clone(), State::at_rest(&model), IntegrationMethod::Rk4);
///     robot.hold_efforts(&[effort, 0.0]); // N m
///     robot
/// };
/// let (mut first, mut second, mut alone) = (robot(1.0), robot(2.0), robot(2.0));
/// let mut together = SimdGroup::new(&first).ok_or("this robot is stepped alone")?;
/// assert!(together.fits(&second));
/// together.step(&mut [&mut first, &mut second], 0.01, 10);
/// alone.step(0.01, 10);
/// assert_eq!(second.state(), alone.state());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct SimdGroup {
    batch: Batch,
    tableau: &'static Tableau,
    /// The states before the step.
    before: Block,
    /// Positions and rates of a robot before and after a step.
    joints: [Vec<f64>; 4],
}

impl SimdGroup {
    /// For robots like `robot`. `None` if a batch cannot step it: closed loops, damping or friction in the joints,
    /// mimic joints, another formulation.
    pub fn new(robot: &Floating) -> Option<Self> {
        let tableau = robot.lane_tableau()?;
        let model = robot.model();
        let mut batch = Batch::with_tableau(model, tableau, GROUP_SIZE);
        // A step in which a joint reaches a limit is repeated by the robot itself.
        batch.setup.joints = JointSteps::Never;
        batch.scratch = vec![Scratch::new(&batch.setup)];
        Some(Self {
            tableau,
            before: batch.blocks[0].clone(),
            joints: std::array::from_fn(|_| vec![0.0; model.dof()]),
            batch,
        })
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.batch.setup.model
    }

    /// Whether `robot` can be stepped with the others: the same model and integration, and no external wrench.
    pub fn fits(&self, robot: &Floating) -> bool {
        let tableau = robot.lane_tableau();
        tableau.is_some_and(|tableau| std::ptr::eq(tableau, self.tableau))
            && robot.model() == self.model()
    }

    /// Advances all robots by `steps` steps of `dt` \[s\] under their held efforts. They must [fit](Self::fits), which
    /// is not checked.
    ///
    /// # Panics
    /// If a robot has another number of joints.
    pub fn step(&mut self, robots: &mut [&mut Floating], dt: f64, steps: usize) {
        for group in robots.chunks_mut(GROUP_SIZE) {
            for _ in 0..steps {
                self.step_group(group, dt);
            }
        }
    }

    fn step_group(&mut self, robots: &mut [&mut Floating], dt: f64) {
        let Self {
            batch,
            before,
            joints,
            ..
        } = self;
        let block = &mut batch.blocks[0];
        for (lane, robot) in robots.iter().enumerate() {
            block.set_state(lane, robot.state());
            put(&mut block.efforts, lane, robot.efforts().as_slice());
        }
        before.copy_states(block);
        let piece = Piece {
            setup: &batch.setup,
            blocks: &mut batch.blocks,
            scratch: &mut batch.scratch[0],
            task: Task::Step { dt, steps: 1 },
        };
        piece.run(None);
        let block = &batch.blocks[0];
        for (lane, robot) in robots.iter_mut().enumerate() {
            let [q, qd, next_q, next_qd] = &mut *joints;
            read(&before.q, lane, q);
            read(&before.qd, lane, qd);
            read(&block.q, lane, next_q);
            read(&block.qd, lane, next_qd);
            match robot.is_free((q, qd), (next_q, next_qd), dt) {
                true => robot.change_state(|state| block.read_state(lane, state)),
                false => robot.step(dt, 1),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::{IntegrationMethod, State};
    use nalgebra::DVector;

    fn robots(urdf: &str, count: usize) -> Vec<Floating> {
        let model = Model::from_urdf(urdf, "robot").unwrap();
        let robots = (0..count).map(|k| {
            let wave = |j: usize, i: f64| (1.7 * (k * 6 + j) as f64 + i).sin();
            let mut state =
                State::at_rest_with(&model, &DVector::from_fn(model.dof(), |j, _| wave(j, 0.0)));
            state.qd = DVector::from_fn(model.dof(), |j, _| wave(j, 1.0));
            state.momentum_W.angular.x = wave(0, 2.0);
            state.momentum_W.linear.y = wave(0, 3.0);
            let mut robot = Floating::new(model.clone(), state, IntegrationMethod::Rk4);
            let efforts: Vec<_> = (0..model.dof()).map(|j| 10.0 * wave(j, 4.0)).collect();
            robot.hold_efforts(&efforts);
            robot
        });
        robots.collect()
    }

    fn assert_as_alone(urdf: &str) {
        let (mut all, mut alone) = (robots(urdf, 19), robots(urdf, 19));
        let mut together = SimdGroup::new(&all[0]).unwrap();
        assert!(all.iter().all(|robot| together.fits(robot)));
        for _ in 0..30 {
            let mut group: Vec<_> = all.iter_mut().collect();
            together.step(&mut group, 0.01, 3);
            alone.iter_mut().for_each(|robot| robot.step(0.01, 3));
        }
        for (one, expected) in all.iter_mut().zip(&mut alone) {
            assert_eq!(one.state(), expected.state());
            assert_eq!(one.workspace().V_WB_B(), expected.workspace().V_WB_B());
            assert_eq!(one.accelerations(), expected.accelerations());
        }
    }

    #[test]
    fn robots_move_together_as_alone() {
        assert_as_alone(include_str!("../../../../../urdf/servicer.urdf"));
    }

    // Some robots reach their limits, others do not.
    #[test]
    fn a_robot_that_reaches_a_limit_is_stepped_as_alone() {
        let urdf = include_str!("../../../../../urdf/servicer.urdf");
        let limited = urdf.replacen(
            r#"<joint name="joint1" type="continuous">"#,
            r#"<joint name="joint1" type="revolute"><limit lower="-0.9" upper="0.9" effort="100" velocity="2"/>"#,
            1,
        );
        assert_ne!(urdf, limited);
        assert_as_alone(&limited);
    }

    #[test]
    fn robots_that_are_not_stepped_in_lanes_are_refused() {
        let urdf = include_str!("../../../../../urdf/servicer.urdf");
        let mut robot = robots(urdf, 1).remove(0);
        let together = SimdGroup::new(&robot).unwrap();
        robot.input_mut().wrenches[0].force.x = 1.0;
        assert!(!together.fits(&robot) && SimdGroup::new(&robot).is_none());
        let other = robots(&urdf.replace(r#"value="2000""#, r#"value="2001""#), 1);
        assert!(!together.fits(&other[0]));
    }
}
