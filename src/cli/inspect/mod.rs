//! `fuyu inspect`: mass properties, Jacobians and inertias of a robot.

mod reach;

use std::fmt::Write;
use std::path::PathBuf;

use nalgebra::{DMatrix, DVector, Isometry3, Matrix6xX, UnitQuaternion, Vector3};
use serde::Serialize;

use self::reach::{Goal, ReachReport};
use super::joint_values::{self, JointValues};
use super::table::{matrix, number, shown, width};
use super::{Failure, Numbers, print, read_model};
use crate::dynamics::{Input, State, Workspace};
use crate::model::{Frame, Joint, JointKind, Model};
use crate::spatial::{Pose, Twist};

/// Mass properties, Jacobians and reduced inertia of a robot
///
/// Prints the generalized and the fixed-base Jacobian (linear rows first: the tip's origin in
/// inertial space, in base axes), the base map (velocity of the base's centre of mass and angular velocity
/// of the base per unit joint rate at zero momentum) and the reduced inertia. SI units.
///
/// With --reach, searches for a joint motion of the free-floating robot that brings the tip to a pose in the world.
/// The base frame starts as the world frame, at rest in the posture --q. Momentum stays zero: the centre of mass
/// does not move, and the base turns with the joints, so that its attitude at the end depends on the whole motion.
/// Exit code 1 if no motion is found.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Robot description: a path or package://PACKAGE/PATH
    urdf: PathBuf,
    /// Joint positions [rad or m]: 0.5,-1,0 for all joints, or elbow=0.5,wrist=-1 for some; default: zero
    #[arg(long, value_name = "A,B,.. or NAME=A,..", allow_hyphen_values = true)]
    q: Option<JointValues>,
    /// Joint rates [rad/s or m/s]; adds momentum and kinetic energy
    #[arg(long, value_name = "A,B,.. or NAME=A,..", allow_hyphen_values = true)]
    qd: Option<JointValues>,
    /// Joint efforts [N m or N]; adds the joint accelerations of the free-floating robot
    #[arg(long, value_name = "A,B,.. or NAME=A,..", allow_hyphen_values = true)]
    tau: Option<JointValues>,
    /// Twist of the base's centre of mass in base axes [m/s, rad/s]; default: that of zero momentum
    #[arg(long, value_name = "VX,VY,VZ,WX,WY,WZ", allow_hyphen_values = true)]
    base_twist: Option<Numbers>,
    /// Link whose origin is the tip; default: tool0, or the last link that a joint moves
    #[arg(long, value_name = "LINK")]
    tip: Option<String>,
    /// Whether the free-floating robot can bring the tip to this position, and attitude, in the world [m, rad]
    #[arg(long, value_name = "X,Y,Z[,R,P,Y]", allow_hyphen_values = true)]
    reach: Option<Goal>,
    /// Refuse a description that needs repairs
    #[arg(long)]
    strict: bool,
    /// Folders with ROS packages, searched for package://PACKAGE/PATH before those of the environment
    #[arg(long, value_name = "FOLDER", value_delimiter = ',')]
    packages: Vec<PathBuf>,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// Runs `fuyu inspect`.
///
/// # Errors
/// [`Failure::Input`] for an invalid description, a wrong number of values, an unknown link, or a link that no joint
/// moves; [`Failure::Check`] if no motion to the goal is found.
pub fn run(args: Args) -> Result<(), Failure> {
    let model = read_model(&args.urdf, &args.packages, args.strict)?;
    let tip = tip(&model, args.tip.as_deref())?;
    let report = Report::new(&model, tip, &args)?;
    if args.json {
        let json = serde_json::to_string(&report)
            .map_err(|e| Failure::Runtime(format!("cannot write JSON: {e}")))?;
        print(&(json + "\n"))?;
    } else {
        print(&report.for_people(&model, tip, &args))?;
    }
    match report.reach.and_then(|reach| reach.problem) {
        None => Ok(()),
        Some(problem) => Err(Failure::Check(format!("--reach: {problem}"))),
    }
}

