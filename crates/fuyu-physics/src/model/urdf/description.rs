//! Links and joints as stated in a robot description.

use std::collections::HashMap;

use nalgebra::{Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};
use roxmltree::Node;

use super::document::{Checked, Source, absent, unknown, version};
use super::error::UrdfProblem;
use super::repair::RepairKind;
use crate::model::{JointKind, JointLimits, Spring};
use crate::spatial::Pose;

/// A robot description: links and joints in document order.
pub(super) struct Description {
    pub name: String,
    pub links: Vec<Link>,
    pub joints: Vec<JointElement>,
    /// Springs by the names of their joints.
    pub springs: HashMap<String, Spring>,
}

/// A link.
pub(super) struct Link {
    pub name: String,
    /// Byte offset, for the line number of a message.
    pub at: usize,
    pub inertial: Option<Inertial>,
}

/// Mass properties of a link, in the frame I of its `<inertial>`.
pub(super) struct Inertial {
    pub X_LI: Pose,
    pub mass: f64,
    pub about_com: Matrix3<f64>,
}

/// A joint.
pub(super) struct JointElement {
    pub name: String,
    /// Byte offset, for the line number of a message.
    pub at: usize,
    pub kind: Kind,
    pub parent: String,
    pub child: String,
    /// Pose of the joint frame in the parent link.
    pub X_LJ: Pose,
    pub axis: Vector3<f64>,
    /// `None` if there is no `<limit>`.
    pub limits: Option<JointLimits>,
    pub damping: f64,
    pub friction: f64,
    pub mimic: Option<MimicElement>,
}

/// Type of a joint.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Kind {
    Fixed,
    Moving(JointKind),
    /// A URDF type with several degrees of freedom.
    Several(String),
}

/// The `<mimic>` of a joint.
pub(super) struct MimicElement {
    /// The leading joint.
    pub joint: String,
    pub ratio: f64,
    pub offset: f64,
    pub at: usize,
}

/// Elements that `<robot>` may hold besides links and joints without a warning.
const OF_ROBOT: [&str; 8] = [
    "link",
    "joint",
    "material",
    "gazebo",
    "transmission",
    "ros2_control",
    "sensor",
    "visual",
];

/// Elements that `<link>` may hold without a warning: contacts and sensors are for other programs.
const OF_LINK: [&str; 7] = [
    "inertial",
    "visual",
    "collision",
    "contact",
    "sensor",
    "self_collision_checking",
    "material",
];

const OF_JOINT: [&str; 9] = [
    "origin",
    "parent",
    "child",
    "axis",
    "limit",
    "dynamics",
    "calibration",
    "safety_controller",
    "mimic",
];

