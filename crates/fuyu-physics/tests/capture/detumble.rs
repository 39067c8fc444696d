//! Closed forms for detumbling (`detumble.json`): against the fixtures, and against a simulated stack.

use fuyu_physics::control::detumbling::{
    BrakingCouple, GraspForceLimit, JointBrake, damped_momentum, time_with_body_limits,
    time_with_inertial_limits, wheel_momentum, wheel_motor_torque,
};
use fuyu_physics::dynamics::capture::Captured;
use fuyu_physics::dynamics::{Input, IntegrationMethod, State};
use fuyu_physics::estimation::free_body::FreeRotation;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde_json::Value;

use crate::impulse::grasp;
use crate::support::{
    base_twist, cases, fixture, list, matrix, near, number, numbers, rotation, servicer_at,
    target_at, vector,
};

const TOLERANCE: f64 = 1e-9;

/// Inertia, free motion and angular momentum of the body of a case.
fn tumbling(case: &Value) -> (Matrix3<f64>, FreeRotation, Vector3<f64>) {
    let inertia = Matrix3::from_diagonal(&vector(&case["I"]));
    let (R, w) = (rotation(&case["R0"]), vector(&case["w0"]));
    let free = FreeRotation::new(&inertia, R, &w, 0.0).unwrap();
    (inertia, free, R * (inertia * w))
}

fn near_attitude(what: &str, found: &UnitQuaternion<f64>, expected: &Value) {
    near(
        what,
        found.to_rotation_matrix().matrix().as_slice(),
        matrix(expected).as_slice(),
        TOLERANCE,
    );
}

/// Angular velocity of a slowed body, body axes.
fn slowed(free: &FreeRotation, time: f64, factor: f64) -> (UnitQuaternion<f64>, Vector3<f64>) {
    let R = free.attitude(time);
    (R, R.inverse() * free.angular_velocity(time) * factor)
}

#[test]
fn a_braking_couple_slows_the_free_motion_down() {
    let file = fixture("detumble");
    let all = file.as_object().unwrap();
    for (name, case) in all.iter().filter(|(name, _)| name.starts_with("A_")) {
        let (_, free, L) = tumbling(case);
        near(name, L.as_slice(), &numbers(&case["L0"]), TOLERANCE);
        let couple = BrakingCouple::Constant(number(&case["tau_max"]));
        let duration = couple.duration(L.norm());
        assert!((duration - number(&case["T"])).abs() < TOLERANCE);
        for (k, t) in numbers(&case["t"]).into_iter().enumerate() {
            let at = couple.slowdown(L.norm(), t);
            let (R, w) = slowed(&free, at.time, at.factor);
            near_attitude(name, &R, &list(&case["R"])[k]);
            near(
                name,
                w.as_slice(),
                &numbers(&list(&case["w_body"])[k]),
                TOLERANCE,
            );
        }
        let end = couple.slowdown(L.norm(), 2.0 * duration);
        assert_eq!(end.factor, 0.0);
        near_attitude(name, &free.attitude(end.time), &case["attitude_at_rest"]);

        let slow = &case["kL"];
        let couple = BrakingCouple::Proportional(number(&slow["k"]));
        for (k, t) in numbers(&slow["t"]).into_iter().enumerate() {
            let at = couple.slowdown(L.norm(), t);
            let (R, w) = slowed(&free, at.time, at.factor);
            near_attitude(name, &R, &list(&slow["R"])[k]);
            near(
                name,
                w.as_slice(),
                &numbers(&list(&slow["w_body"])[k]),
                TOLERANCE,
            );
        }
    }
}

#[test]
fn bounds_hold_for_damping_and_for_limits_of_each_axis() {
    let file = fixture("detumble");
    let case = &file["C"];
    let (_, _, L) = tumbling(case);
    for (t, norm) in numbers(&case["t"])
        .into_iter()
        .zip(numbers(&case["L_norm"]))
    {
        let (low, high) = damped_momentum(L.norm(), number(&case["D"]), &vector(&case["I"]), t);
        assert!(
            low <= norm * (1.0 + 1e-12) && norm <= high * (1.0 + 1e-12),
            "{t}: {low} {norm} {high}"
        );
    }
    let case = &file["D"];
    let (_, _, L) = tumbling(case);
    let limits = vector(&case["tau"]);
    let (low, high) = time_with_body_limits(L.norm(), &limits);
    near(
        "D",
        &[low, high],
        &[number(&case["lower"]), number(&case["upper"])],
        TOLERANCE,
    );
    let time = number(&case["T"]);
    assert!(low <= time && time <= high);
    // Each component at its own rate: the slowest one decides.
    assert_eq!(
        time_with_inertial_limits(&Vector3::new(6.0, -8.0, 5.0), &limits),
        2.0
    );
}

