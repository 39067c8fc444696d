//! Your own robot: from a URDF to its generalized Jacobian.
//!
//! `cargo run --release --example own_robot [URDF [FRAME]]`; without arguments, the satellite below.
//! The generalized Jacobian gives the tip's velocity in inertial space for joint rates, at zero momentum: it contains
//! the reaction of the free base, which the fixed-base Jacobian leaves out.

use std::error::Error;

use fuyu::dynamics::{State, Workspace};
use fuyu::model::Model;
use nalgebra::{DVector, Matrix6xX};

/// A base of 100 kg with two links of 10 kg and 1 m each, both turning about z.
const SATELLITE: &str = r#"<robot name="satellite">
  <link name="base"><inertial><mass value="100"/>
    <inertia ixx="20" iyy="20" izz="20" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="upper"><inertial><origin xyz="0.5 0 0"/><mass value="10"/>
    <inertia ixx="0.1" iyy="0.9" izz="0.9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.5 0 0"/><mass value="10"/>
    <inertia ixx="0.1" iyy="0.9" izz="0.9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool0"/>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/>
    <origin xyz="0.5 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="1 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="flange" type="fixed"><parent link="lower"/><child link="tool0"/>
    <origin xyz="1 0 0"/></joint>
</robot>"#;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let model = match arguments.next() {
        Some(path) => Model::from_urdf(&std::fs::read_to_string(&path)?, &path)?,
        None => Model::from_urdf(SATELLITE, "satellite.urdf")?,
    };
    let name = arguments.next().unwrap_or_else(|| "tool0".to_owned());
    let frame = model.frame(&name).ok_or(format!("no frame {name}"))?;
    println!(
        "{}: {} joints, {} kg",
        model.name(),
        model.dof(),
        model.total_mass()
    );

    // All joints at 0.5 rad (or m), the robot at rest.
    let q = DVector::from_element(model.dof(), 0.5);
    let state = State::at_rest_with(&model, &q);
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&model, &state.q);

    // Rows: linear velocity of the frame [m/s], then angular velocity [rad/s], both in base axes.
    let mut fixed = Matrix6xX::zeros(model.dof());
    workspace.fixed_base_jacobian(frame, &mut fixed);
    println!("fixed-base Jacobian of {name}:{fixed:.4}");
    let mut generalized = Matrix6xX::zeros(model.dof());
    workspace.generalized_jacobian(frame, &mut generalized);
    println!("generalized Jacobian of {name}:{generalized:.4}");
    Ok(())
}
