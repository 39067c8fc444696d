//! Compliant contact against closed forms and two independent codes (`contact.json`).

use fuyu_physics::dynamics::Floating;
use fuyu_physics::dynamics::contact::{ContactEvent, ContactLaw, ContactWorld, Shape};
use fuyu_physics::spatial::Pose;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde_json::Value;

use crate::support::{
    base_twist, body, fixture, floating, list, matrix, momentum, near, number, numbers, quaternion,
    vector,
};

/// Mass \[kg\] of what stands for a fixed body.
const FIXED: f64 = 1e18;

fn ball(mass: f64, inertia: f64, at: Vector3<f64>, v: Vector3<f64>, w: Vector3<f64>) -> Floating {
    let model = body("ball", mass, Matrix3::identity() * inertia);
    floating(&model, at, UnitQuaternion::identity(), v, w, &[], &[])
}

fn law(value: &Value) -> ContactLaw {
    let of = |name: &str| number(&value[name]);
    ContactLaw {
        stiffness: of("k"),
        exponent: of("n"),
        dissipation: of("d"),
        ..ContactLaw::default()
    }
}

/// A ball over the plane z = 0 of another body.
fn over_plane(
    ball: Floating,
    radius: f64,
    mass: f64,
    law: ContactLaw,
    tolerance: f64,
) -> ContactWorld {
    let zero = Vector3::zeros();
    let slab = self::ball(mass, mass, zero, zero, zero);
    let mut world = ContactWorld::new(vec![ball, slab]).with_tolerance(tolerance);
    let a = world.add_collider(0, 0, Pose::identity(), Shape::sphere(radius).unwrap());
    let b = world.add_collider(1, 0, Pose::identity(), Shape::HalfSpace);
    world.add_pair(a, b, law).unwrap();
    world
}

/// Restitution and duration to 1e-9 of the closed forms. A normal force without `max`, an event that is located
/// late, or a step across the touchdown shows at once.
#[test]
fn head_on_impacts_have_restitution_and_duration_of_the_closed_forms() {
    for case in list(&fixture("contact")["closed_form"]) {
        let of = |name: &str| number(&case[name]);
        let (radius, v) = (of("R"), of("v0"));
        let zero = Vector3::zeros();
        let start = Vector3::new(0.0, 0.0, radius + 1e-4);
        let ball = ball(of("m1"), 0.01, start, Vector3::new(0.0, 0.0, -v), zero);
        let law = ContactLaw {
            friction: 0.0,
            ..law(case)
        };
        let mut world = over_plane(ball, radius, of("m2"), law, 1e-16);
        world.step(0.1).unwrap();
        let speed = |i: usize| base_twist(&world.systems()[i]).0.z;
        let restitution = (speed(0) - speed(1)) / v;
        assert!(
            (restitution - of("restitution")).abs() < 1e-9,
            "{case}: {restitution}"
        );
        assert!(
            (law.restitution(v) - of("restitution")).abs() < 1e-12,
            "{case}"
        );
        let work = world.work();
        let events: Vec<ContactEvent> = world.take_events().collect();
        assert_eq!(events.len(), 2, "{events:?}");
        let duration = events[1].time - events[0].time;
        assert!(
            (duration / of("duration") - 1.0).abs() < 1e-9,
            "{case}: {duration}"
        );
        assert!(
            (events[0].time - 1e-4 / v).abs() < 1e-11,
            "{case}: {events:?}"
        );
        println!(
            "{} {work:?} {:e}",
            case["name"],
            restitution - of("restitution")
        );
        assert!(work.steps < 8000, "{work:?}");
    }
}

