//! Errors in robot descriptions.

use crate::spatial::InertiaError;
use std::fmt;

/// Why a robot description was refused. Displays as one line: `robot.urdf:12: link 'arm': <mass> value="-3" ...`.
#[derive(Debug, Clone, PartialEq)]
pub struct UrdfError {
    /// Name of the description, as given to [`Model::from_urdf`](super::super::Model::from_urdf).
    pub source_name: String,
    /// Line of the element at fault, counted from 1.
    pub line: Option<u32>,
    /// The link or joint at fault, such as `joint 'elbow'`.
    pub element: Option<String>,
    /// The problem.
    pub problem: Box<UrdfProblem>,
}

impl fmt::Display for UrdfError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.source_name)?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if let Some(element) = &self.element {
            write!(f, ": {element}")?;
        }
        write!(f, ": {}", self.problem)
    }
}

impl std::error::Error for UrdfError {}

/// A problem of an element of a robot description; its message also states the remedy.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum UrdfProblem {
    /// Not XML, or not well formed.
    #[error("not well-formed XML: {0}")]
    Xml(String),
    /// The root element is not `<robot>`.
    #[error("the root element is <{0}>; a URDF starts with <robot name=\"...\">")]
    NotARobot(String),
    /// Unexpanded macros.
    #[error(
        "<{0}> is a xacro macro; expand the file first: `pip install xacro`, `xacro robot.urdf.xacro -o robot.urdf`"
    )]
    Xacro(String),
    /// An expression of a macro.
    #[error(
        "\"{0}\" is a xacro expression; expand the file first: `pip install xacro`, `xacro robot.urdf.xacro -o robot.urdf`"
    )]
    XacroExpression(String),
    /// A robot in another format.
    #[error("the document is {0}; convert it to URDF first (docs/robots.md)")]
    OtherFormat(&'static str),
    /// Elements nested too deep.
    #[error("<{element}> is nested deeper than {limit} elements")]
    TooDeep {
        /// The element.
        element: String,
        /// The deepest nesting accepted.
        limit: usize,
    },
    /// A robot without a single link.
    #[error("the robot has no <link>; it needs at least its base")]
    NoLinks,
    /// A required element or attribute is missing.
    #[error("<{element}> has no {missing}")]
    Missing {
        /// The element that should contain it.
        element: String,
        /// The missing element or attribute, as it would be written.
        missing: &'static str,
    },
    /// An element that may occur once occurs twice.
    #[error("has more than one <{0}>; keep one")]
    Repeated(&'static str),
    /// An unknown element or attribute, which would be ignored silently.
    #[error("<{element}> cannot hold {found}; it may hold {allowed}")]
    Unknown {
        /// The element that contains it.
        element: String,
        /// The unknown element or attribute.
        found: String,
        /// The elements or attributes that it may contain.
        allowed: String,
    },
    /// An attribute that must be a number, or several.
    #[error("<{element}> {attribute}=\"{value}\" must be {wanted}")]
    Number {
        /// The element.
        element: String,
        /// The attribute.
        attribute: String,
        /// Its value.
        value: String,
        /// The expected format.
        wanted: &'static str,
    },
    /// An element whose text must be a number.
    #[error("<{element}>{value}</{element}> must be {wanted}")]
    Text {
        /// The element.
        element: String,
        /// Its text.
        value: String,
        /// The expected format.
        wanted: &'static str,
    },
    /// A spring for a joint that does not exist.
    #[error(
        "<gazebo reference=\"{name}\"> has a spring, but no joint has this name; the joints are {known}"
    )]
    SpringOfNoJoint {
        /// The name given.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// A spring for a joint that does not move.
    #[error("a fixed joint cannot have a spring; make it a moving one or drop <springStiffness>")]
    SpringOfFixedJoint,
    /// Two orientations for one frame, or one that this URDF version does not know.
    #[error("<origin> quat_xyzw=\"{value}\" {reason}")]
    Quaternion {
        /// The attribute.
        value: String,
        /// The problem.
        reason: &'static str,
    },
    /// Two links or two joints with one name.
    #[error(
        "the name is already taken on line {0}; names of links and names of joints must differ"
    )]
    DuplicateName(u32),
    /// A type that URDF does not have.
    #[error("type=\"{0}\" is unknown; it must be revolute, continuous, prismatic or fixed")]
    JointType(String),
    /// A type of URDF with more than one degree of freedom.
    #[error(
        "type=\"{0}\" is not supported: it has several degrees of freedom; use revolute, continuous, prismatic or fixed joints (the base floats by itself)"
    )]
    UnsupportedJoint(String),
    /// A mimic joint that follows one that does not exist.
    #[error("<mimic joint=\"{name}\"> is not a joint; the joints are {known}")]
    MimicOfNoJoint {
        /// The name given.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// Mimic joints that follow each other.
    #[error("mimic joints follow each other: {0}; one of them must move independently")]
    MimicCycle(String),
    /// A joint between links that do not exist.
    #[error("its {role} link '{name}' is not defined; the links are {known}")]
    UnknownLink {
        /// `parent` or `child`.
        role: &'static str,
        /// The name given.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// A joint from a link to itself.
    #[error("joins link '{0}' to itself")]
    SelfJoint(String),
    /// A link with two parents.
    #[error(
        "link '{link}' is already the child of joint '{other}'; a link has one parent (a closed loop is cut here and closed by the dynamics node's loop_closures)"
    )]
    TwoParents {
        /// The link.
        link: String,
        /// The joint that claims it first.
        other: String,
    },
    /// Links that are their own ancestors.
    #[error("the joints form a cycle: {0}; a robot is a tree with one root")]
    Cycle(String),
    /// More than one link without a parent.
    #[error(
        "{count} links have no parent ({names}); a robot is a tree with one root: join the others to it"
    )]
    SeveralRoots {
        /// Number of these links.
        count: usize,
        /// Names of these links.
        names: String,
    },
    /// Mass properties that no body can have.
    #[error("{0}")]
    Inertia(InertiaError),
    /// A moving body, or the base, without any mass.
    #[error("{0} has no mass; give the link an <inertial> with a positive mass")]
    Massless(String),
    /// An axis of length zero, or not finite.
    #[error("<axis> xyz=\"{0} {1} {2}\" has no direction; give a unit vector")]
    ZeroAxis(f64, f64, f64),
    /// An axis that is not of unit length.
    #[error("<axis> xyz=\"{axis}\" has length {length}; it must be a unit vector: xyz=\"{unit}\"")]
    NonUnitAxis {
        /// The axis given.
        axis: String,
        /// Its length.
        length: f64,
        /// The unit vector along it.
        unit: String,
    },
    /// A joint that must have limits.
    #[error(
        "a {0} joint needs <limit lower=\"..\" upper=\"..\" effort=\"..\" velocity=\"..\"/>; without a range it is continuous"
    )]
    NoLimit(&'static str),
    /// An empty range.
    #[error("<limit> lower=\"{lower}\" is above upper=\"{upper}\"; swap them")]
    Limits {
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
    },
    /// A quantity that cannot be negative.
    #[error("<{element}> {attribute}=\"{value}\" is negative; it must be zero or positive")]
    Negative {
        /// The element.
        element: &'static str,
        /// The attribute.
        attribute: &'static str,
        /// Its value.
        value: f64,
    },
    /// A visual or collision without a shape.
    #[error(
        "has no <geometry> with a <box>, <sphere>, <cylinder>, <capsule> or <mesh filename=\"..\">"
    )]
    NoGeometry,
    /// A mimic joint that would always be outside of its range.
    #[error(
        "its <limit> excludes every position that it takes while it follows joint '{0}' in its range"
    )]
    MimicRange(String),
    /// Two joints in line that move only a body without mass between them.
    #[error(
        "moves a body without mass about the same axis as joint '{0}'; without inertia between them, their motion is not determined: give the link an <inertial>, or fix one of the joints"
    )]
    NoInertiaBetween(String),
    /// A root without mass, and several joints from it.
    #[error(
        "the root has no mass, and several joints move on it ({0}); give it, or a link fixed to it, an <inertial> with a positive mass"
    )]
    MasslessRoot(String),
    /// Not even the whole robot has mass.
    #[error(
        "no link has mass; a robot that floats freely needs an <inertial> with a positive mass"
    )]
    NoMass,
}
