//! Recorded runs: the messages of a bag converted back to states.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

use super::recorded_contacts::TouchedTargets;
use super::recorded_names::is_of_target;
use super::recorded_runs::RunCounter;
use crate::bag::Message;
use crate::model::Model;
use crate::msg::builtin_interfaces::Time;
use crate::msg::fuyu_msgs::{
    AppendageStates, ControllerState, ExternalImpulse, MissionState, Momentum,
};
use crate::msg::geometry_msgs::{self, PoseStamped};
use crate::msg::nav_msgs::Odometry;
use crate::msg::sensor_msgs::JointState;
use crate::msg::std_msgs;
use crate::msg::tf2_msgs::TFMessage;
use crate::nodes::controller::measured_errors;
use crate::spatial::Twist;

/// Runs in a bag by namespace, which is usually empty; each namespace has one robot or target. A robot has several runs
/// if the simulation was reset; a target also if it was replaced, or given another pose or twist.
#[derive(Debug, Default)]
pub struct RecordedRuns {
    runs: BTreeMap<String, Vec<RecordedRun>>,
    counter: RunCounter,
    /// Number of times that each target was replaced or moved from outside.
    moves: BTreeMap<String, usize>,
    touched: TouchedTargets,
}

/// The recorded data of one robot. Times are stamps in nanoseconds.
#[derive(Debug, Default)]
pub struct RecordedRun {
    /// The model of its `robot_description`, or the error.
    pub model: Option<Result<Model, String>>,
    /// Names of the joints, in the order of the values in [`JointSample`].
    pub joint_names: Vec<String>,
    /// `joint_states`.
    pub joints: Vec<JointSample>,
    /// `ground_truth/momentum`.
    pub momentum: Vec<MomentumSample>,
    /// Names of the wheels, in the order of the values in [`Self::wheels`].
    pub wheel_names: Vec<String>,
    /// `wheel_states`.
    pub wheels: Vec<JointSample>,
    /// `ground_truth/appendages`.
    pub deformation: Vec<DeformationSample>,
    /// `ground_truth/external_impulse`.
    pub external: Vec<ExternalSample>,
    /// `ground_truth/odom`.
    pub base: Vec<BaseSample>,
    /// `controller/state`.
    pub controller: Vec<ControllerSample>,
    /// The last `mission/state`.
    pub mission: Option<MissionState>,
    /// The last `goal_pose`, with its frame.
    pub goal: Option<(String, Isometry3<f64>)>,
    /// The last transform of every frame in `tf` and `tf_static`, by child frame: parent frame, and pose in it.
    pub frames: BTreeMap<String, (String, Isometry3<f64>)>,
    /// `camera/tip_pose`.
    pub seen_tip: Vec<SeenPose>,
    /// `camera/goal_pose`.
    pub seen_goal: Vec<SeenPose>,
}

/// A pose in the base frame as measured by the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenPose {
    /// Stamp \[ns\].
    pub time: i64,
    /// Pose.
    pub pose: Isometry3<f64>,
}

/// Joint positions and rates, and the mean efforts since the previous sample.
#[derive(Debug, Clone)]
pub struct JointSample {
    /// Stamp \[ns\].
    pub time: i64,
    /// Positions \[rad or m\].
    pub q: Vec<f64>,
    /// Rates \[rad/s or m/s\].
    pub qd: Vec<f64>,
    /// Mean efforts \[N m or N\]; empty if not recorded.
    pub effort: Vec<f64>,
}

/// Momentum about the system's centre of mass in world axes, and kinetic energy.
#[derive(Debug, Clone)]
pub struct MomentumSample {
    /// Stamp \[ns\].
    pub time: i64,
    /// Linear momentum \[N s\].
    pub linear: Vector3<f64>,
    /// Angular momentum \[N m s\].
    pub angular: Vector3<f64>,
    /// Kinetic energy \[J\].
    pub kinetic_energy: f64,
    /// Energy dissipated by joints, deformation and wheel bearings since the start \[J\].
    pub dissipated_energy: f64,
}

/// Strain energy, and the motors of elastic joints on the output side of their gears.
#[derive(Debug, Clone)]
pub struct DeformationSample {
    /// Stamp \[ns\].
    pub time: i64,
    /// Strain energy \[J\].
    pub strain_energy: f64,
    /// Names of the elastic joints.
    pub joint_names: Vec<String>,
    /// Motor positions \[rad or m\].
    pub motor_position: Vec<f64>,
    /// Motor rates \[rad/s or m/s\].
    pub motor_velocity: Vec<f64>,
}

