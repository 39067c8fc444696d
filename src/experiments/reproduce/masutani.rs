//! The figures of Masutani 1995, chapter 5, compared with the numbers stated in the text.

use nalgebra::{Point3, Vector3};

use super::Report;
use crate::control::{JacobianKind, LawKind};
use crate::dynamics::Workspace;
use crate::experiments::masutani_ch5::{Moment, PERIOD, Run, model};
use crate::experiments::{Figure, Panel, Series};
use crate::spatial::{Pose, roll_pitch_yaw_intrinsic};

/// Duration of the runs \[s\].
const DURATION: f64 = 60.0;

const RECOVERED: &str = "The thesis prints gains and limits, but neither the geometry of Fig. 5.2 nor start and \
    goal. They are recovered ones, so that what depends on them can only be near.";

fn moments(law: LawKind) -> Vec<Moment> {
    Run::new(law, JacobianKind::Generalized, PERIOD).moments(DURATION)
}

fn largest(moments: &[Moment], figure: impl Fn(&Moment) -> f64) -> f64 {
    moments.iter().map(figure).fold(0.0, f64::max)
}

/// Projections of the arm every 3 s, under (a) joint PD control and (b) the proposed law.
pub(super) fn fig_5_3(mut report: Report) -> Report {
    let laws = [LawKind::JointPd, LawKind::TransposeJacobian];
    let [joint_pd, proposed] = laws.map(moments);
    let last = |run: &[Moment]| run.last().map_or(f64::NAN, |m| m.error.position.norm());
    let turned = |run: &[Moment]| run.last().map_or(f64::NAN, |m| m.error.angle.to_degrees());
    let (miss, hit) = (last(&joint_pd), last(&proposed));
    report.holds(
        "(a) joint PD converges elsewhere: more than 0.1 m from the goal [m]",
        miss,
        miss > 0.1,
    );
    let speed = joint_pd.last().map_or(f64::NAN, |m| m.tip_speed);
    report.holds(
        "(a) it does converge: speed of the tip at the end below 1 mm/s [m/s]",
        speed,
        speed < 1e-3,
    );
    report.near(
        "(b) proposed law, position of the tip off the goal [m]",
        0.0,
        hit,
        1e-3,
    );
    report.near(
        "(b) attitude of the tip off the goal [deg]",
        0.0,
        turned(&proposed),
        0.5,
    );
    report.note(RECOVERED);
    let panel = |label: &str, run: &[Moment]| Panel {
        y_label: format!("{label} x [m]"),
        series: projection(run),
        ..Panel::default()
    };
    let figure = Figure {
        title: "Masutani 1995 Fig. 5.3: the arm every 3 s, seen along z".to_owned(),
        x_label: "y [m]".to_owned(),
        panels: vec![panel("(a)", &joint_pd), panel("(b)", &proposed)],
        ..Figure::default()
    };
    report.figures.push(("masutani-fig-5.3".to_owned(), figure));
    report
}

/// The arm in the y-x plane, drawn forth and back along its links, so that one line contains all postures.
fn projection(run: &[Moment]) -> Vec<Series> {
    let model = model();
    let mut workspace = Workspace::new(&model);
    let mut posture = |q: &nalgebra::DVector<f64>, X_WB: &Pose| -> Vec<(f64, f64)> {
        workspace.set_positions(q);
        let frames = model
            .frames()
            .iter()
            .filter(|f| f.name.starts_with("link") || f.name == "tool0");
        let origins = frames.map(|f| X_WB * workspace.X_BF(f) * Point3::origin());
        let base = X_WB * Point3::origin();
        std::iter::once(base)
            .chain(origins)
            .map(|p| (p.y, p.x))
            .collect()
    };
    let every = (3.0 / PERIOD).round() as usize;
    let mut arm = Vec::new();
    for moment in run.iter().step_by(every) {
        let line = posture(&moment.q, &moment.X_WB);
        arm.extend(&line);
        arm.extend(line.iter().rev());
    }
    let tip = run.iter().map(|m| (m.p_WE.y, m.p_WE.x)).collect();
    let goal = Run::new(
        LawKind::TransposeJacobian,
        JacobianKind::Generalized,
        PERIOD,
    );
    let goal = goal.X_WD().translation.vector;
    let arms = 0.15;
    let cross = [
        (goal.y - arms, goal.x),
        (goal.y + arms, goal.x),
        (goal.y, goal.x),
        (goal.y, goal.x - arms),
        (goal.y, goal.x + arms),
    ];
    let series = |name: &str, points| Series {
        name: name.to_owned(),
        points,
    };
    vec![
        series("arm", arm),
        series("path of the tip", tip),
        series("goal", cross.to_vec()),
    ]
}

