//! The formulations of forward dynamics against each other: they share the model and nothing else.

use fuyu::dynamics::{
    Floating, Formulation, FormulationKind, Input, IntegrationMethod, InverseDynamics, State,
    TreeAcceleration, TreeMotion,
};
use fuyu::model::{Joint, JointKind, JointLimits, Model, ModelBuilder, Spring};
use fuyu::spatial::{Pose, RigidInertia, Twist, Wrench};
use nalgebra::{DVector, Matrix3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Draws robots and motions from a seed.
pub struct Draw(StdRng);

impl Draw {
    pub fn new(seed: u64) -> Self {
        Self(StdRng::seed_from_u64(seed))
    }

    pub fn number(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    pub fn vector(&mut self, scale: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.0.random_range(-scale..scale))
    }

    fn rotation(&mut self) -> Rotation3<f64> {
        // Every third one is a right angle or none, as in most arms.
        let quarter = std::f64::consts::FRAC_PI_2;
        match self.0.random_range(0..6) {
            0 => Rotation3::identity(),
            1 => Rotation3::from_euler_angles(quarter, 0.0, -quarter),
            _ => Rotation3::new(self.vector(2.0)),
        }
    }

    fn inertia(&mut self, mass: f64) -> RigidInertia {
        let s = [0; 3].map(|_| self.number(0.02, 0.5));
        let principal = Vector3::new(s[1] + s[2], s[0] + s[2], s[0] + s[1]) * mass;
        let r = *self.rotation().matrix();
        let about_com = r * Matrix3::from_diagonal(&principal) * r.transpose();
        RigidInertia {
            mass,
            com: self.vector(0.5),
            about_com: (about_com + about_com.transpose()) * 0.5,
        }
    }

    fn axis(&mut self) -> Unit<Vector3<f64>> {
        match self.0.random_range(0..5) {
            0 => Vector3::x_axis(),
            1 => Vector3::y_axis(),
            2 => -Vector3::z_axis(),
            _ => Unit::new_normalize(self.vector(1.0) + Vector3::new(0.0, 0.0, 1.5)),
        }
    }

    /// A tree of 2 to `most` bodies with revolute and prismatic joints, springs and dampers.
    pub fn tree(&mut self, most: usize) -> Model {
        let mass = self.number(5.0, 500.0);
        let mut builder = ModelBuilder::new("random", "base_link", self.inertia(mass));
        let mut path = vec![0];
        for k in 1..self.0.random_range(2..=most) {
            let up = self.0.random_range(0..6usize).saturating_sub(3);
            path.truncate(path.len().saturating_sub(up).max(1));
            let translation = match self.0.random_range(0..4) {
                0 => Vector3::new(self.number(0.1, 1.0), 0.0, 0.0),
                1 => Vector3::zeros(),
                _ => self.vector(1.0),
            };
            let slides = self.0.random_range(0..3) == 0;
            let joint = Joint {
                name: format!("joint{k}"),
                kind: if slides {
                    JointKind::Prismatic
                } else {
                    JointKind::Continuous
                },
                axis: self.axis(),
                X_PJ: Pose::from_parts(Translation3::from(translation), self.rotation()),
                limits: JointLimits::NONE,
                damping: self.number(0.0, 5.0),
                friction: 0.0,
                spring: Spring {
                    stiffness: self.number(0.0, 20.0),
                    rest: self.number(-1.0, 1.0),
                },
            };
            let mass = self.number(1.0, 20.0);
            let inertia = self.inertia(mass);
            let parent = *path.last().unwrap();
            path.push(builder.joint(&format!("link{k}"), parent, joint, inertia));
        }
        builder.build()
    }

    pub fn motion(&mut self, model: &Model) -> Motion {
        let n = model.dof();
        let mut input = Input::zero(model);
        input.efforts = DVector::from_fn(n, |_, _| self.number(-20.0, 20.0));
        for wrench in &mut input.wrenches {
            if self.0.random_range(0..4) == 0 {
                *wrench = Wrench::new(self.vector(10.0), self.vector(10.0));
            }
        }
        Motion {
            R_WB: UnitQuaternion::new(self.vector(2.0)),
            V_WB_B: Twist::new(self.vector(1.0), self.vector(2.0)),
            q: (0..n).map(|_| self.number(-3.0, 3.0)).collect(),
            qd: (0..n).map(|_| self.number(-2.0, 2.0)).collect(),
            input,
        }
    }
}

pub struct Motion {
    R_WB: UnitQuaternion<f64>,
    V_WB_B: Twist,
    pub q: Vec<f64>,
    pub qd: Vec<f64>,
    pub input: Input,
}

impl Motion {
    pub fn tree_motion(&self) -> TreeMotion<'_> {
        TreeMotion {
            R_WB: self.R_WB,
            V_WB_B: self.V_WB_B,
            q: &self.q,
            qd: &self.qd,
        }
    }
}

fn largest_difference(a: &TreeAcceleration, b: &TreeAcceleration) -> f64 {
    let joints = (&a.qdd - &b.qdd).amax();
    let base = a.A_WB_B - b.A_WB_B;
    joints.max(base.angular.amax()).max(base.linear.amax())
}

