//! Masutani 1995, chapters 4 and 6: the planar arm of Fig. 4.4 on bases of several sizes, controlled with the fixed-base
//! Jacobian as an approximation.
//!
//! Table 6.2 prints the robot whose base is five times as heavy as its arm. The parameters of Fig. 4.4 are not printed; most
//! likely they are the same arm on a base of mass ratio 20, which Table 6.2 scales.

use nalgebra::{DVector, Matrix3, Matrix6xX, Rotation3, Translation3, Vector3};

use super::continuous_loop::ContinuousLoop;
use crate::control::{
    ControllerConfig, Gains, JacobianKind, LinearisedLoop, Saturation, TransposeJacobianConfig,
};
use crate::dynamics::Workspace;
use crate::model::{Frame, JointKind, Model, ModelBuilder};
use crate::spatial::{Pose, RigidInertia};

/// Length of either link \[m\].
pub const LINK: f64 = 2.5;

/// Base and arm.
#[derive(Debug, Clone)]
pub struct Planar {
    /// The robot; its plane is x-y, and both joints turn about z.
    pub model: Model,
    /// The tip's frame.
    pub tip: Frame,
    /// Position of joint 1 on the base's x axis \[m\].
    pub mount: f64,
    workspace: Workspace,
}

/// Gains of chapter 6; attitude is free.
pub fn gains(e_p_max: f64) -> Gains {
    Gains {
        k_p: 100.0,
        k_o: 0.0,
        k_v: vec![200.0, 1000.0],
        saturation: Saturation {
            position: e_p_max,
            orientation: f64::INFINITY,
        },
    }
}

/// Stability of a goal in the base frame under the approximate Jacobian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Region {
    /// The tip converges to a goal here.
    Stable,
    /// The tip leaves a goal here.
    Unstable,
    /// Outside the workspace.
    Outside,
}

impl Planar {
    /// The arm on a base of `ratio` times its mass. Bases are similar bodies of one density: lengths scale with the
    /// cube root of the mass, moments of inertia with its power 5/3.
    pub fn with_mass_ratio(ratio: f64) -> Self {
        let scale = ratio / 20.0;
        let mount = 1.75 * scale.cbrt();
        let body = |mass: f64, com: f64, inertia: f64| RigidInertia {
            mass,
            com: Vector3::new(com, 0.0, 0.0),
            about_com: Matrix3::identity() * inertia,
        };
        let base = body(2000.0 * scale, 0.0, 1500.0 * scale.powf(5.0 / 3.0));
        let link = body(50.0, 0.5 * LINK, 26.0);
        let at = |x: f64| Pose::from_parts(Translation3::new(x, 0.0, 0.0), Rotation3::identity());
        let (kind, z) = (JointKind::Continuous, Vector3::z_axis());
        let mut builder = ModelBuilder::new("planar", "base_link", base);
        let first = builder.body("link1", 0, kind, z, at(mount), link);
        let second = builder.body("link2", first, kind, z, at(LINK), link);
        builder.frame("tool0", second, Some("link2".to_owned()), at(LINK));
        Self::new(builder.build(), mount)
    }

    /// The robot of Table 6.2, as printed: mass ratio 5, rounded.
    pub fn table_6_2() -> Self {
        let xml = include_str!("../../urdf/planar_two_link.urdf");
        let model = Model::from_urdf(xml, "urdf/planar_two_link.urdf");
        Self::new(model.expect("the planar robot is well formed"), 1.1)
    }

    fn new(model: Model, mount: f64) -> Self {
        Self {
            tip: model.frame("tool0").expect("the arm has a tip").clone(),
            workspace: Workspace::new(&model),
            model,
            mount,
        }
    }

    /// The largest growth rate of the linearised loop, eq. (6.2) \[1/s\].
    pub fn growth_rate(&mut self, q: [f64; 2], gains: &Gains, jacobian: JacobianKind) -> f64 {
        let q = DVector::from_row_slice(&q);
        let workspace = &mut self.workspace;
        LinearisedLoop::at(&self.model, workspace, &self.tip, &q, gains, jacobian)
            .growth_rate()
            .expect("two joints have four roots")
    }

