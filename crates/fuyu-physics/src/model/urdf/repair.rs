//! Repairs of a robot description, and their reports.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;

use super::error::UrdfError;
use crate::model::Model;
use crate::spatial::InertiaError;

/// A robot whose description may have been repaired ([`Model::repaired_from_urdf`]).
#[derive(Debug, Clone, PartialEq)]
pub struct Repaired {
    /// The robot.
    pub model: Model,
    /// The repairs, in the order of the document; empty if [`Model::from_urdf`] accepts the description.
    pub repairs: Vec<Repair>,
    /// Name of the description, for the warnings.
    pub(super) source: String,
}

/// One repair of a robot description.
#[derive(Debug, Clone, PartialEq)]
pub struct Repair {
    /// Line of the element, counted from 1.
    pub line: u32,
    /// The link or joint, such as `elbow`; empty for an element outside of links and joints.
    pub name: String,
    /// Kind of repair.
    pub kind: RepairKind,
}

/// A deviation from the requirements of URDF or physics, and the repair.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum RepairKind {
    /// An element or attribute unknown to URDF was ignored: such as `<limit> stiffness`, or `<link><foo>`.
    Ignored(String),
    /// A second element where only one is allowed was ignored: its tag.
    Repeated(&'static str),
    /// Numbers separated or followed by punctuation, or more numbers than expected; the first ones were used. The
    /// attribute as stated.
    Numbers(String),
    /// A visual or collision without a known geometry was ignored.
    NoGeometry,
    /// Link without mass, although it has an `<inertial>`: it only adds frames. Its moments of inertia, with this
    /// Frobenius norm \[kg m²\], were dropped.
    NoMass {
        /// Norm of the dropped tensor \[kg m²\].
        dropped: f64,
    },
    /// Missing products of inertia are zero.
    NoProducts,
    /// Moments of inertia that no rigid body has were replaced by the nearest valid ones
    /// ([`RigidInertia::nearest_valid`](crate::spatial::RigidInertia::nearest_valid)).
    Inertia {
        /// What is wrong with the moments.
        problem: InertiaError,
        /// Distance in the Frobenius norm \[kg m²\].
        distance: f64,
        /// The distance relative to the norm of the stated tensor; infinite if the norm is zero.
        relative: f64,
    },
    /// The joint is held, because no body that it moves has mass.
    MovesNoMass,
    /// The joint is held, because its parent, the root, has no mass: the moved link is the floating base.
    MasslessRoot,
    /// The joint is held, because its range is a single position other than zero, or because it follows a fixed joint.
    Immobile,
    /// The joint moves a body without mass that carries other bodies.
    MasslessCarrier,
    /// A link that no joint connects, and that has no mass, was ignored.
    Unconnected,
    /// A moving joint without a range has infinite limits.
    NoRange,
    /// A missing limit of effort or velocity is infinite.
    NoLimit,
    /// A range whose lower end is above the upper, or with both at zero (which some programs write for an unknown
    /// range), is replaced by infinite limits; with it, zero effort and velocity also become infinite.
    EmptyRange,
    /// An axis that is not of unit length was normalised.
    Axis {
        /// Its length.
        length: f64,
    },
    /// The range of a mimic joint was ignored, because it excludes every position that its leader allows.
    MimicRange,
    /// A spring for a joint that does not exist, or is fixed, was ignored.
    Spring,
}

