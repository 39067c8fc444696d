//! Inverse dynamics: the efforts that a given motion requires.

use nalgebra::Vector3;
use pulp::{Simd, WithSimd};

use super::expanded_motion::ExpandedMotion;
use super::kernel::{SpatialMotion, Vec3, inverse_dynamics, locked_inertia};
use super::scratch_memory::DynamicsScratch;
use super::{TreeMotion, checks};
use crate::model::Model;
use crate::spatial::{Twist, Wrench};

/// Inverse dynamics of a tree on a floating base by recursive Newton-Euler: linear in the number of
/// joints.
#[derive(Debug, Clone)]
pub struct InverseDynamics {
    scratch: DynamicsScratch,
    expanded: ExpandedMotion,
    /// Accelerations and efforts of the tree's joints; empty without mimic joints.
    tree: [Vec<f64>; 2],
}

impl InverseDynamics {
    /// Inverse dynamics of `model`. Allocates; evaluations do not.
    pub fn new(model: &Model) -> Self {
        let scratch = DynamicsScratch::new(model);
        let joints = if model.has_mimics() {
            scratch.tree.dof()
        } else {
            0
        };
        Self {
            expanded: ExpandedMotion::new(model),
            tree: [(); 2].map(|()| vec![0.0; joints]),
            scratch,
        }
    }

    /// Actuator efforts \[N m or N\] for joint accelerations `qdd` while the base accelerates with `A_WB_B` (its origin
    /// as a point; base axes). Springs, dampers and `wrenches` (one per body, about its frame's origin in its axes; an
    /// empty slice means none) act as well. Returns the wrench that the base needs, about its frame's origin in its
    /// axes.
    ///
    /// # Panics
    /// If the length of a slice does not fit the robot.
    pub fn efforts(
        &mut self,
        motion: &TreeMotion,
        A_WB_B: &Twist,
        qdd: &[f64],
        wrenches: &[Wrench],
        efforts: &mut [f64],
    ) -> Wrench {
        self.evaluate(motion, Some(A_WB_B), qdd, wrenches, efforts)
    }

    /// [`InverseDynamics::efforts`] for a free base. Returns the base's acceleration: angular \[rad/s²\], and of its
    /// frame's origin as a point \[m/s²\], base axes.
    ///
    /// # Panics
    /// If the length of a slice does not fit the robot.
    pub fn free_floating_efforts(
        &mut self,
        motion: &TreeMotion,
        qdd: &[f64],
        wrenches: &[Wrench],
        efforts: &mut [f64],
    ) -> Twist {
        self.evaluate(motion, None, qdd, wrenches, efforts);
        let DynamicsScratch { tree, links, .. } = &self.scratch;
        let (R_BK, base) = (&tree.bodies[0].X_BK.rotation, &links[0].acceleration);
        let [angular, linear] = [base.angular, base.linear].map(|v| R_BK * Vector3::from(v.0));
        Twist::new(angular, linear)
    }

    fn evaluate(
        &mut self,
        motion: &TreeMotion,
        base: Option<&Twist>,
        qdd: &[f64],
        wrenches: &[Wrench],
        efforts: &mut [f64],
    ) -> Wrench {
        let model = &self.scratch.model;
        checks::joint_vector("motion.q", motion.q.len(), model);
        checks::joint_vector("motion.qd", motion.qd.len(), model);
        checks::joint_vector("qdd", qdd.len(), model);
        if !wrenches.is_empty() {
            checks::body_vector("wrenches", wrenches.len(), model);
        }
        checks::joint_vector("efforts", efforts.len(), model);
        let arch = self.scratch.arch;
        if !model.has_mimics() {
            return arch.dispatch(RecursiveNewtonEuler {
                scratch: &mut self.scratch,
                motion: *motion,
                base,
                qdd,
                wrenches,
                efforts,
            });
        }
        let [tree_qdd, tree_efforts] = &mut self.tree;
        let motion = self.expanded.of(model, motion);
        model.expand_rates(qdd, tree_qdd);
        let base = arch.dispatch(RecursiveNewtonEuler {
            scratch: &mut self.scratch,
            motion,
            base,
            qdd: tree_qdd,
            wrenches,
            efforts: tree_efforts,
        });
        (self.scratch.model).gather_efforts(tree_efforts, efforts);
        base
    }
}

/// One evaluation; `pulp` compiles it for every instruction set.
struct RecursiveNewtonEuler<'a> {
    scratch: &'a mut DynamicsScratch,
    motion: TreeMotion<'a>,
    /// Acceleration of the base; `None` for a free base, whose acceleration is computed.
    base: Option<&'a Twist>,
    qdd: &'a [f64],
    wrenches: &'a [Wrench],
    efforts: &'a mut [f64],
}

impl WithSimd for RecursiveNewtonEuler<'_> {
    type Output = Wrench;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Wrench {
        let DynamicsScratch {
            tree,
            links,
            subtrees,
            external,
            ..
        } = self.scratch;
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
        let to_kernel = |v: &Vector3<f64>| Vec3(R_BK.inverse_transform_vector(v).into());
        links[0].w = to_kernel(&self.motion.V_WB_B.angular);
        links[0].acceleration = match self.base {
            Some(base) => SpatialMotion {
                angular: to_kernel(&base.angular),
                linear: to_kernel(&base.linear),
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
