//! All 64 kinds of hinge.

use fuyu::dynamics::newton_euler::{
    Axis, BodyState, Freedom, Hinge, INERTIAL, Load, MatrixMethod, Start, System, SystemBuilder,
};
use fuyu::dynamics::{RungeKutta, Tableau};
use fuyu::spatial::{Pose, RigidInertia, exp_so3};
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::largest;

fn body(mass: f64) -> RigidInertia {
    RigidInertia {
        mass,
        com: Vector3::new(0.2, -0.1, 0.3),
        about_com: Matrix3::new(0.3, 0.02, -0.03, 0.02, 0.5, 0.04, -0.03, 0.04, 0.4) * mass,
    }
}

fn kinds() -> impl Iterator<Item = Freedom> {
    (0..64).map(|bits| {
        let free = Axis::ALL.into_iter().filter(|a| bits >> a.index() & 1 == 1);
        free.fold(Freedom::LOCKED, Freedom::and)
    })
}

/// Two floating bodies, joined by a hinge of this kind with springs on all its free axes.
fn pair(freedom: Freedom, hanging_from_the_second: bool) -> System {
    let at = |x, y, z| Pose::translation(x, y, z) * Rotation3::from_euler_angles(z, x, y);
    let mut hinge =
        Hinge::new("hinge", "first", "second", freedom).at(at(0.5, -0.3, 0.2), at(-0.4, 0.6, 0.1));
    for axis in Axis::ALL.into_iter().filter(|a| freedom.is_free(*a)) {
        hinge = hinge.spring(axis, 20.0, 0.0);
    }
    let floating = if hanging_from_the_second {
        "second"
    } else {
        "first"
    };
    SystemBuilder::new()
        .body("first", body(3.0))
        .body("second", body(2.0))
        .hinge(Hinge::new("float", INERTIAL, floating, Freedom::FREE))
        .hinge(hinge)
        .build()
        .unwrap()
}

fn start(freedom: Freedom) -> Start {
    let mut start = Start::new()
        .with("float", Axis::RotationX, 0.4, 0.9)
        .with("float", Axis::RotationY, -0.7, -0.6)
        .with("float", Axis::TranslationX, 3.0, 0.5);
    for axis in Axis::ALL.into_iter().filter(|a| freedom.is_free(*a)) {
        let k = axis.index() as f64;
        start = start.with("hinge", axis, 0.3 - 0.1 * k, 0.5 + 0.1 * k);
    }
    start
}

/// Springs store energy without loss, constraint forces do no work and do not change momentum, and locked axes do not move.
/// A wrong axis or rate of an axis, or a force at the wrong point or without reaction, violates one of these to first
/// order. The tolerance is truncation error.
#[test]
fn every_kind_of_hinge_keeps_energy_momentum_and_constraints() {
    for freedom in kinds() {
        for reversed in [false, true] {
            let system = pair(freedom, reversed);
            let mut state = system.assemble(&start(freedom)).unwrap();
            let (mut method, load) = (MatrixMethod::new(&system), Load::zero(&system));
            let mut stepper = RungeKutta::new(&Tableau::DOP8, state.len());
            let energy = |state: &[f64]| {
                let (kinetic, stored) = system.energy(state);
                kinetic + stored
            };
            let (before, p) = (energy(&state), system.momentum(&state));
            let displaced = system.displacement(&state, 1);
            for _ in 0..50 {
                stepper.step(&mut state, 0.01, |x, rates| {
                    method.derivative(&system, x, &load, rates);
                });
            }
            let after = system.momentum(&state);
            let lost = largest([
                energy(&state) - before,
                (after.linear - p.linear).norm(),
                (after.angular - p.angular).norm(),
            ]);
            assert!(lost < 1e-12, "{freedom:?} {lost:e}");
            let moved = system.displacement(&state, 1);
            for axis in Axis::ALL {
                let k = axis.index();
                let moved = (moved[k] - displaced[k]).abs();
                if freedom.is_free(axis) {
                    assert!(moved > 1e-5, "{freedom:?} does not move: {axis} {moved:e}");
                } else {
                    assert!(moved < 1e-12, "{freedom:?} gives way: {axis} {moved:e}");
                }
            }
            assert_eq!(method.rank(), 6 - freedom.degrees());
        }
    }
}

/// After a hinge has been displaced by about 1e-3, projection restores the constraints up to rounding errors, hardly moves the
/// free axes, and changes neither the centre of mass nor the momentum.
#[test]
fn projection_closes_every_kind_of_hinge() {
    for freedom in kinds() {
        let system = pair(freedom, false);
        let whole = system.assemble(&start(freedom)).unwrap();
        let mut state = whole.clone();
        let mut torn = BodyState::read(&state, 1);
        torn.p_WC += Vector3::new(1.0, -2.0, 0.5) * 1e-3;
        let turned = torn.R_WB() * exp_so3(&(Vector3::new(0.4, 0.8, -1.2) * 1e-3));
        torn.Q_WB = turned.into_inner() * 1.01;
        torn.v_WC_B += Vector3::new(0.5, 1.0, 2.0) * 1e-3;
        torn.w_WB_B += Vector3::new(-1.0, 0.3, 0.2) * 1e-3;
        torn.write(&mut state, 1);
        let com = |state: &[f64]| -> Vector3<f64> {
            let bodies = system.bodies().iter().enumerate();
            bodies
                .map(|(b, x)| BodyState::read(state, b).p_WC * x.inertia.mass)
                .sum()
        };
        let before = com(&state);
        let gap = MatrixMethod::new(&system).project(&system, &mut state);
        assert!(gap < 1e-13, "{freedom:?} {gap:e}");
        let (x, xd) = (system.displacement(&state, 1), system.rate(&state, 1));
        for axis in Axis::ALL.into_iter().filter(|a| !freedom.is_free(*a)) {
            let off = largest([x[axis.index()], xd[axis.index()]]);
            assert!(off < 1e-13, "{freedom:?} {axis} {off:e}");
        }
        assert!((com(&state) - before).norm() < 1e-13);
        let moved = largest(state.iter().zip(&whole).map(|(a, b)| a - b));
        assert!(moved < 6e-3, "{freedom:?} {moved:e}");
        assert!((BodyState::read(&state, 1).Q_WB.norm() - 1.0).abs() < 1e-13);
    }
}
