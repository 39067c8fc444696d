//! The force and torque sensor in a joint, and the forces of contacts, against the momentum that links gain.

use fuyu::{
    nodes::{dynamics::World, scenario::Scenario},
    spatial::{Pose, Wrench},
};
use nalgebra::Vector3;

const ROBOT: &str = r#"<robot name="r">
    <link name="base"><inertial><mass value="50"/><inertia ixx="9" iyy="8" izz="7" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <link name="arm"><inertial><origin xyz="0.4 0 0"/><mass value="6"/><inertia ixx="0.1" iyy="0.5" izz="0.5" ixy="0.02" ixz="0" iyz="0"/></inertial></link>
    <link name="hand"><inertial><origin xyz="0.1 0.02 0"/><mass value="2"/><inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0.001" iyz="0"/></inertial>
        <collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
    <link name="sensor"/>
    <joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><origin xyz="0.5 0 0"/><axis xyz="0 0 1"/></joint>
    <joint name="wrist" type="continuous"><parent link="arm"/><child link="hand"/><origin xyz="0.8 0 0" rpy="0.3 0 0"/><axis xyz="0 1 0"/></joint>
    <joint name="mount" type="fixed"><parent link="arm"/><child link="sensor"/><origin xyz="0.75 0.01 0" rpy="0 0.2 0.5"/></joint>
</robot>"#;

const BALL: &str = r#"<robot name="ball"><link name="ball"><inertial><mass value="20"/><inertia ixx="0.2" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.15"/></geometry></collision></link></robot>"#;

