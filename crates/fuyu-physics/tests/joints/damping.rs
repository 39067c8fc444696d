//! Viscous damping of any strength at one step.

use fuyu_physics::dynamics::{
    Floating, FormulationKind, Input, IntegrationMethod, Integrator, State, Workspace,
};
use nalgebra::{DVector, Matrix2, Vector2, Vector3};

use crate::robots::{arm, coaxial, coaxial_inertia, energy, energy_error, momentum_error, moving};

/// `q̈ = A q̇ + a` for two joints, whose solution is a matrix exponential.
struct Exact {
    A: Matrix2<f64>,
    a: Vector2<f64>,
}

impl Exact {
    fn new(moments: &[f64], c: [f64; 2], efforts: [f64; 2]) -> Self {
        let inertia = coaxial_inertia(moments);
        let inverse = inertia.fixed_view::<2, 2>(0, 0).try_inverse().unwrap();
        let damping = Matrix2::from_diagonal(&Vector2::from(c));
        Self {
            A: -(inverse * damping),
            a: inverse * Vector2::from(efforts),
        }
    }

    /// Positions and rates after `t` from zero positions and these rates. By Sylvester's formula, with one projection for each
    /// eigenvalue `λ`: a rate along it becomes `e^{λt} v + φ a`, `φ = (e^{λt} - 1)/λ`.
    fn at(&self, t: f64, rates: [f64; 2]) -> [f64; 4] {
        let (trace, determinant) = (self.A.trace(), self.A.determinant());
        let fast = 0.5 * (trace - (trace * trace - 4.0 * determinant).sqrt());
        let slow = if fast == 0.0 { 0.0 } else { determinant / fast };
        let identity = Matrix2::identity();
        let (mut q, mut qd) = (Vector2::zeros(), Vector2::zeros());
        let projections = match fast == slow {
            // Only without damping.
            true => [(slow, identity), (fast, identity * 0.0)],
            false => [
                (slow, (self.A - identity * fast) / (slow - fast)),
                (fast, (self.A - identity * slow) / (fast - slow)),
            ],
        };
        for (rate, projection) in projections {
            let (v, a) = (projection * Vector2::from(rates), projection * self.a);
            let z = rate * t;
            // (e^z - 1)/z and (e^z - 1 - z)/z², the latter by its series where the difference loses digits.
            let first = if z == 0.0 { 1.0 } else { z.exp_m1() / z };
            let second = match z.abs() < 0.1 {
                true => {
                    (0..12)
                        .rev()
                        .fold(0.0, |sum, k| 1.0 + sum * z / f64::from(k + 3))
                        / 2.0
                }
                false => (first - 1.0) / z,
            };
            qd += v * z.exp() + a * (t * first);
            q += v * (t * first) + a * (t * t * second);
        }
        [q.x, q.y, qd.x, qd.y]
    }
}

/// Three bodies on a common axis, of which the last is light: `q̈ = Ĥ⁻¹ (τ - D q̇)` with constant matrices, whose solution is a
/// matrix exponential. The damping of one joint is 0 to 1e4 N m s/rad, the step 10 ms: the fastest decay takes 1 ns. Would break if the
/// damping were integrated by the explicit method (diverges from 1 N m s/rad on), by implicit Euler (a first-order error), or if
/// effort and damping were split (the joints would not reach the rate τ/c).
#[test]
fn any_damping_at_10_ms_agrees_with_the_matrix_exponential() {
    let moments = [4.0, 0.5, 0.002];
    let efforts = [0.3, -0.2];
    for damping in [0.0, 1e-3, 0.1, 1.0, 10.0, 1e2, 1e3, 1e4] {
        for c in [[damping, 0.2], [0.2, damping], [damping, damping]] {
            let model = coaxial(&moments, |j, joint| joint.damping = c[j]);
            let exact = Exact::new(&moments, c, efforts);
            for method in [IntegrationMethod::Dop8, IntegrationMethod::Rk4] {
                let mut state = State::at_rest(&model);
                state.qd = DVector::from_vec(vec![0.7, -1.3]);
                let mut robot = Floating::new(model.clone(), state, method);
                robot.hold_efforts(&efforts);
                let before = energy(&robot);
                for step in 1..=100 {
                    robot.step(0.01, 1);
                    let exact = exact.at(0.01 * f64::from(step), [0.7, -1.3]);
                    let state = robot.state();
                    for j in 0..2 {
                        let q = (state.q[j] - exact[j]).abs();
                        let qd = (state.qd[j] - exact[2 + j]).abs();
                        assert!(
                            q < 1e-11 && qd < 1e-11,
                            "c {c:?} {method:?} step {step} joint {j}: q {q:e} qd {qd:e}"
                        );
                    }
                    // The base turns against the joints, as momentum zero demands.
                    let total: f64 = moments.iter().sum();
                    let turned =
                        -(state.q[0] * (moments[1] + moments[2]) + state.q[1] * moments[2]) / total;
                    let about_z = state.R_WB.scaled_axis().z;
                    assert!((about_z - turned).abs() < 1e-12, "{c:?} {about_z} {turned}");
                }
                let error = energy_error(&robot, before);
                // The order-4 method integrates the work of weak damping less exactly than the motion.
                let limit = if method == IntegrationMethod::Dop8 {
                    1e-12
                } else {
                    1e-9
                };
                assert!(error < limit, "{c:?} {method:?}: energy {error:e}");
                assert!(momentum_error(&robot) < 1e-14);
                let damped = robot.state().dissipated;
                assert!(damped.total() == damped.damping);
            }
        }
    }
}