/// Changes due to external wrenches since the start: momentum about the system's centre of mass in world axes, and
/// energy.
#[derive(Debug, Clone, Copy, Default)]
pub struct ExternalSample {
    /// Stamp \[ns\].
    pub time: i64,
    /// Linear impulse \[N s\].
    pub linear: Vector3<f64>,
    /// Angular impulse \[N m s\].
    pub angular: Vector3<f64>,
    /// Work \[J\].
    pub work: f64,
}

/// Pose of the base in the world and its twist in base axes.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseSample {
    /// Stamp \[ns\].
    pub time: i64,
    /// Pose.
    pub X_WB: Isometry3<f64>,
    /// Twist of the base frame's origin.
    pub V_WB_B: Twist,
}

/// Deviation of the tip from the goal as measured by the controller.
#[derive(Debug, Clone)]
pub struct ControllerSample {
    /// Stamp \[ns\].
    pub time: i64,
    /// Position error \[m\].
    pub position_error: f64,
    /// Attitude error \[rad\].
    pub attitude_error: f64,
    /// Gain on the position error \[N/m\]; zero if the law does not control the position.
    pub k_p: f64,
    /// Gain on the orientation error \[N m\]; zero if the law does not control the attitude.
    pub k_o: f64,
}

impl BaseSample {
    fn of(odom: Odometry) -> Self {
        let twist = &odom.twist.twist;
        Self {
            time: odom.header.stamp.nanos(),
            X_WB: pose(&odom.pose.pose),
            V_WB_B: Twist::new(vector(&twist.angular), vector(&twist.linear)),
        }
    }
}

impl RecordedRuns {
    /// Adds a message; ignores other topics and types.
    pub fn accept(&mut self, message: &Message) {
        self.touched.accept(message);
        for (suffix, type_name, take) in TOPICS {
            if message.topic.type_name == *type_name
                && let Some(namespace) = message.topic.name.strip_suffix(suffix)
                // `/chaser/tf` belongs to the robot `/chaser`, but `/camera/goal_pose` is not the `goal_pose` of a
                // robot `/camera`.
                && !namespace.ends_with("/camera")
                && !namespace.ends_with("/ground_truth")
            {
                self.split(namespace, message);
                return take(self.run(namespace, message), message);
            }
        }
        for (suffix, type_name, take) in OF_TARGETS {
            if message.topic.type_name == *type_name
                && let Some(namespace) = message.topic.name.strip_suffix(suffix)
                && is_of_target(namespace)
            {
                self.split(namespace, message);
                return take(self.run(namespace, message), message);
            }
        }
    }

    /// The run in `namespace` that a message belongs to.
    fn run(&mut self, namespace: &str, message: &Message) -> &mut RecordedRun {
        let moves = self.moves.get(namespace).copied().unwrap_or(0);
        let index = self.counter.run_of(message) + moves;
        let runs = self.runs.entry(namespace.to_owned()).or_default();
        while runs.len() <= index {
            let next = runs.last().map(RecordedRun::again);
            runs.push(next.unwrap_or_default());
        }
        &mut runs[index]
    }

    /// Begins a new run of a target if `message` shows that it was replaced (another description follows states), or moved
    /// from outside (another state of the same time follows).
    fn split(&mut self, namespace: &str, message: &Message) {
        if !is_of_target(namespace) {
            return;
        }
        let Some(last) = self.runs.get(namespace).and_then(|runs| runs.last()) else {
            return;
        };
        let is_description = message.topic.type_name == "std_msgs/msg/String";
        let is_new = match (is_description, last.base.last()) {
            (true, _) => !last.is_empty(),
            (false, Some(before)) if message.topic.type_name == "nav_msgs/msg/Odometry" => message
                .decode()
                .map(BaseSample::of)
                .is_ok_and(|now| now.time == before.time && now != *before),
            (false, _) => false,
        };
        if is_new {
            *self.moves.entry(namespace.to_owned()).or_default() += 1;
            let run = self.run(namespace, message);
            if is_description {
                run.joint_names.clear();
            }
        }
    }

    /// Whether anything has touched the target in `namespace`.
    pub fn was_touched(&self, namespace: &str) -> bool {
        self.touched.contains(namespace)
    }

    /// Robots, and targets with joints: namespaces and recorded data, run by run.
    pub fn robots(&self) -> impl Iterator<Item = (&str, &RecordedRun)> {
        self.robot_runs()
            .flat_map(|(namespace, runs)| runs.into_iter().map(move |run| (namespace, run)))
    }

