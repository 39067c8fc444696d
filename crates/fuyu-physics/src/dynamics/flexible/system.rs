//! A robot with flexible parts, wheels and thrusters: its description, checked once.

use std::sync::Arc;

use fuyu_structures::{Appendage, FirstOrderLimits};
use nalgebra::{Matrix3, Unit, Vector3};

use super::error::require;
use super::{ElasticJoint, FlexibleError, ModalBody, RotorModel, Thruster, Wheel};
use crate::model::{Frame, Model};
use crate::spatial::{Pose, RigidInertia};

/// A robot with deformable bodies, elastic joints, reaction wheels and thrusters. Immutable; clones share one copy.
#[derive(Clone, Debug)]
pub struct FlexibleSystem {
    parts: Arc<Parts>,
}

#[derive(Debug)]
struct Parts {
    model: Model,
    modal_bodies: Vec<ModalBody>,
    joints: Vec<ElasticJoint>,
    wheels: Vec<Wheel>,
    thrusters: Vec<Thruster>,
    /// Of each deformable body without second order.
    limits: Vec<Option<FirstOrderLimits>>,
    compiled: Compiled,
}

/// What the recursions need.
#[derive(Debug)]
pub(super) struct Compiled {
    pub bodies: Vec<CompiledBody>,
    /// Rotors: those of motors with [`RotorModel::Full`], then the wheels.
    pub rotors: Vec<Rotor>,
    /// For each joint its place among the elastic joints.
    pub elastic: Vec<Option<usize>>,
    /// For each elastic joint its joint.
    pub joint_of: Vec<usize>,
    /// For each thruster its body, and position and force in the body's frame.
    pub thrusters: Vec<(usize, Vector3<f64>, Vector3<f64>)>,
    pub modes: usize,
    pub mass: f64,
}

/// A body and the joint that moves it.
#[derive(Debug)]
pub(super) struct CompiledBody {
    pub parent: usize,
    pub is_prismatic: bool,
    pub axis: Vector3<f64>,
    /// Pose of the joint frame in the frame that carries it: the parent's, or the section of an elastic link.
    pub R_PJ: Matrix3<f64>,
    pub p_PJ: Vector3<f64>,
    /// Rigid mass properties about the body frame's origin; zero for an elastic link.
    pub mass: f64,
    pub S: Vector3<f64>,
    pub J: Matrix3<f64>,
    /// The elastic link that this body is.
    pub link: Option<usize>,
    /// The deformable bodies fixed to it, itself included if it is an elastic link.
    pub modal_bodies: Vec<usize>,
    pub rotors: Vec<usize>,
}

/// A rotor on a body, whose inertia contains it as locked.
#[derive(Debug)]
pub(super) struct Rotor {
    pub body: usize,
    /// In the body's axes.
    pub axis: Vector3<f64>,
    pub inertia: f64,
    /// Its coordinate among motor angles and wheel angles, and how fast it spins for a unit rate of it.
    pub coordinate: usize,
    pub ratio: f64,
}

/// Collects the parts of a [`FlexibleSystem`].
#[derive(Clone, Debug)]
pub struct FlexibleBuilder {
    model: Model,
    appendages: Vec<(Frame, Pose, Appendage)>,
    links: Vec<(String, Pose, Appendage, usize)>,
    joints: Vec<ElasticJoint>,
    wheels: Vec<(Frame, Wheel)>,
    thrusters: Vec<(Frame, Thruster)>,
}

impl FlexibleBuilder {
    /// Adds a deformable body that is clamped to a link, in addition to the link's own inertia. `X_FA` is the pose of
    /// its attachment frame A in the link's frame F.
    #[must_use]
    pub fn appendage(mut self, frame: &Frame, X_FA: Pose, appendage: Appendage) -> Self {
        self.appendages.push((frame.clone(), X_FA, appendage));
        self
    }

    /// Makes the link that moves a body elastic. The deformable body replaces the rigid inertia of the body `link`, which is clamped to its
    /// joint. Whatever follows in the tree, and frames fixed to the link, are carried by the output point number
    /// `section` (the tip of an [`ElasticLink`](fuyu_structures::ElasticLink) is number 0), which turns by its small rotation φ as `Rz(φ_z) Ry(φ_y) Rx(φ_x)` in axes of A. `X_BA` is the pose
    /// of the attachment frame A in the body's frame B.
    #[must_use]
    pub fn elastic_link(
        mut self,
        link: &str,
        X_BA: Pose,
        appendage: Appendage,
        section: usize,
    ) -> Self {
        (self.links).push((link.to_owned(), X_BA, appendage, section));
        self
    }

    /// Makes a joint elastic.
    #[must_use]
    pub fn elastic_joint(mut self, joint: ElasticJoint) -> Self {
        self.joints.push(joint);
        self
    }

