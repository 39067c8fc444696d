//! Collision shapes of robot and targets, from the `<collision>` elements of their descriptions, and the contact pairs.

use std::path::{Path, PathBuf};

use super::{
    contact_system::{ContactSystem, Label},
    params::{ContactPairParams, ContactParams, Description},
    rigid_robot::RigidRobot,
    target::Target,
};
use crate::{
    dynamics::{
        Floating,
        capture::Captured,
        contact::{ColliderId, ContactLaw, ContactWorld, Shape},
    },
    model::{CollisionElement, CollisionGeometry, Model},
    nodes::{
        mesh,
        resource::{AllowedFolders, Lookup},
    },
    spatial::Pose,
};

/// Name of the whole robot in `contact.pairs`, accepted in addition to the name in its description.
const ROBOT: &str = "robot";

/// A collision shape on a link.
#[derive(Clone)]
struct CollisionShape {
    /// The link's frame in the model.
    frame: String,
    /// Name of the link in messages and events.
    label: String,
    /// Name of the `<collision>` element.
    element: Option<String>,
    X_LC: Pose,
    shape: Shape,
}

/// A collision shape added to the contact world.
struct Placed<'a> {
    solid: &'a CollisionShape,
    /// The owner: 0 for the robot, or the target's number counted from one.
    owner: usize,
    /// Index of the system in the contact world, and of the body in that system.
    system: usize,
    body: usize,
    collider: ColliderId,
}

/// Collision shapes and contact parameters from which the contact world is built.
pub(super) struct ContactBuilder {
    params: ContactParams,
    /// Longest step of the bodies' own integrators \[s\].
    time_step: f64,
    robot: Vec<CollisionShape>,
    /// Folders in which meshes of targets added by peers may be.
    allowed: AllowedFolders,
}

