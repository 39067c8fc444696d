//! Contact of a target that the robot holds.

use super::*;
use crate::{
    dynamics::State,
    nodes::{dynamics::free_body::FreeBody as _, scenario::Scenario},
};
use nalgebra::{Point3, Vector3};

const ARM: &str = r#"<link name="base"><inertial><mass value="50"/><inertia ixx="9" iyy="8" izz="7" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <link name="arm"><inertial><origin xyz="0.4 0 0"/><mass value="6"/><inertia ixx="0.1" iyy="0.5" izz="0.5" ixy="0.02" ixz="0" iyz="0"/></inertial>
        <collision><origin xyz="0.35 0 0"/><geometry><box size="0.5 0.1 0.1"/></geometry></collision></link>
    <link name="hand"><inertial><origin xyz="0.1 0.02 0"/><mass value="2"/><inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0.001" iyz="0"/></inertial></link>
    <joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><origin xyz="0.5 0 0"/><axis xyz="0 0 1"/></joint>
    <joint name="wrist" type="continuous"><parent link="arm"/><child link="hand"/><origin xyz="0.8 0 0"/><axis xyz="0 1 0"/></joint>"#;
const BALL: &str = r#"<link name="ball"><inertial><mass value="20"/><inertia ixx="0.2" iyy="0.3" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.15"/></geometry></collision></link>"#;
const ROD: &str = r#"<link name="rod"><inertial><origin xyz="0 0.01 0.4"/><mass value="3"/><inertia ixx="0.1" iyy="0.12" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.45"/><geometry><sphere radius="0.08"/></geometry></collision></link>"#;
const ROCK: &str = r#"<link name="rock"><inertial><mass value="5"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.2"/></geometry></collision></link>"#;

/// A rod that hangs on the hand by a ball joint, and swings towards the arm.
const SWINGING: &str = "    targets: [rod]\n    rod:\n      urdf: rod.urdf\n      position: [1.3, 0.0, 0.0]\n      angular_velocity: [0.1, -0.9, 0.0]\n    \
         grasps: [hold]\n    hold:\n      frame: hand\n      target: rod\n      kind: ball\n      at: 0.0\n";

/// A world of a robot with these links and further parameters of the dynamics node, in ticks of a millisecond.
fn world(links: &str, more: &str) -> World {
    world_at(1000.0, links, more)
}

/// The same with ticks of another rate \[Hz\].
fn world_at(rate: f64, links: &str, more: &str) -> World {
    let folder = tempfile::tempdir().unwrap();
    let parts = [
        ("robot", links),
        ("ball", BALL),
        ("rod", ROD),
        ("rock", ROCK),
    ];
    for (name, links) in parts {
        let text = format!("<robot name=\"{name}\">{links}</robot>");
        std::fs::write(folder.path().join(format!("{name}.urdf")), text).unwrap();
    }
    let text = format!(
        "dynamics:\n  ros__parameters:\n    urdf: robot.urdf\n    state_rate: {rate:.1}\n    time_step: 0.001\n    integrator: dop8\n    \
         contact:\n      stiffness: 2.0e3\n      friction: 0.4\n      stiction_speed: 0.05\n      dissipation: 1.0\n    \
         wrist:\n      joint: wrist\n{more}"
    );
    let path = folder.path().join("w.yaml");
    std::fs::write(&path, text).unwrap();
    let scenario = Scenario::read(path.to_str().unwrap()).unwrap();
    World::new(&scenario.dynamics().unwrap()).unwrap()
}

fn step(world: &mut World) {
    world.step_to_tick_or_restore().unwrap();
    world.check_contacts().unwrap();
    world.check_grasps().unwrap();
}

fn what(world: &World) -> Vec<&str> {
    world
        .contact_events()
        .iter()
        .map(|e| e.what.as_str())
        .collect()
}

