//! Your own control law: the tip of a planar arm on a free base moves to a goal that rests in space.
//!
//! `cargo run --release --example own_law`. The controller checks the law's input and output and damps the joints.

use fuyu::{control::*, dynamics::*, model::Model};
use nalgebra::{DVector, Matrix6xX, Translation3};

#[derive(Debug)]
struct BoundedForce;

impl Law for BoundedForce {
    fn efforts(
        &mut self,
        input: &LawInput<'_>,
        manipulator: &mut Manipulator,
        efforts: &mut DVector<f64>,
    ) -> Result<LawStatus, LawError> {
        let Some(tip) = input.tip() else {
            return Ok(LawStatus::Inactive); // No camera measurement.
        };
        // From the tip E to its goal D, base axes: 100 N/m, but no more than 20 N.
        let deviation = tip.X_BD.translation.vector - tip.X_BE.translation.vector;
        let force = (100.0 * deviation).cap_magnitude(20.0);
        let mut J = Matrix6xX::zeros(efforts.len());
        (manipulator.workspace).generalized_jacobian(&manipulator.tip, &mut J);
        efforts.copy_from(&J.rows(0, 3).tr_mul(&force));
        Ok(LawStatus::TipFeedback)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let urdf = include_str!("../urdf/planar_two_link.urdf");
    let model = Model::from_urdf(urdf, "planar_two_link.urdf")?;
    let tip = model.frame("tool0").ok_or("no tool0")?.clone();
    let gains = Gains {
        k_p: 1.0, // Not used by this law.
        k_o: 0.0,
        k_v: vec![50.0, 50.0],
        saturation: Saturation::NONE,
    };
    let arm = Manipulator::new(model.clone(), tip.clone());
    let config = ControllerConfig::new(LawConfig::Custom, gains);
    let mut controller = Controller::with_law(arm, Box::new(BoundedForce), config)?;
    let start = State::at_rest_with(&model, &DVector::from_vec(vec![0.3, 1.0]));
    let mut robot = Floating::new(model, start, IntegrationMethod::Rk4);
    let X_WE = |r: &Floating| r.state().X_WB(r.workspace()) * r.workspace().X_BF(&tip);
    let X_WD = Translation3::new(-0.3, 0.2, 0.0) * X_WE(&robot);
    for _ in 0..30_000 {
        let (state, workspace) = (robot.state(), robot.workspace());
        let X_BD = state.X_WB(workspace).inverse() * X_WD;
        let seen = TipMeasurement::new(state.time, workspace.X_BF(&tip), X_BD);
        let measurement = Measurement::new(state.time, &state.q, &state.qd);
        controller.update(&measurement.with_tip(Some(&seen)))?;
        robot.hold_efforts(controller.efforts().as_slice());
        robot.step(0.01, 1);
    }
    let distance = (X_WE(&robot).translation.vector - X_WD.translation.vector).norm();
    println!("after five minutes the tip is {distance:.4} m from its goal");
    Ok(())
}
