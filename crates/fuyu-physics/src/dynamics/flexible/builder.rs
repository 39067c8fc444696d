//! Collects and checks the parts of a robot with flexible parts.

use std::sync::Arc;

use fuyu_structures::Appendage;
use nalgebra::{Matrix6, Vector3};

use super::composite::Composite;
use super::error::require;
use super::system::{Compiled, CompiledBody, Parts, Rotor};
use super::{ElasticJoint, FlexibleError, FlexibleSystem, ModalBody, RotorModel, Thruster, Wheel};
use crate::model::{Frame, Model};
use crate::spatial::Pose;

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

/// Largest relative difference of an elastic link's mass from that of the deformable body that replaces it.
const MASS_SHARE: f64 = 0.01;

impl FlexibleBuilder {
    pub(super) fn new(model: &Model) -> Self {
        Self {
            model: model.clone(),
            appendages: Vec::new(),
            links: Vec::new(),
            joints: Vec::new(),
            wheels: Vec::new(),
            thrusters: Vec::new(),
        }
    }

    /// Adds a deformable body that is clamped to a link, in addition to the link's own inertia. `X_FA` is the pose of
    /// its attachment frame A in the link's frame F.
    #[must_use]
    pub fn appendage(mut self, frame: &Frame, X_FA: Pose, appendage: Appendage) -> Self {
        self.appendages.push((frame.clone(), X_FA, appendage));
        self
    }