/// Oblique impacts on a fixed plane follow the exact integral of the soft norm to 1e-9, for the deepest point (w =
/// 0), and the fixture for the middle (w = 1/2).
#[test]
fn oblique_impacts_follow_the_exact_slip_law() {
    for case in list(&fixture("contact")["oblique"]) {
        let of = |name: &str| number(&case[name]);
        let (radius, name) = (of("R"), case["name"].as_str().unwrap());
        for (weight, v_after, w_after) in [
            (0.0, "v_after", Some("w_after")),
            (0.5, "v_after_w_half", Some("w_after_w_half")),
        ] {
            let start = Vector3::new(0.0, 0.0, radius + 1e-9);
            let ball = ball(
                of("m"),
                of("I"),
                start,
                vector(&case["v0"]),
                vector(&case["w0"]),
            );
            let law = ContactLaw {
                friction: of("mu"),
                stiction_speed: of("v_s"),
                point_weight: weight,
                ..law(case)
            };
            let mut world = over_plane(ball, radius, FIXED, law, 1e-13);
            world.step(0.1).unwrap();
            let (v, w) = base_twist(&world.systems()[0]);
            near(
                &format!("{name} v {weight}"),
                v.as_slice(),
                &numbers(&case[v_after]),
                1e-9,
            );
            if let Some(w_after) = w_after {
                near(
                    &format!("{name} w {weight}"),
                    w.as_slice(),
                    &numbers(&case[w_after]),
                    1e-9 / radius,
                );
            }
            if weight == 0.0 {
                // G(s0) - G(s1) = μ P / m_t
                let s = of("v_s");
                let integral = |x: f64| x.hypot(s) + s * (x / (s + x.hypot(s))).ln();
                let slip = |v: Vector3<f64>, w: Vector3<f64>| {
                    (v + w.cross(&Vector3::new(0.0, 0.0, -radius))).xy().norm()
                };
                let (before, after) = (slip(vector(&case["v0"]), vector(&case["w0"])), slip(v, w));
                if after > 1e-6 {
                    let lost = of("mu") * of("Pn") / of("m_t");
                    assert!(
                        (integral(before) - integral(after) - lost).abs() < 1e-9,
                        "{name}"
                    );
                }
            }
        }
    }
}

/// Two free bodies: trajectories to 1e-8 (a box's corner: 1e-7), momentum to 1e-12, and energy that never rises.
#[test]
fn two_free_bodies_touch_as_two_other_codes_compute() {
    for case in list(&fixture("contact")["trajectories"]) {
        let name = case["name"].as_str().unwrap();
        let tolerance = if name.starts_with("box") { 1e-7 } else { 1e-8 };
        let system = |of: &str| {
            let model = body(of, number(&case[of]["m"]), matrix(&case[of]["I"]));
            let first = |what: &str| &list(&case[format!("{of}_{what}")])[0];
            let R = quaternion(first("quat_wxyz"));
            floating(
                &model,
                vector(first("com")),
                R,
                vector(first("v")),
                vector(first("w")),
                &[],
                &[],
            )
        };
        let (a, b) = (&case["A"], &case["B"]);
        let (points, radii) = (list(&a["points"]), numbers(&a["radius"]));
        let along_x = Pose::from_parts(
            nalgebra::Translation3::identity(),
            Rotation3::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2),
        );
        let (shape, X) = match points.len() {
            1 => (Shape::sphere(radii[0]).unwrap(), Pose::identity()),
            2 => (
                Shape::capsule(radii[0], 2.0 * vector(&points[0]).x).unwrap(),
                along_x,
            ),
            _ => (
                Shape::cuboid(&(vector(&points[0]) * 2.0)).unwrap(),
                Pose::identity(),
            ),
        };
        let mut world = ContactWorld::new(vec![system("A"), system("B")]).with_tolerance(1e-12);
        let first = world.add_collider(0, 0, X, shape);
        let second = match b["rB"].as_f64() {
            Some(radius) => {
                world.add_collider(1, 0, Pose::identity(), Shape::sphere(radius).unwrap())
            }
            None => world.add_collider(1, 0, vector_pose(&b["p0"]), Shape::HalfSpace),
        };
        let law = ContactLaw {
            friction: number(&case["law"]["mu"]),
            stiction_speed: number(&case["law"]["vs"]),
            point_weight: number(&case["law"]["w"]),
            ..law(&case["law"])
        };
        world.add_pair(first, second, law).unwrap();
        world.check_apart().unwrap();
        let total = |world: &ContactWorld| {
            momentum(&[world.systems()[0].state(), world.systems()[1].state()])
        };
        let (P, L) = total(&world);
        let (mut energy, mut time) = (f64::INFINITY, 0.0);
        for (k, t) in numbers(&case["t"]).iter().enumerate() {
            if *t > time {
                world.step(t - time).unwrap();
            }
            time = *t;
            for (i, of) in ["A", "B"].iter().enumerate() {
                let at = |what: &str| format!("{name} {of}_{what} at {t}");
                let expected = |what: &str| &list(&case[format!("{of}_{what}")])[k];
                let system = &world.systems()[i];
                let (v, w) = base_twist(system);
                near(
                    &at("com"),
                    system.state().p_WC.as_slice(),
                    &numbers(expected("com")),
                    tolerance,
                );
                near(&at("v"), v.as_slice(), &numbers(expected("v")), tolerance);
                near(&at("w"), w.as_slice(), &numbers(expected("w")), tolerance);
                let R = system.state().R_WB.to_rotation_matrix();
                let turned = R.matrix()
                    - quaternion(expected("quat_wxyz"))
                        .to_rotation_matrix()
                        .matrix();
                near(&at("R"), turned.as_slice(), &[0.0; 9], tolerance);
            }
            let (P_now, L_now) = total(&world);
            assert!(
                (P_now - P).norm() < 1e-12 && (L_now - L).norm() < 1e-12,
                "{name} {:e} {:e}",
                (P_now - P).norm(),
                (L_now - L).norm()
            );
            let now = world.kinetic_energy() + world.stored_energy();
            assert!(
                now <= energy + 1e-10,
                "{name}: energy rises by {:e}",
                now - energy
            );
            energy = now;
        }
        println!("{name} {:?}", world.work());
        let events: Vec<ContactEvent> = world.take_events().collect();
        let expected = list(&case["events"]);
        assert_eq!(events.len(), expected.len(), "{name}: {events:?}");
        for (event, expected) in events.iter().zip(expected) {
            assert!(
                (event.time - number(&expected["t"])).abs() < 1e-8,
                "{name}: {event:?} {expected}"
            );
            assert_eq!(
                event.point as u64,
                expected["contact"].as_u64().unwrap(),
                "{name}"
            );
            assert_eq!(event.begins, expected["kind"] == "touchdown", "{name}");
        }
    }
}