/// Where mesh files are looked up.
enum Meshes<'a> {
    /// Anywhere, for a description that the scenario names; with the folders of ROS packages.
    Anywhere(&'a [PathBuf]),
    /// Only below allowed folders, for a description that a peer has sent.
    Below(&'a AllowedFolders),
}

impl ContactBuilder {
    /// Reads the robot's shapes.
    ///
    /// # Errors
    /// A line that names the description, the link and what is wrong with its shape.
    pub fn new(
        params: &ContactParams,
        time_step: f64,
        robot: &Description,
        model: &Model,
        allowed: &AllowedFolders,
    ) -> Result<Self, String> {
        let meshes = Meshes::Anywhere(&params.packages);
        let mut solids = read(&robot.xml, &robot.source, &meshes)?;
        // Links that no joint connects to the robot are not part of the model.
        solids.retain(|solid| model.frame(&solid.frame).is_some());
        Ok(Self {
            params: params.clone(),
            time_step,
            robot: solids,
            allowed: allowed.clone(),
        })
    }

    /// The contact world of the robot, the target that it holds and the other targets in their current states, with all
    /// pairs.
    ///
    /// # Errors
    /// A line on a description, a shape or a pair.
    pub fn build(&self, robot: &RigidRobot, targets: &[Target]) -> Result<ContactSystem, String> {
        let held = targets.iter().position(|t| robot.held() == Some(&t.name));
        self.build_around(robot.own(), robot.captured().zip(held), targets)
    }

    /// Checks that a contact world can be built with all targets free, whatever the robot holds now.
    ///
    /// # Errors
    /// A line on a description, a shape or a pair.
    pub fn check_pairs(&self, robot: &RigidRobot, targets: &[Target]) -> Result<(), String> {
        self.build_around(robot.own(), None, targets).map(drop)
    }

    /// The contact world; `held` has the joined system of robot and held target, and the target's index.
    fn build_around(
        &self,
        robot: &Floating,
        held: Option<(&Captured, usize)>,
        targets: &[Target],
    ) -> Result<ContactSystem, String> {
        let (captured, held) = held.unzip();
        let of_targets = targets.iter().map(|target| self.solids_of(target));
        let of_targets: Vec<Vec<CollisionShape>> = of_targets.collect::<Result<_, _>>()?;
        let free = (targets.iter().enumerate()).filter(|(i, _)| Some(*i) != held);
        let bodies = free.map(|(_, target)| &target.body);
        let systems: Vec<&Floating> = std::iter::once(captured.map_or(robot, Captured::floating))
            .chain(bodies)
            .collect();
        let has_joints = systems.iter().any(|system| system.model().dof() > 0);
        let mut world = ContactWorld::new(systems.iter().map(|s| (*s).clone()).collect())
            .with_tolerance(self.params.tolerance_of(has_joints))
            .with_free_steps(self.time_step);
        let mut placed = Vec::new();
        let all = std::iter::once(&self.robot).chain(&of_targets);
        let mut next_system = 1;
        for (owner, solids) in all.enumerate() {
            let is_held = owner > 0 && held == Some(owner - 1);
            let system = match owner > 0 && !is_held {
                true => next_system,
                false => 0,
            };
            next_system += usize::from(system > 0);
            for solid in solids {
                let frame = match captured {
                    Some(captured) if is_held => captured.target_frame(&solid.frame),
                    _ => systems[system].model().frame(&solid.frame),
                };
                let Some(frame) = frame else { continue };
                let shape = solid.shape.clone();
                let collider = world.add_collider_on(system, frame, &solid.X_LC, shape);
                world.name_collider(collider, &solid.label);
                placed.push(Placed {
                    solid,
                    owner,
                    system,
                    body: frame.body,
                    collider,
                });
            }
        }
        let own = robot.model();
        let owners: Vec<Vec<&str>> = std::iter::once(vec![ROBOT, own.name()])
            .chain(
                targets
                    .iter()
                    .map(|t| vec![t.name.as_str(), t.body.model().name()]),
            )
            .collect();
        for (k, first) in placed.iter().enumerate() {
            for second in &placed[k + 1..] {
                if !self.may_touch(systems[0].model(), captured, first, second) {
                    continue;
                }
                let Some((law, is_swapped)) = self.law_of(&owners, first, second) else {
                    continue;
                };
                let (a, b) = match is_swapped {
                    true => (second.collider, first.collider),
                    false => (first.collider, second.collider),
                };
                (world.add_pair(a, b, law)).map_err(|e| format!("parameter contact: {e}"))?;
            }
        }
        let labels = placed.iter().map(|p| Label {
            link: p.solid.label.clone(),
            owner: p.owner,
            robot_body: match p.owner {
                0 => own.frame(&p.solid.frame).map(|frame| frame.body),
                _ => None,
            },
        });
        let ids = targets.iter().map(|target| target.id);
        Ok(ContactSystem::new(
            world,
            labels.collect(),
            ids.collect(),
            held,
        ))
    }

    /// Checks that there are collision shapes, and that each name in `contact.pairs` matches one.
    ///
    /// # Errors
    /// A line that names the parameter, with what there is.
    pub fn check(&self, robot: &Model, targets: &[Target]) -> Result<(), String> {
        let mut known: Vec<(Vec<String>, Vec<CollisionShape>)> = vec![(
            vec![ROBOT.to_owned(), robot.name().to_owned()],
            self.robot.clone(),
        )];
        for target in targets {
            let names = vec![target.name.clone(), target.body.model().name().to_owned()];
            known.push((names, self.solids_of(target)?));
        }
        if known.iter().all(|(_, solids)| solids.is_empty()) {
            return Err(
                "parameter contact: neither the robot nor a target has <collision> elements, so that nothing can touch; add some to their descriptions"
                    .to_owned(),
            );
        }
        for pair in &self.params.pairs {
            for name in &pair.names {
                let is_known = |(owners, solids): &(Vec<String>, Vec<CollisionShape>)| {
                    let owners: Vec<&str> = owners.iter().map(String::as_str).collect();
                    solids.iter().any(|s| precision(name, s, &owners) > 0)
                };
                if !known.iter().any(is_known) {
                    let mut labels: Vec<&str> = (known.iter())
                        .flat_map(|(_, solids)| solids.iter().map(|s| s.label.as_str()))
                        .collect();
                    labels.dedup();
                    let [a, b] = &pair.names;
                    return Err(format!(
                        "parameter contact.pairs.{a}.{b}: '{name}' is no link, target or <collision> element that can touch; there are {}",
                        labels.join(", ")
                    ));
                }
            }
        }
        Ok(())
    }

    /// Shapes of a target. The links of its description have the names of its frames.
    fn solids_of(&self, target: &Target) -> Result<Vec<CollisionShape>, String> {
        let meshes = match target.spawned {
            true => Meshes::Below(&self.allowed),
            false => Meshes::Anywhere(&self.params.packages),
        };
        let mut solids = read(&target.description, &target.source, &meshes)?;
        let root = &target.body.model().bodies()[0].name;
        for solid in &mut solids {
            let link = solid.label.strip_prefix(&target.name);
            solid.frame = match link.and_then(|rest| rest.strip_prefix('/')) {
                Some(link) => link.to_owned(),
                None => root.clone(),
            };
        }
        Ok(solids)
    }

    /// Whether two shapes can come into contact at all. `robot` is the joined model of the robot and what it holds.
    fn may_touch(
        &self,
        robot: &Model,
        captured: Option<&Captured>,
        first: &Placed,
        second: &Placed,
    ) -> bool {
        if first.system != second.system {
            return true;
        }
        let (a, b) = (first.body, second.body);
        if first.owner != second.owner {
            // Not the hand and the link that it holds, which are one body or have a ball joint between them.
            return captured.is_some_and(|captured| {
                let hand = robot.frame(&captured.grasp().robot.name);
                a != b
                    && (hand.map(|frame| frame.body), captured.target_root().body) != (Some(a), b)
            });
        }
        let bodies = robot.bodies();
        self.params.self_contact
            && first.owner == 0
            && a != b
            && bodies[a].parent != Some(b)
            && bodies[b].parent != Some(a)
    }

    /// The law of a pair, and whether the second shape is the first one of the law; `None` if they do not touch.
    fn law_of(
        &self,
        owners: &[Vec<&str>],
        first: &Placed,
        second: &Placed,
    ) -> Option<(ContactLaw, bool)> {
        let fits = |names: &[String; 2], a: &Placed, b: &Placed| {
            let of = |name: &String, p: &Placed| precision(name, p.solid, &owners[p.owner]);
            let found = [of(&names[0], a), of(&names[1], b)];
            (!found.contains(&0)).then(|| found.iter().sum::<u8>())
        };
        let mut best: Option<(u8, &ContactPairParams, bool)> = None;
        for pair in &self.params.pairs {
            let ways = [
                (fits(&pair.names, first, second), false),
                (fits(&pair.names, second, first), true),
            ];
            for (fit, is_swapped) in ways {
                if let Some(fit) = fit
                    && best.is_none_or(|(so_far, ..)| fit > so_far)
                {
                    best = Some((fit, pair, is_swapped));
                }
            }
        }
        match best {
            None => Some((self.params.law, false)),
            Some((_, pair, is_swapped)) => Some((pair.law?, is_swapped)),
        }
    }
}

/// How precisely `name` names a solid whose body has the names `owners`: 3 by its `<collision>` element, 2 by its link,
/// 1 by its body; 0 if it does not.
fn precision(name: &str, solid: &CollisionShape, owners: &[&str]) -> u8 {
    if solid.element.as_deref() == Some(name) {
        3
    } else if owners.contains(&name) {
        1
    } else if solid.label == name || solid.frame == name {
        2
    } else {
        0
    }
}

/// The shapes in the description `xml`, which `source` names in messages.
fn read(xml: &str, source: &str, meshes: &Meshes) -> Result<Vec<CollisionShape>, String> {
    let elements = CollisionElement::all_from_urdf(xml, source).map_err(|e| e.to_string())?;
    let solids = elements.into_iter().map(|element| {
        let at = |e: String| format!("{source}: <collision> of link '{}': {e}", element.link);
        let vertices = match &element.geometry {
            CollisionGeometry::Mesh { filename, .. } => {
                let found = match meshes {
                    Meshes::Anywhere(packages) => Lookup {
                        folder: Path::new(source).parent().map(Path::to_owned),
                        packages: packages.to_vec(),
                    }
                    .resolve(filename.strip_prefix("file://").unwrap_or(filename)),
                    Meshes::Below(allowed) => allowed.resolve(filename),
                };
                found.and_then(|f| mesh::vertices(&f)).map_err(at)?
            }
            _ => Vec::new(),
        };
        let shape = Shape::from_geometry(&element.geometry, &vertices);
        Ok(CollisionShape {
            shape: shape.map_err(|e| at(e.to_string()))?,
            frame: element.link.clone(),
            label: element.link.clone(),
            element: element.name.clone(),
            X_LC: element.X_LC,
        })
    });
    solids.collect()
}
