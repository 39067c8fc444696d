//! TR-942 section 3.3: satellite with a pantograph, whose two loops are closed by the hinges h6 and h7.

use fuyu::dynamics::newton_euler::{
    Axis, Freedom, Hinge, INERTIAL, Load, MatrixMethod, Start, System, SystemBuilder, SystemError,
};
use fuyu::dynamics::{RungeKutta, Tableau};
use fuyu::experiments::tr942::pantograph::PRINTED;
use fuyu::spatial::{Pose, RigidInertia};
use nalgebra::{Matrix3, Vector3};

const SLIDING: Freedom = Freedom::REVOLUTE.and(Axis::TranslationY);
/// Holds only what the plane of motion needs; three whole revolute hinges in a plane repeat each other.
const IN_PLANE: Freedom = Freedom::SPHERICAL.and(Axis::TranslationZ);

/// Tables 3.3.1 and 3.3.2.
fn builder(closing: Freedom) -> SystemBuilder {
    let body = |mass, x, moments| RigidInertia {
        mass,
        com: Vector3::new(x, 0.0, 0.0),
        about_com: Matrix3::from_diagonal(&Vector3::from(moments)),
    };
    let x = |x| Pose::translation(x, 0.0, 0.0);
    let hinge = Hinge::new;
    let mut system = SystemBuilder::new();
    system
        .body("1", body(200.0, 0.0, [20.0; 3]))
        .body("2", body(20.0, 1.0, [1.0, 5.0, 5.0]))
        .body("3", body(20.0, 1.0, [1.0, 5.0, 5.0]))
        .body("4", body(10.0, 0.5, [0.2, 1.0, 1.0]))
        .body("5", body(10.0, 0.5, [0.2, 1.0, 1.0]))
        .hinge(hinge("h1", INERTIAL, "1", Freedom::FREE))
        .hinge(
            hinge("h2", "1", "2", SLIDING)
                .at(x(1.0), x(0.0))
                .spring(Axis::RotationZ, 4.0, 0.0)
                .damper(Axis::RotationZ, 10.0)
                .spring(Axis::TranslationY, 1.0, 0.0)
                .damper(Axis::TranslationY, 10.0),
        )
        .hinge(hinge("h3", "1", "3", SLIDING).at(x(1.0), x(0.0)))
        .hinge(hinge("h4", "3", "4", Freedom::REVOLUTE).at(x(2.0), x(0.0)))
        .hinge(hinge("h5", "2", "5", Freedom::REVOLUTE).at(x(2.0), x(0.0)))
        .hinge(hinge("h6", "2", "3", closing).at(x(1.0), x(1.0)))
        .hinge(hinge("h7", "4", "5", closing).at(x(1.0), x(1.0)));
    system
}

/// Table 3.3.3: folded but for 2 degrees.
fn start() -> Start {
    let (fold, slide) = (88f64.to_radians(), 2f64.to_radians().cos());
    Start::new()
        .with("h2", Axis::RotationZ, -fold, 0.0)
        .with("h2", Axis::TranslationY, slide, 0.0)
        .with("h3", Axis::RotationZ, fold, 0.0)
        .with("h3", Axis::TranslationY, -slide, 0.0)
        .with("h4", Axis::RotationZ, -2.0 * fold, 0.0)
        .with("h5", Axis::RotationZ, 2.0 * fold, 0.0)
}

struct Run {
    /// θ2, θ3, θ5 and the rates of θ3, θ5 at 2, 4, 6, 8 s.
    rows: [[f64; 5]; 4],
    momentum: f64,
}

fn run(system: &System, tableau: &'static Tableau, step: f64, project: bool) -> Run {
    let (mut state, load) = (system.assemble(&start()).unwrap(), Load::zero(system));
    let mut method = MatrixMethod::new(system);
    let mut stepper = RungeKutta::new(tableau, state.len());
    let steps = (2.0 / step).round() as usize;
    let mut momentum = 0.0_f64;
    let rows = [(); 4].map(|()| {
        for _ in 0..steps {
            stepper.step(&mut state, step, |x, rates| method.derivative(system, x, &load, rates));
            if project {
                method.project(system, &mut state);
            }
            let p = system.momentum(&state);
            momentum = momentum.max(p.linear.norm()).max(p.angular.norm());
        }
        let z = Axis::RotationZ.index();
        let angle = |h| system.displacement(&state, h)[z];
        let rate = |h| system.rate(&state, h)[z];
        [angle(1), angle(2), angle(4), rate(2), rate(4)]
    });
    Run { rows, momentum }
}

fn printed() -> [[f64; 5]; 4] {
    [1, 2, 3, 4].map(|row| {
        let (a, r) = (PRINTED[row].angles, PRINTED[row].rates);
        [a[0], a[1], a[2], r[0], r[1]]
    })
}

fn exact() -> [[f64; 5]; 4] {
    EXACT.map(|(x, xd)| [x, -x, -2.0 * x, -xd, -2.0 * xd])
}

/// Largest differences of angles and of rates.
fn worst(a: &[[f64; 5]; 4], b: &[[f64; 5]; 4]) -> [f64; 2] {
    let over = |columns: std::ops::Range<usize>| {
        let pairs = a.iter().zip(b).flat_map(|(a, b)| a[columns.clone()].iter().zip(&b[columns.clone()]));
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    [over(0..3), over(3..5)]
}

/// θ2 and its rate at 2, 4, 6, 8 s in the five coordinates that the closed loops leave, by another program at a
/// tolerance of 1e-13; θ3 = -θ2 and θ5 = -2 θ2.
const EXACT: [(f64, f64); 4] = [
    (-1.4562229044549682, 0.07693648826240448),
    (-1.2357260607754696, 0.14320717088571455),
    (-0.877149637649779, 0.21925054893949725),
    (-0.3303746632685937, 0.3312831928053415),
];

#[test]
fn probe() {
    let system = builder(IN_PLANE).build().unwrap();
    for h in [0.025, 0.0125, 0.00625] {
        for p in [false, true] {
            let r = run(&system, &Tableau::RK_GILL, h, p);
            println!("{h} {p} {:?} {:?} {:e} {:?}", worst(&r.rows, &printed()), worst(&r.rows, &exact()), r.momentum, r.rows[3]);
        }
    }
    let r = run(&system, &Tableau::DOP8, 0.025, false);
    println!("dop8 {:?} {:?} {:e} {:?}", worst(&r.rows, &printed()), worst(&r.rows, &exact()), r.momentum, r.rows[3]);
    println!("{}", builder(Freedom::REVOLUTE).build().unwrap().assemble(&start()).unwrap_err());
    let system = builder(Freedom::REVOLUTE).allow_redundant().build().unwrap();
    for h in [0.025, 0.00625] {
        for p in [false, true] {
            let r = run(&system, &Tableau::RK_GILL, h, p);
            println!("red {h} {p} {:?} {:?} {:e} {:?}", worst(&r.rows, &printed()), worst(&r.rows, &exact()), r.momentum, r.rows[3]);
        }
    }
    let _: Option<SystemError> = None;
}
