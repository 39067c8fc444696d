//! Detumbling: simulation compared with closed forms.

use nalgebra::Vector3;

use super::super::Report;
use crate::{
    control::detumbling::{GraspForceLimit, JointBrake, time_with_body_limits},
    dynamics::{Floating, IntegrationMethod, State, Workspace},
    model::{JointKind, ModelBuilder},
    spatial::{Pose, RigidInertia, Twist, Wrench},
};

/// Times with a limited force at the grasp point, bounds with limited couples, and a simulated brake.
pub(super) fn detumbling(mut report: Report) -> Report {
    // 300 kg, 1.8 m from the grasp point, 25 N; computed by quadrature in 30 digits.
    let limit = GraspForceLimit {
        mass: 300.0,
        radius: 1.8,
        force: 25.0,
    };
    for (rate, time) in [
        (0.05, 1.080_315_311_3),
        (0.1, 2.170_279_050_1),
        (0.15, 3.325_281_625_4),
    ] {
        let what = format!("force of 25 N at the grasp point: time from {rate} rad/s [s]");
        report.near(&what, time, limit.time(rate), 1e-9);
    }
    let fastest = limit.holdable_rate();
    report.near(
        "time from the fastest rate that the force holds, times that rate (quarter of a lemniscate)",
        1.311_028_777_1,
        limit.time(fastest) * fastest,
        1e-9,
    );
    let bounds = time_with_body_limits(1.0, &Vector3::new(0.5, 0.5, 0.5));
    report.near(
        "equal limits of three couples: shortest over longest time, 1 / sqrt 3",
        1.0 / 3f64.sqrt(),
        bounds.0 / bounds.1,
        1e-12,
    );
    couple(&mut report);
    brake(&mut report);
    report
}

fn inertia(mass: f64, moments: Vector3<f64>) -> RigidInertia {
    RigidInertia {
        mass,
        com: Vector3::zeros(),
        about_com: nalgebra::Matrix3::from_diagonal(&moments),
    }
}

/// A couple against the angular momentum reduces it linearly, regardless of the body's motion.
fn couple(report: &mut Report) {
    const TORQUE: f64 = 2.0;
    let model =
        ModelBuilder::new("b", "b", inertia(300.0, Vector3::new(120.0, 150.0, 200.0))).build();
    let mut state = State::at_rest(&model);
    let V = Twist::new(Vector3::new(0.05, -0.03, 0.06), Vector3::zeros());
    state.set_base(
        &mut Workspace::new(&model),
        &nalgebra::Isometry3::identity(),
        &V,
    );
    let mut body = Floating::new(model, state, IntegrationMethod::Dop8);
    let start = body.state().momentum_W.angular;
    let mut against = |_: f64, state: &State, input: &mut crate::dynamics::Input| {
        let L = state.momentum_W.angular;
        let torque_B = state.R_WB.inverse() * (L * (-TORQUE / L.norm()));
        input.wrenches[0] = Wrench::new(torque_B, Vector3::zeros());
    };
    for _ in 0..500 {
        body.step_with(0.01, &mut against);
    }
    let left = body.state().momentum_W.angular;
    report.near(
        "couple of 2 N m for 5 s, simulated: angular momentum lost [N m s]",
        10.0,
        start.norm() - left.norm(),
        1e-9,
    );
    report.near(
        "the same: angle between momentum before and after [rad]",
        0.0,
        start.cross(&left).norm() / (start.norm() * left.norm()),
        1e-12,
    );
}

/// A damper in a joint between two bodies, simulated, against its closed forms.
fn brake(report: &mut Report) {
    let (of_base, of_target, rate, damping) = (900.0, 60.0, 0.08, 40.0);
    let axis = Vector3::z_axis();
    let mut builder = ModelBuilder::new("r", "base", inertia(1000.0, Vector3::repeat(of_base)));
    let target = inertia(300.0, Vector3::repeat(of_target));
    builder.body(
        "target",
        0,
        JointKind::Continuous,
        axis,
        Pose::identity(),
        target,
    );
    let model = builder.build();
    let mut state = State::at_rest(&model);
    state.qd[0] = rate;
    state.momentum_W.angular.z = of_target * rate;
    let mut robot = Floating::new(model, state, IntegrationMethod::Dop8);
    let energy = robot.workspace().kinetic_energy();
    let mut hold = |_: f64, state: &State, input: &mut crate::dynamics::Input| {
        input.efforts[0] = -damping * state.qd[0];
    };
    for _ in 0..6000 {
        robot.step_with(0.01, &mut hold);
    }
    let closed = JointBrake {
        base: of_base,
        target: of_target,
    };
    let momentum = of_target * rate;
    report.near(
        "damper between base and target, simulated: rate of both afterwards [rad/s]",
        closed.common_rate(momentum),
        robot.workspace().V_WB_B().angular.z,
        1e-9,
    );
    report.near(
        "the same: angle until rest [rad]",
        closed.damper(rate, damping).1,
        robot.state().q[0],
        1e-9,
    );
    report.near(
        "the same: energy taken [J]",
        closed.dissipated(rate),
        energy - robot.workspace().kinetic_energy(),
        1e-9,
    );
}
