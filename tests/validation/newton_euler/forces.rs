//! Forces and motions in closed form, and the augmented inertia matrix.

use fuyu::dynamics::newton_euler::{
    Axis, Freedom, Hinge, INERTIAL, Load, MatrixMethod, Start, System, SystemBuilder,
};
use fuyu::dynamics::{RungeKutta, Tableau};
use fuyu::spatial::{Pose, RigidInertia, Wrench};
use nalgebra::{Matrix3, Vector3};

use super::largest;

fn ball(mass: f64) -> RigidInertia {
    RigidInertia {
        mass,
        com: Vector3::zeros(),
        about_com: Matrix3::from_diagonal(&Vector3::new(0.3, 0.4, 0.5)) * mass,
    }
}

/// A floating body `one`, joined by `hinge` to a body `other`.
fn pair(masses: [f64; 2], hinge: Hinge) -> System {
    SystemBuilder::new()
        .body("one", ball(masses[0]))
        .body("other", ball(masses[1]))
        .hinge(Hinge::new("float", INERTIAL, "one", Freedom::FREE))
        .hinge(hinge)
        .build()
        .unwrap()
}

/// A rod of unequal balls that spins about the common centre of mass, with the force and the torque that a push on
/// its far end adds. Nothing of it is at the first ball's centre, where the axes are.
#[test]
fn a_spinning_dumbbell_s_rod_pulls_with_the_centripetal_force() {
    let (m, n, length, spin) = (2.0, 3.0, 1.5, 4.0);
    let rod = Hinge::new("rod", "one", "other", Freedom::LOCKED)
        .at(Pose::translation(length, 0.0, 0.0), Pose::identity());
    let system = pair([m, n], rod);
    let inward = n * length / (m + n);
    let start = Start::new().with("float", Axis::RotationZ, 0.0, spin).with(
        "float",
        Axis::TranslationY,
        0.0,
        -spin * inward,
    );
    let state = system.assemble(&start).unwrap();
    let p = system.momentum(&state);
    assert!(p.linear.norm() < 1e-14);
    let reduced = m * n / (m + n);
    let about_z = reduced * length * length + 0.5 * (m + n);
    assert!((p.angular - Vector3::z() * about_z * spin).norm() < 1e-13);

    let mut method = MatrixMethod::new(&system);
    let mut load = Load::zero(&system);
    method.solve(&system, &state, &load);
    let wrench = method.hinge_wrench(&system, 1);
    let pull = -reduced * length * spin * spin;
    assert!((wrench.force - Vector3::x() * pull).norm() < 1e-12);
    assert!(wrench.torque.norm() < 1e-12);

    // A torque on the far ball: the share that turns it alone stays there, the rest goes through the rod.
    load.wrenches[1].torque.z = 10.0;
    method.solve(&system, &state, &load);
    let turning = 10.0 / about_z;
    let wrench = method.hinge_wrench(&system, 1);
    let sideways = reduced * length * turning;
    assert!((wrench.force - Vector3::new(pull, sideways, 0.0)).norm() < 1e-12);
    assert!((wrench.torque - Vector3::z() * (0.5 * n * turning - 10.0)).norm() < 1e-12);
    assert!((method.acceleration(0).angular.z - turning).abs() < 1e-13);
}

/// Two bodies on a spring with a damper: the distance is that of the reduced mass, in closed form. A hinge of six
/// degrees of freedom, which constrains nothing.
#[test]
fn two_bodies_on_a_spring_swing_with_their_reduced_mass() {
    let (m, n, k, d): (f64, f64, f64, f64) = (2.0, 3.0, 40.0, 1.5);
    let bush = Hinge::new("bush", "one", "other", Freedom::FREE)
        .spring(Axis::TranslationX, k, 0.2)
        .damper(Axis::TranslationX, d);
    let system = pair([m, n], bush);
    let start = Start::new().with("bush", Axis::TranslationX, 0.5, 0.0);
    let mut state = system.assemble(&start).unwrap();
    let (mut method, load) = (MatrixMethod::new(&system), Load::zero(&system));
    let mut stepper = RungeKutta::new(&Tableau::DOP8, state.len());
    let reduced = m * n / (m + n);
    let decay = d / (2.0 * reduced);
    let swing = (k / reduced - decay * decay).sqrt();
    for step in 1..=200 {
        stepper.step(&mut state, 0.01, |x, rates| {
            method.derivative(&system, x, &load, rates)
        });
        let t = 0.01 * f64::from(step);
        let swung = (swing * t).cos() + decay / swing * (swing * t).sin();
        let expected = 0.2 + 0.3 * (-decay * t).exp() * swung;
        let x = system.displacement(&state, 1)[0];
        assert!((x - expected).abs() < 1e-12, "{t}: {x} {expected}");
    }
}

/// A wheel driven with a given acceleration about its axis turns the body the other way in the ratio of the
/// inertias; the torque that it takes is an output.
#[test]
fn a_driven_wheel_turns_its_carrier_the_other_way() {
    let wheel = Hinge::new("wheel", "one", "other", Freedom::LOCKED);
    let system = pair([4.0, 1.0], wheel);
    let state = system.assemble(&Start::new()).unwrap();
    let mut load = Load::zero(&system);
    load.driven[1][Axis::RotationZ.index()] = 5.0;
    let mut method = MatrixMethod::new(&system);
    method.solve(&system, &state, &load);
    assert!((method.acceleration(0).angular - Vector3::z() * -1.0).norm() < 1e-14);
    assert!((method.hinge_acceleration(&system, 1)[5] - 5.0).abs() < 1e-14);
    assert!((method.hinge_efforts(1)[5] - 2.0).abs() < 1e-14);
}