// A rock hits a ball that the hand holds; the result must be the same as if the ball were a part of the hand from the
// start. Fails if a held target has no contact, or if contact forces act on the wrong link.
#[test]
fn what_is_held_touches_others_as_a_part_of_the_hand() {
    let rock = "    rock:\n      urdf: rock.urdf\n      position: [1.55, 0.8, 0.05]\n      velocity: [0.02, -0.6, 0.0]\n";
    let held = format!(
        "    targets: [ball, rock]\n    ball:\n      urdf: ball.urdf\n      position: [1.6, 0.0, 0.0]\n{rock}    grasps: [hold]\n    \
         hold:\n      frame: hand\n      target: ball\n      target_position: [-0.3, 0.0, 0.0]\n      at: 0.0\n"
    );
    let mut held = world(ARM, &held);
    let fixed = r#"<joint name="fix" type="fixed"><parent link="hand"/><child link="ball"/><origin xyz="0.3 0 0"/></joint>"#;
    let mut fixed = world(
        &format!("{ARM}{BALL}{fixed}"),
        &format!("    targets: [rock]\n{rock}"),
    );
    assert_eq!(held.held_target(), Some("ball"));
    let mut hardest: f64 = 0.0;
    for _ in 0..2000 {
        step(&mut held);
        step(&mut fixed);
        let [a, b] = [&held, &fixed].map(|world| world.robot.state());
        let [m, n] = [&held, &fixed].map(|world| world.targets.last().unwrap().body.state());
        let off = (&a.q - &b.q).norm()
            + (m.p_WC - n.p_WC).norm()
            + (held.robot.X_WB().translation.vector - fixed.robot.X_WB().translation.vector).norm();
        assert!(off < 1e-8, "{off:e}");
        let [f, g] = [&mut held, &mut fixed].map(|world| world.wrist_wrench().unwrap());
        let off = (f.force - g.force).norm() + (f.torque - g.torque).norm();
        assert!(off < 1e-4 * (1.0 + f.force.norm()), "{off:e} {f:?} {g:?}");
        hardest = hardest.max(f.force.norm());
    }
    assert!(hardest > 3.0, "{hardest}");
    let events = [
        "contact of ball and rock begins",
        "contact of ball and rock ends",
    ];
    assert_eq!(what(&held), events);
    assert_eq!(what(&fixed), events);
}

/// Momentum, angular about the world's origin, of robot and target.
fn momentum(world: &World) -> [Vector3<f64>; 2] {
    let mut sum = [Vector3::zeros(); 2];
    for state in [world.robot.state(), world.targets[0].body.state()] {
        let State {
            momentum_W, p_WC, ..
        } = state;
        sum[0] += momentum_W.linear;
        sum[1] += momentum_W.angular + p_WC.cross(&momentum_W.linear);
    }
    sum
}

/// Momentum of hand and rod, angular about the world's origin.
fn momentum_beyond(world: &World) -> [Vector3<f64>; 2] {
    let rod = world.targets[0].body.state();
    let P = rod.momentum_W.linear;
    let mut sum = [P, rod.momentum_W.angular + rod.p_WC.cross(&P)];
    let robot = &world.robot;
    let frame = robot.model().frame("hand").unwrap();
    let inertia = &robot.model().bodies()[frame.body].inertia;
    let (X_BH, V, R) = (robot.X_BF(frame), robot.V_WF_B(frame), robot.state().R_WB);
    let arm = X_BH.rotation * inertia.com;
    let I = X_BH.rotation * inertia.about_com * X_BH.rotation.inverse();
    let P = R * (V.linear + V.angular.cross(&arm)) * inertia.mass;
    sum[0] += P;
    sum[1] += R * (I * V.angular)
        + (robot.X_WB() * X_BH * Point3::from(inertia.com))
            .coords
            .cross(&P);
    sum
}

