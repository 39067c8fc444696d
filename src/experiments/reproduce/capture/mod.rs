//! Capture: closed forms of impacts, friction and detumbling, and impulses computed by two other programs.

mod detumbling;
mod impacts;
mod impulses;

use super::Reproduction;

/// All reproductions on capture.
pub(super) const CAPTURE: &[Reproduction] = &[
    Reproduction {
        name: "capture-restitution",
        shows: "Hunt and Crossley 1975: restitution and duration of head-on impacts, against their closed forms",
        compute: impacts::restitution,
    },
    Reproduction {
        name: "capture-friction",
        shows: "oblique impacts with regularised friction, against the exact law of slip and Lambert's restitution",
        compute: impacts::friction,
    },
    Reproduction {
        name: "capture-impulse",
        shows: "a servicer grasps a target: twists, impulse and energy lost, against Pinocchio and maximal coordinates",
        compute: impulses::impulses,
    },
    Reproduction {
        name: "capture-detumbling",
        shows: "closed forms of detumbling: a limited force at the grasp point, couples, a joint's brake",
        compute: detumbling::detumbling,
    },
];
