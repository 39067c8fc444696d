//! The articulated-body formulation: what the kernels need to serve one model and one state.

use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};

use super::kernel::{
    LinkScratch, SpatialForce, SubtreeMomentum, Tree, Vec3, base_angular_velocity, forward_dynamics,
};
use super::{Formulation, Input, State, TreeAcceleration, TreeMotion};
use crate::model::Model;
use crate::spatial::Twist;

/// Forward dynamics by articulated bodies in link frames: linear in the number of joints and at full
/// precision, whatever their number.
#[derive(Debug, Clone)]
pub struct ArticulatedBody {
    tree: Tree,
    pub(super) arch: Arch,
    links: Vec<LinkScratch<f64>>,
    subtrees: Vec<SubtreeMomentum<f64>>,
    external: Vec<SpatialForce<f64>>,
}

impl ArticulatedBody {
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

    /// Accelerations of a state on which no external wrench acts; returns the base's angular velocity, base
    /// axes, which follows from the momentum. To be called inside a dispatch.
    #[inline(always)]
    pub(super) fn accelerate_free(
        &mut self,
        simd: impl Simd,
        state: &State,
        efforts: &[f64],
        out: &mut TreeAcceleration,
    ) -> Vector3<f64> {
        self.set_joints(simd, state.q.as_slice(), state.qd.as_slice(), efforts);
        let momentum_B = (state.R_WB).inverse_transform_vector(&state.momentum_W.angular);
        let momentum = self.tree.to_base_kernel(Vec3(momentum_B.into()));
        let w = base_angular_velocity(&self.tree, &self.links, &mut self.subtrees, momentum);
        self.links[0].w = w;
        forward_dynamics(&self.tree, &mut self.links, None);
        self.tell(out);
        self.tree.to_base_frame(w).0.into()
    }

    /// Power of all joints' efforts, springs and dampers included, after an evaluation \[W\].
    #[inline(always)]
    pub(super) fn joint_power(&self) -> f64 {
        let mut power = 0.0;
        for link in &self.links[1..] {
            power += link.effort * link.qd;
        }
        power
    }

    #[inline(always)]
    fn set_joints(&mut self, simd: impl Simd, q: &[f64], qd: &[f64], efforts: &[f64]) {
        let n = self.tree.dof();
        let (q, qd, efforts) = (&q[..n], &qd[..n], &efforts[..n]);
        let links = &mut self.links[1..];
        (self.tree).for_each_rotation(simd, q, |j, q, turn| {
            (links[j].q, links[j].rotation) = (q, turn)
        });
        for (j, link) in links.iter_mut().enumerate() {
            link.qd = qd[j];
            link.effort = self.tree.total_effort(j, efforts[j], q[j], qd[j]);
        }
    }

    #[inline(always)]
    fn tell(&self, out: &mut TreeAcceleration) {
        let base = &self.links[0].acceleration;
        out.A_WB_B = Twist::new(
            self.tree.to_base_frame(base.angular).0.into(),
            self.tree.to_base_frame(base.linear).0.into(),
        );
        let qdd = out.qdd.as_mut_slice().iter_mut();
        for (qdd, link) in qdd.zip(&self.links[1..]) {
            *qdd = link.qdd;
        }
    }
}

impl Formulation for ArticulatedBody {
    fn accelerations(
        &mut self,
        _model: &Model,
        motion: &TreeMotion,
        input: &Input,
        out: &mut TreeAcceleration,
    ) {
        self.arch.dispatch(Evaluation {
            dynamics: self,
            motion,
            input,
            out,
        });
    }
}

/// One evaluation, for `pulp` to compile.
struct Evaluation<'a> {
    dynamics: &'a mut ArticulatedBody,
    motion: &'a TreeMotion<'a>,
    input: &'a Input,
    out: &'a mut TreeAcceleration,
}

impl WithSimd for Evaluation<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (dynamics, motion, input) = (self.dynamics, self.motion, self.input);
        dynamics.set_joints(simd, motion.q, motion.qd, input.efforts.as_slice());
        let w = Vec3(motion.V_WB_B.angular.into());
        dynamics.links[0].w = dynamics.tree.to_base_kernel(w);
        let loaded = dynamics
            .tree
            .set_external_forces(&input.wrenches, &mut dynamics.external);
        let external = loaded.then_some(&dynamics.external[..]);
        forward_dynamics(&dynamics.tree, &mut dynamics.links, external);
        dynamics.tell(self.out);
    }
}
