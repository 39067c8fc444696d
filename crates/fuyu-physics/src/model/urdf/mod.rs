//! From a robot description (URDF) to a [`Model`].
//!
//! `document` reads the XML, `description` extracts links and joints, `link_tree` finds the tree, `mobility` determines
//! which joints move. The compiler in this file numbers the bodies depth first and welds links with fixed joints to
//! their parents' bodies.
//!
//! Every repairable mistake in a link or joint is reported by [`document::Source::repair_at`]: an error in strict mode,
//! otherwise a [`Repair`].

mod collision;
mod description;
mod document;
mod error;
mod gazebo;
mod link_tree;
mod mobility;
mod repair;
#[cfg(test)]
mod repair_tests;
#[cfg(test)]
mod tests;

use nalgebra::{Rotation3, Translation3, Unit, Vector3};

use super::coupling::common_limits;
use super::{Joint, JointKind, JointLimits, Model, ModelBuilder};
use crate::spatial::{InertiaError, Pose, RigidInertia};
pub use collision::{CollisionElement, CollisionGeometry};
use description::{Description, Kind};
pub use document::without_surroundings;
use document::{Checked, Source, subject};
pub use error::{UrdfError, UrdfProblem};
use link_tree::LinkTree;
use mobility::Mobility;
pub use repair::{Repair, RepairKind, Repaired};

/// Axes whose length deviates from one by no more than this are normalised: rounding of printed decimals.
const AXIS_TOLERANCE: f64 = 1e-6;

impl Model {
    /// Compiles the robot description `xml`; `source` names it in messages, such as by its path.
    ///
    /// Any tree of revolute, continuous, prismatic, mimic and fixed joints is accepted. Bodies and joints are numbered
    /// depth first, siblings in document order. A link without `<inertial>` has no mass; if it is fixed to a body, it
    /// only adds a named frame. The root needs no mass of its own if a link fixed to it has mass. Limits that the
    /// description does not state are infinite. Joint springs are read from Gazebo's `<springStiffness>` and
    /// `<springReference>`.
    ///
    /// # Errors
    /// [`UrdfError`], one line with the location, the value and the remedy. Nothing is guessed: masses, inertias
    /// ([`RigidInertia::check`]), axes (unit to 1e-6), limits and the tree itself must be valid, and unknown elements
    /// are errors where they would have physical meaning. [`Model::repaired_from_urdf`] accepts more.
    ///
    /// ```
    /// use fuyu_physics::model::Model;
    /// let xml = r#"<robot name="ball"><link name="base"><inertial><mass value="-1"/>
    ///   <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"#;
    /// let error = Model::from_urdf(xml, "ball.urdf").unwrap_err().to_string();
    /// assert_eq!(error, "ball.urdf:1: link 'base': mass is -1 kg; it must be positive and finite");
    /// ```
    pub fn from_urdf(xml: &str, source: &str) -> Result<Self, UrdfError> {
        Ok(compile(xml, source, false)?.model)
    }

    /// Compiles the robot description `xml` like [`Model::from_urdf`], but repairs common mistakes that other programs
    /// accept: moments of inertia that no rigid body has, links without mass, unknown elements and attributes, missing
    /// or empty limits, axes that are not of unit length ([`RepairKind`] lists all). A valid description gives the same
    /// model as [`Model::from_urdf`].
    ///
    /// # Errors
    /// [`UrdfError`] where physics or intention are unclear: negative masses, inertias without a usable part, joints
    /// that move no mass between two others, joints with several degrees of freedom (except from a root without mass,
    /// where they are the motion of the base), names that do not exist, invalid numbers, and links that do not form a
    /// tree.
    ///
    /// ```
    /// use fuyu_physics::model::Model;
    /// let xml = r#"<robot name="rod"><link name="base"><inertial><mass value="2"/>
    ///   <inertia ixx="1" iyy="2" izz="4" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"#;
    /// let repaired = Model::repaired_from_urdf(xml, "rod.urdf")?;
    /// assert_eq!(
    ///     repaired.warnings(),
    ///     ["rod.urdf:1: moments of inertia that no rigid body has, replaced by the nearest valid ones: base (by 5.8e-1 kg m², 12.6 %)"]
    /// );
    /// # Ok::<(), fuyu_physics::model::UrdfError>(())
    /// ```
    pub fn repaired_from_urdf(xml: &str, source: &str) -> Result<Repaired, UrdfError> {
        compile(xml, source, true)
    }
}