fn tip<'m>(model: &'m Model, name: Option<&str>) -> Result<&'m Frame, Failure> {
    let is_moved = |frame: &&Frame| frame.body > 0 || model.dof() == 0;
    let Some(name) = name else {
        // Frames are in depth-first order, so the last one is a leaf.
        let of_name = model.frame("tool0").filter(is_moved);
        let last = || model.frames().iter().rfind(is_moved);
        let tip = of_name.or_else(last).unwrap_or(&model.frames()[0]);
        return Ok(tip);
    };
    let tip = model.frame(name).ok_or_else(|| {
        let known: Vec<&str> = model.frames().iter().map(|f| f.name.as_str()).collect();
        Failure::Input(format!(
            "--tip '{name}' is not a link; the links are {}",
            known.join(", ")
        ))
    })?;
    if !is_moved(&tip) {
        let base = &model.bodies()[0].name;
        let moved = model.frames().iter().filter(is_moved);
        let moved: Vec<&str> = moved.map(|f| f.name.as_str()).collect();
        return Err(Failure::Input(format!(
            "--tip '{name}' is fixed to the base {base}, so that no joint moves it; joints move {}",
            moved.join(", ")
        )));
    }
    Ok(tip)
}

#[derive(Serialize)]
struct MomentumReport {
    linear: Vector3<f64>,
    angular: Vector3<f64>,
}

/// A pose as JSON.
#[derive(Serialize)]
struct PoseReport {
    /// \[m\]
    position: Vector3<f64>,
    /// Quaternion `x, y, z, w`.
    orientation: [f64; 4],
}

impl From<&Pose> for PoseReport {
    fn from(pose: &Pose) -> Self {
        let q = UnitQuaternion::from(pose.rotation);
        Self {
            position: pose.translation.vector,
            orientation: q.coords.into(),
        }
    }
}

/// A joint that follows another one, as JSON.
#[derive(Serialize)]
struct MimicReport {
    joint: String,
    follows: String,
    multiplier: f64,
    offset: f64,
}

#[derive(Serialize)]
struct Report {
    joints: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    mimics: Vec<MimicReport>,
    /// Link whose origin is the tip.
    tip: String,
    /// Its pose in the base frame.
    tip_pose: PoseReport,
    total_mass: f64,
    com: Vector3<f64>,
    #[serde(serialize_with = "rows")]
    generalized_jacobian: DMatrix<f64>,
    #[serde(serialize_with = "rows")]
    fixed_base_jacobian: DMatrix<f64>,
    #[serde(serialize_with = "rows")]
    base_map: DMatrix<f64>,
    #[serde(serialize_with = "rows")]
    reduced_inertia: DMatrix<f64>,
    /// Sum over the bodies in base axes; angular part about the system's centre of mass.
    #[serde(skip_serializing_if = "Option::is_none")]
    momentum: Option<MomentumReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    kinetic_energy: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    qdd: Option<Vec<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reach: Option<ReachReport>,
}

fn rows<S: serde::Serializer>(matrix: &DMatrix<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(
        matrix
            .row_iter()
            .map(|r| r.iter().copied().collect::<Vec<_>>()),
    )
}