impl Source<'_> {
    /// All links and joints, checked one by one.
    pub fn description(&self) -> Checked<Description> {
        let robot = self.robot()?;
        let version = version(robot);
        if self.repairs() {
            self.only_children(robot, &OF_ROBOT)?;
        }
        let (mut links, mut joints) = (Vec::new(), Vec::new());
        for node in robot.children().filter(Node::is_element) {
            match node.tag_name().name() {
                "link" => links.push(self.link(node, version)?),
                "joint" => joints.push(self.joint(node, version)?),
                _ => {}
            }
        }
        let springs = self.springs(robot)?;
        if links.is_empty() {
            return Err(self.error(robot, UrdfProblem::NoLinks));
        }
        Ok(Description {
            name: robot.attribute("name").unwrap_or_default().to_owned(),
            links,
            joints,
            springs,
        })
    }

    fn link(&self, link: Node, version: (u32, u32)) -> Checked<Link> {
        let name = self.required(link, "name", "attribute 'name'")?;
        for child in link.children().filter(Node::is_element) {
            let holds_mass = |n: &Node| matches!(n.tag_name().name(), "mass" | "inertia");
            let tag = child.tag_name().name();
            if holds_mass(&child) || (tag != "inertial" && child.children().any(|n| holds_mass(&n)))
            {
                // Ignoring it would lose mass.
                return Err(self.error(child, unknown(link, format!("<{tag}>"), &["inertial"])));
            } else if matches!(tag, "visual" | "collision") {
                self.check_geometry(child)?;
            }
        }
        if self.repairs() {
            self.only_children(link, &OF_LINK)?;
        }
        let inertial = self.only_child(link, "inertial")?;
        let inertial = inertial.map(|node| self.inertial(node, version));
        Ok(Link {
            name: name.to_owned(),
            at: link.range().start,
            inertial: inertial.transpose()?.flatten(),
        })
    }

    /// Checks the geometry of a `<visual>`: it has no effect, but an unknown one is likely to be a mistake.
    fn check_geometry(&self, visual: Node) -> Checked<()> {
        let known = |n: &Node| {
            let tag = n.tag_name().name();
            matches!(tag, "box" | "sphere" | "cylinder" | "capsule")
                || tag == "mesh" && n.has_attribute("filename")
        };
        let mut geometries = visual.children().filter(|n| n.has_tag_name("geometry"));
        if geometries.any(|g| g.children().any(|n| known(&n))) {
            return Ok(());
        }
        self.repair(visual, RepairKind::NoGeometry, UrdfProblem::NoGeometry)
    }

    /// The mass properties of an `<inertial>`; `None` if it has no mass and may be repaired.
    fn inertial(&self, inertial: Node, version: (u32, u32)) -> Checked<Option<Inertial>> {
        self.only_children(inertial, &["origin", "mass", "inertia"])?;
        let X_LI = self.origin(inertial, version)?;
        let no_mass = || absent(inertial, "<mass value=\"..\"/>");
        let Some(mass) = self.only_child(inertial, "mass")? else {
            let kind = RepairKind::NoMass { dropped: 0.0 };
            self.repair(inertial, kind, no_mass())?;
            return Ok(None);
        };
        let mass = self.required_number(mass, "value", "attribute 'value'")?;
        let mut moments = [0.0; 6];
        if let Some(inertia) = self.only_child(inertial, "inertia")? {
            for (moment, (name, missing)) in moments.iter_mut().zip([
                ("ixx", "attribute 'ixx'"),
                ("ixy", "attribute 'ixy'"),
                ("ixz", "attribute 'ixz'"),
                ("iyy", "attribute 'iyy'"),
                ("iyz", "attribute 'iyz'"),
                ("izz", "attribute 'izz'"),
            ]) {
                match self.number(inertia, name)? {
                    Some(stated) => *moment = stated,
                    None if matches!(name, "ixy" | "ixz" | "iyz") => {
                        let problem = absent(inertia, missing);
                        self.repair(inertia, RepairKind::NoProducts, problem)?;
                    }
                    None => return Err(self.error(inertia, absent(inertia, missing))),
                }
            }
        } else if !self.repairs() {
            return Err(self.error(inertial, absent(inertial, "<inertia ixx=\"..\" ../>")));
        }
        let [xx, xy, xz, yy, yz, zz] = moments;
        #[rustfmt::skip]
        let about_com = Matrix3::new(
            xx, xy, xz,
            xy, yy, yz,
            xz, yz, zz,
        );
        Ok(Some(Inertial {
            X_LI,
            mass,
            about_com,
        }))
    }

    fn joint(&self, joint: Node, version: (u32, u32)) -> Checked<JointElement> {
        let name = self.required(joint, "name", "attribute 'name'")?;
        let kind = match self.required(joint, "type", "attribute 'type'")? {
            "revolute" => Kind::Moving(JointKind::Revolute),
            "continuous" => Kind::Moving(JointKind::Continuous),
            "prismatic" => Kind::Moving(JointKind::Prismatic),
            "fixed" => Kind::Fixed,
            known @ ("planar" | "floating" | "spherical") => {
                let problem = UrdfProblem::UnsupportedJoint(known.to_owned());
                if !self.repairs() {
                    return Err(self.error(joint, problem));
                }
                // At a root without mass, this joint's motion is the motion of the base.
                Kind::Several(known.to_owned())
            }
            other => return Err(self.error(joint, UrdfProblem::JointType(other.to_owned()))),
        };
        self.only_children(joint, &OF_JOINT)?;
        let end = |tag: &'static str, missing| {
            let end = self.child(joint, tag, missing)?;
            Ok(self.required(end, "link", "attribute 'link'")?.to_owned())
        };
        let parent = end("parent", "<parent link=\"..\"/>")?;
        let child = end("child", "<child link=\"..\"/>")?;
        let mut direction = Vector3::x();
        if let Some(axis) = self.only_child(joint, "axis")? {
            self.required(axis, "xyz", "attribute 'xyz'")?;
            let xyz = self.numbers::<3>(axis, "xyz", "three finite numbers")?;
            direction = xyz.unwrap_or_default().into();
        }
        let limit = self.only_child(joint, "limit")?;
        let limits = limit.map(|limit| self.limits(limit, version)).transpose()?;
        let (mut damping, mut friction) = (0.0, 0.0);
        if let Some(dynamics) = self.only_child(joint, "dynamics")? {
            damping = self.number(dynamics, "damping")?.unwrap_or_default();
            friction = self.number(dynamics, "friction")?.unwrap_or_default();
            let known = ["damping", "friction"];
            // Simulators add their own attributes, which are accepted in addition to these, but not instead of them.
            if !known.iter().any(|&a| dynamics.has_attribute(a)) {
                self.only_attributes(dynamics, &known)?;
            }
        }
        let mimic = self.only_child(joint, "mimic")?;
        let mimic = mimic.map(|mimic| {
            Ok(MimicElement {
                joint: self
                    .required(mimic, "joint", "attribute 'joint'")?
                    .to_owned(),
                ratio: self.number(mimic, "multiplier")?.unwrap_or(1.0),
                offset: self.number(mimic, "offset")?.unwrap_or_default(),
                at: mimic.range().start,
            })
        });
        Ok(JointElement {
            name: name.to_owned(),
            at: joint.range().start,
            kind,
            parent,
            child,
            X_LJ: self.origin(joint, version)?,
            axis: direction,
            limits,
            damping,
            friction,
            mimic: mimic.transpose()?,
        })
    }

    /// The limits; infinite where they are missing and may be repaired.
    fn limits(&self, limit: Node, version: (u32, u32)) -> Checked<JointLimits> {
        let known = [
            "lower",
            "upper",
            "effort",
            "velocity",
            "acceleration",
            "deceleration",
            "jerk",
        ];
        self.only_attributes(limit, &known)?;
        let [lower, upper, effort, velocity, ..] = known;
        for unused in &known[4..] {
            self.number(limit, unused)?;
        }
        let (low, high) = (self.number(limit, lower)?, self.number(limit, upper)?);
        // Since URDF 1.2, missing limits mean unlimited; before, effort and velocity are required, and missing ends of
        // the range are 0.
        let actuator = |name: &str, missing| match self.number(limit, name)? {
            Some(stated) => Ok(stated),
            None if version >= (1, 2) => Ok(f64::INFINITY),
            None => {
                self.repair(limit, RepairKind::NoLimit, absent(limit, missing))?;
                Ok(f64::INFINITY)
            }
        };
        let effort = actuator(effort, "attribute 'effort'")?;
        let velocity = actuator(velocity, "attribute 'velocity'")?;
        let without_range = low.is_none() && high.is_none() && self.repairs();
        let (lower, upper) = if version >= (1, 2) || without_range {
            (f64::NEG_INFINITY, f64::INFINITY)
        } else {
            (0.0, 0.0)
        };
        Ok(JointLimits {
            lower: low.unwrap_or(lower),
            upper: high.unwrap_or(upper),
            velocity,
            effort,
        })
    }

    /// The pose of the `<origin>` of `parent`: fixed-axis roll, pitch, yaw, `R = Rz(yaw) Ry(pitch) Rx(roll)`, or the
    /// quaternion of URDF 1.1.
    pub(super) fn origin(&self, parent: Node, version: (u32, u32)) -> Checked<Pose> {
        let Some(origin) = self.only_child(parent, "origin")? else {
            return Ok(Pose::identity());
        };
        self.only_attributes(origin, &["xyz", "rpy", "quat_xyzw"])?;
        let xyz = self.numbers::<3>(origin, "xyz", "three finite numbers")?;
        let rpy = self.numbers::<3>(origin, "rpy", "three finite numbers")?;
        let translation = Translation3::from(Vector3::from(xyz.unwrap_or_default()));
        let [roll, pitch, yaw] = rpy.unwrap_or_default();
        let Some(q) = self.numbers::<4>(origin, "quat_xyzw", "four finite numbers")? else {
            let rotation = Rotation3::from_euler_angles(roll, pitch, yaw);
            return Ok(Pose::from_parts(translation, rotation));
        };
        let quaternion = Quaternion::from(q);
        let reason = if version < (1, 1) {
            "needs <robot version=\"1.1\"> or later; without it, give rpy"
        } else if origin.has_attribute("rpy") {
            "is given together with rpy; keep one of them"
        } else if (quaternion.norm() - 1.0).abs() > 1e-6 {
            "must be a unit quaternion"
        } else {
            let rotation = UnitQuaternion::new_normalize(quaternion).to_rotation_matrix();
            return Ok(Pose::from_parts(translation, rotation));
        };
        let value = origin.attribute("quat_xyzw").unwrap_or_default().to_owned();
        Err(self.error(origin, UrdfProblem::Quaternion { value, reason }))
    }
}
