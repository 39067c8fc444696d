//! Closed loops, cut open at a hinge: TR-942 section 2.3.3.

use nalgebra::{DMatrix, DVector, Vector3};

use super::CutError;
use super::bodies::KaneBody;
use super::matching::ConstraintMatching;
use crate::model::Model;
use crate::spatial::{Pose, Twist, Wrench};

/// A hinge at which a loop is cut. It connects two bodies of the tree; its constraint forces are unknowns instead of
/// its motion.
///
/// The constrained directions are axes of the hinge frame `H` on body `k`. A pin constrains all three translations and
/// the two rotations across its axis; in a planar mechanism, only the two translations in the plane (the other
/// constraints are satisfied already, and repeating them leaves the forces undetermined).
#[derive(Debug, Clone, PartialEq)]
pub struct CutHinge {
    /// Body `k`, which carries the constrained directions.
    pub body_k: usize,
    /// Pose of the hinge frame in body `k`.
    pub X_KH: Pose,
    /// Body `l`.
    pub body_l: usize,
    /// Pose of the hinge frame in body `l`. In a closed loop, it coincides with the other frame up to the free
    /// directions.
    pub X_LH: Pose,
    /// Whether translations along the axes x, y, z of `H` are constrained (`x_kp`).
    pub translations: [bool; 3],
    /// Whether rotations about the axes x, y, z of `H` are constrained (`y_kp`).
    pub rotations: [bool; 3],
}

/// A checked cut: its constraints, and the hinges that move them.
#[derive(Debug, Clone)]
pub(super) struct Cut {
    hinge: CutHinge,
    /// Index of its first column.
    first: usize,
    /// Hinges between body `k` and the last common body, and between the last common body and body `l`.
    k_path: Vec<usize>,
    l_path: Vec<usize>,
}

impl Cut {
    /// Checks `hinges` against `model`.
    pub(super) fn all(model: &Model, hinges: &[CutHinge]) -> Result<Vec<Self>, CutError> {
        let mut cuts = Vec::with_capacity(hinges.len());
        let mut matching = ConstraintMatching::new(model.bodies().len());
        for (cut, hinge) in hinges.iter().enumerate() {
            check_ends(model, cut, hinge)?;
            let [k_path, l_path] = paths(model, hinge.body_k, hinge.body_l);
            let compiled = Self {
                hinge: hinge.clone(),
                first: matching.count(),
                k_path,
                l_path,
            };
            if compiled.count() == 0 {
                return Err(CutError::Unconstrained { cut });
            }
            let on_loop: Vec<_> =
                (compiled.k_path.iter().chain(&compiled.l_path).copied()).collect();
            // Prismatic hinges do not affect rotations.
            let mut revolute = on_loop.clone();
            revolute.retain(|&k| model.tree_joint(k - 1).kind.is_rotational());
            let translations = directions(&hinge.translations).map(|_| &on_loop);
            let rotations = directions(&hinge.rotations).map(|_| &revolute);
            for movers in translations.chain(rotations) {
                if let Err(hinges) = matching.add(movers.clone()) {
                    return Err(CutError::OverConstrained {
                        cut,
                        constraints: hinges + 1,
                        hinges,
                    });
                }
            }
            cuts.push(compiled);
        }
        Ok(cuts)
    }

    /// Number of constrained directions.
    pub(super) fn count(&self) -> usize {
        directions(&self.hinge.translations).count() + directions(&self.hinge.rotations).count()
    }

    /// Writes the cut's columns of `G = -H` (2.3.43), rows of the hinges from `row` on, and its entries of `Ġᵀ u`:
    /// equation (2.3.47), which as printed is `Ġᵀ u` and not `Ḣᵀ u`.
    ///
    /// With one translation free and another constrained (a slot), (2.3.40) as printed is not sufficient: the point of
    /// body `k` is here the one that coincides with body `l`'s end. With all translations constrained, this is the printed
    /// point. Force and reaction then always act along the same line, so that momentum is conserved even if the loop is
    /// slightly open.
    /// slightly open.
    pub(super) fn constrain(
        &self,
        bodies: &[KaneBody],
        row: usize,
        G: &mut DMatrix<f64>,
        rate: &mut DVector<f64>,
    ) {
        let (k, l) = (&bodies[self.hinge.body_k], &bodies[self.hinge.body_l]);
        let r_l = l.R_WB * self.hinge.X_LH.translation.vector;
        let point = l.p + r_l;
        let r_k = point - k.p;
        let (w_k, w_l) = (&k.velocity.angular, &l.velocity.angular);
        let v_k = k.velocity.linear + w_k.cross(&r_k);
        let v_l = l.velocity.linear + w_l.cross(&r_l);
        let slip = v_k - v_l;
        let a_k =
            k.bias.linear + k.bias.angular.cross(&r_k) + w_k.cross(&(v_l - k.velocity.linear));
        let a_l = l.bias.linear + l.bias.angular.cross(&r_l) + w_l.cross(&w_l.cross(&r_l));
        let linear = a_k - a_l + slip.cross(w_k);
        let angular = k.bias.angular - l.bias.angular - w_l.cross(w_k);
        let R_WH = k.R_WB * self.hinge.X_KH.rotation;
        let axis = |i: usize| R_WH.matrix().column(i).into_owned();
        let mut column = self.first;
        for x in directions(&self.hinge.translations).map(axis) {
            self.write_column(&mut G.column_mut(column).as_mut_slice()[row..], |hinge| {
                x.dot(&partial_velocity(&bodies[hinge], &point))
            });
            rate[column] = x.dot(&linear);
            column += 1;
        }
        for y in directions(&self.hinge.rotations).map(axis) {
            self.write_column(&mut G.column_mut(column).as_mut_slice()[row..], |hinge| {
                let body = &bodies[hinge];
                if body.is_prismatic() {
                    0.0
                } else {
                    y.dot(&body.z)
                }
            });
            rate[column] = y.dot(&angular);
            column += 1;
        }
    }

