//! Teleoperation, Masutani 1995 chapter 8: the positioning experiment with an operator in the loop, and the arm for
//! the maps of the operability indices.
//!
//! The operator of the thesis was a man of 24 with a stereo view of the scene; here it is [`Operator`], the same for every
//! method and every target. The arm of the thesis has joints without inertia; here it has a servo of finite bandwidth on the
//! full dynamics. Neither the arm of Fig. 8.4 nor the eight targets are printed. Here the arm is that of Fig. 5.2 without its
//! wrist (as in chapter 7), which has the three joints that the inverses of the text need, and the targets are the corners of a cube.

use nalgebra::{DVector, Matrix3, Matrix6xX, Point3, Translation3, Vector3};

use crate::control::{
    JacobianKind, Operator, OperatorConfig, Resolution, ResolvedRate, ResolvedRateConfig,
    ServoGains, VelocityServo, VelocityServoConfig,
};
use crate::dynamics::{Floating, IntegrationMethod, State, Workspace};
use crate::model::{Frame, Model};
use crate::spatial::{Pose, Twist};

/// Whether the base moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Base {
    /// Fixed: its mass is a million times larger.
    Fixed,
    /// Floating.
    Free,
}

/// Initial position of the tip in the base frame \[m\]; section 8.3.
pub const START: [f64; 3] = [0.0, 2.5, 1.5];

/// Distance of the targets from the start \[m\]; section 8.3.
pub const DISTANCE: f64 = 0.5;

/// Largest command along each axis \[m/s\]; section 8.3.
pub const FULL_SPEED: f64 = 0.5;

/// The tip has arrived if it stays within this distance of the target \[m\]; not printed.
pub const ARRIVED: f64 = 0.01;

/// Bandwidth of the joints' servo \[rad/s\]. The thesis takes it as unlimited.
pub const BANDWIDTH: f64 = 20.0;

/// Crossover frequency of the operator \[rad/s\]: the only number fitted to the six means of [`PUBLISHED`].
pub const CROSSOVER: f64 = 0.8;

/// Time from one sample of operator, steering and servo to the next \[s\].
pub const PERIOD: f64 = 0.01;

/// Longest duration of an attempt \[s\].
pub const MAX_DURATION: f64 = 40.0;

/// The servicer of Fig. 5.2 without links 4 to 6.
pub fn model(base: Base) -> Model {
    let xml = include_str!("../../urdf/servicer.urdf");
    let (arm, _) = (xml.split_once("<joint name=\"joint4\"")).expect("the servicer has a wrist");
    let mut xml = format!(
        "{arm}<joint name=\"tool0_joint\" type=\"fixed\"><parent link=\"link3\"/><child link=\"tool0\"/>\
         <origin xyz=\"2.5 0 0\"/></joint><link name=\"tool0\"/></robot>"
    );
    if base == Base::Fixed {
        for value in ["2000", "1400", "2040"] {
            xml = xml.replace(&format!("\"{value}\""), &format!("\"{value}e6\""));
        }
    }
    Model::from_urdf(&xml, "servicer without its wrist").expect("it is well formed")
}

/// The planar arm of Fig. 4.4, with recovered parameters: the base has 20 times the mass of the arm. Its links are
/// those of Table 6.2.
pub fn planar_model() -> Model {
    let mut xml = include_str!("../../urdf/planar_two_link.urdf").to_owned();
    for (table_6_2, fig_4_4) in [
        ("<mass value=\"500\"/>", "<mass value=\"2000\"/>"),
        ("\"148.82\"", "\"1500\""),
        ("xyz=\"1.1 0 0\"", "xyz=\"1.75 0 0\""),
    ] {
        assert!(xml.contains(table_6_2), "the planar robot has {table_6_2}");
        xml = xml.replace(table_6_2, fig_4_4);
    }
    Model::from_urdf(&xml, "planar arm of Fig. 4.4").expect("it is well formed")
}

