//! Capture: the servicer latches on to a tumbling satellite, and a couple on its base stops both.
//!
//! `cargo run --release --example capture`. The joints of the arm move freely. How long the couple takes follows from
//! the angular momentum alone, whatever they do.

use std::error::Error;

use fuyu::control::detumbling::BrakingCouple;
use fuyu::dynamics::capture::{Captured, Grasp, JointReaction, Latch};
use fuyu::dynamics::{Floating, Input, IntegrationMethod, State};
use fuyu::model::{Model, ModelBuilder};
use fuyu::spatial::RigidInertia;
use nalgebra::{DVector, Matrix3, UnitQuaternion, Vector3};

const METHOD: IntegrationMethod = IntegrationMethod::Dop8;
const COUPLE: f64 = 2.0; // of the thrusters [N m]

fn main() -> Result<(), Box<dyn Error>> {
    let servicer = Model::from_urdf(include_str!("../urdf/servicer.urdf"), "servicer.urdf")?;
    let q = DVector::from_row_slice(&[0.3, 0.6, -1.1, 0.4, 0.5, -0.2]);
    let robot = Floating::new(servicer.clone(), State::at_rest_with(&servicer, &q), METHOD);
    let tool = servicer.frame("tool0").ok_or("no tool0")?.clone();
    let X_WE = robot.state().X_WB(robot.workspace()) * robot.workspace().X_BF(&tool);

    // A satellite whose frame is where the tool is, its centre of mass 1.2 m behind.
    let com = Vector3::new(1.2, 0.0, 0.0);
    let about_com = Matrix3::from_diagonal(&Vector3::new(90.0, 120.0, 100.0));
    #[rustfmt::skip]
    let satellite = RigidInertia { mass: 300.0, com, about_com };
    let satellite = ModelBuilder::new("satellite", "ring", satellite).build();
    let mut state = State::at_rest(&satellite);
    state.R_WB = UnitQuaternion::from_rotation_matrix(&X_WE.rotation);
    state.p_WC = (X_WE * nalgebra::Point3::from(com)).coords;
    state.momentum_W.angular = state.R_WB * Vector3::new(3.0, -2.0, 4.0);
    let target = Floating::new(satellite.clone(), state, METHOD);

    let (ring, latch, joints) = (
        satellite.frames()[0].clone(),
        Latch::Weld,
        JointReaction::Free,
    );
    #[rustfmt::skip]
    let grasp = Grasp { robot: tool, target: ring, latch, joints };
    let (mut both, impulse) = Captured::new(&robot, &target, &grasp, METHOD)?;
    println!("latched, {:.4} J lost", impulse.energy_lost);

    let momentum = both.floating().state().momentum_W.angular.norm();
    let duration = BrakingCouple::Constant(COUPLE).duration(momentum);
    println!("{COUPLE} N m stop {momentum:.2} N m s in {duration:.2} s");
    let mut brake = |_: f64, state: &State, input: &mut Input| {
        let L = state.momentum_W.angular;
        input.wrenches[0].torque = state.R_WB.inverse() * L * (-COUPLE / L.norm());
    };
    for _ in 0..200 {
        (both.floating_mut()).step_with(0.99 * duration / 200.0, &mut brake);
    }
    let left = both.floating().state().momentum_W.angular.norm() / momentum;
    println!("left after 99 % of it: {:.2} %", 100.0 * left);
    Ok(())
}