    /// Writes the entries of the hinges on both sides of the loop; the others stay zero.
    fn write_column(&self, column: &mut [f64], entry: impl Fn(usize) -> f64) {
        for &hinge in &self.k_path {
            column[hinge - 1] = entry(hinge);
        }
        for &hinge in &self.l_path {
            column[hinge - 1] = -entry(hinge);
        }
    }

    /// Constraint forces as a wrench on body `k`, axes of `H`, from the multipliers of all cuts.
    pub(super) fn wrench(&self, multipliers: &DVector<f64>) -> Wrench {
        let mut values = multipliers.as_slice()[self.first..].iter();
        let mut take = |constrained: &[bool; 3]| {
            let mut v = Vector3::zeros();
            for i in directions(constrained) {
                v[i] = *values.next().expect("one multiplier for each direction");
            }
            v
        };
        let force = take(&self.hinge.translations);
        let torque = take(&self.hinge.rotations);
        Wrench::new(torque, force)
    }

    /// Velocity of body `l`'s end relative to body `k`, axes of `H`.
    pub(super) fn relative_velocity(&self, bodies: &[KaneBody]) -> Twist {
        let (k, l) = (&bodies[self.hinge.body_k], &bodies[self.hinge.body_l]);
        let r_l = l.R_WB * self.hinge.X_LH.translation.vector;
        let r_k = l.p + r_l - k.p;
        let (V_k, V_l) = (&k.velocity, &l.velocity);
        let linear = V_l.linear + V_l.angular.cross(&r_l) - V_k.linear - V_k.angular.cross(&r_k);
        let R_HW = (k.R_WB * self.hinge.X_KH.rotation).inverse();
        Twist::new(R_HW * (V_l.angular - V_k.angular), R_HW * linear)
    }
}

/// Partial velocity `v^i` of (2.3.20), (2.3.21) at `point`, which is on the hinge's outer set.
fn partial_velocity(body: &KaneBody, point: &Vector3<f64>) -> Vector3<f64> {
    if body.is_prismatic() {
        body.z
    } else {
        body.z.cross(&(point - body.p))
    }
}

fn directions(constrained: &[bool; 3]) -> impl Iterator<Item = usize> + use<> {
    let constrained = *constrained;
    (0..3).filter(move |&i| constrained[i])
}

fn check_ends(model: &Model, cut: usize, hinge: &CutHinge) -> Result<(), CutError> {
    let bodies = model.bodies().len();
    for (body, X) in [(hinge.body_k, &hinge.X_KH), (hinge.body_l, &hinge.X_LH)] {
        if body >= bodies {
            return Err(CutError::NoSuchBody { cut, body, bodies });
        }
        let finite = X.translation.vector.iter().chain(X.rotation.matrix());
        if !finite.copied().all(f64::is_finite) {
            let body = model.bodies()[body].name.clone();
            return Err(CutError::NotFinite { cut, body });
        }
    }
    if hinge.body_k == hinge.body_l {
        let body = model.bodies()[hinge.body_k].name.clone();
        return Err(CutError::SameBody { cut, body });
    }
    Ok(())
}

/// Hinges that move `k` but not `l`, and those that move `l` but not `k`, each by the index of the body that it moves.
fn paths(model: &Model, k: usize, l: usize) -> [Vec<usize>; 2] {
    let moves =
        |hinge: usize, body: usize| (hinge..model.bodies()[hinge].subtree_end).contains(&body);
    let between = |of: usize, not: usize| {
        let hinges = 1..model.bodies().len();
        hinges.filter(|&h| moves(h, of) && !moves(h, not)).collect()
    };
    [between(k, l), between(l, k)]
}
