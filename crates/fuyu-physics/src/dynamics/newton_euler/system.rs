//! Systems of bodies and hinges, and their builder.

use std::collections::HashMap;

use nalgebra::{UnitQuaternion, Vector3};

use super::gear::Gear;
use super::{Axis, Freedom, SystemError};
use crate::model::Spring;
use crate::spatial::{InertiaError, Pose, RigidInertia};

/// Name of inertial space in hinge descriptions.
pub const INERTIAL: &str = "inertial";

/// A rigid body of a [`System`].
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Name, unique among bodies.
    pub name: String,
    /// Mass properties in the body's frame.
    pub inertia: RigidInertia,
}

/// A hinge between two bodies, or between inertial space and a body.
///
/// Its frame M is fixed to the inner body and its frame N to the outer one; they coincide at zero displacement.
/// Translations are those of N's origin along M's axes. A single free rotation is about the axis common to the two
/// frames. Two free rotations are those of a Hooke joint: TR-942 eq. (2.2.4) constrains the third component of the
/// relative angular velocity along M's axes, which for two free rotations cannot be integrated to a position; here the
/// third direction is perpendicular to the free two. Three free rotations are measured by the rotation vector, on whose
/// components springs act; these are conservative if all three are equally stiff.
#[derive(Debug, Clone, PartialEq)]
pub struct Hinge {
    /// Name, unique among hinges.
    pub name: String,
    /// Name of the inner body, `m(i)` in TR-942, or [`INERTIAL`].
    pub inner: String,
    /// Name of the outer body, `n(i)` in TR-942, or [`INERTIAL`].
    pub outer: String,
    /// Pose of M in the inner body's frame.
    pub X_BM: Pose,
    /// Pose of N in the outer body's frame.
    pub X_BN: Pose,
    /// The free axes.
    pub freedom: Freedom,
    /// Springs on the free axes, `K_s` and `K_w` of eqs. (2.2.20)-(2.2.21) \[N/m, N m/rad\].
    pub springs: [Spring; 6],
    /// Dampers on the free axes, `D_s` and `D_w` of eqs. (2.2.20)-(2.2.21) \[N s/m, N m s/rad\].
    pub damping: [f64; 6],
}

impl Hinge {
    /// A hinge at the origins of the two bodies' frames, without springs and dampers.
    pub fn new(name: &str, inner: &str, outer: &str, freedom: Freedom) -> Self {
        Self {
            name: name.to_owned(),
            inner: inner.to_owned(),
            outer: outer.to_owned(),
            X_BM: Pose::identity(),
            X_BN: Pose::identity(),
            freedom,
            springs: [Spring::default(); 6],
            damping: [0.0; 6],
        }
    }

    /// Sets the poses of the hinge's frames on the inner and on the outer body.
    pub fn at(mut self, X_BM: Pose, X_BN: Pose) -> Self {
        self.X_BM = X_BM;
        self.X_BN = X_BN;
        self
    }

    /// Adds a spring on `axis` with rest position `rest`.
    pub fn spring(mut self, axis: Axis, stiffness: f64, rest: f64) -> Self {
        self.springs[axis.index()] = Spring { stiffness, rest };
        self
    }

    /// Adds a damper on `axis`.
    pub fn damper(mut self, axis: Axis, damping: f64) -> Self {
        self.damping[axis.index()] = damping;
        self
    }

    fn check(&self) -> Result<(), SystemError> {
        let value = |what: String, value: f64, expected| SystemError::Value {
            hinge: self.name.clone(),
            what,
            value,
            expected,
        };
        for (which, X) in [("inner", &self.X_BM), ("outer", &self.X_BN)] {
            let numbers = X.translation.vector.iter();
            let not_finite = |x: &&f64| !x.is_finite();
            let mut numbers = numbers.chain(X.rotation.matrix().iter());
            if let Some(x) = numbers.find(not_finite) {
                let what = format!("a number of its frame on the {which} body");
                return Err(value(what, *x, "finite"));
            }
        }
        for axis in Axis::ALL {
            let (spring, damping) = (self.springs[axis.index()], self.damping[axis.index()]);
            let constrained = |what| SystemError::Constrained {
                hinge: self.name.clone(),
                axis,
                what,
            };
            if !spring.stiffness.is_finite() {
                let what = format!("stiffness on {axis}");
                return Err(value(what, spring.stiffness, "finite"));
            }
            if !spring.rest.is_finite() {
                return Err(value(
                    format!("rest position on {axis}"),
                    spring.rest,
                    "finite",
                ));
            }
            if !(damping.is_finite() && damping >= 0.0) {
                let expected = "finite and not negative";
                return Err(value(format!("damping on {axis}"), damping, expected));
            }
            if !self.freedom.is_free(axis) && spring.stiffness != 0.0 {
                return Err(constrained("a spring"));
            }
            if !self.freedom.is_free(axis) && damping != 0.0 {
                return Err(constrained("a damper"));
            }
        }
        Ok(())
    }
}

