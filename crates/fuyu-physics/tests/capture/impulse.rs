//! The impulse of a capture, against two independent codes (`capture_impulse.json`).

use fuyu_physics::dynamics::capture::{Captured, Grasp, JointReaction, Latch};
use fuyu_physics::dynamics::{Floating, IntegrationMethod};
use serde_json::Value;

use crate::support::{
    base_twist, cases, grasp_frame, momentum, near, number, numbers, servicer_at, target_at,
};

pub fn grasp(case: &Value, robot: &Floating) -> Grasp {
    Grasp {
        robot: robot.model().frame("tool0").unwrap().clone(),
        target: grasp_frame(&case["target"]),
        latch: match case["grasp"].as_str() {
            Some("weld") => Latch::Weld,
            Some("ball") => Latch::Ball,
            other => panic!("{other:?}"),
        },
        joints: match case["joints"].as_str() {
            Some("free") => JointReaction::Free,
            Some("locked") => JointReaction::Locked,
            Some("rate_held") => JointReaction::RateHeld,
            other => panic!("{other:?}"),
        },
    }
}

/// Twists to 1e-12, impulses to 1e-10, energy loss to 1e-12 of the energy, momentum to 1e-13. A wrong sign of the
/// brakes' impulse, a Jacobian about another point, or a fixed-base inertia instead of the reduced one fail by
/// orders of magnitude.
#[test]
fn impulses_agree_with_two_other_codes() {
    let all = cases("capture_impulse");
    assert!(all.len() >= 9);
    for case in &all {
        let name = case["name"].as_str().unwrap();
        let damping = number(&case["joint_damping"]);
        let (robot, target) = (
            servicer_at(&case["before"], damping),
            target_at(&case["target"], &case["before"]),
        );
        let grasp = grasp(case, &robot);
        let (distance, angle) = grasp.separation(&robot, &target);
        assert!(
            distance < 1e-12 && angle < 1e-7,
            "{name}: {distance:e} {angle:e}"
        );
        let (captured, impulse) =
            Captured::new(&robot, &target, &grasp, IntegrationMethod::Dop8).unwrap();

        let [of_robot, of_target] = &impulse.states[..] else {
            panic!()
        };
        let after = &case["after"];
        let mut moved = [robot.clone(), target.clone()];
        for (system, state) in moved.iter_mut().zip(&impulse.states) {
            system.set_state(state.clone());
        }
        let ((v, w), (v_t, w_t)) = (base_twist(&moved[0]), base_twist(&moved[1]));
        for (what, found) in [
            ("base_v", v),
            ("base_w", w),
            ("target_v", v_t),
            ("target_w", w_t),
        ] {
            near(
                &format!("{name} {what}"),
                found.as_slice(),
                &numbers(&after[what]),
                1e-12,
            );
        }
        near(name, of_robot.qd.as_slice(), &numbers(&after["qd"]), 1e-12);
        let on_robot = &case["impulse_on_servicer"];
        let found = impulse.on_first[0];
        near(
            name,
            found.force.as_slice(),
            &numbers(&on_robot["linear"]),
            1e-10,
        );
        near(
            name,
            found.torque.as_slice(),
            &numbers(&on_robot["angular_about_grasp"]),
            1e-10,
        );
        near(
            name,
            impulse.joints[0].as_slice(),
            &numbers(&on_robot["joint_lock"]),
            1e-10,
        );

        let energy = &case["energy"];
        let (before, lost) = (number(&energy["before"]), number(&energy["lost"]));
        let kinetic = |systems: &[Floating]| {
            systems
                .iter()
                .map(|s| s.workspace().kinetic_energy())
                .sum::<f64>()
        };
        let measured = kinetic(&[robot.clone(), target.clone()]) - kinetic(&moved);
        assert!(
            (impulse.energy_lost - lost).abs() <= 1e-12 * before,
            "{name}: {} {lost}",
            impulse.energy_lost
        );
        assert!(
            (measured - lost).abs() <= 1e-12 * before,
            "{name}: {measured} {lost}"
        );
        let joined = captured.floating().workspace().kinetic_energy();
        assert!(
            (joined - number(&energy["after"])).abs() <= 1e-12 * before,
            "{name}: {joined}"
        );

        let (P, L) = momentum(&[robot.state(), target.state()]);
        for states in [vec![of_robot, of_target], vec![captured.floating().state()]] {
            let (P_after, L_after) = momentum(&states);
            assert!(
                (P - P_after).norm() <= 1e-13 * P.norm(),
                "{name}: dP {:e}",
                (P - P_after).norm()
            );
            assert!(
                (L - L_after).norm() <= 1e-13 * L.norm(),
                "{name}: dL {:e}",
                (L - L_after).norm()
            );
        }
    }
}
