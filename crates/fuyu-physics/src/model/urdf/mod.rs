//! From a robot description (URDF) to a [`Model`].
//!
//! `document` checks the XML, urdf-rs parses it into types, `link_tree` finds the tree. The compiler here numbers the bodies
//! depth first and welds links with fixed joints to their parents' bodies.

mod document;
mod error;
mod gazebo;
mod link_tree;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix3, Rotation3, Translation3, Unit, Vector3};

use super::{Joint, JointKind, JointLimits, Model, ModelBuilder};
use crate::spatial::{InertiaError, Pose, RigidInertia};
use document::{ElementFacts, Facts, Source, subject};
pub use error::{UrdfError, UrdfProblem};
use link_tree::LinkTree;

/// Axes whose length is this close to one are normalised: the rounding of printed decimals.
const AXIS_TOLERANCE: f64 = 1e-6;

impl Model {
    /// Compiles the robot description `xml`; `source` names it in messages, such as by its path.
    ///
    /// Any tree of revolute, continuous, prismatic and fixed joints is accepted. Bodies and joints are
    /// numbered depth first, siblings in document order. A link without `<inertial>` has no mass;
    /// fixed to a body, it only adds a named frame. The root needs no mass of its own if something
    /// fixed to it has some. Limits that the description does not state are infinite. Joints get springs from
    /// Gazebo's `<springStiffness>` and `<springReference>`.
    ///
    /// # Errors
    /// [`UrdfError`], one line with the place, the value and what would be right. Nothing is guessed:
    /// masses, inertias ([`RigidInertia::check`]), axes (unit to 1e-6), limits and the tree itself must be
    /// valid, and unknown elements are errors where they would have physical meaning.
    ///
    /// ```
    /// use fuyu_physics::model::Model;
    /// let xml = r#"<robot name="ball"><link name="base"><inertial><mass value="-1"/>
    ///   <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"#;
    /// let error = Model::from_urdf(xml, "ball.urdf").unwrap_err().to_string();
    /// assert_eq!(error, "ball.urdf:1: link 'base': mass is -1 kg; it must be positive and finite");
    /// ```
    pub fn from_urdf(xml: &str, source: &str) -> Result<Self, UrdfError> {
        let source = Source::parse(xml, source)?;
        let facts = source.check()?;
        let robot = source.typed()?;
        Compiler {
            source: &source,
            robot: &robot,
            facts: &facts,
        }
        .compile()
    }
}

struct Compiler<'a> {
    source: &'a Source<'a>,
    robot: &'a urdf_rs::Robot,
    facts: &'a Facts,
}

/// A joint to be compiled, and the body that carries it.
#[allow(non_snake_case)]
struct Pending {
    joint: usize,
    body: usize,
    /// Pose of the joint's parent link L in the body that carries it.
    X_BL: Pose,
}