/// Builds a [`System`] from bodies and hinges.
#[derive(Debug, Clone, Default)]
pub struct SystemBuilder {
    bodies: Vec<Body>,
    hinges: Vec<Hinge>,
    /// Whether principal moments may break the triangle inequality, as one of TR-942's own bodies does.
    pub(super) allow_any_moments: bool,
}

impl SystemBuilder {
    /// A builder without bodies and hinges.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a body.
    pub fn body(&mut self, name: &str, inertia: RigidInertia) -> &mut Self {
        self.bodies.push(Body {
            name: name.to_owned(),
            inertia,
        });
        self
    }

    /// Adds a hinge. It closes a loop if the hinges before it already connect its bodies.
    pub fn hinge(&mut self, hinge: Hinge) -> &mut Self {
        self.hinges.push(hinge);
        self
    }

    /// Checks and compiles the description.
    ///
    /// # Errors
    /// [`SystemError`] for bad names, masses, inertias and numbers, springs on constrained axes, and bodies that no
    /// hinge connects. [`System::assemble`] checks properties that depend on positions, such as whether loops close.
    pub fn build(&self) -> Result<System, SystemError> {
        if self.bodies.is_empty() {
            return Err(SystemError::NoBodies);
        }
        let bodies = names(
            ["body", "bodies"],
            self.bodies.iter().map(|b| b.name.as_str()),
        )?;
        names(
            ["hinge", "hinges"],
            self.hinges.iter().map(|h| h.name.as_str()),
        )?;
        for body in &self.bodies {
            match body.inertia.check() {
                Err(InertiaError::Triangle(..)) if self.allow_any_moments => {}
                checked => checked.map_err(|problem| SystemError::Inertia {
                    body: body.name.clone(),
                    problem,
                })?,
            }
        }
        let mut joints = Vec::new();
        for hinge in &self.hinges {
            hinge.check()?;
            let find = |name: &String| match bodies.get(name.as_str()) {
                None if name != INERTIAL => Err(SystemError::UnknownBody {
                    hinge: hinge.name.clone(),
                    body: name.clone(),
                }),
                found => Ok(found.copied()),
            };
            let (inner, outer) = (find(&hinge.inner)?, find(&hinge.outer)?);
            if inner == outer {
                return Err(SystemError::SameBody {
                    hinge: hinge.name.clone(),
                    body: hinge.inner.clone(),
                });
            }
            let com =
                |body: Option<usize>| body.map_or(Vector3::zeros(), |b| self.bodies[b].inertia.com);
            joints.push(CompiledHinge {
                inner,
                outer,
                e_inner: hinge.X_BM.translation.vector - com(inner),
                e_outer: hinge.X_BN.translation.vector - com(outer),
                R_BM: UnitQuaternion::from(hinge.X_BM.rotation),
                R_BN: UnitQuaternion::from(hinge.X_BN.rotation),
                closes_loop: false,
                left_out: [false; 6],
            });
        }
        let tree = spanning_tree(&self.bodies, &mut joints)?;
        Ok(System {
            bodies: self.bodies.clone(),
            hinges: self.hinges.clone(),
            joined: joints,
            tree,
            gears: Vec::new(),
        })
    }
}

/// Map from names to indices; no name may be empty, reserved or given twice.
fn names<'a>(
    [kind, plural]: [&'static str; 2],
    names: impl Iterator<Item = &'a str>,
) -> Result<HashMap<&'a str, usize>, SystemError> {
    let mut indices = HashMap::new();
    for (i, name) in names.enumerate() {
        let owned = || name.to_owned();
        if name.is_empty() || name == INERTIAL {
            return Err(SystemError::Name {
                kind,
                name: owned(),
            });
        }
        if indices.insert(name, i).is_some() {
            return Err(SystemError::DuplicateName {
                kind: plural,
                name: owned(),
            });
        }
    }
    Ok(indices)
}

