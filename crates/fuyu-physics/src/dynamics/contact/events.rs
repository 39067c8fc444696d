//! Reports of a contact world: points, events, work.

use nalgebra::Vector3;

/// A collider of a [`ContactWorld`](super::ContactWorld).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ColliderId(pub(super) usize);

impl ColliderId {
    /// Number of the collider in the order in which they were added, from zero.
    pub fn index(self) -> usize {
        self.0
    }
}

/// A point at which two bodies touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    /// The two colliders.
    pub colliders: [ColliderId; 2],
    /// Where the forces act, world \[m\].
    pub at: Vector3<f64>,
    /// Unit normal from the second to the first, world axes.
    pub normal: Vector3<f64>,
    /// Depth \[m\].
    pub depth: f64,
    /// Force on the first body, world axes \[N\]; its opposite acts on the second.
    pub force: Vector3<f64>,
    /// Velocity of the first relative to the second along the surface, world axes \[m/s\].
    pub slip: Vector3<f64>,
}

/// A contact point begins or ends to touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactEvent {
    /// Time \[s\].
    pub time: f64,
    /// The two colliders.
    pub colliders: [ColliderId; 2],
    /// Number of the contact point within its pair of colliders.
    pub point: usize,
    /// Whether the contact begins.
    pub begins: bool,
}

/// Counts of the integration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ContactWork {
    /// Steps.
    pub steps: usize,
    /// Steps that were rejected and repeated with a shorter step.
    pub rejected: usize,
    /// Evaluations of the Jacobian.
    pub jacobians: usize,
    /// Events: contacts that began or ended.
    pub events: usize,
}