/// An arm in three dimensions with momentum: every formulation, both methods, all strengths. Momentum is exact, the energy
/// balance is that of the integrator, and the solution agrees with the one at a tenth of the step.
#[test]
fn a_damped_arm_balances_with_every_formulation() {
    for damping in [0.0, 0.1, 10.0, 1e3, 1e4] {
        let model = arm(|j, joint| joint.damping = damping * [1.0, 0.3, 0.01, 1.0, 0.1, 1.0][j]);
        let mut results = Vec::new();
        for (name, kind) in FormulationKind::NAMES {
            let robot = Floating::new(model.clone(), moving(&model), IntegrationMethod::Dop8);
            let mut robot = robot.with_formulation(kind).unwrap();
            robot.hold_efforts(&[0.5, -0.4, 0.3, 2.0, -0.1, 0.05]);
            let before = energy(&robot);
            robot.step(0.01, 200);
            let (energy, momentum) = (energy_error(&robot, before), momentum_error(&robot));
            println!("c {damping:>7} {name:>16}: energy {energy:.1e} momentum {momentum:.1e}");
            assert!(
                energy < 1e-9 && momentum < 1e-14,
                "{damping} {name} {energy:e} {momentum:e}"
            );
            results.push(robot.state().clone());
        }
        let mut fine = Floating::new(model.clone(), moving(&model), IntegrationMethod::Dop8);
        fine.hold_efforts(&[0.5, -0.4, 0.3, 2.0, -0.1, 0.05]);
        fine.step(0.001, 2000);
        for result in &results {
            let q = (&result.q - &fine.state().q).amax();
            let turned = result.R_WB.angle_to(&fine.state().R_WB);
            println!("c {damping:>7}: to 1 ms q {q:.1e} base {turned:.1e}");
            assert!(q < 1e-8 && turned < 1e-8, "{damping}: {q:e} {turned:e}");
        }
    }
}

/// Weak damping is integrated with the order of the method: against the explicit method, to which the damping is given as an
/// effort that depends on the state. Would break if the forcing's polynomial or the base's rotation lost the order.
#[test]
fn weak_damping_agrees_with_the_explicit_method() {
    let c = [0.3, 0.2, 0.05, 0.5, 0.02, 0.01];
    let damped = arm(|j, joint| joint.damping = c[j]);
    let free = arm(|_, _| {});
    for method in [IntegrationMethod::Dop8, IntegrationMethod::Rk4] {
        let mut with = (moving(&damped), Workspace::new(&damped));
        let mut explicit = (moving(&free), Workspace::new(&free));
        // An external wrench too, for the momentum.
        let push = |input: &mut Input| input.wrenches[4].force = Vector3::new(0.2, -0.4, 0.1);
        let mut alone = |_: f64, _: &State, input: &mut Input| push(input);
        let mut effort = |_: f64, state: &State, input: &mut Input| {
            push(input);
            for (j, c) in c.iter().enumerate() {
                input.efforts[j] = -c * state.qd[j];
            }
        };
        let mut first = Integrator::new(&damped, method);
        let mut second = Integrator::new(&free, method);
        first.steps(&mut with.0, &mut with.1, 0.01, 100, &mut alone);
        second.steps(&mut explicit.0, &mut explicit.1, 0.01, 100, &mut effort);
        let limit = if method == IntegrationMethod::Dop8 {
            1e-11
        } else {
            1e-7
        };
        let (a, b) = (&with.0, &explicit.0);
        for (what, error) in [
            ("q", (&a.q - &b.q).amax()),
            ("qd", (&a.qd - &b.qd).amax()),
            ("base", a.R_WB.angle_to(&b.R_WB)),
            ("com", (a.p_WC - b.p_WC).norm()),
            (
                "momentum",
                (a.momentum_W.linear - b.momentum_W.linear).norm(),
            ),
            (
                "angular",
                (a.momentum_W.angular - b.momentum_W.angular).norm(),
            ),
            ("work", (a.work - b.work).abs()),
        ] {
            println!("{method:?} {what} {error:.1e}");
            assert!(error < limit, "{method:?} {what}: {error:e}");
        }
    }
}
