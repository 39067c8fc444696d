//! The articulated-body formulation: what the kernels need to serve one model and one state.

use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};

use super::kernel::{
    Branch, Force, Fused, GROUP, Scalar, Slot, Tree, Vec3, forward_dynamics, sin_cos,
};
use super::{Formulation, Input, TreeAcceleration, TreeMotion};
use crate::model::Model;
use crate::spatial::{Pose, Twist, Wrench};

/// Forward dynamics by articulated bodies in link frames: linear in the number of joints and at full
/// precision, whatever their number.
#[derive(Debug, Clone)]
pub struct ArticulatedBody {
    tree: Tree,
    arch: Arch,
    sweeps: Sweeps,
}

/// Scratch in the numbers that suit the machine.
#[derive(Debug, Clone)]
enum Sweeps {
    Plain(Scratch<f64>),
    Fused(Scratch<Fused>),
}

#[derive(Debug, Clone)]
struct Scratch<S> {
    slots: Vec<Slot<S>>,
    branches: Vec<Branch<S>>,
    external: Vec<Force<S>>,
}

/// A real number of this machine.
trait Real: Scalar {
    fn of(value: f64) -> Self;
    fn value(self) -> f64;
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn value(self) -> f64 {
        self
    }
}

impl Real for Fused {
    #[inline(always)]
    fn of(value: f64) -> Self {
        Self(value)
    }
    #[inline(always)]
    fn value(self) -> f64 {
        self.0
    }
}

impl ArticulatedBody {
    /// Scratch for `model`; the only place where memory is taken.
    pub fn new(model: &Model) -> Self {
        let tree = Tree::new(model);
        let arch = Arch::new();
        let sweeps = if arch.dispatch(Fuses) {
            Sweeps::Fused(Scratch::new(&tree))
        } else {
            Sweeps::Plain(Scratch::new(&tree))
        };
        Self { tree, arch, sweeps }
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
        let (tree, arch) = (&self.tree, self.arch);
        match &mut self.sweeps {
            Sweeps::Plain(scratch) => arch.dispatch(Run {
                tree,
                scratch,
                motion,
                input,
                out,
            }),
            Sweeps::Fused(scratch) => arch.dispatch(Run {
                tree,
                scratch,
                motion,
                input,
                out,
            }),
        }
    }
}

/// Asks whether the machine multiplies and adds in one instruction.
struct Fuses;

impl WithSimd for Fuses {
    type Output = bool;
    #[inline(always)]
    fn with_simd<L: Simd>(self, _: L) -> bool {
        L::F64_LANES > 1
    }
}

/// One evaluation.
struct Run<'a, S> {
    tree: &'a Tree,
    scratch: &'a mut Scratch<S>,
    motion: &'a TreeMotion<'a>,
    input: &'a Input,
    out: &'a mut TreeAcceleration,
}

impl<S: Real> WithSimd for Run<'_, S> {
    type Output = ();
    #[inline(always)]
    fn with_simd<L: Simd>(self, _: L) {
        let (tree, scratch, input) = (self.tree, self.scratch, self.input);
        let n = tree.dof();
        let (q, qd) = (&self.motion.q[..n], &self.motion.qd[..n]);
        let efforts = &input.efforts.as_slice()[..n];
        scratch.place(tree, q);
        for (j, slot) in scratch.slots.iter_mut().enumerate() {
            slot.qd = S::of(qd[j]);
            slot.effort = S::of(tree.effort(j, efforts[j], q[j], qd[j]));
        }
        let loaded = scratch.load(tree, &input.wrenches);
        let X_BK = &tree.bodies[0].X_BK;
        let w = vec3(&(X_BK.rotation.inverse() * self.motion.V_WB_B.angular));
        let external = loaded.then_some(&scratch.external[..]);
        let base = forward_dynamics(tree, &mut scratch.slots, &mut scratch.branches, w, external);
        self.out.A_WB_B = Twist::new(
            X_BK.rotation * vector(base.angular),
            X_BK.rotation * vector(base.linear),
        );
        for (qdd, slot) in self.out.qdd.as_mut_slice().iter_mut().zip(&scratch.slots) {
            *qdd = slot.qdd.value();
        }
    }
}

impl<S: Real> Scratch<S> {
    fn new(tree: &Tree) -> Self {
        let zero = S::of(0.0);
        Self {
            slots: vec![Slot::new(zero); tree.dof()],
            branches: vec![Branch::new(zero); tree.bodies.len()],
            external: vec![Force::zero(zero); tree.bodies.len()],
        }
    }

    #[inline(always)]
    fn place(&mut self, tree: &Tree, q: &[f64]) {
        let groups = q.chunks(GROUP).zip(tree.hops.chunks(GROUP));
        for ((q, hops), slots) in groups.zip(self.slots.chunks_mut(GROUP)) {
            let mut angles = [0.0; GROUP];
            angles[..q.len()].copy_from_slice(q);
            let (cos, sin) = sin_cos(&angles);
            for (i, (slot, hop)) in slots.iter_mut().zip(hops).enumerate() {
                slot.place(hop, S::of(q[i]), S::of(cos[i]), S::of(sin[i]));
            }
        }
    }

    /// Takes over wrenches into the kernel frames. Says whether there is any.
    #[inline(always)]
    fn load(&mut self, tree: &Tree, wrenches: &[Wrench]) -> bool {
        if wrenches.iter().all(|wrench| *wrench == Wrench::ZERO) {
            return false;
        }
        for ((into, wrench), body) in self.external.iter_mut().zip(wrenches).zip(&tree.bodies) {
            *into = external(wrench, &body.X_BK);
        }
        true
    }
}

fn external<S: Real>(wrench: &Wrench, X_BK: &Pose) -> Force<S> {
    let wrench = wrench.shifted_to_child(X_BK);
    Force {
        torque: vec3(&wrench.torque),
        force: vec3(&wrench.force),
    }
}

#[inline(always)]
fn vec3<S: Real>(v: &Vector3<f64>) -> Vec3<S> {
    Vec3([v.x, v.y, v.z].map(S::of))
}

#[inline(always)]
fn vector<S: Real>(v: Vec3<S>) -> Vector3<f64> {
    Vector3::from(v.0.map(S::value))
}
