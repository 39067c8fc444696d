//! One closure: which frames, which directions, how far it is open.

use nalgebra::{DMatrix, Matrix6xX, Rotation3, Vector3};

use super::LoopError;
use crate::dynamics::Workspace;
use crate::model::{Frame, Model};

/// A direction of the motion of frame B against frame A.
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

    /// Its name.
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

/// Two frames of a tree that are held together in some directions, with frame B at the origin of frame
/// A and in its axes when the loop is closed.
///
/// What stays free says what joint closes the loop: all translations and two rotations constrained are a
/// hinge about the third axis; all but one translation a slider; three translations a ball. A hinge holds
/// the third axes of A and B together, and with a single rotation constrained the loop is closed by a
/// universal joint (one axis fixed in A, the other in B).
#[derive(Debug, Clone, PartialEq)]
pub struct LoopClosure {
    /// Name, for messages.
    pub name: String,
    /// First end; its axes are those of the constrained directions.
    pub frame_a: Frame,
    /// Second end.
    pub frame_b: Frame,
    /// Whether each of [`Direction::ALL`] is constrained.
    pub constrained: [bool; 6],
}

/// How far a loop is open.
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

    /// Where B stands in A: its origin and its axes, in A's axes.
    fn placed(&self, workspace: &Workspace) -> (Vector3<f64>, Rotation3<f64>) {
        let X_AB = workspace.X_BF(&self.frame_a).inverse() * workspace.X_BF(&self.frame_b);
        (X_AB.translation.vector, X_AB.rotation)
    }

    /// Displacement of B from A in all directions \[m, rad\], those that are free included.
    pub(super) fn displacement(&self, workspace: &Workspace) -> [f64; 6] {
        let (p, R_AB) = self.placed(workspace);
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
            // NaN must not be lost in a comparison.
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
            let swept = Vector3::from(a.fixed_rows::<3>(3)).cross(&d);
            let linear = to_A * (b.fixed_rows::<3>(0) - a.fixed_rows::<3>(0) - swept);
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
        let swept = w_A.cross(&d);
        let v = V_B.linear - V_A.linear - swept;
        let linear = to_A
            * (A_B.linear
                - A_A.linear
                - A_A.angular.cross(&d)
                - w_A.cross(&swept)
                - w_A.cross(&v) * 2.0);
        let w = V_B.angular - w_A;
        let angular = to_A * (A_B.angular - A_A.angular - w_A.cross(&w));
        let R_AB = to_A * X_BB.rotation;
        let rotation = match self.rotation_normal(&R_AB) {
            Some(normal) => {
                // One of the normal's two axes turns with B.
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

    /// With a single rotation constrained: the direction about which B is held, in A's axes.
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

/// The axes of the universal joint that leaves all rotations but that about axis `i` free, in A's axes: the
/// one after `i`, fixed in A, and the one after that, fixed in B.
fn universal_axes(R_AB: &Rotation3<f64>, i: usize) -> (Vector3<f64>, Vector3<f64>) {
    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
    (Vector3::ith(j, 1.0), R_AB * Vector3::ith(k, 1.0))
}

/// The rotation vector, to full precision near the identity, where the trace has none.
fn rotation_vector(R_AB: &Rotation3<f64>) -> Vector3<f64> {
    let m = R_AB.matrix();
    let skew = Vector3::new(
        m[(2, 1)] - m[(1, 2)],
        m[(0, 2)] - m[(2, 0)],
        m[(1, 0)] - m[(0, 1)],
    );
    let (sin, cos) = (0.5 * skew.norm(), 0.5 * (m.trace() - 1.0));
    if sin < 1e-6 && cos < 0.0 {
        // Close to half a turn the skew part has none.
        R_AB.scaled_axis()
    } else if sin > 0.0 {
        skew * (0.5 * sin.atan2(cos) / sin)
    } else {
        Vector3::zeros()
    }
}

/// The smallest rotation, in A's axes, that takes A's axis `k` to B's.
fn misalignment(R_AB: &Rotation3<f64>, k: usize) -> Vector3<f64> {
    let (own, other) = (Vector3::ith(k, 1.0), R_AB * Vector3::ith(k, 1.0));
    let cross = own.cross(&other);
    let (sin, cos) = (cross.norm(), own.dot(&other));
    if sin > 0.0 {
        cross * (sin.atan2(cos) / sin)
    } else if cos < 0.0 {
        Vector3::ith((k + 1) % 3, std::f64::consts::PI)
    } else {
        Vector3::zeros()
    }
}