impl Report {
    fn new(model: &Model, tip: &Frame, args: &Args) -> Result<Self, Failure> {
        let n = model.dof();
        let mut state = State::at_rest(model);
        let mut workspace = Workspace::new(model);
        state.q = joint_values::vector("--q", args.q.as_ref(), model)?;
        state.qd = joint_values::vector("--qd", args.qd.as_ref(), model)?;
        workspace.set_positions(&state.q);
        if let Some(twist) = &args.base_twist {
            let V_WB_B = base_twist(twist, &model.bodies()[0].inertia.com)?;
            // The base frame coincides with the world frame, so components in W and B are equal.
            state.set_base(&mut workspace, &Isometry3::identity(), &V_WB_B);
        }
        workspace.set_motion(&state);

        let [mut generalized, mut fixed, mut base_map] = [(); 3].map(|()| Matrix6xX::zeros(n));
        workspace.generalized_jacobian(tip, &mut generalized);
        workspace.fixed_base_jacobian(tip, &mut fixed);
        workspace.base_map(&mut base_map);
        let qdd = match &args.tau {
            None => None,
            Some(_) => {
                let mut input = Input::zero(model);
                input.efforts = joint_values::vector("--tau", args.tau.as_ref(), model)?;
                let mut qdd = DVector::zeros(n);
                workspace.accelerations(&state, &input, &mut qdd);
                Some(qdd.iter().copied().collect())
            }
        };
        let moving = args.qd.is_some() || args.base_twist.is_some();
        let momentum = workspace.carried_momentum();
        let reach = args.reach.as_ref().map(|goal| {
            let start = State::at_rest_with(model, &state.q);
            ReachReport::new(model, tip, &start, goal)
        });
        let mimics = model.mimics().map(|mimic| MimicReport {
            joint: mimic.joint.name.clone(),
            follows: model.joints()[mimic.coupling.coordinate].name.clone(),
            multiplier: mimic.coupling.ratio,
            offset: mimic.coupling.offset,
        });
        let report = Self {
            joints: model.joints().iter().map(|j| j.name.clone()).collect(),
            mimics: mimics.collect(),
            tip: tip.name.clone(),
            tip_pose: PoseReport::from(&workspace.X_BF(tip)),
            total_mass: model.total_mass(),
            com: *workspace.p_BC(),
            generalized_jacobian: to_dynamic(&generalized),
            fixed_base_jacobian: to_dynamic(&fixed),
            base_map: to_dynamic(&base_map),
            reduced_inertia: workspace.reduced_inertia().clone(),
            momentum: moving.then_some(MomentumReport {
                linear: momentum.linear,
                angular: momentum.angular,
            }),
            kinetic_energy: moving.then(|| workspace.kinetic_energy()),
            qdd,
            reach,
        };
        if report.is_finite() {
            Ok(report)
        } else {
            Err(Failure::Input(format!(
                "{}: these values overflow; are they in SI units?",
                args.urdf.display()
            )))
        }
    }

    fn is_finite(&self) -> bool {
        let momentum = self.momentum.iter();
        let momentum = momentum.flat_map(|m| m.linear.iter().chain(m.angular.iter()));
        [
            &self.generalized_jacobian,
            &self.fixed_base_jacobian,
            &self.base_map,
            &self.reduced_inertia,
        ]
        .iter()
        .flat_map(|m| m.iter())
        .chain(self.com.iter())
        .chain(self.tip_pose.position.iter())
        .chain(momentum)
        .chain(self.kinetic_energy.iter())
        .chain(self.qdd.iter().flatten())
        .all(|x| x.is_finite())
    }

