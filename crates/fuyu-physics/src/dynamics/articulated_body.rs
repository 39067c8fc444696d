//! Forward dynamics by the articulated-body algorithm.

use pulp::{Arch, Simd, WithSimd};

use super::formulation::evaluate_with_base_twist;
use super::kernel::{Vec3, base_angular_velocity, forward_dynamics};
use super::scratch_memory::DynamicsScratch;
use super::{
    Evaluation, Formulation, Input, Reduced, State, TreeAcceleration, TreeMotion, Workspace, checks,
};
use crate::model::Model;
use crate::spatial::{Twist, Wrench};

/// Forward dynamics by the articulated-body algorithm in link frames. Cost is linear in the number of joints, and
/// precision does not depend on that number. A mimic joint couples branches, which the recursion from the tips to the
/// base cannot express: robots with mimic joints are evaluated by [`Reduced`].
#[derive(Debug, Clone)]
pub struct ArticulatedBody {
    pub(super) scratch: DynamicsScratch,
    /// The method for robots with mimic joints.
    coupled: Option<Box<Reduced>>,
}

impl ArticulatedBody {
    /// The formulation for `model`. Allocates; evaluations do not.
    pub fn new(model: &Model) -> Self {
        Self {
            scratch: DynamicsScratch::new(model),
            coupled: model.has_mimics().then(|| Box::new(Reduced::new(model))),
        }
    }

    /// As [`ArticulatedBody::new`], with another instruction set, for a robot without mimic joints.
    pub(super) fn with_instruction_set(model: &Model, arch: Arch) -> Self {
        Self {
            scratch: DynamicsScratch::with_instruction_set(model, arch),
            coupled: None,
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn set_joints(&mut self, simd: impl Simd, q: &[f64], qd: &[f64], efforts: &[f64]) {
        let DynamicsScratch { tree, links, .. } = &mut self.scratch;
        let n = tree.dof();
        let (q, qd, efforts) = (&q[..n], &qd[..n], &efforts[..n]);
        let links = &mut links[1..];
        tree.for_each_rotation(simd, q, |j, q, turn| {
            (links[j].q, links[j].rotation) = (q, turn)
        });
        for (j, link) in links.iter_mut().enumerate() {
            link.qd = qd[j];
            link.effort = tree.total_effort(j, efforts[j], q[j], qd[j]);
        }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn write_accelerations(&self, out: &mut TreeAcceleration) {
        let DynamicsScratch { tree, links, .. } = &self.scratch;
        let base = &links[0].acceleration;
        out.A_WB_B = Twist::new(
            tree.to_base_frame(base.angular).0.into(),
            tree.to_base_frame(base.linear).0.into(),
        );
        for (qdd, link) in out.qdd.as_mut_slice().iter_mut().zip(&links[1..]) {
            *qdd = link.qdd;
        }
    }
}

impl Formulation for ArticulatedBody {
    fn accelerations(&mut self, motion: &TreeMotion, input: &Input, out: &mut TreeAcceleration) {
        if let Some(coupled) = &mut self.coupled {
            coupled.accelerations(motion, input, out);
            return;
        }
        checks::formulation(motion, input, out, &self.scratch.model);
        self.scratch.arch.dispatch(GivenBaseTwist {
            dynamics: self,
            motion,
            input,
            out,
        });
    }

    /// Without external wrenches no poses are needed: one sweep computes the base's angular velocity.
    fn evaluate(
        &mut self,
        state: &State,
        workspace: &mut Workspace,
        input: &Input,
        out: &mut Evaluation,
    ) {
        if self.coupled.is_some() || Wrench::any(&input.wrenches) {
            evaluate_with_base_twist(self, state, workspace, input, out);
        } else {
            self.scratch.arch.dispatch(FreeFloating {
                dynamics: self,
                state,
                efforts: input.efforts.as_slice(),
                out,
            });
        }
    }
}

/// Accelerations for a given base twist; `pulp` compiles it for every instruction set.
struct GivenBaseTwist<'a> {
    dynamics: &'a mut ArticulatedBody,
    motion: &'a TreeMotion<'a>,
    input: &'a Input,
    out: &'a mut TreeAcceleration,
}

impl WithSimd for GivenBaseTwist<'_> {
    type Output = ();
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn with_simd<S: Simd>(self, simd: S) {
        let (dynamics, motion, input) = (self.dynamics, self.motion, self.input);
        dynamics.set_joints(simd, motion.q, motion.qd, input.efforts.as_slice());
        let DynamicsScratch {
            tree,
            links,
            external,
            ..
        } = &mut dynamics.scratch;
        let w = Vec3(motion.V_WB_B.angular.into());
        links[0].w = tree.to_base_kernel(w);
        let loaded = tree.set_external_forces(&input.wrenches, external);
        let external = loaded.then_some(&external[..]);
        forward_dynamics(tree, links, external);
        dynamics.write_accelerations(self.out);
    }
}

/// Accelerations of a state without external wrenches; the base's angular velocity follows from momentum. `pulp`
/// compiles it for every instruction set.
struct FreeFloating<'a> {
    dynamics: &'a mut ArticulatedBody,
    state: &'a State,
    efforts: &'a [f64],
    out: &'a mut Evaluation,
}

impl WithSimd for FreeFloating<'_> {
    type Output = ();
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn with_simd<S: Simd>(self, simd: S) {
        let (dynamics, state, out) = (self.dynamics, self.state, self.out);
        dynamics.set_joints(simd, state.q.as_slice(), state.qd.as_slice(), self.efforts);
        let DynamicsScratch {
            tree,
            links,
            subtrees,
            ..
        } = &mut dynamics.scratch;
        let momentum_B = (state.R_WB).inverse_transform_vector(&state.momentum_W.angular);
        let momentum = tree.to_base_kernel(Vec3(momentum_B.into()));
        let w = base_angular_velocity(tree, links, subtrees, momentum);
        links[0].w = w;
        forward_dynamics(tree, links, None);
        out.w_WB_B = tree.to_base_frame(w).0.into();
        out.external = None;
        out.power = 0.0;
        for link in &links[1..] {
            out.power += link.effort * link.qd;
        }
        dynamics.write_accelerations(&mut out.acceleration);
    }
}
