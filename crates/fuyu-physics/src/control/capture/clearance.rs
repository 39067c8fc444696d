//! Distances between the arm, the base and the target: capsules and spheres.

use nalgebra::{Point3, Vector3};

use crate::dynamics::Workspace;
use crate::model::{Frame, Model};
use crate::spatial::{Pose, closest_points};

/// Sizes of the shapes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClearanceConfig {
    /// Radius of the capsules around the links \[m\].
    pub link_radius: f64,
    /// Radius of the sphere around the base's centre of mass \[m\].
    pub base_radius: f64,
    /// Radius of the sphere around the target's centre of mass that nothing may enter before the final approach \[m\].
    pub keep_out: f64,
    /// Least distance between parts of the robot \[m\].
    pub margin: f64,
}

impl Default for ClearanceConfig {
    fn default() -> Self {
        Self {
            link_radius: 0.12,
            base_radius: 1.43,
            keep_out: 0.9,
            margin: 0.05,
        }
    }
}

/// A link's axis, or the stroke of a prismatic joint.
#[derive(Debug, Clone)]
struct Capsule {
    /// For either end, the frame of a body and a point in that frame.
    from: (Frame, Vector3<f64>),
    to: (Frame, Vector3<f64>),
    /// Body of the capsule; a stroke belongs to the sliding body.
    body: usize,
}

/// The shapes of a robot.
#[derive(Debug, Clone)]
pub struct Clearance {
    config: ClearanceConfig,
    capsules: Vec<Capsule>,
    /// Capsules that are more than a joint away from the base.
    off_base: Vec<bool>,
    /// Pairs of capsules that are checked: those with more than two joints between their bodies. Neighbours touch, and
    /// the next but one would overlap where the link between them is shorter than wide.
    pairs: Vec<(usize, usize)>,
    base: Vector3<f64>,
}

/// Remaining distances \[m\]; negative where shapes overlap, infinite without shapes to compare.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distances {
    /// Between the arm and the keep-out sphere.
    pub keep_out: f64,
    /// Between parts of the robot that are not near neighbours.
    pub own: f64,
}

impl Distances {
    /// The smaller of each distance.
    #[must_use]
    pub fn least(self, other: Self) -> Self {
        Self {
            keep_out: self.keep_out.min(other.keep_out),
            own: self.own.min(other.own),
        }
    }
}

impl Clearance {
    /// Capsules from joint to joint, along the strokes of prismatic joints, and from the last joint to the tip.
    pub fn new(model: &Model, tip: &Frame, config: ClearanceConfig) -> Self {
        let bodies = model.bodies();
        let frame_of = |body: usize| {
            let mut frames = model.frames().iter().filter(|f| f.body == body);
            frames.find(|f| f.name == bodies[body].name)
        };
        let mut capsules = Vec::new();
        for body in 1..bodies.len() {
            let Some(frame) = frame_of(body) else {
                continue;
            };
            let origin = (frame.clone(), Vector3::zeros());
            let joint = model.tree_joint(body - 1);
            if let Some(parent) = frame_of(model.tree_parent(body - 1))
                && !joint.kind.is_rotational()
            {
                capsules.push(Capsule {
                    from: (parent.clone(), joint.X_PJ.translation.vector),
                    to: origin.clone(),
                    body,
                });
            }
            let children = (body + 1..bodies.len()).filter(|c| model.tree_parent(c - 1) == body);
            let joints = children.map(|c| model.tree_joint(c - 1).X_PJ.translation.vector);
            let tip = (tip.body == body).then_some(tip.X_BF.translation.vector);
            for end in joints.chain(tip).filter(|end| end.norm() > 1e-6) {
                capsules.push(Capsule {
                    from: origin.clone(),
                    to: (frame.clone(), end),
                    body,
                });
            }
        }
        let of = |k: usize| capsules[k].body;
        let pairs = (0..capsules.len()).flat_map(|i| (i + 1..capsules.len()).map(move |k| (i, k)));
        Self {
            config,
            pairs: pairs
                .filter(|(i, k)| joints_between(model, of(*i), of(*k)) > 2)
                .collect(),
            off_base: capsules
                .iter()
                .map(|c| joints_between(model, c.body, 0) > 1)
                .collect(),
            capsules,
            base: bodies[0].inertia.com,
        }
    }

    /// The sizes.
    pub fn config(&self) -> &ClearanceConfig {
        &self.config
    }

    /// Distances at the positions of `workspace`, with the base at `X_IB` and the target's centre of mass at `center` (in
    /// I).
    pub fn distances(
        &self,
        workspace: &Workspace,
        X_IB: &Pose,
        center: Option<&Vector3<f64>>,
    ) -> Distances {
        let radius = self.config.link_radius;
        let at =
            |(frame, p): &(Frame, Vector3<f64>)| (workspace.X_BF(frame) * Point3::from(*p)).coords;
        let ends = self.capsules.iter().map(|c| [at(&c.from), at(&c.to)]);
        let ends: Vec<_> = ends.collect();
        let center = center.map(|c| X_IB.inverse_transform_point(&Point3::from(*c)).coords);
        let apart = |first: &[Vector3<f64>; 2], second: &[Vector3<f64>; 2]| {
            let [p, q] = closest_points(first, second);
            (p - q).norm()
        };
        let mut found = Distances {
            keep_out: f64::INFINITY,
            own: f64::INFINITY,
        };
        for (axis, off_base) in ends.iter().zip(&self.off_base) {
            if let Some(center) = center {
                let left = apart(axis, &[center, center]) - self.config.keep_out - radius;
                found.keep_out = found.keep_out.min(left);
            }
            if *off_base {
                let left = apart(axis, &[self.base, self.base]) - self.config.base_radius - radius;
                found.own = found.own.min(left);
            }
        }
        for (i, k) in &self.pairs {
            let left = apart(&ends[*i], &ends[*k]) - 2.0 * radius;
            found.own = found.own.min(left);
        }
        found
    }
}

