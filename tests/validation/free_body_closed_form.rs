//! The closed forms of free rotation (Masutani 1995 sec. 2.3) against numerical integration of Euler's
//! equations, and against values computed independently.

use fuyu::dynamics::{Input, IntegrationMethod, Integrator, State, Workspace};
use fuyu::estimation::free_body::{FreeRotation, SolutionKind};
use fuyu::model::ModelBuilder;
use fuyu::spatial::RigidInertia;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// Largest difference between closed form and integration over 360 s from `start`: attitude \[rad\], angular
/// velocity \[rad/s\].
fn compare(
    I_B: Matrix3<f64>,
    R_CB: UnitQuaternion<f64>,
    w_B: Vector3<f64>,
    kind: SolutionKind,
) -> (f64, f64) {
    let inertia = RigidInertia {
        mass: 100.0,
        com: Vector3::zeros(),
        about_com: I_B,
    };
    let model = ModelBuilder::new("body", "body", inertia).build();
    let mut state = State::at_rest(&model);
    state.R_WB = R_CB;
    state.momentum_W.angular = R_CB * (I_B * w_B);
    let mut workspace = Workspace::new(&model);
    let mut integrator = Integrator::new(&model, IntegrationMethod::Dop8);
    let mut coast = |_: f64, _: &State, _: &mut Input| {};
    let motion = FreeRotation::new(&I_B, R_CB, &w_B, 0.0).unwrap();
    assert_eq!(motion.kind(), kind);
    let (dt, mut worst) = (0.03, (0f64, 0f64));
    for step in 1..=12_000 {
        integrator.step(&mut state, &mut workspace, dt, &mut coast);
        let time = dt * f64::from(step);
        workspace.set_positions(&state.q);
        workspace.set_motion(&state);
        let w = state.R_WB * workspace.V_WB_B().angular;
        worst.0 = worst.0.max(motion.attitude(time).angle_to(&state.R_WB));
        worst.1 = worst.1.max((motion.angular_velocity(time) - w).norm());
    }
    (worst.0, worst.1)
}

fn start() -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(0.4, -0.9, 2.1)
}

fn diagonal(x: f64, y: f64, z: f64) -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(x, y, z))
}

fn check(I_B: Matrix3<f64>, w_B: Vector3<f64>, kind: SolutionKind) {
    let (attitude, velocity) = compare(I_B, start(), w_B, kind);
    println!("{kind:?} {w_B:?}: {attitude:e} rad, {velocity:e} rad/s");
    assert!(attitude < 1e-9, "{attitude:e} rad");
    assert!(velocity < 1e-9, "{velocity:e} rad/s");
}

/// Both energy regimes, with axes in every order and rates of every sign: a wrong permutation, sign or branch
/// fails one of them.
#[test]
fn asymmetric_bodies_move_as_integrated() {
    use SolutionKind::Asymmetric;
    check(
        diagonal(94.2, 53.8, 40.3),
        Vector3::new(0.3, -0.2, 0.5),
        Asymmetric,
    );
    check(
        diagonal(94.2, 53.8, 40.3),
        Vector3::new(-0.5, 0.2, -0.1),
        Asymmetric,
    );
    check(
        diagonal(40.3, 94.2, 53.8),
        Vector3::new(-0.1, -0.7, 0.3),
        Asymmetric,
    );
    check(
        diagonal(53.8, 40.3, 94.2),
        Vector3::new(0.1, 0.6, -0.2),
        Asymmetric,
    );
    // The pliers of sec. 3.2: near the separatrix, k = 0.9887.
    check(
        diagonal(94.2, 53.83, 40.37),
        Vector3::new(0.0, 0.854429741019, 0.131907065001),
        Asymmetric,
    );
    // Nearly symmetric, nearly about one axis.
    check(
        diagonal(90.0, 50.0, 50.0001),
        Vector3::new(0.4, 0.3, -0.2),
        Asymmetric,
    );
    check(
        diagonal(90.0, 70.0, 50.0),
        Vector3::new(1e-6, -2e-6, 0.8),
        Asymmetric,
    );
}

/// A body whose axes are not principal.
#[test]
fn any_body_axes_will_do() {
    let turn = Rotation3::from_euler_angles(0.3, 1.1, -0.7);
    let I_B = turn * diagonal(94.2, 53.8, 40.3) * turn.inverse();
    check(I_B, Vector3::new(0.3, -0.2, 0.5), SolutionKind::Asymmetric);
}

/// Exactly on the separatrix: `L² = 2 E I_y`. Integration leaves it by e^{λt} times rounding, so the motion is
/// slow enough to pass the fast moment once within 360 s.
#[test]
fn the_aperiodic_motion_moves_as_integrated() {
    // I_x (I_x - I_y) w_x² = I_z (I_y - I_z) w_z² makes alpha equal J_y: 3·1·w_x² = 1·1·w_z².
    let I_B = diagonal(3.0, 2.0, 1.0);
    for (wy, sign) in [(-0.05, 1.0), (0.01, -1.0)] {
        let wx = 0.008;
        let w_B = Vector3::new(sign * wx, wy, wx * 3f64.sqrt());
        check(I_B, w_B, SolutionKind::Aperiodic);
    }
}