#[test]
fn wheels_take_up_the_momentum_of_the_body() {
    let case = &fixture("detumble")["F"];
    let (inertia, free, H) = tumbling(case);
    let torque = number(&case["tau"]);
    let couple = BrakingCouple::Constant(torque);
    assert!((couple.duration(H.norm()) - number(&case["T"])).abs() < TOLERANCE);
    let total = H + rotation(&case["R0"]) * vector(&case["h_w0"]);
    near("F", total.as_slice(), &numbers(&case["L0"]), TOLERANCE);
    for (k, t) in numbers(&case["t"]).into_iter().enumerate() {
        let at = couple.slowdown(H.norm(), t);
        let (R, w) = slowed(&free, at.time, at.factor);
        near_attitude("F", &R, &list(&case["R"])[k]);
        near(
            "F",
            w.as_slice(),
            &numbers(&list(&case["w_body"])[k]),
            TOLERANCE,
        );
        let wheels = wheel_momentum(&total, &R, &(inertia * w));
        near(
            "F",
            wheels.as_slice(),
            &numbers(&list(&case["h_w"])[k]),
            TOLERANCE,
        );
        // The motors' torque is the rate of the wheels' momentum, body axes.
        let rate = (inertia * w).normalize() * torque - w.cross(&wheels);
        assert!(rate.norm() <= wheel_motor_torque(torque, &w, &wheels) + 1e-12);
    }
}

#[test]
fn grasp_force_and_joint_brake_have_their_closed_forms() {
    let file = fixture("detumble");
    for case in list(&file["G"]) {
        let of = |name: &str| number(&case[name]);
        let limit = GraspForceLimit {
            mass: of("m_t"),
            radius: of("r"),
            force: of("F"),
        };
        let rate = of("w0");
        // At the fastest rate the time has a root there: the last digit of the rate is half of those of the time.
        let is_fastest = (rate / limit.holdable_rate() - 1.0).abs() < 1e-9;
        let tolerance = if is_fastest { 1e-6 } else { TOLERANCE };
        assert!(
            (limit.time(rate) - of("T")).abs() < tolerance,
            "{case}: {}",
            limit.time(rate)
        );
        assert!(
            (limit.angle(rate) - of("angle")).abs() < tolerance,
            "{case}: {}",
            limit.angle(rate)
        );
        assert!((limit.holdable_rate().powi(2) - of("A")).abs() < 1e-15);
    }
    let case = &file["H"];
    let of = |name: &str| number(&case[name]);
    let brake = JointBrake {
        base: of("I_b"),
        target: of("I_t"),
    };
    let rate = of("rel_rate0");
    let (constant, damper) = (
        brake.constant_torque(rate, of("tau")),
        brake.damper(rate, of("d")),
    );
    for (found, name) in [
        (brake.reduced_inertia(), "I_r"),
        (constant.0, "T_const"),
        (constant.1, "stroke_const"),
        (damper.0, "time_constant"),
        (damper.1, "stroke_viscous"),
        (brake.dissipated(rate), "dissipated"),
        (brake.common_rate(of("I_t") * rate), "common_rate"),
    ] {
        assert!((found - of(name)).abs() < TOLERANCE, "{name}: {found}");
    }
}

/// A robot that holds its target, with damped joints, under a couple on its base against the angular momentum of
/// both: that momentum shortens as the closed form says, whatever the joints do, and the motion is that of two
/// other codes.
#[test]
fn a_stack_is_stopped_as_one_body() {
    let starts = cases("capture_motion");
    for case in list(&fixture("detumble")["E"]) {
        let name = case["case"].as_str().unwrap();
        let damping = number(&case["joint_damping"]);
        let start = starts.iter().find(|start| start["name"] == *name).unwrap();
        let robot = servicer_at(&start["initial"], damping);
        let target = target_at(&start["target"], &start["initial"]);
        let (mut captured, _) = Captured::new(
            &robot,
            &target,
            &grasp(start, &robot),
            IntegrationMethod::Dop8,
        )
        .unwrap();
        let L = captured.floating().state().momentum_W.angular;
        near(name, L.as_slice(), &numbers(&case["Lc0"]), 1e-8);
        let couple = BrakingCouple::Constant(number(&case["tau_max"]));
        assert!((couple.duration(L.norm()) - number(&case["T"])).abs() < 1e-8);
        let torque = number(&case["tau_max"]);
        let mut brake = |_: f64, state: &State, input: &mut Input| {
            let L = &state.momentum_W.angular;
            input.wrenches[0].torque = state.R_WB.inverse() * L * (-torque / L.norm());
        };
        let mut time = 0.0;
        for sample in list(&case["samples"]) {
            let t = number(&sample["t"]);
            let steps = ((t - time) / 0.02).ceil();
            for _ in 0..steps as usize {
                captured
                    .floating_mut()
                    .step_with((t - time) / steps, &mut brake);
            }
            time = t;
            let system = captured.floating();
            let state = system.state();
            let expected = L * couple.slowdown(L.norm(), t).factor;
            let error = (state.momentum_W.angular - expected).norm();
            assert!(
                error < TOLERANCE * L.norm().max(1.0),
                "{name} at {t}: {error:e}"
            );
            let (v, w) = base_twist(system);
            near(
                &format!("{name} at {t}"),
                v.as_slice(),
                &numbers(&sample["base_v"]),
                1e-8,
            );
            near(
                &format!("{name} at {t}"),
                w.as_slice(),
                &numbers(&sample["base_w"]),
                1e-8,
            );
            let (q, qd) = captured.robot_joints();
            near(
                &format!("{name} at {t}"),
                q.as_slice(),
                &numbers(&sample["q"]),
                1e-8,
            );
            near(
                &format!("{name} at {t}"),
                qd.as_slice(),
                &numbers(&sample["qd"]),
                1e-8,
            );
            let momentum = &state.momentum_W.linear;
            near(name, momentum.as_slice(), &numbers(&sample["P"]), 1e-9);
        }
    }
}
