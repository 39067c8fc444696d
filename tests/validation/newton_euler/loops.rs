//! Closed loops of one degree of freedom against their own equation of motion: the poses of all bodies in closed
//! form as a function of the crank's angle, kinetic energy `½ M(θ) θ'²` from differences of these poses, and
//! `M θ'' + ½ M' θ'² = torque`.

use fuyu::dynamics::newton_euler::{
    Axis, Freedom, Hinge, INERTIAL, Load, MatrixMethod, Start, System, SystemBuilder,
};
use fuyu::dynamics::{RungeKutta, Tableau};
use fuyu::spatial::{Pose, RigidInertia};
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::largest;

/// Central difference of order 8; at this step truncation and rounding are some 1e-13.
fn derivative<T>(f: impl Fn(f64) -> T, x: f64) -> T
where
    T: std::ops::Sub<Output = T> + std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>,
{
    let h = 0.02;
    let pair = |k: f64| f(x + k * h) - f(x - k * h);
    (pair(1.0) * (4.0 / 5.0) - pair(2.0) * (1.0 / 5.0) + pair(3.0) * (4.0 / 105.0)
        - pair(4.0) * (1.0 / 280.0))
        * (1.0 / h)
}

/// A mechanism whose first hinge is the crank.
struct Mechanism<P: Fn(f64) -> [Pose; 3]> {
    inertias: [RigidInertia; 3],
    poses: P,
    stiffness: f64,
    damping: f64,
}

impl<P: Fn(f64) -> [Pose; 3]> Mechanism<P> {
    fn inertia(&self, crank: f64) -> f64 {
        let body = |(b, inertia): (usize, &RigidInertia)| {
            let com = |x| {
                let X = (self.poses)(x)[b];
                X.rotation * inertia.com + X.translation.vector
            };
            let R = |x| *(self.poses)(x)[b].rotation.matrix();
            let W = R(crank).transpose() * derivative(R, crank);
            let w = Vector3::new(W[(2, 1)], W[(0, 2)], W[(1, 0)]);
            inertia.mass * derivative(com, crank).norm_squared() + w.dot(&(inertia.about_com * w))
        };
        self.inertias.iter().enumerate().map(body).sum()
    }

    /// Crank angle and rate after `time` \[s\].
    fn integrate(&self, mut crank: [f64; 2], time: f64) -> [f64; 2] {
        let mut stepper = RungeKutta::new(&Tableau::DOP8, 2);
        let steps = 100;
        for _ in 0..steps {
            stepper.step(&mut crank, time / f64::from(steps), |x, rate| {
                let slope = derivative(|x| self.inertia(x), x[0]);
                let torque = -self.stiffness * x[0] - self.damping * x[1];
                rate[0] = x[1];
                rate[1] = (torque - 0.5 * slope * x[1] * x[1]) / self.inertia(x[0]);
            });
        }
        crank
    }
}

/// Crank angle and rate after `time` by the matrix method, and the rank of the constraints at the end.
fn simulate(system: &System, start: &Start, time: f64) -> ([f64; 2], usize) {
    let mut state = system.assemble(start).unwrap();
    let load = Load::zero(system);
    let mut method = MatrixMethod::new(system);
    let mut stepper = RungeKutta::new(&Tableau::DOP8, state.len());
    let steps = 200;
    for _ in 0..steps {
        stepper.step(&mut state, time / f64::from(steps), |x, rates| {
            method.derivative(system, x, &load, rates);
        });
    }
    let z = Axis::RotationZ.index();
    let crank = [system.displacement(&state, 0)[z], system.rate(&state, 0)[z]];
    (crank, method.rank())
}

fn link(mass: f64, com: [f64; 3]) -> RigidInertia {
    RigidInertia {
        mass,
        com: com.into(),
        about_com: Matrix3::new(0.3, 0.02, -0.03, 0.02, 0.5, 0.04, -0.03, 0.04, 0.4) * mass,
    }
}

fn turn(angle: f64) -> Pose {
    Pose::from_parts(
        Vector3::zeros().into(),
        Rotation3::from_axis_angle(&Vector3::z_axis(), angle),
    )
}

fn assert_same(ours: [f64; 2], expected: [f64; 2]) {
    let off = largest([ours[0] - expected[0], ours[1] - expected[1]]);
    assert!(off < 1e-9, "{off:e}: {ours:?} {expected:?}");
}

