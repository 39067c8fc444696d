//! Impacts of a ball: restitution, duration, friction.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

use super::super::Report;
use crate::{
    dynamics::{
        Floating, IntegrationMethod, State, Workspace,
        contact::{ContactError, ContactLaw, ContactWorld, Shape},
    },
    model::ModelBuilder,
    spatial::{Pose, RigidInertia, Twist},
};

/// `d v` and coefficient of restitution `e = (1 + W0(-(1 + a) exp(-(1 + a)))) / a`, by Lambert's W function in 30
/// digits.
const RESTITUTION: [(f64, f64); 9] = [
    (0.01, 0.993_377_454_399),
    (0.05, 0.967_738_578_531),
    (0.1, 0.937_475_579_950),
    (0.2, 0.882_189_986_247),
    (0.5, 0.748_434_931_597),
    (1.0, 0.593_624_260_040),
    (2.0, 0.410_719_686_061),
    (5.0, 0.196_980_245_281),
    (10.0, 0.099_981_624_753),
];

/// Mass of the body that represents a fixed body \[kg\].
const FIXED: f64 = 1e18;

/// Radius of the ball \[m\].
const RADIUS: f64 = 0.05;

/// A body with its centre of mass at height `z`, velocity `v` and angular velocity `w`.
fn body(mass: f64, inertia: f64, z: f64, v: Vector3<f64>, w: Vector3<f64>) -> Floating {
    let inertia = RigidInertia {
        mass,
        com: Vector3::zeros(),
        about_com: Matrix3::identity() * inertia,
    };
    let model = ModelBuilder::new("body", "body", inertia).build();
    let mut state = State::at_rest(&model);
    let X_WB = Isometry3::from_parts(Translation3::new(0.0, 0.0, z), UnitQuaternion::identity());
    state.set_base(&mut Workspace::new(&model), &X_WB, &Twist::new(w, v));
    Floating::new(model, state, IntegrationMethod::Dop8)
}

/// A ball over the plane z = 0 of another body.
fn over_plane(
    ball: Floating,
    other: Floating,
    law: ContactLaw,
    tolerance: f64,
) -> Result<ContactWorld, ContactError> {
    let mut world = ContactWorld::new(vec![ball, other]).with_tolerance(tolerance);
    let sphere = Shape::Sphere { radius: RADIUS };
    let first = world.add_collider(0, 0, Pose::identity(), sphere);
    let second = world.add_collider(1, 0, Pose::identity(), Shape::HalfSpace);
    world.add_pair(first, second, law)?;
    Ok(world)
}

/// Velocity of the centre of mass, and angular velocity, world axes.
fn motion(system: &Floating) -> (Vector3<f64>, Vector3<f64>) {
    let state = system.state();
    (
        state.momentum_W.linear / system.model().total_mass(),
        state.R_WB * system.workspace().V_WB_B().angular,
    )
}

/// Restitution and duration of a head-on impact of 10 kg on 500 kg at 0.1 m/s, simulated.
fn head_on(law: ContactLaw) -> Result<(f64, f64), ContactError> {
    const SPEED: f64 = 0.1;
    let zero = Vector3::zeros();
    let down = Vector3::new(0.0, 0.0, -SPEED);
    let ball = body(10.0, 0.01, RADIUS + 1e-4, down, zero);
    let mut world = over_plane(ball, body(500.0, 500.0, 0.0, zero, zero), law, 1e-16)?;
    world.step(0.1)?;
    let speed = |i: usize| motion(&world.systems()[i]).0.z;
    let restitution = (speed(0) - speed(1)) / SPEED;
    let times: Vec<f64> = world.take_events().map(|event| event.time).collect();
    let duration = match times.as_slice() {
        [begin, end] => end - begin,
        _ => f64::NAN,
    };
    Ok((restitution, duration))
}

