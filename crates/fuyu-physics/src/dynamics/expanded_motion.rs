//! Motion of all joints of a tree, mimic joints included.

use super::TreeMotion;
use crate::model::Model;

/// Memory for positions and rates of all joints of a tree; empty without mimic joints. Their motion follows from that
/// of the coordinates ([`Coupling`](crate::model::Coupling)).
#[derive(Debug, Clone)]
pub(super) struct ExpandedMotion {
    q: Vec<f64>,
    qd: Vec<f64>,
}

impl ExpandedMotion {
    pub fn new(model: &Model) -> Self {
        let joints = match model.has_mimics() {
            true => model.tree_joints().len(),
            false => 0,
        };
        let zeros = vec![0.0; joints];
        Self {
            q: zeros.clone(),
            qd: zeros,
        }
    }

    /// Expands `motion`, which has positions and rates of the coordinates, to all joints of the tree.
    pub fn of<'a>(&'a mut self, model: &Model, motion: &TreeMotion<'a>) -> TreeMotion<'a> {
        if !model.has_mimics() {
            return *motion;
        }
        let Self { q, qd } = self;
        model.expand_positions(motion.q, q);
        model.expand_rates(motion.qd, qd);
        TreeMotion { q, qd, ..*motion }
    }
}
