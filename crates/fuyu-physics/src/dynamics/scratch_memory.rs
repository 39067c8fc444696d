//! Preallocated memory of the recursions over one tree.

use std::sync::Arc;

use pulp::Arch;

use super::InstructionSets;
use super::kernel::{LinkScratch, SpatialForce, SubtreeMomentum, Tree};
use crate::model::Model;

/// Data of one robot for forward and inverse dynamics: its compiled tree, and one entry per body in each list.
#[derive(Debug, Clone)]
pub(super) struct DynamicsScratch {
    pub(super) model: Model,
    pub(super) tree: Arc<Tree>,
    /// Instruction set of the processor.
    pub(super) arch: Arch,
    pub(super) links: Vec<LinkScratch<f64>>,
    pub(super) subtrees: Vec<SubtreeMomentum<f64>>,
    pub(super) external: Vec<SpatialForce<f64>>,
}

impl DynamicsScratch {
    /// Allocates.
    pub(super) fn new(model: &Model) -> Self {
        let arch = InstructionSets::of_this_processor().forward_dynamics;
        Self::with_instruction_set(model, arch)
    }

    pub(super) fn with_instruction_set(model: &Model, arch: Arch) -> Self {
        let tree = Tree::shared(model);
        Self {
            model: model.clone(),
            arch,
            links: vec![LinkScratch::new(0.0); tree.bodies.len()],
            subtrees: vec![SubtreeMomentum::new(0.0); tree.bodies.len()],
            external: vec![SpatialForce::zero(0.0); tree.bodies.len()],
            tree,
        }
    }
}
