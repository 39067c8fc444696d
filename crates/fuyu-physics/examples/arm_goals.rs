//! Arms on a satellite, without any parameter: how many random reachable goals a control law attains in ten simulated minutes.
//!
//! ```sh
//! cargo run --release -p fuyu-physics --example arm_goals -- LAW GOALS TIP ROBOT.urdf...
//! ```
//! `LAW` is a name of `LawKind::NAMES`, `TIP` the link whose frame is the tip. Gains are computed. Measurements are exact, sampled at 100 Hz.

#![allow(non_snake_case)]

use fuyu_physics::control::{
    AutoGains, Controller, ControllerConfig, FloatingInverseKinematics, JointPdConfig, LawConfig,
    LawKind, Measurement, PoseError, TipMeasurement, with_default_effort_limits,
};
use fuyu_physics::dynamics::{Floating, IntegrationMethod, State, Workspace};
use fuyu_physics::model::{Frame, Model};
use fuyu_physics::spatial::Pose;
use nalgebra::DVector;
use rand::{RngExt, SeedableRng, rngs::StdRng};

const PERIOD: f64 = 0.01;
const DURATION: f64 = 600.0;
/// Acceleration of the default effort limits, as in the dynamics node \[rad/s²\].
const ACCELERATION: f64 = 100.0;
/// Attained: 1 cm and 1°.
const ATTAINED: (f64, f64) = (0.01, 0.017_453);
/// Time for which the tip must stay there \[s\].
const HELD: f64 = 20.0;

enum Outcome {
    Attained(f64),
    Refused(String),
    Missed(f64, f64),
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let mut next = |what: &str| args.next().ok_or(format!("give {what}"));
    let (law, goals, tip) = (next("LAW")?, next("GOALS")?, next("TIP")?);
    let goals: usize = goals.parse()?;
    let known = LawKind::NAMES.iter().find(|(name, _)| *name == law);
    let kind = known.ok_or("LAW is not known")?.1;
    println!(
        "{:>12} {:>9} {:>8} {:>7} {:>14} {:>14}",
        law, "attained", "refused", "missed", "median time", "worst error"
    );
    let (mut attained, mut asked) = (0, 0);
    for path in args {
        let xml = std::fs::read_to_string(&path)?;
        let model = match Model::from_urdf(&xml, &path) {
            Ok(model) => with_default_effort_limits(&model, ACCELERATION),
            Err(error) => {
                println!("{path}: {error}");
                continue;
            }
        };
        let tip = model.frame(&tip).ok_or("no such tip")?.clone();
        let (mut times, mut refused, mut missed) = (Vec::new(), Vec::new(), Vec::new());
        for goal in 0..goals {
            match run(&model, &tip, kind, goal as u64) {
                Outcome::Attained(time) => times.push(time),
                Outcome::Refused(why) => refused.push(why),
                Outcome::Missed(position, angle) => missed.push((position, angle)),
            }
        }
        times.sort_by(f64::total_cmp);
        let median = times.get(times.len() / 2).copied().unwrap_or(f64::NAN);
        let worst = missed
            .iter()
            .fold((0.0_f64, 0.0_f64), |w, m| (w.0.max(m.0), w.1.max(m.1)));
        println!(
            "{:>12} {:>9} {:>8} {:>7} {median:>12.1} s {:>7.3} m {:>5.2} rad",
            model.name(),
            times.len(),
            refused.len(),
            missed.len(),
            worst.0,
            worst.1
        );
        for why in refused {
            println!("{:>14}{why}", "");
        }
        attained += times.len();
        asked += goals;
    }
    println!("{attained} of {asked}");
    Ok(())
}

/// A posture within the limits.
fn posture(model: &Model, random: &mut StdRng) -> DVector<f64> {
    let half_turn = std::f64::consts::PI;
    let joints = model.joints().iter().map(|joint| {
        let (lower, upper) = (
            joint.limits.lower.max(-half_turn),
            joint.limits.upper.min(half_turn),
        );
        random.random_range(lower..upper)
    });
    DVector::from_iterator(model.dof(), joints)
}

/// Where the tip gets, in the base frame at the start, when the joints move to two random postures one after the other.
fn reachable_goal(model: &Model, tip: &Frame, start: &DVector<f64>, seed: u64) -> Pose {
    let mut random = StdRng::seed_from_u64(seed);
    let (first, second) = (posture(model, &mut random), posture(model, &mut random));
    let mut floating = FloatingInverseKinematics::new(model, tip);
    let mut workspace = Workspace::new(model);
    workspace.set_positions(&first);
    let X_0B = floating.tip_after(start, &first) * workspace.X_BF(tip).inverse();
    X_0B * floating.tip_after(&first, &second)
}

fn run(model: &Model, tip: &Frame, kind: LawKind, seed: u64) -> Outcome {
    let state = State::at_rest(model);
    let X_WD = reachable_goal(model, tip, &state.q, seed);
    let Some(auto) = AutoGains::new(model, tip, PERIOD) else {
        return Outcome::Refused("no gains".to_owned());
    };
    let law = match kind {
        LawKind::JointPd => JointPdConfig {
            k_p: auto.joint_k_p,
        }
        .into(),
        kind => LawConfig::from(kind),
    };
    let config = ControllerConfig::new(law, auto.gains);
    let mut controller = match Controller::new(model.clone(), tip.clone(), config) {
        Ok(controller) => controller,
        Err(error) => return Outcome::Refused(error.to_string()),
    };
    let mut robot = Floating::new(model.clone(), state, IntegrationMethod::Dop8);
    let mut since = None;
    let mut left = (f64::NAN, f64::NAN);
    for step in 0..(DURATION / PERIOD) as usize {
        let time = PERIOD * step as f64;
        let workspace = robot.workspace();
        let X_BE = workspace.X_BF(tip);
        let X_BD = robot.state().X_WB(workspace).inverse() * X_WD;
        let error = PoseError::between(&X_BE, &X_BD);
        left = (error.position.norm(), error.angle);
        if left.0 < ATTAINED.0 && left.1 < ATTAINED.1 {
            let since = *since.get_or_insert(time);
            if time - since > HELD {
                return Outcome::Attained(since);
            }
        } else {
            since = None;
        }
        let w = workspace.V_WB_B().angular;
        let sight = TipMeasurement::new(time, X_BE, X_BD);
        let state = robot.state();
        let seen = Measurement::new(time, &state.q, &state.qd);
        let seen = seen.with_gyro(Some(&w)).with_tip(Some(&sight));
        if let Err(error) = controller.update(&seen) {
            return Outcome::Refused(error.to_string());
        }
        if !robot.state().is_finite() {
            break;
        }
        robot.hold_efforts(controller.efforts().as_slice());
        robot.step(PERIOD, 1);
    }
    Outcome::Missed(left.0, left.1)
}
