//! TR-942 section 3.2: satellite with a manipulator of four links.

use fuyu::dynamics::newton_euler::{Axis, Load, MatrixMethod, Start, System};
use fuyu::dynamics::{RungeKutta, Tableau};
use fuyu::experiments::tr942::chain::{self, Angles};

fn start(system: &System) -> Vec<f64> {
    let start = (1..).zip(chain::INITIAL).fold(Start::new(), |start, (hinge, angle)| {
        start.with(&system.hinges()[hinge].name, Axis::RotationZ, angle, 0.0)
    });
    system.assemble(&start).unwrap()
}

/// θ2 and θ3 at 2, 4, 6 and 8 s, and the largest momentum on the way \[N s, N m s\].
fn run(tableau: &'static Tableau, step: f64) -> ([[f64; 2]; 4], f64) {
    let system = System::from_model(&chain::model()).unwrap();
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

/// Largest difference from a table at 2, 4, 6 and 8 s.
fn worst(run: &[[f64; 2]; 4], table: &[Angles]) -> f64 {
    let pairs = run.iter().flatten().zip(table.iter().flat_map(|row| &row.theta));
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The report prints what its program for Kane's method gave. The matrix method integrates other variables,
/// so its truncation differs: 2e-5 rad at the report's step is that and nothing else, as the next test shows.
#[test]
fn gill_at_the_report_s_step_gives_the_printed_table() {
    let off = worst(&run(&Tableau::RK_GILL, 0.05).0, &chain::PRINTED[1..]);
    assert!(off < 2e-5, "{off:e}");
}

/// Order 4, then 1e-9 rad. A wrong term in any equation converges to something else.
#[test]
fn smaller_steps_converge_to_the_exact_solution() {
    let errors = [0.0125, 0.00625, 0.003125].map(|h| worst(&run(&Tableau::RK_GILL, h).0, &chain::CONVERGED));
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 4.0).abs() < 0.3, "order {order}: {errors:?}");
    }
    assert!(errors[2] < 1e-9, "{errors:?}");
}

/// Nothing carries momentum but the bodies themselves, so all of the method's errors show in it. The bodies
/// of the system carry some 20 N s each.
#[test]
fn momentum_stays_zero_at_small_steps() {
    let (angles, momentum) = run(&Tableau::DOP8, 0.01);
    assert!(momentum < 1e-12, "{momentum:e}");
    assert!(worst(&angles, &chain::CONVERGED) < 2e-12, "{:e}", worst(&angles, &chain::CONVERGED));
}
