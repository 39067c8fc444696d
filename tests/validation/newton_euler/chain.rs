//! TR-942 section 3.2: satellite with a manipulator of four links.

use std::f64::consts::{FRAC_PI_2, PI};

use fuyu::dynamics::newton_euler::{
    Axis, Freedom, Hinge, INERTIAL, Load, MatrixMethod, Start, System, SystemBuilder,
};
use fuyu::dynamics::{RungeKutta, Tableau};
use fuyu::spatial::{Pose, RigidInertia};
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Tables 3.2.1 and 3.2.2; frames of body 3 as they reproduce the tables, x3 = -x2, y3 = -z2, z3 = -y2.
fn system() -> System {
    let v = Vector3::new;
    let body = |mass, com, moments| RigidInertia {
        mass,
        com,
        about_com: Matrix3::from_diagonal(&moments),
    };
    let turned = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[
        v(-1.0, 0.0, 0.0),
        v(0.0, 0.0, -1.0),
        v(0.0, -1.0, 0.0),
    ]));
    let at = |p: Vector3<f64>, r: Rotation3<f64>| Pose::from_parts(p.into(), r);
    let straight = Rotation3::identity();
    let hinge = |name, inner, outer, X, k, d| {
        Hinge::new(name, inner, outer, Freedom::REVOLUTE)
            .at(X, Pose::identity())
            .spring(Axis::RotationZ, k, 0.0)
            .damper(Axis::RotationZ, d)
    };
    SystemBuilder::new()
        .body("1", body(200.0, v(0.0, 0.0, 0.0), v(100.0, 100.0, 100.0)))
        .body("2", body(10.0, v(0.0, 0.0, 0.05), v(0.01, 0.01, 0.1)))
        .body("3", body(50.0, v(0.0, -0.5, 0.0), v(5.0, 0.5, 5.0)))
        .body("4", body(40.0, v(0.0, -0.5, 0.0), v(4.0, 0.4, 4.0)))
        .body("5", body(30.0, v(0.0, -0.15, 0.0), v(0.3, 0.3, 0.3)))
        .hinge(Hinge::new("h1", INERTIAL, "1", Freedom::FREE))
        .hinge(hinge("h2", "1", "2", at(v(-0.5, 0.0, 0.5), straight), 10.0, 5.0))
        .hinge(hinge("h3", "2", "3", at(v(0.0, 0.0, 0.1), turned), 10.0, 2.0))
        .hinge(hinge("h4", "3", "4", at(v(0.0, -1.0, 0.0), straight), 10.0, 2.0))
        .hinge(hinge("h5", "4", "5", at(v(0.0, -1.0, 0.0), straight), 1.0, 5.0))
        .build()
        .unwrap()
}

/// Table 3.2.3, its angles as the multiples of a quarter turn that they round.
fn start(system: &System) -> Vec<f64> {
    let start = Start::new()
        .with("h2", Axis::RotationZ, FRAC_PI_2, 0.0)
        .with("h3", Axis::RotationZ, -FRAC_PI_2, 0.0)
        .with("h4", Axis::RotationZ, PI, 0.0)
        .with("h5", Axis::RotationZ, -FRAC_PI_2, 0.0);
    system.assemble(&start).unwrap()
}

/// θ2 and θ3 at 2, 4, 6 and 8 s, and the largest momentum on the way \[N s, N m s\].
fn run(tableau: &'static Tableau, step: f64) -> ([[f64; 2]; 4], f64) {
    let system = system();
    let (mut state, load) = (start(&system), Load::zero(&system));
    let mut method = MatrixMethod::new(&system);
    let mut stepper = RungeKutta::new(tableau, state.len());
    let steps = (2.0 / step).round() as usize;
    let mut momentum = 0.0_f64;
    let angles = [(); 4].map(|()| {
        for _ in 0..steps {
            stepper.step(&mut state, step, |x, rates| method.derivative(&system, x, &load, rates));
            let p = system.momentum(&state);
            momentum = momentum.max(p.linear.norm()).max(p.angular.norm());
        }
        [1, 2].map(|h| system.displacement(&state, h)[Axis::RotationZ.index()])
    });
    (angles, momentum)
}

fn worst(a: &[[f64; 2]; 4], b: &[[f64; 2]; 4]) -> f64 {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Table 3.2.4, the eight digits of its lower part.
const PRINTED: [[f64; 2]; 4] = [
    [5.0269164e-02, -3.3256799e-01],
    [-7.3774916e-01, 1.8884898],
    [-5.0845999e-01, 5.6723559e-01],
    [7.1992821e-01, -3.2072845e-01],
];

/// By an implementation of Kane's equations that shares nothing with this one, Dormand-Prince of order 8 at a
/// tolerance of 1e-13.
const CONVERGED: [[f64; 2]; 4] = [
    [0.050269493456, -0.332567777886],
    [-0.737754617723, 1.888506610851],
    [-0.508475946424, 0.567258634128],
    [0.719929152765, -0.320750374962],
];

/// The report prints what its program for Kane's method gave. The matrix method integrates other variables,
/// so its truncation differs: 2e-5 rad at the report's step is that and nothing else, as the next test shows.
#[test]
fn gill_at_the_report_s_step_gives_the_printed_table() {
    let off = worst(&run(&Tableau::RK_GILL, 0.05).0, &PRINTED);
    assert!(off < 2e-5, "{off:e}");
}

/// Order 4, then 1e-9 rad. A wrong term in any equation converges to something else.
#[test]
fn smaller_steps_converge_to_the_exact_solution() {
    let errors = [0.0125, 0.00625, 0.003125].map(|h| worst(&run(&Tableau::RK_GILL, h).0, &CONVERGED));
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 4.0).abs() < 0.3, "order {order}: {errors:e?}");
    }
    assert!(errors[2] < 1e-9, "{errors:e?}");
}

/// Nothing carries momentum but the bodies themselves, so all of the method's errors show in it. The bodies
/// of the system carry some 20 N s each.
#[test]
fn momentum_stays_zero_at_small_steps() {
    let (angles, momentum) = run(&Tableau::DOP8, 0.01);
    assert!(momentum < 1e-12, "{momentum:e}");
    assert!(worst(&angles, &CONVERGED) < 2e-12, "{:e}", worst(&angles, &CONVERGED));
}