/// Crank, coupler and rocker on the ground, the crank turning round and round.
#[test]
fn planar_four_bar_moves_as_its_own_equation_says() {
    let (crank, coupler, rocker, ground) = (1.0, 2.5, 2.0, 2.2);
    let angles = move |x: f64| {
        let to_pivot = Vector3::new(ground - crank * x.cos(), -crank * x.sin(), 0.0);
        let d = to_pivot.norm();
        // The law of cosines, the coupler's end to the left of the diagonal.
        let at_crank = ((coupler * coupler + d * d - rocker * rocker) / (2.0 * coupler * d)).acos();
        let phi = to_pivot.y.atan2(to_pivot.x) + at_crank;
        let end_y = crank * x.sin() + coupler * phi.sin();
        let end_x = crank * x.cos() + coupler * phi.cos();
        Vector3::new(x, phi, end_y.atan2(end_x - ground))
    };
    let along = |x| Pose::translation(x, 0.0, 0.0);
    let mechanism = Mechanism {
        inertias: [
            link(2.0, [0.5, 0.1, 0.2]),
            link(3.0, [1.2, -0.2, 0.1]),
            link(4.0, [0.9, 0.3, 0.0]),
        ],
        poses: move |x| {
            let a = angles(x);
            [
                turn(a[0]),
                turn(a[0]) * along(crank) * turn(a[1] - a[0]),
                along(ground) * turn(a[2]),
            ]
        },
        stiffness: 3.0,
        damping: 0.2,
    };
    let [a, b, c] = mechanism.inertias;
    let build = |closing: Freedom| {
        let mut system = SystemBuilder::new();
        let z = Axis::RotationZ;
        let whole = Freedom::REVOLUTE;
        system
            .body("crank", a)
            .body("coupler", b)
            .body("rocker", c)
            .hinge(
                Hinge::new("drive", INERTIAL, "crank", whole)
                    .spring(z, 3.0, 0.0)
                    .damper(z, 0.2),
            )
            .hinge(Hinge::new("knee", "crank", "coupler", whole).at(along(crank), along(0.0)))
            // Declared from the far end, so that a hinge is also followed inward.
            .hinge(Hinge::new("pivot", "rocker", INERTIAL, whole).at(along(0.0), along(ground)))
            .hinge(
                Hinge::new("end", "coupler", "rocker", closing).at(along(coupler), along(rocker)),
            )
            .build()
            .unwrap()
    };
    let (x, xd) = (1.2, 5.0);
    let (at, rate) = (angles(x), derivative(angles, x) * xd);
    let start = Start::new()
        .with("drive", Axis::RotationZ, x, xd)
        .with("knee", Axis::RotationZ, at[1] - at[0], rate[1] - rate[0])
        .with("pivot", Axis::RotationZ, -at[2], -rate[2]);
    let expected = mechanism.integrate([x, xd], 1.5);
    let in_plane = Freedom::SPHERICAL.and(Axis::TranslationZ);
    let (ours, rank) = simulate(&build(in_plane), &start, 1.5);
    assert_same(ours, expected);
    assert_eq!(rank, 17);
    let mut whole = build(Freedom::REVOLUTE);
    assert_eq!(whole.leave_out_redundant(&start).unwrap().len(), 3);
    let (ours, rank) = simulate(&whole, &start, 1.5);
    assert_same(ours, expected);
    assert_eq!(rank, 17);
}

/// Bennett's linkage: four revolute hinges whose axes are neither parallel nor meet, and which moves although it has
/// four constraints too many by count. `sin α / a = sin β / b`, `tan(θ1/2) tan(θ2/2) = sin((β+α)/2) / sin((β-α)/2)`.
#[test]
fn bennett_s_linkage_moves_as_its_own_equation_says() {
    let (alpha, beta, a) = (0.7_f64, 1.1_f64, 1.0);
    let b = a * beta.sin() / alpha.sin();
    let screw = |length: f64, twist: f64| {
        let R = Rotation3::from_axis_angle(&Vector3::x_axis(), twist);
        Pose::from_parts(Vector3::new(length, 0.0, 0.0).into(), R)
    };
    let (short, long) = (screw(a, alpha), screw(b, beta));
    let k = ((beta + alpha) / 2.0).sin() / ((beta - alpha) / 2.0).sin();
    let second = move |x: f64| 2.0 * (k / (x / 2.0).tan()).atan();
    let mechanism = Mechanism {
        inertias: [
            link(2.0, [0.5, 0.1, 0.2]),
            link(3.0, [0.7, -0.2, 0.1]),
            link(4.0, [0.4, 0.3, 0.0]),
        ],
        poses: move |x| {
            let one = turn(x);
            let two = one * short * turn(second(x));
            [one, two, two * long * turn(-x)]
        },
        stiffness: 3.0,
        damping: 0.2,
    };
    let [one, two, three] = mechanism.inertias;
    let build = |closing: Freedom| {
        let mut system = SystemBuilder::new();
        let z = Axis::RotationZ;
        let whole = Freedom::REVOLUTE;
        let start = Pose::identity();
        system
            .body("one", one)
            .body("two", two)
            .body("three", three)
            .hinge(
                Hinge::new("1", INERTIAL, "one", whole)
                    .spring(z, 3.0, 0.0)
                    .damper(z, 0.2),
            )
            .hinge(Hinge::new("2", "one", "two", whole).at(short, start))
            .hinge(Hinge::new("3", "two", "three", whole).at(long, start))
            .hinge(Hinge::new("4", "three", INERTIAL, closing).at(short, long.inverse()))
            .build()
            .unwrap()
    };
    let (x, xd) = (1.0, 2.0);
    let turning = derivative(second, x) * xd;
    let start = Start::new()
        .with("1", Axis::RotationZ, x, xd)
        .with("2", Axis::RotationZ, second(x), turning)
        .with("3", Axis::RotationZ, -x, -xd);
    let expected = mechanism.integrate([x, xd], 1.0);
    let mut whole = build(Freedom::REVOLUTE);
    assert_eq!(whole.leave_out_redundant(&start).unwrap().len(), 3);
    let (ours, rank) = simulate(&whole, &start, 1.0);
    assert_same(ours, expected);
    assert_eq!(rank, 17);
    // A ball in a groove holds the two things that three revolute hinges leave open.
    let groove = Freedom::SPHERICAL.and(Axis::TranslationZ);
    let (ours, rank) = simulate(&build(groove), &start, 1.0);
    assert_same(ours, expected);
    assert_eq!(rank, 17);
    // As a ball alone it holds one thing twice.
    let ball = build(Freedom::SPHERICAL).assemble(&start).unwrap_err();
    assert!(
        ball.to_string().contains("hinge `4` is over-constrained"),
        "{ball}"
    );
}