    /// Adds a reaction wheel to the link with this frame.
    #[must_use]
    pub fn wheel(mut self, frame: &Frame, wheel: Wheel) -> Self {
        self.wheels.push((frame.clone(), wheel));
        self
    }

    /// Adds a thruster to the link with this frame.
    #[must_use]
    pub fn thruster(mut self, frame: &Frame, thruster: Thruster) -> Self {
        self.thrusters.push((frame.clone(), thruster));
        self
    }

    /// Checks all parts and compiles them.
    ///
    /// # Errors
    /// [`FlexibleError`] for a robot with mimic joints, a part on a link or joint that the robot lacks, a part that an elastic link cannot
    /// carry, two parts with one name, or a number out of its range.
    pub fn build(self) -> Result<FlexibleSystem, FlexibleError> {
        let model = &self.model;
        if model.has_mimics() {
            return Err(FlexibleError::part(
                model.name(),
                "has mimic joints; flexible parts need a robot without them",
            ));
        }
        let mut bodies = compile_bodies(model);
        let mut modal_bodies = Vec::new();
        self.place_modal_bodies(&mut bodies, &mut modal_bodies)?;
        let modes = modal_bodies.iter().map(ModalBody::modes).sum();
        let (elastic, joint_of) = self.place_joints(&bodies)?;
        let mut rotors = Vec::new();
        for (e, joint) in self.joints.iter().enumerate() {
            let moved = &bodies[joint_of[e] + 1];
            if joint.rotor == RotorModel::Full {
                rotors.push(Rotor {
                    body: moved.parent,
                    axis: moved.R_PJ * moved.axis,
                    inertia: joint.rotor_inertia,
                    coordinate: e,
                    ratio: joint.gear_ratio,
                });
            }
        }
        for (i, (frame, wheel)) in self.wheels.iter().enumerate() {
            wheel.check()?;
            self.check_carrier(&bodies, frame, &wheel.name, "wheel")?;
            rotors.push(Rotor {
                body: frame.body,
                axis: frame.X_BF.rotation * *wheel.axis,
                inertia: wheel.inertia,
                coordinate: self.joints.len() + i,
                ratio: 1.0,
            });
        }
        for (i, rotor) in rotors.iter().enumerate() {
            bodies[rotor.body].rotors.push(i);
        }
        let mut thrusters = Vec::new();
        for (frame, thruster) in &self.thrusters {
            thruster.check()?;
            self.check_carrier(&bodies, frame, &thruster.name, "thruster")?;
            let position = frame.X_BF * nalgebra::Point3::from(thruster.position);
            let force = frame.X_BF.rotation * *thruster.direction * thruster.thrust;
            thrusters.push((frame.body, position.coords, force));
        }
        self.check_names()?;
        check_rotor_inertias(&bodies, &rotors, model)?;
        let rigid: f64 = bodies.iter().map(|b| b.mass).sum();
        let deformable: f64 = modal_bodies.iter().map(|b| b.integrals.mass).sum();
        let compiled = Compiled {
            bodies,
            rotors,
            elastic,
            joint_of,
            thrusters,
            modes,
            mass: rigid + deformable,
        };
        let limits = modal_bodies.iter().map(|body| {
            let limits = body.appendage.first_order_limits();
            (!body.second_order()).then_some(limits).transpose()
        });
        let limits = limits.collect::<Result<_, _>>()?;
        Ok(FlexibleSystem {
            parts: Arc::new(Parts {
                model: self.model,
                modal_bodies,
                joints: self.joints,
                wheels: self.wheels.into_iter().map(|(_, w)| w).collect(),
                thrusters: self.thrusters.into_iter().map(|(_, t)| t).collect(),
                limits,
                compiled,
            }),
        })
    }

