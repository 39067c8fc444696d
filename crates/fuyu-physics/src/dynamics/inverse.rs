//! What efforts a motion takes.

use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};

use super::TreeMotion;
use super::kernel::{
    LinkScratch, SpatialForce, SpatialMotion, SubtreeMomentum, Tree, Vec3, inverse_dynamics,
    locked_inertia,
};
use crate::model::Model;
use crate::spatial::{Twist, Wrench};

/// Inverse dynamics of a tree on a floating base by recursive Newton-Euler: linear in the number of
/// joints.
#[derive(Debug, Clone)]
pub struct InverseDynamics {
    tree: Tree,
    arch: Arch,
    links: Vec<LinkScratch<f64>>,
    subtrees: Vec<SubtreeMomentum<f64>>,
    external: Vec<SpatialForce<f64>>,
}

impl InverseDynamics {
    /// Scratch for `model`; the only place where memory is taken.
    pub fn new(model: &Model) -> Self {
        let tree = Tree::new(model);
        Self {
            arch: Arch::new(),
            links: vec![LinkScratch::new(0.0); tree.bodies.len()],
            subtrees: vec![SubtreeMomentum::new(0.0); tree.bodies.len()],
            external: vec![SpatialForce::zero(0.0); tree.bodies.len()],
            tree,
        }
    }

    /// Efforts \[N m or N\] that actuators must give beside springs, dampers and `wrenches` (one per body,
    /// about its frame's origin in its axes) for joint accelerations `qdd`, while the base accelerates with
    /// `A_WB_B` (its origin as a point; base axes). Returns the wrench on the base, about its frame's
    /// origin in its axes, that this takes.
    ///
    /// # Panics
    /// If a slice does not fit the model.
    pub fn efforts(
        &mut self,
        motion: &TreeMotion,
        A_WB_B: &Twist,
        qdd: &[f64],
        wrenches: &[Wrench],
        efforts: &mut [f64],
    ) -> Wrench {
        self.arch.dispatch(Evaluation {
            dynamics: self,
            motion,
            base: Some(A_WB_B),
            qdd,
            wrenches,
            efforts,
        })
    }

    /// [`InverseDynamics::efforts`] for a base on which nothing but `wrenches` acts. Returns how it
    /// accelerates: angular, and its frame's origin as a point, base axes.
    ///
    /// # Panics
    /// If a slice does not fit the model.
    pub fn free_floating_efforts(
        &mut self,
        motion: &TreeMotion,
        qdd: &[f64],
        wrenches: &[Wrench],
        efforts: &mut [f64],
    ) -> Twist {
        self.arch.dispatch(Evaluation {
            dynamics: self,
            motion,
            base: None,
            qdd,
            wrenches,
            efforts,
        });
        let (R_BK, base) = (
            &self.tree.bodies[0].X_BK.rotation,
            &self.links[0].acceleration,
        );
        let [angular, linear] = [base.angular, base.linear].map(|v| R_BK * Vector3::from(v.0));
        Twist::new(angular, linear)
    }
}

/// One evaluation, for `pulp` to compile.
struct Evaluation<'a> {
    dynamics: &'a mut InverseDynamics,
    motion: &'a TreeMotion<'a>,
    /// Acceleration of the base; without it that of a free one is found.
    base: Option<&'a Twist>,
    qdd: &'a [f64],
    wrenches: &'a [Wrench],
    efforts: &'a mut [f64],
}

impl WithSimd for Evaluation<'_> {
    type Output = Wrench;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Wrench {
        let InverseDynamics {
            tree,
            links,
            subtrees,
            external,
            ..
        } = self.dynamics;
        let n = tree.dof();
        let (q, qd, qdd) = (&self.motion.q[..n], &self.motion.qd[..n], &self.qdd[..n]);
        let efforts = &mut self.efforts[..n];
        tree.for_each_rotation(simd, q, |j, q, turn| {
            (links[j + 1].q, links[j + 1].rotation) = (q, turn);
            (links[j + 1].qd, links[j + 1].qdd) = (qd[j], qdd[j]);
        });
        let loaded = tree.set_external_forces(self.wrenches, external);
        let external = loaded.then_some(&external[..]);
        let R_BK = &tree.bodies[0].X_BK.rotation;
        let turned = |v: &Vector3<f64>| Vec3(R_BK.inverse_transform_vector(v).into());
        links[0].w = turned(&self.motion.V_WB_B.angular);
        links[0].acceleration = match self.base {
            Some(base) => SpatialMotion {
                angular: turned(&base.angular),
                linear: turned(&base.linear),
            },
            None => {
                links[0].acceleration = SpatialMotion::zero(0.0);
                let held = inverse_dynamics(tree, links, external);
                locked_inertia(tree, links, subtrees).free_acceleration(held)
            }
        };
        let base = inverse_dynamics(tree, links, external);
        for (j, effort) in efforts.iter_mut().enumerate() {
            *effort = links[j + 1].effort - tree.total_effort(j, 0.0, q[j], qd[j]);
        }
        Wrench::new(
            R_BK * Vector3::from(base.torque.0),
            R_BK * Vector3::from(base.force.0),
        )
    }
}