// A rod hangs on the hand by a ball joint and swings against the arm, by more than the angle at which the joint's axes are
// chosen again. Momentum, energy, and the sensor in the wrist against the momentum that hand and rod gain. Fails if contact of the
// held body with the robot is left out, acts on one of them only, or ends with the choice of axes.
#[test]
fn what_is_held_touches_the_robot() {
    let mut world = world(ARM, SWINGING);
    assert_eq!(world.held_target(), Some("rod"));
    let [P, L] = momentum(&world);
    let energy = |world: &World| {
        let (stored, dissipated) = world.contact_energy().unwrap();
        let rod = world.targets[0].body.workspace().kinetic_energy();
        world.robot.kinetic_energy() + rod + stored + dissipated
    };
    let start = energy(&world);
    let mut states = Vec::new();
    for _ in 0..3000 {
        step(&mut world);
        let [P_now, L_now] = momentum(&world);
        assert!((P_now - P).norm() < 1e-11 && (L_now - L).norm() < 1e-11);
        let off = energy(&world) / start - 1.0;
        assert!(off.abs() < 1e-7, "{off:e} at {}", world.time());
        let mut on_beyond = [Vector3::zeros(); 2];
        for found in world.contact_points() {
            assert_eq!(found.links, ["arm", "rod"]);
            on_beyond[0] -= found.point.force;
            on_beyond[1] -= found.point.at.cross(&found.point.force);
        }
        let frame = world.robot.model().frame("hand").unwrap().clone();
        let X_WS = world.robot.X_WB() * world.robot.X_BF(&frame);
        let measured = world.wrist_wrench().unwrap();
        states.push((measured, X_WS, momentum_beyond(&world), on_beyond));
    }
    let events = what(&world);
    assert_eq!(
        events[..2],
        [
            "contact of arm and rod begins",
            "contact of arm and rod ends"
        ]
    );
    let mut in_contact = 0;
    for five in states.windows(5) {
        // Fourth-order central differences; across the beginning and the end of contact they have an error of their
        // own.
        let touch = five.iter().filter(|s| s.3[0].norm() > 1.0).count();
        let apart = five.iter().filter(|s| s.3[0].norm() == 0.0).count();
        if touch < 5 && apart < 5 {
            continue;
        }
        in_contact += usize::from(touch == 5);
        let rate = |k: usize| {
            let of = |i: usize| five[i].2[k];
            (8.0 * (of(3) - of(1)) - (of(4) - of(0))) / (12.0 * 1e-3)
        };
        let (measured, X_WS, _, on_beyond) = &five[2];
        let force = -(rate(0) - on_beyond[0]);
        let torque = -(rate(1) - on_beyond[1]) - X_WS.translation.vector.cross(&force);
        let off = (X_WS.rotation * measured.force - force).norm() / (1.0 + force.norm());
        let off_torque = (X_WS.rotation * measured.torque - torque).norm() / (1.0 + torque.norm());
        assert!(
            off < 3e-3 && off_torque < 3e-3,
            "{off:e} {off_torque:e} {force} {torque}"
        );
    }
    assert!(in_contact > 20, "{in_contact}");
}

// With ticks in which the joint turns by more than its axes allow. Fails if its axes are chosen once a tick.
#[test]
fn the_axes_of_a_ball_joint_are_chosen_in_time_whatever_the_tick() {
    let mut fine = world(ARM, SWINGING);
    let mut coarse = world_at(0.5, ARM, SWINGING);
    for k in 1..=3 {
        step(&mut coarse);
        for _ in 0..2000 {
            step(&mut fine);
        }
        assert!((fine.time() - coarse.time()).abs() < 1e-9);
        let [a, b] = [&fine, &coarse].map(|world| world.robot.state());
        let [m, n] = [&fine, &coarse].map(|world| world.targets[0].body.state());
        let off = (&a.q - &b.q).norm() + (m.p_WC - n.p_WC).norm();
        assert!(off < 1e-6, "{off:e} after {k} ticks");
    }
    assert_eq!(what(&fine), what(&coarse));
    assert!(what(&fine).len() >= 2);
}

// The hand overlaps with the ball from before a grasp until after it is released; everything is at rest. Fails if contact of the two
// begins at their full depth when contact is set up again.
#[test]
fn what_overlaps_is_not_pushed_apart_when_a_grasp_closes_and_opens() {
    let hand = r#"<inertial><origin xyz="0.1 0.02 0"/>"#;
    let shape = r#"<collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.1"/></geometry></collision>"#;
    let links = ARM.replacen(hand, &format!("{shape}{hand}"), 1);
    assert!(links.len() > ARM.len());
    let mut world = world(
        &links,
        "    targets: [rock, ball]\n    rock:\n      urdf: rock.urdf\n      position: [0.0, 5.0, 0.0]\n    ball:\n      urdf: ball.urdf\n      \
         position: [1.6, 0.0, 0.0]\n    grasps: [hold]\n    hold:\n      frame: hand\n      target: ball\n      \
         target_position: [-0.3, 0.0, 0.0]\n      at: 0.0\n      release_at: 0.2505\n",
    );
    for k in 0..500 {
        step(&mut world);
        assert_eq!(world.held_target().is_some(), k < 250, "{k}");
        if k == 300 {
            // Contact is set up again, because there is another body.
            world.targets.remove(0);
        }
        let moved = world.targets.last().unwrap().body.state().momentum_W;
        assert!(moved.linear.norm() < 1e-12, "{moved:?} after tick {k}");
        assert_eq!(world.contact_points().count(), 0);
    }
    assert!(what(&world).is_empty(), "{:?}", what(&world));
}
