//! A node that echoes messages, decoded and encoded again, and serves the other rows of the interop matrix.

use fuyu::{
    msg::{
        Interface, cdr, diagnostic_msgs, fuyu_msgs, geometry_msgs, nav_msgs, rcl_interfaces,
        rosgraph_msgs, sensor_msgs,
        simulation_interfaces::{
            self,
            simulate_steps::{Feedback, Outcome, SimulateSteps},
        },
        std_msgs::{self, Int32, Int64, String as Text},
        std_srvs::{Trigger, TriggerResponse},
        tf2_msgs,
    },
    ros::{ActionServer, Node, NodeError, Qos},
};
use std::{
    sync::atomic::{AtomicI64, Ordering::Relaxed},
    time::{Duration, Instant},
};

/// Every message type that is echoed: `in/PACKAGE/NAME` to `out/PACKAGE/NAME`.
macro_rules! for_every_type {
    ($do:ident) => {
        $do!(
            diagnostic_msgs::DiagnosticArray,
            fuyu_msgs::AppendageOutlines,
            fuyu_msgs::AppendageStates,
            fuyu_msgs::AttitudeState,
            fuyu_msgs::ControllerState,
            fuyu_msgs::ExternalImpulse,
            fuyu_msgs::FeatureTracks,
            fuyu_msgs::MissionState,
            fuyu_msgs::Momentum,
            fuyu_msgs::MotionEstimate,
            fuyu_msgs::ThrusterCommands,
            geometry_msgs::Accel,
            geometry_msgs::Inertia,
            geometry_msgs::PointStamped,
            geometry_msgs::PoseStamped,
            geometry_msgs::QuaternionStamped,
            geometry_msgs::TwistStamped,
            geometry_msgs::Vector3Stamped,
            geometry_msgs::WrenchStamped,
            nav_msgs::Odometry,
            nav_msgs::Path,
            rcl_interfaces::Log,
            rcl_interfaces::ParameterEvent,
            rosgraph_msgs::Clock,
            sensor_msgs::CameraInfo,
            sensor_msgs::CompressedImage,
            sensor_msgs::Image,
            sensor_msgs::Imu,
            sensor_msgs::JointState,
            sensor_msgs::Joy,
            sensor_msgs::PointCloud2,
            std_msgs::Bool,
            std_msgs::ColorRGBA,
            std_msgs::Empty,
            std_msgs::Float64,
            std_msgs::Float64MultiArray,
            std_msgs::Int32,
            std_msgs::Int64,
            std_msgs::String,
            std_msgs::UInt32,
            tf2_msgs::TFMessage
        )
    };
}

/// ROS names of the types that are echoed.
pub fn types() -> Vec<String> {
    macro_rules! names {
        ($($package:ident::$name:ident),*) => {
            vec![$(<$package::$name as Interface>::DEFINITION.type_name()),*]
        };
    }
    for_every_type!(names)
}

/// Echoes `in/PACKAGE/NAME` on `out/PACKAGE/NAME` through the struct, so that both decoding
/// and encoding are tested.
fn echo<M: Interface>(node: &Node) -> Result<fuyu::ros::RawSubscription, NodeError> {
    let topic = format!("{}/{}", M::DEFINITION.package, M::DEFINITION.name);
    let out = node.advertise::<M>(&format!("out/{topic}"), Qos::RELIABLE)?;
    let type_name = M::DEFINITION.type_name();
    node.subscribe_raw(
        &format!("in/{topic}"),
        &type_name,
        Qos::RELIABLE,
        move |sample| match cdr::decode::<M>(&sample.cdr) {
            Ok(message) => out.publish(&message),
            Err(e) => tracing::error!("{}: {e}", M::DEFINITION.type_name()),
        },
    )
}

