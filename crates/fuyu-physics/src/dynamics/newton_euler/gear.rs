//! Gears: one free axis of a hinge follows that of another.

use super::Axis;
use crate::model::Model;

/// The displacement of `follower` is `ratio` times that of `leader`, plus `offset`: a constraint in addition to those
/// of TR-942, with a multiplier that is the effort of the gear on the follower.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gear {
    /// Hinge and free axis.
    pub leader: (usize, Axis),
    /// Hinge and free axis.
    pub follower: (usize, Axis),
    pub ratio: f64,
    pub offset: f64,
}

impl Gear {
    /// The gears of a robot's mimic joints; hinge `k + 1` is joint `k` of the tree, and `axis` gives its free axis.
    pub fn of(model: &Model, axis: impl Fn(usize) -> Axis) -> Vec<Self> {
        let gears = model.mimics().map(|mimic| {
            let (leader, follower) = (model.joint_body(mimic.coupling.coordinate), mimic.body);
            Self {
                leader: (leader, axis(leader - 1)),
                follower: (follower, axis(follower - 1)),
                ratio: mimic.coupling.ratio,
                offset: mimic.coupling.offset,
            }
        });
        gears.collect()
    }

    /// Follower and leader, with their weights in the constraint.
    pub fn ends(&self) -> [(usize, Axis, f64); 2] {
        let ((f, f_axis), (l, l_axis)) = (self.follower, self.leader);
        [(f, f_axis, 1.0), (l, l_axis, -self.ratio)]
    }
}
