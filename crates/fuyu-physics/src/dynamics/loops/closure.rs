//! One loop closure: its frames and directions, its gap, and its derivatives.

use nalgebra::{DMatrix, Matrix6xX, Rotation3, Vector3};

use super::LoopError;
use crate::dynamics::Workspace;
use crate::model::{Frame, Model};

/// A direction of the motion of frame B relative to frame A.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Translation along A's x axis.
    X,
    /// Translation along A's y axis.
    Y,
    /// Translation along A's z axis.
    Z,
    /// Rotation about A's x axis.
    Roll,
    /// Rotation about A's y axis.
    Pitch,
    /// Rotation about A's z axis.
    Yaw,
}

impl Direction {
    /// All directions, translations first.
    pub const ALL: [Self; 6] = [
        Self::X,
        Self::Y,
        Self::Z,
        Self::Roll,
        Self::Pitch,
        Self::Yaw,
    ];

    /// All directions by name. A bare `y` would be a boolean in a ROS parameter file.
    pub const NAMES: [(&'static str, Self); 6] = [
        ("along_x", Self::X),
        ("along_y", Self::Y),
        ("along_z", Self::Z),
        ("about_x", Self::Roll),
        ("about_y", Self::Pitch),
        ("about_z", Self::Yaw),
    ];

    /// Name in parameter files.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize].0
    }

    /// Whether it is a rotation.
    pub fn is_rotation(self) -> bool {
        self as usize >= 3
    }

    /// Unit of a displacement in this direction.
    pub fn unit(self) -> &'static str {
        if self.is_rotation() { "rad" } else { "m" }
    }
}

/// A constraint between two frames of a tree in some directions. When the loop is closed, frames A and B coincide, except in
/// the free directions.
///
/// The free directions determine the type of joint that closes the loop. With all translations and two rotations
/// constrained, it is a revolute joint about the third axis, which A and B share. With all directions constrained but one
/// translation, it is a prismatic joint; with three translations constrained, a spherical one; and with the translations
/// and one rotation constrained, a universal joint (one axis fixed in A, the other in B).
#[derive(Debug, Clone, PartialEq)]
pub struct LoopClosure {
    /// Name in messages.
    pub name: String,
    /// Frame A, along whose axes the directions are.
    pub frame_a: Frame,
    /// Frame B.
    pub frame_b: Frame,
    /// Whether each of [`Direction::ALL`] is constrained.
    pub constrained: [bool; 6],
}

/// Gap of an open loop.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LoopGap {
    /// Largest gap in a constrained translation \[m\].
    pub translation: f64,
    /// Largest gap in a constrained rotation \[rad\].
    pub rotation: f64,
}

impl LoopClosure {
    /// A closure between the links `frame_a` and `frame_b` of `model`.
    ///
    /// # Errors
    /// [`LoopError::UnknownFrame`]. [`Loops::new`](super::Loops::new) checks the rest.
    pub fn between(
        model: &Model,
        name: &str,
        frame_a: &str,
        frame_b: &str,
        constrained: &[Direction],
    ) -> Result<Self, LoopError> {
        let find = |frame: &str| {
            model.frame(frame).cloned().ok_or_else(|| {
                let known: Vec<_> = model.frames().iter().map(|f| f.name.as_str()).collect();
                LoopError::UnknownFrame {
                    closure: name.to_owned(),
                    frame: frame.to_owned(),
                    known: known.join(", "),
                }
            })
        };
        Ok(Self {
            name: name.to_owned(),
            frame_a: find(frame_a)?,
            frame_b: find(frame_b)?,
            constrained: Direction::ALL.map(|d| constrained.contains(&d)),
        })
    }