impl RepairKind {
    /// Order of the warning, and its text for one and for several elements.
    fn text(&self) -> (u8, &'static str) {
        match self {
            Self::Inertia { .. } => (
                0,
                "moments of inertia that no rigid body has, replaced by the nearest valid ones",
            ),
            Self::NoMass { .. } => (1, "no mass: merged into the links that they are fixed to"),
            Self::MovesNoMass => (2, "joints that move no mass, held"),
            Self::MasslessRoot => (
                3,
                "joints from a root without mass, held: what they move is the floating base",
            ),
            Self::MasslessCarrier => (4, "joints that move a body without mass, with others on it"),
            Self::Immobile => (5, "joints that cannot move, held"),
            Self::NoRange => (6, "joints without a range, without limits"),
            Self::EmptyRange => (
                7,
                "joints whose range is empty (both ends zero, or the lower above the upper), without limits",
            ),
            Self::NoLimit => (
                8,
                "limits of effort or velocity that are not stated, infinite",
            ),
            Self::MimicRange => (
                9,
                "ranges of mimic joints that exclude every position of the joint that they follow, ignored",
            ),
            Self::Axis { .. } => (10, "axes that are not of unit length, normalised"),
            Self::NoProducts => (11, "products of inertia that are not stated, zero"),
            Self::Numbers(_) => (
                17,
                "numbers with punctuation, or more than expected, the first ones used",
            ),
            Self::Spring => (12, "springs of joints that do not move, ignored"),
            Self::Unconnected => (13, "links that no joint connects, ignored"),
            Self::Repeated(_) => (
                14,
                "elements that may occur once, all but the first ignored",
            ),
            Self::Ignored(_) => (15, "unknown elements and attributes, ignored"),
            Self::NoGeometry => (
                16,
                "visuals and collisions without a known geometry, ignored",
            ),
        }
    }

    /// Details of one repair in a warning, besides the name.
    fn detail(&self) -> String {
        match self {
            Self::Inertia {
                distance, relative, ..
            } if relative.is_finite() => {
                format!("by {distance:.1e} kg m², {}", percent(*relative))
            }
            Self::Inertia { distance, .. } => format!("by {distance:.1e} kg m²"),
            Self::NoMass { dropped } if *dropped > 0.0 => {
                format!("{dropped:.1e} kg m² dropped")
            }
            Self::Axis { length } => format!("length {length:.6}"),
            Self::Repeated(tag) => format!("<{tag}>"),
            Self::Ignored(what) | Self::Numbers(what) => what.clone(),
            _ => String::new(),
        }
    }
}

fn percent(fraction: f64) -> String {
    match fraction * 100.0 {
        small if small < 0.1 => format!("{small:.1e} %"),
        large => format!("{large:.1} %"),
    }
}

/// Largest number of names in one warning; the others are counted.
const NAMED: usize = 8;

impl Repaired {
    /// [`Model::from_urdf`] with no repairs if `strict`, otherwise [`Model::repaired_from_urdf`].
    ///
    /// # Errors
    /// As these two.
    pub fn from_urdf(xml: &str, source: &str, strict: bool) -> Result<Self, UrdfError> {
        super::compile(xml, source, !strict)
    }

    /// One line for each kind of repair, with the elements concerned; unknown elements and attributes are named once each.
    pub fn warnings(&self) -> Vec<String> {
        let mut kinds: BTreeMap<(u8, &str), Vec<&Repair>> = BTreeMap::new();
        for repair in &self.repairs {
            kinds.entry(repair.kind.text()).or_default().push(repair);
        }
        let line = |((_, text), repairs): (&(u8, &str), &Vec<&Repair>)| {
            let mut seen: Vec<(String, usize)> = Vec::new();
            let mut places: HashMap<String, usize> = HashMap::new();
            for repair in repairs {
                let named = match (&repair.kind, repair.kind.detail()) {
                    (RepairKind::Ignored(what), _) => what.clone(),
                    (_, detail) if detail.is_empty() => repair.name.clone(),
                    (_, detail) => format!("{} ({detail})", repair.name),
                };
                let place = *places.entry(named.clone()).or_insert(seen.len());
                match seen.get_mut(place) {
                    Some((_, count)) => *count += 1,
                    None => seen.push((named, 1)),
                }
            }
            let first = repairs.iter().map(|r| r.line).min().unwrap_or_default();
            let mut warning = format!("{}:{first}: {text}: ", self.source);
            for (k, (named, count)) in seen.iter().take(NAMED).enumerate() {
                let comma = if k > 0 { ", " } else { "" };
                let _ = write!(warning, "{comma}{named}");
                if *count > 1 {
                    let _ = write!(warning, " ({count} times)");
                }
            }
            if seen.len() > NAMED {
                let _ = write!(warning, " and {} more", seen.len() - NAMED);
            }
            warning
        };
        kinds.iter().map(line).collect()
    }
}
