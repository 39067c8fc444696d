//! Run time of one controller step for every law, on the servicer's six joints and on two arms of seven:
//! `cargo bench --bench laws` prints the table of `docs/tracking.md`.
//!
//! A step is everything between a joint state and its command: kinematics, Jacobian, latency compensation, law, bumpless
//! transfer, progress monitor. A camera frame comes with every tenth step, as at 10 Hz, or with every one.

use std::time::Instant;

use fuyu::control::prediction::Prediction;
use fuyu::control::{
    BaseTask, Controller, ControllerConfig, Gains, JacobianKind, JointPdConfig, LawConfig, LawKind,
    Measurement, OperationalSpaceConfig, Resolution, ResolvedRate, ResolvedRateConfig, Saturation,
    Shaping, StraightPathConfig, TipMeasurement, TipTask,
};
use fuyu::dynamics::Workspace;
use fuyu::model::{Frame, Model};
use fuyu::spatial::{Pose, Twist};
use nalgebra::{DVector, Matrix6xX, Translation3, Vector3};

/// States that the steps cycle through.
const STATES: usize = 16;
/// Few enough that most batches run undisturbed on a busy computer.
const STEPS: usize = 32;
const BATCHES: usize = 401;

struct Robot {
    model: Model,
    tips: Vec<Frame>,
    states: Vec<(DVector<f64>, DVector<f64>)>,
}

impl Robot {
    fn new(xml: &str, name: &str, tips: &[&str]) -> Self {
        let model = Model::from_urdf(xml, name).expect("a robot of the repository");
        let n = model.dof();
        let wave = |s: usize, j: usize| ((1.3 * s as f64 + 2.1 * j as f64) * 0.7).sin();
        let states = (0..STATES).map(|s| {
            let q = DVector::from_fn(n, |j, _| 0.8 + 0.3 * wave(s, j));
            (q, DVector::from_fn(n, |j, _| 0.03 * wave(s + 5, j)))
        });
        Self {
            states: states.collect(),
            tips: tips
                .iter()
                .map(|t| model.frame(t).expect("its tip").clone())
                .collect(),
            model,
        }
    }

    fn gains(&self) -> Gains {
        Gains {
            k_p: 75.0,
            k_o: 100.0,
            k_v: vec![20.0; self.model.dof()],
            saturation: Saturation {
                position: 0.2,
                orientation: 0.1,
            },
        }
    }

