//! Wrong input and its error messages.

use fuyu::dynamics::newton_euler::{
    Axis, Freedom, Hinge, INERTIAL, Start, SystemBuilder, SystemError,
};
use fuyu::spatial::{Pose, RigidInertia};
use nalgebra::{Matrix3, Vector3};

fn ball(mass: f64) -> RigidInertia {
    RigidInertia {
        mass,
        com: Vector3::zeros(),
        about_com: Matrix3::identity(),
    }
}

/// A floating body `a`, and a body `b` on a revolute hinge `arm`.
fn pair() -> SystemBuilder {
    let mut system = SystemBuilder::new();
    system
        .body("a", ball(1.0))
        .body("b", ball(2.0))
        .hinge(Hinge::new("float", INERTIAL, "a", Freedom::FREE))
        .hinge(
            Hinge::new("arm", "a", "b", Freedom::REVOLUTE)
                .at(Pose::translation(1.0, 0.0, 0.0), Pose::identity()),
        );
    system
}

#[track_caller]
fn refused(system: &SystemBuilder, says: &str) {
    assert_eq!(system.build().unwrap_err().to_string(), says);
}

#[track_caller]
fn start_refused(system: &SystemBuilder, start: Start, says: &str) -> SystemError {
    let error = system.build().unwrap().assemble(&start).unwrap_err();
    assert_eq!(error.to_string(), says);
    error
}

#[test]
fn names() {
    refused(&SystemBuilder::new(), "the system has no bodies");
    refused(pair().body("a", ball(1.0)), "two bodies are named `a`");
    refused(pair().body("", ball(1.0)), "a body cannot be named \"\"");
    let taken = "a body cannot be named \"inertial\"";
    refused(pair().body(INERTIAL, ball(1.0)), taken);
    let twice = Hinge::new("arm", "a", "b", Freedom::FREE);
    refused(pair().hinge(twice), "two hinges are named `arm`");
    let typo = Hinge::new("h", "a", "bee", Freedom::FREE);
    refused(
        pair().hinge(typo),
        "hinge `h` joins `bee`, which is no body of the system",
    );
    let own = Hinge::new("h", "b", "b", Freedom::FREE);
    refused(pair().hinge(own), "hinge `h` joins `b` to itself");
}

#[test]
fn numbers() {
    refused(
        pair().body("c", ball(-3.0)),
        "body `c`: mass is -3 kg; it must be positive and finite",
    );
    let mut flat = ball(1.0);
    flat.about_com[(2, 2)] = -1.0;
    let error = pair().body("c", flat).build().unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("body `c`: inertia is not positive definite"),
        "{error}"
    );
    let mut thin = ball(1.0);
    thin.about_com[(2, 2)] = 5.0;
    let error = pair().body("c", thin).build().unwrap_err();
    assert!(error.to_string().contains("triangle inequality"), "{error}");
    let hinge = || Hinge::new("h", "a", "b", Freedom::REVOLUTE);
    let nan = Pose::translation(0.0, f64::NAN, 0.0);
    refused(
        pair().hinge(hinge().at(Pose::identity(), nan)),
        "hinge `h`: a number of its frame on the outer body is NaN; it must be finite",
    );
    refused(
        pair().hinge(hinge().spring(Axis::RotationZ, f64::INFINITY, 0.0)),
        "hinge `h`: stiffness on rotation z is inf; it must be finite",
    );
    refused(
        pair().hinge(hinge().spring(Axis::RotationZ, 1.0, f64::NAN)),
        "hinge `h`: rest position on rotation z is NaN; it must be finite",
    );
    refused(
        pair().hinge(hinge().damper(Axis::RotationZ, -2.0)),
        "hinge `h`: damping on rotation z is -2; it must be finite and not negative",
    );
    refused(
        pair().hinge(hinge().spring(Axis::TranslationX, 1.0, 0.0)),
        "hinge `h`: a spring on translation x, which the hinge constrains",
    );
    refused(
        pair().hinge(hinge().damper(Axis::RotationY, 1.0)),
        "hinge `h`: a damper on rotation y, which the hinge constrains",
    );
}

