//! Preallocated memory of the recursions over one tree.

use std::sync::Arc;

use pulp::Arch;

use super::kernel::{Carried, Force, Slot, Tree};
use crate::model::Model;

/// What forward and inverse dynamics need of one robot: its compiled tree, and one entry per body in each list.
#[derive(Debug, Clone)]
pub(super) struct LinkScratch {
    pub(super) model: Model,
    pub(super) tree: Arc<Tree>,
    /// Instruction set of the processor.
    pub(super) arch: Arch,
    pub(super) slots: Vec<Slot<f64>>,
    pub(super) carried: Vec<Carried<f64>>,
    pub(super) external: Vec<Force<f64>>,
}

impl LinkScratch {
    /// Allocates.
    pub(super) fn new(model: &Model) -> Self {
        let tree = Tree::shared(model);
        Self {
            model: model.clone(),
            arch: Arch::new(),
            slots: vec![Slot::new(0.0); tree.bodies.len()],
            carried: vec![Carried::new(0.0); tree.bodies.len()],
            external: vec![Force::zero(0.0); tree.bodies.len()],
            tree,
        }
    }
}
