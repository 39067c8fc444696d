//! A real run in a bag: the servicer positions its tip, at 100 Hz as the nodes do.

use fuyu::bag::{Recording, Topic, TopicId, Writer, WriterOptions};
use fuyu::control::{
    Controller, ControllerConfig, Gains, LawKind, Measurement, PoseError, Saturation,
    TipMeasurement,
};
use fuyu::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu::model::Model;
use fuyu::msg::builtin_interfaces::Time;
use fuyu::msg::fuyu_msgs::{ControllerState, Momentum};
use fuyu::msg::geometry_msgs::{
    Point, Pose, PoseStamped, Quaternion, Transform, TransformStamped, Vector3,
};
use fuyu::msg::nav_msgs::Odometry;
use fuyu::msg::sensor_msgs::JointState;
use fuyu::msg::std_msgs::{Header, String as Text};
use fuyu::msg::tf2_msgs::TFMessage;
use fuyu::ros::Qos;
use nalgebra as na;
use std::path::Path;

/// Faults to inject, so that a check fails.
#[derive(Clone, Copy, Default)]
pub struct Spoil {
    /// Momentum added without a force, from the middle of the run \[N s\].
    pub push: f64,
    /// Factor on the recorded efforts.
    pub effort: f64,
    /// Samples left out from the middle.
    pub gap: usize,
    /// One stamp a second back.
    pub backwards: bool,
    /// One velocity that is no number.
    pub nan: bool,
}

pub struct Setup<'a> {
    pub namespace: &'a str,
    pub seconds: f64,
    /// Viscous damping of every joint \[N m s/rad\].
    pub damping: f64,
    pub spoil: Spoil,
}

impl Default for Setup<'_> {
    fn default() -> Self {
        Self {
            namespace: "",
            seconds: 60.0,
            damping: 0.0,
            spoil: Spoil::default(),
        }
    }
}

fn degrees(q: [f64; 6]) -> na::DVector<f64> {
    na::DVector::from_iterator(6, q.into_iter().map(f64::to_radians))
}

fn vector(v: &na::Vector3<f64>) -> Vector3 {
    let (x, y, z) = (v.x, v.y, v.z);
    Vector3 { x, y, z }
}

fn quaternion(r: &na::Rotation3<f64>) -> Quaternion {
    let q = na::UnitQuaternion::from_rotation_matrix(r);
    let (x, y, z, w) = (q.i, q.j, q.k, q.w);
    Quaternion { x, y, z, w }
}

fn pose(p: &na::IsometryMatrix3<f64>) -> Pose {
    let t = p.translation.vector;
    Pose {
        position: Point {
            x: t.x,
            y: t.y,
            z: t.z,
        },
        orientation: quaternion(&p.rotation),
    }
}

struct Topics {
    joints: TopicId,
    momentum: TopicId,
    odom: TopicId,
    controller: TopicId,
    tip: TopicId,
    seen_goal: TopicId,
    tf: TopicId,
}