    /// The constrained directions.
    pub fn directions(&self) -> impl Iterator<Item = Direction> + '_ {
        Direction::ALL
            .into_iter()
            .filter(|d| self.constrained[*d as usize])
    }

    /// Which of the three rotations are constrained.
    fn rotations(&self) -> [bool; 3] {
        let [.., roll, pitch, yaw] = self.constrained;
        [roll, pitch, yaw]
    }

    /// Position and rotation of B in A.
    fn relative_pose(&self, workspace: &Workspace) -> (Vector3<f64>, Rotation3<f64>) {
        let X_AB = workspace.X_BF(&self.frame_a).inverse() * workspace.X_BF(&self.frame_b);
        (X_AB.translation.vector, X_AB.rotation)
    }

    /// Displacement of B from A in all directions, including the free ones \[m, rad\].
    pub(super) fn displacement(&self, workspace: &Workspace) -> [f64; 6] {
        let (p, R_AB) = self.relative_pose(workspace);
        let rotation = match self.rotations() {
            [true, true, true] => rotation_vector(&R_AB),
            [false, true, true] => misalignment(&R_AB, 0),
            [true, false, true] => misalignment(&R_AB, 1),
            [true, true, false] => misalignment(&R_AB, 2),
            single => match single.iter().position(|c| *c) {
                Some(i) => {
                    let (j, k) = universal_axes(&R_AB, i);
                    Vector3::ith(i, -j.dot(&k))
                }
                None => Vector3::zeros(),
            },
        };
        [p.x, p.y, p.z, rotation.x, rotation.y, rotation.z]
    }

    /// The gap in the constrained directions.
    pub(super) fn gap(&self, workspace: &Workspace) -> LoopGap {
        let displacement = self.displacement(workspace);
        let mut gap = LoopGap::default();
        for direction in self.directions() {
            let open = displacement[direction as usize].abs();
            let worst = if direction.is_rotation() {
                &mut gap.rotation
            } else {
                &mut gap.translation
            };
            // Comparisons with NaN are false, but a NaN must be reported.
            if open > *worst || open.is_nan() {
                *worst = open;
            }
        }
        gap
    }

    /// Writes the constraints' gradients with respect to joint positions, one column per constrained
    /// direction from column `first` on (n rows), rotations times `length` \[m\]. The Jacobians are scratch.
    pub(super) fn gradients(
        &self,
        workspace: &Workspace,
        length: f64,
        (J_A, J_B): (&mut Matrix6xX<f64>, &mut Matrix6xX<f64>),
        first: usize,
        out: &mut DMatrix<f64>,
    ) {
        workspace.fixed_base_jacobian(&self.frame_a, J_A);
        workspace.fixed_base_jacobian(&self.frame_b, J_B);
        let (X_BA, X_BB) = (workspace.X_BF(&self.frame_a), workspace.X_BF(&self.frame_b));
        let d = X_BB.translation.vector - X_BA.translation.vector;
        let to_A = X_BA.rotation.inverse();
        let normal = self.rotation_normal(&(to_A * X_BB.rotation));
        for (j, (a, b)) in J_A.column_iter().zip(J_B.column_iter()).enumerate() {
            let angular = to_A * (b.fixed_rows::<3>(3) - a.fixed_rows::<3>(3));
            let w_cross_d = Vector3::from(a.fixed_rows::<3>(3)).cross(&d);
            let linear = to_A * (b.fixed_rows::<3>(0) - a.fixed_rows::<3>(0) - w_cross_d);
            for (k, direction) in self.directions().enumerate() {
                out[(j, first + k)] = match direction {
                    Direction::X => linear.x,
                    Direction::Y => linear.y,
                    Direction::Z => linear.z,
                    rotation => match normal {
                        Some(normal) => normal.dot(&angular) * length,
                        None => angular[rotation as usize - 3] * length,
                    },
                };
            }
        }
    }

    /// Second derivative with respect to time of the displacement in every direction \[m/s², rad/s²\], for
    /// the accelerations that `workspace` holds.
    pub(super) fn acceleration(&self, workspace: &Workspace) -> [f64; 6] {
        let (X_BA, X_BB) = (workspace.X_BF(&self.frame_a), workspace.X_BF(&self.frame_b));
        let (V_A, V_B) = (
            workspace.V_WF_B(&self.frame_a),
            workspace.V_WF_B(&self.frame_b),
        );
        let (A_A, A_B) = (
            workspace.A_WF_B(&self.frame_a),
            workspace.A_WF_B(&self.frame_b),
        );
        let d = X_BB.translation.vector - X_BA.translation.vector;
        let to_A = X_BA.rotation.inverse();
        let w_A = V_A.angular;
        let w_cross_d = w_A.cross(&d);
        let v = V_B.linear - V_A.linear - w_cross_d;
        let linear = to_A
            * (A_B.linear
                - A_A.linear
                - A_A.angular.cross(&d)
                - w_A.cross(&w_cross_d)
                - w_A.cross(&v) * 2.0);
        let w = V_B.angular - w_A;
        let angular = to_A * (A_B.angular - A_A.angular - w_A.cross(&w));
        let R_AB = to_A * X_BB.rotation;
        let rotation = match self.rotation_normal(&R_AB) {
            Some(normal) => {
                // One of the two axes is fixed in B.
                let i = self.rotations().iter().position(|c| *c).unwrap_or(0);
                let (j, k) = universal_axes(&R_AB, i);
                let w = to_A * w;
                Vector3::ith(i, normal.dot(&angular) - j.dot(&w.cross(&w.cross(&k))))
            }
            None => angular,
        };
        [
            linear.x, linear.y, linear.z, rotation.x, rotation.y, rotation.z,
        ]
    }

    /// Axis of the constrained rotation in A's axes, if a single rotation is constrained.
    fn rotation_normal(&self, R_AB: &Rotation3<f64>) -> Option<Vector3<f64>> {
        let rotations = self.rotations();
        let mut constrained = (0..3).filter(|&i| rotations[i]);
        match (constrained.next(), constrained.next()) {
            (Some(i), None) => {
                let (j, k) = universal_axes(R_AB, i);
                Some(j.cross(&k))
            }
            _ => None,
        }
    }
}