/// The eight targets in the world, whose origin is the initial position of the base.
pub fn targets() -> [Vector3<f64>; 8] {
    std::array::from_fn(|i| {
        let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let corner = Vector3::new(sign(0), sign(1), sign(2));
        Vector3::from(START) + corner.normalize() * DISTANCE
    })
}

/// An operator trained with a method: the gain along each axis is divided by the tip's initial velocity per unit of
/// command, so that the crossover frequency is [`CROSSOVER`] for every method.
pub fn operator(base: Base, method: Resolution) -> OperatorConfig {
    let model = model(base);
    let tip = tip(&model);
    let mut workspace = Workspace::new(&model);
    workspace.set_positions(&start(&model));
    let default = OperatorConfig::default();
    let response = velocity_per_command(&model, &workspace, &tip, method);
    OperatorConfig {
        gain: response.diagonal().map(|velocity| CROSSOVER / velocity),
        full_speed: FULL_SPEED,
        ..default
    }
}

/// Tip velocity in the world per unit of command, at rest; base axes.
fn velocity_per_command(
    model: &Model,
    workspace: &Workspace,
    tip: &Frame,
    method: Resolution,
) -> Matrix3<f64> {
    let mut generalized = Matrix6xX::zeros(model.dof());
    let mut own = generalized.clone();
    workspace.generalized_jacobian(tip, &mut generalized);
    match method.jacobian() {
        JacobianKind::Generalized => own.copy_from(&generalized),
        JacobianKind::FixedBase => workspace.fixed_base_jacobian(tip, &mut own),
    }
    let linear = |J: &Matrix6xX<f64>| -> Matrix3<f64> { J.fixed_view::<3, 3>(0, 0).into() };
    let (generalized, own) = (linear(&generalized), linear(&own));
    match method.inverts() {
        true => generalized * own.try_inverse().expect("the start is not singular"),
        false => generalized * own.transpose(),
    }
}

fn tip(model: &Model) -> Frame {
    model.frame("tool0").expect("the arm has a tip").clone()
}

/// Joint positions with the tip at [`START`].
pub fn start(model: &Model) -> DVector<f64> {
    let tip = tip(model);
    let mut workspace = Workspace::new(model);
    let mut matrix = Matrix6xX::zeros(3);
    let mut q = DVector::from_row_slice(&[0.0, 2.3, -2.4]);
    for _ in 0..50 {
        workspace.set_positions(&q);
        let off = Vector3::from(START) - workspace.X_BF(&tip).translation.vector;
        workspace.fixed_base_jacobian(&tip, &mut matrix);
        let J: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into();
        let step = J.try_inverse().expect("no posture on the way is singular") * off;
        q += DVector::from_column_slice(step.as_slice());
    }
    q
}

/// Result of an attempt.
#[derive(Debug, Clone, PartialEq)]
pub struct Attempt {
    /// Time after which the tip stayed within [`ARRIVED`] \[s\]; infinite if it did not.
    pub time: f64,
    /// Length of the tip's path in the world divided by the distance of the target.
    pub path_ratio: f64,
    /// Rotation of the base at the end \[rad\].
    pub base_turn: f64,
    /// Largest distance of the tip from the straight line to the target, in the world \[m\].
    pub deviation: f64,
    /// The tip in the world every [`PERIOD`] \[m\].
    pub path: Vec<Vector3<f64>>,
}

/// An operator brings the tip to a target at rest in the world.
pub fn attempt(base: Base, method: Resolution, target: &Vector3<f64>) -> Attempt {
    attempt_by(base, method, target, operator(base, method))
}

