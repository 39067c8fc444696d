//! Bags to test with.

use fuyu::bag::{Recording, Topic, Writer, WriterOptions};
use fuyu::msg::builtin_interfaces::Time;
use fuyu::msg::geometry_msgs::{PoseStamped, TransformStamped};
use fuyu::msg::sensor_msgs::JointState;
use fuyu::msg::std_msgs::{Header, String as Text};
use fuyu::msg::tf2_msgs::TFMessage;
use fuyu::msg::{cdr, fuyu_msgs, rcl_interfaces};
use fuyu::ros::Qos;
use std::path::Path;

/// Time of the `i`-th joint state \[ns\].
pub fn time(i: u64) -> u64 {
    1_700_000_000_000_000_000 + i * 10_000_000
}

pub fn header(i: u64) -> Header {
    Header {
        stamp: Time::from_nanos(time(i) as i64),
        frame_id: "base_link".into(),
    }
}

pub fn joint_state(i: u64) -> JointState {
    let phase = i as f64 * 0.01;
    JointState {
        header: header(i),
        name: ["joint1", "joint2"].map(String::from).to_vec(),
        position: vec![phase.sin(), phase.cos()],
        velocity: vec![phase.cos(), -phase.sin()],
        effort: vec![0.1 * phase, 0.0],
    }
}

/// Writes `n` joint states, and all other kinds of messages: latched text, nested messages,
/// arrays of every kind, raw bytes of a known and of an unknown type.
pub fn write(folder: &Path, n: u64, options: WriterOptions) -> Recording {
    let mut w = Writer::create(folder, options).unwrap();
    let joints = w
        .add_topic(Topic::of::<JointState>("/joint_states", Qos::RELIABLE))
        .unwrap();
    let description = w
        .add_topic(Topic::of::<Text>("/robot_description", Qos::LATCHED))
        .unwrap();
    let tf = w
        .add_topic(Topic::of::<TFMessage>("/tf", Qos::RELIABLE))
        .unwrap();
    let state = w
        .add_topic(Topic::of::<fuyu_msgs::ControllerState>(
            "/controller/state",
            Qos::RELIABLE,
        ))
        .unwrap();
    let events = w
        .add_topic(Topic::of::<rcl_interfaces::ParameterEvent>(
            "/parameter_events",
            Qos::RELIABLE,
        ))
        .unwrap();
    let raw = w
        .add_topic(Topic::named(
            "/raw_pose",
            "geometry_msgs/msg/PoseStamped",
            Qos::SENSOR_DATA,
        ))
        .unwrap();
    let unknown = w
        .add_topic(Topic::named(
            "/unknown",
            "acme_msgs/msg/Gripper",
            Qos::RELIABLE,
        ))
        .unwrap();
    w.write_message(
        description,
        time(0),
        &Text {
            data: "<robot name=\"浮遊\"/>".into(),
        },
    )
    .unwrap();
    let mut event = rcl_interfaces::ParameterEvent {
        node: "/controller".into(),
        ..Default::default()
    };
    event.new_parameters.push(rcl_interfaces::Parameter {
        name: "k_p".into(),
        value: rcl_interfaces::ParameterValue {
            r#type: rcl_interfaces::ParameterType::PARAMETER_DOUBLE,
            double_value: 2.5,
            ..Default::default()
        },
    });
    w.write_message(events, time(0), &event).unwrap();
    for i in 0..n {
        w.write_message(joints, time(i), &joint_state(i)).unwrap();
        if i % 10 == 0 {
            let transforms = ["tool0", "camera"]
                .map(|child| TransformStamped {
                    header: header(i),
                    child_frame_id: child.into(),
                    ..Default::default()
                })
                .to_vec();
            w.write_message(tf, time(i), &TFMessage { transforms })
                .unwrap();
            let message = fuyu_msgs::ControllerState {
                header: header(i),
                law: "transpose".into(),
                joint_names: vec!["joint1".into(), "joint2".into()],
                k_v: vec![1.0, 2.0],
                position_saturated: i % 20 == 0,
                ..Default::default()
            };
            w.write_message(state, time(i), &message).unwrap();
            let pose = PoseStamped {
                header: header(i),
                ..Default::default()
            };
            w.write_cdr(raw, time(i), time(i) - 5, &cdr::encode(&pose))
                .unwrap();
            w.write_cdr(unknown, time(i), time(i), &[0, 1, 0, 0, i as u8])
                .unwrap();
        }
    }
    w.finish().unwrap()
}