#[test]
fn axisymmetric_bodies_move_as_integrated() {
    use SolutionKind::Axisymmetric;
    check(
        diagonal(94.2, 94.2, 40.3),
        Vector3::new(0.3, -0.2, 0.5),
        Axisymmetric,
    );
    check(
        diagonal(94.2, 40.3, 94.2),
        Vector3::new(0.3, -0.2, 0.5),
        Axisymmetric,
    );
    check(
        diagonal(94.2, 40.3, 40.3),
        Vector3::new(-0.3, -0.2, 0.5),
        Axisymmetric,
    );
    // Almost across the axis of symmetry, and almost along it.
    check(
        diagonal(94.2, 40.3, 40.3),
        Vector3::new(1e-7, -0.2, 0.5),
        Axisymmetric,
    );
    check(
        diagonal(94.2, 40.3, 40.3),
        Vector3::new(0.8, -1e-7, 1e-7),
        Axisymmetric,
    );
}

#[test]
fn single_axis_rotation_moves_as_integrated() {
    use SolutionKind::SingleAxis;
    check(
        diagonal(94.2, 53.8, 40.3),
        Vector3::new(0.0, 0.0, -0.8),
        SingleAxis,
    );
    check(
        diagonal(94.2, 53.8, 40.3),
        Vector3::new(0.8, 0.0, 0.0),
        SingleAxis,
    );
    check(
        diagonal(50.0, 50.0, 50.0),
        Vector3::new(0.3, -0.2, 0.5),
        SingleAxis,
    );
}

/// Identities that hold for every body and start, the nearly degenerate ones above all: the start is what was
/// asked for, momentum stays where it is, and the attitude turns as the angular velocity says.
#[test]
fn identities_hold_for_bodies_of_every_kind() {
    let mut random = StdRng::seed_from_u64(20);
    let (mut kinds, mut wrong) = ([0; 4], Vec::new());
    for case in 0..4000 {
        let mut uniform = || 2.0 * random.random::<f64>() - 1.0;
        let mut moments = [0; 3].map(|_| 1.0 + 0.45 * uniform());
        // Moments equal to rounding, to nine digits, or not at all.
        let apart = [0.0, 1e-15, 1e-12, 1e-9, 1e-5, 1.0][case % 6];
        moments[1] = moments[0] + apart * (moments[1] - moments[0]);
        if case % 7 == 0 {
            moments[2] = moments[1] + apart * (moments[2] - moments[1]);
        }
        moments.rotate_left(case % 3);
        let mut w_B = Vector3::new(uniform(), uniform(), uniform());
        // Along an axis, nearly along it, in a plane of symmetry, anywhere.
        let aside = [1.0, 0.0, 1e-13, 1e-8, 1e-4][case % 5];
        w_B[case % 2] *= aside;
        w_B[(case % 2) + 1] *= [aside, 1.0][case % 11 % 2];
        let turn = Rotation3::new(Vector3::new(uniform(), uniform(), uniform()));
        let turn = if case % 4 == 0 {
            Rotation3::identity()
        } else {
            turn
        };
        let I_B = turn * Matrix3::from_diagonal(&Vector3::from(moments)) * turn.inverse();
        let I_B = 0.5 * (I_B + I_B.transpose());
        let w_B = turn * w_B;
        let R_CB = UnitQuaternion::from_euler_angles(uniform(), uniform(), 3.0 * uniform());
        let motion = FreeRotation::new(&I_B, R_CB, &w_B, 5.0).unwrap();
        kinds[motion.kind() as usize] += 1;

        let label = format!("{case}: {moments:?} {w_B:?} {:?}", motion.kind());
        let mut hold = |what: &str, error: f64, limit: f64| {
            // A NaN is wrong, too.
            if !error.lt(&limit) {
                wrong.push(format!("{label}: {what} {error:e}"));
            }
        };
        hold("attitude", motion.attitude(5.0).angle_to(&R_CB), 1e-7);
        let velocity = motion.angular_velocity(5.0);
        hold("velocity", (velocity - R_CB * w_B).norm(), 1e-7);
        let momentum = R_CB * (I_B * w_B);
        for time in [-40.0, 4.9, 6.0, 100.0] {
            let R = motion.attitude(time);
            let w = motion.angular_velocity(time);
            let carried = R * (I_B * R.inverse_transform_vector(&w));
            hold("momentum", (carried - momentum).norm(), 1e-7);
            // A body that is symmetric to nine digits and turns across its axis has an attitude good to 1e-10.
            let h = 1e-4;
            let turned = (motion.attitude(time + h) / motion.attitude(time - h)).scaled_axis();
            hold("turn", (turned / (2.0 * h) - w).norm(), 1e-5);
        }
    }
    assert!(
        wrong.is_empty(),
        "{} wrong: {:#?}",
        wrong.len(),
        &wrong[..wrong.len().min(12)]
    );
    assert!(kinds.iter().filter(|n| **n > 50).count() >= 3, "{kinds:?}");
}