/// A tilted tree with a loop, everything moving, loaded and driven.
fn busy() -> (System, Vec<f64>, Load) {
    let at = |x, y, z| Pose::translation(x, y, z) * nalgebra::Rotation3::from_euler_angles(x, z, y);
    let hinge = |name, inner, outer, freedom| {
        Hinge::new(name, inner, outer, freedom).at(at(0.3, -0.2, 0.5), at(-0.4, 0.1, 0.2))
    };
    let bush = Hinge::new("bush", "d", "a", Freedom::FREE).spring(Axis::TranslationY, 30.0, 0.1);
    let system = SystemBuilder::new()
        .body("a", ball(5.0))
        .body("b", ball(2.0))
        .body(
            "c",
            RigidInertia {
                com: Vector3::new(0.1, 0.2, -0.3),
                ..ball(1.5)
            },
        )
        .body("d", ball(1.0))
        .hinge(Hinge::new("float", INERTIAL, "a", Freedom::FREE))
        .hinge(hinge("universal", "a", "b", Freedom::UNIVERSAL).damper(Axis::RotationX, 0.4))
        .hinge(hinge(
            "slide",
            "b",
            "c",
            Freedom::PRISMATIC.and(Axis::RotationX),
        ))
        .hinge(hinge("ball", "c", "d", Freedom::SPHERICAL).spring(Axis::RotationY, 3.0, 0.5))
        .hinge(bush)
        .build()
        .unwrap();
    let start = Start::new()
        .with("float", Axis::RotationX, 0.4, 0.7)
        .with("float", Axis::TranslationZ, 2.0, -0.6)
        .with("universal", Axis::RotationX, 0.5, -1.1)
        .with("universal", Axis::RotationY, -0.8, 0.9)
        .with("slide", Axis::TranslationZ, 0.3, 0.4)
        .with("slide", Axis::RotationX, -0.6, 1.3)
        .with("ball", Axis::RotationX, 0.2, -0.5)
        .with("ball", Axis::RotationZ, 0.9, 0.8);
    let state = system.assemble(&start).unwrap();
    let mut load = Load::zero(&system);
    load.wrenches[2] = Wrench::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(3.0, 0.2, -1.0));
    load.efforts[1][Axis::RotationY.index()] = 2.0;
    load.driven[2][Axis::TranslationX.index()] = -1.5;
    (system, state, load)
}

/// The solution, found by elimination, satisfies the equations as the report writes them; and an assembled start
/// moves as prescribed.
#[test]
fn the_solution_satisfies_the_augmented_equations() {
    let (system, state, load) = busy();
    let mut method = MatrixMethod::new(&system);
    let mut rates = vec![0.0; state.len()];
    method.derivative(&system, &state, &load, &mut rates);
    let (n, m) = (system.bodies().len(), system.hinges().len());
    let mut X = nalgebra::DVector::zeros(6 * (n + m));
    for (b, body) in system.bodies().iter().enumerate() {
        let rate = |i: usize| Vector3::from_column_slice(&rates[13 * b + i..13 * b + i + 3]);
        X.fixed_rows_mut::<3>(3 * b)
            .copy_from(&(rate(7) * body.inertia.mass));
        let spin = body.inertia.about_com * rate(10);
        X.fixed_rows_mut::<3>(3 * n + 3 * b).copy_from(&spin);
    }
    for i in 0..m {
        let efforts = Vector3::from_column_slice(&method.hinge_efforts(i)[..3]);
        X.fixed_rows_mut::<3>(6 * n + 3 * i).copy_from(&efforts);
        let efforts = Vector3::from_column_slice(&method.hinge_efforts(i)[3..]);
        X.fixed_rows_mut::<3>(6 * n + 3 * m + 3 * i)
            .copy_from(&efforts);
    }
    let (A, B) = method.augmented(&system, &state, &load);
    let off = (&A * &X - &B).amax();
    assert!(off < 1e-13 * X.amax(), "{off:e}");
    let values = A.singular_values();
    assert!(values.min() > 1e-4 * values.max(), "{values}");

    let (slide, universal) = (system.displacement(&state, 2), system.rate(&state, 1));
    let off = [
        slide[2] - 0.3,
        slide[3] + 0.6,
        universal[3] + 1.1,
        universal[4] - 0.9,
        system.displacement(&state, 3)[5] - 0.9,
        system.rate(&state, 3)[3] + 0.5,
    ];
    assert!(largest(off) < 1e-15, "{off:?}");
}

#[test]
fn solving_and_projecting_do_not_allocate() {
    let (system, mut state, load) = busy();
    let mut method = MatrixMethod::new(&system);
    let mut rates = vec![0.0; state.len()];
    let used = allocation_counter::measure(|| {
        method.derivative(&system, &state, &load, &mut rates);
        method.project(&system, &mut state);
        assert!(method.hinge_wrench(&system, 2).force.norm() > 0.0);
    });
    assert_eq!(used.count_total, 0, "{used:?}");
}
