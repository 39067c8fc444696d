//! The force and torque sensor in the wrist of robots with flexible parts and wheels.

use super::*;
use crate::{
    dynamics::flexible::{ElasticJoint, RotorModel},
    nodes::{
        dynamics::{WristParams, free_body::FreeBody as _},
        scenario::Scenario,
    },
};
use nalgebra::{Point3, Vector3};

/// Momentum of the servicer's bodies from `first` on, angular about the world's origin.
fn momentum_from(world: &World, first: usize) -> [Vector3<f64>; 2] {
    let robot = &world.robot;
    let (X_WB, R_WB) = (robot.X_WB(), robot.state().R_WB);
    let mut sum = [Vector3::zeros(); 2];
    for body in &robot.model().bodies()[first..] {
        let frame = robot.model().frame(&body.name).unwrap();
        let (X_BF, V) = (robot.X_BF(frame), robot.V_WF_B(frame));
        let arm = X_BF.rotation * body.inertia.com;
        let I = X_BF.rotation * body.inertia.about_com * X_BF.rotation.inverse();
        let P = R_WB * (V.linear + V.angular.cross(&arm)) * body.inertia.mass;
        let p = (X_WB * X_BF * Point3::from(body.inertia.com)).coords;
        sum[0] += P;
        sum[1] += R_WB * (I * V.angular) + p.cross(&P);
    }
    sum
}

/// Steps a servicer with a sensor in joint5 and frame tool0 through 60 ticks, and compares what it measures with the rate of the
/// momentum beyond the joint, to which the bodies that it holds contribute `held`. Returns the largest force \[N\].
pub(super) fn check_wrist(
    world: &mut World,
    tolerance: f64,
    held: impl Fn(&World) -> [Vector3<f64>; 2],
) -> f64 {
    let frame = |world: &World, name: &str| world.robot.model().frame(name).unwrap().clone();
    let (first, tool) = (frame(world, "link5").body, frame(world, "tool0"));
    let begin = world.time();
    let mut states = Vec::new();
    for _ in 0..60 {
        world.step_to_tick();
        let X_WS = world.robot.X_WB() * world.robot.X_BF(&tool);
        let measured = world.wrist_wrench().unwrap();
        let [P, L] = momentum_from(world, first);
        let [P_held, L_held] = held(world);
        states.push((measured, X_WS, [P + P_held, L + L_held]));
    }
    let dt = (world.time() - begin) / 60.0;
    let mut largest: f64 = 0.0;
    for five in states.windows(5) {
        // Fourth-order central differences.
        let rate = |k: usize| {
            let of = |i: usize| five[i].2[k];
            (8.0 * (of(3) - of(1)) - (of(4) - of(0))) / (12.0 * dt)
        };
        let (measured, X_WS, _) = &five[2];
        let force = -rate(0);
        let torque = -rate(1) - X_WS.translation.vector.cross(&force);
        let off = (X_WS.rotation * measured.force - force).norm();
        let off_torque = (X_WS.rotation * measured.torque - torque).norm();
        assert!(
            off < tolerance && off_torque < tolerance,
            "{off:e} {off_torque:e} {force} {torque}"
        );
        largest = largest.max(force.norm());
    }
    largest
}

// Fails if what panels, an elastic joint and wheels do to the links beyond the sensor is left out.
#[test]
fn a_robot_that_bends_feels_its_hand_in_its_wrist() {
    let scenario = Scenario::read("package://fuyu/config/flexible_servicer.yaml").unwrap();
    let mut params = scenario.dynamics().unwrap();
    params.wrist = WristParams {
        joint: "joint5".to_owned(),
        frame: "tool0".to_owned(),
        ..WristParams::default()
    };
    params.flexible.joints.push(ElasticJoint {
        joint: "joint2".to_owned(),
        stiffness: 2000.0,
        damping: 1.0,
        rotor_inertia: 1e-3,
        gear_ratio: 100.0,
        rotor: RotorModel::Full,
    });
    let mut world = World::new(&params).unwrap();
    world.hold_wheel_torques([(0, 0.5), (1, -1.0)]);
    (world.robot).hold_efforts(&[30.0, -20.0, 10.0, 3.0, -0.2, 0.1]);
    let largest = check_wrist(&mut world, 1e-4, |_| [Vector3::zeros(); 2]);
    assert!(largest > 0.1, "{largest}");
}