impl Compiler<'_> {
    #[allow(non_snake_case)]
    fn compile(&self) -> Result<Model, UrdfError> {
        let tree = LinkTree::find(self.source, self.robot, self.facts)?;
        let inertias = (0..self.robot.links.len())
            .map(|i| self.inertia(i))
            .collect::<Result<Vec<_>, _>>()?;

        let root = &self.robot.links[tree.root].name;
        let mut builder = ModelBuilder::new(&self.robot.name, root, inertias[tree.root]);
        let mut link_of_body = vec![tree.root];
        let mut stack = Vec::new();
        // Pushed in reverse, so that siblings are popped in document order.
        let push = |stack: &mut Vec<Pending>, link: usize, body: usize, X_BL: Pose| {
            let pending = |&joint| Pending { joint, body, X_BL };
            stack.extend(tree.child_joints[link].iter().rev().map(pending));
        };
        push(&mut stack, tree.root, 0, Pose::identity());
        while let Some(Pending { joint, body, X_BL }) = stack.pop() {
            let link = tree.child_link[joint];
            let name = &self.robot.links[link].name;
            let parent = &self.robot.joints[joint].parent.link;
            let X_BJ = X_BL * self.joint_origin(joint);
            match self.joint(joint, X_BJ)? {
                Some(moving) => {
                    let moved = builder.joint_on_link(name, body, parent, moving, inertias[link]);
                    link_of_body.push(link);
                    push(&mut stack, link, moved, Pose::identity());
                }
                None => {
                    builder.weld(body, &inertias[link].expressed_in(&X_BJ));
                    builder.frame(name, body, Some(parent.clone()), X_BJ);
                    push(&mut stack, link, body, X_BJ);
                }
            }
        }

        let model = builder.build();
        for (b, body) in model.bodies().iter().enumerate() {
            let problem = if body.inertia.mass == 0.0 {
                UrdfProblem::Massless(match b {
                    0 => "the root".to_owned(),
                    _ => format!("what joint '{}' moves", model.joints()[b - 1].name),
                })
            } else if let Err(e) = body.inertia.check() {
                UrdfProblem::Inertia(e)
            } else if body
                .spatial_inertia
                .about_origin
                .to_matrix()
                .iter()
                .all(|x| x.is_finite())
            {
                continue;
            } else {
                // Each number is finite, but their products overflow.
                UrdfProblem::Inertia(InertiaError::NotFinite("inertia about the link's origin"))
            };
            return Err(self.link_error(link_of_body[b], problem));
        }
        Ok(model)
    }

    fn link_error(&self, link: usize, problem: UrdfProblem) -> UrdfError {
        let element = subject("link", &self.robot.links[link].name);
        let at = self.facts.links[link].at;
        self.source.error_at(at, Some(element), problem)
    }

    fn joint_error(&self, joint: usize, problem: UrdfProblem) -> UrdfError {
        let element = subject("joint", &self.robot.joints[joint].name);
        let at = self.facts.joints[joint].at;
        self.source.error_at(at, Some(element), problem)
    }

    /// The link's own mass properties in its frame; zero if it states none.
    #[allow(non_snake_case)]
    fn inertia(&self, link: usize) -> Result<RigidInertia, UrdfError> {
        let facts = &self.facts.links[link];
        if !facts.stated {
            return Ok(RigidInertia::zero());
        }
        let inertial = &self.robot.links[link].inertial;
        let i = &inertial.inertia;
        #[rustfmt::skip]
        let about_com = Matrix3::new(
            i.ixx, i.ixy, i.ixz,
            i.ixy, i.iyy, i.iyz,
            i.ixz, i.iyz, i.izz,
        );
        let in_inertial_frame = RigidInertia {
            mass: inertial.mass.value,
            com: Vector3::zeros(),
            about_com,
        };
        in_inertial_frame
            .check()
            .map_err(|e| self.link_error(link, UrdfProblem::Inertia(e)))?;
        let X_LI = pose(&inertial.origin, facts);
        Ok(in_inertial_frame.expressed_in(&X_LI))
    }

    fn joint_origin(&self, joint: usize) -> Pose {
        pose(&self.robot.joints[joint].origin, &self.facts.joints[joint])
    }

    /// The joint placed at `X_BJ` of its parent body, or `None` if it is fixed.
    #[allow(non_snake_case)]
    fn joint(&self, j: usize, X_BJ: Pose) -> Result<Option<Joint>, UrdfError> {
        let urdf = &self.robot.joints[j];
        let kind = match urdf.joint_type {
            urdf_rs::JointType::Revolute => JointKind::Revolute,
            urdf_rs::JointType::Continuous => JointKind::Continuous,
            urdf_rs::JointType::Prismatic => JointKind::Prismatic,
            // `document` has rejected all other types.
            _ => return Ok(None),
        };
        let (damping, friction) = urdf
            .dynamics
            .as_ref()
            .map_or((0.0, 0.0), |d| (d.damping, d.friction));
        for (attribute, value) in [("damping", damping), ("friction", friction)] {
            self.not_negative(j, "dynamics", attribute, value)?;
        }
        Ok(Some(Joint {
            name: urdf.name.clone(),
            kind,
            axis: self.axis(j)?,
            X_PJ: X_BJ,
            limits: self.limits(j, kind)?,
            damping,
            friction,
            spring: (self.facts.springs.get(&urdf.name).copied()).unwrap_or_default(),
        }))
    }

    fn axis(&self, j: usize) -> Result<Unit<Vector3<f64>>, UrdfError> {
        let axis = Vector3::from(*self.robot.joints[j].axis.xyz);
        let length = axis.norm();
        if (length - 1.0).abs() <= AXIS_TOLERANCE {
            return Ok(Unit::new_normalize(axis));
        }
        let problem = if length > 1e-9 && length.is_finite() {
            let unit = axis / length;
            let text = |v: Vector3<f64>| format!("{} {} {}", v.x, v.y, v.z);
            UrdfProblem::NonUnitAxis {
                axis: text(axis),
                length,
                unit: text(unit),
            }
        } else {
            UrdfProblem::ZeroAxis(axis.x, axis.y, axis.z)
        };
        Err(self.joint_error(j, problem))
    }

    fn limits(&self, j: usize, kind: JointKind) -> Result<JointLimits, UrdfError> {
        if !self.facts.joints[j].stated {
            return match kind {
                JointKind::Continuous => Ok(JointLimits::NONE),
                JointKind::Revolute => Err(self.joint_error(j, UrdfProblem::NoLimit("revolute"))),
                JointKind::Prismatic => Err(self.joint_error(j, UrdfProblem::NoLimit("prismatic"))),
            };
        }
        let limit = &self.robot.joints[j].limit;
        for (attribute, value) in [("effort", limit.effort), ("velocity", limit.velocity)] {
            self.not_negative(j, "limit", attribute, value)?;
        }
        let (lower, upper) = match kind {
            JointKind::Continuous => (f64::NEG_INFINITY, f64::INFINITY),
            _ => (limit.lower, limit.upper),
        };
        if lower > upper {
            return Err(self.joint_error(j, UrdfProblem::Limits { lower, upper }));
        }
        Ok(JointLimits {
            lower,
            upper,
            velocity: limit.velocity,
            effort: limit.effort,
        })
    }

    fn not_negative(
        &self,
        joint: usize,
        element: &'static str,
        attribute: &'static str,
        value: f64,
    ) -> Result<(), UrdfError> {
        if value >= 0.0 {
            return Ok(());
        }
        let problem = UrdfProblem::Negative {
            element,
            attribute,
            value,
        };
        Err(self.joint_error(joint, problem))
    }
}

/// Pose of an `<origin>`: fixed-axis roll, pitch, yaw, `R = Rz(yaw) Ry(pitch) Rx(roll)`.
fn pose(origin: &urdf_rs::Pose, facts: &ElementFacts) -> Pose {
    let [roll, pitch, yaw] = *origin.rpy;
    let rotation = facts.quaternion.map_or_else(
        || Rotation3::from_euler_angles(roll, pitch, yaw),
        |q| q.to_rotation_matrix(),
    );
    Pose::from_parts(Translation3::from(Vector3::from(*origin.xyz)), rotation)
}
