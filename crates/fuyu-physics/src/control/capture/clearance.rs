//! Distances between the arm, the base and the target: capsules and spheres.

use nalgebra::{Point3, Vector3};

use crate::dynamics::Workspace;
use crate::model::{Frame, Model};
use crate::spatial::Pose;

/// Sizes of the shapes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClearanceConfig {
    /// Radius of the capsules around the links \[m\].
    pub link_radius: f64,
    /// Radius of the sphere around the base's centre of mass \[m\].
    pub base_radius: f64,
    /// Radius of the sphere around the target's centre of mass that nothing may enter before the final approach \[m\].
    pub keep_out: f64,
    /// Least distance between shapes of the robot \[m\].
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

/// A link's axis, in the frame of its body.
#[derive(Debug, Clone)]
struct Capsule {
    frame: Frame,
    from: Vector3<f64>,
    to: Vector3<f64>,
    /// Number of joints between it and the base.
    depth: usize,
}

/// The shapes of a robot.
#[derive(Debug, Clone)]
pub struct Clearance {
    config: ClearanceConfig,
    capsules: Vec<Capsule>,
    base: Vector3<f64>,
}

/// Distances that are left \[m\]; negative where shapes overlap, infinite where there is nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distances {
    /// Between the arm and the keep-out sphere.
    pub keep_out: f64,
    /// Between parts of the robot that are not neighbours.
    pub own: f64,
}

impl Distances {
    /// The smaller of each.
    #[must_use]
    pub fn least(self, other: Self) -> Self {
        Self {
            keep_out: self.keep_out.min(other.keep_out),
            own: self.own.min(other.own),
        }
    }
}

impl Clearance {
    /// Capsules from joint to joint, and from the last one to the tip.
    pub fn new(model: &Model, tip: &Frame, config: ClearanceConfig) -> Self {
        let mut capsules = Vec::new();
        let bodies = model.bodies().len();
        let mut depth = vec![0; bodies];
        for body in 1..bodies {
            let parent = model.tree_parent(body - 1);
            depth[body] = depth[parent] + 1;
            let end_of = |from: Vector3<f64>, to: Vector3<f64>, body: usize| {
                let own = model.frames().iter();
                let mut own = own.filter(|f| f.body == body);
                let frame = own.find(|f| f.name == model.bodies()[body].name);
                frame.map(|frame| (frame.clone(), from, to))
            };
            let origin = Vector3::zeros();
            let mut ends = Vec::new();
            for child in (body + 1)..bodies {
                if model.tree_parent(child - 1) == body {
                    ends.push(model.tree_joint(child - 1).X_PJ.translation.vector);
                }
            }
            if tip.body == body {
                ends.push(tip.X_BF.translation.vector);
            }
            for end in ends.into_iter().filter(|end| end.norm() > 1e-6) {
                if let Some((frame, from, to)) = end_of(origin, end, body) {
                    capsules.push(Capsule {
                        frame,
                        from,
                        to,
                        depth: depth[body],
                    });
                }
            }
        }
        Self {
            config,
            capsules,
            base: model.bodies()[0].inertia.com,
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
        let ends = self.capsules.iter().map(|capsule| {
            let X_BK = workspace.X_BF(&capsule.frame);
            let at = |p: &Vector3<f64>| (X_BK * Point3::from(*p)).coords;
            (at(&capsule.from), at(&capsule.to), capsule.depth)
        });
        let ends: Vec<_> = ends.collect();
        let center = center.map(|c| X_IB.inverse_transform_point(&Point3::from(*c)).coords);
        let mut found = Distances {
            keep_out: f64::INFINITY,
            own: f64::INFINITY,
        };
        for (i, (a, b, depth)) in ends.iter().enumerate() {
            if let Some(center) = &center {
                let apart = point_segment(center, a, b) - self.config.keep_out - radius;
                found.keep_out = found.keep_out.min(apart);
            }
            if *depth > 1 {
                let apart = point_segment(&self.base, a, b) - self.config.base_radius - radius;
                found.own = found.own.min(apart);
            }
            for (c, d, other) in &ends[i + 1..] {
                // Neighbours touch; those next to them would overlap where a link between is shorter than wide.
                if other.abs_diff(*depth) > 2 {
                    found.own = found.own.min(segments(a, b, c, d) - 2.0 * radius);
                }
            }
        }
        found
    }
}

/// Distance of a point from a segment.
fn point_segment(p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let along = b - a;
    let s = ((p - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (p - a - along * s).norm()
}

/// Distance of two segments (C. Ericson, Real-Time Collision Detection, 2005, section 5.1.9).
fn segments(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>, d: &Vector3<f64>) -> f64 {
    let (u, v, w) = (b - a, d - c, a - c);
    let (uu, vv, uv) = (u.norm_squared(), v.norm_squared(), u.dot(&v));
    let (uw, vw) = (u.dot(&w), v.dot(&w));
    let determinant = uu * vv - uv * uv;
    let s = match determinant > 1e-12 * uu * vv {
        true => ((uv * vw - vv * uw) / determinant).clamp(0.0, 1.0),
        false => 0.0,
    };
    let t = (uv * s + vw) / vv;
    let (s, t) = match t {
        t if t < 0.0 => ((-uw / uu).clamp(0.0, 1.0), 0.0),
        t if t > 1.0 => (((uv - uw) / uu).clamp(0.0, 1.0), 1.0),
        t => (s, t),
    };
    (w + u * s - v * t).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::fixtures::servicer;
    use nalgebra::DVector;

    // By sampling both segments finely.
    #[test]
    fn distances_of_segments_are_those_of_their_points() {
        let mut x = 0.37_f64;
        let mut next = || {
            x = (x * 997.13).fract();
            2.0 * x - 1.0
        };
        for k in 0..200 {
            let mut point = || Vector3::new(next(), next(), next());
            let (a, b, c) = (point(), point(), point());
            // Every fifth pair is parallel.
            let d = match k % 5 {
                0 => c + (b - a) * 0.7,
                _ => point(),
            };
            let sampled = (0..=200)
                .map(|i| point_segment(&a.lerp(&b, f64::from(i) / 200.0), &c, &d))
                .fold(f64::INFINITY, f64::min);
            let found = segments(&a, &b, &c, &d);
            assert!(
                found <= sampled + 1e-12 && found > sampled - 0.02,
                "{found} {sampled}"
            );
        }
    }

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
}
