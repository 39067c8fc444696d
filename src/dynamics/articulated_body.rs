//! The articulated-body formulation: what the kernels need to serve one model and one state.

use nalgebra::Vector3;
use pulp::{Arch, NullaryFnOnce};

use super::kernel::{Force, Place, Slot, Tree, Vec3, forward_dynamics};
use super::{Formulation, Input, TreeAcceleration, TreeMotion};
use crate::model::Model;
use crate::spatial::Twist;

/// Forward dynamics by articulated bodies in link frames: linear in the number of joints and at full
/// precision, whatever their number.
#[derive(Debug, Clone)]
pub struct ArticulatedBody {
    tree: Tree,
    arch: Arch,
    slots: Vec<Slot<f64>>,
    external: Vec<Force<f64>>,
}

impl ArticulatedBody {
    /// Scratch for `model`; the only place where memory is taken.
    pub fn new(model: &Model) -> Self {
        let tree = Tree::new(model);
        Self {
            arch: Arch::new(),
            slots: vec![Slot::new(0.0); tree.bodies.len()],
            external: vec![Force::zero(0.0); tree.bodies.len()],
            tree,
        }
    }

    /// [`Formulation::accelerations`] where the joints' turns are known already.
    pub(super) fn accelerations_at(
        &mut self,
        places: &[Place<f64>],
        motion: &TreeMotion,
        input: &Input,
        out: &mut TreeAcceleration,
    ) {
        for (slot, place) in self.slots.iter_mut().zip(places) {
            (slot.q, slot.turn) = (place.q, place.turn);
        }
        self.arch.dispatch(Evaluation {
            dynamics: self,
            motion,
            is_placed: true,
            input,
            out,
        });
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
            is_placed: false,
            input,
            out,
        });
    }
}

/// One evaluation, for `pulp` to compile.
struct Evaluation<'a> {
    dynamics: &'a mut ArticulatedBody,
    motion: &'a TreeMotion<'a>,
    /// Whether the slots know the joints' turns.
    is_placed: bool,
    input: &'a Input,
    out: &'a mut TreeAcceleration,
}

impl NullaryFnOnce for Evaluation<'_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let (dynamics, input) = (self.dynamics, self.input);
        let n = dynamics.tree.dof();
        let (q, qd) = (&self.motion.q[..n], &self.motion.qd[..n]);
        if !self.is_placed {
            let slots = &mut dynamics.slots[1..];
            (dynamics.tree).turns(q, |j, q, turn| (slots[j].q, slots[j].turn) = (q, turn));
        }
        let efforts = &input.efforts.as_slice()[..n];
        for (j, slot) in dynamics.slots[1..].iter_mut().enumerate() {
            slot.qd = qd[j];
            slot.effort = dynamics.tree.effort(j, efforts[j], q[j], qd[j]);
        }
        let loaded = dynamics.tree.load(&input.wrenches, &mut dynamics.external);
        let R_BK = &dynamics.tree.bodies[0].X_BK.rotation;
        dynamics.slots[0].w = Vec3(
            R_BK.inverse_transform_vector(&self.motion.V_WB_B.angular)
                .into(),
        );
        let external = loaded.then_some(&dynamics.external[..]);
        forward_dynamics(&dynamics.tree, &mut dynamics.slots, external);
        let base = &dynamics.slots[0].acceleration;
        self.out.A_WB_B = Twist::new(
            R_BK * Vector3::from(base.angular.0),
            R_BK * Vector3::from(base.linear.0),
        );
        for (qdd, slot) in self
            .out
            .qdd
            .as_mut_slice()
            .iter_mut()
            .zip(&dynamics.slots[1..])
        {
            *qdd = slot.qdd;
        }
    }
}