    /// As [`Self::robots`], with the runs of a robot together. A target with joints has the namespace
    /// `ground_truth/NAME`.
    pub fn robot_runs(&self) -> impl Iterator<Item = (&str, Vec<&RecordedRun>)> {
        self.runs.iter().filter_map(|(namespace, runs)| {
            let is_rigid = |run: &RecordedRun| is_of_target(namespace) && run.joints.is_empty();
            let was_recorded = |run: &&RecordedRun| !run.is_empty() && !is_rigid(run);
            let runs: Vec<_> = runs.iter().filter(was_recorded).collect();
            (!runs.is_empty()).then_some((namespace.as_str(), runs))
        })
    }
}

type Take = fn(&mut RecordedRun, &Message);

// Undecodable messages are ignored here; the topic check reports them.
const TOPICS: &[(&str, &str, Take)] = &[
    ("/robot_description", "std_msgs/msg/String", |run, m| {
        if let Ok(text) = m.decode::<std_msgs::String>() {
            let robot = Model::repaired_from_urdf(&text.data, &m.topic.name);
            run.model = Some(robot.map(|r| r.model).map_err(|e| e.to_string()));
        }
    }),
    ("/joint_states", "sensor_msgs/msg/JointState", |run, m| {
        if let Ok(state) = m.decode() {
            let sample = sample_of(&mut run.joint_names, state);
            run.joints.extend(sample);
        }
    }),
    (
        "/ground_truth/momentum",
        "fuyu_msgs/msg/Momentum",
        RecordedRun::add_momentum,
    ),
    ("/wheel_states", "sensor_msgs/msg/JointState", |run, m| {
        if let Ok(state) = m.decode() {
            let sample = sample_of(&mut run.wheel_names, state);
            run.wheels.extend(sample);
        }
    }),
    (
        "/ground_truth/appendages",
        "fuyu_msgs/msg/AppendageStates",
        |run, m| {
            if let Ok(states) = m.decode::<AppendageStates>() {
                run.deformation.push(DeformationSample {
                    time: states.header.stamp.nanos(),
                    strain_energy: states.strain_energy,
                    joint_names: states.joint_name,
                    motor_position: states.motor_position,
                    motor_velocity: states.motor_velocity,
                });
            }
        },
    ),
    (
        "/ground_truth/external_impulse",
        "fuyu_msgs/msg/ExternalImpulse",
        |run, m| {
            if let Ok(change) = m.decode::<ExternalImpulse>() {
                run.external.push(ExternalSample {
                    time: change.header.stamp.nanos(),
                    linear: vector(&change.linear),
                    angular: vector(&change.angular),
                    work: change.work,
                });
            }
        },
    ),
    (
        "/ground_truth/odom",
        "nav_msgs/msg/Odometry",
        RecordedRun::add_base,
    ),
    (
        "/controller/state",
        "fuyu_msgs/msg/ControllerState",
        |run, m| {
            if let Ok(state) = m.decode::<ControllerState>()
                && let Some((position_error, attitude_error)) = measured_errors(&state)
            {
                run.controller.push(ControllerSample {
                    time: state.header.stamp.nanos(),
                    position_error,
                    attitude_error,
                    k_p: state.k_p,
                    k_o: state.k_o,
                });
            }
        },
    ),
    ("/mission/state", "fuyu_msgs/msg/MissionState", |run, m| {
        if let Ok(state) = m.decode() {
            run.mission = Some(state);
        }
    }),
    (
        "/camera/tip_pose",
        "geometry_msgs/msg/PoseStamped",
        |run, m| {
            run.seen_tip.extend(seen(m));
        },
    ),
    (
        "/camera/goal_pose",
        "geometry_msgs/msg/PoseStamped",
        |run, m| {
            run.seen_goal.extend(seen(m));
        },
    ),
    ("/goal_pose", "geometry_msgs/msg/PoseStamped", |run, m| {
        if let Ok(goal) = m.decode::<PoseStamped>() {
            run.goal = Some((goal.header.frame_id, pose(&goal.pose)));
        }
    }),
    ("/tf", "tf2_msgs/msg/TFMessage", RecordedRun::add_frames),
    (
        "/tf_static",
        "tf2_msgs/msg/TFMessage",
        RecordedRun::add_frames,
    ),
];

/// Further topics of a target, in its namespace.
const OF_TARGETS: &[(&str, &str, Take)] = &[
    ("/odom", "nav_msgs/msg/Odometry", RecordedRun::add_base),
    (
        "/momentum",
        "fuyu_msgs/msg/Momentum",
        RecordedRun::add_momentum,
    ),
];

