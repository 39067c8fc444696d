//! The wrench that a part of a rigid robot exerts on the rest through a joint.

use super::Floating;
use crate::model::Frame;
use crate::spatial::{Pose, Wrench};

impl Floating {
    /// Wrench that body `b` and its subtree exert on the rest of the robot through the body's joint: torque about the
    /// base's origin \[N m\] and force \[N\], base axes. `wrenches` are external ones on the bodies, each about its
    /// body's origin in the body's axes.
    ///
    /// It is the rate of momentum of the rest minus `wrenches` on it (Newton's and Euler's laws for each body of the rest),
    /// so it is also valid while the subtree holds or touches other bodies. Needs the accelerations of this instant
    /// ([`Floating::accelerations`]).
    ///
    /// # Panics
    /// If there is no body `b`, or `wrenches` are not one per body.
    pub fn transmitted_wrench(&self, b: usize, wrenches: &[Wrench]) -> Wrench {
        let (bodies, workspace) = (self.model().bodies(), self.workspace());
        assert_eq!(wrenches.len(), bodies.len(), "one wrench per body");
        let beyond = b..bodies[b].subtree_end;
        let mut total_B = Wrench::ZERO;
        for (index, body) in bodies.iter().enumerate() {
            if beyond.contains(&index) {
                continue;
            }
            let frame = Frame {
                name: String::new(),
                body: index,
                parent: None,
                X_BF: Pose::identity(),
            };
            let (X, w) = (workspace.X_BF(&frame), workspace.V_WF_B(&frame).angular);
            let A = workspace.A_WF_B(&frame);
            let (inertia, alpha) = (&body.inertia, A.angular);
            let arm = X.rotation * inertia.com;
            let force = inertia.mass * (A.linear + alpha.cross(&arm) + w.cross(&w.cross(&arm)));
            let I = X.rotation * inertia.about_com * X.rotation.inverse();
            let torque = I * alpha + w.cross(&(I * w));
            let p_com = X.translation.vector + arm;
            total_B += Wrench::new(torque + p_com.cross(&force), force);
            total_B += wrenches[index].shifted_to_parent(&X) * -1.0;
        }
        total_B
    }
}
