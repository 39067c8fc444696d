//! TR-942 section 3.2: satellite with a manipulator of four links.

use fuyu::dynamics::newton_euler::{Axis, Load, MatrixMethod, System};
use fuyu::dynamics::{RungeKutta, Tableau};
use fuyu::experiments::tr942::chain::{self, Angles};

use super::largest;

/// θ2 and θ3 at 2, 4, 6 and 8 s, and the largest momentum on the way \[N s, N m s\].
fn run(tableau: &'static Tableau, step: f64, project: bool) -> ([[f64; 2]; 4], f64) {
    let system = System::from_model(&chain::model()).unwrap();
    let mut state = system.assemble(&chain::start(&system)).unwrap();
    let load = Load::zero(&system);
    let mut method = MatrixMethod::new(&system);
    let mut stepper = RungeKutta::new(tableau, state.len());
    let steps = (2.0 / step).round() as usize;
    let mut momentum = 0.0_f64;
    let angles = [(); 4].map(|()| {
        for _ in 0..steps {
            stepper.step(&mut state, step, |x, rates| {
                method.derivative(&system, x, &load, rates);
            });
            if project {
                method.project(&system, &mut state);
            }
            let p = system.momentum(&state);
            momentum = largest([momentum, p.linear.norm(), p.angular.norm()]);
        }
        [1, 2].map(|h| system.displacement(&state, h)[Axis::RotationZ.index()])
    });
    (angles, momentum)
}

/// Largest difference from a table at 2, 4, 6 and 8 s.
fn worst(run: &[[f64; 2]; 4], table: &[Angles]) -> f64 {
    let table = table.iter().flat_map(|row| &row.theta);
    largest(run.iter().flatten().zip(table).map(|(a, b)| a - b))
}

/// The report prints what its program for Kane's method gave. The matrix method integrates other variables, so
/// its truncation differs: at the report's step it is 1e-4 rad from the exact solution where the print is 2e-5.
/// Most of that is drift from the constraints; brought back to them after every step, as the end of section
/// 2.2.2 advises, it is as near to the exact solution as the print.
#[test]
fn gill_at_the_report_s_step_gives_the_printed_table() {
    let printed = &chain::PRINTED[1..];
    let drifting = worst(&run(&Tableau::RK_GILL, chain::STEP, false).0, printed);
    assert!(drifting < 1e-4, "{drifting:e}");
    let held = worst(&run(&Tableau::RK_GILL, chain::STEP, true).0, printed);
    assert!(held < 6e-6, "{held:e}");
}

/// A wrong term in any equation converges to something else, or not with order 4.
#[test]
fn smaller_steps_converge_to_the_exact_solution() {
    for (project, finest) in [(false, 2e-9), (true, 1e-9)] {
        let errors = [0.0125, 0.00625, 0.003125]
            .map(|h| worst(&run(&Tableau::RK_GILL, h, project).0, &chain::CONVERGED));
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!((order - 4.0).abs() < 0.3, "order {order}: {errors:?}");
        }
        assert!(errors[2] < finest, "{errors:?}");
    }
}

/// Nothing carries momentum but the bodies themselves, so all of the method's errors show in it. The bodies
/// exchange some 20 N s.
#[test]
fn momentum_stays_zero_at_small_steps() {
    let (angles, momentum) = run(&Tableau::DOP8, 0.008, false);
    assert!(momentum < 1e-12, "{momentum:e}");
    let off = worst(&angles, &chain::CONVERGED);
    assert!(off < 2e-12, "{off:e}");
}