fn vector_pose(value: &Value) -> Pose {
    Pose::from_parts(vector(value).into(), Rotation3::identity())
}

/// Invalid input is refused in one line, and what cannot be integrated ends in an error, not in a hang.
#[test]
fn invalid_contacts_are_refused() {
    let zero = Vector3::zeros();
    let balls = [0.0, 0.15].map(|z| ball(1.0, 0.01, Vector3::new(0.0, 0.0, z), zero, zero));
    let mut world = ContactWorld::new(balls.into());
    let [a, b] =
        [0, 1].map(|i| world.add_collider(i, 0, Pose::identity(), Shape::sphere(0.1).unwrap()));
    let c = world.add_collider(0, 0, Pose::identity(), Shape::HalfSpace);
    let law = ContactLaw {
        friction: -0.1,
        ..ContactLaw::default()
    };
    let message = world.add_pair(a, b, law).unwrap_err().to_string();
    assert_eq!(
        message,
        "contact of body of ball and body of ball: friction is -0.1; it must be zero or positive, and finite"
    );
    let message = world
        .add_pair(a, c, ContactLaw::default())
        .unwrap_err()
        .to_string();
    assert!(
        message.ends_with("cannot touch each other: they are on one body"),
        "{message}"
    );
    world.add_pair(a, b, ContactLaw::default()).unwrap();
    let message = world.check_apart().unwrap_err().to_string();
    assert_eq!(
        message,
        "body of ball and body of ball overlap by 5.00e-2 m at the start; move them apart"
    );
    world.input_mut(0).wrenches[0].force.x = f64::NAN;
    let message = world.step(1.0).unwrap_err().to_string();
    assert!(
        message.starts_with("contact at 0 s cannot be integrated"),
        "{message}"
    );
    assert_eq!(world.systems()[0].state().time, 0.0);
}