    /// Median time of a step \[ns\]; a frame comes with every `every`th.
    fn step(&self, config: ControllerConfig, every: usize) -> f64 {
        let more = self.tips[1..].to_vec();
        let tip = self.tips[0].clone();
        let controller = Controller::with_tips(self.model.clone(), tip, more, config);
        let mut controller = controller.expect("gains that fit");
        let mut workspace = Workspace::new(&self.model);
        // The measurement for each state: a goal a few centimetres from the tip.
        let sights: Vec<Vec<TipMeasurement>> = (self.states.iter())
            .map(|(q, _)| {
                workspace.set_positions(q);
                let see = |tip: &Frame| {
                    let X_BE = workspace.X_BF(tip);
                    let p = X_BE.translation.vector + Vector3::new(0.1, 0.05, -0.02);
                    TipMeasurement::new(
                        0.0,
                        X_BE,
                        Pose::from_parts(Translation3::from(p), X_BE.rotation),
                    )
                };
                self.tips.iter().map(see).collect()
            })
            .collect();
        let w = Vector3::new(1e-3, -2e-3, 1e-3);
        let (mut k, mut exposed) = (0, 0.0);
        let mut times = Vec::with_capacity(BATCHES);
        for _ in 0..BATCHES {
            let began = Instant::now();
            for _ in 0..STEPS {
                let time = 0.01 * k as f64;
                if k % every == 0 {
                    exposed = time;
                }
                let (q, qd) = &self.states[k % STATES];
                let seen = |tip: usize| TipMeasurement {
                    time: exposed,
                    ..sights[k % STATES][tip]
                };
                let first = seen(0);
                let second = [(self.tips.len() > 1).then(|| seen(1))];
                let measured = Measurement {
                    more_tips: &second[..self.tips.len() - 1],
                    ..Measurement::new(time, q, qd)
                };
                let measured = measured.with_tip(Some(&first)).with_gyro(Some(&w));
                controller.update(&measured).expect("efforts");
                k += 1;
            }
            times.push(began.elapsed().as_secs_f64() / STEPS as f64 * 1e9);
        }
        median(times)
    }
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn row(robot: &str, what: &str, nanoseconds: f64) {
    println!("| {robot} | {what} | {:.2} µs |", nanoseconds * 1e-3);
}

fn main() {
    let servicer = include_str!("../urdf/servicer.urdf");
    let arm = Robot::new(servicer, "servicer.urdf", &["tool0"]);
    let two = include_str!("../urdf/dual_arm.urdf");
    let arms = Robot::new(two, "dual_arm.urdf", &["left_tool", "right_tool"]);
    println!("| robot | step | median |\n| --- | --- | ---: |");
    row(
        "6 joints",
        "kinematics and generalized Jacobian alone",
        jacobian(&arm),
    );
    let predictions = [
        ("", Prediction::None, 10),
        (", `prediction: motion`", Prediction::Motion, 10),
        (
            ", `prediction: motion`, a frame with every state",
            Prediction::Motion,
            1,
        ),
    ];
    let straight = |shaping, period| StraightPathConfig {
        shaping,
        period,
        ..StraightPathConfig::default()
    };
    let n = arm.model.dof();
    for (how, prediction, every) in predictions {
        let with = |law: LawConfig| ControllerConfig {
            prediction,
            ..ControllerConfig::new(law, arm.gains())
        };
        for (name, law) in LawKind::NAMES {
            if law == LawKind::StraightPath {
                for (shape, shaping) in Shaping::NAMES {
                    for (load, period) in [("", 0.0), (", with its load", 0.01)] {
                        let config = with(straight(shaping, period).into());
                        let what = format!("`{name}` by {shape}{load}{how}");
                        row("6 joints", &what, arm.step(config, every));
                    }
                }
            } else {
                let law = match law {
                    LawKind::JointPd => JointPdConfig { k_p: vec![1.0; n] }.into(),
                    law => law.into(),
                };
                row(
                    "6 joints",
                    &format!("`{name}`{how}"),
                    arm.step(with(law), every),
                );
            }
        }
        for (name, base) in BaseTask::NAMES {
            let law = OperationalSpaceConfig {
                tips: vec![TipTask::Pose, TipTask::Pose],
                base,
                ..OperationalSpaceConfig::default()
            };
            let config = ControllerConfig {
                prediction,
                ..ControllerConfig::new(law, arms.gains())
            };
            let what = format!("two poses, `base_task: {name}`{how}");
            row("2 arms of 7", &what, arms.step(config, every));
        }
    }
    for (name, method) in Resolution::NAMES {
        row(
            "6 joints",
            &format!("joint rates, `{name}`"),
            resolved(&arm, method),
        );
    }
}

fn jacobian(robot: &Robot) -> f64 {
    let mut workspace = Workspace::new(&robot.model);
    let mut out = Matrix6xX::zeros(robot.model.dof());
    let mut batch = || {
        let began = Instant::now();
        for k in 0..STEPS {
            workspace.set_positions(&robot.states[k % STATES].0);
            JacobianKind::Generalized.write(&mut workspace, &robot.tips[0], &mut out);
            std::hint::black_box(&out);
        }
        began.elapsed().as_secs_f64() / STEPS as f64 * 1e9
    };
    median((0..BATCHES).map(|_| batch()).collect())
}

fn resolved(robot: &Robot, method: Resolution) -> f64 {
    let config = ResolvedRateConfig {
        method,
        ..ResolvedRateConfig::default()
    };
    let mut law = ResolvedRate::new(&robot.model, &robot.tips[0], config);
    let mut workspace = Workspace::new(&robot.model);
    let mut rates = DVector::zeros(robot.model.dof());
    let wanted = Twist::new(Vector3::zeros(), Vector3::new(0.02, 0.05, 0.0));
    let mut batch = || {
        let began = Instant::now();
        for k in 0..STEPS {
            let q = &robot.states[k % STATES].0;
            law.rates(&robot.model, &mut workspace, q, &wanted, &mut rates);
            std::hint::black_box(&rates);
        }
        began.elapsed().as_secs_f64() / STEPS as f64 * 1e9
    };
    median((0..BATCHES).map(|_| batch()).collect())
}