/// Hinges of the spanning tree, ordered outward from inertial space; the others are marked as closing loops.
fn spanning_tree(bodies: &[Body], hinges: &mut [CompiledHinge]) -> Result<Vec<usize>, SystemError> {
    // Node 0 is inertial space. `group[i]` is the smallest node that is connected to i.
    let node = |body: Option<usize>| body.map_or(0, |b| b + 1);
    let mut group: Vec<usize> = (0..=bodies.len()).collect();
    for hinge in hinges.iter_mut() {
        let (a, b) = (group[node(hinge.inner)], group[node(hinge.outer)]);
        hinge.closes_loop = a == b;
        let (keep, drop) = (a.min(b), a.max(b));
        for g in group.iter_mut().filter(|g| **g == drop) {
            *g = keep;
        }
    }
    if let Some(alone) = group.iter().position(|g| *g != 0) {
        return Err(SystemError::Unreachable {
            body: bodies[alone - 1].name.clone(),
        });
    }
    let mut reached = vec![false; group.len()];
    reached[0] = true;
    let mut order = Vec::new();
    while order.len() < bodies.len() {
        for (i, hinge) in hinges.iter().enumerate().filter(|(_, h)| !h.closes_loop) {
            let (a, b) = (node(hinge.inner), node(hinge.outer));
            if reached[a] != reached[b] {
                (reached[a], reached[b]) = (true, true);
                order.push(i);
            }
        }
    }
    Ok(order)
}

/// A hinge compiled for the equations.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CompiledHinge {
    /// Inner body; inertial space if none.
    pub inner: Option<usize>,
    /// Outer body; inertial space if none.
    pub outer: Option<usize>,
    /// From the inner body's centre of mass to M, body axes; from the world's origin if inertial.
    pub e_inner: Vector3<f64>,
    /// From the outer body's centre of mass to N, body axes; from the world's origin if inertial.
    pub e_outer: Vector3<f64>,
    pub R_BM: UnitQuaternion<f64>,
    pub R_BN: UnitQuaternion<f64>,
    pub closes_loop: bool,
    /// Constrained axes that are redundant and were removed.
    pub left_out: [bool; 6],
}

/// A checked system of bodies and hinges of any topology.
#[derive(Debug, Clone, PartialEq)]
pub struct System {
    pub(super) bodies: Vec<Body>,
    pub(super) hinges: Vec<Hinge>,
    pub(super) joined: Vec<CompiledHinge>,
    /// Hinges of the spanning tree, from inertial space outward.
    pub(super) tree: Vec<usize>,
    pub(super) gears: Vec<Gear>,
}

impl System {
    /// All bodies, as declared.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// All hinges, as declared.
    pub fn hinges(&self) -> &[Hinge] {
        &self.hinges
    }

    /// Index of the body called `name`.
    pub fn body(&self, name: &str) -> Option<usize> {
        self.bodies.iter().position(|b| b.name == name)
    }

    /// Index of the hinge called `name`.
    pub fn hinge(&self, name: &str) -> Option<usize> {
        self.hinges.iter().position(|h| h.name == name)
    }

    /// Whether hinge `hinge` connects bodies that the hinges declared before it already connect.
    pub fn closes_loop(&self, hinge: usize) -> bool {
        self.joined[hinge].closes_loop
    }

    /// Length of a state: 13 numbers per body, see [`super::BodyState`].
    pub fn state_len(&self) -> usize {
        13 * self.bodies.len()
    }

    /// Number of constraints, including those of mimic joints.
    pub fn constraints(&self) -> usize {
        let of_hinge = |i| Axis::ALL.into_iter().filter(|a| self.holds(i, *a)).count();
        (0..self.hinges.len()).map(of_hinge).sum::<usize>() + self.gears.len()
    }

    /// Whether hinge `hinge` exerts a constraint force along or about `axis`: the axis is not free, and
    /// [`System::leave_out_redundant`] has not removed it.
    pub fn holds(&self, hinge: usize, axis: Axis) -> bool {
        !self.hinges[hinge].freedom.is_free(axis) && !self.joined[hinge].left_out[axis.index()]
    }
}