fn size(a: &TreeAcceleration) -> f64 {
    let base = a.A_WB_B.angular.amax().max(a.A_WB_B.linear.amax());
    a.qdd.amax().max(base)
}

/// 500 trees with momentum, wrenches, springs and dampers. A term missing in one formulation shows at
/// first order.
#[test]
fn all_formulations_agree_on_random_trees() {
    let mut draw = Draw::new(942);
    let mut worst = [0.0f64; FormulationKind::NAMES.len()];
    for _ in 0..500 {
        let model = draw.tree(30);
        let motion = draw.motion(&model);
        let answers = FormulationKind::NAMES.map(|(_, kind)| {
            let mut answer = TreeAcceleration::zero(&model);
            let (motion, input) = (motion.tree_motion(), &motion.input);
            let mut dynamics = kind.prepare(&model).unwrap();
            dynamics.accelerations(&motion, input, &mut answer);
            answer
        });
        for (worst, answer) in worst.iter_mut().zip(&answers) {
            let error = largest_difference(&answers[0], answer) / size(&answers[0]);
            *worst = worst.max(error);
        }
    }
    for ((name, _), worst) in FormulationKind::NAMES.iter().zip(worst) {
        assert!(worst <= 1e-11, "{name} differs by {worst:e}");
    }
}

/// Inverse dynamics of what forward dynamics found gives the efforts back, and a free base needs no wrench;
/// with the base's acceleration given or found. What one of the two leaves out breaks it.
#[test]
fn inverse_dynamics_gives_the_efforts_back() {
    let mut draw = Draw::new(1987);
    for _ in 0..200 {
        let model = draw.tree(30);
        let motion = draw.motion(&model);
        let mut answer = TreeAcceleration::zero(&model);
        FormulationKind::ArticulatedBody
            .prepare(&model)
            .unwrap()
            .accelerations(&motion.tree_motion(), &motion.input, &mut answer);
        let mut inverse = InverseDynamics::new(&model);
        let (qdd, wrenches) = (answer.qdd.as_slice(), &motion.input.wrenches);
        let mut efforts = DVector::zeros(model.dof());
        let on_base = inverse.efforts(
            &motion.tree_motion(),
            &answer.A_WB_B,
            qdd,
            wrenches,
            efforts.as_mut_slice(),
        );
        // Efforts are small differences of what moves the bodies, some 1e3 to 1e5 N here.
        let scale = 1e3 * (1.0 + size(&answer));
        assert!((&efforts - &motion.input.efforts).amax() <= 1e-13 * scale);
        assert!(on_base.force.amax().max(on_base.torque.amax()) <= 1e-12 * scale);
        let base = inverse.free_floating_efforts(
            &motion.tree_motion(),
            qdd,
            wrenches,
            efforts.as_mut_slice(),
        );
        assert!((&efforts - &motion.input.efforts).amax() <= 1e-13 * scale);
        let apart = base - answer.A_WB_B;
        let apart = apart.angular.amax().max(apart.linear.amax());
        assert!(apart <= 1e-11 * size(&answer), "{apart:e}");
    }
}

/// A run by any formulation ends at the same state.
#[test]
fn robots_can_be_stepped_by_any_formulation() {
    let mut draw = Draw::new(1995);
    let model = draw.tree(8);
    let motion = draw.motion(&model);
    let mut start = State::at_rest_with(&model, &DVector::from_row_slice(&motion.q));
    start.qd = DVector::from_row_slice(&motion.qd);
    start.momentum_W.angular = Vector3::new(3.0, -1.0, 2.0);
    let ends = FormulationKind::NAMES.map(|(_, kind)| {
        let mut robot = Floating::new(model.clone(), start.clone(), IntegrationMethod::Rk4)
            .with_formulation(kind)
            .unwrap();
        robot.input_mut().clone_from(&motion.input);
        robot.step(1e-3, 100);
        robot.state().clone()
    });
    for ((name, _), end) in FormulationKind::NAMES.iter().zip(&ends) {
        let apart = (&end.qd - &ends[0].qd).amax() / ends[0].qd.amax();
        assert!(apart <= 1e-11, "{name}: {apart:e}");
        assert!(end.R_WB.angle_to(&ends[0].R_WB) <= 1e-11);
    }
}

#[test]
fn no_formulation_allocates() {
    let mut draw = Draw::new(4);
    let model = draw.tree(20);
    let motion = draw.motion(&model);
    let mut answer = TreeAcceleration::zero(&model);
    let mut inverse = InverseDynamics::new(&model);
    let mut efforts = vec![0.0; model.dof()];
    for (name, kind) in FormulationKind::NAMES {
        let mut dynamics = kind.prepare(&model).unwrap();
        let used = allocation_counter::measure(|| {
            dynamics.accelerations(&motion.tree_motion(), &motion.input, &mut answer);
            let (qdd, wrenches) = (answer.qdd.as_slice(), &motion.input.wrenches);
            inverse.free_floating_efforts(&motion.tree_motion(), qdd, wrenches, &mut efforts);
        });
        assert_eq!(used.count_total, 0, "{name}: {used:?}");
    }
}
