//! Plans, followed by an integrator that shares nothing with the planner.

use fuyu_physics::control::capture::{
    Clearance, ClearanceConfig, FrameMotion, JointLimitsShare, Plan, PlanError, Rendezvous,
    RendezvousPlanner, Start,
};
use fuyu_physics::control::commander::JointPoint;
use fuyu_physics::dynamics::{State, Workspace};
use fuyu_physics::spatial::{Pose, Twist};
use nalgebra::{DVector, UnitQuaternion, Vector3};

use crate::world::{posture, servicer};

const LIMITS: JointLimitsShare = JointLimitsShare {
    velocity: 0.8,
    default_velocity: 0.5,
    acceleration: 0.5,
    effort: 0.7,
};

fn start(momentum: Vector3<f64>) -> Start {
    let (model, ..) = servicer();
    let mut state = State::at_rest_with(&model, &posture());
    state.p_WC = Vector3::zeros();
    state.momentum_W.angular = momentum;
    let positions = posture();
    let joints = positions.iter().map(|q| JointPoint {
        position: *q,
        rate: 0.01,
        acceleration: -0.002,
    });
    Start {
        joints: joints.collect(),
        state,
    }
}

/// Where the tip is in I at the start, moved by `ahead` (tip's axes), with a twist and an acceleration.
fn goal(ahead: Vector3<f64>, turn: Vector3<f64>) -> FrameMotion {
    let (model, tip, _) = servicer();
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&posture());
    let X_IB = Pose::from_parts((-workspace.p_BC()).into(), nalgebra::Rotation3::identity());
    let X = X_IB * workspace.X_BF(&tip);
    let turn = UnitQuaternion::from_scaled_axis(turn).to_rotation_matrix();
    FrameMotion {
        X: X * Pose::from_parts(ahead.into(), turn),
        V: Twist::new(
            Vector3::new(0.03, -0.02, 0.04),
            Vector3::new(0.02, 0.03, -0.01),
        ),
        A: Twist::new(
            Vector3::new(1e-3, 2e-3, -1e-3),
            Vector3::new(-2e-3, 1e-3, 1e-3),
        ),
    }
}

fn planner() -> RendezvousPlanner {
    let (model, tip, _) = servicer();
    let clearance = Clearance::new(&model, &tip, ClearanceConfig::default());
    RendezvousPlanner::new(&model, &tip, clearance, LIMITS)
}

/// Pose and twist (axes of I) of the tip at the arrival, by small midpoint steps on the base's twist from momentum; and the
/// turn of the base.
fn followed(plan: &Plan, start: &Start) -> (Pose, Twist, f64) {
    let (model, tip, _) = servicer();
    let mut workspace = Workspace::new(&model);
    let n = model.dof();
    let mut state = start.state.clone();
    let steps = 20_000;
    let dt = (plan.arrival - plan.start) / f64::from(steps);
    let at = |time: f64| {
        let points: Vec<_> = (0..n).map(|j| plan.at(j, time)).collect();
        (
            DVector::from_iterator(n, points.iter().map(|p| p.position)),
            DVector::from_iterator(n, points.iter().map(|p| p.rate)),
        )
    };
    for k in 0..steps {
        let (q, qd) = at(plan.start + (f64::from(k) + 0.5) * dt);
        workspace.set_positions(&q);
        let rate = |R: &UnitQuaternion<f64>, workspace: &Workspace| {
            workspace
                .base_twist(&state.momentum_W.expressed_in(R), &qd)
                .angular
        };
        let first = rate(&state.R_WB, &workspace);
        let middle = state.R_WB * UnitQuaternion::from_scaled_axis(first * (0.5 * dt));
        let w = rate(&middle, &workspace);
        state.R_WB *= UnitQuaternion::from_scaled_axis(w * dt);
    }
    (state.q, state.qd) = at(plan.arrival - 1e-12);
    workspace.set_positions(&state.q);
    workspace.set_motion(&state);
    let V = workspace.V_WF_B(&tip);
    let R = state.R_WB;
    let V = Twist::new(R * V.angular, R * V.linear);
    let turn = start.state.R_WB.angle_to(&R);
    (state.X_WB(&workspace) * workspace.X_BF(&tip), V, turn)
}