    fn place_modal_bodies(
        &self,
        bodies: &mut [CompiledBody],
        modal_bodies: &mut Vec<ModalBody>,
    ) -> Result<(), FlexibleError> {
        let mut offset = 0;
        for (frame, X_FA, appendage) in &self.appendages {
            appendage.check()?;
            let X_BA = frame.X_BF * X_FA;
            bodies[frame.body].modal_bodies.push(modal_bodies.len());
            let body = ModalBody::new(appendage.clone(), frame.body, X_BA, offset, None);
            offset += body.modes();
            modal_bodies.push(body);
        }
        for (link, X_BA, appendage, section) in &self.links {
            appendage.check()?;
            let name = &appendage.name;
            let mut named = self.model.bodies().iter();
            let Some(index) = named.position(|body| body.name == *link) else {
                let names: Vec<_> = self.model.bodies()[1..].iter().map(|b| &*b.name).collect();
                let problem = format!(
                    "link {link} is not moved by a joint of the robot; it must be one of {}",
                    names.join(", ")
                );
                return Err(FlexibleError::part(name, problem));
            };
            if index == 0 || !bodies[index].modal_bodies.is_empty() {
                let problem = format!(
                    "link {link} must be moved by a joint and carry no other deformable body"
                );
                return Err(FlexibleError::part(name, problem));
            }
            if *section >= appendage.outputs.len() {
                let problem = format!(
                    "output point {section} does not exist; it has {}",
                    appendage.outputs.len()
                );
                return Err(FlexibleError::part(name, problem));
            }
            let body = &mut bodies[index];
            (body.mass, body.S, body.J) = (0.0, Vector3::zeros(), Matrix3::zeros());
            body.link = Some(modal_bodies.len());
            body.modal_bodies.push(modal_bodies.len());
            let placed = ModalBody::new(appendage.clone(), index, *X_BA, offset, Some(*section));
            offset += placed.modes();
            // What follows is carried by the section, whose frame has the axes of B while the link is straight.
            let p_BE = placed.in_body.outputs[*section].position;
            for child in &mut bodies[index + 1..] {
                if child.parent == index {
                    child.p_PJ -= p_BE;
                }
            }
            modal_bodies.push(placed);
        }
        Ok(())
    }

    /// For each joint its elastic joint, and for each elastic joint its joint.
    fn place_joints(
        &self,
        bodies: &[CompiledBody],
    ) -> Result<(Vec<Option<usize>>, Vec<usize>), FlexibleError> {
        let mut elastic = vec![None; self.model.dof()];
        let mut joint_of = Vec::new();
        for (e, joint) in self.joints.iter().enumerate() {
            joint.check()?;
            let name = &joint.joint;
            let Some(j) = self.model.joint_index(name) else {
                let names: Vec<_> = self.model.joints().iter().map(|j| &*j.name).collect();
                let problem = format!(
                    "is not a joint of the robot; it must be one of {}",
                    names.join(", ")
                );
                return Err(FlexibleError::part(&format!("joint {name}"), problem));
            };
            let full = joint.rotor == RotorModel::Full;
            if full && (bodies[j + 1].is_prismatic || bodies[bodies[j + 1].parent].link.is_some()) {
                return Err(FlexibleError::part(
                    &format!("joint {name}"),
                    "only a revolute joint on a rigid link can have the full rotor model; use the reduced one",
                ));
            }
            elastic[j] = Some(e);
            joint_of.push(j);
        }
        Ok((elastic, joint_of))
    }

    fn check_carrier(
        &self,
        bodies: &[CompiledBody],
        frame: &Frame,
        name: &str,
        what: &str,
    ) -> Result<(), FlexibleError> {
        if bodies[frame.body].link.is_some() {
            let problem = format!(
                "is on the elastic link {}; a {what} needs a rigid link",
                self.model.bodies()[frame.body].name
            );
            return Err(FlexibleError::part(&format!("{what} {name}"), problem));
        }
        Ok(())
    }

    fn check_names(&self) -> Result<(), FlexibleError> {
        let modal = self.appendages.iter().map(|(_, _, a)| &a.name);
        let modal = modal.chain(self.links.iter().map(|(_, _, a, _)| &a.name));
        let lists: [Vec<&String>; 4] = [
            modal.collect(),
            self.joints.iter().map(|j| &j.joint).collect(),
            self.wheels.iter().map(|(_, w)| &w.name).collect(),
            self.thrusters.iter().map(|(_, t)| &t.name).collect(),
        ];
        for list in lists {
            for (i, name) in list.iter().enumerate() {
                if list[..i].contains(name) {
                    return Err(FlexibleError::part(name, "the name is used twice"));
                }
            }
        }
        Ok(())
    }
}

fn compile_bodies(model: &Model) -> Vec<CompiledBody> {
    let compiled = model.bodies().iter().enumerate().map(|(b, body)| {
        let joint = b.checked_sub(1).map(|j| &model.joints()[j]);
        let inertia = &body.spatial_inertia;
        CompiledBody {
            parent: body.parent.unwrap_or(0),
            is_prismatic: joint.is_some_and(|j| !j.kind.is_rotational()),
            axis: joint.map_or_else(Vector3::zeros, |j| *j.axis),
            R_PJ: joint.map_or_else(Matrix3::identity, |j| *j.X_PJ.rotation.matrix()),
            p_PJ: joint.map_or_else(Vector3::zeros, |j| j.X_PJ.translation.vector),
            mass: inertia.mass,
            S: inertia.first_moment,
            J: inertia.about_origin.to_matrix(),
            link: None,
            modal_bodies: Vec::new(),
            rotors: Vec::new(),
        }
    });
    compiled.collect()
}