fn compile(xml: &str, name: &str, repairs: bool) -> Checked<Repaired> {
    let text = if repairs {
        without_surroundings(xml)
    } else {
        xml.into()
    };
    let source = Source::parse(&text, name, repairs)?;
    let robot = source.description()?;
    let tree = LinkTree::find(&source, &robot)?;
    let compiler = Compiler {
        source: &source,
        robot: &robot,
        tree: &tree,
    };
    Ok(Repaired {
        model: compiler.compile()?,
        repairs: source.into_repairs(),
        source: name.to_owned(),
    })
}

struct Compiler<'a> {
    source: &'a Source<'a>,
    robot: &'a Description,
    tree: &'a LinkTree,
}

/// A joint that is still to be compiled, and the body to which its parent link is fixed.
#[allow(non_snake_case)]
struct Pending {
    joint: usize,
    body: usize,
    /// Pose of the joint's parent link L in that body.
    X_BL: Pose,
}

impl Compiler<'_> {
    #[allow(non_snake_case)]
    fn compile(&self) -> Checked<Model> {
        let (robot, tree) = (self.robot, self.tree);
        let inertias = (0..robot.links.len())
            .map(|i| self.inertia(i))
            .collect::<Result<Vec<_>, _>>()?;
        let masses: Vec<f64> = inertias.iter().map(|i| i.mass).collect();
        let mobility = self.mobility(&masses)?;

        let root = &robot.links[tree.root].name;
        let mut builder = ModelBuilder::new(&robot.name, root, inertias[tree.root]);
        let mut link_of_body = vec![tree.root];
        let mut moved_by: Vec<Option<(usize, JointLimits)>> = vec![None; robot.joints.len()];
        let mut stack = Vec::new();
        // Pushed in reverse, so that siblings are popped in document order.
        let push = |stack: &mut Vec<Pending>, link: usize, body: usize, X_BL: Pose| {
            let pending = |&joint| Pending { joint, body, X_BL };
            stack.extend(tree.child_joints[link].iter().rev().map(pending));
        };
        push(&mut stack, tree.root, 0, Pose::identity());
        while let Some(Pending { joint, body, X_BL }) = stack.pop() {
            let link = tree.child_link[joint];
            let (name, element) = (&robot.links[link].name, &robot.joints[joint]);
            let X_BJ = X_BL * element.X_LJ;
            if let (Kind::Moving(kind), None) = (&element.kind, mobility.held[joint]) {
                let moving = self.joint(joint, *kind, X_BJ)?;
                let limits = moving.limits;
                let moved =
                    builder.joint_on_link(name, body, &element.parent, moving, inertias[link]);
                moved_by[joint] = Some((moved, limits));
                link_of_body.push(link);
                push(&mut stack, link, moved, Pose::identity());
            } else {
                let q = mobility.held[joint].unwrap_or_default();
                let X_BL = X_BJ * self.moved_by(joint, q);
                builder.weld(body, &inertias[link].expressed_in(&X_BL));
                builder.frame(name, body, Some(element.parent.clone()), X_BL);
                push(&mut stack, link, body, X_BL);
            }
        }
        self.add_mimics(&mut builder, &mobility, &moved_by)?;
        let model = builder.build();
        self.check_bodies(&model, &link_of_body)?;
        Ok(model)
    }

    /// Adds the mimic couplings.
    fn add_mimics(
        &self,
        builder: &mut ModelBuilder,
        mobility: &Mobility,
        moved_by: &[Option<(usize, JointLimits)>],
    ) -> Checked<()> {
        for (j, coupling) in mobility.couplings.iter().enumerate() {
            let leader = coupling.coordinate;
            let (true, Some((follower, limits)), Some((leader, of_leader))) =
                (leader != j, &moved_by[j], &moved_by[leader])
            else {
                continue;
            };
            builder.mimic(*follower, *leader, coupling.ratio, coupling.offset);
            if common_limits(of_leader, limits, coupling).is_none() {
                let (joint, leader) = (
                    &self.robot.joints[j],
                    &self.robot.joints[coupling.coordinate],
                );
                let refused = || self.joint_error(j, UrdfProblem::MimicRange(leader.name.clone()));
                (self.source).repair_at(joint.at, &joint.name, RepairKind::MimicRange, refused)?;
            }
        }
        Ok(())
    }

    /// Checks the bodies after welding.
    fn check_bodies(&self, model: &Model, link_of_body: &[usize]) -> Checked<()> {
        for (b, body) in model.bodies().iter().enumerate() {
            let problem = if body.inertia.mass == 0.0 {
                if self.source.repairs() {
                    continue;
                }
                UrdfProblem::Massless(match b {
                    0 => "the root".to_owned(),
                    _ => format!("what joint '{}' moves", model.tree_joint(b - 1).name),
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
                // Each number is finite, but a product overflows.
                UrdfProblem::Inertia(InertiaError::NotFinite("inertia about the link's origin"))
            };
            return Err(self.link_error(link_of_body[b], problem));
        }
        Ok(())
    }

    fn link_error(&self, link: usize, problem: UrdfProblem) -> UrdfError {
        let link = &self.robot.links[link];
        let element = subject("link", &link.name);
        self.source.error_at(link.at, Some(element), problem)
    }

    fn joint_error(&self, joint: usize, problem: UrdfProblem) -> UrdfError {
        let joint = &self.robot.joints[joint];
        let element = subject("joint", &joint.name);
        self.source.error_at(joint.at, Some(element), problem)
    }

    /// Records the repair `kind` of a joint; returns the error `problem` if repairs are not allowed.
    fn repair_joint(&self, joint: usize, kind: RepairKind, problem: UrdfProblem) -> Checked<()> {
        let element = &self.robot.joints[joint];
        let refused = || self.joint_error(joint, problem);
        (self.source).repair_at(element.at, &element.name, kind, refused)
    }

    /// The link's own mass properties in its frame; zero if it has none.
    fn inertia(&self, link: usize) -> Checked<RigidInertia> {
        let element = &self.robot.links[link];
        let Some(inertial) = &element.inertial else {
            return Ok(RigidInertia::zero());
        };
        let stated = RigidInertia {
            mass: inertial.mass,
            com: Vector3::zeros(),
            about_com: inertial.about_com,
        };
        let Err(problem) = stated.check() else {
            return Ok(stated.expressed_in(&inertial.X_LI));
        };
        let norm = stated.about_com.norm();
        let refused = || self.link_error(link, UrdfProblem::Inertia(problem.clone()));
        let repair = |kind| (self.source).repair_at(element.at, &element.name, kind, refused);
        if stated.mass == 0.0 {
            repair(RepairKind::NoMass { dropped: norm })?;
            return Ok(RigidInertia::zero());
        }
        let Some((nearest, distance)) = stated.nearest_valid() else {
            return Err(refused());
        };
        repair(RepairKind::Inertia {
            problem: problem.clone(),
            distance,
            relative: distance / norm,
        })?;
        Ok(nearest.expressed_in(&inertial.X_LI))
    }

    /// Pose of a joint's child link in its joint frame at position `q`.
    fn moved_by(&self, joint: usize, q: f64) -> Pose {
        let element = &self.robot.joints[joint];
        match (&element.kind, Unit::try_new(element.axis, 1e-9)) {
            (Kind::Moving(JointKind::Prismatic), Some(axis)) => {
                Pose::from_parts(Translation3::from(*axis * q), Rotation3::identity())
            }
            (Kind::Moving(_), Some(axis)) => {
                let rotation = Rotation3::from_axis_angle(&axis, q);
                Pose::from_parts(Translation3::identity(), rotation)
            }
            _ => Pose::identity(),
        }
    }

    /// The moving joint placed at `X_BJ` of its parent body.
    #[allow(non_snake_case)]
    fn joint(&self, j: usize, kind: JointKind, X_BJ: Pose) -> Checked<Joint> {
        let element = &self.robot.joints[j];
        let (damping, friction) = (element.damping, element.friction);
        for (attribute, value) in [("damping", damping), ("friction", friction)] {
            self.not_negative(j, "dynamics", attribute, value)?;
        }
        Ok(Joint {
            name: element.name.clone(),
            kind,
            axis: self.axis(j)?,
            X_PJ: X_BJ,
            limits: self.limits(j, kind)?,
            damping,
            friction,
            spring: (self.robot.springs.get(&element.name).copied()).unwrap_or_default(),
        })
    }

    fn axis(&self, j: usize) -> Checked<Unit<Vector3<f64>>> {
        let axis = self.robot.joints[j].axis;
        let length = axis.norm();
        if (length - 1.0).abs() <= AXIS_TOLERANCE {
            return Ok(Unit::new_normalize(axis));
        }
        if length > 1e-9 && length.is_finite() {
            let unit = axis / length;
            let text = |v: Vector3<f64>| format!("{} {} {}", v.x, v.y, v.z);
            let problem = UrdfProblem::NonUnitAxis {
                axis: text(axis),
                length,
                unit: text(unit),
            };
            self.repair_joint(j, RepairKind::Axis { length }, problem)?;
            return Ok(Unit::new_normalize(axis));
        }
        let problem = UrdfProblem::ZeroAxis(axis.x, axis.y, axis.z);
        Err(self.joint_error(j, problem))
    }

    fn limits(&self, j: usize, kind: JointKind) -> Checked<JointLimits> {
        let needs_range = |name| {
            let problem = UrdfProblem::NoLimit(name);
            self.repair_joint(j, RepairKind::NoRange, problem)?;
            Ok(JointLimits::NONE)
        };
        let Some(mut limits) = self.robot.joints[j].limits else {
            return match kind {
                JointKind::Continuous => Ok(JointLimits::NONE),
                JointKind::Revolute => needs_range("revolute"),
                JointKind::Prismatic => needs_range("prismatic"),
            };
        };
        for (attribute, value) in [("effort", limits.effort), ("velocity", limits.velocity)] {
            self.not_negative(j, "limit", attribute, value)?;
        }
        let unlimited = (f64::NEG_INFINITY, f64::INFINITY);
        if kind == JointKind::Continuous {
            (limits.lower, limits.upper) = unlimited;
        }
        let JointLimits { lower, upper, .. } = limits;
        if lower > upper {
            let problem = UrdfProblem::Limits { lower, upper };
            self.repair_joint(j, RepairKind::EmptyRange, problem)?;
            (limits.lower, limits.upper) = unlimited;
        } else if (lower, upper) == (0.0, 0.0) && self.source.repairs() {
            self.note(j, RepairKind::EmptyRange);
            (limits.lower, limits.upper) = unlimited;
            for limit in [&mut limits.effort, &mut limits.velocity] {
                if *limit == 0.0 {
                    *limit = f64::INFINITY;
                }
            }
        } else if (lower, upper) == unlimited && kind != JointKind::Continuous {
            self.note(j, RepairKind::NoRange);
        }
        Ok(limits)
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