/// Head-on impacts by Hertz's law and by a linear spring.
pub(super) fn restitution(mut report: Report) -> Report {
    let law = |exponent: f64, dissipation: f64| ContactLaw {
        stiffness: if exponent == 1.0 { 2e5 } else { 4e6 },
        exponent,
        dissipation,
        friction: 0.0,
        ..ContactLaw::default()
    };
    for (k, (a, published)) in RESTITUTION.into_iter().enumerate() {
        let exponent = if k % 2 == 0 { 1.5 } else { 1.0 };
        let found = head_on(law(exponent, a / 0.1)).map_or(f64::NAN, |found| found.0);
        let what = format!("e at d v = {a}, exponent {exponent}");
        report.near(&what, published, found, 1e-9);
    }
    let mass: f64 = 10.0 * 500.0 / 510.0;
    let spring = law(1.0, 0.0);
    let found = head_on(spring).map_or(f64::NAN, |found| found.1);
    let period = PI * (mass / spring.stiffness).sqrt();
    report.near(
        "duration with a linear spring, over pi sqrt(m / k)",
        1.0,
        found / period,
        1e-9,
    );
    let hertz = law(1.5, 0.0);
    let depth = (2.5 * mass * 0.01 / (2.0 * hertz.stiffness)).powf(0.4);
    let found = head_on(hertz).map_or(f64::NAN, |found| found.1);
    report.near(
        "duration with Hertz's law, over depth / speed (K. Johnson, Contact Mechanics, eq. 11.24: 2.94)",
        2.943_275,
        found * 0.1 / depth,
        5e-7,
    );
    report.note("A ball of 10 kg hits 500 kg at 0.1 m/s. Restitution depends on d v alone, not on stiffness, exponent or masses.");
    report
}

/// Oblique impact of a spinning ball of 10 kg on a fixed plane: the contact point is the ball's deepest point, so that
/// the slip follows `G(s0) - G(s1) = μ P / m_t` for any normal force.
pub(super) fn friction(mut report: Report) -> Report {
    let (mass, inertia, friction, speed) = (10.0, 0.01, 0.1, 1e-4);
    let law = ContactLaw {
        stiffness: 4e6,
        exponent: 1.5,
        dissipation: 2.0,
        friction,
        stiction_speed: speed,
        point_weight: 0.0,
        bristle: None,
    };
    let (v, w) = (Vector3::new(0.3, 0.1, -0.1), Vector3::new(1.0, -2.0, 3.0));
    let ball = body(mass, inertia, RADIUS + 1e-9, v, w);
    let fixed = body(FIXED, FIXED, 0.0, Vector3::zeros(), Vector3::zeros());
    let simulated = over_plane(ball, fixed, law, 1e-13).and_then(|mut world| {
        world.step(0.1)?;
        Ok(motion(&world.systems()[0]))
    });
    let nothing = Vector3::repeat(f64::NAN);
    let (after, spin) = simulated.unwrap_or((nothing, nothing));
    // Integrated by another program with relative tolerance 1e-13.
    let published = (
        [0.282_376_506_552_349_8, 0.093_391_189_957_131_18],
        [0.669_559_497_856_558_5, -1.118_825_327_617_489_5],
    );
    report.near("velocity after, x [m/s]", published.0[0], after.x, 1e-9);
    report.near("velocity after, y [m/s]", published.0[1], after.y, 1e-9);
    report.near(
        "angular velocity after, x [rad/s]",
        published.1[0],
        spin.x,
        2e-8,
    );
    report.near(
        "angular velocity after, y [rad/s]",
        published.1[1],
        spin.y,
        2e-8,
    );
    let slip = |v: Vector3<f64>, w: Vector3<f64>| {
        (v + w.cross(&Vector3::new(0.0, 0.0, -RADIUS))).xy().norm()
    };
    let integral = |s: f64| s.hypot(speed) + speed * (s / (speed + s.hypot(speed))).ln();
    // The ball's restitution at d v = 0.2, and its inertia against a force along the plane.
    let impulse = mass * (1.0 + RESTITUTION[3].1) * 0.1;
    let tangential = 1.0 / (1.0 / mass + RADIUS * RADIUS / inertia);
    report.near(
        "G(s0) - G(s1) [m/s], over mu P / m_t",
        1.0,
        (integral(slip(v, w)) - integral(slip(after, spin))) / (friction * impulse / tangential),
        1e-7,
    );
    report.note(
        "G(s) = sqrt(s² + v_s²) + v_s ln(s / (v_s + sqrt(s² + v_s²))) integrates the soft norm exactly; rigid Coulomb friction is its limit.",
    );
    report
}
