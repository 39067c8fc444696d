//! How many digits forward dynamics keeps: the same recursion in twice as many.

use std::ops::{Add, Mul, Neg, Sub};

use fuyu::dynamics::kernel::{LinkScratch, Scalar, Tree, Vec3, forward_dynamics};
use fuyu::dynamics::{ArticulatedBody, Formulation, Input, TreeAcceleration, TreeMotion};
use fuyu::model::{JointKind, Model, ModelBuilder};
use fuyu::spatial::{Pose, RigidInertia, Twist};
use nalgebra::{DVector, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// The sum of two `f64` that do not overlap: some 32 digits.
#[derive(Debug, Clone, Copy)]
struct Double(f64, f64);

impl Double {
    fn sum(a: f64, b: f64) -> Self {
        let s = a + b;
        let t = s - a;
        Self(s, (a - (s - t)) + (b - t))
    }

    /// Cosine and sine by their series, which 60 terms exhaust for angles of a few radians.
    fn cos_sin(angle: f64) -> (Self, Self) {
        let x = Self(angle, 0.0);
        let (mut term, mut sums) = (Self(1.0, 0.0), [Self(0.0, 0.0); 2]);
        for k in 0..60 {
            let signed = if k % 4 < 2 { term } else { -term };
            sums[k % 2] = sums[k % 2] + signed;
            term = term * x * Self((k + 1) as f64, 0.0).recip();
        }
        (sums[0], sums[1])
    }
}

impl Add for Double {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        let (high, low) = (Self::sum(self.0, o.0), Self::sum(self.1, o.1));
        let high = Self::sum(high.0, high.1 + low.0);
        Self::sum(high.0, high.1 + low.1)
    }
}

impl Neg for Double {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}

impl Sub for Double {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}

impl Mul for Double {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let p = self.0 * o.0;
        let rest = self.0.mul_add(o.0, -p);
        Self::sum(p, rest + (self.0 * o.1 + self.1 * o.0))
    }
}

impl Scalar for Double {
    fn constant(self, value: f64) -> Self {
        Self(value, 0.0)
    }

    fn recip(self) -> Self {
        let mut x = Self(1.0 / self.0, 0.0);
        for _ in 0..2 {
            x = x * (Self(2.0, 0.0) - self * x);
        }
        x
    }
}

fn chain(links: usize) -> Model {
    let body = |mass: f64| RigidInertia {
        mass,
        com: Vector3::new(0.2, 0.01, 0.0),
        about_com: Matrix3::from_diagonal(&Vector3::new(0.02, 0.15, 0.15)) * mass,
    };
    let mut builder = ModelBuilder::new("chain", "base_link", body(1000.0));
    let mut parent = 0;
    for k in 0..links {
        let placement = Pose::from_parts(
            Translation3::new(0.4, 0.0, 0.0),
            Rotation3::from_euler_angles(1.2, 0.1, 0.3),
        );
        let (name, kind) = (format!("link{k}"), JointKind::Continuous);
        parent = builder.body(&name, parent, kind, Vector3::z_axis(), placement, body(5.0));
    }
    builder.build()
}

/// The largest error of a joint acceleration, of the largest acceleration. Points of reference far from the
/// bodies would lose three digits here.
#[test]
fn forward_dynamics_keeps_its_digits() {
    for (model, limit) in [
        (crate::fixtures::servicer(), 1e-14),
        (chain(10), 1e-13),
        (chain(100), 1e-12),
    ] {
        let n = model.dof();
        let q: Vec<f64> = (0..n).map(|j| 2.0 * (1.0 + j as f64).sin()).collect();
        let qd: Vec<f64> = (0..n).map(|j| (2.0 + j as f64).cos()).collect();
        let w = Vector3::new(0.3, -0.2, 0.5);
        let mut input = Input::zero(&model);
        input.efforts = DVector::from_fn(n, |j, _| (3.0 * j as f64).sin());
        let motion = TreeMotion {
            R_WB: UnitQuaternion::identity(),
            V_WB_B: Twist::new(w, Vector3::zeros()),
            q: &q,
            qd: &qd,
        };
        let mut answer = TreeAcceleration::zero(&model);
        ArticulatedBody::new(&model).accelerations(&motion, &input, &mut answer);

        let tree = Tree::new(&model);
        let mut links = vec![LinkScratch::new(Double(0.0, 0.0)); n + 1];
        let w_K: [f64; 3] = tree.base_axes().inverse_transform_vector(&w).into();
        links[0].w = Vec3(w_K.map(|x| Double(x, 0.0)));
        for (j, link) in links[1..].iter_mut().enumerate() {
            let (cos, sin) = Double::cos_sin(q[j]);
            link.rotation = tree.joint_rotation(j, cos, sin);
            (link.q, link.qd) = (Double(q[j], 0.0), Double(qd[j], 0.0));
            link.effort = Double(input.efforts[j], 0.0);
        }
        forward_dynamics(&tree, &mut links, None);
        let exact = DVector::from_fn(n, |j, _| links[j + 1].qdd.0);
        let error = (&answer.qdd - &exact).amax() / exact.amax();
        assert!(error <= limit, "{}: {error:e}", model.name());
        assert!(links[n].qdd.1 != 0.0, "the reference must have more digits");
    }
}