/// Pairs of all shapes that hit each other: momentum stays to 1e-12, and energy does not rise. Capsules on cylinders
/// and meshes, whose forces would jump from face to face, are refused.
#[test]
fn all_pairs_of_shapes_keep_momentum() {
    let cloud: Vec<Vector3<f64>> = (0..24)
        .map(|i| {
            let (turn, z) = (2.4 * f64::from(i), 1.0 - f64::from(2 * i + 1) / 24.0);
            Vector3::new(
                turn.cos() * (1.0 - z * z).sqrt(),
                turn.sin() * (1.0 - z * z).sqrt(),
                z,
            ) * 0.15
        })
        .collect();
    let shapes = [
        Shape::sphere(0.12).unwrap(),
        Shape::capsule(0.08, 0.2).unwrap(),
        Shape::cuboid(&Vector3::new(0.2, 0.25, 0.3)).unwrap(),
        Shape::cylinder(0.1, 0.2).unwrap(),
        Shape::convex_hull(&cloud).unwrap(),
        Shape::HalfSpace,
    ];
    let law = ContactLaw {
        stiffness: 2e5,
        friction: 0.4,
        stiction_speed: 5e-3,
        ..ContactLaw::default()
    };
    for (i, first) in shapes.iter().enumerate() {
        for (j, second) in shapes.iter().enumerate() {
            if i == 5 && j == 5 {
                continue;
            }
            let inertia = Matrix3::from_diagonal(&Vector3::new(0.05, 0.06, 0.08));
            let spin = |k: usize| Vector3::new(0.3, -0.2, 0.4) * (1.0 + k as f64);
            let turned =
                |k: usize| UnitQuaternion::from_euler_angles(0.3 * k as f64, 0.5, -0.2 * k as f64);
            // A half-space is below z = 0 of its body: the other one comes from above, or it from below, upside down.
            let (height, flip) = (0.45, i == 5);
            let R_1 = if flip {
                UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.0)
            } else {
                turned(i)
            };
            let R_2 = if j == 5 {
                UnitQuaternion::identity()
            } else {
                turned(j + 1)
            };
            let still = |k: usize| if k == 5 { Vector3::zeros() } else { spin(k) };
            let systems = vec![
                floating(
                    &body("one", 5.0, inertia),
                    Vector3::new(0.02, 0.01, height),
                    R_1,
                    Vector3::new(0.02, 0.01, -0.3),
                    still(i),
                    &[],
                    &[],
                ),
                floating(
                    &body("two", 8.0, inertia * 2.0),
                    Vector3::zeros(),
                    R_2,
                    Vector3::new(0.0, 0.0, 0.05),
                    still(j),
                    &[],
                    &[],
                ),
            ];
            let mut world = ContactWorld::new(systems).with_tolerance(1e-9);
            let a = world.add_collider(0, 0, Pose::identity(), first.clone());
            let b = world.add_collider(1, 0, Pose::identity(), second.clone());
            let added = world.add_pair(a, b, law);
            if matches!((i, j), (1, 3 | 4) | (3 | 4, 1)) {
                let message = added.unwrap_err().to_string();
                assert!(
                    message.contains("give the other shape as a box"),
                    "{message}"
                );
                continue;
            }
            added.unwrap();
            world.check_apart().unwrap();
            let total = |world: &ContactWorld| {
                momentum(&[world.systems()[0].state(), world.systems()[1].state()])
            };
            let ((P, L), mut energy) = (total(&world), world.kinetic_energy());
            let mut rise = 0.0_f64;
            for _ in 0..30 {
                let stepped = world.step(0.05);
                assert_eq!(stepped, Ok(()), "{i} {j}: {:?}", world.work());
                let (P_now, L_now) = total(&world);
                assert!(
                    (P_now - P).norm() < 1e-12 && (L_now - L).norm() < 1e-12,
                    "{i} {j}"
                );
                let now = world.kinetic_energy() + world.stored_energy();
                rise = rise.max(now - energy);
                assert!(
                    now <= energy + 1e-9,
                    "{i} {j}: energy rises by {:e}",
                    now - energy
                );
                energy = now;
            }
            assert!(world.take_events().count() > 1, "{i} {j}: nothing touched");
            println!("{i} {j}: rise {rise:.1e} J, {:?}", world.work());
            assert!(world.work().steps < 20_000, "{i} {j}: {:?}", world.work());
        }
    }
}