impl RecordedRun {
    /// An empty run of the same robot: latched data are kept, since they are not repeated after a reset.
    fn again(&self) -> Self {
        Self {
            model: self.model.clone(),
            joint_names: self.joint_names.clone(),
            wheel_names: self.wheel_names.clone(),
            goal: self.goal.clone(),
            frames: self.frames.clone(),
            ..Self::default()
        }
    }

    /// External impulse and work up to `time` \[ns\].
    pub fn external_until(&self, time: i64) -> ExternalSample {
        let count = self.external.partition_point(|sample| sample.time <= time);
        match count {
            0 => ExternalSample::default(),
            count => self.external[count - 1],
        }
    }

    fn is_empty(&self) -> bool {
        self.joints.is_empty()
            && self.momentum.is_empty()
            && self.base.is_empty()
            && self.controller.is_empty()
    }

    fn add_base(&mut self, message: &Message) {
        self.base.extend(message.decode().map(BaseSample::of));
    }

    fn add_momentum(&mut self, message: &Message) {
        if let Ok(momentum) = message.decode::<Momentum>() {
            self.momentum.push(MomentumSample {
                time: momentum.header.stamp.nanos(),
                linear: vector(&momentum.linear),
                angular: vector(&momentum.angular),
                kinetic_energy: momentum.kinetic_energy,
                dissipated_energy: momentum.dissipated_energy,
            });
        }
    }

    fn add_frames(&mut self, message: &Message) {
        let Ok(tf) = message.decode::<TFMessage>() else {
            return;
        };
        for t in tf.transforms {
            let X_PC = Isometry3::from_parts(
                Translation3::from(vector(&t.transform.translation)),
                rotation(&t.transform.rotation),
            );
            self.frames
                .insert(t.child_frame_id, (t.header.frame_id, X_PC));
        }
    }

    /// The base body's centre of mass in the world; the base frame's origin if the robot is unknown \[m\].
    pub fn base_com(&self, sample: &BaseSample) -> Vector3<f64> {
        let com = match &self.model {
            Some(Ok(model)) => model.bodies()[0].inertia.com,
            _ => Vector3::zeros(),
        };
        sample.X_WB.rotation * com + sample.X_WB.translation.vector
    }

    /// The last pose of a frame in the root of its tree, and the root's name.
    pub fn pose_in_root(&self, frame: &str) -> (String, Isometry3<f64>) {
        let mut name = frame;
        let mut pose = Isometry3::identity();
        // The number of frames limits the depth of a tree; this also terminates in case of a cycle.
        for _ in 0..self.frames.len() {
            let Some((parent, X_PC)) = self.frames.get(name) else {
                break;
            };
            pose = X_PC * pose;
            name = parent;
        }
        (name.to_owned(), pose)
    }

    /// The earliest stamp of the run \[ns\], the origin of plots.
    pub fn start(&self) -> i64 {
        let first = [
            self.joints.first().map(|s| s.time),
            self.momentum.first().map(|s| s.time),
            self.base.first().map(|s| s.time),
            self.controller.first().map(|s| s.time),
        ];
        first.into_iter().flatten().min().unwrap_or(0)
    }
}

/// A sample with values in the order of `names`, which the first message defines; `None` if a name is missing.
fn sample_of(names: &mut Vec<String>, state: JointState) -> Option<JointSample> {
    if names.is_empty() {
        names.clone_from(&state.name);
    }
    let ordered = |values: &[f64]| -> Option<Vec<f64>> {
        if state.name == *names {
            return (values.len() == names.len()).then(|| values.to_vec());
        }
        let value_of = |wanted: &String| {
            let i = state.name.iter().position(|name| name == wanted)?;
            values.get(i).copied()
        };
        names.iter().map(value_of).collect()
    };
    Some(JointSample {
        time: state.header.stamp.nanos(),
        q: ordered(&state.position)?,
        qd: ordered(&state.velocity)?,
        effort: ordered(&state.effort).unwrap_or_default(),
    })
}

fn seen(message: &Message) -> Option<SeenPose> {
    let measured = message.decode::<PoseStamped>().ok()?;
    Some(SeenPose {
        time: measured.header.stamp.nanos(),
        pose: pose(&measured.pose),
    })
}

/// Seconds from `start` to `time` (both in ns).
pub fn seconds_since(start: i64, time: i64) -> f64 {
    let t = Time::from_nanos(time - start);
    t.seconds()
}

fn vector(v: &geometry_msgs::Vector3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

fn rotation(q: &geometry_msgs::Quaternion) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(q.w, q.x, q.y, q.z))
}

fn pose(p: &geometry_msgs::Pose) -> Isometry3<f64> {
    let position = Translation3::new(p.position.x, p.position.y, p.position.z);
    Isometry3::from_parts(position, rotation(&p.orientation))
}