    /// Makes the body `link` elastic: `appendage` replaces its rigid inertia and is clamped to the joint that moves it.
    /// `X_BA` is the pose of the attachment frame A in the body's frame B. Its output point number `section` (the tip
    /// of an [`ElasticLink`](fuyu_structures::ElasticLink) is number 0) carries the following links, frames fixed to
    /// the link, and external wrenches on it. The section turns by its small rotation φ as `Rz(φ_z) Ry(φ_y) Rx(φ_x)` in
    /// axes of A.
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
    /// [`FlexibleError`] for a robot with mimic joints, modes that move more mass than their body and its link have, a
    /// part on a link or joint that does not exist, a part that an elastic link cannot carry, two parts with one name,
    /// or a number out of its range.
    pub fn build(self) -> Result<FlexibleSystem, FlexibleError> {
        let model = &self.model;
        if model.has_mimics() {
            return Err(FlexibleError::part(
                model.name(),
                "has mimic joints; flexible parts need a robot without them",
            ));
        }
        let mut bodies = compile_bodies(model);
        let modal_bodies = self.place_modal_bodies(&mut bodies)?;
        let modes = modal_bodies.iter().map(ModalBody::modes).sum();
        let (elastic, joint_of) = self.place_joints(&bodies)?;
        let rotors = self.place_rotors(&bodies, &joint_of)?;
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
        let rigid: f64 = bodies.iter().map(|b| b.rigid.mass).sum();
        let deformable: f64 = modal_bodies.iter().map(|b| b.integrals.rigid.mass).sum();
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

    /// Places the appendages, then the elastic links.
    fn place_modal_bodies(
        &self,
        bodies: &mut [CompiledBody],
    ) -> Result<Vec<ModalBody>, FlexibleError> {
        let (mut modal_bodies, mut offset) = (Vec::new(), 0);
        for (frame, X_FA, appendage) in &self.appendages {
            appendage.check()?;
            self.check_frame(frame, &appendage.name)?;
            let X_BA = frame.X_BF * X_FA;
            bodies[frame.body].modal_bodies.push(modal_bodies.len());
            let body = ModalBody::new(appendage.clone(), frame.body, X_BA, offset, None);
            let carrier = bodies[frame.body].rigid.mass_matrix();
            body.in_body.check_coupled_mass(&carrier)?;
            offset += body.modes();
            modal_bodies.push(body);
        }
        for (number, (link, X_BA, appendage, section)) in self.links.iter().enumerate() {
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
            let (rigid, deformable) = (body.rigid.mass, appendage.invariants.mass());
            if (rigid - deformable).abs() > MASS_SHARE * rigid {
                let problem = format!(
                    "has {deformable:.3} kg, but link {link} has {rigid:.3} kg with all that is fixed to it; they must agree to 1 %"
                );
                return Err(FlexibleError::part(name, problem));
            }
            body.rigid = Composite::zero();
            body.section = Some(number);
            body.modal_bodies.push(modal_bodies.len());
            let placed = ModalBody::new(appendage.clone(), index, *X_BA, offset, Some(*section));
            placed.in_body.check_coupled_mass(&Matrix6::zeros())?;
            offset += placed.modes();
            // The section carries the following links; its frame has the axes of B while the link is straight.
            let p_BE = placed.in_body.outputs[*section].position;
            for child in &mut bodies[index + 1..] {
                if child.parent == index {
                    child.X_PJ.translation.vector -= p_BE;
                }
            }
            modal_bodies.push(placed);
        }
        Ok(modal_bodies)
    }

    /// For each joint the index of its elastic joint, and for each elastic joint the index of its joint.
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
            if full
                && (bodies[j + 1].is_prismatic || bodies[bodies[j + 1].parent].section.is_some())
            {
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

    /// Places the rotors of motors, then the wheels.
    fn place_rotors(
        &self,
        bodies: &[CompiledBody],
        joint_of: &[usize],
    ) -> Result<Vec<Rotor>, FlexibleError> {
        let mut rotors = Vec::new();
        for (e, joint) in self.joints.iter().enumerate() {
            let moved = &bodies[joint_of[e] + 1];
            if joint.rotor == RotorModel::Full {
                rotors.push(Rotor {
                    body: moved.parent,
                    axis: moved.X_PJ.rotation * moved.axis,
                    inertia: joint.rotor_inertia,
                    coordinate: e,
                    ratio: joint.gear_ratio,
                });
            }
        }
        for (i, (frame, wheel)) in self.wheels.iter().enumerate() {
            wheel.check()?;
            self.check_carrier(bodies, frame, &wheel.name, "wheel")?;
            rotors.push(Rotor {
                body: frame.body,
                axis: frame.X_BF.rotation * *wheel.axis,
                inertia: wheel.inertia,
                coordinate: self.joints.len() + i,
                ratio: 1.0,
            });
        }
        Ok(rotors)
    }

    fn check_carrier(
        &self,
        bodies: &[CompiledBody],
        frame: &Frame,
        name: &str,
        what: &str,
    ) -> Result<(), FlexibleError> {
        let part = format!("{what} {name}");
        self.check_frame(frame, &part)?;
        if bodies[frame.body].section.is_some() {
            let problem = format!(
                "is on the elastic link {}; a {what} needs a rigid link",
                self.model.bodies()[frame.body].name
            );
            return Err(FlexibleError::part(&part, problem));
        }
        Ok(())
    }

    fn check_frame(&self, frame: &Frame, part: &str) -> Result<(), FlexibleError> {
        if self.model.frames().contains(frame) {
            return Ok(());
        }
        let (link, robot) = (&frame.name, self.model.name());
        let problem = format!("is on link {link}, which is a link of another robot than {robot}");
        Err(FlexibleError::part(part, problem))
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
            X_PJ: joint.map_or_else(Pose::identity, |j| j.X_PJ),
            rigid: Composite {
                mass: inertia.mass,
                S: inertia.first_moment,
                J: inertia.about_origin.to_matrix(),
            },
            section: None,
            modal_bodies: Vec::new(),
            rotors: Vec::new(),
        }
    });
    compiled.collect()
}

/// Checks that the inertia of each body contains its rotors: the remainder about their axes must be positive.
fn check_rotor_inertias(
    bodies: &[CompiledBody],
    rotors: &[Rotor],
    model: &Model,
) -> Result<(), FlexibleError> {
    for (b, body) in bodies.iter().enumerate() {
        if body.rotors.is_empty() {
            continue;
        }
        let mut about_com = body.rigid.about_com();
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