// Zero relative pose and twist at the arrival, with momentum, from moving joints. Fails if the base's reaction or its
// drift by momentum were left out.
#[test]
fn the_tip_meets_the_goal_at_zero_relative_twist() {
    let mut planner = planner();
    for (momentum, ahead) in [
        (Vector3::zeros(), Vector3::new(0.3, 0.1, -0.1)),
        (Vector3::new(6.0, -4.0, 8.0), Vector3::new(0.1, 0.3, 0.2)),
    ] {
        let (start, goal) = (start(momentum), goal(ahead, Vector3::new(0.2, -0.1, 0.3)));
        let task = Rendezvous {
            start: &start,
            arrival: 20.0,
            goal: &goal,
            center: None,
        };
        let plan = planner.plan(&task).unwrap();
        let (X, V, turn) = followed(&plan, &start);
        let off = (X.translation.vector - goal.X.translation.vector).norm();
        // The planner divides the way into pieces of 0.4 s.
        assert!(off < 1e-5, "{off}");
        assert!(X.rotation.angle_to(&goal.X.rotation) < 1e-5);
        let relative = (V.linear - goal.V.linear).norm() + (V.angular - goal.V.angular).norm();
        assert!(relative < 1e-5, "{relative}");
        assert!(
            (turn - plan.base_turn).abs() < 1e-5,
            "{turn} {}",
            plan.base_turn
        );
        // The start is that of the joints.
        for j in 0..6 {
            let first = plan.at(j, plan.start);
            let wanted = start.joints[j];
            assert!((first.position - wanted.position).abs() < 1e-12);
            assert!((first.rate - wanted.rate).abs() < 1e-12);
            assert!((first.acceleration - wanted.acceleration).abs() < 1e-12);
        }
        // On the way a plan from there meets the same goal.
        let joints = (0..6).map(|j| plan.at(j, 8.0)).collect();
        let mut state = start.state.clone();
        state.time = 8.0;
        let later = Start { state, joints };
        let task = Rendezvous {
            start: &later,
            ..task
        };
        let again = planner.replan(&task, &plan).unwrap();
        let (X, ..) = followed(&again, &later);
        assert!((X.translation.vector - goal.X.translation.vector).norm() < 1e-5);
    }
}

#[test]
fn goals_out_of_reach_and_limits_are_refused_with_a_reason() {
    let mut planner = planner();
    let start = start(Vector3::zeros());
    let far = goal(Vector3::new(9.0, 0.0, 0.0), Vector3::zeros());
    let task = |goal, arrival| Rendezvous {
        start: &start,
        arrival,
        goal,
        center: None,
    };
    let error = planner.plan(&task(&far, 20.0)).unwrap_err();
    assert!(matches!(error, PlanError::NoPosture(_)), "{error}");
    let near = goal(Vector3::new(0.3, 0.1, -0.1), Vector3::zeros());
    let error = planner.plan(&task(&near, 1.0)).unwrap_err();
    assert!(matches!(error, PlanError::Joint { .. }), "{error}");
    // The target's sphere is where the arm is.
    let here = near.X.translation.vector;
    let blocked = Rendezvous {
        center: Some((here, here)),
        ..task(&near, 20.0)
    };
    let error = planner.plan(&blocked).unwrap_err();
    assert!(matches!(error, PlanError::Clearance { .. }), "{error}");
    assert!(planner.plan(&task(&near, 20.0)).is_ok());
}

// Fails if the objective did not decide on the posture: of several goals, that of the least impact has a lower effective mass
// and a faster base for at least one, and never the other way round.
#[test]
fn the_objective_decides_on_the_posture() {
    use fuyu_physics::control::capture::Objective;
    let start = start(Vector3::zeros());
    let mut differ = 0;
    for k in 0..8 {
        let turn = Vector3::new(0.3, -0.2, 0.1) * f64::from(k);
        let goal = goal(Vector3::new(0.3, 0.2, -0.1), turn);
        let task = Rendezvous {
            start: &start,
            arrival: 40.0,
            goal: &goal,
            center: None,
        };
        let of = |objective| {
            let mut planner = planner().with_objective(objective, &Vector3::x());
            planner.plan(&task)
        };
        let (Ok(calm), Ok(light)) = (of(Objective::BaseReaction), of(Objective::Impact)) else {
            continue;
        };
        assert!(light.effective_mass <= calm.effective_mass + 1e-9);
        assert!(calm.base_rate <= light.base_rate + 1e-12);
        if light.effective_mass < 0.95 * calm.effective_mass {
            differ += 1;
        }
        println!(
            "{k}: {:.1} kg {:.4} rad/s, {:.1} kg {:.4} rad/s",
            calm.effective_mass, calm.base_rate, light.effective_mass, light.base_rate
        );
    }
    assert!(differ >= 1, "{differ}");
}