/// [`attempt`] with the given operator.
pub fn attempt_by(
    base: Base,
    method: Resolution,
    target: &Vector3<f64>,
    operator: OperatorConfig,
) -> Attempt {
    let model = model(base);
    let tip = tip(&model);
    let config = ResolvedRateConfig {
        method,
        components: [true, true, true, false, false, false],
        ..ResolvedRateConfig::default()
    };
    let servo = VelocityServoConfig {
        gains: ServoGains::Bandwidth(BANDWIDTH),
        integral: 0.0,
    };
    let mut servo = VelocityServo::new(&model, servo).expect("the gains are positive");
    let mut resolver = ResolvedRate::new(&model, &tip, config);
    let mut workspace = Workspace::new(&model);
    let mut rates = DVector::zeros(model.dof());
    let mut operator = Operator::new(operator);
    let state = State::at_rest_with(&model, &start(&model));
    let mut robot = Floating::new(model, state, IntegrationMethod::Rk4);
    let mut path = Vec::new();
    let mut arrived = None;
    // The tip must stay at the target for this time [s].
    const SETTLED: f64 = 3.0;
    for step in 0.. {
        let time = f64::from(step) * PERIOD;
        let X_WB = robot.state().X_WB(robot.workspace());
        let p_BE = robot.workspace().X_BF(&tip).translation.vector;
        path.push((X_WB * Point3::from(p_BE)).coords);
        let displacement = (X_WB.inverse() * Point3::from(*target)).coords - p_BE;
        arrived = match displacement.norm() <= ARRIVED {
            true => arrived.or(Some(time)),
            false => None,
        };
        let over = arrived.is_some_and(|since| time - since >= SETTLED);
        if over || time >= MAX_DURATION {
            break;
        }
        let command = Twist::new(Vector3::zeros(), operator.command(time, &displacement));
        let q = &robot.state().q;
        resolver.rates(robot.model(), &mut workspace, q, &command, &mut rates);
        for (j, rate) in rates.iter().enumerate() {
            servo.set_reference(robot.model(), j, *rate);
        }
        let efforts = servo.efforts(robot.model(), robot.state(), PERIOD);
        robot.hold_efforts(efforts.as_slice());
        robot.step(PERIOD, 1);
    }
    let straight = (target - path[0]).normalize();
    let off = |p: &Vector3<f64>| (p - path[0]).cross(&straight).norm();
    let X_WB: Pose = robot.state().X_WB(robot.workspace());
    let steps = path.windows(2).map(|w| (w[1] - w[0]).norm());
    Attempt {
        time: arrived.unwrap_or(f64::INFINITY),
        path_ratio: steps.sum::<f64>() / DISTANCE,
        base_turn: X_WB.rotation.angle(),
        deviation: path.iter().map(off).fold(0.0, f64::max),
        path,
    }
}

/// The six experiments of Fig. 8.7, in the order of its table.
pub const EXPERIMENTS: [(Base, Resolution); 6] = [
    (Base::Fixed, Resolution::InverseFixedBase),
    (Base::Fixed, Resolution::TransposeFixedBase),
    (Base::Free, Resolution::InverseGeneralized),
    (Base::Free, Resolution::InverseFixedBase),
    (Base::Free, Resolution::TransposeGeneralized),
    (Base::Free, Resolution::TransposeFixedBase),
];

/// Mean and standard deviation of the times \[s\] in the table below Fig. 8.7, in the order of [`EXPERIMENTS`].
pub const PUBLISHED: [(f64, f64); 6] = [
    (4.89, 2.34),
    (3.56, 1.71),
    (4.70, 1.44),
    (4.65, 1.80),
    (5.54, 2.74),
    (5.39, 1.75),
];

/// Joint positions of the planar arm with `q₂ > 0` for which its tip is at `(x, y)` in the base frame; `None` if out of
/// reach.
pub fn planar_posture(x: f64, y: f64) -> Option<[f64; 2]> {
    const MOUNT: f64 = 1.75;
    const LINK: f64 = 2.5;
    let tip = Translation3::new(x - MOUNT, y, 0.0).vector;
    let cosine = tip.norm_squared() / (2.0 * LINK * LINK) - 1.0;
    if cosine.abs() >= 1.0 {
        return None;
    }
    let q2 = cosine.acos();
    Some([tip.y.atan2(tip.x) - 0.5 * q2, q2])
}