    fn for_people(&self, model: &Model, tip: &Frame, args: &Args) -> String {
        const VELOCITY: [&str; 6] = ["vx", "vy", "vz", "wx", "wy", "wz"];
        let names: Vec<&str> = self.joints.iter().map(String::as_str).collect();
        let base = &model.bodies()[0].name;
        let mut out = String::new();
        let vector = |v: &Vector3<f64>| v.iter().map(|&x| number(x)).collect::<Vec<_>>().join(", ");
        let _ = writeln!(
            out,
            "{} ({}): {} moving joints, base {base}, tip {}{}\n",
            model.name(),
            args.urdf.display(),
            model.dof(),
            tip.name,
            if args.tip.is_none() {
                " (the default)"
            } else {
                ""
            }
        );
        let _ = writeln!(out, "total mass      {} kg", number(self.total_mass));
        let _ = writeln!(out, "centre of mass  {} m in {base}", vector(&self.com));
        let [x, y, z, w] = self.tip_pose.orientation;
        let attitude = [x, y, z, w].map(number).join(", ");
        let position = vector(&self.tip_pose.position);
        let _ = writeln!(
            out,
            "tip             {position} m in {base}, orientation {attitude} (x, y, z, w)"
        );
        if let (Some(momentum), Some(energy)) = (&self.momentum, self.kinetic_energy) {
            let (linear, angular) = (vector(&momentum.linear), vector(&momentum.angular));
            let _ = writeln!(
                out,
                "momentum        {linear} N s; {angular} N m s about the centre of mass"
            );
            let _ = writeln!(out, "kinetic energy  {} J", number(energy));
        }
        if let Some(reach) = &self.reach {
            reach.for_people(&mut out, model);
        }
        if model.dof() == 0 {
            return out;
        }
        joint_table(&mut out, model, self.qdd.as_deref());
        let mut section = |title: &str, rows: &[&str], values: &DMatrix<f64>| {
            let _ = writeln!(out, "\n{title}");
            matrix(&mut out, rows, &names, values);
        };
        let tip = &tip.name;
        section(
            &format!("generalized Jacobian of {tip} (free base; m/s, rad/s in base axes)"),
            &VELOCITY,
            &self.generalized_jacobian,
        );
        section(
            &format!("fixed-base Jacobian of {tip}"),
            &VELOCITY,
            &self.fixed_base_jacobian,
        );
        section(
            "base map (velocity of the base's centre of mass and angular velocity, at zero momentum)",
            &VELOCITY,
            &self.base_map,
        );
        section("reduced inertia", &names, &self.reduced_inertia);
        out
    }
}

/// Twist of the base frame, from the twist of the base's centre of mass.
fn base_twist(Numbers(values): &Numbers, com: &Vector3<f64>) -> Result<Twist, Failure> {
    let &[vx, vy, vz, wx, wy, wz] = values.as_slice() else {
        return Err(Failure::Input(format!(
            "--base-twist has {} values; give six: vx,vy,vz,wx,wy,wz",
            values.len()
        )));
    };
    let angular = Vector3::new(wx, wy, wz);
    Ok(Twist::new(
        angular,
        Vector3::new(vx, vy, vz) - angular.cross(com),
    ))
}

fn to_dynamic(matrix: &Matrix6xX<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(6, matrix.ncols(), matrix.as_slice())
}

fn joint_table(out: &mut String, model: &Model, qdd: Option<&[f64]>) {
    let kind = |joint: &Joint| match joint.kind {
        JointKind::Revolute => "revolute",
        JointKind::Continuous => "continuous",
        JointKind::Prismatic => "prismatic",
    };
    let joints = model.joints();
    let names: Vec<String> = joints.iter().map(|j| shown(&j.name)).collect();
    let width = width(names.iter().map(String::as_str));
    let _ = writeln!(out, "\njoints");
    for (j, joint) in joints.iter().enumerate() {
        let limits = &joint.limits;
        let unit = if joint.kind.is_rotational() {
            "rad"
        } else {
            "m"
        };
        let range = if limits.lower.is_finite() || limits.upper.is_finite() {
            format!(
                "{} to {} {unit}",
                number(limits.lower),
                number(limits.upper)
            )
        } else {
            "no limits".to_owned()
        };
        let moves = &model.bodies()[model.joint_body(j)];
        let mass = number(moves.inertia.mass);
        let _ = write!(
            out,
            "  {:width$}  {:10}  moves {} ({mass} kg), {range}",
            names[j],
            kind(joint),
            shown(&moves.name)
        );
        if let Some(qdd) = qdd {
            let _ = write!(out, ", acceleration {} {unit}/s2", number(qdd[j]));
        }
        out.push('\n');
    }
    for mimic in model.mimics() {
        let moves = &model.bodies()[mimic.body];
        let coupling = &mimic.coupling;
        let _ = writeln!(
            out,
            "  {} follows {}: {} times its position plus {}, moves {} ({} kg)",
            shown(&mimic.joint.name),
            names[coupling.coordinate],
            number(coupling.ratio),
            number(coupling.offset),
            shown(&moves.name),
            number(moves.inertia.mass)
        );
    }
}