/// Axes of the universal joint that constrains only the rotation about axis `i`, in A's axes: the axis after `i`, fixed
/// in A, and the next one, fixed in B.
fn universal_axes(R_AB: &Rotation3<f64>, i: usize) -> (Vector3<f64>, Vector3<f64>) {
    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
    (Vector3::ith(j, 1.0), R_AB * Vector3::ith(k, 1.0))
}

/// Rotation vector with full precision near the identity, where a formula with the trace loses all digits.
fn rotation_vector(R_AB: &Rotation3<f64>) -> Vector3<f64> {
    let m = R_AB.matrix();
    let skew = Vector3::new(
        m[(2, 1)] - m[(1, 2)],
        m[(0, 2)] - m[(2, 0)],
        m[(1, 0)] - m[(0, 1)],
    );
    let (sin, cos) = (0.5 * skew.norm(), 0.5 * (m.trace() - 1.0));
    if sin < 1e-6 && cos < 0.0 {
        // Close to 180° the skew-symmetric part loses all digits.
        R_AB.scaled_axis()
    } else if sin > 0.0 {
        skew * (0.5 * sin.atan2(cos) / sin)
    } else {
        Vector3::zeros()
    }
}

/// The smallest rotation, in A's axes, that takes A's axis `k` to B's axis `k`.
fn misalignment(R_AB: &Rotation3<f64>, k: usize) -> Vector3<f64> {
    let (axis_A, axis_B) = (Vector3::ith(k, 1.0), R_AB * Vector3::ith(k, 1.0));
    let cross = axis_A.cross(&axis_B);
    let (sin, cos) = (cross.norm(), axis_A.dot(&axis_B));
    if sin > 0.0 {
        cross * (sin.atan2(cos) / sin)
    } else if cos < 0.0 {
        Vector3::ith((k + 1) % 3, std::f64::consts::PI)
    } else {
        Vector3::zeros()
    }
}
