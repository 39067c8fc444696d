//! Motion after capture, against two independent codes (`capture_motion.json`).

use fuyu_physics::dynamics::IntegrationMethod;
use fuyu_physics::dynamics::capture::{Captured, ReleaseSpring};
use nalgebra::Vector3;

use crate::impulse::grasp;
use crate::support::{
    base_twist, cases, list, momentum, near, number, numbers, quaternion, servicer_at, target_at,
};

/// Pose and rate to 1e-8 over 20 s, momentum to 1e-10, energy as the fixture has it.
#[test]
fn joined_systems_move_as_two_other_codes_compute() {
    for case in &cases("capture_motion") {
        let name = case["name"].as_str().unwrap();
        let damping = number(&case["joint_damping"]);
        let start = &case["initial"];
        let (robot, target) = (
            servicer_at(start, damping),
            target_at(&case["target"], start),
        );
        let grasp = grasp(case, &robot);
        let (mut captured, impulse) =
            Captured::new(&robot, &target, &grasp, IntegrationMethod::Dop8).unwrap();
        // The fixture starts after the impulse.
        assert!(
            impulse.on_first[0].force.norm() < 1e-9,
            "{name}: {:?}",
            impulse.on_first
        );
        let energy = numbers(&case["energy"]);
        let (P, L) = momentum(&[captured.floating().state()]);
        let series = |what: &str, k: usize| &list(&case[what])[k];
        let mut last = f64::INFINITY;
        for (k, t) in numbers(&case["t"]).iter().enumerate() {
            let at = format!("{name} at {t} s");
            if k > 0 {
                captured.step(0.01, 100);
            }
            let system = captured.floating();
            let (state, workspace) = (system.state(), system.workspace());
            let X_WB = state.X_WB(workspace);
            let near = |what: &str, found: &[f64], expected: &[f64]| {
                near(&format!("{at}: {what}"), found, expected, 1e-8)
            };
            near(
                "base_p",
                X_WB.translation.vector.as_slice(),
                &numbers(series("base_p", k)),
            );
            assert!(
                state
                    .R_WB
                    .angle_to(&quaternion(series("base_quat_wxyz", k)))
                    < 1e-7,
                "{at}"
            );
            let turned = state.R_WB.to_rotation_matrix().matrix()
                - quaternion(series("base_quat_wxyz", k))
                    .to_rotation_matrix()
                    .matrix();
            near("base_R", turned.as_slice(), &[0.0; 9]);
            let (v, w) = base_twist(system);
            near("base_v", v.as_slice(), &numbers(series("base_v", k)));
            near("base_w", w.as_slice(), &numbers(series("base_w", k)));
            let (q, qd) = captured.robot_joints();
            near("q", q.as_slice(), &numbers(series("q", k)));
            near("qd", qd.as_slice(), &numbers(series("qd", k)));
            let (X_WT, V) = captured.target_motion();
            near(
                "target_com",
                X_WT.translation.vector.as_slice(),
                &numbers(series("target_com", k)),
            );
            let turned = X_WT.rotation.matrix()
                - quaternion(series("target_quat_wxyz", k))
                    .to_rotation_matrix()
                    .matrix();
            near("target_R", turned.as_slice(), &[0.0; 9]);
            near(
                "target_v",
                V.linear.as_slice(),
                &numbers(series("target_v", k)),
            );
            near(
                "target_w",
                V.angular.as_slice(),
                &numbers(series("target_w", k)),
            );
            let (P_now, L_now) = momentum(&[state]);
            assert!((P - P_now).norm() <= 1e-12 * P.norm(), "{at}: dP");
            assert!((L - L_now).norm() <= 1e-10 * L.norm(), "{at}: dL");
            let kinetic = workspace.kinetic_energy();
            assert!(
                (kinetic - energy[k]).abs() <= 1e-9 * energy[0],
                "{at}: {kinetic} {}",
                energy[k]
            );
            assert!(
                kinetic <= last + 1e-11 * energy[0],
                "{at}: energy rises to {kinetic}"
            );
            last = kinetic;
        }
    }
}

/// What separates has the momentum of what was joined; a spring adds its energy, and pushes in its direction.
#[test]
fn releases_keep_momentum_and_springs_add_their_energy() {
    for case in &cases("capture_motion") {
        let (robot, target) = (
            servicer_at(&case["initial"], 0.0),
            target_at(&case["target"], &case["initial"]),
        );
        let grasp = grasp(case, &robot);
        let (mut captured, _) =
            Captured::new(&robot, &target, &grasp, IntegrationMethod::Dop8).unwrap();
        captured.step(0.05, 20);
        let before = captured.floating().workspace().kinetic_energy();
        let (P, L) = momentum(&[captured.floating().state()]);
        let push = ReleaseSpring {
            direction: Vector3::x(),
            energy: 0.7,
        };
        let mut speeds = Vec::new();
        for spring in [None, Some(&push)] {
            let apart = captured.release(spring);
            let (P_after, L_after) = momentum(&[&apart.robot, &apart.target]);
            assert!((P - P_after).norm() <= 1e-13 * P.norm());
            assert!((L - L_after).norm() <= 1e-13 * L.norm());
            let (mut of_robot, mut of_target) = (robot.clone(), target.clone());
            of_robot.set_state(apart.robot);
            of_target.set_state(apart.target);
            let energy =
                of_robot.workspace().kinetic_energy() + of_target.workspace().kinetic_energy();
            let added = spring.map_or(0.0, |spring| spring.energy);
            assert!(
                (energy - before - added).abs() < 1e-11 * (before + 1.0),
                "{energy} {before}"
            );
            // Speed at which the grasp point opens, along the spring.
            let X_WG = of_robot.state().X_WB(of_robot.workspace())
                * of_robot.workspace().X_BF(&grasp.robot);
            let tip = of_robot.state().R_WB * of_robot.workspace().V_WF_B(&grasp.robot).linear;
            let of_base = base_twist(&of_target);
            let p = X_WG.translation.vector - of_target.state().p_WC;
            let opening = of_base.0 + of_base.1.cross(&p) - tip;
            speeds.push((X_WG.rotation.inverse() * opening).x);
        }
        assert!(speeds[0].abs() < 1e-12 && speeds[1] > 0.01, "{speeds:?}");
    }
}