/// The inertia of a body must contain its rotors: what is left about their axes must be positive.
fn check_rotor_inertias(
    bodies: &[CompiledBody],
    rotors: &[Rotor],
    model: &Model,
) -> Result<(), FlexibleError> {
    for (b, body) in bodies.iter().enumerate() {
        if body.rotors.is_empty() {
            continue;
        }
        let mut about_com = body.J;
        if body.mass > 0.0 {
            let c = body.S / body.mass;
            about_com -= (Matrix3::identity() * c.norm_squared() - c * c.transpose()) * body.mass;
        }
        for i in &body.rotors {
            let Rotor { axis, inertia, .. } = &rotors[*i];
            about_com -= axis * axis.transpose() * *inertia;
        }
        let least = about_com.symmetric_eigenvalues().min();
        require(
            || {
                format!(
                    "link {}, least moment of inertia without its wheels and motor rotors [kg m²]",
                    model.bodies()[b].name
                )
            },
            least,
            least > 0.0,
            "positive: the link's inertia contains them",
        )?;
    }
    Ok(())
}

impl FlexibleSystem {
    /// Starts with a robot without flexible parts.
    pub fn builder(model: &Model) -> FlexibleBuilder {
        FlexibleBuilder {
            model: model.clone(),
            appendages: Vec::new(),
            links: Vec::new(),
            joints: Vec::new(),
            wheels: Vec::new(),
            thrusters: Vec::new(),
        }
    }

    /// The robot. Bodies that are elastic links keep the rigid inertia of the description here.
    pub fn model(&self) -> &Model {
        &self.parts.model
    }

    /// Appendages in the order in which they were added, then elastic links.
    pub fn modal_bodies(&self) -> &[ModalBody] {
        &self.parts.modal_bodies
    }

    /// How many modal coordinates there are.
    pub fn modes(&self) -> usize {
        self.parts.compiled.modes
    }

    /// The elastic joints.
    pub fn elastic_joints(&self) -> &[ElasticJoint] {
        &self.parts.joints
    }

    /// The reaction wheels.
    pub fn wheels(&self) -> &[Wheel] {
        &self.parts.wheels
    }

    /// Axis of wheel `i` in the axes of the body that carries it, and the index of this body.
    ///
    /// # Panics
    /// If there are fewer wheels.
    pub fn wheel_axis(&self, i: usize) -> (usize, Unit<Vector3<f64>>) {
        let compiled = &self.parts.compiled;
        let first = compiled.rotors.len() - self.parts.wheels.len();
        let rotor = &compiled.rotors[first + i];
        (rotor.body, Unit::new_normalize(rotor.axis))
    }

    /// The thrusters.
    pub fn thrusters(&self) -> &[Thruster] {
        &self.parts.thrusters
    }

    /// Mass of everything \[kg\].
    pub fn total_mass(&self) -> f64 {
        self.parts.compiled.mass
    }

    /// Number of modal coordinates, motor angles and wheel angles together.
    pub(super) fn extras(&self) -> usize {
        let Parts { joints, wheels, .. } = &*self.parts;
        self.modes() + joints.len() + wheels.len()
    }

    pub(super) fn compiled(&self) -> &Compiled {
        &self.parts.compiled
    }

    pub(super) fn limits(&self) -> &[Option<FirstOrderLimits>] {
        &self.parts.limits
    }

    /// Whether both are clones of one system.
    pub(super) fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.parts, &other.parts)
    }

    /// Names of the joints whose Coulomb friction, stops or speed limits are not simulated: those of the description that
    /// have any. Springs and viscous damping are.
    pub fn unsimulated_joints(&self) -> impl Iterator<Item = &str> {
        let joints = self.model().joints().iter();
        joints
            .filter(|joint| {
                let limits = &joint.limits;
                let ends = [limits.lower, limits.upper, limits.velocity];
                joint.friction != 0.0 || ends.iter().any(|x| x.is_finite())
            })
            .map(|joint| &*joint.name)
    }

    /// Inertia of the undeformed robot's body `b`, with the appendages that it carries, in its frame.
    pub(super) fn undeformed_inertia(&self, b: usize) -> RigidInertia {
        let body = &self.compiled().bodies[b];
        let (mut mass, mut S, mut J) = (body.mass, body.S, body.J);
        for i in &body.modal_bodies {
            let integrals = &self.modal_bodies()[*i].integrals;
            mass += integrals.mass;
            S += integrals.S;
            J += integrals.J;
        }
        if mass == 0.0 {
            return RigidInertia::zero();
        }
        let com = S / mass;
        let shift = Matrix3::identity() * com.norm_squared() - com * com.transpose();
        RigidInertia {
            mass,
            com,
            about_com: J - shift * mass,
        }
    }
}
