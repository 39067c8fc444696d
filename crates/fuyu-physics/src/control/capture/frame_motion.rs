//! Motion of a frame.

use nalgebra::{Rotation3, Translation3, Vector3};

use crate::spatial::{Pose, Twist};

/// Motion of a frame at one time: pose, twist of its origin and rate of change of the twist, axes of I.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameMotion {
    /// Pose in I.
    pub X: Pose,
    /// Angular velocity and velocity of the origin.
    pub V: Twist,
    /// Angular acceleration, and acceleration of the origin.
    pub A: Twist,
}

impl FrameMotion {
    /// The motion of another frame fixed to the same body, at `X_FG`.
    #[must_use]
    pub fn of_fixed(&self, X_FG: &Pose) -> Self {
        let r = self.X.rotation * X_FG.translation.vector;
        let (w, alpha) = (self.V.angular, self.A.angular);
        Self {
            X: self.X * X_FG,
            V: Twist::new(w, self.V.linear + w.cross(&r)),
            A: Twist::new(
                alpha,
                self.A.linear + alpha.cross(&r) + w.cross(&w.cross(&r)),
            ),
        }
    }

    /// The motion of a frame with the same axes, whose origin is at `offset` in this frame and moves in it with `rate`
    /// and `acceleration`.
    #[must_use]
    pub fn with_offset(
        &self,
        offset: &Vector3<f64>,
        rate: &Vector3<f64>,
        acceleration: &Vector3<f64>,
    ) -> Self {
        let [rate, acceleration] = [rate, acceleration].map(|v| self.X.rotation * v);
        let mut moved = self.of_fixed(&Pose::from_parts(
            Translation3::from(*offset),
            Rotation3::identity(),
        ));
        moved.V.linear += rate;
        moved.A.linear += acceleration + self.V.angular.cross(&rate) * 2.0;
        moved
    }
}