#[test]
fn topology() {
    let says = "body `c` is joined to nothing: no chain of hinges leads to it from inertial space (a floating \
                body needs a free hinge)";
    refused(pair().body("c", ball(1.0)), says);
    let islands = Hinge::new("h", "c", "d", Freedom::REVOLUTE);
    refused(
        pair()
            .body("c", ball(1.0))
            .body("d", ball(1.0))
            .hinge(islands),
        says,
    );
}

#[test]
fn starts() {
    let z = Axis::RotationZ;
    start_refused(
        &pair(),
        Start::new().with("leg", z, 0.0, 0.0),
        "the start names hinge `leg`, which is no hinge of the system",
    );
    start_refused(
        &pair(),
        Start::new().with("arm", Axis::RotationX, 0.1, 0.0),
        "hinge `arm`: a start value on rotation x, which the hinge constrains",
    );
    start_refused(
        &pair(),
        Start::new().with("arm", z, 0.1, f64::NAN),
        "hinge `arm`: start rate of rotation z is NaN; it must be finite",
    );
}

/// A rod from `b`'s far end back to `a`, of length √2 when the arm stands at a right angle.
fn triangle(freedom: Freedom) -> SystemBuilder {
    let mut system = pair();
    let at = |x| Pose::translation(x, 0.0, 0.0);
    system
        .body("rod", ball(1.0))
        .hinge(Hinge::new("tip", "b", "rod", Freedom::REVOLUTE).at(at(1.0), at(0.0)))
        .hinge(Hinge::new("close", "rod", "a", freedom).at(at(2f64.sqrt()), at(0.0)));
    system
}

fn right_angle(tip: f64, rate: f64) -> Start {
    let quarter = std::f64::consts::FRAC_PI_2;
    Start::new()
        .with("arm", Axis::RotationZ, quarter, rate)
        .with("tip", Axis::RotationZ, tip, 0.0)
}

#[test]
fn loops() {
    let in_plane = Freedom::SPHERICAL.and(Axis::TranslationZ);
    let tip = 135f64.to_radians();
    triangle(in_plane)
        .build()
        .unwrap()
        .assemble(&right_angle(tip, 0.0))
        .unwrap();

    // The rod's end misses by sin 0.01 of its length, seen in the rod's own axes.
    let open = start_refused(
        &triangle(in_plane),
        right_angle(tip + 0.01, 0.0),
        "hinge `close` does not close its loop at the start: translation y is off by -1.414e-2 m",
    );
    let SystemError::Open { residual, .. } = open else {
        panic!("{open:?}")
    };
    assert!(
        (residual.abs() - 2f64.sqrt() * 0.01).abs() < 2e-4,
        "{residual}"
    );
    let error = triangle(in_plane)
        .build()
        .unwrap()
        .assemble(&right_angle(tip, 0.5))
        .unwrap_err();
    assert!(
        matches!(&error, SystemError::Opening { hinge, residual, .. } if hinge == "close" && residual.abs() > 0.3),
        "{error}"
    );
    start_refused(
        &triangle(in_plane),
        Start::new().with("close", Axis::RotationZ, 0.0, 0.0),
        "hinge `close` closes a loop: where it starts follows from the hinges before it",
    );

    // Whole revolute hinges hold a planar loop three times over, and of a triangle nothing is left to move.
    start_refused(
        &triangle(Freedom::REVOLUTE),
        right_angle(tip, 0.0),
        "hinge `close` is over-constrained: translation z, rotation x, rotation y are held by `arm`, `tip` \
         already; free them, or leave redundant constraints out",
    );
    // Two hinges in the same place.
    let mut twice = pair();
    twice.hinge(Hinge::new(
        "second",
        "a",
        "b",
        Freedom::FREE.without(Axis::RotationX),
    ));
    start_refused(
        &twice,
        Start::new(),
        "hinge `second` is over-constrained: rotation x is held by `arm` already; free it, or leave redundant \
         constraints out",
    );
}