pub fn program(node: &Node) -> Result<(), NodeError> {
    let mut declare = node.declare();
    let _gain = declare
        .param("gain", 0.5, "A gain [1/s]")
        .range(0.0, 10.0)
        .live();
    declare.finish()?;
    macro_rules! echoes {
        ($($package:ident::$name:ident),*) => {
            [$(echo::<$package::$name>(node)?),*]
        };
    }
    let _echoes = for_every_type!(echoes);
    let _ping = node.serve::<Trigger>("ping", |_| TriggerResponse {
        success: true,
        message: "pong".into(),
    })?;
    // Offered QoS below a peer's request, and requested QoS above a peer's offer.
    let fast = node.advertise::<Text>("best_effort", Qos::SENSOR_DATA)?;
    let _asks = node.subscribe::<Text>("reliable_please", Qos::RELIABLE)?;
    let retained = node.advertise::<Text>("retained", Qos::LATCHED)?;
    retained.publish(&Text {
        data: "from before".into(),
    });
    // A thousand a second out of here: as many as asked for, numbered, and any other number that is heard.
    let stream = node.advertise::<sensor_msgs::JointState>("stream", Qos::RELIABLE.depth(4000))?;
    let asked = node.subscribe::<Int32>("start_stream", Qos::RELIABLE)?;
    // And into here: the numbers must come without a gap.
    static NEXT: AtomicI64 = AtomicI64::new(0);
    let counted = node.advertise::<Int64>("counted", Qos::RELIABLE)?;
    let _counts = node.subscribe_raw(
        "upstream",
        "sensor_msgs/msg/JointState",
        Qos::RELIABLE.depth(4000),
        move |sample| {
            let state = cdr::decode::<sensor_msgs::JointState>(&sample.cdr);
            if state.is_ok_and(|state| numbered(&state) == NEXT.load(Relaxed)) {
                NEXT.fetch_add(1, Relaxed);
            }
            let heard = NEXT.load(Relaxed);
            if heard % 100 == 0 {
                counted.publish(&Int64 { data: heard });
            }
        },
    )?;
    // A goal of many steps takes until it is cancelled.
    let actions = ActionServer::<SimulateSteps>::new(node, "steps")?;
    let (mut goal, mut done) = (None, 0);
    let late = node.subscribe::<Int32>("come_late", Qos::RELIABLE)?;
    let mut latecomer = None;
    let heard = node.advertise::<Text>("heard", Qos::RELIABLE)?;
    tracing::info!("echoes {} types", types().len());

    let mut warned = false;
    let mut left = 0..0;
    let (mut due, mut tick) = (Instant::now(), 0);
    while node.wait_for(Duration::from_millis(if left.is_empty() { 50 } else { 1 })) {
        tick += 1;
        fast.publish(&Text {
            data: tick.to_string(),
        });
        if let Some(count) = asked.take() {
            left = 0..i64::from(count.message.data);
            due = Instant::now();
        }
        while due <= Instant::now()
            && let Some(number) = left.next()
        {
            stream.publish(&joint_state(number));
            due += Duration::from_millis(1);
        }
        if goal.is_none() {
            (goal, done) = (actions.take(), 0);
        }
        if let Some(running) = goal.take() {
            let total = running.goal.steps;
            done += 1;
            running.feedback(Feedback {
                completed_steps: done,
                remaining_steps: total - done,
            });
            let outcome = Outcome {
                result: simulation_interfaces::Result {
                    result: simulation_interfaces::Result::OK,
                    error_message: format!("{done} steps"),
                },
            };
            if running.is_canceling() {
                running.canceled(outcome);
            } else if done == total {
                running.succeed(outcome);
            } else {
                goal = Some(running);
            }
        }
        if !warned && tick % 20 == 0 {
            let publishers = node.discovered_publishers().into_iter();
            let mut hashes = publishers.filter(|p| p.topic == "/upstream");
            if let Some((publisher, hash)) = hashes.find_map(|p| Some((p.type_name, p.type_hash?)))
            {
                tracing::info!("/upstream comes with {publisher} {hash}");
                warned = true;
            }
        }
        if late.take().is_some() {
            latecomer = Some(node.subscribe::<Text>("peer_retained", Qos::LATCHED)?);
        }
        if let Some(text) = latecomer.as_ref().and_then(|topic| topic.take()) {
            heard.publish(&text.message);
        }
    }
    Ok(())
}

/// A joint state of six joints with a number in its stamp.
pub fn joint_state(number: i64) -> sensor_msgs::JointState {
    let mut state = sensor_msgs::JointState {
        name: (1..=6).map(|i| format!("joint{i}")).collect(),
        position: vec![0.1; 6],
        velocity: vec![0.2; 6],
        effort: vec![0.3; 6],
        ..Default::default()
    };
    state.header.stamp.sec = i32::try_from(number / 1000).unwrap_or(i32::MAX);
    state.header.stamp.nanosec = (number % 1000) as u32;
    state
}

/// The number in the stamp of a joint state.
pub fn numbered(state: &sensor_msgs::JointState) -> i64 {
    i64::from(state.header.stamp.sec) * 1000 + i64::from(state.header.stamp.nanosec)
}