pub fn write(folder: &Path, setup: &Setup) -> Recording {
    let mut urdf = include_str!("../../urdf/servicer.urdf").to_owned();
    if setup.damping > 0.0 {
        let dynamics = format!("<dynamics damping=\"{}\"/></joint>", setup.damping);
        urdf = urdf.replace("</joint>", &dynamics);
    }
    let mut w = Writer::create(folder, WriterOptions::default()).unwrap();
    let name = |topic: &str| format!("{}/{topic}", setup.namespace);
    let mut add = |topic| w.add_topic(topic).unwrap();
    let reliable = Qos::RELIABLE;
    let topics = Topics {
        joints: add(Topic::of::<JointState>(name("joint_states"), reliable)),
        momentum: add(Topic::of::<Momentum>(
            name("ground_truth/momentum"),
            reliable,
        )),
        odom: add(Topic::of::<Odometry>(name("ground_truth/odom"), reliable)),
        controller: add(Topic::of::<ControllerState>(
            name("controller/state"),
            reliable,
        )),
        tip: add(Topic::of::<PoseStamped>(name("camera/tip_pose"), reliable)),
        seen_goal: add(Topic::of::<PoseStamped>(name("camera/goal_pose"), reliable)),
        tf: add(Topic::of::<TFMessage>(name("tf"), reliable)),
    };
    let description = add(Topic::of::<Text>(name("robot_description"), Qos::LATCHED));
    let goal = add(Topic::of::<PoseStamped>(name("goal_pose"), reliable));
    w.write_message(description, 0, &Text { data: urdf.clone() })
        .unwrap();

    let model = Model::from_urdf(&urdf, "servicer.urdf").unwrap();
    let tip = model.frame("tool0").unwrap().clone();
    let mut at_goal = Workspace::new(&model);
    at_goal.set_positions(&degrees([87.0, 62.0, -41.0, 51.0, 28.0, 68.0]));
    let X_WD = at_goal.X_BF(&tip);
    let header = |time: u64, frame: &str| Header {
        stamp: Time::from_nanos(time as i64),
        frame_id: frame.into(),
    };
    let message = PoseStamped {
        header: header(0, "world"),
        pose: pose(&X_WD),
    };
    w.write_message(goal, 0, &message).unwrap();

    let gains = Gains {
        k_p: 75.0,
        k_o: 100.0,
        k_v: vec![400.0, 100.0, 200.0, 10.0, 2.0, 2.0],
        saturation: Saturation {
            position: 0.2,
            orientation: 0.1,
        },
    };
    let config = ControllerConfig::new(LawKind::TransposeJacobian, gains);
    let mut controller = Controller::new(model.clone(), tip.clone(), config).unwrap();
    let start = State::at_rest_with(&model, &degrees([65.0, 99.0, -95.0, -22.0, 3.0, -42.0]));
    let names: Vec<String> = model.joints().iter().map(|j| j.name.clone()).collect();
    let mut robot = Floating::new(model, start, IntegrationMethod::Dop8);
    let samples = (setup.seconds * 100.0).round() as u64;
    for i in 0..=samples {
        let time = i * 10_000_000;
        let state = robot.state().clone();
        let X_WB = state.X_WB(robot.workspace());
        let X_BE = robot.workspace().X_BF(&tip);
        let X_BD = X_WB.inverse() * X_WD;
        let middle = i == samples / 2;
        let spoil = setup.spoil;
        if !(samples / 2..samples / 2 + spoil.gap as u64).contains(&i) {
            let mut stamp = time;
            if spoil.backwards && middle {
                stamp -= 1_000_000_000;
            }
            let mut velocity = state.qd.as_slice().to_vec();
            if spoil.nan && middle {
                velocity[2] = f64::NAN;
            }
            // Mean since the sample before.
            let effort = robot.efforts().iter().map(|e| e * (1.0 + spoil.effort));
            let message = JointState {
                header: header(stamp, ""),
                name: names.clone(),
                position: state.q.as_slice().to_vec(),
                velocity,
                effort: effort.collect(),
            };
            w.write_message(topics.joints, time, &message).unwrap();
        }
        let carried = robot.workspace().carried_momentum();
        let mut linear = X_WB.rotation * carried.linear;
        if i > samples / 2 {
            linear.x += spoil.push;
        }
        let message = Momentum {
            header: header(time, "world"),
            linear: vector(&linear),
            angular: vector(&(X_WB.rotation * carried.angular)),
            kinetic_energy: robot.workspace().kinetic_energy(),
            dissipated_energy: robot.state().dissipated.total(),
        };
        w.write_message(topics.momentum, time, &message).unwrap();
        let mut odom = Odometry {
            header: header(time, "world"),
            child_frame_id: "base_link".into(),
            ..Default::default()
        };
        odom.pose.pose = pose(&X_WB);
        odom.twist.twist.linear = vector(&robot.workspace().V_WB_B().linear);
        odom.twist.twist.angular = vector(&robot.workspace().V_WB_B().angular);
        w.write_message(topics.odom, time, &odom).unwrap();
        let transform =
            |parent: &str, child: &str, X: &na::IsometryMatrix3<f64>| TransformStamped {
                header: header(time, parent),
                child_frame_id: child.into(),
                transform: Transform {
                    translation: vector(&X.translation.vector),
                    rotation: quaternion(&X.rotation),
                },
            };
        let transforms = vec![
            transform("world", "base_link", &X_WB),
            transform("base_link", "tool0", &X_BE),
        ];
        w.write_message(topics.tf, time, &TFMessage { transforms })
            .unwrap();
        for (topic, X) in [(topics.tip, X_BE), (topics.seen_goal, X_BD)] {
            let message = PoseStamped {
                header: header(time, "base_link"),
                pose: pose(&X),
            };
            w.write_message(topic, time, &message).unwrap();
        }
        let error = PoseError::between(&X_BE, &X_BD);
        let sight = TipMeasurement::new(state.time, X_BE, X_BD);
        let seen = Measurement::new(state.time, &state.q, &state.qd).with_tip(Some(&sight));
        controller.update(&seen).unwrap();
        let message = ControllerState {
            header: header(time, "base_link"),
            law: "transpose_jacobian".into(),
            position_error: vector(&error.position),
            orientation_error: vector(&error.orientation),
            position_error_norm: error.position.norm(),
            attitude_error_angle: error.angle,
            joint_names: names.clone(),
            effort: controller.efforts().as_slice().to_vec(),
            ..Default::default()
        };
        w.write_message(topics.controller, time, &message).unwrap();
        robot.hold_efforts(controller.efforts().as_slice());
        robot.step(0.01, 1);
    }
    w.finish().unwrap()
}