/// Number of joints on the way from one body to another.
fn joints_between(model: &Model, mut a: usize, mut b: usize) -> usize {
    let mut count = 0;
    // Parents come before their children.
    while a != b {
        if a < b {
            (a, b) = (b, a);
        }
        a = model.tree_parent(a - 1);
        count += 1;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::fixtures::servicer;
    use nalgebra::DVector;

    #[test]
    fn an_outstretched_arm_is_clear_and_a_folded_one_is_not() {
        let (model, tip) = servicer();
        let clearance = Clearance::new(&model, &tip, ClearanceConfig::default());
        let mut workspace = Workspace::new(&model);
        let mut at = |q: [f64; 6], center: Vector3<f64>| {
            workspace.set_positions(&DVector::from_row_slice(&q));
            clearance.distances(&workspace, &Pose::identity(), Some(&center))
        };
        // The arm is along y, from 1.5 m to 7.45 m.
        let far = at([0.0; 6], Vector3::new(3.0, 6.0, 0.0));
        assert!(far.own > 0.0);
        assert!((far.keep_out - (3.0 - 0.9 - 0.12)).abs() < 1e-9, "{far:?}");
        // The second long link folded back along the first.
        let folded = at([0.0, 0.0, 3.1, 0.0, 0.0, 0.0], Vector3::new(9.0, 0.0, 0.0));
        assert!(folded.own < 0.0, "{folded:?}");
    }

    /// A robot with two arms of three links each, 2 m apart, and a slider of 0 to 5 m on a third arm.
    fn branched() -> Model {
        let mut xml = String::from("<robot name=\"two\">");
        let link = |name: &str| {
            format!(
                "<link name=\"{name}\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial></link>"
            )
        };
        xml += &link("base");
        let joint = |kind: &str, parent: &str, child: &str, at: &str, axis: &str| {
            format!(
                "<joint name=\"j_{child}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin xyz=\"{at}\"/><axis xyz=\"{axis}\"/><limit lower=\"-6\" upper=\"6\" velocity=\"1\" effort=\"1\"/></joint>"
            )
        };
        for (arm, at) in [("l", "-1 2 0"), ("r", "1 2 0")] {
            let mut parent = "base".to_owned();
            for k in 0..3 {
                let child = format!("{arm}{k}");
                xml += &link(&child);
                let at = if k == 0 { at } else { "0 2 0" };
                xml += &joint("revolute", &parent, &child, at, "0 0 1");
                parent = child;
            }
        }
        for (parent, child, at) in [("base", "s0", "0 0 8"), ("s0", "s1", "0 0 1")] {
            xml += &link(child);
            xml += &joint("prismatic", parent, child, at, "0 0 1");
        }
        xml += "</robot>";
        Model::from_urdf(&xml, "two").unwrap()
    }

    fn branched_at(set: &[(&str, f64)], center: &Vector3<f64>) -> Distances {
        let model = branched();
        let tip = model.frame("r2").unwrap().clone();
        let clearance = Clearance::new(&model, &tip, ClearanceConfig::default());
        let mut workspace = Workspace::new(&model);
        let mut q = DVector::zeros(model.dof());
        for (name, value) in set {
            let j = model.joints().iter().position(|j| j.name == *name);
            q[j.unwrap()] = *value;
        }
        workspace.set_positions(&q);
        clearance.distances(&workspace, &Pose::identity(), Some(center))
    }

    // Links of two arms have the same depth: a difference of depths would not compare them.
    #[test]
    fn arms_are_kept_apart() {
        let far = Vector3::new(50.0, 0.0, 0.0);
        let apart = branched_at(&[], &far).own;
        assert!((apart - (2.0 - 0.24)).abs() < 1e-9, "{apart}");
        // The second links turned towards each other cross.
        let crossed = branched_at(&[("j_l1", -1.2), ("j_r1", 1.2)], &far).own;
        assert!((crossed + 0.24).abs() < 1e-9, "{crossed}");
    }

    // The slider's own link has no length: without its stroke nothing would be near the target.
    #[test]
    fn the_stroke_of_a_slider_is_covered() {
        let at_the_side = Vector3::new(3.0, 0.0, 11.0);
        let left = branched_at(&[("j_s1", 5.0)], &at_the_side).keep_out;
        assert!((left - (3.0 - 0.9 - 0.12)).abs() < 1e-9, "{left}");
        let left = branched_at(&[("j_s1", 0.0)], &at_the_side).keep_out;
        assert!(
            (left - (13.0_f64.sqrt() - 0.9 - 0.12)).abs() < 1e-9,
            "{left}"
        );
    }
}