fn world(more: &str) -> World {
    let folder = tempfile::tempdir().unwrap();
    let text = format!(
        "dynamics:\n  ros__parameters:\n    urdf: robot.urdf\n    state_rate: 1000.0\n    time_step: 0.001\n    integrator: dop8\n    \
         initial_joint_positions: [0.2, -0.4]\n    initial_joint_velocities: [0.3, -0.5]\n    base:\n      angular_velocity: [0.05, -0.02, 0.1]\n    \
         targets: [ball]\n    ball:\n      urdf: ball.urdf\n      position: [1.75, 0.25, 0.1]\n      velocity: [-0.6, 0.1, 0.0]\n    \
         contact:\n      stiffness: 2.0e3\n      friction: 0.4\n      stiction_speed: 0.05\n      dissipation: 1.0\n    \
         excitations:\n      motor:\n        joint: wrist\n        amplitude: 3.0\n        period: 0.4\n    \
         wrist:\n      joint: wrist\n      frame: sensor\n{more}"
    );
    for (name, text) in [
        ("robot.urdf", ROBOT),
        ("ball.urdf", BALL),
        ("w.yaml", &text),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let path = folder.path().join("w.yaml");
    let scenario = Scenario::read(path.to_str().unwrap()).unwrap();
    World::new(&scenario.dynamics().unwrap()).unwrap()
}

/// Momentum of the hand, angular about the world's origin.
fn momentum(world: &World) -> (Vector3<f64>, Vector3<f64>) {
    let model = world.robot.model();
    let frame = model.frame("hand").unwrap();
    let inertia = &model.bodies()[frame.body].inertia;
    let R = world.robot.state().R_WB;
    let (X, V) = (world.robot.X_BF(frame), world.robot.V_WF_B(frame));
    let arm = X.rotation * inertia.com;
    let v = R * (V.linear + V.angular.cross(&arm));
    let w = R * V.angular;
    let X_WH: Pose = world
        .robot
        .rigid()
        .unwrap()
        .state()
        .X_WB(world.robot.rigid().unwrap().workspace())
        * X;
    let I = X_WH.rotation * inertia.about_com * X_WH.rotation.inverse();
    let p = X_WH * nalgebra::Point3::from(inertia.com);
    (
        v * inertia.mass,
        I * w + p.coords.cross(&(v * inertia.mass)),
    )
}

/// Force on the hand by contacts, and torque about the world's origin.
fn contact(world: &World) -> (Vector3<f64>, Vector3<f64>) {
    let mut sum = (Vector3::zeros(), Vector3::zeros());
    for found in world.contact_points() {
        let sign = if found.links[0] == "hand" { 1.0 } else { -1.0 };
        assert!(found.links.contains(&"hand") && found.links.contains(&"ball"));
        sum.0 += found.point.force * sign;
        sum.1 += found.point.at.cross(&found.point.force) * sign;
    }
    sum
}

/// The sensor against the rate of the hand's momentum less what contacts give it, while a ball hits the hand and a motor
/// drives it. Fails if contacts are left out of accelerations or counted with a wrong sign, and for wrong axes or points.
#[test]
fn the_sensor_measures_what_the_hand_exerts_on_the_arm() {
    let mut world = world("");
    let dt = 1e-3;
    let (mut largest, mut touched): (f64, usize) = (0.0, 0);
    let mut states: Vec<(Wrench, Pose, [Vector3<f64>; 4])> = Vec::new();
    for _ in 0..900 {
        world.step_to_tick();
        world.check_contacts().unwrap();
        let measured = world.wrist_wrench().unwrap();
        let frame = world.robot.model().frame("sensor").unwrap().clone();
        let floating = world.robot.rigid().unwrap();
        let X_WS = floating.state().X_WB(floating.workspace()) * world.robot.X_BF(&frame);
        let (p, l) = momentum(&world);
        let (f, t) = contact(&world);
        touched += usize::from(f.norm() > 0.0);
        states.push((measured, X_WS, [p, l, f, t]));
    }
    for five in states.windows(5) {
        let [first, before, now, after, last] = five else {
            unreachable!()
        };
        // Central differences of fourth order.
        let rate =
            |k: usize| (8.0 * (after.2[k] - before.2[k]) - (last.2[k] - first.2[k])) / (12.0 * dt);
        // On the hand by the arm, about the sensor, whose sign is the other one.
        let force = -(rate(0) - now.2[2]);
        let about_origin = -(rate(1) - now.2[3]);
        let torque = about_origin - now.1.translation.vector.cross(&force);
        let found = &now.0;
        let off = (now.1.rotation * found.force - force).norm() / (1.0 + force.norm());
        let off_torque = (now.1.rotation * found.torque - torque).norm() / (1.0 + torque.norm());
        // Differences across the beginning and the end of the contact have an error of their own.
        let in_contact = five.iter().all(|(_, _, of)| of[2].norm() > 1.0);
        let apart = five.iter().all(|(_, _, of)| of[2].norm() == 0.0);
        if in_contact || apart {
            assert!(
                off < 3e-3 && off_torque < 3e-3,
                "{off:e} {off_torque:e} {force} {torque}"
            );
        }
        largest = largest.max(force.norm());
    }
    assert!(touched > 20 && largest > 5.0, "{touched} {largest}");
    let events: Vec<_> = world
        .contact_events()
        .iter()
        .map(|e| e.what.as_str())
        .collect();
    assert_eq!(
        events,
        [
            "contact of hand and ball begins",
            "contact of hand and ball ends"
        ]
    );
}

/// Bias is added; noise has its deviation, depends on the state only, and is that of the seed.
#[test]
fn the_sensor_has_bias_and_noise() {
    let mut ideal = world("");
    let mut real = world(
        "      force_bias: [1.0, -2.0, 0.5]\n      torque_bias: [0.1, 0.2, -0.3]\n      force_noise: 0.5\n      torque_noise: 0.02\n",
    );
    let (mut sum, mut squares, n) = (Vector3::zeros(), 0.0, 400);
    for _ in 0..n {
        ideal.step_to_tick();
        real.step_to_tick();
        let (truth, measured) = (ideal.wrist_wrench().unwrap(), real.wrist_wrench().unwrap());
        assert_eq!(Some(measured), real.wrist_wrench());
        let off = measured.force - truth.force - Vector3::new(1.0, -2.0, 0.5);
        let of_torque = measured.torque - truth.torque - Vector3::new(0.1, 0.2, -0.3);
        sum += off;
        squares += off.norm_squared() / 0.25 + of_torque.norm_squared() / 4e-4;
    }
    // Six components; the mean square of 2400 numbers has a deviation of 3 %.
    let mean_square = squares / (6 * n) as f64;
    assert!((mean_square - 1.0).abs() < 0.12, "{mean_square}");
    assert!(
        sum.norm() / f64::from(n) < 5.0 * 0.5 / f64::from(n).sqrt() * 3f64.sqrt(),
        "{sum}"
    );
}

#[test]
fn a_sensor_in_no_joint_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("robot.urdf"), ROBOT).unwrap();
    let path = folder.path().join("w.yaml");
    for (wrist, says) in [
        (
            "joint: mount",
            "parameter wrist.joint is 'mount', which is no joint of the robot that moves; it has shoulder, wrist",
        ),
        (
            "joint: wrist, frame: thumb",
            "parameter wrist.frame is 'thumb', which is no link of the robot; it has",
        ),
    ] {
        let text = format!(
            "dynamics:\n  ros__parameters:\n    urdf: robot.urdf\n    wrist: {{{wrist}}}\n"
        );
        std::fs::write(&path, text).unwrap();
        let run = super::fuyu::fuyu(&["simulate", path.to_str().unwrap(), "--json"]);
        assert!(run.refusal().contains(says), "{}", run.stderr);
    }
}
