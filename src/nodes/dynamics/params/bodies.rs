//! Descriptions of bodies and their initial motion.

use nalgebra::{DVector, Isometry3, Vector3};

use crate::{
    dynamics::{State, Workspace},
    model::{Model, Repaired, without_surroundings},
    nodes::{
        placement::{declare_pose, declare_vector, finite},
        resource::Lookup,
    },
    ros::Declare,
    spatial::Twist,
};

/// A robot description: its text, and its source for error messages.
#[derive(Debug, Clone)]
pub struct Description {
    /// URDF.
    pub xml: String,
    /// File or parameter that it is from.
    pub source: String,
    /// Whether a description that needs repairs is refused; otherwise it is repaired.
    pub strict: bool,
}

/// Initial pose and velocity of a body's root frame.
#[derive(Debug, Clone)]
pub struct InitialMotion {
    /// Pose in the world.
    pub pose: Isometry3<f64>,
    /// Velocity of the frame's origin in world axes \[m/s\].
    pub velocity_W: Vector3<f64>,
    /// Angular velocity in the body's own axes \[rad/s\].
    pub angular_velocity_B: Vector3<f64>,
}

/// A free body (target), with or without joints.
#[derive(Debug, Clone)]
pub struct TargetParams {
    /// Its name, which is also the name of its frame and part of its topics (`ground_truth/NAME/odom`).
    pub name: String,
    /// Its description.
    pub description: Description,
    /// Initial pose and velocity of its root frame.
    pub motion: InitialMotion,
    /// Initial joint positions and rates.
    pub joints: InitialJoints,
}

/// Initial joint positions and rates of a target, in the order of its description; empty means zero.
#[derive(Debug, Clone, Default)]
pub struct InitialJoints {
    /// Positions \[rad or m\].
    pub positions: Vec<f64>,
    /// Rates \[rad/s or m/s\].
    pub velocities: Vec<f64>,
}

impl InitialJoints {
    /// Declares `TARGET.initial_joint_positions` and `.initial_joint_velocities`, and reads them.
    pub(super) fn declare(declare: &mut Declare, target: &str) -> Self {
        let mut list =
            |name: &str, what: &str| finite_list(declare, &format!("{target}.{name}"), what);
        Self {
            positions: list(
                "initial_joint_positions",
                "Joint positions of the target at the start, in its joint order [rad or m]; empty is zero",
            ),
            velocities: list(
                "initial_joint_velocities",
                "Joint rates of the target at the start [rad/s or m/s]; empty is zero",
            ),
        }
    }

    /// Sets the joint positions and rates in `state`.
    ///
    /// # Errors
    /// A line that names the parameter if the number of values is not the number of joints.
    pub fn place(&self, target: &str, state: &mut State) -> Result<(), String> {
        let joints = state.q.len();
        let of = |name: &str, values: &[f64]| {
            let parameter = format!("{target}.{name}");
            joint_vector_of(&format!("target {target}"), &parameter, values, joints)
        };
        state.q = of("initial_joint_positions", &self.positions)?;
        state.qd = of("initial_joint_velocities", &self.velocities)?;
        Ok(())
    }
}

impl Description {
    /// A description from the URDF text `xml`; unless `strict`, it is repaired so that viewers accept it, too.
    pub fn new(xml: String, source: String, strict: bool) -> Self {
        let xml = if strict {
            xml
        } else {
            without_surroundings(&xml).into_owned()
        };
        Self {
            xml,
            source,
            strict,
        }
    }

    /// Reads the file that a parameter names.
    pub(super) fn read(
        parameter: &str,
        file: &str,
        lookup: &Lookup,
        strict: bool,
    ) -> Result<Self, String> {
        let read = lookup
            .read(file)
            .map_err(|e| format!("parameter {parameter}: {e}"))?;
        Ok(Self::new(read.0, read.1, strict))
    }

    /// Compiles the model.
    ///
    /// # Errors
    /// A line that names the source and the mistake.
    pub fn compile(&self) -> Result<Model, String> {
        self.repair().map(|repaired| repaired.model)
    }

    /// The repairs made to the description, one line per kind.
    pub fn warnings(&self) -> Vec<String> {
        self.repair()
            .map_or_else(|_| Vec::new(), |repaired| repaired.warnings())
    }

    fn repair(&self) -> Result<Repaired, String> {
        Repaired::from_urdf(&self.xml, &self.source, self.strict).map_err(|e| e.to_string())
    }
}

impl InitialMotion {
    /// Declares `PREFIX.position`, `.orientation`, `.velocity` and `.angular_velocity`, and reads them.
    pub(super) fn declare(declare: &mut Declare, prefix: &str, what: &str) -> Result<Self, String> {
        let pose = declare_pose(declare, prefix, what, false);
        let velocity = format!("Velocity of the {what} in world axes at the start [m/s]");
        let velocity_W = declare_vector(declare, &format!("{prefix}.velocity"), &velocity);
        let angular =
            format!("Angular velocity of the {what} in its own axes at the start [rad/s]");
        let angular_velocity_B =
            declare_vector(declare, &format!("{prefix}.angular_velocity"), &angular);
        Ok(Self {
            pose: pose?.unwrap_or_default(),
            velocity_W,
            angular_velocity_B,
        })
    }

    /// Sets the pose and velocity of the base of `model` in `state`.
    pub fn place(&self, model: &Model, state: &mut State) {
        let (X_WB, V_WB_B) = self.motion();
        state.set_base(&mut Workspace::new(model), &X_WB, &V_WB_B);
    }

    /// Pose in the world, and twist of the frame's origin in the frame's own axes.
    pub fn motion(&self) -> (Isometry3<f64>, Twist) {
        let linear_B = self.pose.rotation.inverse() * self.velocity_W;
        (self.pose, Twist::new(self.angular_velocity_B, linear_B))
    }
}

/// Declares a list of finite numbers, one per joint or empty.
pub(super) fn finite_list(declare: &mut Declare, name: &str, description: &str) -> Vec<f64> {
    (declare.param(name, Vec::<f64>::new(), description))
        .read_only()
        .check("finite numbers, one per joint, or none", |v| {
            finite(v, v.len())
        })
        .value()
}

/// The values as a joint vector; an empty list means zero.
///
/// # Errors
/// A line that names the parameter if the number of values is not the number of joints.
pub(in crate::nodes::dynamics) fn joint_vector(
    name: &str,
    values: &[f64],
    joints: usize,
) -> Result<DVector<f64>, String> {
    joint_vector_of("the robot", name, values, joints)
}

/// As [`joint_vector`], for the joints of `body`.
fn joint_vector_of(
    body: &str,
    name: &str,
    values: &[f64],
    joints: usize,
) -> Result<DVector<f64>, String> {
    match values.len() {
        0 => Ok(DVector::zeros(joints)),
        n if n == joints => Ok(DVector::from_row_slice(values)),
        n => Err(format!(
            "parameter {name} has {n} values; {body} has {joints} joints"
        )),
    }
}
