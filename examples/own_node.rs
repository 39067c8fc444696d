//! An own ROS 2 node on fuyu-ros: publishes the mechanical power of all joints, the sum of effort times velocity.
//!
//! `cargo run --example own_node -- --ros-args -p rate:=5.0 -r joint_states:=/chaser/joint_states`

use fuyu::msg::{sensor_msgs::JointState, std_msgs::Float64};
use fuyu::ros::{self, Node, NodeError, Qos};
use std::{process::ExitCode, time::Duration};

fn power_meter(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let scale = declare
        .param("scale", 1.0, "Factor on the published power [-]")
        .range(0.0, 1000.0)
        .live();
    let rate = declare
        .param("rate", 10.0, "Messages per second [Hz]")
        .range(0.1, 1000.0)
        .read_only()
        .value();
    declare.finish()?;

    let states = node.subscribe::<JointState>("joint_states", Qos::SENSOR_DATA)?;
    let power = node.advertise::<Float64>("~/power", Qos::RELIABLE)?;
    let status = node.diagnostics().status("input");
    let mut timer = node.timer(Duration::from_secs_f64(1.0 / rate));
    let mut last = None;
    while node.wait_until(timer.next()) {
        last = states.latest().map(|received| received.message).or(last);
        if timer.due() {
            let Some(state) = &last else {
                status.warn(format!("no message on {}", states.topic()));
                continue;
            };
            let products = state.effort.iter().zip(&state.velocity);
            let sum: f64 = products.map(|(effort, velocity)| effort * velocity).sum();
            power.publish(&Float64 {
                data: scale.get() * sum,
            });
            status.ok("publishing");
        }
    }
    Ok(())
}

fn main() -> ExitCode {
    ros::run("power_meter", power_meter)
}