/// Deviations of the tip over time, and the statements of the text about the motion.
pub(super) fn fig_5_4(mut report: Report) -> Report {
    let run = moments(LawKind::TransposeJacobian);
    let (first, last) = (&run[0], &run[run.len() - 1]);
    report.near(
        "|e_p| at the end [m]",
        0.0,
        last.error.position.norm(),
        1e-3,
    );
    report.near("|e_o| at the end", 0.0, last.error.orientation.norm(), 1e-2);
    let moved = last.X_WB.translation.vector - first.X_WB.translation.vector;
    for (axis, published, moved) in [
        ("x", 0.01, moved.x),
        ("y", 0.07, moved.y),
        ("z", 0.04, moved.z),
    ] {
        let quantity = format!("displacement of the base, {axis}, magnitude [m]");
        report.near(&quantity, published, moved.abs(), 0.01);
    }
    let turned = roll_pitch_yaw_intrinsic(&last.X_WB.rotation).map(f64::to_degrees);
    for (angle, published, turned) in [
        ("roll", 16.0, turned[0]),
        ("pitch", 10.0, turned[1]),
        ("yaw", 1.0, turned[2]),
    ] {
        let quantity = format!("{angle} of the base, magnitude [deg]");
        report.near(&quantity, published, turned.abs(), 2.0);
    }
    let speed = largest(&run, |m| m.tip_speed);
    let acceleration = largest(&run, |m| m.tip_acceleration);
    report.near("largest speed of the tip [m/s]", 0.65, speed, 0.05);
    report.near(
        "largest acceleration of the tip [m/s²]",
        2.5,
        acceleration,
        0.1,
    );
    report.note(RECOVERED);
    report.note("The text prints the drift of the base without signs.");
    let panel = |label: &str, value: fn(&Moment) -> f64| Panel {
        y_label: label.to_owned(),
        series: vec![Series {
            name: label.split(' ').next().unwrap_or(label).to_owned(),
            points: run.iter().map(|m| (m.time, value(m))).collect(),
        }],
        ..Panel::default()
    };
    let figure = Figure {
        title: "Masutani 1995 Fig. 5.4: deviation of the tip".to_owned(),
        x_label: "time [s]".to_owned(),
        panels: vec![
            panel("|e_p| [m]", |m| m.error.position.norm()),
            panel("|e_o|", |m| m.error.orientation.norm()),
        ],
        ..Figure::default()
    };
    report.figures.push(("masutani-fig-5.4".to_owned(), figure));
    report
}

/// Angular acceleration of the base over time, and the corresponding moment.
pub(super) fn fig_5_5(mut report: Report) -> Report {
    /// Time during which the tip is still far from its goal [s].
    const MOVING: f64 = 15.0;
    let run = moments(LawKind::TransposeJacobian);
    let moment = |m: &Moment| m.base_moment_B.norm();
    let moving = run.iter().take_while(|m| m.time <= MOVING);
    let mut moving: Vec<f64> = moving.map(moment).collect();
    moving.sort_by(f64::total_cmp);
    let (least, median) = (moving[0], moving[moving.len() / 2]);
    report.holds(
        "moment of the arm on the base, least while the arm moves: above 1 N m [N m]",
        least,
        least > 1.0,
    );
    report.holds(
        "moment of the arm on the base, median while the arm moves: 1 to 10 N m [N m]",
        median,
        (1.0..=10.0).contains(&median),
    );
    report.note(&format!(
        "The text: the moment on the base 'reaches 1 to 10 N m'. Here the first {MOVING} s count as motion; at its \
         peak the moment is {:.1} N m, the angular acceleration {:.4} rad/s². The values of the figure do not \
         survive.",
        largest(&run, moment),
        largest(&run, |m| m.alpha_WB_B.norm()),
    ));
    report.note(RECOVERED);
    let panel = |label: &str, value: fn(&Moment) -> Vector3<f64>| Panel {
        y_label: label.to_owned(),
        series: (0..3)
            .map(|axis| Series {
                name: ["x", "y", "z"][axis].to_owned(),
                points: run.iter().map(|m| (m.time, value(m)[axis])).collect(),
            })
            .collect(),
        ..Panel::default()
    };
    let figure = Figure {
        title: "Masutani 1995 Fig. 5.5: the base under the arm's motion, base axes".to_owned(),
        x_label: "time [s]".to_owned(),
        panels: vec![
            panel("angular acceleration [rad/s²]", |m| m.alpha_WB_B),
            panel("moment [N m]", |m| m.base_moment_B),
        ],
        ..Figure::default()
    };
    report.figures.push(("masutani-fig-5.5".to_owned(), figure));
    report
}
