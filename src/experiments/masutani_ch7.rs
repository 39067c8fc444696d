//! Masutani 1995, chapter 7: straight paths of the tip, for the servicer without its wrist.
//!
//! Gains are printed; start and goal of Fig. 7.3 are recovered.

use nalgebra::{DVector, Rotation3, Translation3, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::continuous_loop::ContinuousLoop;
use crate::control::{ControllerConfig, Gains, LawKind, Saturation, Shaping, StraightPathConfig};
use crate::dynamics::Workspace;
use crate::model::Model;
use crate::spatial::Pose;

/// The robot: joints 1 to 3 of Fig. 5.2, the tip at the end of link 3.
pub fn model() -> Model {
    let xml = include_str!("../../urdf/servicer_without_wrist.urdf");
    Model::from_urdf(xml, "urdf/servicer_without_wrist.urdf").expect("the servicer is well formed")
}

/// Law of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Steering {
    /// The law of chapter 5, Fig. 7.3 (a).
    Plain,
    /// A straight path, by rotation as in Fig. 7.3 (b) or by damping.
    Straight(Shaping),
}

/// The printed gains, with one of the laws; there is no saturation.
pub fn config(steering: Steering) -> ControllerConfig {
    let gains = Gains {
        k_p: 20.0,
        k_o: 0.0,
        k_v: vec![400.0, 100.0, 200.0],
        saturation: Saturation::NONE,
    };
    match steering {
        Steering::Plain => ControllerConfig::new(LawKind::TransposeJacobian, gains),
        Steering::Straight(shaping) => {
            let law = StraightPathConfig {
                shaping,
                ..StraightPathConfig::default()
            };
            ControllerConfig::new(law, gains)
        }
    }
}

/// Start and goal of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Task {
    /// Joint angles at the start \[rad\].
    pub start: [f64; 3],
    /// Goal in the world, whose origin is the initial position of the base \[m\].
    pub goal: [f64; 3],
}

/// Fig. 7.3.
pub const FIG_7_3: Task = Task {
    start: [
        0.0,
        std::f64::consts::FRAC_PI_3,
        -2.0 * std::f64::consts::FRAC_PI_3,
    ],
    goal: [0.0, 6.080127018922194, 0.0],
};

/// Fig. 7.3 and eleven more tasks, drawn at random: start and goal are tip positions with the base at its initial position,
/// one to four metres apart, with the elbow bent by 30 to 140 degrees, and the line between them is at least a metre from the
/// axis of joint 1, about which the arm is compliant.
pub fn tasks() -> Vec<Task> {
    let model = model();
    let tip = model.frame("tool0").expect("the servicer's tip").clone();
    let mut workspace = Workspace::new(&model);
    let mut random = StdRng::seed_from_u64(7);
    let mut tip_at = |q: &[f64; 3]| {
        workspace.set_positions(&DVector::from_row_slice(q));
        workspace.X_BF(&tip).translation.vector
    };
    let mut posture = || {
        [
            random.random_range(-3.0..3.0),
            random.random_range(-1.0..2.5),
            random.random_range(-140f64..-30.0).to_radians(),
        ]
    };
    let mut tasks = vec![FIG_7_3];
    while tasks.len() < 12 {
        let (start, end) = (posture(), posture());
        let (tip, goal) = (tip_at(&start), tip_at(&end));
        let line = (0..=20).map(|k| tip.lerp(&goal, f64::from(k) / 20.0));
        let nearest = line.map(|p| p.xz().norm()).fold(f64::INFINITY, f64::min);
        if (1.0..4.0).contains(&(goal - tip).norm()) && nearest >= 1.0 {
            tasks.push(Task {
                start,
                goal: goal.into(),
            });
        }
    }
    tasks
}

/// Result of a task.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Positions of the tip in the world every 0.05 s \[m\].
    pub path: Vec<Vector3<f64>>,
    /// Joint angles and base pose every 3 s.
    pub postures: Vec<(DVector<f64>, Pose)>,
    /// Largest distance of the tip from the straight line \[m\].
    pub deviation: f64,
    /// Length of the path over the distance from its start to its end.
    pub path_ratio: f64,
    /// Time after which the tip stays within 5 cm of its goal \[s\]; `None` if it does not.
    pub settled: Option<f64>,
    /// Final distance from the goal \[m\].
    pub left: f64,
    /// Largest speed of the tip \[m/s\].
    pub top_speed: f64,
}

/// Time between samples of a path \[s\].
pub const SAMPLE: f64 = 0.05;

impl Task {
    /// The closed loop at its start.
    pub fn start(&self, config: ControllerConfig) -> ContinuousLoop {
        let model = model();
        let tip = model.frame("tool0").expect("the servicer's tip").clone();
        let [x, y, z] = self.goal;
        let X_WD = Pose::from_parts(Translation3::new(x, y, z), Rotation3::identity());
        let q = DVector::from_row_slice(&self.start);
        ContinuousLoop::new(model, &tip, config, &q, X_WD).expect("gains for three joints")
    }

    /// Runs the task for `duration` \[s\].
    pub fn run(&self, config: ControllerConfig, duration: f64) -> Outcome {
        let mut robot = self.start(config);
        let goal = robot.X_WD().translation.vector;
        let samples = (duration / SAMPLE).round() as usize;
        let every_3_s = (3.0 / SAMPLE).round() as usize;
        let (mut path, mut postures) = (Vec::new(), Vec::new());
        for k in 0..=samples {
            if k > 0 {
                robot.run_to(k as f64 * SAMPLE, STEP);
            }
            path.push(robot.X_WE().translation.vector);
            if k % every_3_s == 0 {
                postures.push((robot.state().q.clone(), robot.X_WB()));
            }
        }
        let line = (goal - path[0]).normalize();
        let off = |p: &Vector3<f64>| (p - path[0]).cross(&line).norm();
        let steps = path.windows(2).map(|p| (p[1] - p[0]).norm());
        let left = |p: &Vector3<f64>| (goal - p).norm();
        let far = path.iter().rposition(|p| left(p) > 0.05);
        let settled = far.map_or(0, |k| k + 1);
        Outcome {
            deviation: path.iter().map(off).fold(0.0, f64::max),
            path_ratio: steps.clone().sum::<f64>() / (path[samples] - path[0]).norm(),
            settled: (settled <= samples).then_some(settled as f64 * SAMPLE),
            left: left(&path[samples]),
            top_speed: steps.fold(0.0, f64::max) / SAMPLE,
            path,
            postures,
        }
    }
}

/// Step of the integration \[s\]; the fastest root of the damped arm is some 100 1/s.
const STEP: f64 = 0.0125;