    /// Fraction of the tip's area in which the approximate Jacobian is unstable, for the elbow on one side (`q2 > 0`),
    /// computed on an `n` by `n` grid of angles.
    pub fn unstable_fraction(&mut self, gains: &Gains, n: usize) -> f64 {
        let (mut unstable, mut all) = (0.0, 0.0);
        for j in 0..n {
            let q2 = std::f64::consts::PI * (j as f64 + 0.5) / n as f64;
            // Area per unit of joint angles is the determinant of the Jacobian, l1 l2 sin q2.
            let weight = q2.sin();
            for i in 0..n {
                let q1 = std::f64::consts::TAU * (i as f64 + 0.5) / n as f64;
                all += weight;
                if self.growth_rate([q1, q2], gains, JacobianKind::FixedBase) > 0.0 {
                    unstable += weight;
                }
            }
        }
        unstable / all
    }

    /// Joint angles with `q2 > 0` for which the tip is at (x, y) in the base frame, if reachable.
    pub fn angles(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let x = x - self.mount;
        let cos = (x * x + y * y) / (2.0 * LINK * LINK) - 1.0;
        (cos.abs() < 1.0).then(|| {
            let q2 = cos.acos();
            [y.atan2(x) - 0.5 * q2, q2]
        })
    }

    /// Stability of a goal at (x, y) in the base frame.
    pub fn region(&mut self, x: f64, y: f64, gains: &Gains) -> Region {
        match self.angles(x, y) {
            None => Region::Outside,
            Some(q) if self.growth_rate(q, gains, JacobianKind::FixedBase) > 0.0 => {
                Region::Unstable
            }
            Some(_) => Region::Stable,
        }
    }

    /// The fixed-base and the generalized Jacobian of the tip's x and y, in this order.
    pub fn jacobians(&mut self, q: [f64; 2]) -> [nalgebra::Matrix2<f64>; 2] {
        let q = DVector::from_row_slice(&q);
        self.workspace.set_positions(&q);
        [JacobianKind::FixedBase, JacobianKind::Generalized].map(|kind| {
            let mut matrix = Matrix6xX::zeros(2);
            kind.write(&mut self.workspace, &self.tip, &mut matrix);
            matrix.fixed_view::<2, 2>(0, 0).into_owned()
        })
    }

    /// Position of the tip in the base frame \[m\].
    pub fn tip_at(&self, [q1, q2]: [f64; 2]) -> [f64; 2] {
        [
            self.mount + LINK * (q1.cos() + (q1 + q2).cos()),
            LINK * (q1.sin() + (q1 + q2).sin()),
        ]
    }
}

/// A run of section 6.4: the robot of Table 6.2 from rest to a goal at an offset from the tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Example {
    /// Joint angles at the start \[rad\].
    pub start: [f64; 2],
    /// Goal relative to the tip's initial position \[m\].
    pub offset: [f64; 2],
}

/// Fig. 6.2: a start in the stable region. Start and goal are not printed.
pub const STABLE: Example = Example {
    start: [-2.2, 1.3],
    offset: [0.6, -0.5],
};

/// Fig. 6.3: a start in the unstable region. Start and goal are not printed.
pub const UNSTABLE: Example = Example {
    start: [-1.25, 2.96],
    offset: [-0.1, -0.17320508],
};

impl Example {
    /// The closed loop at its start.
    pub fn start(&self, jacobian: JacobianKind) -> ContinuousLoop {
        let robot = Planar::table_6_2();
        let [x, y] = robot.tip_at(self.start);
        let [dx, dy] = self.offset;
        let goal = Translation3::new(x + dx, y + dy, 0.0);
        let config = ControllerConfig::new(TransposeJacobianConfig { jacobian }, gains(0.1));
        let q = DVector::from_row_slice(&self.start);
        let X_WD = Pose::from_parts(goal, Rotation3::identity());
        ContinuousLoop::new(robot.model, &robot.tip, config, &q, X_WD)
            .expect("gains for two joints")
    }
}
